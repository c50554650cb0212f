"""The calibration of the paper, from the study's recordings, which stay where they are."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from vibroswarm.paper.claims import decide
from vibroswarm.paper.item import CLAIMS, Settings
from vibroswarm.paper.items import items_named
from vibroswarm.paper.reproduce import reproduce


@pytest.mark.slow
def test_the_printed_similarities_come_out_and_say_little(recordings: Path, tmp_path: Path) -> None:
    pytest.importorskip("sklearn")
    settings = Settings(runs=9, columns=("paper",), recordings=recordings)
    made = reproduce(settings, tmp_path, items_named(["calibration"])).made[0]
    verdicts = {one.claim.id: one for one in decide(made.tables[CLAIMS])}
    assert verdicts["calibration-printed"].verdict == "reproduced"
    places = verdicts["calibration-tells"].cells.filter(pl.col("cell") == "places of samples")
    assert places["estimate"][0] < 0  # even scatter scores higher
    ours = verdicts["calibration-ours"].cells
    assert ours.filter(pl.col("why").is_not_null())["cell"].to_list() == ["places of samples"]
    states = made.tables["states"].filter(pl.col("source") == "real robots")
    assert states["avoiding"].mean() == pytest.approx(0.127, abs=0.005)
    assert states["sensing"].mean() == pytest.approx(0.302, abs=0.005)
    pictures = {picture.figure.name: picture.figure for picture in made.item.pictures(made.tables, settings)}
    assert len(pictures) == 8
    for name in ("calibration-still", "calibration-places"):
        assert pictures[name].draw("column").numbers.height > 0
