"""The protocol of strategies: what a robot remembers, and does when it hears, samples, or its timer is due.

A strategy is one file: a few classes that declare fields, a few plain functions, and one ``Strategy`` that names them.
The functions change rows in place and are compiled by Numba; they allocate nothing, and all chance comes from ``u``.

    class Params:                          # [strategy.NAME] of a scenario, one field per line, with bounds
        patience: Annotated[int, Field(ge=1)] = 3
    class State:                           # what a robot remembers: int, float, bool
        opinion: int
    class Message:                         # what it sends; if omitted: one ``bit``
        bit: int

    def begin(s, a, d, p, w): ...                     # the state at time 0; it is all zeros before
    def on_counts(s, ones, zeros, p, w): ...          # numbers of one-bit messages heard
    def on_message(s, a, m, sender, t_s, d, p, w): ...  # one message was heard
    def on_sample(s, a, x, out, d, p, w): ...         # an own sample: True sends ``out``
    def on_timer(s, a, t_s, out, d, p, w): ...        # optional, due at s.next_s: True sends ``out``
    def decision(s, a, p, w): ...                     # 0, 1; -1 undecided
    def belief(s, a, p, w): ...                       # optional: that the share of ones lies below w.boundary
    def steer(s, a, x, d, p, w): ...                  # optional, after the own sample: turn_deg, drive_ms
    def opposite(m): ...                              # optional: turns a message into its opposite (faults.opposite)

``s`` is the robot's State, ``a`` its arrays, ``m`` and ``out`` Messages, ``p`` the Params, ``w`` a ``World``, ``x`` a
``Reading``; ``u(d, k)`` is the k-th uniform number of this call. ``decision`` is called after each sample and timer.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field
from functools import cache
from types import FunctionType
from typing import Any, Final, Literal, get_type_hints

import numpy as np
from pydantic import BaseModel, create_model

from vibroswarm.core.frozen_model import FrozenModel
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.registry import Registry
from vibroswarm.errors import InputError, shown
from vibroswarm.strategies.static_analysis import STRATEGY_HOOKS, check_function
from vibroswarm.strategies.world import DetailedReading, Reading, World

Hook = Callable[..., Any]

MAX_BYTES: Final = 144
"""Capacity of a message of the robots' radio, bytes."""
NAME: Final = re.compile(r"[a-z][a-z0-9_]*")


class NoParams:
    """Parameters of a strategy that has none."""


class NoArrays:
    """Arrays of a strategy whose state is scalars alone."""


def _ignore_message(s: Any, a: Any, m: Any, sender: int, t_s: float, d: Any, p: Any, w: Any) -> None:
    """Ignore a message: for strategies that do not listen."""


class Bit:
    """A one-bit message."""

    bit: int


@dataclass(frozen=True)
class Plugin(NotebookView):
    """What strategies, networks and tasks have in common.

    Args:
        name: as scenarios call it: lower-case letters, digits and underscores. params: class of annotated fields.
        about: one line.
    """

    name: str
    _: KW_ONLY
    params: type = NoParams
    about: str = ""
    source: str = field(default="", compare=False)
    """Text of its file, if that is not part of this package."""
    code: str = field(default="", compare=False)
    """Name of that file, its name in it, and hash."""

    def __post_init__(self) -> None:
        if not NAME.fullmatch(self.name):
            raise InputError(
                f"{shown(self.name)} is not a valid name; use lower-case letters, digits and underscores",
                field="name",
            )
        object.__setattr__(self, "params", as_params(self.params, self.name))

    @property
    def params_type(self) -> np.dtype[np.void]:
        """Row type of the parameters."""
        return row_type(self.params, "params")

    def params_row(self, values: object) -> tuple[Any, ...]:
        """Return the parameters as a row of ``params_type``."""
        names: tuple[str, ...] = self.params_type.names or ()
        return tuple(getattr(values, name, 0) for name in names)


