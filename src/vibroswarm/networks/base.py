"""The protocol of networks: who hears which message, and when.

A network is one file, as a strategy is: it declares its parameters and has one of two functions.

    def lost(sender, receiver, d, p, w): ...      # True: lost; else it arrives at the next tick
    def send(n, a, sender, tick, number, bytes_on_air, x_m, y_m, arrival_tick, d, p, w): ...
    def check(params, robots): ...                # optional, plain Python: raises an InputError

``lost`` is for networks that lose messages independently: it is called for each message and receiver, in any order.
``send`` is called for each message in the order of tick and sender, and may keep a memory: ``n``, a row of the
network's State, and ``a``, its Arrays, declared by size as those of strategies; both are zero when a run begins. It
fills ``arrival_tick``, one entry per robot: the tick from which the message can be read (later than ``tick``; never:
-1, which all are before the call). ``x_m`` and ``y_m``, one entry per robot, are the positions at ``tick``, if the
function reads them: exact, except that a turning robot is reported where its turn began, some millimetres away at most.
``p`` is the Params, ``w`` a ``World`` whose ``robot`` is the receiver or the sender; ``u(d, k)`` is the k-th uniform
number. A parameter may be a list, declared as ``tuple[int, ...]`` or ``tuple[float, ...]``: it is an array of ``a``,
which ``send`` must not change. ``check`` is called when a scenario is read.
"""

from __future__ import annotations

import dis
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.registry import Registry
from vibroswarm.errors import InputError
from vibroswarm.strategies.base import KINDS, NoArrays, Plugin, arrays_of, row_type
from vibroswarm.strategies.static_analysis import PARAMETERS, check_function
from vibroswarm.strategies.world import World

Hook = Callable[..., Any]


class NoState:
    """State of a network that has none."""


@dataclass(frozen=True, kw_only=True)
class Network(Plugin):
    """A network, see the module's docstring.

    Args:
        state: class of annotated fields. arrays: class of ``array(...)``. lost, send: one of the two functions.
        check: refuses parameters for a number of robots, as ``check(params, robots)``.
    """

    state: type = NoState
    arrays: type = NoArrays
    lost: Hook | None = None
    send: Hook | None = None
    check: Callable[[Any, int], None] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.lost is not None and self.send is not None:
            raise InputError("has both lost and send; give one of them", field=self.name)
        both = sorted(set(self.lists) & set(arrays_of(self.arrays)))
        if both:
            raise InputError(f"'{both[0]}' is a parameter and an array; rename one", field=self.name)
        rows = {
            "n": self.state_type.names,
            "a": (*self.lists, *arrays_of(self.arrays)),
            "p": self.params_type.names,
            "w": World._fields,
        }
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

    @cached_property
    def lists(self) -> dict[str, type]:
        """Parameters that are lists: the type of their numbers, by name."""
        kinds = self._param_kinds.items()
        return {name: get_args(kind)[0] for name, kind in kinds if get_origin(kind) is tuple}

    @property
    def _param_kinds(self) -> dict[str, Any]:
        """Types of the parameters, by name."""
        params: Any = self.params  # a model, see ``Plugin``
        return {name: info.annotation for name, info in params.model_fields.items()}

    @cached_property
    def params_type(self) -> np.dtype[np.void]:
        """Row type of the parameters that are not lists."""
        if not self.lists:
            return super().params_type
        scalars = [(name, KINDS[kind]) for name, kind in self._param_kinds.items() if name not in self.lists]
        return np.dtype(scalars or [("unused", np.int64)])

    def arrays_of(self, params: object, sizes: Mapping[str, int]) -> dict[str, NDArray[Any]]:
        """Return the arrays of ``a``: the lists among the parameters, and zeroed arrays.

        Args:
            params: the parameters. sizes: robots, rows, columns and tiles.
        """
        lists = {name: np.array(getattr(params, name), KINDS[kind]) for name, kind in self.lists.items()}
        declared = arrays_of(self.arrays)
        return lists | {name: np.zeros(item.size(sizes), item.kind) for name, item in declared.items()}


_registry = Registry[Network]("network", "network.name")
register, forget, names, known, network = (
    _registry.register,
    _registry.forget,
    _registry.names,
    _registry.known,
    _registry.get,
)
