"""What the other robots' samples say of the places at which a robot took its own.

| name | symbol | equation |
|---|---|---|
| map of the others | p_t | map of a grid (``tile_map``), or raster of called patches (``scan``), without its samples |
| felt | q | probability that a sample feels vibration: its place, with its spread and the blur of edges, on this map |

Damage lies between the patches that are declared, whose places are a step apart: of a raster, places are taken as sure
only to the largest step of the called patches, besides their own spread.

A sample is judged by this map, not by one to which it has added: otherwise its own value would say where it counts. A
robot that took all samples by itself is judged by its own map.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.inspection.patches import Form, Patches, Shares
from vibroswarm.inspection.samples import Floats, Samples
from vibroswarm.inspection.scan import CELLS, CLEAR_M, called_patches, critical_by, joined, within
from vibroswarm.inspection.sources import grid_of
from vibroswarm.inspection.tile_map import felt_on, tile_map

LAG_ONE: Final = 0.84
"""Correlation of the errors of a robot's consecutive places: that of simulated robots which estimate them."""
VIBRATES: Final = 0.9
"""Something vibrates if a tile does with more than this probability."""


@dataclass(frozen=True, eq=False)
class Others:
    """The map that all other robots give, for each robot."""

    samples: Samples
    """Those that are judged, with the grid of the maps."""
    maps: dict[int, Floats]
    """Probability of each tile, (tiles,), by robot."""
    felt: Floats
    """q of each sample, (samples,)."""

    @property
    def found(self) -> bool:
        """Whether something vibrates, nearly surely."""
        return any(bool((p > VIBRATES).any()) for p in self.maps.values())

    def drawn(self, random: np.random.Generator, replicates: int) -> NDArray[np.bool_]:
        """Draw whether each sample feels vibration, (samples, replicates).

        Floors are drawn from the map of the others. Errors of places have their stated spreads, and are correlated
        within a robot.
        """
        samples, sensor = self.samples, self.samples.law.sensor
        robot, inside = (
            samples.frame["robot"].to_numpy(),
            np.zeros((samples.frame.height, replicates), dtype=bool),
        )
        for one, p in self.maps.items():
            own = np.flatnonzero(robot == one)
            floors = np.column_stack(
                [random.random((replicates, p.size)) < p, np.zeros(replicates, dtype=bool)]
            )
            at_m = []
            for axis in "xy":
                error = (
                    correlated(random, own.size, replicates) * samples.column(f"spread_{axis}_m")[own, None]
                )
                blur = (sensor.edge_blur_m or 0.0) * random.standard_normal(error.shape)
                at_m.append(samples.column(f"{axis}_m")[own, None] + error + blur)
            inside[own] = self._vibrates(floors, *at_m)
        return inside

    def _vibrates(self, floors: NDArray[np.bool_], x_m: Floats, y_m: Floats) -> NDArray[np.bool_]:
        """Return whether vibration is felt at places, on the floor of each replicate, (samples, replicates)."""
        floor, reach_m = self.samples.grid, self.samples.law.sensor.edge_reach_m or 0.0
        felt = np.zeros(x_m.shape, dtype=bool)
        for dx, dy in {(dx, dy) for dx in (-reach_m, reach_m) for dy in (-reach_m, reach_m)}:
            felt |= floors[np.arange(x_m.shape[1]), floor.tile_at(x_m + dx, y_m + dy)]
        return felt


def correlated(random: np.random.Generator, count: int, replicates: int) -> Floats:
    """Draw standard normal numbers, each correlated with the one before by ``LAG_ONE``, (count, replicates)."""
    white = random.standard_normal((count, replicates))
    white[1:] *= np.sqrt(1.0 - LAG_ONE**2)
    for before, now in pairwise(white):
        now += LAG_ONE * before
    return white


def by_tiles(samples: Samples) -> Others:
    """Return the maps of the others on a known grid."""
    robot = pl.col("robot")
    maps = {
        one: tile_map(samples.with_frame(samples.frame.filter(robot != one)), [np.inf])[0]
        for one in samples.robots
    }
    return _judged(samples, maps if len(maps) > 1 else {one: tile_map(samples, [np.inf])[0] for one in maps})


def by_patches(samples: Samples, patches: Patches, shares: Shares, critical: float, prior: float) -> Others:
    """Return the maps of the others where there is no grid: rasters, with 0 away from the patches that they call.

    Args:
        critical: T from which a patch is called by all samples. prior: probability of damage.
    """
    robot, maps, step_m = samples.frame["robot"].to_numpy(), {}, 0.0
    centres_m = [(np.arange(CELLS) + 0.5) * whole / CELLS for whole in samples.size_m]
    x_m, y_m = np.meshgrid(centres_m[0], centres_m[1][::-1])
    for one in samples.robots:
        there = (robot != one) | (len(samples.robots) == 1)
        least = critical_by(there, critical)
        boxes, steps = called_patches(samples, patches, shares, least, there)
        close = np.zeros((CELLS, CELLS), dtype=bool)
        for box in boxes:
            close |= within(box, x_m, y_m, CLEAR_M, CLEAR_M)
            step_m = max(step_m, Form(*box[2:]).step_m)
        # Most inspections call nothing, and a raster takes longer than the scan.
        cells = joined(patches, steps, prior, samples.size_m) if boxes else 0.0
        maps[one] = np.where(close, cells, 0.0).ravel()
    seen = samples.with_more_spread(step_m)
    return _judged(replace(seen, floor=grid_of(CELLS, CELLS, samples.size_m)), maps)


def _judged(samples: Samples, maps: dict[int, Floats]) -> Others:
    """Return maps of the others with what each robot's samples feel by them."""
    felt, robot = np.zeros(samples.frame.height), samples.frame["robot"].to_numpy()
    for one, p in maps.items():
        if p.any():
            felt[robot == one] = felt_on(samples.of(one), p)
    return Others(samples, maps, felt)