@dataclass(frozen=True, kw_only=True)
class Strategy(Plugin):
    """A strategy, see the module's docstring.

    Args:
        state, message, arrays: classes of fields. begin to opposite: the functions; without ``opposite``, the opposite
            of a message is that of its ``bit``.
        decides: "once", or "opinion": opinions may change, and the swarm has decided when all have agreed for
            ``decision.hold_s``.
        bytes_on_air: of one message, at most 144.
        revises: decisions may change if ``decision.revise`` is set.
        boundary_half: it works only for a boundary of readings of 1/2.
        told: what its parameters tell a robot of the task, such as "accuracy"; the rest: ``static_analysis.told``.
        knows_error_rates: its robots know their sensor's error rates, whatever ``decision.boundary_of`` is.
        reads_details: ``on_sample`` is given a ``DetailedReading``.
        variant: given the parameters, and sizes (those that arrays may have, and the arena's ``longest_mm``), returns
            the strategy that runs in this one's place: itself, or one with the same parameters and other functions, so
            that what is off costs nothing.
    """

    state: type
    begin: Hook
    on_sample: Hook
    decision: Hook
    message: type = Bit
    belief: Hook | None = None
    arrays: type = NoArrays
    on_counts: Hook | None = None
    on_message: Hook | None = None
    on_timer: Hook | None = None
    steer: Hook | None = None
    opposite: Hook | None = None
    decides: Literal["once", "opinion"] = "once"
    bytes_on_air: int = 1
    revises: bool = False
    boundary_half: bool = False
    told: tuple[str, ...] = ()
    knows_error_rates: bool = False
    reads_details: bool = False
    variant: Callable[[Any, Mapping[str, int]], Strategy] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.bytes_on_air <= MAX_BYTES:
            raise InputError(f"{self.bytes_on_air} is wrong; 0 to {MAX_BYTES}", field="bytes_on_air")
        rows = {
            "s": self.state_type.names,
            "out": self.message_type.names,
            "m": self.message_type.names,
            "p": self.params_type.names,
            "w": World._fields,
            "x": DetailedReading._fields if self.reads_details else Reading._fields,
            "a": tuple(arrays_of(self.arrays)),
        }
        for hook in STRATEGY_HOOKS:
            if getattr(self, hook) is not None:
                check_function(
                    hook, getattr(self, hook), {name: row_fields or () for name, row_fields in rows.items()}
                )
        if self.on_timer is not None and "next_s" not in (rows["s"] or ()):
            raise InputError(
                "has on_timer, but its State has no next_s: float", field=f"strategy '{self.name}'"
            )
        if self.on_counts is None and self.on_message is None:
            object.__setattr__(self, "on_message", _ignore_message)

    @property
    def state_type(self) -> np.dtype[np.void]:
        """Row type of a robot's state."""
        return row_type(self.state, "state")

    @property
    def has_opposite(self) -> bool:
        """Whether its messages have an opposite."""
        return self.opposite is not None or "bit" in (self.message_type.names or ())

    @property
    def message_type(self) -> np.dtype[np.void]:
        """Row type of a message."""
        return row_type(self.message, "message")


@dataclass(frozen=True)
class Array:
    """An array in a robot's state: ``array("float32", "robots*tiles")``."""

    kind: str
    of: str

    def size(self, sizes: Mapping[str, int]) -> int:
        """Return the array's number of elements.

        Args:
            sizes: robots, rows, columns, tiles.
        """
        count = 1
        for factor in self.of.split("*"):
            word = factor.strip()
            if not word.isdigit() and word not in sizes:
                raise InputError(
                    f"{shown(word)} is not a size; a number or one of {', '.join(sizes)}", field="arrays"
                )
            count *= int(word) if word.isdigit() else sizes[word]
        return count


ARRAY_KINDS: Final = ("float64", "float32", "int64", "int32", "int16", "uint8")


