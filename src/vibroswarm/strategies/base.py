"""The protocol of strategies: what a robot remembers, and what it does at a message, a sample or a timer.

A strategy is one file: a few classes that declare fields, a few plain functions (hooks), and one ``Strategy`` that
names them. A row is one record of a structured array, whose fields are read and written as attributes. The hooks change
rows in place and are compiled by Numba. They allocate nothing, and draw random numbers by ``u`` only.

    class Params:                          # [strategy.NAME] of a scenario, one field per line, with bounds
        patience: Annotated[int, Field(ge=1)] = 3
    class State:                           # what a robot remembers: int, float, bool
        opinion: int
    class Message:                         # what it sends; if omitted: one ``bit``
        bit: int

    def begin(s, a, d, p, w): ...                     # fills in the state at time 0; all fields are 0 before
    def on_counts(s, ones, zeros, p, w): ...          # takes numbers of one-bit messages heard
    def on_message(s, a, m, sender, t_s, d, p, w): ...  # takes one message heard
    def on_sample(s, a, x, out, d, p, w): ...         # takes an own sample; returns True to send ``out``
    def on_timer(s, a, t_s, out, d, p, w): ...        # optional, called at s.next_s; returns True to send ``out``
    def decision(s, a, p, w): ...                     # returns 0 or 1 (or another kind); -1 while undecided
    def belief(s, a, p, w): ...                       # optional: P(share of ones < w.boundary)
    def steer(s, a, x, d, p, w): ...                  # optional, after the own sample: returns turn_deg, drive_ms
    def opposite(m): ...                              # optional: turns a message into its opposite (faults.opposite)

``s`` is the robot's State, ``a`` its arrays, ``m`` a Message heard, ``out`` the Message to fill in, ``p`` the Params,
``w`` a ``World``, ``x`` a ``Reading``, ``d`` the address of random numbers: ``u(d, k)`` is the k-th uniform number of
this call. ``t_s`` is the time in s. ``decision`` is called after each sample and timer. ``steer`` returns nan for what
it leaves to the walk (``robot.walk.steered``).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field
from difflib import get_close_matches
from functools import cache
from types import FunctionType
from typing import Annotated, Any, Final, Literal, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, create_model

from vibroswarm.core.frozen_model import FrozenModel
from vibroswarm.core.registry import Registry
from vibroswarm.errors import InputError
from vibroswarm.strategies.static_analysis import STRATEGY_HOOKS, UNUSED, check_function, is_shipped
from vibroswarm.strategies.world import Reading, World

Hook = Callable[..., Any]
"""A function of a strategy that the simulator calls."""


class Nothing:
    """No fields, and no arrays."""


def _ignore_message(s: Any, a: Any, m: Any, sender: int, t_s: float, d: Any, p: Any, w: Any) -> None:
    """Ignore a message: for strategies that do not listen."""


class Bit:
    """A one-bit message."""

    bit: int


@dataclass(frozen=True)
class Plugin:
    """What strategies, networks and tasks have in common.

    Args:
        name: as in scenarios: lower-case letters, digits and underscores. params: class of annotated fields; replaced
            by the Pydantic model made of it. about: description in one line.
    """

    name: str
    _: KW_ONLY
    params: type = Nothing
    about: str = ""
    source: str = field(default="", compare=False)
    """Text of its file, if that is not part of this package; else empty."""
    code: str = field(default="", compare=False)
    """Reference to that file: ``voter.py:voter sha256:...`` (``scenario.plugins``); empty without such a file."""

    def __post_init__(self) -> None:
        """Replace the class of parameters by a Pydantic model with the same fields."""
        # The dataclass is frozen, so the attribute is set past its own __setattr__.
        object.__setattr__(self, "params", as_params(self.params, self.name))

    @property
    def is_own(self) -> bool:
        """Whether a user's file or program, or an installed package, has any of its functions."""
        functions = (one for one in vars(self).values() if isinstance(one, FunctionType))
        return bool(self.code) or not is_shipped(*functions)

    @property
    def params_type(self) -> np.dtype[np.void]:
        """Row type of the parameters."""
        return row_type(self.params, "params")

    def params_row(self, values: object) -> tuple[Any, ...]:
        """Return the parameters in the order of ``params_type``; 0 for the field ``unused``."""
        names: tuple[str, ...] = self.params_type.names or ()
        return tuple(getattr(values, name, 0) for name in names)


@dataclass(frozen=True)
class Report:
    """A value, or an array of values, that robots report.

    Args:
        name: of a field or array of ``State``, or of an array of ``Arrays``. unit: of its values, such as "s".
        estimates: whether it estimates the number that the task asks for. Studies then have its error, as they have of
            the field ``estimate``.
    """

    name: str
    unit: str = ""
    estimates: bool = False


