"""Motion that ends when all have decided (``run.stop = "all_decided"``)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from vibroswarm.floors.floor import Floor
from vibroswarm.inference.closed_loop import ClosedLoop, taken_from
from vibroswarm.motion.contract import Motion, MotionState, join, source
from vibroswarm.observation.ground import grounds_of
from vibroswarm.scenario import Scenario
from vibroswarm.steered import Wanted

PIECE_S: Final = 100.0
"""Motion is advanced in pieces of this length; the last one is done again, up to the decision."""
LIKELY: Final = 0.9
"""Of the shortest run so far: how long the first piece of the next one is. No result depends on it."""


def until_all_decided(
    scenario: Scenario,
    seed: int,
    runs: Sequence[int],
    floors: Mapping[int, Floor],
    motion: str,
    wanted: Wanted,
    progress: Callable[[float], None] | None = None,
) -> Motion:
    """Runs up to the tick after that at which the last robot has decided, or to their end.

    Args:
        floors: of each run. motion: the source, by name. wanted: which tables. progress: told the share that is done.
    """
    loop, found, first_s = ClosedLoop(scenario, seed), list[Motion](), PIECE_S
    shortest_s = scenario.run.t_end_s
    for done, (run, ground) in enumerate(zip(runs, grounds_of(scenario, seed, runs, floors), strict=True)):
        loop.begin(run, ground)
        moved = _run(source(motion).init(scenario, seed, run, *wanted), loop, first_s)
        found.append(moved)
        shortest_s = min(shortest_s, float(moved.ends["end_s"].to_numpy().max()))
        first_s = max(LIKELY * shortest_s, scenario.tick_s)
        if progress is not None:
            progress((done + 1) / len(runs))
    return join(found)


def _run(state: MotionState, loop: ClosedLoop, first_s: float) -> Motion:
    """One run from its start."""
    t_end_s, pieces, length_s = loop.scenario.run.t_end_s, list[Motion](), first_s
    while state.time_s < t_end_s:
        before = state.copy()
        piece = state.advance(min(state.time_s + length_s, t_end_s))
        loop.catch_up(*taken_from(piece, [loop], loop.tick_ms))
        decided_s = loop.first_all_decided_s
        if decided_s is not None:
            return join([*pieces, before.advance(decided_s + loop.scenario.tick_s)])
        pieces.append(piece)
        length_s = PIECE_S
    return join(pieces)
