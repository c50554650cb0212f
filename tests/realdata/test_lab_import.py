"""The recordings of the study's robots and the logs of its simulator, read.

They stay where they are; VIBROSWARM_RUGBOT names their folder.
"""

from __future__ import annotations

import polars as pl
import pytest

from vibroswarm.recordings.recording import Recording


def test_all_is_read_and_told(real: Recording) -> None:
    assert real.names == (1, 2, 3, 4, 5)
    told = [one["told"] for one in real.sessions]
    assert [one["rows"] for one in told] == [28063, 28038, 27626]
    assert [one["samples"] for one in told] == [1798, 1810, 1766]
    assert [one["samples_lost"] for one in told] == [2, 1, 1]
    assert all(one["counters_wrapped"] >= 30 for one in told)
    assert real.robots["decision"].to_list() == [0] * 15
    assert real.runs["consensus"].to_list() == ["right"] * 3
    spacing = real.motion.select(pl.col("time_s").diff().over("run", "robot")).drop_nulls()
    assert spacing.to_series().mean() == pytest.approx(3.33, abs=0.01)


def test_what_the_robots_ran_with(real: Recording) -> None:
    """DATA.md: theta_E 1.55, tau 2000 ms."""
    found = {one["name"]: one for one in real.inferred}
    assert found["sensor.rms_threshold"]["value"] == 1.55
    assert found["sample.sample_interval_ms"]["value"] == 2000


def test_what_the_simulator_ran_with(simulated: Recording) -> None:
    found = {one["name"]: one for one in simulated.inferred}
    assert found["sensor.rms_threshold"]["value"] == 1.33
    assert simulated.scenario.strategy.name == "none"
    assert found["sample.sample_interval_ms"]["value"] == 2000
    assert [one["told"]["rows_repeated"] for one in simulated.sessions] == [5, 5, 5]
