"""Measure how good the maps of the three recorded sessions are.

python benchmarks/inspection_sessions.py FOLDER
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import gamma

from vibroswarm.calibrate.dataset import Dataset, dataset_of
from vibroswarm.calibrate.fit_camera import fit_camera
from vibroswarm.calibrate.fit_sensor import FIELDS, SPREADS, fit_sensor
from vibroswarm.inspection.inspection import Inspection, inspect
from vibroswarm.inspection.samples import Law, Samples, ratios_of_values
from vibroswarm.inspection.scan import BLOCK_S
from vibroswarm.inspection.sources import samples_of_result
from vibroswarm.inspection.tile_map import tile_map
from vibroswarm.observation.energy_model import error_rates, readings_of
from vibroswarm.paper.columns import REAL, read_recordings
from vibroswarm.recordings.recording import Recording
from vibroswarm.statistics.intervals import generator
from vibroswarm.statistics.map_scores import map_scores

Floats = NDArray[np.float64]
SHOWN_S = (60.0, 180.0, 300.0, 600.0, 1200.0)


def words_of(samples: Samples, p: Floats) -> str:
    """Return the scores of maps over time, (times, tiles), in words."""
    assert samples.floor is not None
    each = [map_scores(one, samples.floor) for one in p]
    right = ", ".join(f"{one['right'] * p.shape[1]:.0f}" for one in each)
    brier = ", ".join(f"{one['brier']:.4f}" for one in each)
    wrong = ", ".join(f"{one['surely_wrong']:.0f}" for one in each)
    return f"tiles right {right}; Brier score {brier}; surely wrong {wrong}"


def of_others(found: Inspection) -> str:
    """Return when the map by the law of the other sessions has all tiles right, and the tiles that are wrong late."""
    assert found.pooled is not None
    assert found.samples.floor is not None
    truth = found.samples.floor.tiles.ravel() == 1
    late = [
        f"tile {tile} at {time_s:.0f} s"
        for time_s, p in zip(found.times_s, found.pooled, strict=True)
        for tile in np.flatnonzero((p > 0.5) != truth)
        if time_s > 120.0
    ]
    return f"all tiles right from {found.right_from_s:.0f} s; wrong after 120 s: {', '.join(late) or 'none'}"


def with_spread(samples: Samples, spread_m: float) -> Samples:
    """Return samples whose places are said to have this standard deviation."""
    spread = np.full(samples.frame.height, spread_m)
    return samples.with_columns(spread_x_m=spread, spread_y_m=spread)


def without_tile(real: Recording, found: Dataset, run: int) -> Floats:
    """Return the map whose tiles are each judged by the law of the other sessions without samples on this tile."""
    others = found.only([session for session in found.sessions if session != run])
    maps = []
    for tile in range(others.floors[run].tiles.size):
        rest = without(others, tile)
        camera = fit_camera(rest, draws=0).camera
        # Places are corrected from the recording itself, so that the tile's samples must be left out again.
        values = fit_sensor(without(others.corrected(camera), tile), draws=0).values
        stated = {f"sensor.{name}": round(values[name], 5) or None for name in (*FIELDS, *SPREADS)}
        sensor = real.scenario.with_values({"sensor.model": "gamma", **stated}).sensor
        samples = samples_of_result(real, run, Law(sensor, "without the tile", camera=camera))
        maps.append(tile_map(samples, SHOWN_S)[:, tile])
    return np.stack(maps, axis=1)


def without(found: Dataset, tile: int) -> Dataset:
    """Return a dataset without the samples on one tile."""
    return replace(found, samples=found.samples.filter(found.samples["tile"] != tile))


def fitted_blindly(samples: Samples) -> Samples:
    """Return samples with the law that a mixture of two Gamma distributions of their own values gives (EM)."""
    value = samples.column("value")
    vibrating = (value > np.median(value)).astype(np.float64)  # where to begin
    for _ in range(200):
        share, shape, scale = moments(value, vibrating)
        each = share[:, None] * gamma.pdf(value, shape[:, None], scale=scale[:, None])
        vibrating = each[1] / np.maximum(each.sum(axis=0), 1e-300)
    return with_gammas(samples, shape, scale, {})


def split_at_median(samples: Samples) -> Samples:
    """Return samples with the law that takes half of their values for still; nothing is known of edges, or factors."""
    value = samples.column("value")
    _, shape, scale = moments(value, (value > np.median(value)).astype(np.float64))
    unknown = ("edge_reach_m", "edge_blur_m", *SPREADS)
    return with_gammas(samples, shape, scale, dict.fromkeys(unknown))


def moments(value: Floats, vibrating: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the shares, shapes and scales of still and vibrating values, by the probability that each vibrates."""
    weights = np.stack([1.0 - vibrating, vibrating])
    mean = weights @ value / weights.sum(axis=1)
    variance = (weights * (value - mean[:, None]) ** 2).sum(axis=1) / weights.sum(axis=1)
    return weights.mean(axis=1), mean**2 / variance, variance / mean


def with_gammas(samples: Samples, shape: Floats, scale: Floats, changed: dict[str, None]) -> Samples:
    """Return samples judged by Gamma distributions, still and vibrating; ``changed`` are other fields of the sensor."""
    stated: dict[str, float | None] = dict(changed)
    for kind, k in (("still", 0), ("vibrating", 1)):
        stated |= {f"{kind}_shape": shape[k], f"{kind}_scale": scale[k], f"{kind}_location": 0.0}
    law = Law(samples.law.sensor.model_copy(update=stated), "of the session itself")
    ratios = ratios_of_values(law, samples.column("value"))
    return replace(samples, law=law).with_columns(log_ratio=ratios)


