"""What a strategy is: what a robot remembers, says, and does when it hears, samples, or a time has come.

A strategy is one file: a few classes that declare fields, a few plain functions, and one ``Strategy`` that names them.
The functions change rows in place and are compiled by Numba; they allocate nothing, and all chance comes from ``u``.

    class Params:                          # [strategy.NAME] of a scenario, one field a line, with bounds
        patience: Annotated[int, Field(ge=1)] = 3
    class State:                           # what a robot remembers: int, float, bool
        opinion: int
    class Message:                         # what it sends; without: one ``bit``
        bit: int

    def begin(s, a, d, p, w): ...                     # the state at time 0; it is all zeros before
    def on_counts(s, ones, zeros, p, w): ...          # so many messages of one bit were heard
    def on_message(s, a, m, sender, t_s, d, p, w): ...  # one message was heard
    def on_sample(s, a, x, out, d, p, w): ...         # an own sample: True sends ``out``
    def on_timer(s, a, t_s, out, d, p, w): ...        # optional, due at s.next_s: True sends ``out``
    def decision(s, a, p, w): ...                     # 0, 1; -1 undecided
    def belief(s, a, p, w): ...                       # optional: that the share of ones lies below w.boundary
    def steer(s, a, x, d, p, w): ...                  # optional, after the own sample: turn_deg, drive_ms

``s`` is the robot's State, ``a`` its arrays, ``m`` and ``out`` Messages, ``p`` the Params, ``w`` a ``World``, ``x`` a
``Reading``; ``u(d, k)`` is the k-th uniform number of this call. ``decision`` is asked after each own sample and timer.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from types import FunctionType
from typing import Any, Final, Literal, get_type_hints

import numpy as np
from pydantic import BaseModel, ConfigDict, create_model, field_validator

from vibroswarm.errors import InputError, shown
from vibroswarm.registry import Registry
from vibroswarm.strategies.world import Reading, World
from vibroswarm.strategies.written import check_function

Hook = Callable[..., Any]

MOST_BYTES: Final = 144
"""Bytes that the robots' radio carries in one message."""
NAME: Final = re.compile(r"[a-z][a-z0-9_]*")


class StrategyParams(BaseModel):
    """Parameters of a strategy: frozen and strict, as all fields of a scenario are."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @field_validator("*")
    @classmethod
    def _one_zero(cls, value: object) -> object:
        """-0.0 is 0.0: what is equal is written alike and has one hash."""
        return value + 0.0 if isinstance(value, float) else value


class NoParams:
    """A strategy without parameters."""


class NoArrays:
    """A strategy whose state is scalars alone."""


def _deaf(s: Any, a: Any, m: Any, sender: int, t_s: float, d: Any, p: Any, w: Any) -> None:
    """For a strategy that does not listen."""


class Bit:
    """A message of one bit."""

    bit: int


@dataclass(frozen=True)
class Strategy:
    """A strategy, see the head of this module.

    Args:
        name: as scenarios call it: small letters, digits and underscores. about: one line.
        state, message, params, arrays: classes of fields. begin to steer: the functions.
        decides: "once", or "opinion": it may change, and the swarm has decided when all have agreed for
            ``decision.hold_s``.
        bytes_on_air: of one message, at most 144.
        revises: a decision may change later where ``decision.revise`` says so.
        boundary_half: it asks which of two kinds is more: its boundary of readings must be 1/2.
    """

    name: str
    state: type
    begin: Hook
    on_sample: Hook
    decision: Hook
    message: type = Bit
    belief: Hook | None = None
    params: type = NoParams
    arrays: type = NoArrays
    on_counts: Hook | None = None
    on_message: Hook | None = None
    on_timer: Hook | None = None
    steer: Hook | None = None
    decides: Literal["once", "opinion"] = "once"
    bytes_on_air: int = 1
    revises: bool = False
    boundary_half: bool = False
    about: str = ""
    source: str = field(default="", compare=False)
    """The text of the file it comes from, where that is not of this package."""
    code: str = field(default="", compare=False)
    """That file's name, this one's name in it, and its hash."""

    def __post_init__(self) -> None:
        if not NAME.fullmatch(self.name):
            raise InputError(
                f"{shown(self.name)} is no name; small letters, digits and underscores", field="name"
            )
        if not 0 <= self.bytes_on_air <= MOST_BYTES:
            raise InputError(f"{self.bytes_on_air} is wrong; 0 to {MOST_BYTES}", field="bytes_on_air")
        object.__setattr__(self, "params", as_params(self.params, self.name))
        rows = {
            "s": self.state_type.names,
            "out": self.message_type.names,
            "m": self.message_type.names,
            "p": self.params_type.names,
            "w": World._fields,
            "x": Reading._fields,
            "a": tuple(arrays_of(self.arrays)),
        }
        for one in HOOKS:
            if getattr(self, one) is not None:
                check_function(one, getattr(self, one), {name: found or () for name, found in rows.items()})
        if self.on_timer is not None and "next_s" not in (rows["s"] or ()):
            raise InputError(
                "has on_timer, but its State has no next_s: float", field=f"strategy '{self.name}'"
            )
        if self.on_counts is None and self.on_message is None:
            object.__setattr__(self, "on_message", _deaf)

    @property
    def state_type(self) -> np.dtype[np.void]:
        """The row of a robot's state."""
        return row_type(self.state, "state")

    @property
    def message_type(self) -> np.dtype[np.void]:
        """The row of a message."""
        return row_type(self.message, "message")

    @property
    def params_type(self) -> np.dtype[np.void]:
        """The row of the parameters: as of the fields' defaults and bounds."""
        return row_type(self.params, "params")

    def params_row(self, values: BaseModel) -> tuple[Any, ...]:
        """The parameters as a row of ``params_type``."""
        names: tuple[str, ...] = self.params_type.names or ()
        return tuple(getattr(values, name, 0) for name in names)


