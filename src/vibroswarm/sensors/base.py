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

``measure`` must not fall as u grows, nor ``reading`` as the value grows: the share of samples that read as a class
follows from this exactly, without random numbers (``shares_up_to``). What is measured and what robots claim are two
things: ``likelihood`` may state another law than ``measure`` draws from, for robots that are wrong about their sensor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from vibroswarm.core.registry import Registry
from vibroswarm.core.user_code import errors_in
from vibroswarm.errors import CodeError, InputError, shown
from vibroswarm.strategies.base import Plugin

MOST_KINDS: Final = 16
"""Largest number of kinds of tile, and of classes of readings."""
TRIED: Final = (np.arange(1000) + 0.5) / 1000
"""Uniform numbers at which it is seen whether readings rise."""
Values = NDArray[np.float64]
"""Measured values, of any shape."""


def _two(p: Any) -> int:
    """Return 2, the number of kinds and of readings of a sensor that does not state another."""
    return 2


@dataclass(frozen=True, kw_only=True)
class SensorModel(Plugin):
    """A sensor, see the module's docstring.

    Args:
        measure, reading, kinds, readings, likelihood: the functions of the module's docstring.
        share_at_most: optional, a function (kind, thresholds, p) for sensors whose reading is 1 above
            ``sensor.rms_threshold``: the share of values of a kind at or below each threshold, if that has a formula.
        check: optional, a function of the parameters that raises an ``InputError`` if they do not go together.
        in_section: whether the parameters are fields of the section ``sensor`` itself, and not of a table of its own.
        scales: whether values are strengths, which ``sensor.tile_spread`` and ``robot_spread`` may multiply.
    """

    measure: Callable[[int, Values, Any], Values]
    reading: Callable[[Values, Any], NDArray[Any]]
    kinds: Callable[[Any], int] = _two
    readings: Callable[[Any], int] = _two
    likelihood: Callable[[int, Values, Any], Values] | None = None
    share_at_most: Callable[[int, Values, Any], Values] | None = None
    check: Callable[[Any], None] | None = None
    in_section: bool = False
    scales: bool = False

    def __post_init__(self) -> None:
        """Check the name and the functions, and replace the class of parameters (``Plugin``).

        Raises:
            InputError: the name is invalid, or ``measure`` or ``reading`` is not a function.
        """
        super().__post_init__()
        for part in ("measure", "reading"):
            if not callable(getattr(self, part)):
                raise InputError(f"has no function {part}", field=f"sensor '{self.name}'")

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

    def densities(self, kind: int, value: Values, p: BaseModel) -> Values:
        """Return the likelihood that robots claim of values on a kind of tile, in the shape of ``value``.

        Raises:
            InputError: the sensor states none.
            CodeError: ``likelihood`` returned another shape, or what is no density.
        """
        if self.likelihood is None:
            raise InputError(
                f"sensor '{self.name}' states no likelihood, which is needed here", field="sensor.model"
            )
        with errors_in(self.code):
            found = np.asarray(self.likelihood(kind, value, p), dtype=np.float64)
        if found.shape != value.shape or not (found >= 0.0).all():
            raise CodeError(
                f"sensor '{self.name}', likelihood: returned {shown(found)}; return one number of at least 0 for each "
                "value"
            )
        return found

    def values(self, kind: int, u: Values, p: BaseModel) -> Values:
        """Return what samples measure on a kind of tile, in the shape of ``u``.

        Args:
            u: uniform numbers in (0, 1). p: the parameters.
        Raises:
            CodeError: ``measure`` raised an error, or returned another shape, or values that are not finite.
        """
        with errors_in(self.code):
            values = np.asarray(self.measure(kind, u, p), dtype=np.float64)
        if values.shape != u.shape or not np.isfinite(values).all():
            raise CodeError(
                f"sensor '{self.name}', measure: returned {shown(values)}; return one finite number for each of u"
            )
        return values

    def classes(self, value: Values, p: BaseModel) -> NDArray[np.int64]:
        """Return the readings of values, in the shape of ``value``.

        Raises:
            CodeError: ``reading`` raised an error, or returned another shape, or classes that do not exist.
        """
        count = self.number_of("readings", p)
        with errors_in(self.code):
            found = np.asarray(self.reading(value, p))
            classes = found.astype(np.int64)
        if (
            found.shape != value.shape
            or (classes != found).any()
            or not ((classes >= 0) & (classes < count)).all()
        ):
            raise CodeError(
                f"sensor '{self.name}', reading: returned {shown(found)}; return a class from 0 to {count - 1} for "
                "each value"
            )
        return classes

    def shares_up_to(self, kind: int, factors: Values, p: BaseModel) -> Values:
        """Return the share of samples whose reading is at most j, for each class j but the last.

        The reading of a sample with the uniform number u is the number of these shares below u, exactly.

        Args:
            factors: (rows,): the values are multiplied by these.
        Returns: (rows, readings - 1), rising along each row.
        Raises:
            CodeError: the reading falls as u grows.
        """
        # ``check_sensor`` looks more closely; here what would make readings and values of a run contradict each other.
        if (np.diff(self.classes(self.values(kind, TRIED, p), p)) < 0).any():
            raise CodeError(
                f"sensor '{self.name}': the reading falls as u grows; see the protocol of sensors"
            )
        borders = range(1, self.number_of("readings", p))
        return np.stack([self._first_above(kind, factors, border, p) for border in borders], axis=-1)

    def _first_above(self, kind: int, factors: Values, border: int, p: BaseModel) -> Values:
        """Return the largest u whose reading is below ``border``, (rows,), found by bisection to the last bit."""

        def below(u: Values) -> NDArray[np.bool_]:
            return self.classes(self.values(kind, u, p) * factors, p) < border

        low, high = np.full(factors.shape, 2.0**-53), np.full(factors.shape, 1.0 - 2.0**-53)
        low_is_below, high_is_below = below(low), below(high)
        for _ in range(64):  # each halves the interval; doubles in (0, 1) are 2^-53 apart at most
            middle = 0.5 * (low + high)
            is_below = below(middle)
            low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
        return np.where(high_is_below, 1.0, np.where(low_is_below, low, 0.0))


_registry = Registry[SensorModel]("sensor", "sensor.model")
register, forget, names, known, sensor = (
    _registry.register,
    _registry.forget,
    _registry.names,
    _registry.known,
    _registry.get,
)
