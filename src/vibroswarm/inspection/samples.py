"""The samples of one inspection: where each was taken, what it measured, and its log likelihood ratio.

They come from a simulated or stored result, from a recording, or from a CSV (``sources``). All that follows, maps,
scans and certificates, reads nothing else.
"""

from __future__ import annotations

import hashlib
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.calibrate.camera import RIGHT, Camera
from vibroswarm.core.numbers import count
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor, Place
from vibroswarm.observation.energy_model import (
    claimed_rates,
    energy_of,
    factors_differ,
    log_ratios_of_bits,
    log_ratios_of_classes,
    log_ratios_of_energies,
    model_of,
    readings_of,
)
from vibroswarm.scenario.fields import Sensor

Floats = NDArray[np.float64]

SAMPLES: Final[Any] = {
    "robot": pl.UInt16,
    "time_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
    "spread_x_m": pl.Float64,
    "spread_y_m": pl.Float64,
    "true_x_m": pl.Float64,
    "true_y_m": pl.Float64,
    "value": pl.Float64,
    "log_ratio": pl.Float64,
}
"""One row per sample, by time. ``time_s``: from when it counts, which is when its place is known. ``spread_x_m``,
``spread_y_m``: standard deviations of the place. ``true_x_m``, ``true_y_m``: the true place, null
where it is not known; only drawn damage is felt there. ``value``: energy or bit. ``log_ratio``: ln of its likelihood
where it vibrates over that where it is still."""

FEWEST: Final = 20
"""With fewer samples nothing is said."""
FEW_READINGS: Final = 12
"""So few different values of a reference are readings, with nothing half-way between those of both kinds."""


class Draw(NamedTuple):
    """A law fitted to a resampled reference, and what samples measure that this reference has not seen."""

    judge: Sensor
    truth: Sensor


@dataclass(frozen=True, eq=False)
class Law:
    """What a sample measures on still and on vibrating places, and where that is known from."""

    sensor: Sensor
    """Distributions of energies, reach and blur of edges, differences between tiles and robots."""
    origin: str
    """The reference, in words."""
    hash: str = ""
    """Hash of the reference; empty if the scenario states the law."""
    sessions: tuple[str, ...] = ()
    """``session_hash`` of each session that it was fitted to; empty: none."""
    draws: tuple[Draw, ...] = ()
    """Laws fitted to resampled references, which say how sure it is; empty: its error is not known."""
    bits: bool = False
    """Whether values are readings of 0 and 1, not energies."""
    place: Place | None = None
    """Grid of the floor, if the scenario states the law: that of a sensor that measures at each place depends on it."""
    camera: Camera = RIGHT
    """The camera that saw the reference."""

    @property
    def has_contrasts(self) -> bool:
        """Whether damage may be weaker: between few readings, as of a bit or measured as 0 and 1, there is nothing."""
        measured = {*(self.sensor.still_energies or ()), *(self.sensor.vibrating_energies or ())}
        return not self.bits and not 0 < len(measured) <= FEW_READINGS

    @cached_property
    def typical(self) -> Law:
        """The law on a typical tile by a typical robot; itself, if they do not differ."""
        if not factors_differ(self.sensor):
            return self
        alike = self.sensor.model_copy(update={"tile_spread": None, "robot_spread": None})
        return replace(self, sensor=alike, draws=())


class PlaceErrors(NamedTuple):
    """How wrong estimated places are, known in simulations only."""

    lag_one: float
    """Correlation of the errors of a robot's consecutive samples; nan: no robot has two."""
    within: tuple[float, float, float]
    """Shares of errors within 1, 2 and 4 stated standard deviations in x and y; .68, .95 and 1.00 expected."""


