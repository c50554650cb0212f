"""Checks of every motion source: of its tables (``motion.source``), and of the poses that follow from its moves.

A check takes a source, runs it in the cases of ``motion_cases``, and raises ``AssertionError`` if it fails. The first
line of its docstring states what must hold; ``vibroswarm check`` prints it.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator
from functools import partial
from itertools import combinations
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl

from vibroswarm.core.arrays import wrapped
from vibroswarm.core.numbers import number, stated
from vibroswarm.motion.motion_tables import Collected, Motion
from vibroswarm.motion.pose import poses_of
from vibroswarm.motion.source import Source, moved, started
from vibroswarm.motion.source import source as source_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.testing.motion_cases import CASES, SHORT_CASE, Check, motion_of, same, ticks_of
from vibroswarm.testing.runs import Finding, require, run_check

KINDS: Final = ("drive", "turn", "avoid", "stop")
"""What a robot does; a sample has the time spent in each since the robot's last sample, such as ``drive_s``."""
NEAR: Final = 1e-6
"""Difference allowed between poses of different tables because of rounding, m or rad."""
SHORT_S: Final = 40.0
"""Length of the runs of checks that simulate many."""


class RobotOfRun(NamedTuple):
    """What a source made of one robot in one run of a case."""

    scenario: Scenario
    label: str
    """Names case, run and robot in messages."""
    samples: pl.DataFrame
    end: dict[str, Any]
    moves: pl.DataFrame
    poses: pl.DataFrame


def robots_of(source: Source) -> Iterator[RobotOfRun]:
    """Yield each robot of each run of all cases; none if the source has no moves."""
    for case in CASES:
        motion = motion_of(source, case)
        if motion.moves is None:
            return
        poses = poses_of(motion.moves, motion.ends, case.scenario.run.control_period_ms)
        for end in motion.ends.iter_rows(named=True):
            of_robot = {"run": end["run"], "robot": end["robot"]}
            tables = (table.filter(**of_robot) for table in (motion.samples, motion.moves, poses))
            samples, moves, own = tables
            label = f"{case.name}: run {end['run']}, robot {end['robot']}"
            yield RobotOfRun(case.scenario, label, samples, end, moves, own)


def check_tables(source: Source) -> None:
    """Tables have finite numbers, are sorted, and have at most one row of a robot at a time."""
    for case in CASES:
        motion = motion_of(source, case)
        for name, by in (
            ("samples", ["run", "time_s", "robot"]),
            ("moves", ["run", "start_s", "robot"]),
            ("ends", ["run", "robot"]),
        ):
            frame = getattr(motion, name)
            if frame is None:
                continue
            require(frame.height > 0, f"{case.name}: the table {name} is empty")
            # a robot that does not stand has no stop, and only avoidances have a ray
            numbers = frame.drop("stop_start_s", "ray_m", "kind", strict=False)
            require(
                bool(np.isfinite(numbers.to_numpy()).all()),
                f"{case.name}: a number in the {name} is not finite",
            )
            keys, words = frame.select(by), ", ".join(by)
            require(keys.equals(keys.sort(by)), f"{case.name}: the {name} are not sorted by {words}")
            require(not keys.is_duplicated().any(), f"{case.name}: twice the same {words} in the {name}")


def check_sample_numbers(source: Source) -> None:
    """Samples are numbered 0, 1, 2, ... for each run and robot, in the order of time."""
    for case in CASES:
        samples = motion_of(source, case).samples
        expected = samples.select(pl.int_range(pl.len(), dtype=pl.UInt32).over("run", "robot")).to_series()
        require(samples["sample"].equals(expected), f"{case.name}: a sample number is missing or repeated")


def check_accounts_add_up(source: Source) -> None:
    """drive_s + turn_s + avoid_s + stop_s is the time since the robot's last sample, or since the start."""
    for case in CASES:
        s = case.scenario
        for (run, robot), rows in motion_of(source, case).samples.group_by("run", "robot"):
            spent = sum(ticks_of(rows[f"{kind}_s"], s) for kind in KINDS)
            passed = np.diff(ticks_of(rows["time_s"], s), prepend=0)
            require(
                np.array_equal(spent, passed), f"{case.name}: run {run}, robot {robot}: times do not add up"
            )


def check_places(source: Source) -> None:
    """Robots are in the arena, headings from -pi to pi, and stops begin between the last sample and this one."""
    for case in CASES:
        arena, motion = case.scenario.arena, motion_of(source, case)
        inside = pl.col("x_m").is_between(0.0, arena.width_m) & pl.col("y_m").is_between(0.0, arena.height_m)
        for places in (motion.samples, motion.ends):
            require(places.select(inside.all()).item(), f"{case.name}: a robot is not in the arena")
        is_wrapped = (motion.samples["heading_rad"].abs() <= math.pi + 1e-12).all()
        require(is_wrapped, f"{case.name}: a heading is not from -pi to pi")
        before = pl.col("time_s").shift(1).over("run", "robot").fill_null(0.0)
        is_within = motion.samples.select(pl.col("stop_start_s").is_between(before, pl.col("time_s")).all())
        require(
            is_within.item(), f"{case.name}: a stop begins before the robot's last sample, or after its own"
        )


