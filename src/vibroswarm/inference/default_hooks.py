"""The functions ("hooks") of a strategy and a network under the names by which kernels import them.

``generated_kernels`` makes a module like this one for each strategy and network, with their compiled functions, and
replaces this module by it in the kernel's source. The functions here serve for hooks that a strategy or network does
not define, and for type checks of the templates. The constants, and ``next_s``, ``reading_of``, ``views``,
``clear_network``, ``bit_of`` and ``is_message``, are in every generated module, so here they serve for types alone.

``strategies.base`` and ``networks.base`` describe the hooks' arguments: s: state of the robot; a: arrays; x: reading;
m: message; out: message to fill; d: random numbers; p: parameters; w: world; n: state of the network; t_s: time.
"""

from __future__ import annotations

import math
from typing import Any, Final

from vibroswarm.inference.replay_arrays import Readings, own_reading
from vibroswarm.strategies.world import Draws, Reading, World

Row = Any
"""A row of a structured array."""

HAS_TIMER: Final = False
"""Whether the strategy has ``on_timer``."""
HAS_STEER: Final = False
"""Whether the strategy has ``steer``."""
IS_OPINION: Final = False
"""Whether ``decision`` returns opinions, which become decisions when all agree for long enough."""
HAS_SEND: Final = False
"""Whether the network has ``send``."""
READS_POSITIONS: Final = False
"""Whether the network's ``send`` reads positions."""


def begin(s: Row, a: Any, d: Draws, p: Row, w: World) -> None:
    """Set the state ``s`` at time 0; it is all zeros before."""


def on_counts(s: Row, ones: int, zeros: int, p: Row, w: World) -> None:
    """Handle ``ones`` and ``zeros``, the numbers of one-bit messages heard since the last own sample."""


def on_message(s: Row, a: Any, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Handle one message."""


def on_sample(s: Row, a: Any, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Handle an own sample; True sends ``out``."""
    return False


def on_timer(s: Row, a: Any, t_s: float, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Handle the timer set to ``s.next_s``; True sends ``out``."""
    return False


def next_s(s: Row) -> float:
    """Return the time at which ``on_timer`` is due, s.

    The generated function returns ``s.next_s``; without ``on_timer`` it returns 0, and is not called.
    """
    return 0.0


def decision(s: Row, a: Any, p: Row, w: World) -> int:
    """Return 0 or 1, or -1 while undecided."""
    return -1


def belief(s: Row, a: Any, p: Row, w: World) -> float:
    """Return the belief that the share of ones lies below the boundary; nan if the strategy keeps none."""
    return math.nan


def steer(s: Row, a: Any, x: Reading, d: Draws, p: Row, w: World) -> tuple[float, float]:
    """Return the turn (deg) and the duration of the leg (ms) after an own sample; nan keeps what was drawn.

    This default is never called: kernels call ``steer`` only if HAS_STEER is true.
    """
    return 0.0, 0.0


def opposite(m: Row) -> None:
    """Change a message into its opposite; this default is never called."""


def opposite_of(m: Row, w: World) -> None:
    """Change the message that a robot with the fault ``opposite`` sends into its opposite, if it has one.

    It is generated: by the hook ``opposite``, or for a ``bit`` or a ``kind``; other messages stay as they are.
    """


def reading_of(readings: Readings, k: int, time_s: float, number: int) -> Any:
    """Return the reading of the sample in row ``k`` as the strategy gets it.

    It is a ``Reading`` or, for a strategy that ``reads_details``, a ``DetailedReading``: the generated module has
    ``own_reading`` or ``detailed_reading`` under this name.

    Args:
        time_s: time of the sample. number: index of the sample among the robot's samples.
    """
    return own_reading(readings, k, time_s, number)


def views(arrays: Any, i: int) -> Any:
    """Return the arrays of the robot in row ``i`` of ``arrays``, a named tuple; without arrays, 0, which no hook reads.

    The generated function lists the arrays by name.
    """
    return i


def clear_network(a: Any) -> None:
    """Set the network's declared arrays in ``a`` to zero, but not parameters that are lists, which ``a`` contains too.

    The generated function lists the arrays by name; for networks without arrays it does nothing.
    """


def bit_of(m: Row) -> int:
    """Return the bit of a message; the generated function returns 0 if the strategy's messages have no ``bit``."""
    return 0


def is_message(m: Row) -> bool:
    """Return whether the bit of a message is 0 or 1, if it has one; others would count as several, or as a part."""
    return True


def lost(sender: int, receiver: int, d: Draws, p: Row, w: World) -> bool:
    """Return whether a message is lost on its way to a receiver."""
    return False


def send(
    n: Row, a: Any, sender: int, tick: int, number: int, bytes_on_air: int, x_m: Any, y_m: Any,
    arrival_tick: Any, d: Draws, p: Row, w: World,
) -> None:  # fmt: skip
    """Write the tick from which each robot can read a message to ``arrival_tick``, (robots,).

    It holds -1 (never) before the call. This default writes nothing; networks without ``send`` have ``lost`` instead.
    """
