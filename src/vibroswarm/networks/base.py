"""What a network is: who hears which message, and when.

A network is one file, as a strategy is: it declares its parameters and has one of two functions.

    def lost(sender, receiver, d, p, w): ...      # True: never; else it is there at the next tick
    def send(n, sender, tick, number, bytes_on_air, x_m, y_m, arrival_tick, d, p, w): ...

``lost`` is for networks in which messages are lost by themselves: it is asked for each message and receiver, in any
order. ``send`` is called for each message in the order of tick and sender, and may remember what went before in ``n``,
a row of the network's State; it fills ``arrival_tick``, one for each robot: the tick from which on the message can be
read (later than ``tick``; never: -1). ``x_m`` and ``y_m`` are to say where the robots are; they are empty so far.
``p`` is the Params, ``w`` a ``World`` whose ``robot`` is the receiver or the sender; ``u(d, k)`` is the k-th number.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vibroswarm.errors import InputError, nearest, shown
from vibroswarm.strategies.base import NAME, NoParams, as_params, row_type
from vibroswarm.strategies.world import World
from vibroswarm.strategies.written import check_function

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


_known: dict[str, Network] = {}


def register(network: Network) -> Network:
    """Make a network known by its name; gives it back.

    Raises:
        InputError: another of that name is known.
    """
    if network.name in _known and _known[network.name] is not network:
        raise InputError(f"there is a network '{network.name}' already", field="name")
    _known[network.name] = network
    return network


def forget(name: str) -> None:
    """Make a network unknown again, if it was known."""
    _known.pop(name, None)


def names() -> tuple[str, ...]:
    """Names of all known networks."""
    return tuple(_known)


def known() -> Mapping[str, Network]:
    """All known networks by name."""
    return _known


def network(name: str) -> Network:
    """The network of that name.

    Raises:
        InputError: there is none; the nearest is named.
    """
    if name not in _known:
        raise InputError(
            f"there is no network {shown(name)}{nearest(name, _known)} (there are {', '.join(_known)})",
            field="network.name",
        )
    return _known[name]