def check_whole_runs(source: Source) -> None:
    """Each robot has one end, at the scenario's end; samples are taken before it; robots are numbered from 0."""
    for case in CASES:
        s, motion = case.scenario, motion_of(source, case)
        expected = [(run, robot) for run in case.runs for robot in range(s.swarm.robots)]
        ends = motion.ends
        require(ends.select("run", "robot").rows() == expected, f"{case.name}: not one end for each robot")
        require((ticks_of(ends["end_s"], s) == s.ticks).all(), f"{case.name}: a run ends at another time")
        late = ticks_of(motion.samples["time_s"], s) >= s.ticks
        require(not late.any(), f"{case.name}: a sample is taken at or after the end")
        known = motion.samples.join(ends, on=["run", "robot"], how="semi").height == motion.samples.height
        require(known, f"{case.name}: a sample is of an unknown robot or run")


def check_pieces(source: Source) -> None:
    """A run that is advanced in unequal pieces is equal to the same run of a batch."""
    for case in CASES:
        s, run, rows = case.scenario, case.runs[-1], Collected(case.scenario.run.control_period_ms)
        state = started(source, s, moves=True)
        state.begin(case.seed, run)
        for share in (0.0, 1e-4, 0.013, 0.013, 0.3001, 0.31, 0.77777, 1.0):
            until = int(share * s.ticks)
            state.advance(until, rows.sink)
            require(
                state.tick == until, f"{case.name}: after advance({until}) the state is at tick {state.tick}"
            )
        rows.end(state)
        whole = of_run(motion_of(source, case), run)
        same(rows.motion(), whole, f"{case.name}, run {run}, in pieces and in one")


def of_run(motion: Motion, run: int) -> Motion:
    """Return the rows of one run."""
    moves = None if motion.moves is None else motion.moves.filter(run=run)
    return Motion(motion.samples.filter(run=run), motion.ends.filter(run=run), moves)


def short() -> Scenario:
    """Return a scenario for checks that simulate many runs."""
    return CASES[0].scenario.with_values({"run.t_end_s": SHORT_S})


def check_runs_are_their_own(source: Source) -> None:
    """A run is the same again, alone, in a batch, and in whatever order."""
    alone = moved(source, short(), 4, [7])
    for runs in ([7, 2], [2, 7], [0, 1, 2, 7, 9], [7]):
        same(of_run(moved(source, short(), 4, runs), 7), alone, f"run 7 alone and among {runs}")


def check_runs_differ(source: Source) -> None:
    """Other runs and other seeds are different."""
    seven, two, other = (
        moved(source, short(), seed, [run]).samples.drop("run") for seed, run in ((4, 7), (4, 2), (5, 7))
    )
    require(not seven.equals(two), "runs 7 and 2 of a seed are alike")
    require(not other.equals(seven), "a run is alike with seeds 4 and 5")


FOREIGN: Final[dict[str, Any]] = {
    "floor.source": "diagonal:0.46",
    "sensor.rms_threshold": 1.55,
    "strategy.name": "soft",
    "strategy.soft.eta": 10.0,
    "decision.decision_boundary": 0.4,
    "decision.min_observations": 3,
    "network.name": "loss",
    "run.stop": "all_decided",
}
"""Fields of floor, sensor, strategy, decision and network, and ``run.stop``, a rule about decisions; each with a value
that is not its default. Motion must not depend on them."""


def check_nothing_foreign_matters(source: Source) -> None:
    """Motion depends on no field of floor, sensor, strategy, decision or network."""
    base = moved(source, short(), 4, [1])
    for name, value in FOREIGN.items():
        other = moved(source, short().with_values({name: value}), 4, [1])
        same(other, base, f"motion depends on {name}")


def check_moves_are_only_written_down(source: Source) -> None:
    """Whether moves are requested changes nothing else."""
    case, run = SHORT_CASE, SHORT_CASE.runs[0]
    plain, whole = moved(source, case.scenario, case.seed, [run]), of_run(motion_of(source, case), run)
    same(plain, Motion(whole.samples, whole.ends), "without moves")


def check_moves_lead_to_the_next(source: Source) -> None:
    """The arc of a move ends where the next begins, the last one where the table of ends puts the robot."""
    for one in robots_of(source):
        start = np.append(one.moves["start_s"].to_numpy(), one.end["end_s"])
        x, y, heading, speed, rate, turned = (
            one.moves[name].to_numpy()
            for name in ("x_m", "y_m", "heading_rad", "speed_m_s", "turn_rate_rad_s", "turned_rad")
        )
        half, elapsed = 0.5 * turned, np.diff(start)
        chord = speed * elapsed * np.sinc(half / np.pi)
        ended = np.stack(
            [x + chord * np.cos(heading + half), y + chord * np.sin(heading + half), heading + turned]
        )
        last = [[one.end[name]] for name in ("x_m", "y_m", "heading_rad")]
        off = ended - np.concatenate([np.stack([x, y, heading]), last], axis=1)[:, 1:]
        gap = max(np.abs(off[:2]).max(), np.abs(wrapped(off[2])).max(), np.abs(rate * elapsed - turned).max())
        require(gap < NEAR, f"{one.label} jumps, by {number(gap, digits=2)} m or rad")


