"""A run whose samples are read and replayed as they come, by the same functions as whole tables are.

Who follows a run knows when all have decided, and where a strategy wants to steer; it gives what motion to the end,
observation and replay give one after the other, and a test holds it to that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.compiled import entry_for, kernel, read_only, signed, zero_rows
from vibroswarm.inference.replayers import NOWHERE, replayer_of
from vibroswarm.inference.rows import Readings, Rows, Stops
from vibroswarm.inference.timeline import write_heard
from vibroswarm.inference.tracks import NO_TRACKS, move_rows, tracks_of_rows
from vibroswarm.motion.contract import Motion, MotionState
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.record import SAMPLE_ROW
from vibroswarm.observation.ground import Ground, read
from vibroswarm.scenario import Scenario
from vibroswarm.strategies import strategy as strategy_of


class Notes(NamedTuple):
    """A run's samples so far, in the order of time; (room,) each but where it is said."""

    robot: NDArray[np.uint16]
    sample: NDArray[np.uint32]
    time_s: NDArray[np.float64]
    tick: NDArray[np.int64]
    previous: NDArray[np.int32]
    """The robot's row before; -1: none."""
    stop_tick: NDArray[np.int64]
    following: NDArray[np.int32]
    """The robot's next row; -1: none yet."""
    heard: NDArray[np.int32]
    """(room, 3): as of ``Timeline``."""
    observation: NDArray[np.uint8]
    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    heading_rad: NDArray[np.float64]
    latest: NDArray[np.int32]
    """(robots,): the robot's last row; -1: none."""
    own: NDArray[np.int32]
    """(robots,): how many it has taken."""
    first: NDArray[np.int32]
    """(robots,): the robot's first row; -1: none yet."""


def empty_notes(robots: int, room: int) -> Notes:
    """Notes for so many samples."""
    return Notes(
        robot=np.empty(room, dtype=np.uint16),
        sample=np.empty(room, dtype=np.uint32),
        time_s=np.empty(room),
        tick=np.empty(room, dtype=np.int64),
        previous=np.empty(room, dtype=np.int32),
        stop_tick=np.empty(room, dtype=np.int64),
        following=np.empty(room, dtype=np.int32),
        heard=np.empty((room, 3), dtype=np.int32),
        observation=np.empty(room, dtype=np.uint8),
        x_m=np.empty(room),
        y_m=np.empty(room),
        heading_rad=np.empty(room),
        latest=np.empty(robots, dtype=np.int32),
        own=np.empty(robots, dtype=np.int32),
        first=np.empty(robots, dtype=np.int32),
    )


@kernel
def note(
    rows: NDArray[np.void], ground: Ground, notes: Notes, filled: int, seed: int, run: int, tick_ms: int
) -> int:
    """Put down the samples that came next, and what they read; gives how many there are then.

    Args:
        rows: ``motion.record.SAMPLE_ROW``.
    """
    for n in range(rows.size):
        row, k = rows[n], filled
        i, number = signed(row.robot), signed(row.sample)
        _, bit, _, _ = read(ground, row.x_m, row.y_m, seed, run, i, number)
        notes.robot[k], notes.sample[k] = row.robot, row.sample
        notes.tick[k], notes.time_s[k] = row.tick, row.tick * tick_ms / 1000.0
        notes.x_m[k], notes.y_m[k], notes.heading_rad[k] = row.x_m, row.y_m, row.heading_rad
        notes.observation[k], notes.previous[k] = bit, notes.latest[i]
        notes.stop_tick[k], notes.following[k] = row.stop_tick, -1
        if notes.latest[i] >= 0:
            notes.following[notes.latest[i]] = k
        else:
            notes.first[i] = k
        until, last_own, own = row.stop_tick - 2, notes.latest[i], notes.own[i]
        write_heard(notes.heard[k], notes.heard, notes.previous, notes.tick, 0, k, until, last_own, own)
        notes.latest[i] = k
        notes.own[i] += 1
        filled += 1
    return filled


NONE_STANDS: Final = np.empty(0, dtype=np.int64)


