"""Delay of the new answer after a floor is inverted, for strategies at an equal probability of leaving the right side.

    python benchmarks/change_delay.py [RUNS_TO_TUNE [RUNS_TO_TEST [STRATEGIES]]]

Five robots, 10 x 10 tiles, inverted at 1200 s of 2400. A swarm has left the right side if at any time from 600 to
1200 s its answer (on which all robots agreed last) is not the right one. Settings are tuned on one seed: for each
combination of ``GRIDS`` and p_c the memory or threshold with which 5 % of the runs leave, by interpolation between
those of the grid; of these the combination with the least mean delay. It is then measured on another seed, and printed
as a table.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterator
from itertools import product
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm import Result, Scenario, preset, replay, simulate
from vibroswarm.statistics.intervals import Interval, mean_interval, wilson
from vibroswarm.statistics.over_time import course_of

TUNING_SEED, TEST_SEED, CHANGE_S, END_S, FROM_S = 41, 42, 1200.0, 2400.0, 600.0
FILLS: Final = (0.4, 0.3)
LEAVE: Final = 0.05
P_C: Final = (0.52, 0.6, 0.7, 0.8, 0.9, 0.95)


class Grid(NamedTuple):
    """What is tuned of a strategy."""

    strategy: str
    tuned: str
    """Field of the strategy by which the share of runs that leave is set: larger values for fewer."""
    values: tuple[float, ...]
    others: dict[str, tuple[float, ...]]
    """Values of other fields; all combinations are tried."""


SURE = {"trust_limit": (1000.0,), "broken_prior": (0.0,)}
"""A floor that changes contradicts all senders at once."""
GRIDS: Final = {
    "none": Grid("forget", "memory", (0.0,), {}),
    "forget": Grid("forget", "memory", (15.0, 25.0, 40.0, 65.0, 90.0, 120.0, 160.0, 220.0), {}),
    "reset": Grid("reset", "threshold", (3.0, 4.5, 6.0, 8.0, 10.5, 14.0), {"least": (0.05, 0.12, 0.18)}),
    "fading": Grid("fading", "memory_s", (20.0, 35.0, 60.0, 100.0, 150.0, 220.0), SURE),
}
"""By the name of the entry; ``none`` is ``forget`` that forgets nothing, so that it may revise its answer."""

Settings = dict[str, Any]


def base(fill: float) -> Scenario:
    return preset("paper").with_values({
        "floor.source": f"random:{fill}", "floor.rows": 10, "floor.columns": 10, "run.t_end_s": END_S,
        "change.at_s": CHANGE_S, "change.to": "invert", "decision.revise": True,
    })  # fmt: skip


def settings(grid: Grid, values: dict[str, float], p_c: float) -> Settings:
    of_strategy = {f"strategy.{grid.strategy}.{name}": value for name, value in values.items()}
    return {"strategy.name": grid.strategy, **of_strategy, "decision.credible_threshold": p_c}


def forward(values: NDArray[np.int64]) -> NDArray[np.int64]:
    """Carry the last value that is not -1 forward along the first axis."""
    known = np.where(values != -1, np.arange(len(values)).reshape(-1, *[1] * (values.ndim - 1)), 0)
    return np.take_along_axis(values, np.maximum.accumulate(known, axis=0), axis=0)


class Beliefs(NamedTuple):
    """Samples of a run, (samples,) each."""

    time_s: NDArray[np.float64]
    robot: NDArray[np.uint16]
    below: NDArray[np.float64]
    """Belief that the share is below the boundary; nan while the robot has too few bits to decide."""


def beliefs_of(result: Result) -> list[Beliefs]:
    columns = result.inference.join(result.motion, on=["run", "robot", "sample"], maintain_order="left")
    counted = (columns["messages_received"] + columns["sample"]).to_numpy()
    below = np.where(
        counted > result.scenario.decision.min_observations, columns["belief_below"].to_numpy(), math.nan
    )
    first = np.flatnonzero(np.diff(columns["run"].to_numpy(), prepend=-1))[1:]
    arrays = columns["time_s"].to_numpy(), columns["robot"].to_numpy(), below
    return [Beliefs(*run) for run in zip(*(np.split(array, first) for array in arrays), strict=True)]


def at_threshold(
    runs: list[Beliefs], p_c: float, robots: int
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Whether each run left the right side, and its delay, had the robots decided at this threshold.

    Only decisions depend on the threshold, as messages are readings: they are made anew from the beliefs.
    """
    found = []
    for run in runs:
        own = np.full((run.below.size, robots), -1)
        own[np.arange(run.below.size), run.robot] = np.where(
            run.below > p_c, 0, np.where(1.0 - run.below > p_c, 1, -1)
        )
        own = forward(own)
        agreed = np.where((own == own[:, :1]).all(axis=1), own[:, 0], -1)
        found.append(judged(run.time_s, forward(agreed)))
    left, delay_s = zip(*found, strict=True)
    return np.array(left), np.array(delay_s)


def judged(time_s: NDArray[np.float64], answer: NDArray[np.int64]) -> tuple[bool, float]:
    """Whether a swarm left side 0 from 600 s to the change, and how long after that it answered 1.

    The delay is nan if it answers 1 at the change already.
    """
    first = max(int(np.searchsorted(time_s, FROM_S, side="right")) - 1, 0)
    last = int(np.searchsorted(time_s, CHANGE_S))
    new = np.flatnonzero((answer == 1) & (time_s >= CHANGE_S))
    delay_s = float(time_s[new[0]]) - CHANGE_S if new.size else END_S - CHANGE_S
    has_left = bool((answer[first:last] != 0).any())
    return has_left, math.nan if answer[max(last - 1, 0)] == 1 else delay_s


