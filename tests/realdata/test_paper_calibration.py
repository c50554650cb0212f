"""The calibration of the paper, from the study's recordings, which stay where they are."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from vibroswarm.paper.item import Settings, items_named
from vibroswarm.paper.reproduce import reproduce


@pytest.mark.slow
def test_the_printed_similarities_come_out_and_say_little(recordings: Path, tmp_path: Path) -> None:
    pytest.importorskip("sklearn")
    settings = Settings(runs=9, columns=("paper",), recordings=recordings)
    found = reproduce(settings, tmp_path, items_named(["calibration"]))
    verdicts = {one.claim.id: one for one in found.decided}
    assert verdicts["calibration-printed"].verdict == "reproduced"
    places = verdicts["calibration-tells"].values.filter(pl.col("cell") == "places of samples")
    assert places["estimate"][0] < 0  # even scatter scores higher
    ours = verdicts["calibration-ours"].values.filter(pl.col("why") != "")
    assert ours["cell"].to_list() == ["places of samples"]
    (made,) = found.made
    states = made.tables["states"].filter(pl.col("source") == "real robots")
    avoiding, sensing = (
        states.filter(pl.col("state") == name)["time_share"][0] for name in ("avoiding", "sensing")
    )
    assert avoiding == pytest.approx(0.127, abs=0.005)
    assert sensing == pytest.approx(0.302, abs=0.005)
    for name in ("calibration-still", "calibration-places"):
        assert made.pictures[name].draw().numbers.height > 0
