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
from vibroswarm.scenario.scenario import Scenario
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


def check_schema(source: Source) -> None:
    """Tables have the right columns and types, and nulls only where a null has a meaning.

    ``stop_start_s`` of an end is null if the robot walks, ``ray_m`` of a move if no avoidance begins with the move.
    Floating-point columns are in the range of their name. No table is empty. Segments and moves are given only if they
    are requested.
    """
    for case in fitted(CASES[:3], source):  # three cases are enough: columns and types are the same in all
        motion = motion_of(source, case)
        for problem in wrong_tables(motion):
            raise AssertionError(f"{case.name}: {problem}")
        for name in SCHEMAS:
            frame = getattr(motion, name)
            require(frame is None or frame.height > 0, f"{case.name}: the table {name} is empty")
        plain = source.batch(case.scenario, case.seed, case.runs[:1])
        for name in ("segments", "moves"):
            require(getattr(plain, name) is None, f"{case.name}: {name} are given although not requested")


def check_order(source: Source) -> None:
    """Tables are sorted by run, time and robot, and have at most one row of a robot at a time.

    Ends are sorted by run and robot.
    """
    for case in fitted(CASES, source):
        motion = motion_of(source, case)
        for name, by in (
            ("samples", ["run", "time_s", "robot"]),
            ("segments", ["run", "start_s", "robot"]),
            ("moves", ["run", "start_s", "robot"]),
            ("ends", ["run", "robot"]),
        ):
            frame = getattr(motion, name)
            if frame is None:
                continue
            keys, words = frame.select(by), ", ".join(by)
            require(keys.equals(keys.sort(by)), f"{case.name}: the {name} are not sorted by {words}")
            require(not keys.is_duplicated().any(), f"{case.name}: twice the same {words} in the {name}")


def check_sample_numbers(source: Source) -> None:
    """Samples are numbered 0, 1, 2, ... for each run and robot, in the order of time."""
    for case in fitted(CASES, source):
        samples = motion_of(source, case).samples
        # Rows are in order of time, so the expected number of a sample is the index of its row within its run and
        # robot.
        expected = samples.select(pl.int_range(pl.len(), dtype=pl.UInt32).over("run", "robot")).to_series()
        require(samples["sample"].equals(expected), f"{case.name}: a sample number is missing or repeated")


def check_accounts_add_up(source: Source) -> None:
    """drive_s + turn_s + avoid_s + stop_s is the time since the robot's last sample or, for the first, since the start.

    A stop does not begin after its sample.
    """
    for case in fitted(CASES, source):
        s = case.scenario
        for (run, robot), rows in motion_of(source, case).samples.group_by(
            "run", "robot", maintain_order=True
        ):
            label = f"{case.name}: run {run}, robot {robot}"
            spent = sum(ticks_of(rows[f"{kind}_s"], s) for kind in KINDS)
            passed = np.diff(ticks_of(rows["time_s"], s), prepend=0)
            require(
                np.array_equal(spent, passed),
                f"{label}: the times do not add up to that since the last sample",
            )
            require(
                (rows["stop_start_s"] <= rows["time_s"]).all(), f"{label}: a stop begins after its sample"
            )


def check_places(source: Source) -> None:
    """Robots are in the arena at samples and at the end; headings of samples are from -pi to pi.

    A stop does not begin before the robot's last sample.
    """
    for case in fitted(CASES, source):
        arena, motion = case.scenario.arena, motion_of(source, case)
        inside = pl.col("x_m").is_between(0.0, arena.width_m) & pl.col("y_m").is_between(0.0, arena.height_m)
        for places in (motion.samples, motion.ends):
            require(places.select(inside.all()).item(), f"{case.name}: a robot is not in the arena")
        is_wrapped = (motion.samples["heading_rad"].abs() <= math.pi + 1e-12).all()
        require(is_wrapped, f"{case.name}: a heading is not from -pi to pi")
        before = pl.col("time_s").shift(1).over("run", "robot").fill_null(0.0)
        is_after = motion.samples.select((pl.col("stop_start_s") >= before).all()).item()
        require(is_after, f"{case.name}: a stop begins before the robot's last sample")


