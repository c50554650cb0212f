"""Reference replay of a swarm over a given motion, tick by tick in plain Python: slow, independent of the kernels.

At each tick each robot does one of three things. A robot whose stop ends takes its sample. A robot that stands does
nothing. A robot that walks reads the messages that have arrived by then, sorted by tick of arrival, then by tick of
sending, then by sender; after that its timer is called if it is due. A robot stands from the first tick of its stop to
the tick of its sample, both included, and at tick 0. Messages sent at a tick are delivered after all robots have acted,
so they are read at a later tick.

A strategy either decides once, or has opinions that may change. With opinions, the swarm decides when all working
robots have had the same opinion for ``decision.hold_s``. A robot works if it has no fault; if all robots have faults,
all count as working.

The hooks of strategies and networks are those of ``strategies.base`` and ``networks.base``.
"""

from __future__ import annotations

import cmath
import math
from collections import namedtuple
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.rng import Purpose
from vibroswarm.inference.agents import sizes_of, strategy_used, world_of
from vibroswarm.inference.replay import classes_and_values
from vibroswarm.networks import network as network_of
from vibroswarm.observation.decision_boundary import grid_of
from vibroswarm.observation.energy_model import weighed
from vibroswarm.observation.observe import reads_energies
from vibroswarm.result import Result
from vibroswarm.scenario.fault_draws import onset_s, working
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate
from vibroswarm.strategies import Strategy
from vibroswarm.strategies.base import arrays_of
from vibroswarm.strategies.world import Draws, Reading, World

PEER_BITS: Final = 16
"""Bits of an address that hold the number of another robot."""


@dataclass
class PlainRobot:
    """One robot: what it knows, its strategy's state, its messages and counts, and its decision so far."""

    number: int
    """Its number, from 0."""
    world: World
    """What it knows about its task."""
    state: Any
    """State of the strategy."""
    arrays: Any
    """Arrays of the strategy."""
    unread: list[PlainMessage] = field(default_factory=list)
    """Messages on their way or not read yet, in the order of sending and sender."""
    samples: int = 0
    """Number of samples so far."""
    sent: int = 0
    """Number of messages sent."""
    messages_received: int = 0
    """Number of messages passed to the strategy."""
    timers: int = 0
    """Number of calls of ``on_timer``."""
    opinion: int = -1
    """What the strategy's ``decision`` returned last."""
    decision: int = -1
    """The decision that counts: the opinion, if the strategy decides once; otherwise that of the swarm."""
    decided_s: float = math.nan
    """Time of the decision."""
    belief: float = math.nan
    """What the strategy's ``belief`` returned last."""
    belief_at_decision: float = math.nan
    """What the strategy's ``belief`` returned when the decision was made."""


@dataclass(frozen=True)
class PlainMessage:
    """A message: content, sender, tick at which it is sent, and number among the sender's messages, from 0."""

    content: Any
    sender: int
    tick: int
    """Tick at which it is sent."""
    number: int
    """Index among the sender's messages, from 0."""
    arrival_tick: int = 0
    """Tick from which its receiver can read it."""


@dataclass
class PlainRun:
    """Result of ``plain_run``: a row per sample, in order of time and robot, and the robots at the end."""

    rows: list[dict[str, Any]]
    """Keys: robot, sample (its number), sends, message, state, messages_received, belief_below, decision (opinion)."""
    robots: list[PlainRobot]


def plain_run(
    scenario: Scenario,
    seed: int,
    samples: pl.DataFrame,
    ends: pl.DataFrame,
    observations: pl.DataFrame,
    moves: pl.DataFrame | None = None,
) -> PlainRun:
    """Replay one run of a motion with a scenario's strategy and network.

    Robots know their true places: ``localisation`` is not replayed.

    Args:
        seed: of the simulation. samples, ends, observations: tables of this run alone; observations has a row for each
            row of samples. moves: table of this run alone; it is needed if the network reads positions.
    """
    return _Plain(scenario, seed, samples, ends, observations, moves).run()


