"""Facts of labelled energies that the features of a fit of vibration do not hold: who scatters with whom, and edges.

| name | symbol | equation |
|---|---|---|
| scatter | r | log E - its mean over the tile in the session, of samples at least ``FAR_M`` from an edge |
| successive | - | correlation of r between successive samples of a robot on one tile |
| together | - | correlation of r between samples of two robots on one tile within ``TOGETHER_S`` |
| tiles | - | standard deviation of the means of log E between vibrating tiles of a session |
| robots | - | standard deviation of the means of r between robots in a session |

If motors vary slowly, both correlations are high; if robots differ, only the first is; if each sample is by itself,
neither. Means of few samples scatter by themselves, so ``tiles`` and ``robots`` are compared with simulations of as
many samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.calibrate.dataset import Dataset
from vibroswarm.core.arrays import Bools, Floats, Ints
from vibroswarm.core.numbers import number, stated
from vibroswarm.floors.floor import Floor

FAR_M: Final = 0.03
"""Samples at least this far from an edge are of one kind of tile."""
NEAR_M: Final = 0.005
"""Still samples nearer to a border than this lie beside a tile."""
TOGETHER_S: Final = 5.0
"""Samples of two robots on one tile within this time are compared, s."""
LEAST: Final = 1e-9
"""Energy that stands for 0 in a logarithm."""
KINDS: Final = (("vibrating", True), ("still", False))


@dataclass(frozen=True)
class FactSamples:
    """Where, when and by whom recorded samples were taken, (samples,) each."""

    session: Ints
    tile: Ints
    """Number of the tile below, other ones for each session."""
    robot: Ints
    """Number of the robot, other ones for each session."""
    vibrating: Bools
    neighbours: Ints
    """Number of vibrating tiles beside the tile below."""
    edge_m: Floats
    """Signed distance from the nearest edge, negative on vibrating tiles."""
    far: Bools
    """At least ``FAR_M`` from an edge."""
    beside_vibrating: Bools
    """Still, within ``NEAR_M`` of a vibrating tile."""
    beside_still: Bools
    """Still, within ``NEAR_M`` of the tile's border, and of no vibrating tile."""
    successive: Ints
    together: Ints
    """(pairs, 2): indices of samples."""


def fact_samples(found: Dataset) -> FactSamples:
    """Return what facts depend on, in the order of the samples of a dataset."""
    frame = found.samples
    session, robot, tile, sample = (
        frame[name].to_numpy().astype(np.int64) for name in ("run", "robot", "tile", "sample")
    )
    edge_m, vibrating = frame["edge_m"].to_numpy(), frame["vibrating"].to_numpy().astype(np.bool_)
    x_m, y_m = frame["x_m"].to_numpy(), frame["y_m"].to_numpy()
    border_m, neighbours = np.empty(edge_m.size), np.empty_like(tile)
    for one in np.unique(session):
        own, floor = session == one, found.floors[one]
        border_m[own] = to_border_m(floor, x_m[own], y_m[own])
        neighbours[own] = vibrating_neighbours(floor)[tile[own]]
    far = np.abs(edge_m) >= FAR_M
    of_tile = np.unique(np.column_stack((session, tile)), axis=0, return_inverse=True)[1].ravel()
    of_robot = np.unique(np.column_stack((session, robot)), axis=0, return_inverse=True)[1].ravel()
    beside_vibrating = ~vibrating & (edge_m < NEAR_M)
    return FactSamples(
        session,
        of_tile,
        of_robot,
        vibrating,
        neighbours,
        edge_m,
        far,
        beside_vibrating,
        ~vibrating & ~beside_vibrating & (border_m < NEAR_M),
        _successive(of_tile, of_robot, sample, far),
        _together(of_tile, of_robot, frame["time_s"].to_numpy(), far),
    )


def vibrating_neighbours(floor: Floor) -> Ints:
    """Return the number of vibrating tiles beside each tile, (tiles,)."""
    around = np.pad((floor.tiles > 0).astype(np.int64), 1)
    beside = around[:-2, 1:-1] + around[2:, 1:-1] + around[1:-1, :-2] + around[1:-1, 2:]
    return np.asarray(beside.ravel())


def to_border_m(floor: Floor, x_m: Floats, y_m: Floats) -> Floats:
    """Return the distance of places from the border of the tile below, m."""
    _, _, width_m, height_m, left_m, bottom_m = floor.geometry
    across, up = (x_m - left_m) % width_m, (y_m - bottom_m) % height_m
    return np.asarray(np.minimum.reduce([across, width_m - across, up, height_m - up]))


