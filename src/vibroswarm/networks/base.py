"""The protocol of networks: who hears which message, and when.

A network is one file, as a strategy is: it declares its parameters and has one of two functions.

    def lost(sender, receiver, d, p, w): ...      # True: lost; else it arrives at the next tick
    def send(n, sender, tick, number, bytes_on_air, x_m, y_m, arrival_tick, d, p, w): ...

``lost`` is for networks that lose messages independently: it is called for each message and receiver, in any order.
``send`` is called for each message in the order of tick and sender, and may keep a memory in ``n``, a row of the
network's State. It fills ``arrival_tick``, one entry per robot: the tick from which the message can be read (later than
``tick``; never: -1). ``x_m`` and ``y_m``, one entry per robot, are the positions at ``tick``, if the function reads
them: exact, except that a turning robot is reported where its turn began, some millimetres away at most. ``p`` is the
Params, ``w`` a ``World`` whose ``robot`` is the receiver or the sender; ``u(d, k)`` is the k-th uniform number.
"""

from __future__ import annotations

import dis
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from vibroswarm.core.registry import Registry
from vibroswarm.errors import InputError
from vibroswarm.strategies.base import Plugin, row_type
from vibroswarm.strategies.static_checks import PARAMETERS, check_function
from vibroswarm.strategies.world import World

Hook = Callable[..., Any]


class NoState:
    """State of a network that has none."""


@dataclass(frozen=True, kw_only=True)
class Network(Plugin):
    """A network, see the module's docstring.

    Args:
        state: class of annotated fields. lost, send: one of the two functions.
    """

    state: type = NoState
    lost: Hook | None = None
    send: Hook | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.lost is not None and self.send is not None:
            raise InputError("has both lost and send; give one of them", field=self.name)
        rows = {"n": self.state_type.names, "p": self.params_type.names, "w": World._fields}
        for hook in ("lost", "send"):
            if getattr(self, hook) is not None:
                check_function(
                    hook, getattr(self, hook), {name: row_fields or () for name, row_fields in rows.items()}
                )

    @cached_property
    def reads_positions(self) -> bool:
        """Whether ``send`` reads the robots' positions."""
        if self.send is None:
            return False
        parameters = list(inspect.signature(self.send).parameters)
        places = {parameters[PARAMETERS["send"].index(name)] for name in ("x_m", "y_m")}
        return any(
            instruction.opname.startswith("LOAD_FAST") and instruction.argval in places
            for instruction in dis.get_instructions(self.send)
        )

    @property
    def state_type(self) -> np.dtype[np.void]:
        """Row type of its state."""
        return row_type(self.state, "state")


_registry = Registry[Network]("network", "network.name")
register, forget, names, known, network = (
    _registry.register,
    _registry.forget,
    _registry.names,
    _registry.known,
    _registry.get,
)
