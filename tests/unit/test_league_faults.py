"""Faulty robots in a league: against plain loops, and which are borne."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from vibroswarm.league.entries import Entry, floors_of
from vibroswarm.league.fault_curves import FILL, MARGIN, _rise, _verdict, borne, fault_curves
from vibroswarm.league.standings import League
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate

BASE = preset("paper").with_values({"run.t_end_s": 300.0, "decision.min_observations": 60})
LEAGUE = League(BASE, (Entry("none", "none", {}),), floors_of(["stripe"], [0.48]), (4,), runs=3, seed=5)


def test_errors_are_those_of_plain_loops() -> None:
    """Run by run, with the faulty robots of the result's own table."""
    rows = {
        (row["kind"], row["faulty"]): row
        for row in fault_curves(LEAGUE, kinds=["stuck_at_1", "stopped"], most=2, runs=5).iter_rows(named=True)
    }
    assert len(rows) == 6
    asked = BASE.with_values({"swarm.robots": 4, "floor.rows": 10, "floor.columns": 10})

    def errors(kind: str, count: int) -> tuple[np.ndarray, np.ndarray]:
        total, faulty = np.zeros((5, 4)), np.zeros((5, 4), dtype=bool)
        for fill in (FILL, round(1 - FILL, 6)):
            values = {"floor.source": f"random:{fill}", f"faults.{kind}": count / 4}
            result = simulate(asked.with_values(values), LEAGUE.seed + 2, 5)
            for row in result.robots.iter_rows(named=True):
                p, answer = row["belief_in_truth"], row["decision"]
                leans = 0.5 if p is None or p == 0.5 else float(p < 0.5)
                truth = int(fill > 0.5)
                total[row["run"], row["robot"]] += (leans if answer == -1 else abs(answer - truth)) / 2
            if result.faults is not None:
                for row in result.faults.iter_rows(named=True):
                    faulty[row["run"], row["robot"]] = True
        return total, faulty

    for kind in ("stuck_at_1", "stopped"):
        without, _ = errors(kind, 0)
        for count in (1, 2):
            found, faulty = errors(kind, count)
            assert faulty.sum(axis=1).tolist() == [count] * 5
            mine = [found[r, ~faulty[r]].mean() for r in range(5)]
            before = [without[r, ~faulty[r]].mean() for r in range(5)]
            row = rows[kind, count]
            assert row["forced_error"] == pytest.approx(np.mean(mine))
            assert row["rise"] == pytest.approx(np.mean(mine) - np.mean(before))
        assert rows[kind, 0]["forced_error"] == pytest.approx(without.mean())


@pytest.mark.slow
def test_a_stuck_sensor_is_not_borne_and_a_radio_that_dies_last_is() -> None:
    """Negative control: one of four robots stuck at 1 makes the others wrong on one side."""
    late = replace(LEAGUE, base=BASE.with_values({"faults.radio_dead_from_s": 290.0}))
    curves = fault_curves(late, kinds=["stuck_at_1", "radio_dead"], most=1, runs=150)
    rows = {(row["kind"], row["faulty"]): row for row in curves.iter_rows(named=True)}
    assert rows["stuck_at_1", 1]["bears"] is False
    assert rows["stuck_at_1", 1]["rise_low"] > 3 * MARGIN
    assert rows["radio_dead", 1]["bears"] is True
    assert {row["kind"]: row["borne"] for row in borne(curves).iter_rows(named=True)} == {
        "stuck_at_1": 0, "radio_dead": 1,
    }  # fmt: skip


def test_runs_without_a_rise_do_not_say_how_large_rises_are() -> None:
    """By the one small fall among four runs, no rise above 3 points was thought possible: "tolerated"."""
    falls, before = np.array([0.2375, 0.3, 0.3, 0.3]), np.full(4, 0.3)
    assert _rise(falls, before).high == pytest.approx(0.4899, abs=1e-4)  # Wilson's of 0 of 4
    assert _rise(np.repeat(falls, 19), np.repeat(before, 19)).high < MARGIN
    assert _rise(before, falls).high == pytest.approx(0.0653, abs=1e-4)  # Student's of three 0 and 0.0625


def test_what_is_borne_ends_at_the_first_number_that_is_not() -> None:
    verdicts = {"a": [True, None, True], "b": [True, True], "c": [False, True], "d": [None]}
    curves = pl.DataFrame(
        [
            {"name": name, "kind": "opposite", "faulty": k, "bears": verdict}
            for name, found in verdicts.items()
            for k, verdict in enumerate([None, *found])
        ]
    )
    rows = {row["name"]: (row["borne"], row["open"]) for row in borne(curves).iter_rows(named=True)}
    limits = [(-MARGIN, MARGIN / 2), (MARGIN / 2, 2 * MARGIN), (2 * MARGIN, 3 * MARGIN), (None, None)]
    found = [_verdict({"rise_low": low, "rise_high": high}) for low, high in limits]
    assert found == [True, None, False, None]
    assert rows == {"a": (1, True), "b": (2, False), "c": (0, False), "d": (0, True)}


def test_of_one_robot_none_can_be_faulty() -> None:
    curves = fault_curves(replace(LEAGUE, robots=(1,)))
    assert curves.is_empty()
    assert borne(curves).is_empty()
