"""What an inspection would have missed: the probability of detection of damage drawn at its own places.

Model-assisted PoD: the damage is drawn from the law of the sensor, so that it is as right as this law. It holds for the
places and times of this inspection; another one has other places (``pooled_trials``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl

from vibroswarm.core.numbers import stated
from vibroswarm.errors import InputError, check_kind, number_of, plain_value, whole_number_of
from vibroswarm.inspection.damage import drawn_patches, patch_of, random_places
from vibroswarm.inspection.laws import law_of_scenario
from vibroswarm.inspection.patches import SIZES_M, Patches, Shares, declared, shares_of
from vibroswarm.inspection.pod import INTACT, Pod, fit_pod
from vibroswarm.inspection.samples import SAMPLES, Floats, Samples
from vibroswarm.inspection.scan import critical_value, drawn_statistics, intact_statistics
from vibroswarm.inspection.sources import samples_of_result
from vibroswarm.scenario.fault_fields import failing_sensors
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate
from vibroswarm.statistics.intervals import generator

SIDES_M: Final = (0.03, 0.05, 0.07, 0.09, 0.12, 0.15, 0.2, 0.25, 0.3)
"""Sides of the drawn damage."""
CRACKS_M: Final = (0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8)
"""Lengths of drawn cracks."""
EACH: Final = 60
"""Damaged surfaces drawn of each side."""
WEAKEST_M: Final = (0.07, 0.1, 0.14, 0.2, 0.28)
"""Sides of squares for which the weakest contrast that is found is computed."""
CONTRASTS: Final = (0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0)
"""Contrasts of the damage drawn for it."""


def lengths_within(size_m: tuple[float, float], shape: str = "square") -> list[float]:
    """Return the sizes of drawn damage that fit a surface, at least 3: of one that is smaller, all scaled down to it.

    Args:
        size_m: width and height of the surface. shape: of ``damage.SHAPES``; a crack may fit along one axis only.
    """
    most, all_m = (max(size_m), CRACKS_M) if shape == "crack" else (min(size_m), SIDES_M)
    within = [length for length in all_m if length <= most]
    return within if len(within) >= 3 else [most * length / all_m[-1] for length in all_m]


class Trials(NamedTuple):
    """Inspections of drawn damage, (inspections,) each, and of intact surfaces."""

    size_m: Floats
    found: Floats
    false: int
    intact: int

    def fit(self, **how: Any) -> Pod:
        """Return the fitted PoD; the arguments are those of ``fit_pod``."""
        return fit_pod(self.size_m, self.found, self.false, self.intact, **how)


def false_calls(
    samples: Samples, patches: Patches, shares: Shares, critical: float, *, intact: int = INTACT, seed: int = 2,
    looks: int = 1,
) -> tuple[int, int]:  # fmt: skip
    """Return how many intact surfaces are called, drawn at the places of one inspection, and of how many.

    Args:
        critical: T from which a surface is called. intact: surfaces, other than those that gave ``critical``.
        seed: of what is drawn. looks: how often is looked, as for ``critical``.
    """
    drawn = intact_statistics(samples, patches, shares, intact, seed, looks=looks)
    return int((drawn >= critical).sum()), intact


def own_trials(
    samples: Samples,
    patches: Patches,
    shares: Shares,
    critical: float,
    false: tuple[int, int],
    *,
    contrast: float = 1.0,
    sides_m: Sequence[float] = SIDES_M,
    each: int = EACH,
    seed: int = 2,
    shape: str = "square",
    looks: int = 1,
) -> Trials:
    """Draw damage at the places of one inspection, and scan it.

    Args:
        critical: T from which a surface is called. false: ``false_calls`` of this inspection.
        sides_m: sizes of damage. each: surfaces of each size. seed: of what is drawn. shape: of ``damage.SHAPES``.
        looks: how often is looked, as for ``critical``.
    """
    random, size_m = generator(seed, f"damage of contrast {contrast:g}"), np.repeat(sides_m, each)
    patch = drawn_patches(random, size_m, samples.size_m, contrast, shape)
    drawn = drawn_statistics(random, samples, patches, shares, size_m.size, patch, looks=looks)
    return Trials(size_m, (drawn >= critical).astype(np.float64), *false)


def weakest_found(
    samples: Samples, patches: Patches, shares: Shares, critical: float, false: tuple[int, int], *, seed: int = 3,
    looks: int = 1,
) -> pl.DataFrame:  # fmt: skip
    """Return the weakest contrast that is found in 90 % of inspections, a row for each side of ``WEAKEST_M``.

    The columns are side_m, area_m2, c90 and c90_95, its upper 95 % limit: PoD is fitted to contrasts as it is to sizes
    (``pod``), but may end below 1 wherever places are. They are null where even contrast 1 is found less often.

    Args:
        critical, false, looks: as for ``own_trials``.
    """
    random, rows = generator(seed, "weakest contrast"), []
    contrast = np.repeat(CONTRASTS, EACH)
    for side_m in [side_m for side_m in WEAKEST_M if side_m <= min(samples.size_m)]:
        places_m = random_places(random, np.full(contrast.size, side_m), samples.size_m)
        patch = patch_of(*places_m, side_m, contrast)
        drawn = drawn_statistics(random, samples, patches, shares, contrast.size, patch, looks=looks)
        # Squares on which few samples lie are not found, however strong they are.
        pod = Trials(contrast, (drawn >= critical).astype(np.float64), *false).fit(asymptote=True)
        rows.append((side_m, side_m**2, pod.a90_m, pod.a90_95_m if pod.a90_95_m <= 1.0 else float("nan")))
    names = ["side_m", "area_m2", "c90", "c90_95"]
    return pl.DataFrame(rows, schema=dict.fromkeys(names, pl.Float64), orient="row").fill_nan(None)


def pooled_trials(
    inspections: Sequence[Samples],
    fresh: Sequence[Samples],
    *,
    until_s: float,
    sides_m: Sequence[float] = SIDES_M,
    each: int = 3,
    level: float = 0.05,
    seed: int = 3,
    contrast: float = 1.0,
) -> Trials:
    """Draw damage in many inspections, and call it by a threshold from intact inspections of other motion.

    Args:
        inspections: whose places damage is drawn at, ``each`` of each side. fresh: intact inspections that give the
            threshold. until_s: end of each inspection. level: wanted share of false calls.
    """
    patches = declared(inspections[0].size_m)

    def ended(inspection: Samples) -> tuple[Samples, Patches, Shares]:
        """Return an inspection that ends at ``until_s``, with the patches and its shares in them."""
        some = inspection.by_time(until_s)
        return some, patches, shares_of(some, patches)

    ratios, count = max(1, 2000 // len(fresh)), max(1, INTACT // len(inspections))
    intact = [intact_statistics(*ended(one), ratios, seed + number) for number, one in enumerate(fresh)]
    critical = critical_value(np.concatenate(intact), level)
    trials = []
    for drawn, one in enumerate(inspections, seed + 100_000):
        known = *ended(one), critical
        false = false_calls(*known, intact=count, seed=drawn)
        trials.append(own_trials(*known, false, contrast=contrast, sides_m=sides_m, each=each, seed=drawn))
    sizes_m, found, called, inspected = zip(*trials, strict=True)
    return Trials(np.concatenate(sizes_m), np.concatenate(found), sum(called), sum(inspected))


def plan(
    scenario: Scenario,
    robots: Sequence[int],
    until_s: Sequence[float],
    *,
    runs: int = 40,
    seed: int = 1,
    sides_m: Sequence[float] = SIDES_M,
    each: int = 5,
    level: float = 0.05,
    progress: Callable[[float], None] | None = None,
) -> pl.DataFrame:
    """Return what robots and time buy: a row for each number of robots and end of the inspection.

    The columns are robots, until_s, samples (of a run, on average), a50_m, a90_m, a90_95_m, false_calls, and
    sweep_a90_m: a90 of as many samples on a regular grid, of one sensor with exact places, as a reference. Lengths are
    null where they do not exist. a90_95_m depends on the number of drawn surfaces.

    Args:
        scenario: with the walk and the sensor; its floor does not matter. runs: simulated inspections, half of which
            give the threshold. sides_m, each: drawn damage, as in ``pooled_trials``. level: wanted false calls.
        progress: called with the share that is done.
    Raises:
        InputError: fewer than 4 runs, with which there is no threshold, an end before the first samples, squares larger
            than the arena, or sensors that fail.
    """
    check_kind(scenario, Scenario, "scenario", "a Scenario")
    robots, until_s, sides_m = map(plain_value, (robots, until_s, sides_m))
    for field, values in {"robots": robots, "until_s": until_s, "sides_m": sides_m}.items():
        check_kind(values, (tuple, list), field, "a list of numbers")
        for value in values:
            number_of(value, field)
    whole_number_of(runs, "runs", 4, 10**6)
    whole_number_of(each, "each", 1, 10**6)
    level = number_of(level, "level", 0.0, 1.0)
    if failing := failing_sensors(scenario.faults, max(robots, default=0)):
        raise InputError(
            "a plan draws energies of sensors that work; leave it out", field=f"faults.{failing[0]}"
        )
    largest_m, arena = max(*sides_m, *SIZES_M), scenario.arena
    if largest_m > min(arena.size_m):
        raise InputError(
            f"is {arena.width_m:g} m x {arena.height_m:g} m; a plan draws, and scans for, squares of up to "
            f"{100 * largest_m:g} cm, which must fit it",
            field="arena",
        )
    rows: list[tuple[float | None, ...]] = []
    for number in robots:
        inspections = _planned_inspections(scenario, number, until_s, runs, seed)
        damaged, fresh = inspections[: runs // 2], inspections[runs // 2 :]
        for end_s in until_s:
            pod = pooled_trials(
                damaged, fresh, until_s=end_s, sides_m=sides_m, each=each, level=level, seed=seed
            ).fit()
            samples = float(np.mean([one.by_time(end_s).frame.height for one in inspections]))
            swept = _sweep_trials(inspections[0], round(samples), sides_m, each, level, seed).fit()
            rows.append(
                (number, end_s, samples, pod.a50_m, pod.a90_m, pod.a90_95_m, pod.false_calls, swept.a90_m)
            )
            if progress is not None:
                progress(len(rows) / (len(robots) * len(until_s)))
    names = ["robots", "until_s", "samples", "a50_m", "a90_m", "a90_95_m", "false_calls", "sweep_a90_m"]
    return pl.DataFrame(rows, schema=names, orient="row").fill_nan(None)


def _planned_inspections(
    scenario: Scenario, robots: int, until_s: Sequence[float], runs: int, seed: int
) -> list[Samples]:
    """Simulate inspections of an intact surface by so many robots, until the last end.

    Raises:
        InputError: an end is before the first sample of an inspection.
    """
    made = scenario.with_values(
        {
            "swarm.robots": robots,
            "run.t_end_s": max(until_s),
            "floor.source": "random:0.0",
            "floor.tiles": None,
        }
    )
    law = law_of_scenario(made, "the scenario")
    result = simulate(made, seed, runs)
    inspections = [samples_of_result(result, run, law) for run in range(runs)]
    first_s = max(float(one.column("time_s").min()) for one in inspections)
    if min(until_s) < first_s:
        raise InputError(
            f"not all inspections have a sample after {stated(min(until_s))} s; the last has its first at "
            f"{stated(first_s)} s",
            field="--minutes",
        )
    return inspections


SWEEPS: Final = 8
"""Systematic sweeps, with other offsets, half of which give the threshold."""


def _sweep_trials(
    like: Samples, count: int, sides_m: Sequence[float], each: int, level: float, seed: int
) -> Trials:
    """Draw damage at the places of systematic sweeps: as many samples on a regular grid, of one sensor."""
    random = generator(seed, "offsets of sweeps")
    sweeps = []
    for _ in range(SWEEPS):
        across = max(1, round(np.sqrt(count * like.size_m[0] / like.size_m[1])))
        up = max(1, round(count / across))
        x, y = (
            (np.arange(number) + random.random()) * whole / number
            for number, whole in zip((across, up), like.size_m, strict=True)
        )
        x_m, y_m = (places.ravel() for places in np.meshgrid(x, y))
        places = {"x_m": x_m, "y_m": y_m, "true_x_m": x_m, "true_y_m": y_m}
        times = {"time_s": np.arange(x_m.size) / x_m.size}
        frame = pl.DataFrame(dict.fromkeys(SAMPLES, 0.0) | places | times)
        sweeps.append(like.with_frame(frame.cast(SAMPLES)))
    half = SWEEPS // 2
    more = max(1, round(each * 20 / half))  # as many surfaces as 20 inspections would have
    return pooled_trials(
        sweeps[:half], sweeps[half:], until_s=1.0, sides_m=sides_m, each=more, level=level, seed=seed
    )
