"""Fading: ``places``, whose map fades: the evidence of each tile decays with time, for floors that change.

| name | symbol | unit | equation |
|---|---|---|---|
| memory | T | s | evidence that is T old counts exp(-1) |
| evidence of sender j on tile t | l_jt | - | at each own sample, s seconds after the one before: l_jt exp(-s / T) |

All else is as in ``places``. The decision may change if ``decision.revise`` is set.
A floor that changes contradicts all senders at once: set ``trust_limit`` to 1000 and ``broken_prior`` to 0, unless
robots may fail.

Arguments of the functions that the simulator calls (``base``): ``s`` is the robot's state and ``a`` its arrays, both
changed in place; ``x`` is its reading, ``m`` a message heard, ``out`` the message to fill, ``d`` random numbers, ``p``
the parameters, ``w`` what the robot knows. ``on_sample`` returns whether ``out`` is sent.
"""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from vibroswarm.strategies import places
from vibroswarm.strategies.base import register, strategy_in
from vibroswarm.strategies.bayes import Row, decision
from vibroswarm.strategies.places import Message, belief
from vibroswarm.strategies.places import begin as begin_map
from vibroswarm.strategies.places import on_message as add_heard
from vibroswarm.strategies.places import on_sample as add_own
from vibroswarm.strategies.world import Draws, Reading, World

__all__ = ["Message", "belief", "decision", "fading"]


# Fields of this module come first in the rows: Numba would take a row that begins like one of places for one of places.
class Memory:
    """How long evidence counts."""

    memory_s: Annotated[
        float,
        Field(
            gt=0,
            le=1e9,
            description="Time after which evidence on a tile counts 1/e, s.",
        ),
    ] = 600.0


class Params(places.Params, Memory):
    """Those of ``places``, and how long evidence counts."""


class Clock:
    """Time of the last own sample, s."""

    sampled_s: float


class State(places.State, Clock):
    """That of ``places``, and when the map last faded."""


class Arrays(places.Arrays):
    """Those of ``places``."""


def begin(s: Row, a: Row, d: Draws, p: Row, w: World) -> None:
    """Begin as ``places``."""
    begin_map(s, a, d, p, w)


def on_message(s: Row, a: Row, m: Row, sender: int, t_s: float, d: Draws, p: Row, w: World) -> None:
    """Add another robot's sample to the map."""
    add_heard(s, a, m, sender, t_s, d, p, w)


def on_sample(s: Row, a: Row, x: Reading, out: Row, d: Draws, p: Row, w: World) -> bool:
    """Let the map fade, add an earlier sample to it and send that, and decide, again if decisions may change."""
    kept = math.exp(-(x.t_s - s.sampled_s) / p.memory_s)
    s.sampled_s = x.t_s
    for k in range(w.robots * w.rows * w.columns):
        a.odds[k] *= kept
    before = s.decision
    if w.revise:
        s.decision = -1  # so that places decides again; without a new decision the old one stays
    sends: bool = add_own(s, a, x, out, d, p, w)
    if s.decision == -1:
        s.decision = before
    return sends


fading = register(
    strategy_in(
        __name__,
        "fading",
        bytes_on_air=8,
        knows_error_rates=True,
        revises=True,
        reports=("p", "weight"),
        about="fading: places, whose evidence on each tile decays with time",
    )
)
