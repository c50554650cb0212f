"""How a swarm decides over a motion, tick by tick in plain Python: slow, and independent of the kernels.

At each control period, walking robots first read messages that have arrived and were sent at an earlier period,
in the order of arrival, sending, and sender; then a due timer is called; a robot whose stop ends takes its
sample. A robot stands from the first period of its stop to that of its sample, both included, and at time 0, and
reads nothing then.
"""

from __future__ import annotations

import cmath
import math
from collections import namedtuple
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.rng import Purpose
from vibroswarm.faults import onset_s, working
from vibroswarm.inference.agents import sizes_of, strategy_used, world_of
from vibroswarm.networks import network as network_of
from vibroswarm.observation.energy_model import log_ratios
from vibroswarm.observation.observe import reads_energies
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies import Strategy
from vibroswarm.strategies.base import arrays_of
from vibroswarm.strategies.world import DetailedReading, Draws, Reading, World


@dataclass
class PlainRobot:
    """One robot and its history."""

    number: int
    world: World
    state: Any
    arrays: Any
    unread: list[PlainMessage] = field(default_factory=list)
    samples: int = 0
    sent: int = 0
    messages_received: int = 0
    timers: int = 0
    opinion: int = -1
    decision: int = -1
    decided_s: float = math.nan
    belief: float = math.nan
    belief_at_decision: float = math.nan


@dataclass(frozen=True)
class PlainMessage:
    """A message: content, sender, time, and number among the sender's messages."""

    content: Any
    sender: int
    tick: int
    number: int
    arrival_tick: int = 0
    """Tick from which its receiver can read it."""


class TooEarly(NamedTuple):
    """A message that, by its network, could be read at or before the tick at which it was sent."""

    sender: int
    receiver: int
    tick: int
    arrival_tick: int


@dataclass
class PlainRun(NotebookView):
    """Result of ``plain_run``: a row per sample, in order of time and robot, and the robots at the end."""

    rows: list[dict[str, Any]]
    robots: list[PlainRobot]
    too_early: list[TooEarly]
    """Messages delayed to the next tick, although the network gave an earlier one."""


def plain_run(
    scenario: Scenario,
    seed: int,
    samples: pl.DataFrame,
    ends: pl.DataFrame,
    observations: pl.DataFrame,
    moves: pl.DataFrame | None = None,
) -> PlainRun:
    """Replay one run of a motion under a scenario's strategy, over its network.

    Args:
        samples, ends, observations: of that run alone. moves: likewise, if the network reads positions.
    """
    return _Plain(scenario, seed, samples, ends, observations, moves).run()