class Curve(NamedTuple):
    """Share of runs that leave, and mean delay, over the values of the tuned field, (values,) each."""

    others: dict[str, float]
    p_c: float
    left: NDArray[np.float64]
    delay_s: NDArray[np.float64]


def curves(grid: Grid, moved: Result, fill: float) -> Iterator[Curve]:
    """Yield the curve of each combination of the other fields and p_c."""
    for others in product(*grid.others.values()):
        fixed = dict(zip(grid.others, others, strict=True))
        found = []
        for value in grid.values:
            scenario = base(fill).with_values(settings(grid, {grid.tuned: value, **fixed}, 0.95))
            runs = beliefs_of(replay(moved, scenario))
            found.append([at_threshold(runs, p_c, scenario.swarm.robots) for p_c in P_C])
        for k, p_c in enumerate(P_C):
            left = np.array([of_value[k][0].mean() for of_value in found])
            delay_s = np.array([np.nanmean(of_value[k][1]) for of_value in found])
            yield Curve(fixed, p_c, left, delay_s)


def tuned(grid: Grid, moved: Result, fill: float) -> Settings:
    """The setting with the least mean delay among those with which a share ``LEAVE`` leaves, by interpolation.

    Above the value at which the shares first are that small, they may rise again: then robots are late at 600 s.
    """
    candidates = []
    for curve in curves(grid, moved, fill):
        few = np.flatnonzero(curve.left <= LEAVE)
        if few.size:
            at, before = int(few[0]), max(int(few[0]) - 1, 0)
            part = (curve.left[before] - LEAVE) / (curve.left[before] - curve.left[at]) if at else 0.0
            delay_s = float(curve.delay_s[before] * (1.0 - part) + curve.delay_s[at] * part)
            low, high = grid.values[before], grid.values[at]
            value = low * (high / low) ** part if low else high
            candidates.append((delay_s, round(value, 3), curve.others, curve.p_c))
    _, value, others, p_c = min(candidates, key=lambda one: one[0])
    return settings(grid, {grid.tuned: value, **others}, p_c)


def tested(moved: Result, scenario: Scenario) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Whether each run left, and its delay, by the decisions of the robots themselves."""
    result = replay(moved, scenario)
    left, delay = [], []
    for run in result.runs["run"].to_list():
        rows = result.motion.filter(run=run)
        columns = (rows["robot"].to_numpy(), rows["time_s"].to_numpy())
        decision = result.inference.filter(run=run)["decision"].to_numpy()
        counts = np.ones(scenario.swarm.robots, dtype=np.bool_)
        answers = course_of(scenario, result.floor(run), *columns, decision, counts, END_S).swarm
        time_s = np.array([0.0, *(one.since_s for one in answers)])
        answer = np.array([-1, *(one.answer for one in answers)])
        has_left, delay_s = judged(time_s, answer)
        left.append(has_left)
        delay.append(delay_s)
    return np.array(left), np.array(delay)


def setting_words(chosen: Settings) -> str:
    return ", ".join(f"{k.rsplit('.', 1)[1]} {v}" for k, v in chosen.items() if k != "strategy.name")


def words(found: Interval, scale: float = 1.0, digits: int = 0, sign: str = "") -> str:
    estimate, low, high = (scale * value for value in found[:3])
    return f"{estimate:{sign}.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs_to_tune", type=int, nargs="?", default=300, help="300 by default")
    parser.add_argument("runs_to_test", type=int, nargs="?", default=600, help="600 by default")
    parser.add_argument(
        "strategies", nargs="?", default=",".join(GRIDS), help="names with commas; by default all"
    )
    given = parser.parse_args()
    to_tune, to_test, names = given.runs_to_tune, given.runs_to_test, given.strategies.split(",")
    chosen: dict[float, dict[str, Settings]] = {fill: {} for fill in FILLS}
    print(
        "| floor | strategy | setting | left, % | delay, s | minus `forget`, s |\n|---|---|---|---|---|---|"
    )
    for fill in FILLS:
        began = time.process_time()
        moved = [
            simulate(base(fill), seed, runs, energies=False, moves=True)
            for seed, runs in ((TUNING_SEED, to_tune), (TEST_SEED, to_test))
        ]
        for name in names:
            chosen[fill][name] = tuned(GRIDS[name], moved[0], fill)
        tries = [(f".{fill * 10:.0f} to .{10 - fill * 10:.0f}", chosen[fill])]
        if fill != FILLS[0]:
            tries.append((f"{tries[0][0]}, as chosen at .{FILLS[0] * 10:.0f}", chosen[FILLS[0]]))
        for floor, choice in tries:
            measured = {name: tested(moved[1], base(fill).with_values(choice[name])) for name in names}
            for name, (left, delay_s) in measured.items():
                gain = ""
                if name != "forget" and "forget" in measured:
                    gain = words(mean_interval(delay_s - measured["forget"][1]), sign="+")
                share = words(wilson(int(left.sum()), left.size), 100.0, 1)
                cells = (
                    floor,
                    f"`{name}`",
                    setting_words(choice[name]),
                    share,
                    words(mean_interval(delay_s)),
                    gain,
                )
                print("|", " | ".join(cells), "|", flush=True)
        print(f"{time.process_time() - began:.0f} CPU s", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
