"""A sensor that tells several kinds of tile apart, and confuses some: a colour sensor, or a classifier.

| name | symbol | unit | equation |
|---|---|---|---|
| rates | P(j given i) | - | share of samples on tiles of kind i (rows) that read as class j (columns) |
| value | - | class | the class j with P(<= j - 1 given i) < u <= P(<= j given i) |

Without ``rates`` there are ``kinds`` kinds, each read right with the probability ``accuracy``, and as each other kind
equally often.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from vibroswarm.errors import InputError
from vibroswarm.sensors.base import MOST_KINDS, SensorModel, Values, register

Row = Annotated[
    tuple[Annotated[float, Field(ge=0, le=1)], ...], Field(min_length=2, max_length=MOST_KINDS, strict=False)
]
Rates = Annotated[tuple[Row, ...], Field(min_length=2, max_length=MOST_KINDS, strict=False)]
"""One row for each kind of tile, with the share of samples that read as each class; rows sum to 1."""


class Params:
    """Rates of reading each class on each kind of tile."""

    kinds: Annotated[int, Field(ge=2, le=MOST_KINDS)] = 3
    """Number of kinds of tile, without ``rates``."""
    accuracy: Annotated[float, Field(gt=0, le=1)] = 0.9
    """Share of samples that read as the kind of their tile, without ``rates``."""
    rates: Rates | None = None
    """One row for each kind of tile, with the share of samples that read as each class; rows sum to 1."""


def rates_of(p: Any) -> Values:
    """Return the rates, (kinds, classes)."""
    if p.rates is not None:
        return np.asarray(p.rates, dtype=np.float64)
    missed = (1.0 - p.accuracy) / (p.kinds - 1)
    return np.asarray(np.full((p.kinds, p.kinds), missed) + (p.accuracy - missed) * np.eye(p.kinds))


def kinds(p: Any) -> int:
    """Return the number of kinds of tile."""
    return int(p.kinds) if p.rates is None else len(p.rates)


def readings(p: Any) -> int:
    """Return the number of classes."""
    return int(p.kinds) if p.rates is None else len(p.rates[0])


def measure(kind: int, u: Values, p: Any) -> Values:
    """Return the classes at the quantiles ``u``."""
    # The last class takes what rounding leaves of 1.
    return np.asarray(np.searchsorted(np.cumsum(rates_of(p)[kind])[:-1], u), dtype=np.float64)


def reading(value: Values, p: Any) -> NDArray[np.int64]:
    """Return the classes, which are what is measured."""
    return value.astype(np.int64)


def likelihood(kind: int, value: Values, p: Any) -> Values:
    """Return the share of samples on a kind of tile that read as each of these classes."""
    return np.asarray(rates_of(p)[kind][value.astype(np.int64)])


def check(p: Any) -> None:
    """Refuse rates whose rows differ in length or do not sum to 1."""
    if p.rates is not None:
        check_rates(p.rates, len(p.rates[0]), "sensor.confusion.rates")


def check_rates(rates: tuple[tuple[float, ...], ...], classes: int, field: str) -> None:
    """Refuse rates whose rows do not have this number of classes, or do not sum to 1."""
    for number, row in enumerate(rates):
        if len(row) != classes or abs(sum(row) - 1.0) > 1e-9:
            raise InputError(
                f"row {number} has {len(row)} classes and sums to {sum(row):.12g}; give {classes} shares that sum to 1",
                field=field,
            )


confusion = register(
    SensorModel(
        name="confusion",
        params=Params,
        kinds=kinds,
        readings=readings,
        measure=measure,
        reading=reading,
        likelihood=likelihood,
        check=check,
        for_more_kinds="set sensor.confusion.kinds, or give sensor.confusion.rates a row for each kind",
        about="several kinds of tile, each read as each class with a given probability",
    )
)
