"""The protocol of sensors: what a sample measures on a kind of tile, which reading that is, and what robots know of it.

| name | symbol | unit | meaning |
|---|---|---|---|
| kind | - | 0 to 15 | what lies under the robot, such as 0 still and 1 vibrating |
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
follows from this exactly, without random numbers (``shares_up_to``). What is measured and what robots claim are two
things: ``likelihood`` may state another law than ``measure`` draws from, for robots that are wrong about their sensor.
Samples are read by ``measure``; robots that know their sensor go by the rates of ``likelihood`` (``sensors.claims``).
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
from vibroswarm.errors import CodeError, InputError, shown
from vibroswarm.floors.floor import Place
from vibroswarm.floors.surfaces import mixed
from vibroswarm.strategies.base import Plugin
from vibroswarm.strategies.static_analysis import refuse_chance

if TYPE_CHECKING:
    from vibroswarm.robot.sensing import SenseProgram

MOST_KINDS: Final = 16
"""Largest number of kinds of tile, and of classes of readings."""
TRIED: Final = (np.arange(1000) + 0.5) / 1000
"""Uniform numbers at which it is seen whether readings rise."""
Values = NDArray[np.float64]
"""Measured values, of any shape."""


MOST_NUMBERS: Final = 16
"""Most numbers that a sample measures."""
OTHER_COLUMNS: Final = frozenset({"run", "robot", "sample", "tile", "energy", "observation"})
"""Columns of the table of observations beside those of the numbers beyond the first."""
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


def _two(p: Any) -> int:
    """Return 2, the number of kinds and of readings of a sensor that does not state another."""
    return 2


def _one_energy(p: Any) -> tuple[str, ...]:
    """Return the name of the one number of a sensor that does not state others."""
    return ("energy",)


@dataclass(frozen=True, kw_only=True)
class SensorModel(Plugin):
    """A sensor, see the module's docstring.

    Args:
        measure, sense, reading, class_of, kinds, readings, likelihood, likelihood_at: the functions of the module's
            docstring.
        has_threshold: whether the parameters, in a table of their own, have ``rms_threshold`` of the section beside.
        numbers: names of the numbers of a value, a function of the parameters. In tables the first is the column
            ``energy``, and the others are columns of their names.
        warnings: optional, a function of the parameters that returns sentences on what robots cannot tell apart.
        share_at_most: optional, a function (kind, thresholds, p) for sensors whose reading is 1 above
            ``sensor.rms_threshold``: the share of values of a kind at or below each threshold, if that has a formula.
        check: optional, a function of the parameters that raises an ``InputError`` if they do not go together.
        in_section: whether the parameters are fields of the section ``sensor`` itself, and not of a table of its own.
        scales: whether values are strengths, which ``sensor.tile_spread`` and ``robot_spread`` may multiply. With two
            kinds of tile such a sensor also measures values of tiles and patches (``floors.surfaces``).
        accelerometer: optional, for a sensor that reads the robot's accelerometer: a function of the parameters that
            returns its rate, filter and time of reading (``robot.sensing``).
        for_more_kinds: how to give it more kinds of tile, for messages.
        claims_truth: whether ``likelihood`` states the law of ``measure``. The rates that robots claim are then those
            of ``measure`` to the last bit, and are not summed up from the likelihood.
    """

    reading: Callable[[Values, Any], NDArray[Any]] | None = None
    class_of: Callable[[Any, Any], int] | None = None
    measure: Callable[[int, Values, Any], Values] | None = None
    sense: Callable[[Samples, Any], Values] | None = None
    kinds: Callable[[Any], int] = _two
    readings: Callable[[Any], int] = _two
    likelihood: Callable[[int, Values, Any], Values] | None = None
    likelihood_at: Callable[[float, Values, Any], Values] | None = None
    share_at_most: Callable[[int, Values, Any], Values] | None = None
    check: Callable[[Any], None] | None = None
    in_section: bool = False
    scales: bool = False
    accelerometer: Callable[[Any], SenseProgram] | None = None
    for_more_kinds: str = 'give it a law, as with sensor.model = "confusion"'
    claims_truth: bool = False
    has_threshold: bool = False
    numbers: Callable[[Any], tuple[str, ...]] = _one_energy
    warnings: Callable[[Any], list[str]] | None = None

    def __post_init__(self) -> None:
        """Check the name and the functions, and replace the class of parameters (``Plugin``).

        Raises:
            InputError: the name is invalid, or ``measure`` (or ``sense``) or ``reading`` (or ``class_of``) is not a
                function or draws random numbers of its own, or ``class_of`` is there in vain.
        """
        super().__post_init__()
        field = f"sensor '{self.name}'"
        if self.class_of is not None and (self.sense is None or self.reading is not None):
            raise InputError(
                "has class_of, which takes the place of reading in a sensor with sense", field=field
            )
        for part in (
            "measure" if self.sense is None else "sense",
            "reading" if self.class_of is None else "class_of",
        ):
            if not callable(getattr(self, part)):
                raise InputError(f"has no function {part}", field=field)
        # ``sense`` may have a generator of its own, which it seeds by the address of chance that it is given.
        refuse_chance((self.measure, self.reading, self.class_of, self.likelihood), "use u, of measure")

    def __hash__(self) -> int:
        """Hash the sensor with its functions: its laws are cached."""
        functions = [one for one in vars(self).values() if callable(one) and not isinstance(one, type)]
        return hash((self.name, self.code, *functions))

    def number_of(self, what: Literal["kinds", "readings"], p: BaseModel) -> int:
        """Return the number of kinds of tile, or of classes of readings.

        Raises:
            CodeError: it is no whole number from 2 to ``MOST_KINDS``, or the user's function raised an error.
        """
        with errors_in(self.code):
            count = getattr(self, what)(p)
        if type(count) is not int or not 2 <= count <= MOST_KINDS:
            raise CodeError(
                f"sensor '{self.name}', {what}: returned {shown(count)}; return a whole number from 2 to {MOST_KINDS}"
            )
        return count

    def names_of_numbers(self, p: BaseModel) -> tuple[str, ...]:
        """Return the names of the numbers of a value.

        Raises:
            CodeError: they are not 1 to ``MOST_NUMBERS`` different names, or those of other columns, or the user's
                function raised an error.
        """
        with errors_in(self.code):
            names = self.numbers(p)
        if (
            not isinstance(names, tuple)
            or not all(isinstance(name, str) and name.isprintable() for name in names)
            or not 1 <= len(names) == len(set(names)) <= MOST_NUMBERS
            or not OTHER_COLUMNS.isdisjoint(names[1:])
        ):
            raise CodeError(
                f"sensor '{self.name}', numbers: returned {shown(names)}; return a tuple of 1 to {MOST_NUMBERS} "
                f"different names; beyond the first, {', '.join(sorted(OTHER_COLUMNS))} are taken"
            )
        return names

    def densities(self, kind: int, value: Values, p: BaseModel) -> Values:
        """Return the likelihood that robots claim of values on a kind of tile, in the shape of ``value``.

        Args:
            value: of ``sense``, (samples, numbers), a likelihood for each row; nan where a number is not known.
        Raises:
            InputError: the sensor states none.
            CodeError: ``likelihood`` returned another shape, or what is no density.
        """
        if self.likelihood is None:
            raise InputError(
                f"sensor '{self.name}' states no likelihood, which is needed here", field="sensor.model"
            )
        return self._checked_densities("likelihood", kind, value, p)

    def _checked_densities(
        self, part: Literal["likelihood", "likelihood_at"], of: float, value: Values, p: BaseModel
    ) -> Values:
        """Return what one of the likelihoods says of values on a kind, or at a contrast; raises as ``densities``."""
        wrong = f"sensor '{self.name}', {part}: returned %s; return one number of at least 0 for each value"
        with errors_in(self.code):
            found = np.asarray(getattr(self, part)(of, read_only(value), p), dtype=np.float64)
        if found.shape != (value.shape if self.sense is None else value.shape[:1]):
            raise CodeError(wrong % shown(found))
        if np.isnan(found).any() and np.isnan(value).any():
            raise InputError(
                f"the likelihood of '{self.name}' needs {', '.join(self.names_of_numbers(p))}, and only the first is "
                "known of these samples",
                field="sensor.model",
            )
        if not (found >= 0.0).all():
            raise CodeError(wrong % shown(found))
        return found

    def densities_at(self, contrast: float, value: Values, p: BaseModel) -> Values:
        """Return the likelihood that the sensor states at a contrast (``likelihood_at``); raises as ``densities``."""
        return self._checked_densities("likelihood_at", contrast, value, p)

    def values(self, kind: int, u: Values, p: BaseModel) -> Values:
        """Return what samples measure on a kind of tile, in the shape of ``u``.

        Args:
            u: uniform numbers in (0, 1). p: the parameters.
        Raises:
            CodeError: ``measure`` raised an error, or returned another shape, or values that are not finite.
        """
        if self.measure is None:
            return np.quantile(self.reference_values(p)[kind][:, 0], u)
        with errors_in(self.code):
            values = np.asarray(self.measure(kind, read_only(u), p), dtype=np.float64)
        if values.shape != u.shape or not np.isfinite(values).all():
            raise CodeError(
                f"sensor '{self.name}', measure: returned {_wrong(values, np.isfinite(values))}; return one finite "
                "number for each of u"
            )
        return values

    def sensed(self, samples: Samples, p: BaseModel) -> Values:
        """Return what ``sense`` measures at samples of one run, (samples, numbers).

        ``sense`` is given read-only arrays, whoever made them, so that a kernel that it calls is compiled once.

        Raises:
            CodeError: ``sense`` returned another shape, or numbers that are not finite.
        """
        assert self.sense is not None
        arrays: dict[str, Any] = {
            name: read_only(value)
            for name, value in samples._asdict().items()
            if isinstance(value, np.ndarray)
        }
        with errors_in(self.code):
            values = np.asarray(self.sense(samples._replace(**arrays), p), dtype=np.float64)
        shape = (samples.x_m.size, len(self.names_of_numbers(p)))
        if values.shape != shape or not np.isfinite(values).all():
            raise CodeError(
                f"sensor '{self.name}', sense: returned {_wrong(values, np.isfinite(values))}; return finite numbers "
                f"of the shape {shape}"
            )
        return values

    def reference_values(self, p: BaseModel) -> tuple[Values, ...]:
        """Return what samples at reference places measure, by kind of the tile below: (samples, numbers) each.

        Args:
            p: the parameters, with the grid as ``place`` (``at_place``); else it is ``STUDY_GRID``.
        """
        return _reference_values(self, p, getattr(p, "place", STUDY_GRID))

    def at_place(self, p: Any, place: Place | None) -> Any:
        """Return parameters with the grid of the floors on which the laws of ``sense`` are found, as ``place``.

        Args:
            p: the parameters. place: None: not known.
        """
        if self.sense is None or place is None:
            return p
        return p.model_copy(update={"place": place})

    def values_at(self, contrast: Values | float, u: Values, p: BaseModel) -> Values:
        """Return what samples measure at a contrast between the kinds 0 and 1 (``floors.surfaces``), in the shape of u.

        Args:
            contrast: one, or one for each of ``u``. u: uniform numbers in (0, 1). p: the parameters.
        """
        return mixed(self.values(0, u, p), self.values(1, u, p), contrast)

    def classes(self, value: Values, p: BaseModel) -> NDArray[np.int64]:
        """Return the readings of values, in the shape of ``value``; of ``sense``, one for each row.

        Raises:
            CodeError: ``reading`` (or ``class_of``) raised an error, or returned another shape, or classes that do not
                exist.
        """
        count = self.number_of("readings", p)
        with errors_in(self.code):
            found = np.asarray(self._read(value, p))
        # Values that are not numbers, such as None, are no class.
        classes = found.astype(np.int64) if found.dtype.kind in "biuf" else np.full(found.shape, -1)
        is_class = (classes >= 0) & (classes < count) & (classes == found)
        if found.shape != (value.shape if self.sense is None else value.shape[:1]) or not is_class.all():
            raise CodeError(
                f"sensor '{self.name}', {'reading' if self.class_of is None else 'class_of'}: returned "
                f"{_wrong(found, is_class)}; return a class from 0 to {count - 1} for each value"
            )
        return classes

    def _read(self, value: Values, p: BaseModel) -> Any:
        """Return what the file says of values: all at once, or row by row."""
        if self.class_of is not None:
            return [self.class_of(row, p) for row in value.tolist()]
        assert self.reading is not None
        return self.reading(read_only(value), p)

    def shares_up_to(self, kind: int, factors: Values, p: BaseModel) -> Values:
        """Return the share of samples whose reading is at most j, for each class j but the last.

        The reading of a sample with the uniform number u is the number of these shares below u, exactly.

        Args:
            factors: (rows,): the values are multiplied by these.
        Returns: (rows, readings - 1), rising along each row.
        Raises:
            CodeError: the reading falls as u grows.
        """
        if factors.tolist() == [1.0]:
            return _shares_of_values(
                self, kind, p, getattr(p, "rms_threshold", None), getattr(p, "place", None)
            )
        return self._shares_of(kind, factors, p)

    def _shares_of(self, kind: int, factors: Values, p: BaseModel) -> Values:
        """Compute ``shares_up_to``."""
        borders = range(1, self.number_of("readings", p))
        if self.measure is None:
            classes = self.classes(self.reference_values(p)[kind], p)
            count = len(borders) + 1
            below = np.array([np.count_nonzero(classes < border) + 0.5 * border for border in borders])
            return np.tile(below / (classes.size + 0.5 * count), (factors.size, 1))
        # ``check_sensor`` looks more closely; here what would make readings and values of a run contradict each other.
        if (np.diff(self.classes(self.values(kind, TRIED, p), p)) < 0).any():
            raise CodeError(
                f"sensor '{self.name}': the reading falls as u grows; see the protocol of sensors"
            )
        return self._shares_up_to(lambda u: self.values(kind, u, p) * factors, factors.shape, p)

    def shares_at(self, contrasts: Values, factors: Values, p: BaseModel) -> Values:
        """Return the same at contrasts between the kinds 0 and 1, (rows, contrasts, readings - 1).

        Args:
            contrasts: (contrasts,). factors: (rows,): the values are multiplied by these.
        """
        shape = factors.size, contrasts.size
        level = np.broadcast_to(contrasts, shape)
        return self._shares_up_to(lambda u: self.values_at(level, u, p) * factors[:, None], shape, p)

    def _shares_up_to(
        self, measured: Callable[[Values], Values], shape: tuple[int, ...], p: BaseModel
    ) -> Values:
        borders = range(1, self.number_of("readings", p))
        return np.stack([self._first_above(measured, shape, border, p) for border in borders], axis=-1)

    def _first_above(
        self, measured: Callable[[Values], Values], shape: tuple[int, ...], border: int, p: BaseModel
    ) -> Values:
        """Return the largest u whose reading is below ``border``, of a shape, found by bisection to the last bit."""

        def below(u: Values) -> NDArray[np.bool_]:
            return self.classes(measured(u), p) < border

        low, high = np.full(shape, 2.0**-53), np.full(shape, 1.0 - 2.0**-53)
        low_is_below, high_is_below = below(low), below(high)
        for _ in range(64):  # each halves the interval; doubles in (0, 1) are 2^-53 apart at most
            middle = 0.5 * (low + high)
            is_below = below(middle)
            low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
        return np.where(high_is_below, 1.0, np.where(low_is_below, low, 0.0))


@lru_cache(maxsize=256)
def _shares_of_values(
    model: SensorModel, kind: int, p: BaseModel, threshold: float | None, place: Place | None
) -> Values:
    """Return ``SensorModel.shares_up_to`` with the factor 1; cached, because every run needs them.

    Args:
        threshold, place: those of ``p`` (``has_threshold``, ``at_place``). They are no fields of it, so parameters
            compare equal without them.
    """
    shares = model._shares_of(kind, np.ones(1), p)
    shares.setflags(write=False)
    return shares


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


def _wrong(values: NDArray[Any], is_right: NDArray[np.bool_]) -> str:
    """Return the first value that is not right, for a message; if all are, the whole array, whose shape is wrong."""
    wrong = values[~is_right]
    return str(wrong[0]) if wrong.size else shown(values)