def check_whole_runs(source: Source) -> None:
    """Each robot has one end, at the scenario's end; samples are taken before it; robots are numbered from 0.

    All samples are of runs that were requested.
    """
    for case in fitted(CASES, source):
        s, motion = case.scenario, motion_of(source, case)
        for run in case.runs:
            ends = motion.ends.filter(pl.col("run") == run)
            numbered = ends["robot"].to_list() == list(range(s.swarm.robots))
            require(
                numbered, f"{case.name}: the ends do not have one row for each of {s.swarm.robots} robots"
            )
            at_end = (ticks_of(ends["end_s"], s) == s.ticks).all()
            require(at_end, f"{case.name}: a run does not end at {stated(s.ticks * s.tick_s)} s")
        late = ticks_of(motion.samples["time_s"], s) >= s.ticks
        require(not late.any(), f"{case.name}: a sample is taken at or after the end")
        require(
            (motion.samples["robot"] < s.swarm.robots).all(), f"{case.name}: a sample is of an unknown robot"
        )
        require(
            motion.samples["run"].is_in(case.runs).all(),
            f"{case.name}: a sample is of a run that was not requested",
        )


def pieces(end_s: float) -> list[float]:
    """Return times in s, up to ``end_s``, to advance a run to, in unequal pieces; most are between two ticks."""
    # Pieces of no length (the first time is 0, and one is repeated), of a tick or less, and of nearly half a run.
    shares = (0.0, 1e-4, 0.013, 0.013, 0.3001, 0.31, 0.77777, 1.0)
    return [share * end_s for share in shares]


def check_pieces(source: Source) -> None:
    """A run that is advanced in unequal pieces is equal to the same run of a batch.

    After each piece the state is at the first tick at or after the time requested, and its ends are of that time.
    """
    for case in fitted(CASES, source):
        s = case.scenario
        for run in case.runs:
            label = f"{case.name}, run {run}, in pieces and in one"
            state = source.init(s, case.seed, run, segments=True, moves=True)
            require(state.time_s == 0.0, f"{label}: a run begins at {stated(state.time_s)} s, not at 0")
            parts = []
            for until_s in pieces(s.run.t_end_s):
                parts.append(state.advance(until_s))
                now_s = state.time_s
                reached = until_s - 1e-9 <= now_s < until_s + s.tick_s
                require(reached, f"{label}: after advance({stated(until_s)}) it is at {stated(now_s)} s")
                off_s: Any = (parts[-1].ends["end_s"] - now_s).abs().max()
                require(
                    off_s < 1e-9,
                    f"{label}: after advance({stated(until_s)}) the ends are not of {stated(now_s)} s",
                )
            same(join(parts), part_of(motion_of(source, case), run), label)


def check_copies(source: Source) -> None:
    """Copies continue in the same way, in any order, and do not affect each other.

    A state is advanced to 40 % of the run and copied twice; all three must continue as the uninterrupted run does.
    """
    case = SHORT_CASE
    s, run = case.scenario, case.runs[0]
    uninterrupted = part_of(motion_of(source, case), run)
    state = source.init(s, case.seed, run, segments=True, moves=True)
    first = state.advance(0.4 * s.run.t_end_s)
    # Three states go on to the end: ``branch``, a copy that goes on before the state itself does; then the state; then
    # ``third``, a copy of the state that was made after ``branch`` had gone on.
    branch = state.copy()
    second_branch = [branch.advance(0.5 * s.run.t_end_s), branch.advance(s.run.t_end_s)]
    require(state.time_s < 0.5 * s.run.t_end_s, "a state has moved on because its copy has")
    third = state.copy()
    same(join([first, state.advance(s.run.t_end_s)]), uninterrupted, "a state that was copied")
    same(join([first, *second_branch]), uninterrupted, "a copy")
    same(
        join([first, third.advance(s.run.t_end_s)]), uninterrupted, "a copy of a state that has gone on since"
    )


