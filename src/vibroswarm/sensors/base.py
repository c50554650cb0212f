"""The protocol of sensors: what a sample measures on a kind of tile, which reading that is, and what robots know of it.

| name | symbol | unit | meaning |
|---|---|---|---|
| kind | - | 0 to 15 | what lies under the robot, such as 0 still and 1 vibrating |
| level | - | 0 to 15 | a kind, or a contrast between the kinds 0 and 1, which is no whole number |
| value | E | the sensor's own | what a sample measures |
| u | u | (0, 1) | the sample's uniform number: the value is the quantile u of the kind's law |
| reading | O | 0 to 15 | the class that the robot takes the value for |

A sensor is one file: parameters, and plain functions of NumPy arrays.

    class Params:                          # [sensor.NAME] of a scenario, one field per line, with bounds
        noise: Annotated[float, Field(gt=0)] = 0.2

    def kinds(p): ...                      # number of kinds of tile that have a law (if omitted, 2)
    def readings(p): ...                   # number of classes (if omitted, 2)
    def measure(kind, u, p): ...           # (samples,) values: quantiles ``u`` (samples,) of the law of one kind
    def reading(value, p): ...             # (samples,) classes of values
    def likelihood(kind, value, p): ...    # optional: density (or share) of values under the law of one kind
    def likelihood_at(contrast, value, p): ...  # optional: the same at a contrast between the kinds 0 and 1

A sensor whose values depend on the place, as acceleration does, has in place of ``measure``

    def sense(samples, p): ...             # (samples, numbers) values: of ``Samples``, each of up to 16 numbers

    def numbers(p): ...                    # names of these numbers (if omitted, one)

and its ``reading`` and ``likelihood`` get all numbers of each value; the first is the energy of the tables. In place of
``reading`` it may have

    def class_of(v, p): ...                # the class of one sample, of its numbers v[0], v[1], ...

in the language of strategies' hooks (numbers and ``math``), with which robots can be exported to C. Its laws
are those at uniformly random places on random floors of the scenario's grid, ``p.place``, with all kinds in equal
shares, at 0, 3, ..., 747 s (``reference_values``). Of n_i such samples on kind i, n_ij of which read as one of k
classes j, the share is (n_ij + 1/2) / (n_i + k/2).

``measure`` must not fall as u grows, nor ``reading`` as the value grows: the share of samples that read as a class
follows from this exactly, without random numbers (``shares_up_to``). ``likelihood`` states the law that ``measure``
draws from. Robots that are wrong about their sensor are stated by ``sensor.claimed_rates``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from vibroswarm.core.jit import read_only
from vibroswarm.core.registry import Registry
from vibroswarm.core.rng import SEED_LIMIT, Purpose, uniforms
from vibroswarm.core.user_code import errors_in
from vibroswarm.errors import CodeError
from vibroswarm.floors.floor import Place
from vibroswarm.floors.surfaces import mixed
from vibroswarm.strategies.base import Plugin
from vibroswarm.strategies.static_analysis import refuse_chance

if TYPE_CHECKING:
    from vibroswarm.robot.sensing import SenseProgram

MOST_KINDS: Final = 16
"""Largest number of kinds of tile, and of classes of readings."""
MOST_NUMBERS: Final = 16
"""Most numbers that a sample measures."""
TRIED: Final = (np.arange(1000) + 0.5) / 1000
"""Uniform numbers at which it is seen whether readings rise."""
Values = NDArray[np.float64]
"""Measured values, of any shape."""
STUDY_GRID: Final = Place(rows=5, columns=5, width_m=0.2, height_m=0.2, left_m=0.0, top_m=1.0)
"""Grid of the study's floors, on which the laws of sensors that depend on the place are found if no other is known."""
REFERENCE_RUNS: Final = 400
REFERENCE_SAMPLES: Final = 250
"""Number of floors on which these laws are found, and of samples on each."""
REFERENCE_SEED: Final = SEED_LIMIT - 1
FIRST_REFERENCE_RUN: Final = 2**31
"""Seed and number of the first of these floors, which no simulation has."""


class Samples(NamedTuple):
    """Samples of one run: where and when they are taken, on what floor, and the address of their chance."""

    place: Place
    """Grid and position of the floor."""
    tiles: NDArray[np.uint8]
    """(tiles,): kinds of the tiles, top row first."""
    x_m: Values
    y_m: Values
    time_s: Values
    """(samples,): place and time of each sample."""
    robot: NDArray[np.int64]
    sample: NDArray[np.int64]
    """(samples,): number of the robot, and of the sample among its own."""
    seed: int
    run: int


