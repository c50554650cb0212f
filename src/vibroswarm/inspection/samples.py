"""The samples of one inspection: where each was taken, what it measured, and its log likelihood ratio."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.calibrate.camera import RIGHT, Camera
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor, Place
from vibroswarm.observation.energy_model import (
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
"""One row per sample, by time. ``time_s``: from when it counts, which is when its place is known; 0 without times.
``spread_x_m``, ``spread_y_m``: standard deviations of the place. ``true_x_m``, ``true_y_m``: the true place, null where
it is not known; only drawn damage is felt there. ``value``: energy, bit or class. ``log_ratio``: ln of its likelihood
where it vibrates over that where it is still."""

FEWEST: Final = 20
"""With fewer samples there is no answer."""
FEW_READINGS: Final = 12
"""So few different values of a reference are readings, with nothing half-way between those of both kinds."""


class Places(Enum):
    """Where places are known from."""

    ESTIMATED = "estimated by the robots"
    TRUE = "true places, which no real robot knows: an upper bound"
    CAMERA = "seen by a camera"
    FILE = "as the file has them"


class Doubt(Enum):
    """Why not to certify anything."""

    OWN_LAW = "the law was fitted to these samples"
    CHANGED = "the floor changed during the inspection, but is presumed to stay as it is"
    COPIES = "the file repeats rows"
    FAULTS = "faults change readings only, and the energies are those of working sensors (use bits)"


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
    sessions: tuple[str, ...] = ()
    """``session_hash`` of each session that it was fitted to."""
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
        """Whether damage may be weaker; between few readings, as of a bit or 0 and 1, there is nothing."""
        measured = {*(self.sensor.still_energies or ()), *(self.sensor.vibrating_energies or ())}
        return not self.bits and not 0 < len(measured) <= FEW_READINGS


@dataclass(frozen=True, eq=False)
class Samples:
    """The samples of one inspection."""

    frame: pl.DataFrame
    """Columns of ``SAMPLES``."""
    size_m: tuple[float, float]
    """Width and height of the inspected surface, whose lower left corner is the origin."""
    law: Law
    places: Places
    source: str
    """What was inspected, in words."""
    floor: Floor | None = None
    """The grid of tiles and, if ``truth_known``, which of them vibrate, with its changes; None: no grid."""
    truth_known: bool = False
    kinds: Floor | None = None
    """The floor with its kinds of tile, if there are more than two; ``floor`` says which are not of kind 0."""
    doubts: tuple[Doubt, ...] = ()

    @property
    def grid(self) -> Floor:
        """The grid of tiles."""
        if self.floor is None:
            raise InputError("a map of tiles needs a grid; give it", field="--tiles")
        return self.floor

    @property
    def hash(self) -> str:
        """A hash of the samples, by which a certificate names them."""
        return hashlib.sha256(csv_bytes(self.frame)).hexdigest()[:16]

    @property
    def robots(self) -> list[int]:
        """Numbers of the robots, ascending."""
        return [int(robot) for robot in np.unique(self.frame["robot"].to_numpy())]

    def column(self, name: str) -> Floats:
        """Return a column as numbers, (samples,)."""
        return np.ascontiguousarray(self.frame[name].to_numpy(), dtype=np.float64)

    def where(self, chosen: pl.Expr | pl.Series) -> Samples:
        """Return some of the samples."""
        return replace(self, frame=self.frame.filter(chosen))

    def with_columns(self, **columns: Floats) -> Samples:
        """Return the same samples with other values in some columns, such as other places for a control."""
        return replace(self, frame=self.frame.with_columns(**{k: pl.Series(v) for k, v in columns.items()}))


def session_hash(values: Any) -> str:
    """Return a hash of the values of one session, in any order; values that are missing do not count."""
    read = np.asarray(values, dtype=np.float32)
    return hashlib.sha256(np.sort(read[np.isfinite(read)]).tobytes()).hexdigest()[:16]


def ratios_of_values(law: Law, value: Floats) -> Floats:
    """Return the log likelihood ratio of each value under a law, (samples,)."""
    if law.sensor.kinds > 2:
        return log_ratios_of_classes(law.sensor, value, place=law.place)
    if law.bits:
        return log_ratios_of_bits(law.sensor, value, place=law.place)
    return log_ratios_of_energies(law.sensor, value.astype(np.float32), place=law.place)


def read_by(law: Law, energy: NDArray[Any]) -> Floats:
    """Return what samples that measure these energies read, in their shape: the energies, or classes."""
    if not law.bits:
        return energy.astype(np.float64, copy=False)
    model = model_of(law.sensor)
    if len(model.names_of_numbers(law.sensor.params)) > 1:
        raise InputError(f"'{model.name}' measures several numbers; leave it out", field="--bits")
    return readings_of(law.sensor, energy.ravel()).reshape(energy.shape).astype(np.float64)