def array(kind: str, of: str) -> Array:
    """Declare an array in a robot's state.

    Args:
        kind: of its numbers, one of ``ARRAY_KINDS``. of: its size, a product such as "robots*tiles".
    """
    if kind not in ARRAY_KINDS:
        raise InputError(
            f"{shown(kind)} is not a number type (there are {', '.join(ARRAY_KINDS)})", field="arrays"
        )
    return Array(kind, of)


def arrays_of(declared: type) -> dict[str, Array]:
    """Return the arrays of a class whose attributes, or those of the classes it inherits, are ``array(...)``."""
    found: dict[str, Array] = {}
    for of in reversed(declared.__mro__):
        found |= {name: value for name, value in vars(of).items() if isinstance(value, Array)}
    return found


CLASSES: Final = {"Params": "params", "State": "state", "Message": "message", "Arrays": "arrays"}


def strategy_in(module: str, name: str, **more: Any) -> Strategy:
    """Build the strategy of a module from its classes and functions, named as in this module's docstring.

    Args:
        module: ``__name__``. name, more: as of ``Strategy``.
    Raises:
        InputError: a class or a function that every strategy has is missing.
    """
    space = vars(sys.modules[module])
    parts = {CLASSES[part]: space[part] for part in CLASSES if part in space}
    parts |= {part: space[part] for part in STRATEGY_HOOKS if isinstance(space.get(part), FunctionType)}
    for part, word in (
        ("state", "State"),
        ("begin", "begin"),
        ("on_sample", "on_sample"),
        ("decision", "decision"),
    ):
        if part not in parts:
            raise InputError(f"has no {word}; every strategy has one", field=f"strategy '{name}'")
    return Strategy(name=name, **{**parts, **more})


KINDS: Final[dict[type, Any]] = {int: np.int64, float: np.float64, bool: np.bool_}


def fields_of(declared: type) -> dict[str, type]:
    """Return the fields of an annotated class, by name: int, float or bool.

    Raises:
        InputError: another type.
    """
    hints = get_type_hints(declared)
    if issubclass(declared, BaseModel):
        hints = {name: hint for name, hint in hints.items() if name in declared.model_fields}
    for name, kind in hints.items():
        if kind not in KINDS:
            raise InputError(f"{shown(kind)} is not a field type; use int, float or bool", field=name)
    return hints


@cache
def row_type(declared: type, what: str) -> np.dtype[np.void]:
    """Return the row type of a class's fields, and of its arrays of fixed size.

    Raises:
        InputError: a field of another type than int, float or bool, or with a name that NumPy's rows have.
    """
    try:
        fields = fields_of(declared)
    except (NameError, TypeError) as error:
        raise InputError(f"{shown(declared)} declares no fields: {error}", field=what) from None
    for name in fields:
        if hasattr(np.record, name):  # plain Python would find the row's method in place of the field
            raise InputError(f"'{name}' is a word of NumPy's rows; choose another name", field=what)
    parts: list[Any] = [(name, KINDS[kind]) for name, kind in fields.items()]
    parts += [(name, value.kind, (value.size({}),)) for name, value in arrays_of(declared).items()]
    # NumPy rows need a field: one that is not used if the class declares none.
    return np.dtype(parts or [("unused", np.int64)])


def as_params(declared: type, name: str) -> type[BaseModel]:
    """Turn a class of annotated fields into a frozen, strict model."""
    if issubclass(declared, BaseModel):
        return declared
    hints = get_type_hints(declared, include_extras=True)
    definitions: dict[str, Any] = {
        field: (hint, getattr(declared, field, ...)) for field, hint in hints.items()
    }
    return create_model(
        f"{name.title()}Params", __base__=FrozenModel, __doc__=declared.__doc__, **definitions
    )  # fmt: skip


_registry = Registry[Strategy]("strategy", "strategy.name")
register, forget, names, known, strategy = (
    _registry.register,
    _registry.forget,
    _registry.names,
    _registry.known,
    _registry.get,
)
