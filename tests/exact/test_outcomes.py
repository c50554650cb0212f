"""Outcomes of robots and runs against plain loops, robot by robot."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vibroswarm.inference.outcomes import (
    CONSENSUS,
    robot_columns,
    run_columns,
)
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate
from vibroswarm.statistics.figures import Swarms, figures_of
from vibroswarm.statistics.intervals import generator
from vibroswarm.tasks import Asked, task

T_END = 100.0
CELLS, RUNS, SWARM = 3, 40, 3
FILLS = np.tile([0.2, 0.48, 0.5, 0.8], RUNS // 4)
BOUNDARIES = [0.5, 0.48, 0.3]
Arrays = dict[str, NDArray[Any]]


def run_figures(robots: Arrays, runs: Arrays, t_end_s: Any) -> Arrays:
    """Figures by run in the shape of the columns of runs."""
    shape = robots["decision"].shape[:-1]
    return {
        name: of_run.reshape(shape)
        for name, of_run in figures_of(Swarms.of_arrays(robots, runs, t_end_s)).items()
    }


def made_up(seed: int = 1) -> Arrays:
    """Finals of robots that decide, differ, or never do; some have no belief, some decide after T_end."""
    random, shape = generator(seed, "outcomes"), (CELLS, RUNS, SWARM)
    together = random.integers(-1, 2, shape[:2])[..., None]
    decision = np.where(random.random(shape) < 0.8, together, random.integers(-1, 2, shape)).astype(np.int8)
    belief = np.where(random.random(shape) < 0.1, np.nan, random.random(shape))
    return {
        "decision": decision,
        "decision_time_s": np.where(decision == -1, np.nan, random.uniform(1.0, 110.0, shape)),
        "belief_at_decision": np.where(decision == -1, np.nan, belief),
        "belief_below": belief,
        "alpha": random.integers(1, 99, shape).astype(np.uint32),
        "beta": random.integers(1, 99, shape).astype(np.uint32),
        "estimate": random.random(shape),
        "estimate_spread": random.uniform(0.01, 0.1, shape),
        "samples": random.integers(0, 9, shape).astype(np.uint32),
        "messages_received": random.integers(0, 9, shape).astype(np.uint32),
    }


def truth_of(fill: float, boundary: float) -> int | None:
    """1 above the boundary, 0 below, None on it: worked out here, not by the package."""
    return None if abs(fill - boundary) < 1e-12 else int(fill > boundary)


def tables_of(finals: Arrays) -> tuple[Arrays, Arrays]:
    found = [[truth_of(fill, boundary) for fill in FILLS] for boundary in BOUNDARIES]
    truth = np.array([[math.nan if one is None else float(one) for one in row] for row in found])
    ends = np.tile([T_END, T_END - 5e-10, T_END - 0.02, 3.0], RUNS // 4)
    runs = run_columns(finals["decision"], finals["decision_time_s"], FILLS, truth, ends, T_END)
    return robot_columns(finals, truth), runs


def mean_of(values: list[float]) -> float:
    there = [value for value in values if not math.isnan(value)]
    return sum(there) / len(there) if there else math.nan


def by_hand(finals: Arrays, cell: int, run: int) -> dict[str, Any]:
    """One run in plain Python."""
    fill, boundary = float(FILLS[run]), BOUNDARIES[cell]
    truth = None if abs(fill - boundary) < 1e-12 else int(fill > boundary)
    own = [{name: column[cell, run, k].item() for name, column in finals.items()} for k in range(SWARM)]
    right = wrong = undecided = 0
    times, beliefs, estimates = [], [], []
    misses, covers, scores = [], [], []
    for robot in own:
        if robot["decision"] == -1:
            undecided += 1
        elif truth is not None and robot["decision"] == truth:
            right += 1
        elif truth is not None:
            wrong += 1
        times.append(T_END if robot["decision"] == -1 else min(robot["decision_time_s"], T_END))
        sure = {None: math.nan, 0: robot["belief_below"], 1: 1.0 - robot["belief_below"]}
        beliefs.append(sure[truth])
        estimates.append(robot["estimate"])
        misses.append(abs(robot["estimate"] - fill))
        covers.append(float(misses[-1] <= 1.6448536269514722 * robot["estimate_spread"]))
        z = misses[-1] / robot["estimate_spread"]
        density, below = math.exp(-0.5 * z * z) / math.sqrt(2 * math.pi), 0.5 * math.erfc(-z / math.sqrt(2))
        scores.append(robot["estimate_spread"] * (z * (2 * below - 1) + 2 * density - 1 / math.sqrt(math.pi)))
    if undecided:
        consensus = "incomplete"
    elif len({robot["decision"] for robot in own}) > 1:
        consensus = "split"
    elif truth is None:
        consensus = "truth_undefined"
    else:
        consensus = "right" if own[0]["decision"] == truth else "wrong"
    doubts = [robot["belief_below"] if truth == 1 else 1.0 - robot["belief_below"] for robot in own]
    leaning = [
        0.5 if math.isnan(doubt) else float(doubt > 0.5) for doubt in doubts
    ]  # no belief is exactly 1/2
    forced = [
        lean if robot["decision"] == -1 else float(robot["decision"] != truth)
        for robot, lean in zip(own, leaning, strict=True)
    ]
    last = (
        max(robot["decision_time_s"] for robot in own)
        if consensus in ("right", "wrong", "truth_undefined")
        else None
    )
    known = truth is not None
    return {
        "consensus": consensus,
        "counts": (right, wrong, undecided),
        "consensus_time_s": math.nan if last is None else last,
        "decision_time_s": mean_of(times),
        "belief_in_truth": mean_of(beliefs),
        "estimate": mean_of(estimates),
        "estimate_error": mean_of(misses),
        "estimate_coverage": mean_of(covers),
        "estimate_crps": mean_of(scores),
        "stated": sum(not math.isnan(robot["estimate_spread"]) for robot in own),
        "sent": sum(robot["samples"] for robot in own) / SWARM,
        "right": right if known else math.nan,
        "wrong": wrong if known else math.nan,
        "undecided": undecided,
        "right_share": right / SWARM if known else math.nan,
        "wrong_share": wrong / SWARM if known else math.nan,
        "undecided_share": undecided / SWARM,
        "swarm_right": float(consensus == "right") if known else math.nan,
        "swarm_wrong": float(consensus == "wrong") if known else math.nan,
        "swarm_time_s": T_END if last is None else min(last, T_END),
        "robots": SWARM,
        "decided": right + wrong if known else math.nan,
        "robot_error": wrong / (right + wrong) if right + wrong else math.nan,
        "forced_error": sum(forced) / SWARM if known else math.nan,
        **{f"swarm_{name}": float(consensus == name) for name in ("split", "incomplete", "truth_undefined")},
        "swarm_error": float(consensus == "wrong") if consensus in ("right", "wrong") else math.nan,
        **{
            f"agreed_on_{answer}": float(all(robot["decision"] == answer for robot in own))
            for answer in (0, 1)
        },
        "agreed_on_other": float({robot["decision"] for robot in own} in [{k} for k in range(2, 16)]),
        "agreement_held": math.nan,
        # Of floors that change; tests/exact/test_change_strategies.py has them by hand.
        **dict.fromkeys(
            (
                *("right_at_decision", "right_time_share", "answer_delay_s", "false_changes_per_h"),
                "change_time_error_s",
                *("map_brier", "map_auc", "map_location_error_m", "detection_time_s"),
            ),
            math.nan,
        ),
    }


def differing(finals: Arrays, figures: Arrays, runs: Arrays) -> set[str]:
    """Names of figures that differ from those by hand in any run."""
    found = set()
    for cell in range(CELLS):
        for run in range(RUNS):
            hand = by_hand(finals, cell, run)
            if CONSENSUS[runs["consensus"][cell, run]] != hand.pop("consensus"):
                found.add("consensus")
            if hand.pop("counts") != tuple(int(runs[n][cell, run]) for n in ("right", "wrong", "undecided")):
                found.add("counts")
            assert set(hand) == set(figures)
            for name, value in hand.items():
                if not np.isclose(figures[name][cell, run], value, rtol=1e-13, atol=0.0, equal_nan=True):
                    found.add(name)
    return found


def test_every_figure_is_that_by_hand() -> None:
    finals = made_up()
    robots, runs = tables_of(finals)
    figures = run_figures(robots, runs, np.full(CELLS, T_END))
    assert differing(finals, figures, runs) == set()
    seen = {CONSENSUS[k] for k in np.unique(runs["consensus"])}
    assert seen == set(CONSENSUS)  # the example has every outcome
    assert runs["stopped_early"].tolist() == [False, False, True, True] * (RUNS // 4)
    for cell in range(CELLS):
        alone = run_figures(
            {n: v[cell] for n, v in robots.items()}, {n: v[cell] if v.ndim > 1 else v for n, v in runs.items()}, T_END
        )  # fmt: skip
        for name, values in alone.items():
            np.testing.assert_array_equal(values, figures[name][cell])


@pytest.mark.parametrize(
    ("column", "changed", "told"),
    [
        ("decision", 1, {"consensus", "counts"}),
        ("belief_below", 0.123, {"belief_in_truth"}),
        ("estimate", 0.123, {"estimate", "estimate_error", "estimate_crps"}),
        ("decision_time_s", 3.0, {"decision_time_s"}),
    ],
)
def test_a_robot_that_is_changed_is_seen(column: str, changed: float, told: set[str]) -> None:
    """Negative control: the loops see a robot that differs."""
    finals = made_up()
    robots, runs = tables_of(finals)
    figures = run_figures(robots, runs, np.full(CELLS, T_END))
    cell, run, k = (
        int(i[0]) for i in np.nonzero((finals["decision"] == 0) & ~np.isnan(finals["belief_below"]))
    )
    other = finals[column].copy()
    other[cell, run, k] = changed
    assert told <= differing({**finals, column: other}, figures, runs)


def test_truth_is_none_on_the_boundary_only() -> None:
    floor = preset("paper").floor_for(1, 0)
    for fill, boundary, truth in ((0.5, 0.5, None), (0.5 + 1e-13, 0.5, None), (0.1 + 0.2, 0.3, None),
                                  (0.500001, 0.5, 1), (0.48, 0.5, 0)):  # fmt: skip
        assert task("fill_ratio").truth(floor, Asked(1.0, 1.0, fill, boundary), None) == truth


def test_each_run_has_fill_ratio_and_truth_of_its_own_floor() -> None:
    values = {"floor.source": "patch:0.1..0.9", "decision.decision_boundary": 0.3, "run.t_end_s": 10.0}
    result = simulate(preset("paper").with_values(values), 1, 6)
    fills = [result.floor(run).fill_ratio_within(1.0, 1.0) for run in range(6)]
    truths = [truth_of(fill, 0.3) for fill in fills]
    assert set(truths) == {0, 1}
    assert (result.runs["fill_ratio"].to_list(), result.runs["truth"].to_list()) == (fills, truths)


@pytest.fixture(scope="module")
def paper() -> Result:
    return simulate(preset("paper"), 1, 4, energies=False)
