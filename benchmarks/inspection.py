"""Measure how well simulated inspections, whose robots estimate their places, find damage.

python benchmarks/inspection.py --help
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import isotonic_regression
from scipy.special import logsumexp

from vibroswarm import Scenario, preset, simulate
from vibroswarm.errors import InputError
from vibroswarm.floors.surfaces import Patch
from vibroswarm.inspection.checks import PLACES, law_checks
from vibroswarm.inspection.damage import (
    drawn_patches,
    drawn_values,
    patch_of,
    quantiles_of,
    random_places,
    ratios_at,
    sensed,
    values_where,
)
from vibroswarm.inspection.laws import law_of_measured, law_of_scenario
from vibroswarm.inspection.missed import Trials, pooled_trials
from vibroswarm.inspection.others import by_patches, by_tiles, correlated
from vibroswarm.inspection.patches import (
    SIZES_M,
    Form,
    Patches,
    Shares,
    Side,
    declared,
    log_likelihoods,
    raster,
    scan_statistic,
    shares_of,
)
from vibroswarm.inspection.pod import INTACT
from vibroswarm.inspection.region import CELL_M, DRAWN, Region, coarse_shares, posterior_of, region_of
from vibroswarm.inspection.samples import SAMPLES, Law, Samples
from vibroswarm.inspection.scan import (
    BLOCK_S,
    CELLS,
    called_patches,
    critical_value,
    intact_statistics,
    near,
    p_value,
    statistic_of,
)
from vibroswarm.inspection.sources import samples_of_result
from vibroswarm.inspection.stopping import Question, rule_of
from vibroswarm.inspection.tile_map import tile_map
from vibroswarm.observation.energy_model import energy_of
from vibroswarm.statistics.intervals import generator, wilson_limits
from vibroswarm.statistics.map_scores import map_scores

Floats = NDArray[np.float64]
LOOKS = 40
FLOORS = "random:0.0", "random:0.08", "random:0.48"


def scenario_of(name: str, t_end_s: float, floor: str) -> Scenario:
    """Return a preset whose robots estimate their places."""
    values = {"run.t_end_s": t_end_s, "floor.source": floor, "localisation.method": "mixture"}
    return preset(name).with_values(values)


def inspections(
    name: str, count: int, t_end_s: float, floor: str, seed: int, *, bits: bool = False, tiles: int = 5
) -> Iterator[Samples]:
    """Return the samples of simulated inspections, one after the other."""
    scenario = scenario_of(name, t_end_s, floor).with_values({"floor.rows": tiles, "floor.columns": tiles})
    # One for all, so that its tables are computed once.
    law = replace(law_of_scenario(scenario, "the scenario"), bits=bits)
    for begin in range(0, count, 20):
        result = simulate(scenario, seed, range(begin, min(begin + 20, count)))
        for run in result.runs["run"].to_list():
            yield samples_of_result(result, run, law, bits=bits)


def interval(values: Floats) -> str:
    """Return the mean of runs with its 95 % interval."""
    half = 1.96 * values.std(ddof=1) / np.sqrt(values.size)
    return f"{values.mean():.4f} [{values.mean() - half:.4f}, {values.mean() + half:.4f}]"


def share(k: int, n: int) -> str:
    """Return a share with Wilson's limits."""
    if n == 0:
        return "-"
    low, high = wilson_limits(k, n)
    return f"{k / n:.1%} [{float(low):.1%}, {float(high):.1%}]"


def measure_map(count: int) -> None:
    """Print Brier scores over time."""
    at_s = (60.0, 120.0, 300.0, 600.0)
    for name in ("optimised-places", "calibrated"):
        scores = []
        for samples in inspections(name, count, 600.0, "random:0.48", 1):
            assert samples.floor is not None
            scores.append([map_scores(p, samples.floor)["brier"] for p in tile_map(samples, at_s)])
        columns = (interval(column) for column in np.array(scores).T)
        print(
            name, *(f"{s:g} s: {text}" for s, text in zip(at_s, columns, strict=True)), sep="; ", flush=True
        )


def measure_calibration(count: int) -> None:
    """Print how often tiles and cells are as a map says, where it is sure to some degree."""
    for tiles, name in itertools.product((5, 10), ("optimised-places", "calibrated")):
        for until_s in (120.0, 600.0):
            maps = []
            for samples in inspections(name, count, until_s, "random:0.48", 17, tiles=tiles):
                assert samples.floor is not None
                p, vibrates = tile_map(samples, [np.inf])[0], samples.floor.tiles.ravel() == 1
                maps.append((np.maximum(p, 1.0 - p), (p > 0.5) == vibrates))
            print_calibration(f"{name}, tiles of {100 // tiles} cm, {until_s:g} s", maps)
    patches, cells = declared((1.0, 1.0)), (np.arange(CELLS) + 0.5) / CELLS
    for name in ("optimised-places", "calibrated"):
        random, maps = generator(18, "damage for rasters"), []
        for samples in inspections(name, count, 600.0, "random:0.0", 18):
            side_m = random.uniform(SIZES_M[0], SIZES_M[-1], 1)
            damage = patch_of(*random_places(random, side_m, samples.size_m), side_m)
            ratios = ratios_at(samples.law, drawn_values(random, samples, 1, damage))
            logs = log_likelihoods(shares_of(samples, patches), ratios)[:, 0]
            told = raster(patches, logs, 0.5, CELLS, samples.size_m)
            maps.append((told, damage.distance_m(*np.meshgrid(cells, cells[::-1])) < 0.0))
        print_calibration(f"{name}, squares of 7 to 28 cm, 600 s", maps)