def _successive(tile: Ints, robot: Ints, sample: Ints, far: Bools) -> Ints:
    """Return the pairs of successive samples of a robot on one tile; rows are ordered by robot and time."""
    first = np.arange(tile.size - 1)
    same = (robot[1:] == robot[:-1]) & (tile[1:] == tile[:-1]) & (sample[1:] == sample[:-1] + 1)
    return np.asarray(np.column_stack((first, first + 1))[same & far[1:] & far[:-1]])


def _together(tile: Ints, robot: Ints, time_s: Floats, far: Bools) -> Ints:
    """Return the pairs of samples of two robots on one tile within ``TOGETHER_S``."""
    pairs = [np.empty((0, 2), dtype=np.int64)]
    for one in np.unique(tile):
        rows = np.flatnonzero((tile == one) & far)
        rows = rows[np.argsort(time_s[rows], kind="stable")]
        apart_s = time_s[rows] - time_s[rows, None]
        i, j = np.nonzero(
            (apart_s >= 0.0) & (apart_s < TOGETHER_S) & (np.arange(rows.size) > np.arange(rows.size)[:, None])
        )
        others = robot[rows[i]] != robot[rows[j]]
        pairs.append(np.column_stack((rows[i[others]], rows[j[others]])))
    return np.concatenate(pairs)


def scatter(samples: FactSamples, energy: Floats, rows: Ints) -> Floats:
    """Return r of some samples, which are far from edges, (rows,)."""
    logs = _log(energy[rows])
    return logs - _means(samples.tile[rows], logs)[samples.tile[rows]]


def _log(energy: Floats) -> Floats:
    return np.log(np.maximum(energy, LEAST))


def _means(group: Ints, value: Floats) -> Floats:
    """Return the mean of each group, (groups,); nan for groups without a value."""
    number = np.bincount(group)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.bincount(group, value) / number)


def _spread(session: Ints, group: Ints, value: Floats) -> float:
    """Return the standard deviation of the means of groups, within sessions; nan if none has two groups.

    Args:
        session, group: (values,), numbers of the session, and of the group in any session.
    """
    first = np.unique(group, return_index=True)[1]
    means, of = _means(group, value)[group[first]], session[first]
    within = means - _means(of, means)[of]
    freedom = means.size - np.unique(of).size
    return math.sqrt(float((within**2).sum()) / freedom) if freedom > 0 else math.nan


def tile_spread(samples: FactSamples, energy: Floats, rows: Ints) -> float:
    """Return the standard deviation between vibrating tiles of a session of the means of log E.

    Args:
        energy: (samples,). rows: indices of the samples that count, which may repeat.
    """
    own = rows[samples.far[rows] & samples.vibrating[rows]]
    return _spread(samples.session[own], samples.tile[own], _log(energy[own]))


def robot_spread(samples: FactSamples, energy: Floats, rows: Ints) -> float:
    """Return the standard deviation between robots of a session of the means of r; arguments as ``tile_spread``."""
    own = rows[samples.far[rows]]
    return _spread(samples.session[own], samples.robot[own], scatter(samples, energy, own))


def facts(samples: FactSamples, energy: Floats, rms_threshold: float) -> dict[str, float]:
    """Return the facts by name; nan where there is no sample, or no pair.

    Args:
        energy: (samples,), recorded or simulated. rms_threshold: theta_E.
    """
    found = {}
    for name, beside in (("vibrating", samples.beside_vibrating), ("still", samples.beside_still)):
        where = f"still, within {number(1000 * NEAR_M, 0)} mm of a {name} tile"
        found[f"{where}: mean energy"] = _mean(energy[beside])
        found[f"{where}: share above {stated(rms_threshold)}"] = _mean(energy[beside] > rms_threshold)
    rows, own = np.arange(energy.size), np.full(energy.size, np.nan)
    own[samples.far] = scatter(samples, energy, rows[samples.far])
    for name, kind in KINDS:
        of_kind = samples.vibrating == kind
        found[f"{name}: s.d. of log energy on a tile"] = math.sqrt(_mean(own[samples.far & of_kind] ** 2))
        for pairs, words in (
            (samples.successive, "successive samples of a robot"),
            (samples.together, f"two robots within {stated(TOGETHER_S)} s"),
        ):
            found[f"{name}: correlation of {words}"] = _correlation(own, pairs[of_kind[pairs[:, 0]]])
    found["s.d. of mean log energy between vibrating tiles"] = tile_spread(samples, energy, rows)
    found["s.d. of mean log energy between robots"] = robot_spread(samples, energy, rows)
    return found


def _mean(values: NDArray[Any]) -> float:
    return float(values.mean()) if values.size else math.nan


def _correlation(values: Floats, pairs: Ints) -> float:
    if len(pairs) < 3:
        return math.nan
    return float(np.corrcoef(values[pairs[:, 0]], values[pairs[:, 1]])[0, 1])