def majority(p: Floats) -> float:
    """Return the probability that more than half of the tiles vibrate, by a map, (tiles,)."""
    counts = np.array([1.0])
    for one in p:
        counts = np.convolve(counts, [1.0 - one, one])
    return float(counts[p.size // 2 + 1 :].sum())


def shares_by_counting(samples: Samples) -> Floats:
    """Return the share of readings of 1 and that of vibrating places which it stands for, with 95 % limits, (3, 2).

    The limits are of resampled blocks of two minutes of a robot; the floor is presumed to be visited evenly.
    """
    sensor = samples.law.sensor
    false, missed = error_rates(sensor)
    read = readings_of(sensor, samples.column("value")).astype(np.float64)
    block = 1000 * samples.frame["robot"].to_numpy().astype(np.int64) + samples.column("time_s") // BLOCK_S
    _, index = np.unique(block, return_inverse=True)
    size, total = np.bincount(index), np.bincount(index, read)
    drawn = generator(1, "blocks of counted readings").integers(size.size, size=(4000, size.size))
    resampled = total[drawn].sum(axis=1) / size[drawn].sum(axis=1)
    rates = np.array([read.mean(), *np.quantile(resampled, (0.025, 0.975))])
    return np.stack([rates, (rates - false) / (1.0 - missed - false)], axis=1)


def effects_of_time(samples: Samples, *, vibrating: bool) -> Floats:
    """Return the variance of log values between two minutes of a robot and its others, and the same by chance.

    Means of tiles and of robots are taken out. Chance: the same of values exchanged within each robot, (201,) in all.
    """
    assert samples.floor is not None
    tile = samples.floor.tile_at(samples.column("x_m"), samples.column("y_m"))
    there = (samples.floor.tiles.ravel()[np.maximum(tile, 0)] == vibrating) & (tile >= 0)
    robot = samples.frame["robot"].to_numpy().astype(np.int64)[there]
    rest = np.log(np.maximum(samples.column("value")[there], 1e-3))
    for _ in range(10):
        for group in (tile[there], robot):
            _, index = np.unique(group, return_inverse=True)
            rest = rest - (np.bincount(index, rest) / np.bincount(index))[index]
    _, index = np.unique(1000 * robot + samples.column("time_s")[there] // BLOCK_S, return_inverse=True)
    random, order = generator(1, "values exchanged within robots"), np.argsort(robot, kind="stable")
    found = [variance_between(rest, index)]
    for _ in range(200):
        mixed = np.empty(rest.size)
        mixed[order] = rest[np.lexsort((random.random(rest.size), robot))]
        found.append(variance_between(mixed, index))
    return np.array(found)


def variance_between(value: Floats, index: NDArray[np.int64]) -> float:
    """Return the variance of the means of groups beyond what values within them give (method of moments)."""
    size = np.bincount(index)
    mean = np.bincount(index, value) / size
    within = ((value - mean[index]) ** 2).sum() / (value.size - size.size)
    each = (value.size - (size**2).sum() / value.size) / (size.size - 1)
    return float(((size * mean**2).sum() / (size.size - 1) - within) / each)


def measured(folder: Path) -> Iterator[str]:
    """Yield what is measured of each session, in lines."""
    real = read_recordings(folder, REAL)
    found, effects = dataset_of([real]), []
    for run, row in enumerate(real.runs.iter_rows(named=True)):
        samples = (inspection := inspect(real, run=run)).samples
        yield f"session {run + 1}: the robots agreed at {row['consensus_time_s']:.0f} s ({row['consensus']})"
        yield f"  law of the others: {of_others(inspection)}"
        yield f"    at {SHOWN_S} s: {words_of(samples, tile_map(samples, SHOWN_S))}"
        if run == 1:
            for spread_m in (0.005, 0.02):
                spread = replace(inspection, samples=with_spread(samples, spread_m))
                pooled = tile_map(spread.samples, inspection.times_s)
                yield f"    places with a spread of {100 * spread_m:g} cm: {of_others(replace(spread, pooled=pooled))}"
        yield f"  without the tile that is judged: {words_of(samples, without_tile(real, found, run))}"
        for words, law in (("a mixture", fitted_blindly), ("values split at their median", split_at_median)):
            p = tile_map(law(samples), SHOWN_S)
            more = ", ".join(f"{majority(one):.3f}" for one in p)
            yield f"  fitted blindly, {words}: {words_of(samples, p)}; P(more than half vibrate) {more}"
        effects.append([effects_of_time(samples, vibrating=one) for one in (False, True)])
        counted, corrected = (", ".join(f"{one:.1%}" for one in row) for row in shares_by_counting(samples).T)
        yield f"  readings of 1, with 95 % limits: {counted}; corrected by the law's error rates: {corrected}"
    # Of all sessions; what is beyond chance, and its one-sided limit of 95 %.
    of_all = np.mean(effects, axis=0)
    for kind, row in zip(("still", "vibrating"), of_all, strict=True):
        beyond = row[0] - row[1:].mean()
        limit = beyond + 1.645 * row[1:].std()
        yield (
            f"effect of time where it is {kind}: {max(beyond, 0.0) ** 0.5:.1%}, at most {max(limit, 0.0) ** 0.5:.1%}, "
            f"p = {np.mean(row >= row[0]):.3f}"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="of the recordings")
    for line in measured(parser.parse_args().folder):
        print(line, flush=True)