def print_calibration(words: str, maps: list[tuple[Floats, NDArray[np.bool_]]]) -> None:
    """Print probabilities beside how often they are true, with 95 % intervals whose unit is the run.

    Args:
        maps: of each run: probabilities, and what is true.
    """
    for low, high in itertools.pairwise((0.5, 0.8, 0.95, 0.99, 0.999, 1.0)):
        which = [(told > low) & (told <= high) for told, _ in maps]
        number = np.array([here.sum() for here in which])
        told, true = (
            np.array([one[k][here].sum() for one, here in zip(maps, which, strict=True)]) for k in (0, 1)
        )
        if number.any():
            share = true.sum() / number.sum()
            half = 1.96 * np.sqrt(((true - share * number) ** 2).sum()) / number.sum()
            print(
                f"{words}, {low:.1%} to {high:.1%}: told {told.sum() / number.sum():.2%}, true {share:.2%} "
                f"+- {half:.2%} ({number.sum()})",
                flush=True,
            )


def fits_of_plates(trials: Trials, count: int, repeats: int, **how: Any) -> tuple[Floats, Floats]:
    """Return a90 and a90/95 of repeats with 200 plates, one in each of as many inspections, its size at random, m.

    The false calls of each repeat are of 2,000 intact inspections of its own.
    """
    found, sizes = trials.found.reshape(count, -1), trials.size_m.reshape(count, -1)
    random = generator(1, "plates of inspections")
    fits = []
    for _ in range(repeats):
        one = random.choice(count, 200, replace=False), random.integers(found.shape[1], size=200)
        false = int(random.binomial(INTACT, trials.false / trials.intact))
        some = Trials(sizes[one], found[one], false, INTACT).fit(**how)
        fits.append((some.a90_m, some.a90_95_m))
    a90_m, limit_m = np.array(fits).T
    return a90_m, limit_m


def measure_pod(count: int) -> None:
    """Print sizes that are found, by energies and by bits."""
    for bits in (False, True):
        damaged, fresh = (
            list(inspections("optimised-places", count, 1200.0, "random:0.0", seed, bits=bits))
            for seed in (2, 3)
        )
        for until_s in (300.0, 600.0, 1200.0):
            trials = pooled_trials(damaged, fresh, until_s=until_s, each=1)
            pod = trials.fit()
            _, limit_m = fits_of_plates(trials, count, 100)
            low, middle, high = 100 * np.nanquantile(limit_m, (0.05, 0.5, 0.95))
            print(
                f"{'bits' if bits else 'energies'} {until_s:g} s: a50 {100 * pod.a50_m:.1f}, "
                f"a90 {100 * pod.a90_m:.1f}, a90/95 {100 * pod.a90_95_m:.1f} cm of {pod.trials} surfaces; of 200 "
                f"plates {middle:.1f} cm (5 to 95 %: {low:.1f} to {high:.1f}); false calls "
                f"{share(trials.false, trials.intact)}",
                flush=True,
            )


def measure_plates(count: int) -> None:
    """Print a90/95 of as many plates as there might be, one in each inspection, drawn again and again."""
    damaged, fresh = (
        list(inspections("optimised-places", count, 1200.0, "random:0.0", seed)) for seed in (2, 3)
    )
    for until_s in (300.0, 1200.0):
        trials = pooled_trials(damaged, fresh, until_s=until_s, each=10)
        random, words = generator(2, "number of plates"), []
        for plates in (60, 200, 1000):
            some = (random.integers(trials.found.size, size=plates) for _ in range(100))
            limits_m = [some_of(trials, one).fit().a90_95_m for one in some]
            low, middle, high = 100 * np.quantile(np.nan_to_num(limits_m, nan=9.99), (0.05, 0.5, 0.95))
            words.append(f"{plates} plates {middle:.1f} cm (5 to 95 %: {low:.1f} to {high:.1f})")
        a90_cm = 100 * trials.fit().a90_m
        print(
            f"{until_s:g} s: a90 {a90_cm:.1f} cm of {trials.found.size} surfaces; a90/95: {', '.join(words)}",
            flush=True,
        )


def some_of(trials: Trials, which: NDArray[np.int64]) -> Trials:
    """Return some of the trials of damage."""
    return Trials(trials.size_m[which], trials.found[which], trials.false, trials.intact)


FITS: dict[str, dict[str, Any]] = {
    "with p_f": {},
    "without p_f": {"floor": False},
    "with p_f, logistic in ln a": {"curves": ["log size"]},
    "without p_f, logistic in ln a": {"floor": False, "curves": ["log size"]},
}


def measure_isotonic(count: int) -> None:
    """Compare fits of 200 plates with an isotonic fit to damage in all inspections, with and without p_f."""
    even_m, wide_m = np.arange(0.03, 0.305, 0.01).round(3), np.geomspace(0.01, 0.3, 18).round(4)
    for name, until_s in (("optimised-places", 300.0), ("paper", 600.0), ("calibrated", 600.0)):
        damaged = list(inspections(name, count, until_s, "random:0.0", 21))
        fresh = list(inspections(name, INTACT, until_s, "random:0.0", 22))
        truth_m = np.nan
        for sides_m, seed in ((even_m, 3), (wide_m, 4)):
            trials = pooled_trials(
                damaged, fresh, until_s=until_s, each=1, sides_m=sides_m.tolist(), seed=seed
            )
            rates = np.array([trials.found[trials.size_m == side].mean() for side in sides_m])
            if sides_m is even_m:
                truth_m = float(np.interp(0.9, isotonic_regression(rates).x, sides_m))
            print(
                f"{name}, {until_s:g} s, {sides_m.size} sizes from {100 * sides_m[0]:g} cm: isotonic a90 "
                f"{100 * truth_m:.2f} cm; of {trials.found.size} surfaces"
            )
            compare_fits(trials, count, sides_m, rates, truth_m)


