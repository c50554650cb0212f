"""Delay of the new answer after a floor is inverted, for strategies at an equal probability of leaving the right side.

    python benchmarks/change_delay.py [RUNS_TO_TUNE [RUNS_TO_TEST]]

Five robots, 10 x 10 tiles, inverted at 1200 s of 2400. A swarm has left the right side if at any time from 600 to
1200 s its answer (on which all robots agreed last) is not the right one. Settings are chosen on one seed: of those that
leave in at most 5 % of the runs, the one with the least mean delay. They are then simulated on another seed.
docs/figures/change.md has the numbers and what they mean.
"""

from __future__ import annotations

import math
import sys
import time
from itertools import product
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm import Result, Scenario, preset, replay, simulate
from vibroswarm.analysis.answers_over_time import swarm_answers
from vibroswarm.analysis.intervals import mean_interval, wilson

TUNING_SEED, TEST_SEED, CHANGE_S, END_S, FROM_S = 41, 42, 1200.0, 2400.0, 600.0
MOST: Final = 0.05
P_C: Final = (0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 0.98, 0.99, 0.995, 0.999)
MEMORIES: Final = (20.0, 30.0, 40.0, 50.0, 65.0, 80.0, 100.0, 125.0, 150.0, 200.0, 300.0)
GRIDS: Final[dict[str, dict[str, tuple[Any, ...]]]] = {
    "none": {"forget.memory": (0.0,)},
    "forget": {"forget.memory": MEMORIES},
    "reset": {
        "reset.threshold": (5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 14.0),
        "reset.least": (0.05, 0.08, 0.12, 0.18),
    },
    "fading": {
        "fading.memory_s": (60.0, 100.0, 150.0, 220.0, 300.0, 450.0),
        "fading.trust_limit": (1000.0,),
        "fading.broken_prior": (0.0,),
    },
}
"""Parameters of each entry; ``none`` is ``forget`` that forgets nothing, so that it may revise its answer."""


def base(fill: float) -> Scenario:
    return preset("paper").with_values({
        "floor.source": f"random:{fill}", "floor.rows": 10, "floor.columns": 10, "run.t_end_s": END_S,
        "change.at_s": CHANGE_S, "change.to": "invert", "decision.revise": True,
    })  # fmt: skip


def settings_of(name: str) -> list[dict[str, Any]]:
    strategy = "forget" if name == "none" else name
    grid = GRIDS[name]
    return [
        {"strategy.name": strategy, **{f"strategy.{k}": v for k, v in zip(grid, values, strict=True)}}
        for values in product(*grid.values())
    ]


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
    table = result.inference.join(result.motion, on=["run", "robot", "sample"], maintain_order="left")
    may_decide = pl.col("messages_received") + pl.col("sample") > result.scenario.decision.min_observations
    columns = table.select(
        "run", "time_s", "robot", below=pl.when(may_decide).then("belief_below").fill_null(math.nan)
    )
    return [
        Beliefs(*(run[name].to_numpy() for name in Beliefs._fields))
        for _, run in columns.group_by("run", maintain_order=True)
    ]


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
    """Whether a swarm left side 0 from 600 s to the change, and how long after that it answered 1."""
    first = max(int(np.searchsorted(time_s, FROM_S, side="right")) - 1, 0)
    last = int(np.searchsorted(time_s, CHANGE_S))
    new = np.flatnonzero((answer == 1) & (time_s >= CHANGE_S))
    at_change = answer[max(last - 1, 0)]
    delay_s = 0.0 if at_change == 1 else float(time_s[new[0]]) - CHANGE_S if new.size else END_S - CHANGE_S
    return bool((answer[first:last] != 0).any()), delay_s


def tuned(name: str, moved: Result, fill: float) -> dict[str, Any]:
    """The settings with the least mean delay among those that leave in at most 5 % of the runs."""
    best: tuple[float, dict[str, Any]] | None = None
    safest: tuple[float, dict[str, Any]] = (2.0, {})
    for values in settings_of(name):
        result = replay(moved, base(fill).with_values(values))
        runs, robots = beliefs_of(result), result.scenario.swarm.robots
        for p_c in P_C:
            left, delay = at_threshold(runs, p_c, robots)
            found = {**values, "decision.credible_threshold": p_c}
            safest = min(safest, (float(left.mean()), found), key=lambda one: one[0])
            if left.mean() <= MOST and (best is None or delay.mean() < best[0]):
                best = (float(delay.mean()), found)
    return safest[1] if best is None else best[1]


def tested(moved: Result, scenario: Scenario) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Whether each run left, and its delay, by the decisions of the robots themselves."""
    result = replay(moved, scenario)
    left, delay = [], []
    for run in result.runs["run"].to_list():
        answers = swarm_answers(result, run)
        time_s = np.array([0.0, *(one.since_s for one in answers)])
        answer = np.array([-1, *(one.answer for one in answers)])
        has_left, delay_s = judged(time_s, answer)
        left.append(has_left)
        delay.append(delay_s)
    return np.array(left), np.array(delay)


def main() -> None:
    to_tune, to_test = [int(one) for one in sys.argv[1:3]] + [200, 400][len(sys.argv[1:3]) :]
    names = sys.argv[3].split(",") if len(sys.argv) > 3 else list(GRIDS)
    rows, by_run = [], list[dict[str, Any]]()
    for fill in (0.4, 0.3):
        began = time.monotonic()
        moved = {
            seed: simulate(base(fill), seed, runs, energies=False, moves=True)
            for seed, runs in ((TUNING_SEED, to_tune), (TEST_SEED, to_test))
        }
        delays = {}
        for name in names:
            values = tuned(name, moved[TUNING_SEED], fill)
            left, delays[name] = tested(moved[TEST_SEED], base(fill).with_values(values))
            mean, share = mean_interval(delays[name], 0.95), wilson(int(left.sum()), left.size, 0.95)
            row = {
                "fill": fill, "strategy": name, **{k.split(".", 1)[1]: v for k, v in values.items()},
                "left": share.estimate, "left_low": share.low, "left_high": share.high,
                "delay_s": mean.estimate, "delay_low_s": mean.low, "delay_high_s": mean.high,
            }  # fmt: skip
            print({k: round(v, 4) if isinstance(v, float) else v for k, v in row.items()}, flush=True)
            rows.append(row)
            by_run += [
                {"fill": fill, "strategy": name, "run": run, "left": has_left, "delay_s": delay_s}
                for run, (has_left, delay_s) in enumerate(
                    zip(left.tolist(), delays[name].tolist(), strict=True)
                )
            ]
        for name in delays.keys() - {"forget"} if "forget" in delays else ():
            gain = mean_interval(delays[name] - delays["forget"], 0.95)
            print(
                f"{fill} {name} - forget: {gain.estimate:.0f} s [{gain.low:.0f}, {gain.high:.0f}]", flush=True
            )
        print(f"{time.monotonic() - began:.0f} s", flush=True)
    pl.DataFrame(rows, infer_schema_length=None).write_csv("change_delay.csv")
    pl.DataFrame(by_run).write_parquet("change_delay.parquet")


if __name__ == "__main__":
    main()
