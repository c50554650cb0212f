"""The protocol of networks: who hears which message, and when.

A network is one file, as a strategy is: it declares its parameters and has one of two functions.

    def lost(sender, receiver, d, p, w): ...      # True: lost; else it arrives at the next tick
    def send(n, a, sender, tick, number, bytes_on_air, x_m, y_m, arrival_tick, d, p, w): ...
    def check(params, robots): ...                # optional, plain Python: raises an InputError

``lost`` is for networks that lose messages independently. It is called for each message and receiver, in any order.

``send`` is called for each message, in the order of tick and sender, so it may have a memory: ``n`` is a row of the
network's State, and ``a`` holds its Arrays, declared by size as those of strategies. Both are zero when a run begins.
``send`` writes to ``arrival_tick``, which has one entry per robot: the tick from which that robot can read the message.
It must be later than ``tick``, the control period in which the message is sent. All entries are -1 (never) before the
call. The sender's own entry is ignored. ``number`` counts the sender's messages from 0; ``bytes_on_air`` is the length
of the message.

``x_m`` and ``y_m``, one entry per robot, are the positions at ``tick``. They are exact, except that a turning robot is
reported where its turn began, at most some millimetres away. A network that does not read them says
``positions=False``, and is faster.

``p`` holds the parameters. ``w`` is a ``World`` whose ``robot`` is the receiver (``lost``) or the sender (``send``).
``u(d, k)`` is the k-th uniform number of the call. A parameter may be a list, declared as ``tuple[int, ...]`` or
``tuple[float, ...]``; it is then an array of ``a``, which ``send`` must not change. ``check`` is called when a scenario
is read, with the parameters and the number of robots.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.registry import Registry
from vibroswarm.errors import InputError
from vibroswarm.strategies.base import KINDS, Nothing, Plugin, arrays_of, row_type
from vibroswarm.strategies.static_analysis import UNUSED, check_function, is_shipped
from vibroswarm.strategies.world import World

Hook = Callable[..., Any]


@dataclass(frozen=True, kw_only=True)
class Network(Plugin):
    """A network, see the module's docstring.

    Args:
        state: class of annotated fields. arrays: class whose attributes are ``array(...)``.
        lost, send: at most one of the two functions; a network without either loses nothing.
        positions: whether ``send`` reads ``x_m`` or ``y_m``.
        check: ``check(params, robots)`` raises an InputError if the parameters do not suit the number of robots.
    """

    state: type = Nothing
    arrays: type = Nothing
    lost: Hook | None = None
    send: Hook | None = None
    positions: bool = True
    check: Callable[[Any, int], None] | None = None

    def __post_init__(self) -> None:
        """Check the name of the network, and its function unless it is of this package (``is_shipped``).

        Raises:
            InputError: the name is invalid, there are both ``lost`` and ``send``, or the function takes a wrong number
                of arguments, uses a field that does not exist, or makes runs that cannot be repeated
                (``check_function``).
        """
        params = self.params  # as given: the model that replaces it is made by this package
        super().__post_init__()
        if is_shipped(params, self.state, self.arrays, self.lost, self.send):
            return
        if self.lost is not None and self.send is not None:
            raise InputError("has both lost and send; give one of them", field=self.name)
        # Names of the fields or arrays of each argument that has any. Parameters that are lists belong to ``a``.
        names_of: dict[str, Any] = {
            "n": self.state_type.names,
            "a": (*self.lists, *arrays_of(self.arrays)),
            "p": self.params_type.names,
            "w": World._fields,
        }
        for hook in ("lost", "send"):
            if getattr(self, hook) is not None:
                # "or ()" is for the type checker: NumPy's ``names`` may be None, but rows always have fields.
                fields = {argument: names or () for argument, names in names_of.items()}
                check_function(hook, getattr(self, hook), fields)

    @property
    def reads_positions(self) -> bool:
        """Whether the robots' positions are computed for each message."""
        return self.send is not None and self.positions

    @property
    def state_type(self) -> np.dtype[np.void]:
        """Row type of the network's state."""
        return row_type(self.state, "state")

    @cached_property
    def lists(self) -> dict[str, type]:
        """Names of the parameters that are lists (declared as ``tuple[TYPE, ...]``), each with its type of elements."""
        return {name: get_args(kind)[0] for name, kind in self._kinds.items() if get_origin(kind) is tuple}

    @property
    def _kinds(self) -> dict[str, Any]:
        params: Any = self.params  # a model, see ``Plugin``
        return {name: info.annotation for name, info in params.model_fields.items()}

    @cached_property
    def params_type(self) -> np.dtype[np.void]:
        """NumPy row type of the parameters that are not lists; if there are none, it has one field that is not used."""
        scalars = [(name, KINDS[kind]) for name, kind in self._kinds.items() if name not in self.lists]
        return np.dtype(scalars or [(UNUSED, np.int64)])

    def arrays_of(self, params: object, sizes: Mapping[str, int]) -> dict[str, NDArray[Any]]:
        """Return new arrays, by name: copies of the parameters that are lists, and the declared arrays, zeroed.

        Args:
            params: values of the parameters. sizes: "robots", "rows", "columns" and "tiles" of the scenario; the
                declared sizes of arrays are formulas of these.
        """
        lists = {name: np.array(getattr(params, name), KINDS[kind]) for name, kind in self.lists.items()}
        declared = arrays_of(self.arrays)  # the function of ``strategies.base``, not this method
        return lists | {name: np.zeros(item.size(sizes), item.kind) for name, item in declared.items()}


_registry = Registry[Network]("network", "network.name")
register, forget, names, known, network = (
    _registry.register,
    _registry.forget,
    _registry.names,
    _registry.known,
    _registry.get,
)