def compare_fits(trials: Trials, count: int, sides_m: Floats, rates: Floats, truth_m: float) -> None:
    """Print a90 of each of ``FITS`` to all trials, beside a90 and a90/95 of 200 repeats and the isotonic a90."""
    for words, how in FITS.items():
        pod = trials.fit(**how)
        expected = np.clip(pod.at(sides_m), 1e-6, 1.0 - 1e-6)
        misfit = count * ((rates - expected) ** 2 / (expected * (1.0 - expected))).sum()
        a90_m, limit_m = fits_of_plates(trials, count, 200, **how)
        near, above = np.abs(a90_m / truth_m - 1.0) < 0.08, ~(limit_m < truth_m)  # nan: above
        print(
            f"  {words}: a90 of all {100 * pod.a90_m:.2f} cm ({pod.a90_m / truth_m - 1.0:+.1%}), chi squared "
            f"{misfit:.0f}; of 200 plates {100 * np.nanmean(a90_m):.2f} cm on average, within 8 % in "
            f"{share(int(near.sum()), 200)}, a90/95 {100 * np.nanmedian(limit_m):.2f} cm in the median, above "
            f"the truth in {share(int(above.sum()), 200)}",
            flush=True,
        )


def measure_scan(count: int) -> None:
    """Print how often fresh intact inspections, each with motion and surface of its own, are called at each level."""
    levels, replicates, until_s = (0.1, 0.05, 0.01), 199, 600.0
    for name in ("optimised-places", "calibrated"):
        p, patches = [], declared((1.0, 1.0))
        for number, samples in enumerate(inspections(name, count, until_s, "random:0.0", 8)):
            shares = shares_of(samples, patches)
            drawn = intact_statistics(samples, patches, shares, replicates, number)
            own = scan_statistic(patches, log_likelihoods(shares, samples.column("log_ratio")[:, None]))
            p.append(p_value(float(own[0]), drawn))
            if len(p) % 100 == 0:
                called = "; ".join(
                    f"at {level:.0%}: {share(int((np.array(p) <= level).sum()), len(p))}" for level in levels
                )
                print(f"{name}, {until_s:g} s, {len(p)} intact inspections called {called}", flush=True)


Damages = list[Patch]
"""Patches that are on a surface at once, each (replicates,)."""


def damages_of(what: str, random: np.random.Generator, each: int) -> tuple[Damages, list[Side]]:
    """Return drawn damage of one sort, and the sizes that are declared for it."""
    surface, squares = (1.0, 1.0), list[Side](SIZES_M)
    if what == "two squares":  # one in the left half, one in the right
        halves = [random_places(random, np.full(each, 0.2), (0.5, 1.0)) for _ in range(2)]
        return [patch_of(x_m + 0.5 * k, y_m, 0.2) for k, (x_m, y_m) in enumerate(halves)], squares
    if what.startswith("disc of 14 cm"):
        discs = [Form(side, side, True) for side in SIZES_M] if what in SORTS else []
        return [drawn_patches(random, np.full(each, 0.14), surface, 1.0, "disc")], [*squares, *discs]
    if what.startswith("crack of 30 cm x 2 cm"):
        cracks = [(long, 0.02) for long in (0.1, 0.2, 0.3, 0.4, 0.6)] if what in SORTS else []
        cracks += [(0.02, long) for long, _ in cracks]
        return [drawn_patches(random, np.full(each, 0.3), surface, 1.0, "crack")], [*squares, *cracks]
    if what.startswith("rectangle of 30 cm x 10 cm"):
        upright = random.random(each) < 0.5
        sides_m = np.where(upright, 0.1, 0.3), np.where(upright, 0.3, 0.1)
        x_m, y_m = (0.5 * side + (1.0 - side) * random.random(each) for side in sides_m)
        return [Patch(x_m, y_m, *sides_m, np.ones(each))], squares
    side_m, contrast = random.uniform(0.08, 0.25, each), random.uniform(0.4, 1.0, each)
    if what != "squares of 8 to 25 cm, contrast .4 to 1":
        side_m, contrast = np.full(each, float(what.split()[-2]) / 100.0), np.ones(each)
    x_m, y_m = random_places(random, side_m, surface)
    return [Patch(x_m, y_m, side_m, side_m, contrast)], squares


SORTS = (
    "square of 10 cm", "square of 14 cm", "square of 20 cm", "squares of 8 to 25 cm, contrast .4 to 1", "two squares",
    "disc of 14 cm", "crack of 30 cm x 2 cm",
)  # fmt: skip
UNDECLARED = (
    "disc of 14 cm, only squares declared", "rectangle of 30 cm x 10 cm, only squares declared",
    "crack of 30 cm x 2 cm, only squares declared",
)  # fmt: skip
"""Of these the region holds no shape; it may hold the centre."""