@dataclass(frozen=True, kw_only=True)
class SensorModel(Plugin):
    """A sensor, see the module's docstring.

    Args:
        measure, sense, reading, class_of, kinds, readings, likelihood, likelihood_at: the functions of the module's
            docstring.
        has_threshold: whether the parameters, in a table of their own, have ``rms_threshold`` of the section beside.
        numbers: names of the numbers of a value, a function of the parameters. In tables the first is the column
            ``energy``, and the others are columns of their names.
        share_at_most: optional, a function (kind, thresholds, p) for sensors whose reading is 1 above
            ``sensor.rms_threshold``: the share of values of a kind at or below each threshold, if that has a formula.
        check: optional, a function of the parameters that raises an ``InputError`` if they do not go together.
        in_section: whether the parameters are fields of the section ``sensor`` itself, and not of a table of its own.
        scales: whether values are strengths, which ``sensor.tile_spread`` and ``robot_spread`` may multiply. With two
            kinds of tile such a sensor also measures values of tiles and patches (``floors.surfaces``).
        accelerometer: optional, for a sensor that reads the robot's accelerometer: a function of the parameters that
            returns its rate, filter and time of reading (``robot.sensing``).
        for_more_kinds: how to give it more kinds of tile, for messages.
    """

    reading: Callable[[Values, Any], NDArray[Any]] | None = None
    class_of: Callable[[Any, Any], int] | None = None
    measure: Callable[[int, Values, Any], Values] | None = None
    sense: Callable[[Samples, Any], Values] | None = None
    kinds: Callable[[Any], int] = lambda p: 2
    readings: Callable[[Any], int] = lambda p: 2
    likelihood: Callable[[int, Values, Any], Values] | None = None
    likelihood_at: Callable[[float, Values, Any], Values] | None = None
    share_at_most: Callable[[int, Values, Any], Values] | None = None
    check: Callable[[Any], None] | None = None
    in_section: bool = False
    scales: bool = False
    accelerometer: Callable[[Any], SenseProgram] | None = None
    for_more_kinds: str = 'give it a law, as with sensor.model = "confusion"'
    has_threshold: bool = False
    numbers: Callable[[Any], tuple[str, ...]] = lambda p: ("energy",)

    def __post_init__(self) -> None:
        """Check the name and that no function draws random numbers of its own, and replace the class of parameters."""
        super().__post_init__()
        # ``sense`` may have a generator of its own, which it seeds by the address of chance that it is given.
        refuse_chance((self.measure, self.reading, self.class_of, self.likelihood), "use u, of measure")

    def number_of(self, what: Literal["kinds", "readings"], p: BaseModel) -> int:
        """Return the number of kinds of tile, or of classes of readings."""
        count = self._call(what, p, is_right=lambda count: (count >= 2) & (count <= MOST_KINDS))
        return int(count)

    def names_of_numbers(self, p: BaseModel) -> tuple[str, ...]:
        """Return the names of the numbers of a value."""
        with errors_in(self.code):
            return tuple(self.numbers(p))

    def _call(
        self, part: str, *arguments: Any, is_right: Callable[[Values], NDArray[np.bool_]] = np.isfinite
    ) -> Values:
        """Return what one of the functions returns for read-only arguments, or refuse it."""
        given = [read_only(each) if isinstance(each, np.ndarray) else each for each in arguments]
        with errors_in(self.code):
            found = np.asarray(getattr(self, part)(*given), dtype=np.float64)
        if not is_right(found).all():
            raise CodeError(f"sensor '{self.name}', {part}: returned {found[~is_right(found)].flat[0]:g}")
        return found

    def densities(self, kind: int, value: Values, p: BaseModel) -> Values:
        """Return the likelihood of values on a kind of tile, in the shape of ``value``; of ``sense``, one for each row.

        Args:
            value: of ``sense``, (samples, numbers); nan where a number is not known.
        Raises:
            CodeError: ``likelihood`` returned what is no density.
        """
        return self._call("likelihood", kind, value, p, is_right=lambda density: density >= 0.0)

    def densities_at(self, contrast: float, value: Values, p: BaseModel) -> Values:
        """Return the likelihood of values at a contrast between the kinds 0 and 1.

        It is what the sensor states (``likelihood_at``); else it follows from the quantiles of both kinds, in steps
        between 200 of them, and is 0 beyond them.
        """
        if self.likelihood_at is not None:
            return self._call("likelihood_at", contrast, value, p, is_right=lambda density: density >= 0.0)
        from scipy.special import ndtr  # its import takes long

        # levels denser near 0 and 1
        u = ndtr(np.linspace(-4.5, 4.5, 4000)[np.linspace(0, 3999, 200).round().astype(np.int64)])
        still, vibrating = (self.values(kind, u, p).astype(np.float32).astype(float) for kind in (0, 1))
        quantile = mixed(still, vibrating, contrast)
        density = np.diff(u) / np.maximum(np.diff(quantile), 1e-9)
        return np.interp(value, 0.5 * (quantile[1:] + quantile[:-1]), density, left=0.0, right=0.0)

    def values(self, level: float, u: Values, p: BaseModel) -> Values:
        """Return what samples measure at a level, in the shape of ``u``.

        Args:
            level: a kind of tile, or a contrast between the kinds 0 and 1. u: uniform numbers in (0, 1).
        Raises:
            CodeError: ``measure`` raised an error, or returned values that are not finite.
        """
        if level % 1.0:
            return mixed(self.values(0, u, p), self.values(1, u, p), level)
        if self.measure is None:
            return np.quantile(self.reference_values(p)[int(level)][:, 0], u)
        return self._call("measure", int(level), u, p)

    def sensed(self, samples: Samples, p: BaseModel) -> Values:
        """Return what ``sense`` measures at samples of one run, (samples, numbers); its arrays are read-only."""
        return self._call("sense", with_read_only(samples), p)

    def reference_values(self, p: BaseModel) -> tuple[Values, ...]:
        """Return what samples at reference places measure, by kind of the tile below: (samples, numbers) each."""
        return _reference_values(self, p, getattr(p, "place", STUDY_GRID))

    def at_place(self, p: Any, place: Place | None) -> Any:
        """Return parameters with the grid of the floors on which the laws of ``sense`` are found, as ``place``."""
        return p if self.sense is None or place is None else p.model_copy(update={"place": place})

    def classes(self, value: Values, p: BaseModel) -> NDArray[np.int64]:
        """Return the readings of values, in the shape of ``value``; of ``sense``, one for each row."""
        count = self.number_of("readings", p)
        part, given = ("reading", value) if self.class_of is None else ("_class_of_rows", value.tolist())
        found = self._call(part, given, p, is_right=lambda c: (c >= 0) & (c < count) & (c == np.floor(c)))
        return found.astype(np.int64)

    def _class_of_rows(self, rows: list[list[float]], p: BaseModel) -> list[int]:
        assert self.class_of is not None
        return [self.class_of(row, p) for row in rows]

    def shares_up_to(self, kind: int, factors: Values, p: BaseModel) -> Values:
        """Return the shares whose reading is at most each class but the last, (rows, classes - 1): that of u counts
        those below u.
        """
        # Threshold and place are no fields of ``p``, so parameters compare equal without them.
        beside = getattr(p, "rms_threshold", None), getattr(p, "place", None)
        return _shares_up_to(self, kind, tuple(factors.tolist()), p, beside)

    def shares_at(self, contrasts: Values, factors: Values, p: BaseModel) -> Values:
        """Return the same at contrasts between the kinds 0 and 1, (rows, contrasts, readings - 1)."""

        def measured(u: Values) -> Values:
            return mixed(self.values(0, u, p), self.values(1, u, p), contrasts) * factors[:, None]

        return self.shares_of(measured, (factors.size, contrasts.size), p)

    def shares_of(self, measured: Callable[[Values], Values], shape: tuple[int, ...], p: BaseModel) -> Values:
        """Return the largest u whose reading is below each class but 0, found by bisection to the last bit."""
        borders = range(1, self.number_of("readings", p))
        return np.stack([self._share_below(measured, shape, border, p) for border in borders], axis=-1)

    def _share_below(
        self, measured: Callable[[Values], Values], shape: tuple[int, ...], border: int, p: BaseModel
    ) -> Values:
        def is_below(u: Values) -> NDArray[np.bool_]:
            return self.classes(measured(u), p) < border

        ends = np.full(shape, 2.0**-53), np.full(shape, 1.0 - 2.0**-53)
        found, _ = halved(*ends, is_below)
        return np.where(is_below(ends[1]), 1.0, np.where(is_below(ends[0]), found, 0.0))

    def class_borders(self, p: BaseModel) -> Values:
        """Return the least values that read as class 1, 2, ...; inf if nothing measured does."""
        measured = np.unique([self.values(kind, TRIED, p) for kind in range(self.number_of("kinds", p))])
        borders = np.arange(1, self.number_of("readings", p))
        first = np.searchsorted(self.classes(measured, p), borders)
        ends = measured[np.maximum(first - 1, 0)], measured[np.minimum(first, measured.size - 1)]
        _, high = halved(*ends, lambda value: self.classes(value, p) < borders)
        return np.where(first == 0, -np.inf, np.where(first == measured.size, np.inf, high))