@dataclass(frozen=True, kw_only=True)
class Strategy(Plugin):
    """A strategy: its classes of fields and its hooks, as the module's docstring describes them.

    Args:
        state, message, arrays: classes of fields. begin to opposite: the hooks; without ``opposite``, the opposite of a
            message has the other ``bit``, or the next ``kind`` of tile (kind 0 after the last).
        decides: "once", or "opinion": opinions may change, and the swarm has decided when all robots have agreed for
            ``decision.hold_s``.
        bytes_on_air: size of one message, at most 144.
        revises: whether decisions may change if ``decision.revise`` is set.
        boundary_half: whether the strategy works only if the boundary of readings (``World.boundary``) is 1/2; if
            omitted, as ``answers_kinds``, since the most common kind is compared with no boundary.
        reports: what robots report beside ``shares``, a ``Report`` or its name each: fields and arrays of ``State``,
            whose values results have after each sample, and of ``Arrays``, which they have at the end of a run (table
            ``reports``). Fields
            ``estimate`` and ``estimate_spread`` of ``State`` (nan: none yet) are also the robot's estimate of the fill
            ratio, with its standard deviation, in the table of robots.
        shares: optional, an array of ``Arrays`` with a number for each kind of tile: counts of readings, or as many as
            stand for what a robot knows. The robot's estimate is then that of the kind that the task asks for (``kind``
            of its parameters; else 1) by the Dirichlet distribution of these counts.
        many_readings: whether readings may be of more than two classes.
        answers_kinds: whether it decides among as many answers as there are kinds of tile, 0 to kinds - 1, such as
            which is most common, instead of 0 or 1. Its readings may be of many classes too.
        knows_error_rates: whether robots know their sensor's error rates, whatever ``decision.boundary_of`` is.
        check: a function of the parameters and ``decision.decision_boundary``, called when a scenario is made. It
            raises an ``InputError`` if robots cannot be asked that.
    """

    state: type
    begin: Hook
    on_sample: Hook
    decision: Hook
    message: type = Bit
    belief: Hook | None = None
    arrays: type = Nothing
    on_counts: Hook | None = None
    on_message: Hook | None = None
    on_timer: Hook | None = None
    steer: Hook | None = None
    opposite: Hook | None = None
    decides: Literal["once", "opinion"] = "once"
    bytes_on_air: int = 1
    revises: bool = False
    boundary_half: bool | None = None
    reports: tuple[Report | str, ...] = ()
    shares: str = ""
    many_readings: bool = False
    answers_kinds: bool = False
    knows_error_rates: bool = False
    check: Callable[[Any, float], None] | None = None

    def __post_init__(self) -> None:
        """Check the hooks, and replace the class of parameters (``Plugin``)."""
        params = self.params  # as given: the model that replaces it is made by this package
        super().__post_init__()
        if not is_shipped(
            params, self.state, self.message, *(getattr(self, hook) for hook in STRATEGY_HOOKS)
        ):
            self.check_hooks()
        # The dataclass is frozen, so attributes are set past its own __setattr__.
        if self.on_counts is None and self.on_message is None:
            object.__setattr__(self, "on_message", _ignore_message)
        object.__setattr__(self, "many_readings", self.many_readings or self.answers_kinds)
        if self.boundary_half is None:
            object.__setattr__(self, "boundary_half", self.answers_kinds)

    def check_hooks(self) -> None:
        """Check the hooks, and the classes of fields that they use."""
        # Fields that a hook may use of each of its arguments, so that a misspelt field is found before compiling.
        message = self.message_type.names or ()
        rows = {
            "s": self.state_type.names or (),
            "out": message,
            "m": message,
            "p": self.params_type.names or (),
            "w": World._fields,
            "x": Reading._fields,
            "a": tuple(arrays_of(self.arrays)),
        }
        for hook in STRATEGY_HOOKS:
            if getattr(self, hook) is not None:
                check_function(hook, getattr(self, hook), rows)
        if self.on_counts is not None and self.on_message is not None:  # kernels would call one or the other
            raise InputError(
                "has on_counts and on_message; define one of them", field=f"strategy '{self.name}'"
            )
        # Tables of results have these as whole numbers.
        if any(self.state_type[name] != np.int64 for name in {"alpha", "beta"}.intersection(rows["s"])):
            raise InputError(
                "alpha and beta are counts of bits, of type int", field=f"strategy '{self.name}'"
            )

    @property
    def reported(self) -> dict[str, Report]:
        """What robots report, by name, in alphabetical order."""
        names = (self.shares, *self.reports) if self.shares else self.reports
        declared = [one if isinstance(one, Report) else Report(one) for one in names]
        return {one.name: one for one in sorted(declared, key=lambda one: one.name)}

    @property
    def state_type(self) -> np.dtype[np.void]:
        """Row type of a robot's state."""
        return row_type(self.state, "state")

    @property
    def estimates(self) -> bool:
        """Whether robots have an estimate of a share: their own, or the mean of a posterior of counts."""
        counts = {"alpha", "beta"} <= set(self.state_type.names or ())
        return counts or self.has_own_estimate or bool(self.shares)

    @property
    def has_own_estimate(self) -> bool:
        """Whether robots have an estimate of their own, which comes before that of a posterior."""
        return {"estimate", "estimate_spread"} <= set(self.state_type.names or ())

    @property
    def has_opposite(self) -> bool:
        """Whether its messages have an opposite: by the hook, or because they have a ``bit`` or a ``kind``."""
        return self.opposite is not None or not {"bit", "kind"}.isdisjoint(self.message_type.names or ())

    @property
    def message_type(self) -> np.dtype[np.void]:
        """Row type of a message."""
        return row_type(self.message, "message")