def measure_region(count: int) -> None:
    """Print how often the joint region of a called patch holds the damage, among surfaces that are called."""
    law = Law(preset("paper").sensor, "preset paper")
    exact = (at_exact_places(generator(n, "places for regions"), 800, law) for n in range(count))
    simulated = [
        (name, inspections(name, count, 600.0, "random:0.0", 9))
        for name in ("optimised-places", "calibrated")
    ]
    for name, found in [*simulated, ("800 exact places", exact)]:
        held, called = dict.fromkeys(SORTS + UNDECLARED, 0), dict.fromkeys(SORTS + UNDECLARED, 0)
        of_declared, of_others = generator(9, "damage for regions"), generator(10, "damage for regions")
        for number, samples in enumerate(found):
            for what in SORTS + UNDECLARED:
                random = of_declared if what in SORTS else of_others
                damages, sides = damages_of(what, random, 1)
                patches = declared(samples.size_m, sides)
                shares = shares_of(samples, patches)
                x_m, y_m = samples.column("true_x_m")[:, None], samples.column("true_y_m")[:, None]
                inside = [sensed(random, samples.law.sensor, patch, x_m, y_m) for patch in damages]
                value = values_where(random, samples, 1, np.any(inside, axis=0), damages[0].contrast)[:, 0]
                read = samples.with_columns(value=value, log_ratio=ratios_at(samples.law, value))
                critical = critical_of(samples, patches, shares, number, replicates=99)
                there = np.ones(value.size, dtype=bool)
                boxes, _ = called_patches(read, patches, shares, critical, 0.5, there)
                shares = coarse_shares(read, patches)
                for box in boxes[: len(damages)]:
                    region = region_of(posterior_of(read, patches, shares, there))
                    there &= ~near(read, box)
                    called[what] += 1
                    is_held = holds if what in SORTS else holds_centre
                    held[what] += any(is_held(region, one) for one in damages)
        for what in SORTS + UNDECLARED:
            print(f"{name}, {what}: the region holds it in {share(held[what], called[what])}", flush=True)


def holds(region: Region, patch: Patch) -> bool:
    """Return whether a region holds the first replicate of a patch."""
    form = Form(patch.width_m[0], patch.height_m[0], patch.is_disc)
    return region.holds(form, patch.x_m[0], patch.y_m[0], patch.contrast[0])


