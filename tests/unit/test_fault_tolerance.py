"""Robots that are judged: those that work, or all."""

from __future__ import annotations

import polars as pl
from polars.testing import assert_frame_equal

from vibroswarm.inference.outcomes import CONSENSUS
from vibroswarm.scenario.fault_draws import working
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate
from vibroswarm.study.fault_tolerance import judged_tables

QUICK = {"run.t_end_s": 300.0, "decision.min_observations": 40, "decision.credible_threshold": 0.9}


def test_judged_tables_are_those_of_a_swarm_of_the_robots_judged() -> None:
    """Against a count by hand, run by run."""
    faults = {"faults.battery_empty": 0.6, "faults.battery_life_s": [50.0, 400.0], "faults.stuck_at_1": 0.2}
    scenario = Scenario().with_values(QUICK | faults)
    result = simulate(scenario, 3, 12)
    robots, runs = judged_tables(scenario, 3, result.robots, result.runs)
    fine = working(scenario, 3, range(12))
    assert 0 < fine.sum() < fine.size
    assert robots.select("run", "robot").rows() == [(r, i) for r in range(12) for i in range(5) if fine[r, i]]
    for row in runs.to_dicts():
        own = robots.filter(pl.col("run") == row["run"])
        decided = own["decision"].to_list()
        assert row["undecided"] == decided.count(-1)
        assert row["right"] == decided.count(row["truth"])
        assert row["wrong"] == decided.count(1 - row["truth"])
        alike = len(set(decided)) == 1 and decided[0] != -1
        expected = (
            "incomplete" if -1 in decided else "split" if not alike else "right" if row["right"] else "wrong"
        )
        assert row["consensus"] == expected
        assert row["consensus_time_s"] == (own["decision_time_s"].max() if alike else None)
    assert set(runs["consensus"].to_list()) <= set(CONSENSUS)
    everyone = judged_tables(scenario, 3, result.robots, result.runs, "all")
    assert_frame_equal(everyone[0], result.robots)
    assert (runs["undecided"] <= result.runs["undecided"].gather(runs["run"].to_list())).all()
