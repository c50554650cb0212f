"""The calibration of the paper, from the study's recordings, which stay where they are."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from vibroswarm.paper.claims import decide
from vibroswarm.paper.item import CLAIMS, Settings
from vibroswarm.paper.items import items_named
from vibroswarm.paper.reproduce import reproduce


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


@pytest.mark.slow
@pytest.mark.long
def test_a_session_that_no_fit_has_seen_is_predicted(recordings: Path, tmp_path: Path) -> None:
    """The number of samples, and not with the timer of other experiments: the negative control."""
    settings = Settings(runs=9, columns=("calibrated",), recordings=recordings)
    made = reproduce(settings, tmp_path, items_named(["unseen-session"])).made[0]
    verdicts = {one.claim.id: one for one in decide(made.tables[CLAIMS])}
    turned = {one.claim.id: one for one in decide(made.tables["control"])}
    # Over nine seeds of the fit's search session 3 is predicted too large by 3.6 % (2.5 to 4.6): beyond the claim's 3 %
    # or open, as the seed has it. The others are within it, but for one seed (session 1, 3.1 %).
    assert verdicts["unseen-samples"].cells["holds"].to_list()[:2] == ["holds", "holds"]
    assert (verdicts["unseen-samples"].cells["estimate"].abs() < 0.05).all()
    assert turned["unseen-samples"].verdict == "not reproduced"
    assert (turned["unseen-samples"].cells["high"] < -0.15).all()  # a fifth fewer samples
    # With five seeds 4 to 6 of the 18 figures hold, the others are open, and 2 or 3 of the control fail.
    holds = verdicts["unseen-similarity"].cells["holds"].to_list()
    assert holds.count("holds") >= 3
    assert "fails" not in holds
    lost = turned["unseen-similarity"].cells.filter(pl.col("holds") == "fails")["cell"].to_list()
    assert {f"distance and angle, session {session}" for session in (2, 3)} <= set(lost)
    assert all(cell.startswith(("distance and angle", "avoidance time")) for cell in lost)