def holds_centre(region: Region, patch: Patch) -> bool:
    """Return whether the centre of the first replicate is in the area of the centres (``Region.centre_m2``)."""
    shape, at = region.posterior.drawn(generator(1, "density of damage"), DRAWN)
    inside = at[:2, region.posterior.density(shape, at) >= region.least]
    centre_m = np.array([patch.x_m[0], patch.y_m[0]])
    return bool((inside // CELL_M == (centre_m // CELL_M)[:, None]).all(axis=0).any())


def critical_of(
    samples: Samples, patches: Patches, shares: Shares, seed: int, replicates: int = 199
) -> float:
    """Return T from which 5 % of intact surfaces are called."""
    return float(np.quantile(intact_statistics(samples, patches, shares, replicates, seed), 0.95))


def measure_spreads(count: int) -> None:
    """Print what the spreads of places are, and what it costs to state them too exactly."""
    presets = "optimised-places", "calibrated"
    for (tiles, at_s), name in itertools.product(((5, 120.0), (10, 300.0)), presets):
        scores: dict[float, list[tuple[float, float]]] = {1.0: [], 0.5: [], 0.1: []}
        stated, errors, within = [], [], []
        for samples in inspections(
            name, count, at_s, f"random:{0.48 if tiles == 5 else 0.4}", 10, tiles=tiles
        ):
            assert samples.floor is not None
            spread = {axis: samples.column(f"spread_{axis}_m") for axis in "xy"}
            error = {axis: samples.column(f"{axis}_m") - samples.column(f"true_{axis}_m") for axis in "xy"}
            stated.append(np.mean([each**2 for each in spread.values()]))
            errors.append(np.mean([each**2 for each in error.values()]))
            within.append(np.mean([np.abs(error[axis]) <= spread[axis] for axis in "xy"]))
            for factor, of in scores.items():
                changed = samples.with_columns(**{f"spread_{axis}_m": factor * spread[axis] for axis in "xy"})
                found = map_scores(tile_map(changed, [at_s])[0], samples.floor)
                of.append((found["brier"], found["surely_wrong"]))
        right = np.array(scores[1.0])
        for factor in (0.5, 0.1):
            wrong = np.array(scores[factor])
            more = wrong - right
            print(
                f"{name}, {tiles} x {tiles} tiles, {at_s:g} s, spreads times {factor:g}: Brier score worse by "
                f"{interval(more[:, 0])}; surely wrong tiles {wrong[:, 1].mean():.2f}, more by {interval(more[:, 1])}; "
                f"stated {100 * np.mean(stated) ** 0.5:.1f} cm, truly {100 * np.mean(errors) ** 0.5:.1f} cm, "
                f"{np.mean(within):.0%} within one",
                flush=True,
            )


def measure_power(count: int) -> None:
    """Print how often a robot's gain, its drift, one of all robots, and a right law are refused on intact surfaces."""
    gains, drifts = (1.1, 1.25, 1.5, 2.0), (0.1, 0.2, 0.4)
    for name in ("optimised-places", "calibrated"):
        refused = dict.fromkeys(
            [
                "right",
                *(f"gain {k:g}" for k in gains),
                *(f"{of} {k:g}" for of in ("drift", "all") for k in drifts),
            ],
            0,
        )
        for number, samples in enumerate(inspections(name, count, 1200.0, "random:0.0", 11)):
            time_s, is_first = samples.column("time_s"), samples.frame["robot"].to_numpy() == 0
            factors = {"right": np.ones(time_s.size)}
            factors |= {f"gain {k:g}": np.where(is_first, k, 1.0) for k in gains}
            factors |= {
                f"drift {k:g}": np.where(is_first, 1.0 + k * time_s / time_s.max(), 1.0) for k in drifts
            }
            factors |= {f"all {k:g}": 1.0 + k * time_s / time_s.max() for k in drifts}
            for what, factor in factors.items():
                refused[what] += checked(multiplied(samples, factor), number) != set()
        print(f"{name}: {'; '.join(f'{what} {share(k, count)}' for what, k in refused.items())}", flush=True)


def measure_best(count: int) -> None:
    """Print how often a gain of one robot would be noticed by the best test, at 5 % and at Holm's first step (1.25 %).

    It knows the floor, true places, the law and the gain, but not which robot has it: the mean over robots of the
    likelihood ratio. The logarithm of a value is taken as normal, with factors of tiles and robots.
    """
    for name, floor, gain in itertools.product(("optimised-places", "calibrated"), FLOORS, (1.25, 1.5)):
        noticed = [
            noticed_at_best(samples, np.log(gain), number)
            for number, samples in enumerate(inspections(name, count, 1200.0, floor, 92))
        ]
        at_5, at_first = np.mean(noticed, axis=0)
        print(f"{name}, {floor}, gain {gain:g}: {at_5:.0%} at 5 %, {at_first:.0%} at 1.25 %", flush=True)


def noticed_at_best(samples: Samples, log_gain: float, seed: int, drawn: int = 4000) -> list[float]:
    """Return the power of the best test at 5 % and at 1.25 %, for a gain of the first robot."""
    law, floor = samples.law, samples.floor
    assert floor is not None
    table, tile = quantiles_of(law), floor.tile_at(samples.column("true_x_m"), samples.column("true_y_m"))
    of_kind = np.stack([np.log(np.maximum(each, 1e-2)) for each in (table.still, table.vibrating)])
    weight = np.gradient(table.u)
    mean = (of_kind @ weight / weight.sum())[:, None]
    variance = (of_kind - mean) ** 2 @ weight / weight.sum()
    precision = np.zeros((len(samples.robots), floor.tiles.size))
    robot, on = samples.frame["robot"].to_numpy(), tile >= 0
    np.add.at(precision, (robot[on], tile[on]), 1.0 / variance[floor.tiles.ravel()[tile[on]]])
    # One mean of logarithms for each robot and tile is all that the samples say.
    of_robot, of_tile = np.nonzero(precision)
    robots = (of_robot[:, None] == np.arange(len(samples.robots))).astype(np.float64)
    covariance = np.diag(1.0 / precision[of_robot, of_tile])
    for group, spread in ((of_robot, law.sensor.robot_spread), (of_tile, law.sensor.tile_spread)):
        covariance += (spread or 0.0) ** 2 * (group[:, None] == group)
    normal = generator(seed, "best test").standard_normal((of_robot.size, drawn))
    still = np.linalg.cholesky(covariance) @ normal
    slope = log_gain * robots.T @ np.linalg.inv(covariance)
    size = 0.5 * log_gain * (slope * robots.T).sum(axis=1, keepdims=True)
    null, changed = (
        logsumexp(slope @ each - size, axis=0) for each in (still, still + log_gain * robots[:, :1])
    )
    return [float((changed >= np.quantile(null, 1.0 - level)).mean()) for level in (0.05, 0.0125)]


def measure_reference(count: int) -> None:
    """Print false calls, and squares of 15 cm that are found, by a law of few measured values."""
    found = list(inspections("optimised-places", count, 300.0, "random:0.0", 12))
    patches = declared((1.0, 1.0))
    for values in (20, 40, 100, 400):
        false, hits, refused = 0, 0, 0
        for number, samples in enumerate(found):
            random, sensor = generator(number, f"{values} measured values"), samples.law.sensor
            vibrating, still = (
                np.abs(energy_of(sensor, kind, random.random(values)).astype(np.float64)) for kind in (1, 0)
            )
            try:
                law = law_of_measured(vibrating, still, "values")
            except InputError:
                refused += 1
                continue
            shares = shares_of(samples, patches)
            damage = patch_of(*random_places(random, np.full(5, 0.15), samples.size_m), 0.15)
            read = [drawn_values(random, samples, 5, one) for one in (None, damage)]
            # One surface is judged by the law itself; ``statistic_of`` would judge drawn ones by its resampled laws.
            logs = [log_likelihoods(shares, ratios_at(law, values)) for values in read]
            critical = critical_of(replace(samples, law=law), patches, shares, number)
            called = [scan_statistic(patches, one) >= critical for one in logs]
            false, hits = false + int(called[0].sum()), hits + int(called[1].sum())
        n = 5 * (count - refused)
        print(
            f"{values} values of each kind: false calls {share(false, n)}, found {share(hits, n)}; refused {refused}",
            flush=True,
        )


def measure_effects(count: int) -> None:
    """Print false calls at 5 % where each robot's gain varies every two minutes, which no law knows."""
    patches = declared((1.0, 1.0))
    for name in ("optimised-places", "calibrated"):
        called = dict.fromkeys((0.0, 0.05, 0.1, 0.2), 0)
        random = generator(13, "effects of time")
        for number, samples in enumerate(inspections(name, count, 1200.0, "random:0.0", 13)):
            shares = shares_of(samples, patches)
            critical = critical_of(samples, patches, shares, number)
            block = (
                1000 * samples.frame["robot"].to_numpy().astype(np.int64)
                + samples.column("time_s") // BLOCK_S
            )
            _, index = np.unique(block, return_inverse=True)
            for spread in called:
                values = drawn_values(random, samples, 10)
                values *= np.exp(spread * random.standard_normal((int(index.max()) + 1, 10)))[index]
                called[spread] += int((statistic_of(samples, patches, shares, values) >= critical).sum())
        words = (f"{spread:.0%}: {share(k, 10 * count)}" for spread, k in called.items())
        print(f"{name}, false calls by effects of time of {'; '.join(words)}", flush=True)


def told_at_looks(
    samples: Samples, values: Floats, sides_m: list[float], contrasts: tuple[float, ...], strict: bool
) -> Floats:
    """Return the told risk of each surface at each look, (looks, surfaces).

    Args:
        values: of each sample and surface.
    """
    question = Question(min(sides_m), contrasts, strict=strict)
    return rule_of(samples, declared(samples.size_m, sides_m), question, LOOKS).told(values)


def measure_risk(count: int, name: str, surfaces: int, strict: bool) -> None:
    """Print true beside told risks: half of the surfaces are damaged, and an inspection ends when it is tolerated."""
    risks = (0.1, 0.05, 0.01)
    cases = {(side, told): (side, told) for side in (0.2, 0.1) for told in ((1.0,), (1.0, 0.75, 0.5))}
    for side_m, contrasts in cases.values():
        sides = [side for side in (0.10, 0.14, 0.20, 0.28) if side >= side_m]
        least: dict[str, list[Floats]] = {"intact": [], "full": [], "half": []}
        random = generator(5, "damaged surfaces")
        for samples in inspections(name, count, 1200.0, "random:0.0", 4):
            x_m, y_m = random_places(random, np.full(surfaces, side_m), samples.size_m)
            patches = None, patch_of(x_m, y_m, side_m), patch_of(x_m, y_m, side_m, 0.5)
            values = np.hstack([drawn_values(random, samples, surfaces, patch) for patch in patches])
            told = told_at_looks(samples, values, sides, contrasts, strict)
            for group, column in zip(least, np.hsplit(told, 3), strict=True):
                least[group].append(column)
        tables = {group: np.concatenate(columns, axis=1) for group, columns in least.items()}
        for risk in risks:
            cleared = {group: (table <= risk).any(axis=0) for group, table in tables.items()}
            intact = int(cleared["intact"].sum())
            when_s = (1 + (tables["intact"] <= risk).argmax(axis=0)) * 1200.0 / LOOKS
            median_s = np.median(when_s[cleared["intact"]]) if intact else np.nan
            truly = [
                share(int(cleared[group].sum()), int(cleared[group].sum()) + intact) if intact else "-"
                for group in ("full", "half")
            ]
            print(
                f"{name}, {100 * side_m:g} cm, contrasts {contrasts}, told {risk:.0%}: truly {truly[0]}, at half the "
                f"contrast {truly[1]}; intact cleared {share(intact, cleared['intact'].size)}, half of them by "
                f"{median_s:.0f} s",
                flush=True,
            )


def measure_told(count: int) -> None:
    """Print true beside told risks by exact places, by a known law, and by laws of so many measured values.

    Where tiles and robots differ by 17 and 12 %, there are more samples, as fewer surfaces are cleared.
    """
    alike, differ = (0.0, 0.0), (0.17, 0.12)
    cases = [(400, alike, measured) for measured in (0, 100, 300, 1000)]
    cases += [(2000, differ, measured) for measured in (100, 300, 1000)]
    for number, spreads, measured in cases:
        truth = overlapping_law(tile_spread=spreads[0] or None, robot_spread=spreads[1] or None)
        told: dict[str, list[Floats]] = {"mean over laws": [], "law alone": []}
        for seed in range(count):
            random = generator(seed, f"{measured} values, exact places")
            vibrating, still = (energy_of(truth.sensor, kind, random.random(measured)) for kind in (1, 0))
            law = law_of_measured(vibrating, still, "measured", spreads) if measured else truth
            samples = at_exact_places(random, number, truth)
            patch = patch_of(*random_places(random, np.full(1, 0.2), samples.size_m), 0.2)
            values = np.hstack([drawn_values(random, samples, 1, one) for one in (patch, None)])
            for words, judge in (("mean over laws", law), ("law alone", replace(law, draws=()))):
                told[words].append(told_at_looks(replace(samples, law=judge), values, [0.2], (1.0,), False))
        for words, risk in itertools.product(told, (0.1, 0.05, 0.01)):
            each = np.concatenate(told[words], axis=1)  # damaged and intact surfaces in turn
            print(
                f"{number} samples, {measured} values, {words}, {true_beside_told(each, risk, 2)}", flush=True
            )


def measure_differ(count: int) -> None:
    """Print true beside told risks by exact places, where tiles and robots differ as the law says."""
    cases = [
        (0.15, 1500, 0.17, 0.0, 1.0),
        (0.15, 1500, 0.0, 0.12, 1.0),
        (0.2, 2000, 0.17, 0.12, 1.0),
        (0.2, 2000, 0.17, 0.12, 0.5),
        (0.2, 2000, 0.0, 0.12, 0.5),
        (0.1, 2000, 0.17, 0.12, 1.0),
    ]
    for (side_m, number, tiles, robots, contrast), strict in itertools.product(cases, (False, True)):
        law = overlapping_law(tile_spread=tiles or None, robot_spread=robots or None)
        told = []
        for seed in range(count):
            random = generator(seed, "tiles and robots that differ")
            samples = at_exact_places(random, number, law)
            patch = patch_of(*random_places(random, np.full(10, side_m), samples.size_m), side_m, contrast)
            values = np.hstack([drawn_values(random, samples, 10, one) for one in (patch, None)])
            told.append(told_at_looks(samples, values, [side_m], (contrast,), strict))
        for risk in (0.05, 0.01):
            print(
                f"{100 * side_m:g} cm, {number} samples, tiles {tiles:.0%}, robots {robots:.0%}, contrast {contrast}"
                f"{', strict' * strict}, {true_beside_told(np.concatenate(told, axis=1), risk, 20)}",
                flush=True,
            )


def overlapping_law(**spreads: float | None) -> Law:
    """Return a law of still and vibrating values of which many overlap."""
    gammas = {"vibrating": (5.0, 1.2, 0.0), "still": (3.0, 1.0, 0.0)}
    fields: dict[str, Any] = {
        f"sensor.{kind}_{name}": value
        for kind, law in gammas.items()
        for name, value in zip(("shape", "scale", "location"), law, strict=True)
    }
    fields |= {f"sensor.{name}": value for name, value in spreads.items()}
    return law_of_scenario(preset("paper").with_values(fields), "the true law")


def true_beside_told(told: Floats, risk: float, of_inspection: int) -> str:
    """Say how often surfaces were damaged that were cleared at a tolerated risk, and what was told then.

    Args:
        told: of each look and surface; the first half of those of each inspection are damaged.
        of_inspection: surfaces of each inspection.
    """
    cleared = (told <= risk).any(axis=0)
    first = told[(told <= risk).argmax(axis=0), np.arange(told.shape[1])]
    damaged, intact = np.hsplit(cleared.reshape(-1, of_inspection), 2)
    return (
        f"tolerated {risk:.0%}: told {mean_of(first[cleared])}, truly {share(int(damaged.sum()), int(cleared.sum()))}; "
        f"intact cleared {int(intact.sum())} of {intact.size}"
    )


def mean_of(risks: Floats) -> str:
    return f"{risks.mean():.1%}" if risks.size else "-"


def at_exact_places(random: np.random.Generator, count: int, law: Law) -> Samples:
    """Return samples of five robots at random places of 1 m2, without values."""
    x_m, y_m = random.random((2, count))
    columns = dict.fromkeys(SAMPLES, np.zeros(count)) | {"robot": np.arange(count) % 5}
    columns |= {
        "time_s": 3.0 * np.arange(count) + 3.0,
        "x_m": x_m,
        "y_m": y_m,
        "true_x_m": x_m,
        "true_y_m": y_m,
    }
    return Samples(pl.DataFrame(columns).cast(dict(SAMPLES)), (1.0, 1.0), law, "drawn", "drawn")


def measure_drift(count: int) -> None:
    """Print how often a drift of all robots is noticed on intact plates without a grid, or else called damage.

    The best test, which knows its size but not its sign: the mean of both likelihood ratios.
    """
    sensor = preset("paper").sensor
    law, patches = Law(sensor, "preset paper"), declared((1.0, 1.0))
    still = stats.gamma(sensor.still_shape, sensor.still_location, sensor.still_scale)
    for drift, begin in ((0.0, 0.0), (0.2, 0.0), (0.2, -0.1), (0.4, -0.2)):
        by_drift = by_any = damaged = 0
        null, changed = [], []
        for number in range(count):
            random = generator(number, "plates that drift")
            samples = at_exact_places(random, 400, law)
            time_s = samples.column("time_s")
            gains = np.stack([1.0 + sign * (begin + drift * time_s / time_s.max()) for sign in (1.0, -1.0)])
            values = drawn_values(random, samples, 100)
            for drawn, at in ((null, values), (changed, values * gains[0][:, None])):
                # A value that is impossible by one of the two is nearly so.
                logs = [np.maximum(still.logpdf(at / g[:, None]) - np.log(g)[:, None], -100.0) for g in gains]
                off = np.maximum(still.logpdf(at), -100.0)
                drawn.append(np.logaddexp(*[(log - off).sum(axis=0) for log in logs]))
            read = multiplied(samples.with_columns(value=values[:, 0]), gains[0])
            shares = shares_of(samples, patches)
            critical = critical_value(intact_statistics(samples, patches, shares, 199, number), 0.05)
            checks = law_checks(
                read, by_patches(read, patches, shares, critical, 0.5), seed=number, drawn=199
            )
            found = set(checks.filter(pl.col("outcome") == "refused")["check"])
            by_drift += "drift" in found
            by_any += found != set()
            called = scan_statistic(patches, log_likelihoods(shares, read.column("log_ratio")[:, None]))
            damaged += found == set() and bool(called[0] >= critical)
        best = [
            (np.concatenate(changed) >= np.quantile(np.concatenate(null), 1.0 - level)).mean()
            for level in (0.05, 0.05 / 3)
        ]
        print(
            f"drift of all by {drift:.0%} from {1.0 + begin:g}: noticed as drift {share(by_drift, count)}, "
            f"by any check {share(by_any, count)}; not noticed but called damaged {share(damaged, count)}; best test "
            f"{best[0]:.0%} at 5 %, {best[1]:.0%} at 1.67 %",
            flush=True,
        )


def measure_checks(count: int, name: str) -> None:
    """Print how often right laws and right places are refused, and how often wrong ones.

    A robot is lost if more than 5 % of its samples are further than 4 stated standard deviations from where they were
    taken: its places are wrong. Places are right if their errors are drawn, with the stated standard deviations.
    """
    for floor in FLOORS:
        refused = dict.fromkeys(("law", "places", "law, no robot lost", "places, no robot lost"), 0)
        refused |= dict.fromkeys(("right places", "mirrored", "gain", "drift"), 0)
        lost = 0
        for number, samples in enumerate(inspections(name, count, 1200.0, floor, 16)):
            is_lost = bool(lost_robots(samples).any())
            lost += is_lost
            checks = checked(samples, number)
            for words, counted in (("", True), (", no robot lost", not is_lost)):
                refused["law" + words] += counted and checks - {PLACES} != set()
                refused["places" + words] += counted and PLACES in checks
            refused["right places"] += PLACES in checked(with_right_places(samples, number), number)
            is_first, x_m = samples.frame["robot"].to_numpy() == 0, samples.column("x_m")
            mirrored = samples.with_columns(x_m=np.where(is_first, samples.size_m[0] - x_m, x_m))
            refused["mirrored"] += PLACES in checked(mirrored, number)
            time_s = samples.column("time_s")
            for what, factor in (("gain", 1.5), ("drift", 1.0 + 0.2 * time_s / time_s.max())):
                refused[what] += (
                    checked(multiplied(samples, np.where(is_first, factor, 1.0)), number) != set()
                )
        shares = (f"{what} {share(k, count - lost * ('no' in what))}" for what, k in refused.items())
        print(f"{name}, {floor}: {'; '.join(shares)}; a robot lost in {share(lost, count)}", flush=True)


def with_right_places(samples: Samples, seed: int) -> Samples:
    """Return samples at places whose errors have the stated standard deviations, correlated as those of robots are."""
    random, robot = generator(seed, "right places"), samples.frame["robot"].to_numpy()
    columns = {}
    for axis in "xy":
        error = np.empty(robot.size)
        for one in samples.robots:
            error[robot == one] = correlated(random, int((robot == one).sum()), 1)[:, 0]
        columns[f"{axis}_m"] = samples.column(f"true_{axis}_m") + error * samples.column(f"spread_{axis}_m")
    # Some may be outside of the surface.
    return samples.with_frame(samples.frame.with_columns(**{k: pl.Series(v) for k, v in columns.items()}))


def multiplied(samples: Samples, factor: Floats) -> Samples:
    """Return samples whose values are multiplied."""
    value = factor * samples.column("value")
    return samples.with_columns(value=value, log_ratio=ratios_at(samples.law, value))


def checked(samples: Samples, seed: int) -> set[str]:
    """Return the checks that are refused."""
    checks = law_checks(samples, by_tiles(samples), seed=seed, drawn=199)
    return set(checks.filter(pl.col("outcome") == "refused")["check"])


def lost_robots(samples: Samples) -> NDArray[np.bool_]:
    """Return which robots are lost, (robots,)."""
    errors = [
        np.abs(samples.column(f"{axis}_m") - samples.column(f"true_{axis}_m"))
        / np.maximum(samples.column(f"spread_{axis}_m"), 1e-9)
        for axis in "xy"
    ]
    far, robot = np.max(errors, axis=0) > 4.0, samples.frame["robot"].to_numpy()
    return np.array([far[robot == one].mean() > 0.05 for one in samples.robots])


def measure_time(count: int) -> None:
    """Print the CPU time of maps and scans of inspections of 1200 s, beyond motion."""
    scenario = scenario_of("optimised-places", 1200.0, "random:0.48")
    law, result = law_of_scenario(scenario, "the scenario"), simulate(scenario, 7, count)
    patches = declared((1.0, 1.0))

    def scanned(samples: Samples) -> None:
        logs = log_likelihoods(shares_of(samples, patches), samples.column("log_ratio")[:, None])
        scan_statistic(patches, logs)
        raster(patches, logs[:, 0], 0.5, 40, samples.size_m)

    def whole(run: int) -> None:
        samples = samples_of_result(result, run, law)
        tile_map(samples, np.linspace(240.0, 1200.0, 5))
        scanned(samples)

    found = [samples_of_result(result, run, law) for run in range(count)]
    made: dict[str, list[Callable[[], object]]] = {
        "map of 25 tiles": [partial(tile_map, one, [1200.0]) for one in found],
        "60 maps of 25 tiles": [partial(tile_map, one, np.linspace(20.0, 1200.0, 60)) for one in found],
        "T and raster of 40 x 40": [partial(scanned, one) for one in found],
        "samples, 5 maps, T and raster": [partial(whole, run) for run in range(count)],
    }
    for words, calls in made.items():
        calls[0]()
        each_ms = []
        for call in calls:
            begin = time.process_time()
            call()
            each_ms.append(1000.0 * (time.process_time() - begin))
        mean, least = np.mean(each_ms), min(each_ms)
        print(f"{words}: {mean:.2f} ms of CPU on average, least {least:.2f} ms", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    measures = [name.removeprefix("measure_") for name in list(globals()) if name.startswith("measure_")]
    parser.add_argument("what", choices=measures)
    parser.add_argument("--inspections", type=int, default=200)
    parser.add_argument("--preset", default="optimised-places", help="of risk and checks")
    parser.add_argument("--surfaces", type=int, default=1, help="of each sort in each inspection, for risk")
    parser.add_argument(
        "--strict", action="store_true", help="the risk must be tolerated at every place, for risk"
    )
    options = parser.parse_args()
    if options.what == "risk":
        measure_risk(options.inspections, options.preset, options.surfaces, options.strict)
    elif options.what == "checks":
        measure_checks(options.inspections, options.preset)
    else:
        globals()[f"measure_{options.what}"](options.inspections)
