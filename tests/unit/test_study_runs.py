"""Runs as frames: selecting, grouping, pandas."""

from __future__ import annotations

import polars as pl
import pytest
from polars.testing import assert_frame_equal

from vibroswarm import InputError, Runs, Study, preset

SHORT = preset("paper").with_values({"run.t_end_s": 60.0, "swarm.robots": 2})


@pytest.fixture(scope="module")
def runs() -> Runs:
    return Study.of(
        SHORT, 12, 3, floor__source=["random:0.44", "diagonal:0.46"], strategy__name=["none", "soft"]
    ).run()


def test_where_selects_by_what_is_varied(runs: Runs) -> None:
    assert [cell.number for cell in runs.where(strategy__name="soft").cells] == [1, 3]
    one = runs.where(floor__source="diagonal:0.46", strategy__name=["soft"])
    assert one.frame.height == 12
    assert_frame_equal(one.robots, runs.robots.filter(pl.col("cell") == 3))
    with pytest.raises(InputError, match="no cell has"):
        runs.where(strategy__name="positive")


def test_frames_say_what_is_missing(runs: Runs) -> None:
    frame, robots = runs.frame, runs.robots
    assert frame.columns[:3] == ["cell", "floor.source", "strategy.name"]
    assert robots["undecided"].to_list() == robots["decision_time_s"].is_null().to_list()
    assert frame["swarm_undecided"].to_list() == frame["consensus_time_s"].is_null().to_list()
    assert frame["swarm_right"].dtype == pl.Boolean
    counted = robots.group_by("cell", "run", maintain_order=True).agg(pl.col("undecided").sum())
    assert frame["robots_undecided"].to_list() == counted["undecided"].to_list()


def test_pandas_in_one_call(runs: Runs) -> None:
    mean = runs.to_pandas().groupby(["floor.source", "strategy.name"])["distance_m"].mean()
    own = runs.where(floor__source="random:0.44", strategy__name="none").frame["distance_m"].mean()
    assert mean["random:0.44", "none"] == pytest.approx(own)
    assert len(runs.to_pandas("robots")) == runs.robots.height