def most_samples(scenario: Scenario) -> int:
    """No run has more samples."""
    tick_ms, sample = scenario.run.control_period_ms, scenario.sample
    between = 1 + int(sample.sample_interval_ms // tick_ms) + int(sample.stop_ms // tick_ms)
    return scenario.swarm.robots * (scenario.ticks // between + 2)


class ClosedLoop:
    """Follows runs of a scenario, one after the other."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        robots, room = scenario.swarm.robots, most_samples(scenario)
        self.scenario, self.seed, self.tick_ms = scenario, seed, scenario.run.control_period_ms
        self.strategy = strategy_of(scenario.strategy.name)
        self.notes = empty_notes(robots, room)
        self.ends_s: list[float] = []
        """When its runs were over, for who asks."""
        self.entry: Callable[..., int] | None = None
        self.replayer = replayer_of(scenario, seed, runs=1, longest=room, rows=room)
        notes = Notes(*(read_only(column) for column in self.notes))
        self.readings = Readings(
            notes.observation,
            notes.x_m,
            notes.y_m,
            notes.heading_rad,
            NOWHERE,
        )
        self.bounds, self.runs = np.zeros(2, dtype=np.int64), np.zeros(1, dtype=np.int64)
        self.rows = Rows(
            read_only(self.bounds),
            read_only(self.runs),
            notes.robot,
            notes.sample,
            notes.time_s,
            notes.heard,
            read_only(np.zeros((robots, 3), dtype=np.int32)),
        )
        self.walked_tick, self.known_tick = np.zeros(robots, dtype=np.int64), np.zeros(1, dtype=np.int64)
        self.stops = Stops(
            notes.tick,
            notes.stop_tick,
            notes.following,
            notes.first,
            read_only(self.walked_tick),
            read_only(self.known_tick),
        )

    def begin(self, run: int, ground: Ground) -> None:
        """Go to the start of a run."""
        self.ground, self.runs[0], self.bounds[1] = ground, run, 0
        self.notes.latest[:], self.notes.own[:], self.notes.first[:] = -1, 0, -1
        self.walked_tick[:], self.known_tick[0] = 0, 0
        self.moves, self.tracks = list[NDArray[np.void]](), NO_TRACKS
        self.is_new = True

    @property
    def asks_places(self) -> bool:
        """Whether the network reads where robots are: ``take_moves`` is then called before ``catch_up``."""
        return self.replayer.asks_places

    def take_moves(self, rows: NDArray[np.void]) -> None:
        """Put down moves (``motion.moves.MOVE_ROW``) that ended, or are under way; those are given again."""
        self.moves.append(rows.copy())

    def take(self, rows: NDArray[np.void]) -> None:
        """Put down the samples that came next (``motion.record.SAMPLE_ROW``)."""
        arguments = (
            rows,
            self.ground,
            self.notes,
            int(self.bounds[1]),
            self.seed,
            int(self.runs[0]),
            self.tick_ms,
        )
        if self.entry is None:
            self.entry = entry_for(note, *arguments)
        self.bounds[1] = self.entry(*arguments)

    def catch_up(self, known_tick: int, stop_tick: NDArray[np.int64]) -> None:
        """Let the robots live through what was put down.

        Args:
            known_tick: up to here, this tick not included, motion is known. stop_tick: (robots,): since when each robot
                stands then; -1: it walks.
        """
        if self.replayer.needs_stops:
            self.known_tick[0] = known_tick
            self.walked_tick[:] = np.where(stop_tick >= 0, stop_tick, known_tick) - 1
        if self.asks_places:
            self.tracks = tracks_of_rows(np.concatenate(self.moves), self.walked_tick.size)
        self.replayer.go_on(self.rows, self.readings, self.stops, begins=self.is_new, tracks=self.tracks)
        self.is_new = False

    def go_back_to(self, time_s: float) -> None:
        """The swarm as it was at ``time_s``, the samples taken then included."""
        last = int(self.bounds[1]) - 1
        if not self.replayer.needs_stops and (last < 0 or self.notes.time_s[last] <= time_s):
            return  # nothing was done since
        self.replayer.go_on(
            self.rows, self.readings, self.stops, begins=True, limit_s=time_s, tracks=self.tracks
        )

    @property
    def decision(self) -> NDArray[np.int64]:
        """Of each robot so far, (robots,); -1 undecided."""
        return self.replayer.swarm.agents["decision"]

    @property
    def decision_time_s(self) -> NDArray[np.float64]:
        """When it came to stand, (robots,); not a number where undecided."""
        return self.replayer.swarm.agents["decided_s"]

    @property
    def all_decided_s(self) -> float | None:
        """When the last robot's decision came to stand, s; None while there are undecided ones."""
        agents = self.replayer.swarm.agents
        if (agents["decision"] == -1).any():
            return None
        return float(agents["decided_s"].max())

    @property
    def first_all_decided_s(self) -> float | None:
        """When for the first time no robot was undecided, s; None while there are undecided ones."""
        if self.all_decided_s is None:
            return None
        return float(self.replayer.swarm.agents["first_decided_s"].max())

    @property
    def estimate(self) -> NDArray[np.float64]:
        """The robots' posterior means, (robots,); not a number where a strategy keeps no posterior."""
        states = self.replayer.swarm.states
        if not {"alpha", "beta"} <= set(states.dtype.names or ()):
            return np.full(states.size, np.nan)
        return np.asarray(states["alpha"] / (states["alpha"] + states["beta"]))

    @property
    def steers(self) -> bool:
        """Whether the strategy has a say in how robots move."""
        return self.strategy.steer is not None

    @property
    def may_change(self) -> bool:
        """Whether robots that have decided may decide otherwise later."""
        return self.strategy.revises and self.scenario.decision.revise


def sample_rows(samples: pl.DataFrame, tick_ms: int) -> NDArray[np.void]:
    """A motion table as rows (``motion.record.SAMPLE_ROW``), without its account of time."""
    rows = zero_rows(samples.height, SAMPLE_ROW)
    for name in ("run", "robot", "sample", "x_m", "y_m", "heading_rad"):
        rows[name] = samples[name].to_numpy()
    for name, column in (("stop_tick", "stop_start_s"), ("tick", "time_s")):
        rows[name] = np.rint(samples[column].to_numpy() * (1000.0 / tick_ms))
    return rows


def move_on(state: MotionState, loop: Sequence[ClosedLoop], until_s: float) -> Motion | None:
    """Move a run on to ``until_s``, and let the swarms of some scenarios that move alike live through it.

    Gives what is new as tables, where the source gives nothing else.
    """
    tick_ms = loop[0].tick_ms
    if isinstance(state, KernelRun):

        def take(rows: NDArray[np.void]) -> None:
            for one in loop:
                one.take(rows)

        if any(one.asks_places for one in loop):
            rest = state.hand_over(until_s, take)
            for one in loop:
                if one.asks_places and rest.moves is not None:
                    one.take_moves(rest.moves)
        else:
            state.go_on(until_s, take)
        needed = any(one.replayer.needs_stops for one in loop)
        piece, known_tick, stop_tick = None, state.tick, state.stop_ticks if needed else NONE_STANDS
    else:
        piece = state.advance(until_s)
        known_tick, stop_tick = taken_from(piece, loop, tick_ms)
    for one in loop:
        one.catch_up(known_tick, stop_tick)
    return piece


def taken_from(piece: Motion, loop: Sequence[ClosedLoop], tick_ms: int) -> tuple[int, NDArray[np.int64]]:
    """Put down a piece of motion; gives up to which tick it is known, and since when each robot stands then."""
    rows = sample_rows(piece.samples, tick_ms)
    for one in loop:
        one.take(rows)
        if one.asks_places:
            one.take_moves(move_rows(piece.moves, tick_ms))
    standing = piece.ends["stop_start_s"].fill_null(-1.0).to_numpy()
    stop_tick = np.where(standing < 0, -1, np.rint(standing * (1000.0 / tick_ms))).astype(np.int64)
    return int(np.rint(piece.ends["end_s"].to_numpy().max() * (1000.0 / tick_ms))), stop_tick