@dataclass(frozen=True)
class Array:
    """An array of a robot's state: ``array("float32", "robots*tiles")``."""

    kind: str
    of: str

    def size(self, sizes: Mapping[str, int]) -> int:
        """How many numbers it holds.

        Args:
            sizes: robots, rows, columns, tiles.
        """
        found = 1
        for factor in self.of.split("*"):
            word = factor.strip()
            if not word.isdigit() and word not in sizes:
                raise InputError(
                    f"{shown(word)} is no size; a number or one of {', '.join(sizes)}", field="arrays"
                )
            found *= int(word) if word.isdigit() else sizes[word]
        return found


ARRAY_KINDS: Final = ("float64", "float32", "int64", "int32", "int16", "uint8")


def array(kind: str, of: str) -> Array:
    """An array in a robot's state.

    Args:
        kind: of its numbers, one of ``ARRAY_KINDS``. of: its size, a product such as "robots*tiles".
    """
    if kind not in ARRAY_KINDS:
        raise InputError(
            f"{shown(kind)} is no kind of number (there are {', '.join(ARRAY_KINDS)})", field="arrays"
        )
    return Array(kind, of)


def arrays_of(declared: type) -> dict[str, Array]:
    """The arrays of a class whose attributes are ``array(...)``."""
    return {name: one for name, one in vars(declared).items() if isinstance(one, Array)}


HOOKS: Final = (
    "begin", "on_counts", "on_message", "on_sample", "on_timer", "decision", "belief", "steer",
)  # fmt: skip
CLASSES: Final = {"Params": "params", "State": "state", "Message": "message", "Arrays": "arrays"}


def strategy_in(module: str, name: str, **more: Any) -> Strategy:
    """The strategy that a module's classes and functions make, by the names in the head of this module.

    Args:
        module: ``__name__``. name, more: as of ``Strategy``.
    Raises:
        InputError: a class or a function that every strategy has is missing.
    """
    space = vars(sys.modules[module])
    found = {CLASSES[one]: space[one] for one in CLASSES if one in space}
    found |= {one: space[one] for one in HOOKS if isinstance(space.get(one), FunctionType)}
    for one, word in (
        ("state", "State"),
        ("begin", "begin"),
        ("on_sample", "on_sample"),
        ("decision", "decision"),
    ):
        if one not in found:
            raise InputError(f"has no {word}; every strategy has one", field=f"strategy '{name}'")
    return Strategy(name=name, **{**found, **more})


KINDS: Final[dict[type, Any]] = {int: np.int64, float: np.float64, bool: np.bool_}


def fields_of(declared: type) -> dict[str, type]:
    """Fields of a class of annotations, by name: int, float or bool.

    Raises:
        InputError: another type.
    """
    hints = get_type_hints(declared)
    if issubclass(declared, BaseModel):
        hints = {name: hint for name, hint in hints.items() if name in declared.model_fields}
    for name, kind in hints.items():
        if kind not in KINDS:
            raise InputError(f"{shown(kind)} is no type of a field; int, float or bool", field=name)
    return hints


@cache
def row_type(declared: type, what: str) -> np.dtype[np.void]:
    """The row of a class's fields.

    Raises:
        InputError: a field of another type than int, float or bool.
    """
    try:
        found = fields_of(declared)
    except (NameError, TypeError) as error:
        raise InputError(f"{shown(declared)} declares no fields: {error}", field=what) from None
    # A row without a field has no place: a strategy that says or remembers nothing keeps one that is not used.
    return np.dtype([(name, KINDS[kind]) for name, kind in found.items()] or [("unused", np.int64)])


def as_params(declared: type, name: str) -> type[BaseModel]:
    """A class of annotated fields as a frozen, strict model."""
    if issubclass(declared, BaseModel):
        return declared
    hints = get_type_hints(declared, include_extras=True)
    given: dict[str, Any] = {one: (hint, getattr(declared, one, ...)) for one, hint in hints.items()}
    return create_model(
        f"{name.title()}Params", __base__=StrategyParams, __doc__=declared.__doc__, **given
    )  # fmt: skip


_registry = Registry[Strategy]("strategy", "strategy.name")
register, forget, names, known, strategy = (
    _registry.register,
    _registry.forget,
    _registry.names,
    _registry.known,
    _registry.get,
)