class _Plain:
    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        samples: pl.DataFrame,
        ends: pl.DataFrame,
        observations: pl.DataFrame,
        moves: pl.DataFrame | None,
    ) -> None:
        self.moves = [] if moves is None else moves.to_dicts()
        self.scenario, self.seed, self.number = scenario, seed, int(ends["run"][0])
        self.strategy: Strategy = strategy_used(scenario)
        self.params = SimpleNamespace(**scenario.strategy.params.model_dump())
        self.network = network_of(scenario.network.name)
        self.of_network = SimpleNamespace(**scenario.network.params.model_dump())
        self.radio, self.too_early = self._row(self.network.state_type), list[TooEarly]()
        of_radio = self.network.arrays_of(scenario.network.params, sizes_of(scenario))
        self.radio_arrays = SimpleNamespace(**of_radio)
        self.tick_ms = scenario.run.control_period_ms
        self.end = self.tick(float(ends["end_s"].to_numpy().max()))
        self.at: dict[tuple[int, int], int] = {}
        self.standing: set[tuple[int, int]] = {(i, 0) for i in range(scenario.swarm.robots)}
        for k, row in enumerate(samples.iter_rows(named=True)):
            first, last = self.tick(row["stop_start_s"]), self.tick(row["time_s"])
            self.at[row["robot"], last] = k
            self.standing |= {(row["robot"], tick) for tick in range(first, last + 1)}
        for row in ends.iter_rows(named=True):
            if row["stop_start_s"] is not None:
                first = self.tick(row["stop_start_s"])
                self.standing |= {(row["robot"], tick) for tick in range(first, self.end + 1)}
        self.samples, self.observation = samples, observations["observation"].to_list()
        self.log_ratios = [math.nan] * samples.height
        if reads_energies(scenario):
            bits, energy = (observations[name].to_numpy() for name in ("observation", "energy"))
            self.log_ratios = log_ratios(scenario.sensor, bits, energy).tolist()
        self.rows: list[dict[str, Any]] = []
        world = world_of(scenario, samples.height)
        self.robots = [self._robot(i, world._replace(robot=i)) for i in range(scenario.swarm.robots)]
        opposite, silent = (
            onset_s(scenario, seed, [self.number], kind)[0] for kind in ("opposite", "radio_dead")
        )
        self.opposite_s: list[float] = opposite.tolist()
        self.silent_s: list[float] = silent.tolist()
        works: list[bool] = working(scenario, seed, [self.number])[0].tolist()
        self.works = works if any(works) else [True] * len(works)
        self.agreed_since: int | None = None
        self.settled = False

    def tick(self, time_s: float) -> int:
        return round(time_s * 1000.0 / self.tick_ms)

    def _robot(self, i: int, world: World) -> PlainRobot:
        """Create robot ``i`` and call the strategy's ``begin``."""
        sizes = sizes_of(self.scenario)
        declared = arrays_of(self.strategy.arrays)
        values = {name: np.zeros(array.size(sizes), array.kind) for name, array in declared.items()}
        arrays = namedtuple("arrays", values)(**values)
        robot = PlainRobot(i, world, self._row(self.strategy.state_type), arrays)
        draws = Draws(self.seed, self.number, i, int(Purpose.BEGINNING), 0, 0, 0, -1.0)
        self.strategy.begin(robot.state, arrays, draws, self.params, world)
        return robot

    @staticmethod
    def _row(kind: np.dtype[np.void]) -> Any:
        return np.zeros(1, kind).view(np.recarray)[0]

    def run(self) -> PlainRun:
        """Step through all control periods; return the result."""
        for tick in range(1, self.end):
            self.settle(tick)
            sent: list[PlainMessage] = []
            for robot in self.robots:
                if (robot.number, tick) in self.at:
                    sent += self.sample(robot, tick)
                elif (robot.number, tick) not in self.standing:
                    self.read(robot, tick)
                    sent += self.timer(robot, tick)
            for message in sent:
                arrivals = self.arrivals(message)
                for robot in self.robots:
                    if robot.number != message.sender and arrivals[robot.number] >= 0:
                        robot.unread.append(replace(message, arrival_tick=arrivals[robot.number]))
        self.settle(self.end)
        return PlainRun(self.rows, self.robots, self.too_early)

    def arrivals(self, message: PlainMessage) -> list[int]:
        """Return the tick from which each robot can read a message; -1: never."""
        i, tick, number = message.sender, message.tick, message.number
        if self.network.send is None:
            return [-1 if self.is_lost(robot, message) else tick + 1 for robot in self.robots]
        arrival_ticks, (x_m, y_m) = np.full(len(self.robots), -1), self.places(tick)
        draws = Draws(self.seed, self.number, i, int(Purpose.NETWORK), number, 0, 0, -1.0)
        self.network.send(
            self.radio, self.radio_arrays, i, tick, number, self.strategy.bytes_on_air, x_m, y_m, arrival_ticks,
            draws, self.of_network, self.robots[i].world,
        )  # fmt: skip
        ticks: list[int] = arrival_ticks.tolist()
        for receiver, arrival in enumerate(ticks):
            if receiver != i and 0 <= arrival <= tick:
                self.too_early.append(TooEarly(i, receiver, tick, arrival))
        return [arrival if arrival < 0 else max(arrival, tick + 1) for arrival in ticks]

    def places(self, tick: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the robots' positions, m; turning robots are where their turn began."""
        if not self.moves:
            return np.empty(0), np.empty(0)
        time_s, positions = tick * self.tick_ms / 1000.0, np.empty((2, len(self.robots)))
        for move in self.moves:  # in order of time: the last one begun counts
            if move["start_s"] > time_s + self.tick_ms / 4000.0:
                break
            for_s = (time_s - move["start_s"]) if move["kind"] == "drive" else 0.0
            at = complex(move["x_m"], move["y_m"])
            turned, ahead = move["turn_rate_rad_s"] * for_s, cmath.exp(1j * move["heading_rad"])
            if abs(turned) < 1e-9:
                at += move["speed_m_s"] * for_s * ahead
            else:  # along a circle
                at += (
                    move["speed_m_s"] / move["turn_rate_rad_s"] * ahead * (cmath.exp(1j * turned) - 1.0) / 1j
                )
            positions[:, move["robot"]] = at.real, at.imag
        return positions[0], positions[1]

    def is_lost(self, robot: PlainRobot, message: PlainMessage) -> bool:
        """Return whether a message is lost at this robot."""
        if self.network.lost is None:
            return False
        sender, number = message.sender, message.number
        draws = Draws(self.seed, self.number, robot.number, int(Purpose.LOSS), number, sender, 16, -1.0)
        return bool(self.network.lost(sender, robot.number, draws, self.of_network, robot.world))

    def read(self, robot: PlainRobot, tick: int) -> None:
        """Pass the messages that have arrived by ``tick`` to the robot's strategy."""
        if self.is_silent(robot, tick):
            return
        due = sorted((m for m in robot.unread if m.arrival_tick <= tick), key=lambda m: m.arrival_tick)
        robot.unread = [m for m in robot.unread if m.arrival_tick > tick]
        for message in due:
            draws = Draws(
                self.seed, self.number, robot.number, int(Purpose.HEARING), message.number, message.sender, 16,
                -1.0
            )  # fmt: skip
            if self.strategy.on_message is not None:
                self.strategy.on_message(
                    robot.state, robot.arrays, message.content, message.sender, tick * self.tick_ms / 1000.0,
                    draws, self.params, robot.world,
                )  # fmt: skip
            else:
                assert self.strategy.on_counts is not None
                bit = int(message.content.bit)
                self.strategy.on_counts(robot.state, bit, 1 - bit, self.params, robot.world)
            robot.messages_received += 1

    def timer(self, robot: PlainRobot, tick: int) -> list[PlainMessage]:
        """Call the strategy's ``on_timer`` if it is due; return the messages that it sends."""
        if self.strategy.on_timer is None or not robot.state.next_s * 1000.0 / self.tick_ms - 1e-9 <= tick:
            return []
        out = self._row(self.strategy.message_type)
        draws = Draws(self.seed, self.number, robot.number, int(Purpose.TIMER), robot.timers, 0, 0, -1.0)
        time_s = tick * self.tick_ms / 1000.0
        sends = self.strategy.on_timer(
            robot.state, robot.arrays, time_s, out, draws, self.params, robot.world
        )
        robot.timers += 1
        self.ask(robot, tick, time_s)
        return self.post(robot, tick, out) if self.is_sent(sends, robot, tick, out) else []

    def is_silent(self, robot: PlainRobot, tick: int) -> bool:
        """Return whether the robot's radio is dead."""
        return tick * self.tick_ms / 1000.0 >= self.silent_s[robot.number] - 1e-9

    def is_sent(self, sends: bool, robot: PlainRobot, tick: int, content: Any) -> bool:
        """Return whether a message is sent; turn it into its opposite if the robot does that."""
        if tick * self.tick_ms / 1000.0 >= self.opposite_s[robot.number]:
            if self.strategy.opposite is not None:
                self.strategy.opposite(content)
            else:
                content.bit = 1 - content.bit
        return bool(sends) and not self.is_silent(robot, tick)

    def sample(self, robot: PlainRobot, tick: int) -> list[PlainMessage]:
        """Call the strategy's ``on_sample``; return the messages that it sends."""
        k = self.at[robot.number, tick]
        row, number = self.samples.row(k, named=True), robot.samples
        out = self._row(self.strategy.message_type)
        draws = Draws(self.seed, self.number, robot.number, int(Purpose.MESSAGE), number, 0, 0, -1.0)
        x: Any = Reading(
            self.observation[k], row["time_s"], number, row["x_m"], row["y_m"], row["heading_rad"], 0.0,
            number, row["x_m"], row["y_m"], 0.0, 0.0,
        )  # fmt: skip
        if self.strategy.reads_details:
            x = DetailedReading(**x._asdict(), log_ratio=self.log_ratios[k], draws_m=np.empty(0))
        sends = self.strategy.on_sample(robot.state, robot.arrays, x, out, draws, self.params, robot.world)
        robot.samples += 1
        self.ask(robot, tick, row["time_s"])
        sends = self.is_sent(sends, robot, tick, out)
        if self.strategy.steer is not None:
            draws = draws._replace(purpose=int(Purpose.STEERING))
            self.strategy.steer(robot.state, robot.arrays, x, draws, self.params, robot.world)
        self.rows.append(
            {
                "robot": robot.number,
                "sample": number,
                "sends": bool(sends),
                "message": out,
                "state": robot.state.copy(),
                "messages_received": robot.messages_received,
                "belief_below": robot.belief,
                "decision": robot.opinion,
            }
        )
        return self.post(robot, tick, out) if sends else []

    def post(self, robot: PlainRobot, tick: int, content: Any) -> list[PlainMessage]:
        robot.sent += 1
        return [PlainMessage(content, robot.number, tick, robot.sent - 1)]

    def ask(self, robot: PlainRobot, tick: int, time_s: float) -> None:
        """Update the robot's belief and decision from its strategy."""
        arguments = (robot.state, robot.arrays, self.params, robot.world)
        robot.belief = math.nan if self.strategy.belief is None else float(self.strategy.belief(*arguments))
        new = int(self.strategy.decision(*arguments))
        if new == robot.opinion:
            return
        robot.opinion = new
        if self.strategy.decides == "once":
            robot.decision, robot.decided_s, robot.belief_at_decision = new, time_s, robot.belief
            return
        agreed = new != -1 and all(other.opinion == new for other in self.robots if self.works[other.number])
        if not self.settled and self.works[robot.number]:
            self.agreed_since = tick if agreed else None

    def settle(self, tick: int) -> None:
        """Make opinions that have agreed for long enough the swarm's decision."""
        if self.settled or self.agreed_since is None:
            return
        if (tick - self.agreed_since) * self.tick_ms / 1000.0 < self.scenario.decision.hold_s:
            return
        self.settled = True
        for robot in self.robots:
            if robot.opinion == -1:
                continue
            robot.decision, robot.decided_s = robot.opinion, self.agreed_since * self.tick_ms / 1000.0
            robot.belief_at_decision = robot.belief
