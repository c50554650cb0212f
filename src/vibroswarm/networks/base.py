"""What a network is: who hears which message, and when.

A network is one file, as a strategy is: it declares its parameters and has one of two functions.

    def lost(sender, receiver, d, p, w): ...      # True: never; else it is there at the next tick
    def send(n, sender, tick, number, bytes_on_air, x_m, y_m, arrival_tick, d, p, w): ...

``lost`` is for networks in which messages are lost by themselves: it is asked for each message and receiver, in any
order. ``send`` is called for each message in the order of tick and sender, and may remember what went before in ``n``,
a row of the network's State; it fills ``arrival_tick``, one for each robot: the tick from which on the message can be
read (later than ``tick``; never: -1). ``x_m`` and ``y_m``, one for each robot, say where they are at ``tick``, if the
function reads them: exactly, but that a robot that turns is told where it began to, some millimetres away at most.
``p`` is the Params, ``w`` a ``World`` whose ``robot`` is the receiver or the sender; ``u(d, k)`` is the k-th number.
"""

from __future__ import annotations

import dis
import inspect
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from vibroswarm.errors import InputError, shown
from vibroswarm.registry import Registry
from vibroswarm.strategies.base import NAME, NoParams, as_params, row_type
from vibroswarm.strategies.world import World
from vibroswarm.strategies.written import PARAMETERS, check_function

Hook = Callable[..., Any]


class NoState:
    """A network that remembers nothing."""


@dataclass(frozen=True)
class Network:
    """A network, see the head of this module.

    Args:
        name: as scenarios call it. params, state: classes of annotated fields. about: one line.
    """

    name: str
    params: type = NoParams
    state: type = NoState
    lost: Hook | None = None
    send: Hook | None = None
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
        if self.lost is not None and self.send is not None:
            raise InputError("has both lost and send; one of them", field=self.name)
        object.__setattr__(self, "params", as_params(self.params, self.name))
        rows = {"n": self.state_type.names, "p": self.params_type.names, "w": World._fields}
        for one in ("lost", "send"):
            if getattr(self, one) is not None:
                check_function(one, getattr(self, one), {name: found or () for name, found in rows.items()})

    @cached_property
    def asks_places(self) -> bool:
        """Whether ``send`` reads where the robots are."""
        if self.send is None:
            return False
        given = list(inspect.signature(self.send).parameters)
        places = {given[PARAMETERS["send"].index(one)] for one in ("x_m", "y_m")}
        return any(
            one.opname.startswith("LOAD_FAST") and one.argval in places
            for one in dis.get_instructions(self.send)
        )

    @property
    def state_type(self) -> np.dtype[np.void]:
        """The row of its state."""
        return row_type(self.state, "state")

    @property
    def params_type(self) -> np.dtype[np.void]:
        """The row of its parameters."""
        return row_type(self.params, "params")

    def params_row(self, values: object) -> tuple[Any, ...]:
        """The parameters as a row of ``params_type``."""
        names: tuple[str, ...] = self.params_type.names or ()
        return tuple(getattr(values, name, 0) for name in names)


_registry = Registry[Network]("network", "network.name")
register, forget, names, known, network = (
    _registry.register,
    _registry.forget,
    _registry.names,
    _registry.known,
    _registry.get,
)