def with_read_only(samples: Samples) -> Samples:
    """Return samples whose arrays are read-only, so that kernels are compiled once."""
    return Samples._make(read_only(each) if isinstance(each, np.ndarray) else each for each in samples)


def halved(
    low: Values, high: Values, is_below: Callable[[Values], NDArray[np.bool_]]
) -> tuple[Values, Values]:
    """Return the ends of intervals after 64 halvings, which leave no double in between, towards where it turns."""
    for _ in range(64):
        middle = 0.5 * (low + high)
        below = is_below(middle)
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return low, high


@lru_cache(maxsize=256)
def _shares_up_to(
    model: SensorModel, kind: int, factors: tuple[float, ...], p: BaseModel, beside: tuple[Any, ...]
) -> Values:
    """Return ``SensorModel.shares_up_to``; cached, because every run needs them."""
    if model.measure is None:
        count = model.number_of("readings", p)
        classes = model.classes(model.reference_values(p)[kind], p)
        below = np.array([np.count_nonzero(classes < j) + 0.5 * j for j in range(1, count)])
        return read_only(np.tile(below / (classes.size + 0.5 * count), (len(factors), 1)))
    # ``check_sensor`` looks more closely; here what would make readings and values of a run contradict each other.
    if (np.diff(model.classes(model.values(kind, TRIED, p), p)) < 0).any():
        raise CodeError(f"sensor '{model.name}': the reading falls as u grows; see the protocol of sensors")
    strengths = np.array(factors)
    return read_only(model.shares_of(lambda u: model.values(kind, u, p) * strengths, strengths.shape, p))


