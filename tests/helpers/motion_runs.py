"""Runs of engines, begun, and the rows that they give."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.motion.motion_tables import MOVE_ROW, SAMPLE_ROW, Sink, joined
from vibroswarm.scenario.scenario import Scenario


class RunRows(NamedTuple):
    """The rows of a run."""

    samples: NDArray[np.void]
    moves: NDArray[np.void]
    ends: NDArray[np.void]


class Taken:
    """The rows of a run, as they are given."""

    def __init__(self) -> None:
        self.samples, self.moves = list[Any](), list[Any]()
        self.sink = Sink(
            lambda rows: self.samples.append(joined([rows])), lambda rows: self.moves.append(joined([rows]))
        )


def begun(
    engine: Callable[..., Any], scenario: Scenario, seed: int, run: int = 0, moves: bool = False
) -> Any:
    """A run of an engine at time 0."""
    state = engine(scenario, moves)
    state.begin(seed, run)
    return state


def rows_of(state: Any, until: int | None = None) -> RunRows:
    """What a state gives up to a tick, or to the end of its scenario."""
    taken = Taken()
    state.advance(state.scenario.ticks if until is None else until, taken.sink)
    return ended(state, taken)


def ended(state: Any, taken: Taken) -> RunRows:
    """All that was taken of a run, and what is left of it."""
    ends = state.finish(taken.sink)
    samples = joined([np.empty(0, dtype=SAMPLE_ROW), *taken.samples])
    return RunRows(samples, joined([np.empty(0, dtype=MOVE_ROW), *taken.moves]), ends)


def poses_at_ticks(
    engine: Callable[..., Any], scenario: Scenario, seed: int, run: int
) -> NDArray[np.float64]:
    """The poses of all robots at each tick of a run, (robots, ticks, 3)."""
    state, taken = begun(engine, scenario, seed, run), Taken()
    found = []
    for tick in range(scenario.ticks):
        state.advance(tick, taken.sink)
        found.append(state.poses())
    return np.stack(found, axis=1)
