"""Motion up to the tick at which the last robot of a run has decided: ``run.stop = "all_decided"``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.floors.floor import Floor
from vibroswarm.forked import check_threads
from vibroswarm.inference.follow import Follower
from vibroswarm.inference.replay import infer
from vibroswarm.motion.contract import Motion, join, source
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.record import Rows, SampleColumns, joined, with_samples
from vibroswarm.observation.ground import grounds_of
from vibroswarm.observation.model import observe
from vibroswarm.scenario import Scenario

PIECE_S: Final = 100.0
"""Motion is advanced in pieces of this length; the last one is done again, up to the decision."""


def until_all_decided(
    scenario: Scenario,
    seed: int,
    runs: Sequence[int],
    floors: Mapping[int, Floor],
    motion: str,
    segments: bool,
    tell: Callable[[float], None] | None = None,
) -> Motion:
    """Runs up to the tick after that at which the last robot has decided, or to their end.

    Args:
        floors: of each run. motion: the source, by name. segments: also wanted. tell: of the share that is done.
    """
    state = source(motion).init(scenario, seed, runs[0], segments)
    if not isinstance(state, KernelRun):
        return join([_by_tables(scenario, seed, run, floors, motion, segments) for run in runs])
    follower = Follower(scenario, seed)
    columns, parts = SampleColumns(state.tick_ms, 0), []
    for done, (run, ground) in enumerate(zip(runs, grounds_of(scenario, seed, runs, floors), strict=True)):
        state.start(seed, run)
        follower.begin(run, ground)
        parts.append(_run(state, follower, scenario.run.t_end_s, columns))
        if tell is not None:
            tell((done + 1) / len(runs))
    return with_samples(columns.frame(), parts, state.tick_ms)


def _run(state: KernelRun, follower: Follower, t_end_s: float, columns: SampleColumns) -> Rows:
    """One run from its start; its samples go into ``columns``."""
    segments: list[NDArray[np.void]] = []
    while True:
        before, new = state.copy(), list[NDArray[np.void]]()

        def keep(rows: NDArray[np.void], new: list[NDArray[np.void]] = new) -> None:
            new.append(joined([rows]))

        def take(rows: NDArray[np.void], keep: Callable[[NDArray[np.void]], None] = keep) -> None:
            keep(rows)
            follower.take(rows)

        rest = state.hand_over(min(state.time_s + PIECE_S, t_end_s), take)
        decided_s = follower.all_decided_s
        if decided_s is not None:
            new.clear()
            rest = before.hand_over(decided_s + follower.tick_s, keep)
        for rows in new:
            columns.take(rows)
        if rest.segments is not None:
            segments.append(rest.segments)
        if decided_s is not None or state.time_s >= t_end_s:
            return rest._replace(segments=joined(segments) if segments else None)


def _by_tables(
    scenario: Scenario, seed: int, run: int, floors: Mapping[int, Floor], motion: str, segments: bool
) -> Motion:
    """One run of a source that only gives tables."""
    state = source(motion).init(scenario, seed, run, segments)
    so_far: list[Motion] = []
    while state.time_s < scenario.run.t_end_s:
        before = state.copy()
        piece = state.advance(min(state.time_s + PIECE_S, scenario.run.t_end_s))
        moved = join([*so_far, piece])
        observations = observe(scenario, seed, moved.samples, floors, energies=False)
        inference, _ = infer(scenario, seed, moved, observations)
        decided_s = _all_decided_s(moved, inference, scenario.swarm.robots)
        if decided_s is not None:
            return join([*so_far, before.advance(decided_s + scenario.tick_s)])
        so_far.append(piece)
    return join(so_far)


def _all_decided_s(motion: Motion, inference: pl.DataFrame, robots: int) -> float | None:
    """When the last robot of a run has decided for the first time, or None."""
    check_threads()
    decided = inference["decision"] != -1
    first = motion.samples.filter(decided).group_by("robot").agg(pl.col("time_s").min())["time_s"]
    return float(first.to_numpy().max()) if first.len() == robots else None
