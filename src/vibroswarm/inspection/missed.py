"""What an inspection would have missed: the probability of detection of damage drawn at its own places.

Model-assisted PoD: the damage is drawn from the law of the sensor, so that it is as right as this law. It holds for the
places and times of this inspection; another one has other places (``pooled_trials``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
import polars as pl

from vibroswarm.inspection.damage import squares_at
from vibroswarm.inspection.laws import law_of_scenario
from vibroswarm.inspection.patches import Patches, Shares, declared, shares_of
from vibroswarm.inspection.pod import INTACT, Pod, fit_pod
from vibroswarm.inspection.samples import Floats, Samples
from vibroswarm.inspection.scan import critical_value, drawn_statistics
from vibroswarm.inspection.sources import samples_of_result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate
from vibroswarm.statistics.intervals import generator

SIDES_M: Final = (0.03, 0.05, 0.07, 0.09, 0.12, 0.15, 0.2, 0.25, 0.3)
"""Sides of the drawn damage; on a surface that is smaller all are scaled down to it."""
EACH: Final = 60
"""Damaged surfaces drawn of each side."""


class Trials(NamedTuple):
    """Inspections of drawn damage, (inspections,) each, and of intact surfaces."""

    size_m: Floats
    found: Floats
    false: int
    intact: int

    def fit(self) -> Pod:
        """Return the fitted PoD."""
        return fit_pod(*self)


def own_trials(
    samples: Samples, patches: Patches, shares: Shares, critical: float, *, contrast: float = 1.0, each: int = EACH,
    intact: int = INTACT, seed: int = 2,
) -> Trials:  # fmt: skip
    """Draw damage, and intact surfaces, at the places of one inspection, and scan them."""
    random = generator(seed, f"damage of contrast {contrast:g}")
    sides_m = np.array(SIDES_M) * min(1.0, min(samples.size_m) / SIDES_M[-1])
    size_m = np.repeat(sides_m, each)
    squares = squares_at(random, size_m, samples.size_m, contrast)
    damaged = drawn_statistics(random, samples, patches, shares, size_m.size, squares)
    whole = drawn_statistics(random, samples, patches, shares, intact)
    return Trials(size_m, (damaged >= critical).astype(np.float64), int((whole >= critical).sum()), intact)


def pooled_trials(
    inspections: Sequence[Samples], fresh: Sequence[Samples], *, each: int = 5, level: float = 0.05, seed: int = 3,
    contrast: float = 1.0,
) -> Trials:  # fmt: skip
    """Draw damage in many inspections, and call it by a threshold from intact inspections of other motion."""
    patches = declared(inspections[0].size_m)
    each_intact = max(1, INTACT // len(fresh))
    critical = critical_value(
        np.concatenate([
            drawn_statistics(generator(seed + number, "fresh"), one, patches, shares_of(one, patches), each_intact)
            for number, one in enumerate(fresh)
        ]),
        level,
    )  # fmt: skip
    trials = [
        own_trials(one, patches, shares_of(one, patches), critical, contrast=contrast, each=each,
                   intact=max(1, INTACT // len(inspections)), seed=seed + 100_000 + number)
        for number, one in enumerate(inspections)
    ]  # fmt: skip
    sizes_m, found, called, inspected = zip(*trials, strict=True)
    return Trials(np.concatenate(sizes_m), np.concatenate(found), sum(called), sum(inspected))


def plan(
    scenario: Scenario, robots: Sequence[int], until_s: Sequence[float], *, runs: int = 40, seed: int = 1,
    each: int = 5, level: float = 0.05, progress: Callable[[float], None] | None = None,
) -> pl.DataFrame:  # fmt: skip
    """Return what robots and time buy: a50, a90, their limit and false calls, by number of robots and end."""
    rows: list[tuple[float, ...]] = []
    for number in robots:
        intact = {"floor.source": "random:0.0", "floor.tiles": None}
        ends = {"swarm.robots": number, "run.t_end_s": max(until_s)}
        simulated = scenario.with_values(intact | ends)
        result, law = simulate(simulated, seed, runs), law_of_scenario(simulated, "the scenario")
        inspections = [samples_of_result(result, run, law) for run in range(runs)]
        for end_s in until_s:
            ended = [one.where(pl.col("time_s") <= end_s) for one in inspections]
            pod = pooled_trials(
                ended[: runs // 2], ended[runs // 2 :], each=each, level=level, seed=seed
            ).fit()
            samples = float(np.mean([one.frame.height for one in ended]))
            rows.append((number, end_s, samples, pod.a50_m, pod.a90_m, pod.a90_95_m, pod.false_calls))
            if progress is not None:
                progress(len(rows) / (len(robots) * len(until_s)))
    names = ["robots", "until_s", "samples", "a50_m", "a90_m", "a90_95_m", "false_calls_share"]
    return pl.DataFrame(rows, schema=names, orient="row").fill_nan(None)