def check_beginnings(source: Source) -> None:
    """A run that ends earlier is the beginning of one that ends later.

    ``run.t_end_s`` says only when a run ends: a shorter run is equal to a longer one that is advanced to its end.
    """
    s, seed, run = SHORT_CASE.scenario, SHORT_CASE.seed, SHORT_CASE.runs[0]
    end_s = s.run.t_end_s / 2
    shorter = source.batch(s.with_values({"run.t_end_s": end_s}), seed, [run], segments=True, moves=True)
    longer = source.init(s, seed, run, segments=True, moves=True).advance(end_s)
    same(
        longer,
        shorter,
        f"a run of {stated(s.run.t_end_s)} s up to {stated(end_s)} s, and one that ends there",
    )


SHORT_S: Final = 40.0
"""Length of the runs of checks that simulate many."""


def _short() -> Scenario:
    """Return a scenario for checks that simulate many runs."""
    return CASES[0].scenario.with_values({"run.t_end_s": SHORT_S})


def check_runs_are_their_own(source: Source) -> None:
    """A run is the same again, alone, in a batch, and in whatever order.

    Run 7 of seed 4 (an arbitrary choice) is simulated alone twice, and in batches of different order. Moves are not
    compared.
    """
    s = _short()
    alone = source.batch(s, 4, [7], segments=True)
    for runs in ([7, 2], [2, 7], [0, 1, 2, 7, 9]):
        batch = source.batch(s, 4, runs, segments=True)
        require(sorted(batch.ends["run"].unique()) == sorted(runs), f"a batch of runs {runs} has others")
        same(part_of(batch, 7), alone, f"run 7 alone and among {runs}")
    same(source.batch(s, 4, [7], segments=True), alone, "run 7 once more")


def check_runs_differ(source: Source) -> None:
    """Other runs and other seeds are different.

    A failure is only a warning: a source that replays a recording gives the same motion in every run.
    """
    s = _short()
    run_seven, run_two = (source.batch(s, 4, [run], segments=True).samples.drop("run") for run in (7, 2))
    require(not run_seven.equals(run_two), "runs 7 and 2 of a seed are alike")
    require(
        not source.batch(s, 5, [7], segments=True).samples.drop("run").equals(run_seven),
        "a run is alike with seeds 4 and 5",
    )


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
    s = _short()
    base = source.batch(s, 4, [1], segments=True)
    for name, value in FOREIGN.items():
        same(
            source.batch(s.with_values({name: value}), 4, [1], segments=True),
            base,
            f"motion depends on {name}",
        )


def check_segments_and_moves_are_only_written_down(source: Source) -> None:
    """Whether segments and moves are requested changes nothing else.

    Each of the four combinations must give the same tables, those not requested left out.
    """
    case, run = SHORT_CASE, SHORT_CASE.runs[0]
    both = part_of(motion_of(source, case), run)
    for segments, moves in ((False, False), (False, True), (True, False)):
        some = source.batch(case.scenario, case.seed, [run], segments=segments, moves=moves)
        expected = Motion(
            both.samples,
            both.ends,
            segments=both.segments if segments else None,
            moves=both.moves if moves else None,
        )
        same(some, expected, f"with {segments=}, {moves=}")


TABLE_CHECKS: Final[tuple[Check, ...]] = (
    check_schema,
    check_order,
    check_sample_numbers,
    check_accounts_add_up,
    check_places,
    check_whole_runs,
    check_pieces,
    check_copies,
    check_beginnings,
    check_runs_are_their_own,
    check_runs_differ,
    check_nothing_foreign_matters,
    check_segments_and_moves_are_only_written_down,
)
"""Checks of all sources."""
