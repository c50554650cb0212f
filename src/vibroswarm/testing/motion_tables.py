"""Checks of the tables of every motion source.

A check takes a source, and raises ``AssertionError`` if the source fails. The first line of its docstring states what
must hold; ``vibroswarm check`` prints this line. Tables are described in ``motion.source``.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.numbers import stated
from vibroswarm.motion.motion_tables import SCHEMAS, part_of, wrong_tables
from vibroswarm.motion.source import Motion, Source, join
from vibroswarm.testing.motion_cases import (
    CASES,
    SHORT_CASE,
    Check,
    fitted,
    motion_of,
    same,
    ticks_of,
)
from vibroswarm.testing.runs import require

KINDS: Final = ("drive", "turn", "avoid", "stop")
"""What a robot does; a sample has the time spent in each since the robot's last sample, such as ``drive_s``."""
PIECES: Final = (0.0, 1e-4, 0.013, 0.013, 0.3001, 0.31, 0.77777, 1.0)
"""Shares of a run to which it is advanced: pieces of no length, of a tick or less, and of nearly half a run."""
ORDER: Final = {
    "samples": ["run", "time_s", "robot"],
    "segments": ["run", "start_s", "robot"],
    "moves": ["run", "start_s", "robot"],
    "ends": ["run", "robot"],
}
"""Columns by which each table is sorted."""


def check_schema(source: Source) -> None:
    """Tables have the right columns and types, none is empty, and those not requested are left out."""
    for case in fitted(CASES[:3], source):  # three cases are enough: columns and types are the same in all
        motion = motion_of(source, case)
        problems = list(wrong_tables(motion))
        require(not problems, f"{case.name}: {problems[:1]}")
        for name in SCHEMAS:
            frame = getattr(motion, name)
            require(frame is None or frame.height > 0, f"{case.name}: the table {name} is empty")
        plain = source.batch(case.scenario, case.seed, case.runs)
        same(plain, Motion(motion.samples, motion.ends), f"{case.name}: without segments and moves")


def check_order(source: Source) -> None:
    """Tables are sorted by run, time and robot, ends by run and robot; samples are numbered from 0.

    There is at most one row of a robot at a time.
    """
    for case in fitted(CASES, source):
        motion = motion_of(source, case)
        for name, by in ORDER.items():
            frame = getattr(motion, name)
            if frame is not None:
                keys = frame.select(by)
                is_sorted = keys.equals(keys.unique().sort(by))
                require(is_sorted, f"{case.name}: the {name} are not sorted by {', '.join(by)}")
        expected = pl.int_range(pl.len(), dtype=pl.UInt32).over("run", "robot")
        numbered = motion.samples.select((pl.col("sample") == expected).all()).item()
        require(numbered, f"{case.name}: a sample number is missing or repeated")


def check_accounts_add_up(source: Source) -> None:
    """drive_s + turn_s + avoid_s + stop_s is the time since the robot's last sample or, for the first, since the start.

    A stop begins after the robot's last sample, and not after its own.
    """
    for case in fitted(CASES, source):
        before = pl.col("time_s").shift(1).over("run", "robot").fill_null(0.0)
        samples = motion_of(source, case).samples.with_columns(passed_s=pl.col("time_s") - before)
        spent = sum(ticks_of(samples[f"{kind}_s"], case.scenario) for kind in KINDS)
        is_spent = np.array_equal(spent, ticks_of(samples["passed_s"], case.scenario))
        require(is_spent, f"{case.name}: the times do not add up to that since the last sample")
        stops = samples.select(pl.col("stop_start_s").is_between(before, pl.col("time_s")).all()).item()
        require(stops, f"{case.name}: a stop begins before the robot's last sample, or after its own")


def check_places(source: Source) -> None:
    """Robots are in the arena at samples and at the end; headings of samples are from -pi to pi."""
    for case in fitted(CASES, source):
        arena, motion = case.scenario.arena, motion_of(source, case)
        inside = pl.col("x_m").is_between(0.0, arena.width_m) & pl.col("y_m").is_between(0.0, arena.height_m)
        for places in (motion.samples, motion.ends):
            require(places.select(inside.all()).item(), f"{case.name}: a robot is not in the arena")
        is_wrapped = (motion.samples["heading_rad"].abs() <= math.pi + 1e-12).all()
        require(is_wrapped, f"{case.name}: a heading is not from -pi to pi")