class _Plain:
    """The state of a replay, see ``plain_run``."""

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        samples: pl.DataFrame,
        ends: pl.DataFrame,
        observations: pl.DataFrame,
        moves: pl.DataFrame | None,
    ) -> None:
        """Begin the replay at tick 0: call the strategy's ``begin`` for each robot. Arguments: see ``plain_run``."""
        self.moves = [] if moves is None else moves.to_dicts()
        # self.number: number of the run, which is a part of the address of random numbers.
        self.scenario, self.seed, self.number = scenario, seed, int(ends["run"][0])
        self.strategy: Strategy = strategy_used(scenario)
        self.params = SimpleNamespace(**scenario.strategy.params.model_dump())
        self.network = network_of(scenario.network.name)
        self.network_params = SimpleNamespace(**scenario.network.params.model_dump())
        self.network_state = _new_row(self.network.state_type)
        network_arrays = self.network.arrays_of(scenario.network.params, sizes_of(scenario))
        self.network_arrays = SimpleNamespace(**network_arrays)
        self.tick_ms = scenario.run.control_period_ms
        self.end = self.tick(float(ends["end_s"].to_numpy().max()))
        # ``sample_at`` gives the row in ``samples`` of the sample that a robot takes at a tick, by (robot, tick).
        # ``standing`` holds each (robot, tick) at which a robot stands.
        self.sample_at: dict[tuple[int, int], int] = {}
        self.standing: set[tuple[int, int]] = {(i, 0) for i in range(scenario.swarm.robots)}
        for k, row in enumerate(samples.iter_rows(named=True)):
            first, last = self.tick(row["stop_start_s"]), self.tick(row["time_s"])
            self.sample_at[row["robot"], last] = k
            self.standing |= {(row["robot"], tick) for tick in range(first, last + 1)}
        for row in ends.iter_rows(named=True):  # stops that are under way at the end
            if row["stop_start_s"] is not None:
                first = self.tick(row["stop_start_s"])
                self.standing |= {(row["robot"], tick) for tick in range(first, self.end + 1)}
        self.samples, self.observation = samples, observations["observation"].to_list()
        self.weighed = [[math.nan, math.nan]] * samples.height
        if reads_energies(scenario):
            classes, energy = classes_and_values(observations)
            assert energy is not None
            self.weighed = weighed(scenario.sensor, classes, energy, grid_of(scenario)).tolist()
        self.rows: list[dict[str, Any]] = []
        # The number of samples of all robots gives the size of ``world.beliefs``, a cache of beliefs by their counts.
        world = world_of(scenario, samples.height)
        self.robots = [self._robot(i, world._replace(robot=i)) for i in range(scenario.swarm.robots)]
        # Time, s, from which each robot sends opposite messages, and from which its radio is dead; inf: never.
        opposite, silent = (
            onset_s(scenario, seed, [self.number], kind)[0] for kind in ("opposite", "radio_dead")
        )
        self.opposite_s: list[float] = opposite.tolist()
        self.silent_s: list[float] = silent.tolist()
        # Robots with a fault, whenever it begins in the run, do not count for the agreement of the swarm, unless all
        # robots have one.
        faultless: list[bool] = working(scenario, seed, [self.number])[0].tolist()
        self.is_working = faultless if any(faultless) else [True] * len(faultless)
        self.agreed_since: int | None = None  # tick since which all working robots agree; None: they do not
        self.has_decided = False  # whether the swarm has decided, if opinions may change

    def tick(self, time_s: float) -> int:
        """Return the tick at a time."""
        return round(time_s * 1000.0 / self.tick_ms)

    def draws(self, robot: int, purpose: Purpose, event: int, peer: int = 0, shift: int = 0) -> Draws:
        """Return the address of the random numbers of one call of a hook, from which ``u(d, k)`` computes the k-th one.

        Args:
            robot: whose numbers they are. event: index of the sample, timer or message. peer, shift: number of the
                other robot, and ``PEER_BITS``, where the event concerns two robots; else 0.
        """
        return Draws(
            seed=self.seed,
            run=self.number,
            robot=robot,
            purpose=int(purpose),
            address=event,
            peer=peer,
            shift=shift,
            first=-1.0,  # below 0: ``u`` computes the number for k = 0 like all others; kernels may know it already
        )

    def _robot(self, i: int, world: World) -> PlainRobot:
        """Return robot ``i`` at tick 0: with zeroed state and arrays, changed by the strategy's ``begin``."""
        sizes = sizes_of(self.scenario)
        declared = arrays_of(self.strategy.arrays)
        values = {name: np.zeros(array.size(sizes), array.kind) for name, array in declared.items()}
        arrays = namedtuple("arrays", values)(**values)  # hooks read arrays by name: a.odds
        robot = PlainRobot(i, world, _new_row(self.strategy.state_type), arrays)
        draws = self.draws(i, Purpose.BEGINNING, 0)
        self.strategy.begin(robot.state, arrays, draws, self.params, world)
        return robot

    def run(self) -> PlainRun:
        """Step through all ticks from 1 to before the end, and return the result.

        At each tick the swarm decides if its robots have agreed for long enough (``decide_if_agreed``), then each robot
        acts, then the messages that the robots sent are put into the lists ``unread`` of their receivers.
        """
        for tick in range(1, self.end):
            self.decide_if_agreed(tick)
            sent: list[PlainMessage] = []
            for robot in self.robots:
                if (robot.number, tick) in self.sample_at:
                    sent += self.sample(robot, tick)
                elif (robot.number, tick) not in self.standing:
                    self.read(robot, tick)
                    sent += self.timer(robot, tick)
            for message in sent:
                arrivals = self.arrivals(message)  # by receiver; -1: the message never arrives there
                for robot in self.robots:
                    if robot.number != message.sender and arrivals[robot.number] >= 0:
                        robot.unread.append(replace(message, arrival_tick=arrivals[robot.number]))
        self.decide_if_agreed(self.end)
        return PlainRun(self.rows, self.robots)

    def arrivals(self, message: PlainMessage) -> list[int]:
        """Return, for each robot, the tick from which it can read a message; -1: never.

        Arrivals at or before the tick of sending are delayed to the tick after sending. The entry of the sender itself
        has no meaning.
        """
        i, tick, number = message.sender, message.tick, message.number
        if self.network.send is None:  # then messages arrive at the next tick, unless ``lost`` loses them
            return [-1 if self.is_lost(robot, message) else tick + 1 for robot in self.robots]
        arrival_ticks, (x_m, y_m) = np.full(len(self.robots), -1), self.places(tick)
        draws = self.draws(i, Purpose.NETWORK, number)
        # ``send`` fills in ``arrival_ticks``; -1 stays where the message is lost.
        self.network.send(
            self.network_state, self.network_arrays, i, tick, number, self.strategy.bytes_on_air, x_m, y_m,
            arrival_ticks, draws, self.network_params, self.robots[i].world,
        )  # fmt: skip
        ticks: list[int] = arrival_ticks.tolist()
        return [arrival if arrival < 0 else max(arrival, tick + 1) for arrival in ticks]

    def places(self, tick: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return x and y (robots,) of all robots at a tick, m; two empty arrays if no moves were given.

        A robot that drives is on the arc of its move; any other robot is where its move began.
        """
        if not self.moves:
            return np.empty(0), np.empty(0)
        time_s, positions = tick * self.tick_ms / 1000.0, np.empty((2, len(self.robots)))
        for move in self.moves:  # in order of time, so that the last move begun overwrites earlier ones
            if move["start_s"] > time_s + self.tick_ms / 4000.0:  # a quarter of a tick, for rounding of times
                break
            for_s = (time_s - move["start_s"]) if move["kind"] == "drive" else 0.0
            position = complex(move["x_m"], move["y_m"])  # x + i y
            # ``turned``: angle turned since the move began; ``ahead``: the direction of its start, e^(i heading).
            turned, ahead = move["turn_rate_rad_s"] * for_s, cmath.exp(1j * move["heading_rad"])
            if abs(turned) < 1e-9:
                position += move["speed_m_s"] * for_s * ahead
            else:  # along a circle: the integral of the velocity, speed * e^(i (heading + turn rate * time))
                position += (
                    move["speed_m_s"] / move["turn_rate_rad_s"] * ahead * (cmath.exp(1j * turned) - 1.0) / 1j
                )
            positions[:, move["robot"]] = position.real, position.imag
        return positions[0], positions[1]

    def is_lost(self, robot: PlainRobot, message: PlainMessage) -> bool:
        """Return whether the network loses a message on its way to this robot; False if the network has no ``lost``."""
        if self.network.lost is None:
            return False
        sender, number = message.sender, message.number
        draws = self.draws(robot.number, Purpose.LOSS, number, sender, PEER_BITS)
        return bool(self.network.lost(sender, robot.number, draws, self.network_params, robot.world))

    def read(self, robot: PlainRobot, tick: int) -> None:
        """Pass the messages that have arrived by ``tick`` to the robot's strategy, and remove them from ``unread``.

        A robot whose radio is dead reads nothing.
        """
        if not robot.unread or self.is_silent(robot, tick):
            return
        # ``unread`` is in the order of sending and sender, which the stable sort keeps for equal arrivals.
        due = sorted((m for m in robot.unread if m.arrival_tick <= tick), key=lambda m: m.arrival_tick)
        robot.unread = [m for m in robot.unread if m.arrival_tick > tick]
        for message in due:
            draws = self.draws(robot.number, Purpose.HEARING, message.number, message.sender, PEER_BITS)
            if self.strategy.on_message is not None:
                self.strategy.on_message(
                    robot.state, robot.arrays, message.content, message.sender, tick * self.tick_ms / 1000.0,
                    draws, self.params, robot.world,
                )  # fmt: skip
            else:
                # ``Strategy`` sees to it that one of the two hooks is there; the assertion is for the type checker.
                assert self.strategy.on_counts is not None
                bit = int(message.content.bit)
                self.strategy.on_counts(robot.state, bit, 1 - bit, self.params, robot.world)
            robot.messages_received += 1

    def timer(self, robot: PlainRobot, tick: int) -> list[PlainMessage]:
        """Call ``on_timer`` if the time ``next_s`` in the robot's state is reached; return the message sent, or []."""
        # 1e-9 is for rounding. With next_s = nan or inf the comparison is false, so the timer is never due.
        if self.strategy.on_timer is None or not robot.state.next_s * 1000.0 / self.tick_ms - 1e-9 <= tick:
            return []
        out = _new_row(self.strategy.message_type)
        draws = self.draws(robot.number, Purpose.TIMER, robot.timers)
        time_s = tick * self.tick_ms / 1000.0
        sends = self.strategy.on_timer(
            robot.state, robot.arrays, time_s, out, draws, self.params, robot.world
        )
        robot.timers += 1
        self.ask(robot, tick, time_s)
        return self.post(robot, tick, out) if self.is_sent(sends, robot, tick, out) else []

    def is_silent(self, robot: PlainRobot, tick: int) -> bool:
        """Return whether the robot's radio is dead at a tick: from the first tick at or after the time of the fault.

        1e-9 s is for rounding, as kernels convert the time of the fault to a tick with such a margin.
        """
        return tick * self.tick_ms / 1000.0 >= self.silent_s[robot.number] - 1e-9

    def is_sent(self, sends: bool, robot: PlainRobot, tick: int, content: Any) -> bool:
        """Return whether a message is sent: ``sends``, unless the robot's radio is dead.

        ``content`` is changed in place into the opposite message if the robot has the fault "opposite" by then, even if
        it is not sent.
        """
        # Without a margin for rounding, as kernels compare these times themselves, not ticks.
        if tick * self.tick_ms / 1000.0 >= self.opposite_s[robot.number]:
            if self.strategy.opposite is not None:
                self.strategy.opposite(content)
            elif hasattr(content, "bit"):
                content.bit = 1 - content.bit
            else:
                content.kind = (content.kind + 1) % robot.world.kinds
        return bool(sends) and not self.is_silent(robot, tick)

    def sample(self, robot: PlainRobot, tick: int) -> list[PlainMessage]:
        """Call the strategy's ``on_sample`` and ``steer``, and record a row; return the message that is sent, or [].

        Robots know their true places here, so the fields of ``Reading`` about a lagged sample, whose place a robot
        estimates better later on, are those of the sample itself, and all spreads are 0.
        """
        k = self.sample_at[robot.number, tick]
        row, number = self.samples.row(k, named=True), robot.samples
        out = _new_row(self.strategy.message_type)
        draws = self.draws(robot.number, Purpose.MESSAGE, number)
        value, log_ratio = self.weighed[k]
        x = Reading(
            reading=self.observation[k], t_s=row["time_s"], number=number,
            x_m=row["x_m"], y_m=row["y_m"], heading_rad=row["heading_rad"], spread_m=0.0,
            lagged_number=number, lagged_x_m=row["x_m"], lagged_y_m=row["y_m"],
            lagged_spread_x_m=0.0, lagged_spread_y_m=0.0, log_ratio=log_ratio, value=value,
        )  # fmt: skip
        sends = self.strategy.on_sample(robot.state, robot.arrays, x, out, draws, self.params, robot.world)
        robot.samples += 1
        self.ask(robot, tick, row["time_s"])
        sends = self.is_sent(sends, robot, tick, out)
        if self.strategy.steer is not None:
            # The motion is given, so only the changes of state and arrays matter, not the turn and drive returned.
            draws = draws._replace(purpose=int(Purpose.STEERING))
            self.strategy.steer(robot.state, robot.arrays, x, draws, self.params, robot.world)
        self.rows.append(
            {
                "robot": robot.number,
                "sample": number,
                "sends": bool(sends),
                "message": out,
                "state": robot.state.copy(),  # the state at this sample; the row itself changes later
                "messages_received": robot.messages_received,
                "belief_below": robot.belief,
                "decision": robot.opinion,
            }
        )
        return self.post(robot, tick, out) if sends else []

    def post(self, robot: PlainRobot, tick: int, content: Any) -> list[PlainMessage]:
        """Count a message as sent, and return it as a list of one."""
        robot.sent += 1
        return [PlainMessage(content, robot.number, tick, robot.sent - 1)]

    def ask(self, robot: PlainRobot, tick: int, time_s: float) -> None:
        """Update the robot's belief and opinion from its strategy, and with them its decision.

        If the strategy decides once, a new opinion is the robot's decision. Otherwise ``agreed_since`` is set to this
        tick if all working robots have the new opinion, else to None, and ``decide_if_agreed`` makes the decision
        later. The opinion of a robot that does not work leaves ``agreed_since`` as it is.
        """
        arguments = (robot.state, robot.arrays, self.params, robot.world)
        robot.belief = math.nan if self.strategy.belief is None else float(self.strategy.belief(*arguments))
        new = int(self.strategy.decision(*arguments))
        if new == robot.opinion:
            return
        robot.opinion = new
        if self.strategy.decides == "once":
            robot.decision, robot.decided_s, robot.belief_at_decision = new, time_s, robot.belief
            return
        agreed = new != -1 and all(
            other.opinion == new for other in self.robots if self.is_working[other.number]
        )
        if not self.has_decided and self.is_working[robot.number]:
            self.agreed_since = tick if agreed else None

    def decide_if_agreed(self, tick: int) -> None:
        """Make each robot's opinion its decision if, by ``tick``, working robots have agreed for ``decision.hold_s``.

        Robots that do not work get their own opinions too, which may differ. One that failed before it had an opinion
        stays undecided. The decision time is when the robots began to agree. Decisions are made once, and are final.
        """
        if self.has_decided or self.agreed_since is None:
            return
        if (tick - self.agreed_since) * self.tick_ms / 1000.0 < self.scenario.decision.hold_s:
            return
        self.has_decided = True
        for robot in self.robots:
            if robot.opinion == -1:
                continue
            robot.decision, robot.decided_s = robot.opinion, self.agreed_since * self.tick_ms / 1000.0
            robot.belief_at_decision = robot.belief


def _new_row(kind: np.dtype[np.void]) -> Any:
    """Return a row of zeros, with its fields as attributes."""
    return np.zeros(1, kind).view(np.recarray)[0]


def differences(result: Result, plain: PlainRun) -> list[str]:
    """Return the columns in which a compiled run differs from the reference.

    Args:
        result: of one run. plain: of the same run; its rows are in the same order as those of ``result.inference``.
    """
    at_samples, at_end = result.inference, result.robots
    states = [row["state"] for row in plain.rows]
    compared: dict[str, tuple[pl.Series, list[Any]]] = {
        name: (at_samples[name], [row[name] for row in plain.rows])
        for name in ("robot", "sample", "messages_received", "decision", "belief_below")
    }
    if states and "bit" in plain.rows[0]["message"].dtype.names:  # only such messages are in the table
        bits = [int(row["message"].bit) if row["sends"] else math.nan for row in plain.rows]
        compared["message"] = at_samples["message"], bits
    for name, attribute in {"decision_time_s": "decided_s"}.items() | {
        (name, name) for name in ("decision", "sent", "samples", "messages_received", "belief_at_decision")
    }:
        compared[f"{name} at the end"] = at_end[name], [getattr(robot, attribute) for robot in plain.robots]
    for name in ("alpha", "beta"):
        if states and at_samples[name].null_count() == 0:
            compared[name] = at_samples[name], [int(state[name]) for state in states]
    if result.reports is not None:
        rows = sorted(plain.rows, key=lambda row: (row["robot"], row["sample"]))
        for (name,), reported in result.reports.group_by("name", maintain_order=True):
            if states and name in states[0].dtype.names:
                values = [value for row in rows for value in np.ravel(row["state"][str(name)]).tolist()]
                compared[f"report {name}"] = reported["value"], values
    return [
        name
        for name, (found, expected) in compared.items()
        if not found.cast(pl.Float64).fill_null(math.nan).equals(pl.Series(found.name, expected, pl.Float64))
    ]


def equals_plain(scenario: Scenario, seed: int = 7) -> list[str]:
    """Return where a run of a scenario differs from the reference."""
    result = simulate(scenario, seed, 1, moves=True)
    plain = plain_run(scenario, seed, result.motion, result.ends, result.observations, result.moves)
    return differences(result, plain)
