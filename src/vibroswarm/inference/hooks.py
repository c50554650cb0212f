"""The functions of a strategy and of a network, as the kernels that run them import them.

``generate`` makes a module like this one for each strategy and network, in which these are theirs, compiled, and gives
it to a kernel's source in place of this one. What stands here says the types, and what is done where one is left out.
"""

from __future__ import annotations

import math
from typing import Any, Final

from vibroswarm.strategies.world import Draws, Reading, World

Row = Any
"""A row of a structured array."""

HAS_TIMER: Final = False
HAS_STEER: Final = False
IS_OPINION: Final = False
HAS_SEND: Final = False
ASKS_PLACES: Final = False


def begin(s: Row, a: Any, d: Draws, p: Row, w: World) -> None:
    """The state at time 0; all zeros before."""


def on_counts(s: Row, ones: int, zeros: int, p: Row, w: World) -> None:
    """So many messages of one bit were heard since the last own sample."""


def on_message(s: Row, a: Any, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """One message was heard."""


def on_sample(s: Row, a: Any, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """An own sample; True sends ``out``."""
    return False


def on_timer(s: Row, a: Any, t_s: float, out: Row, d: Draws, p: Row, w: World) -> bool:
    """The time ``s.next_s`` has come; True sends ``out``."""
    return False


def next_s(s: Row) -> float:
    """When ``on_timer`` is due."""
    return 0.0


def decision(s: Row, a: Any, p: Row, w: World) -> int:
    """0, 1; -1 undecided."""
    return -1


def belief(s: Row, a: Any, p: Row, w: World) -> float:
    """That the share of ones lies below the boundary; nan: it has none."""
    return math.nan


def steer(s: Row, a: Any, x: Reading, d: Draws, p: Row, w: World) -> tuple[float, float]:
    """turn_deg and drive_ms after the own sample; nan: as drawn."""
    return 0.0, 0.0


def views(arrays: Any, i: int) -> Any:
    """The arrays of the robot in row ``i``."""
    return i


def bit_of(m: Row) -> int:
    """The bit of a message of one bit."""
    return 0


def lost(sender: int, receiver: int, d: Draws, p: Row, w: World) -> bool:
    """Whether a message never reaches a receiver."""
    return False


def send(
    n: Row, sender: int, tick: int, number: int, bytes_on_air: int, x_m: Any, y_m: Any, arrival_tick: Any, d: Draws,
    p: Row, w: World,
) -> None:  # fmt: skip
    """From which tick on each robot can read a message; never: -1."""