def check_whole_runs(source: Source) -> None:
    """Each robot of each run has one end, at the scenario's end, and samples only before it."""
    for case in fitted(CASES, source):
        s, motion = case.scenario, motion_of(source, case)
        expected = [(run, robot) for run in case.runs for robot in range(s.swarm.robots)]
        own = motion.ends.select("run", "robot").rows()
        require(own == expected, f"{case.name}: the ends are not those of each robot of each run")
        at_end = (ticks_of(motion.ends["end_s"], s) == s.ticks).all()
        require(at_end, f"{case.name}: a run does not end at {stated(s.ticks * s.tick_s)} s")
        late = ticks_of(motion.samples["time_s"], s) >= s.ticks
        require(not late.any(), f"{case.name}: a sample is taken at or after the end")
        strange = set(motion.samples.select("run", "robot").unique().rows()) - set(own)
        require(not strange, f"{case.name}: a sample is of an unknown run or robot")


def check_pieces(source: Source) -> None:
    """A run that is advanced in unequal pieces is equal to the same run of a batch.

    After each piece the state is at the first tick at or after the time requested.
    """
    for case in fitted(CASES, source):
        s = case.scenario
        for run in case.runs:
            label = f"{case.name}, run {run}, in pieces and in one"
            state, parts = source.init(s, case.seed, run, segments=True, moves=True), []
            for share in PIECES:
                until_s = share * s.run.t_end_s
                parts.append(state.advance(until_s))
                reached = until_s - 1e-9 <= state.time_s < until_s + s.tick_s
                require(reached, f"{label}: advance({stated(until_s)}) leads to {stated(state.time_s)} s")
            same(join(parts), part_of(motion_of(source, case), run), label)


def check_copies(source: Source) -> None:
    """A copy of a state and the state itself continue in the same way, and do not affect each other."""
    case = SHORT_CASE
    s, run = case.scenario, case.runs[0]
    uninterrupted = part_of(motion_of(source, case), run)
    state = source.init(s, case.seed, run, segments=True, moves=True)
    first, branch = state.advance(0.4 * s.run.t_end_s), state.copy()
    same(join([first, branch.advance(s.run.t_end_s)]), uninterrupted, "a copy")
    same(join([first, state.advance(s.run.t_end_s)]), uninterrupted, "a state that was copied")


def check_runs_are_their_own(source: Source) -> None:
    """A run is the same again, alone, in a batch, and in whatever order."""
    s = CASES[0].scenario
    alone = source.batch(s, 4, [7], segments=True)
    for runs in ([7], [2, 7], [7, 0, 9]):
        same(part_of(source.batch(s, 4, runs, segments=True), 7), alone, f"run 7 alone and among {runs}")


def check_runs_differ(source: Source) -> None:
    """Other runs and other seeds are different.

    A failure is only a warning: a source that replays a recording gives the same motion in every run.
    """
    first, *others = (
        source.batch(CASES[0].scenario, seed, [run]).samples.drop("run")
        for seed, run in ((4, 7), (4, 2), (5, 7))
    )
    require(not any(first.equals(other) for other in others), "another run, or another seed, is alike")


FOREIGN: Final[dict[str, Any]] = {
    "floor.source": "diagonal:0.46",
    "sensor.rms_threshold": 1.55,
    "sensor.still_shape": 3.0,
    "strategy.name": "soft",
    "strategy.soft.eta": 10.0,
    "strategy.soft.kappa": 0.5,
    "decision.decision_boundary": 0.4,
    "decision.credible_threshold": 0.6,
    "decision.min_observations": 3,
    "decision.gate": "own",
    "decision.gate_counts_current": True,
    "decision.revise": True,
    "decision.prior_alpha": 9,
    "network.name": "loss",
    "network.loss.share": 0.4,
    "run.stop": "all_decided",
}
"""Fields of floor, sensor, strategy, decision and network, and ``run.stop``, a rule about decisions; each with a value
that is not its default. Motion must not depend on them."""


def check_nothing_foreign_matters(source: Source) -> None:
    """Motion depends on no field of floor, sensor, strategy, decision or network.

    Nor does it depend on ``run.stop``, which only says by the decisions when a run ends. Each field of ``FOREIGN`` is
    changed by itself, and the motion must stay the same.
    """
    s = CASES[0].scenario
    base = source.batch(s, 4, [1], segments=True)
    for name, value in FOREIGN.items():
        same(
            source.batch(s.with_values({name: value}), 4, [1], segments=True),
            base,
            f"motion depends on {name}",
        )


TABLE_CHECKS: Final[tuple[Check, ...]] = (
    check_schema,
    check_order,
    check_accounts_add_up,
    check_places,
    check_whole_runs,
    check_pieces,
    check_copies,
    check_runs_are_their_own,
    check_runs_differ,
    check_nothing_foreign_matters,
)
"""Checks of all sources."""