@lru_cache(maxsize=16)
def _reference_values(model: SensorModel, p: BaseModel, place: Place) -> tuple[Values, ...]:
    """Return ``SensorModel.reference_values``; cached, because every scenario with this sensor needs them."""
    kinds, tiles, seed = model.number_of("kinds", p), place.rows * place.columns, REFERENCE_SEED
    below: list[NDArray[np.uint8]] = []
    found: list[Values] = []
    number = np.arange(REFERENCE_SAMPLES)
    time_s = np.asarray(3.0 * number, dtype=np.float64)
    for run in range(FIRST_REFERENCE_RUN, FIRST_REFERENCE_RUN + REFERENCE_RUNS):
        # Kinds in turn, in random order; the first one is another in each run, as the shares cannot be quite equal.
        order = np.argsort(uniforms(seed, run, 0, Purpose.FLOOR, tiles), kind="stable")
        floor = ((order + run) % kinds).astype(np.uint8)
        right, down = (uniforms(seed, run, axis, Purpose.PLACEMENT, REFERENCE_SAMPLES) for axis in (0, 1))
        column, row = right * place.columns, down * place.rows
        x_m, y_m = place.left_m + column * place.width_m, place.top_m - row * place.height_m
        samples = Samples(place, floor, x_m, y_m, time_s, np.zeros_like(number), number, seed, run)
        found.append(model.sensed(samples, p))
        below.append(floor[row.astype(np.int64) * place.columns + column.astype(np.int64)])
    values, kind = np.concatenate(found), np.concatenate(below)
    return tuple(values[kind == one] for one in range(kinds))


_registry = Registry[SensorModel]("sensor", "sensor.model")
register, forget, names, known, sensor = (
    _registry.register,
    _registry.forget,
    _registry.names,
    _registry.known,
    _registry.get,
)
