"""Figures of a cell and incidence over time: by hand on four runs, against plain loops, and of 100,000 runs."""

from __future__ import annotations

import math

import polars as pl
import pytest

from vibroswarm.inference.outcomes import ROBOTS, RUNS
from vibroswarm.statistics.figures import summary
from vibroswarm.statistics.incidence import robot_incidence, swarm_incidence
from vibroswarm.statistics.intervals import mean_interval, wilson

T_END = 100.0
Cell = tuple[pl.DataFrame, pl.DataFrame]


def truth_of(fill: float, boundary: float) -> int | None:
    """1 above the boundary, 0 below, None on it: worked out here, not by the package."""
    return None if abs(fill - boundary) < 1e-12 else int(fill > boundary)


def cell(decisions: list[list[int]], times: list[list[float | None]], fill: float = 0.4) -> Cell:
    """Tables of robots and runs; the truth is 0 unless the fill ratio says otherwise."""
    truth, rows, of_runs = truth_of(fill, 0.5), [], []
    for run, (who, when) in enumerate(zip(decisions, times, strict=True)):
        for robot, (d, t) in enumerate(zip(who, when, strict=True)):
            belief = 0.6 if d == -1 else 0.97 if d == 0 else 0.02
            sure = None if truth is None else belief if truth == 0 else 1 - belief
            rows.append(
                (run, robot, d, t, None if d == -1 else belief, belief, sure, 9, 5, 9 / 14, 0.1, 12, 12, 0)
            )
        right, wrong = (0, 0) if truth is None else (who.count(truth), who.count(1 - truth))
        left, alike = who.count(-1), len(set(who)) == 1
        outcome = (
            "incomplete" if left else "split" if not alike else "truth_undefined" if truth is None else None
        )
        outcome = outcome or ("right" if right else "wrong")
        last = None if outcome in ("incomplete", "split") else max(t for t in when if t is not None)
        of_runs.append((run, outcome, last, fill, truth, right, wrong, left, T_END, False))
    return (
        pl.DataFrame(rows, schema=ROBOTS, orient="row"),
        pl.DataFrame(of_runs, schema=RUNS, orient="row"),
    )


FOUR = cell(
    [[0, 0], [0, 1], [1, 1], [0, -1]],
    [[10.0, 20.0], [30.0, 30.0], [40.0, 60.0], [50.0, None]],
)


def test_four_runs_by_hand() -> None:
    s = summary(*FOUR, T_END)
    shares = (
        s["swarm_right"],
        s["swarm_wrong"],
        s["swarm_split"],
        s["swarm_incomplete"],
        s["swarm_truth_undefined"],
    )
    assert [i.estimate for i in shares] == [0.25, 0.25, 0.25, 0.25, 0.0]
    assert s["swarm_right"] == wilson(1, 4)
    assert (s["agreed_on_0"], s["agreed_on_1"]) == (wilson(1, 4), wilson(1, 4))
    assert s["agreed_on_other"] == wilson(0, 4)
    third = [[2, 2], [1, 1], [0, 2], [3, 3]]
    assert summary(*cell(third, [[1.0, 1.0]] * 4), T_END)["agreed_on_other"] == wilson(2, 4)
    assert math.isnan(s["agreement_lasted"].estimate)  # decisions are final
    assert s["swarm_error"] == wilson(1, 2)
    student = mean_interval([20.0, 100.0, 60.0, 100.0])
    assert s["consensus_time_s"] == student._replace(high=T_END)  # no time is later
    assert s["consensus_median_s"].estimate == math.inf  # only two of four runs ever got there
    robots = (s["robots_right"], s["robots_wrong"], s["robots_undecided"], s["robot_error"])
    assert [i.estimate for i in robots] == pytest.approx([4 / 8, 3 / 8, 1 / 8, 3 / 7])
    assert s["decision_time_s"] == mean_interval([15.0, 30.0, 50.0, 75.0])
    assert s["belief_in_truth"].estimate == pytest.approx((4 * 0.97 + 3 * 0.02 + 0.6) / 8)


def test_no_runs_at_all() -> None:
    robots, runs = (frame.clear() for frame in FOUR)
    assert summary(robots, runs, T_END)["robots_right"].n == 0


def test_incidence_by_hand() -> None:
    frame = robot_incidence(*FOUR, T_END, [0.0, 30.0, 100.0])
    assert frame["right"].to_list() == pytest.approx([0, 3 / 8, 4 / 8])
    assert frame["wrong"].to_list() == pytest.approx([0, 1 / 8, 3 / 8])
    assert frame["undecided"].to_list() == pytest.approx([1, 4 / 8, 1 / 8])
    swarm = swarm_incidence(*FOUR, T_END, [19.9, 20.0, 60.0])
    assert swarm["right"].to_list() == [0, 0.25, 0.25]
    assert swarm["wrong"].to_list() == [0, 0, 0.25]
    assert swarm["open"].to_list() == [1, 0.75, 0.5]
    assert swarm["right_high"][0] == pytest.approx(wilson(0, 4).high)


def test_runs_robots_and_rows_in_any_order() -> None:
    robots, runs = FOUR
    mixed = robots.sample(fraction=1.0, shuffle=True, seed=4), runs.reverse()
    found = summary(*mixed, T_END)
    for name, one in summary(*FOUR, T_END).items():
        assert found[name][:3] == pytest.approx(one[:3], nan_ok=True)


def test_coverage_is_a_share_of_the_robots_that_state_a_spread() -> None:
    """In the first run both robots hold the number; in the others one of two states a spread, which does not."""
    robots, runs = cell([[0, 0]] * 3, [[10.0, 20.0]] * 3)
    held = pl.Series("estimate", [0.4, 0.4, 0.9, None, 0.9, None])
    spread = pl.Series("estimate_spread", [0.1, 0.1, 0.1, None, 0.1, None])
    found = summary(robots.with_columns(held, spread), runs, T_END)["estimate_coverage"]
    assert found.estimate == pytest.approx(2 / 4)
    assert found.low < 2 / 4 < found.high


def test_limits_of_what_cannot_be_negative_are_not_below_zero() -> None:
    """Two runs, whose estimates differ by 0.01 and 0.05 from the number: Student's lower limit is -0.22."""
    robots, runs = cell([[0, 0]] * 2, [[10.0, 20.0]] * 2)
    estimates = pl.Series("estimate", [0.41, 0.41, 0.45, 0.45])
    sent = pl.Series("sent", [1, 1, 9, 9], dtype=ROBOTS["sent"])
    found = summary(robots.with_columns(estimates, sent), runs, T_END)
    for interval in (found["estimate_error"], found["estimate_crps"], found["sent"]):
        assert interval.low == 0.0
    assert found["estimate_error"].estimate == pytest.approx(0.03)