@dataclass(frozen=True, eq=False)
class Samples:
    """The samples of one inspection."""

    frame: pl.DataFrame
    """Columns of ``SAMPLES``."""
    size_m: tuple[float, float]
    """Width and height of the inspected surface, whose lower left corner is the origin."""
    law: Law
    places: str
    """Where places are known from, in words."""
    source: str
    """What was inspected, in words."""
    floor: Floor | None = None
    """The grid of tiles and, if ``truth_known``, which of them vibrate, with its changes; None: no grid."""
    truth_known: bool = False
    kinds: Floor | None = None
    """The floor with its kinds of tile, if there are more than two; ``floor`` says which are not of kind 0."""
    place_errors: PlaceErrors | None = None
    """None: not known, or places are exact."""
    left_out: int = 0
    """Rows of a file that have no value."""
    warning: str = ""
    """Why not to trust what is said of them; empty: no reason."""

    def __post_init__(self) -> None:
        """Refuse samples of which nothing can be said.

        Raises:
            InputError: there are too few, or they are outside the surface.
        """
        if self.frame.height < FEWEST:
            without = f" and {count(self.left_out, 'row')} without a value" if self.left_out else ""
            raise InputError(
                f"has {count(self.frame.height, 'sample')}{without}; nothing can be said with fewer than {FEWEST}",
                field=self.source,
            )
        outside = (self.beyond > 0.05).any(axis=0)
        if outside.mean() > 0.05:
            raise InputError(
                f"{outside.sum()} of {outside.size} places are outside the surface of {self.size_m[0]:g} m x "
                f"{self.size_m[1]:g} m; are its size, the units and the origin (its lower left corner) right?",
                field=self.source,
            )

    @property
    def grid(self) -> Floor:
        """The grid of tiles.

        Raises:
            InputError: there is no grid.
        """
        if self.floor is None:
            raise InputError(
                "a map of tiles needs a grid; give --tiles, or leave it to the raster", field="--tiles"
            )
        return self.floor

    @property
    def beyond(self) -> Floats:
        """How far places are outside along x and y, over width and height, (2, samples); negative: inside."""
        at = np.stack(
            [self.column(f"{axis}_m") / whole for axis, whole in zip("xy", self.size_m, strict=True)]
        )
        return np.asarray(np.maximum(-at, at - 1.0))

    @property
    def hash(self) -> str:
        """A hash of the samples, by which a certificate names them."""
        return hashlib.sha256(csv_bytes(self.frame)).hexdigest()[:16]

    @property
    def began_s(self) -> float:
        """When the inspection began: at 0, or with the first sample if the clock was started long before."""
        time_s = self.column("time_s")
        first_s, last_s = float(time_s.min(initial=np.inf)), float(time_s.max(initial=0.0))
        return first_s if last_s - first_s < first_s < np.inf else 0.0

    @property
    def robots(self) -> list[int]:
        """Numbers of the robots, ascending."""
        return [int(robot) for robot in np.unique(self.frame["robot"].to_numpy())]

    @property
    def is_timeless(self) -> bool:
        """Whether all samples of each robot have the same time, so that none can drift."""
        return self.frame.select("robot", "time_s").n_unique() == len(self.robots)

    def column(self, name: str) -> Floats:
        """Return a column as numbers, (samples,)."""
        return np.ascontiguousarray(self.frame[name].to_numpy(), dtype=np.float64)

    def of(self, robot: int) -> Samples:
        """Return the samples of one robot."""
        return self.with_frame(self.frame.filter(pl.col("robot") == robot))

    def with_columns(self, **columns: Floats) -> Samples:
        """Return the same samples with other values in some columns, such as other places for a control."""
        return replace(self, frame=self.frame.with_columns(**{k: pl.Series(v) for k, v in columns.items()}))

    def with_more_spread(self, spread_m: float) -> Samples:
        """Return the same samples with a standard deviation more in each place, independent of its own."""
        names = ("spread_x_m", "spread_y_m")
        return self.with_columns(**{name: np.hypot(self.column(name), spread_m) for name in names})

    def with_frame(self, frame: pl.DataFrame) -> Samples:
        """Return some of the samples; of fewer than ``FEWEST``, such as those of one robot, too."""
        some = copy(self)
        object.__setattr__(some, "frame", frame)
        return some

    def by_time(self, until_s: float) -> Samples:
        """Return the samples that count by a time."""
        return self.with_frame(self.frame.filter(pl.col("time_s") <= until_s))


SELF_JUDGED: Final = "The session judges itself: the law was fitted to its own samples."


def session_hash(values: Any) -> str:
    """Return a hash of the values of one session, in any order; values that are missing do not count."""
    read = np.asarray(values, dtype=np.float32)
    return hashlib.sha256(np.sort(read[np.isfinite(read)]).tobytes()).hexdigest()[:16]


def ratios_of_values(law: Law, value: Floats) -> Floats:
    """Return the log likelihood ratio of each value under a law, (samples,).

    Args:
        value: energies; readings of 0 and 1, if the law is of bits; classes, if it has more than two kinds of tile.
    """
    if law.sensor.kinds > 2:
        return log_ratios_of_classes(law.sensor, value, place=law.place)
    if law.bits:
        return log_ratios_of_bits(law.sensor, value, place=law.place)
    return log_ratios_of_energies(law.sensor, value.astype(np.float32), place=law.place)


def read_by(law: Law, energy: NDArray[Any]) -> Floats:
    """Return the values of samples that measure these energies, in their shape: the energies, or what is read of them.

    Raises:
        InputError: what is read depends on further numbers.
    """
    if not law.bits:
        return energy.astype(np.float64, copy=False)
    model = model_of(law.sensor)
    if len(model.names_of_numbers(law.sensor.params)) > 1:
        raise InputError(
            f"'{model.name}' measures several numbers, of which only energies are known here; leave it out",
            field="--bits",
        )
    return readings_of(law.sensor, energy.ravel()).reshape(energy.shape).astype(np.float64)


def check_law(law: Law) -> None:
    """Refuse a law by which no sample tells still from vibrating.

    Raises:
        InputError: the distributions on still and vibrating places overlap wholly.
    """
    if law.sensor.kinds > 2:
        each = log_ratios_of_classes(law.sensor, np.arange(law.sensor.readings), place=law.place)
        told = float(claimed_rates(law.sensor, law.place)[1:].mean(axis=0) @ each)
    else:
        u = (np.arange(400) + 0.5) / 400
        told = float(ratios_of_values(law, read_by(law, energy_of(law.sensor, 1, u, law.place))).mean())
    if told < 0.01:  # nats: 1,000 samples on one place would tell it by a factor of e^10 at most
        raise InputError(
            "the laws of still and of vibrating places overlap wholly: no sample tells them apart, and nothing can be "
            "said",
            field=law.origin,
        )