def check_moves_account_for_time(source: Source) -> None:
    """The moves between two samples last as long as drive_s, turn_s, avoid_s and stop_s say, from time 0 on."""
    for one in robots_of(source):
        start = one.moves["start_s"][0]
        require(start == 0.0, f"{one.label}: its first move begins at {stated(start)} s")
        ends = ticks_of(one.samples["time_s"], one.scenario)
        for kind in KINDS:
            total = np.concatenate([[0], np.cumsum((one.poses["kind"] == kind).to_numpy())])[ends]
            spent = ticks_of(one.samples[f"{kind}_s"], one.scenario)
            is_equal = (np.diff(total, prepend=0) == spent).all()
            require(is_equal, f"{one.label}: {kind}_s differs from the time in such moves")


def check_poses_at_samples(source: Source) -> None:
    """The moves put a robot where its sample is, and it stands there since the stop began, and not before."""
    for one in robots_of(source):
        expected = one.samples.select("x_m", "y_m", "heading_rad").to_numpy()
        for column in ("time_s", "stop_start_s"):
            tick = ticks_of(one.samples[column], one.scenario)
            off = one.poses.select("x_m", "y_m", "heading_rad").to_numpy()[tick] - expected
            gap = max(np.abs(off[:, :2]).max(initial=0.0), np.abs(wrapped(off[:, 2])).max(initial=0.0))
            require(gap < NEAR, f"{one.label}: a sample is {number(gap, digits=2)} m or rad from its moves")
            require(
                (one.poses["kind"].gather(tick) == "stop").all(), f"{one.label} does not stand at {column}"
            )
        before = one.poses["kind"].gather(ticks_of(one.samples["stop_start_s"], one.scenario) - 1)
        require((before != "stop").all(), f"{one.label} stood before its stop")


def check_ends(source: Source) -> None:
    """The ends say which stop is under way, and that a robot that walks makes none."""
    for one in robots_of(source):
        last = one.moves.tail(1).to_dicts()[0]
        began_s = last["start_s"] if last["kind"] == "stop" else None
        require(
            one.end["stop_start_s"] == began_s,
            f"{one.label}: its last stop began at another time",
        )


def check_bodies(source: Source) -> None:
    """No two bodies that drive or stand overlap, and none leaves the arena, at every control period."""
    for case in CASES:
        s, motion = case.scenario, motion_of(source, case)
        if motion.moves is None:
            return
        radius_m, arena = s.robot.body_radius_m, np.array([s.arena.width_m, s.arena.height_m])
        poses = poses_of(motion.moves, motion.ends, s.run.control_period_ms)
        for (run,), of_all in poses.group_by("run"):
            places = of_all.select("x_m", "y_m").to_numpy().reshape(s.swarm.robots, -1, 2)
            exact = of_all["kind"].is_in(["drive", "stop"]).to_numpy().reshape(s.swarm.robots, -1)
            beyond_m = np.maximum(radius_m - places, places + radius_m - arena)[exact].max()
            require(beyond_m < NEAR, f"{case.name}: a body is {number(beyond_m, digits=2)} m beyond a wall")
            for i, j in combinations(range(s.swarm.robots), 2):
                apart_m = np.hypot(*(places[j] - places[i])[exact[i] & exact[j]].T)
                over_m = (2 * radius_m - apart_m).max(initial=0.0)
                require(
                    over_m < NEAR, f"{case.name}, run {run}: bodies overlap by {number(over_m, digits=2)} m"
                )


MOTION_CHECKS: Final[tuple[Check, ...]] = (
    check_tables,
    check_sample_numbers,
    check_accounts_add_up,
    check_places,
    check_whole_runs,
    check_pieces,
    check_runs_are_their_own,
    check_runs_differ,
    check_nothing_foreign_matters,
    check_moves_are_only_written_down,
    check_moves_lead_to_the_next,
    check_moves_account_for_time,
    check_poses_at_samples,
    check_ends,
    check_bodies,
)
"""Checks of all sources."""
WARNINGS_ONLY: Final = (check_runs_differ,)
"""Checks whose failure is not an error: a recording is the same in every run."""


def check_motion(name: str) -> list[Finding]:
    """Run all checks of a registered motion source, and return their findings in order."""
    source = source_of(name)  # one object for all checks, because ``motion_of`` caches motion by source
    return [
        run_check(words_of(check), partial(check, source), is_warning=check in WARNINGS_ONLY)
        for check in MOTION_CHECKS
    ]


def words_of(check: Check) -> str:
    """Return what a check requires: the first line of its docstring, without its full stop."""
    return (inspect.getdoc(check) or check.__name__).splitlines()[0].rstrip(".")