@dataclass(frozen=True)
class Array:
    """An array of a robot, a message or a network, declared as ``array("float32", "robots*tiles")``; see ``array``."""

    kind: str
    of: str

    def size(self, sizes: Mapping[str, int]) -> int:
        """Return the array's number of elements: the product that ``of`` names."""
        factors = (factor.strip() for factor in self.of.split("*"))
        return math.prod(int(factor) if factor.isdecimal() else sizes[factor] for factor in factors)


def array(kind: str, of: str | int) -> Array:
    """Declare an array of a robot (in its class ``Arrays``), a message or a network.

    Args:
        kind: type of its elements: float64, float32, int64, int32, int16 or uint8. of: number of its elements, a whole
            number or a product such as "robots*tiles", in a message a number; arrays have one dimension.
    """
    return Array(kind, str(of))


def arrays_of(declared: type) -> dict[str, Array]:
    """Return the attributes of a class that were declared by ``array(...)``, inherited ones included, by name."""
    classes = reversed(declared.__mro__)  # from the oldest class on, so that a derived one overrides
    attributes = (item for base in classes for item in vars(base).items())
    return {name: value for name, value in attributes if isinstance(value, Array)}


CLASSES: Final = {"Params": "params", "State": "state", "Message": "message", "Arrays": "arrays"}
"""Names of classes in a module, and the arguments of ``Strategy`` that they become."""


def strategy_in(module: str, name: str, **more: Any) -> Strategy:
    """Build a strategy from the classes and hooks in a module, found by the names in this module's docstring.

    Args:
        module: ``__name__`` of the module. name: of the strategy. more: further arguments of ``Strategy``; they
            override what is found in the module.
    Raises:
        InputError: a function has nearly the name of a hook, or ``Strategy`` refuses an argument.
    """
    space = vars(sys.modules[module])
    parts = {CLASSES[part]: space[part] for part in CLASSES if part in space}
    parts |= {part: space[part] for part in STRATEGY_HOOKS if isinstance(space.get(part), FunctionType)}
    lacking = tuple(hook for hook in STRATEGY_HOOKS if hook not in {*parts, *more})
    for word, value in space.items():
        is_helper = word.startswith(("_", *lacking))  # such as a function ``beliefs``
        if isinstance(value, FunctionType) and not is_helper and get_close_matches(word, lacking, 1, 0.9):
            raise InputError(f"has {word}, which is nearly the name of a hook", field=f"strategy '{name}'")
    return Strategy(name=name, **{**parts, **more})


KINDS: Final[dict[type, Any]] = {int: np.int64, float: np.float64, bool: np.bool_}
"""Types of fields, and the types that they have in a row."""


def fields_of(declared: type) -> dict[str, type]:
    """Return the type of each field of an annotated class, by name: int, float or bool."""
    hints = get_type_hints(declared)
    # A model has other annotations too, such as model_config.
    return {name: hints[name] for name in getattr(declared, "model_fields", hints)}


@cache
def row_type(declared: type, what: str) -> np.dtype[np.void]:
    """Return the dtype of a class's fields and arrays of fixed size; with neither, of one field ``unused``."""
    fields = fields_of(declared)
    for name in fields:
        if what != "params" and getattr(declared, name, 0) != 0:
            raise InputError(
                f"{name}: defaults have no effect, all fields are 0 at first; set it in begin", field=what
            )
    parts: list[Any] = [(name, KINDS[kind]) for name, kind in fields.items()]
    # Sizes are empty, so only arrays whose size is a number are allowed here.
    parts += [(name, value.kind, (value.size({}),)) for name, value in arrays_of(declared).items()]
    return np.dtype(parts or [(UNUSED, np.int64)])


class _Parameters(FrozenModel):
    """Base of the models of parameters. Defaults become what the same value becomes where it is given."""

    model_config = ConfigDict(validate_default=True)


def as_params(declared: type, name: str) -> type[BaseModel]:
    """Return the frozen, strict Pydantic model of a class of annotated fields; a model is returned unchanged."""
    if issubclass(declared, BaseModel):
        return declared
    definitions: dict[str, Any] = {
        # TOML and --set give a tuple as a list, which strict models refuse.
        field_name: (_from_list(hint), getattr(declared, field_name))
        for field_name, hint in get_type_hints(declared, include_extras=True).items()
    }
    return create_model(
        f"{name.title()}Params", __base__=_Parameters, __doc__=declared.__doc__, **definitions
    )


def _from_list(hint: Any) -> Any:
    """Return the annotation, of which a tuple may also be given as a list."""
    is_tuple = get_origin(get_args(hint)[0] if get_origin(hint) is Annotated else hint) is tuple
    return Annotated[hint, Field(strict=False)] if is_tuple else hint


_registry = Registry[Strategy]("strategy", "strategy.name")
register, forget, names, known, strategy = (
    _registry.register,
    _registry.forget,
    _registry.names,
    _registry.known,
    _registry.get,
)
