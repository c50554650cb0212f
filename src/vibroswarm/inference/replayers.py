"""The robots of some runs, and the kernel that runs their strategy from sample to sample."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import entry_for, read_only, zero_rows
from vibroswarm.errors import CodeError
from vibroswarm.inference.agents import empty_swarm, world_of
from vibroswarm.inference.generate import kernels
from vibroswarm.inference.rows import DONE, NO_ROOM, WHY, Counts, Log, Mail, Readings, Rows, Stops, empty_log
from vibroswarm.inference.timeline import NO_REACH, Timeline
from vibroswarm.inference.told_errors import told
from vibroswarm.inference.tracks import NO_TRACKS, Tracks
from vibroswarm.networks import Network
from vibroswarm.networks import network as network_of
from vibroswarm.scenario import Scenario
from vibroswarm.strategies import Strategy
from vibroswarm.strategies import strategy as strategy_of

NOWHERE: Final = read_only(np.empty(0))


class Replayer(ABC):
    """Goes on with some runs from where they stopped.

    Args:
        runs: how many. longest: most samples of one. rows: of all. messages, log: (rows,), written; without nothing is
            put down.
    """

    template: str
    needs_stops: bool

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        runs: int,
        longest: int,
        rows: int,
        messages: NDArray[np.void] | None,
        log: Log | None,
        network: Network,
    ) -> None:
        self.strategy, self.network = strategy_of(scenario.strategy.name), network
        self.module = kernels(self.strategy, network, self.template)
        self.seed, self.world = seed, world_of(scenario, longest)
        self.swarm = empty_swarm(self.strategy, network, scenario, runs)
        self.taken = np.zeros(runs, dtype=np.int64)
        self.log = empty_log(0, self.strategy.state_type) if log is None else log
        self.messages = zero_rows(0, self.strategy.message_type) if messages is None else messages
        self.entry: Callable[..., int] | None = None
        self.calls, self.is_new = 0, True
        self.course = np.empty((rows if self.strategy.steer is not None else 0, 2))

    @property
    def asks_places(self) -> bool:
        """Whether the network reads where robots are."""
        return self.network.asks_places

    @abstractmethod
    def go_on(
        self,
        rows: Rows,
        readings: Readings,
        stops: Stops,
        *,
        begins: bool = False,
        ends: bool = False,
        limit_s: float = np.inf,
        tracks: Tracks = NO_TRACKS,
    ) -> None:
        """Replay what is new.

        Args:
            stops: of no rows, where this replay does not need them. begins: from time 0. ends: also hear what is
                heard after the last sample. limit_s: no further. tracks: where ``asks_places``.
        Raises:
            CodeError: the strategy did what none may.
        """

    def clear(self) -> None:
        """All zeros, as states and arrays are before ``begin``."""
        if self.is_new:
            self.is_new = False
            return
        self.swarm.states.view(np.uint8)[:] = 0
        for one in self.swarm.arrays if isinstance(self.swarm.arrays, tuple) else ():
            one[:] = 0

    def call(self, arguments: tuple[Any, ...]) -> int:
        """What the kernel gives for these arguments, which are of the same types at each call."""
        if self.entry is None:
            with told(self.strategy, self.network):
                came: int = self.module.replay(*arguments)
            self.calls += 1
            if self.calls == 2 and not self.strategy.code:  # what a kernel raises tells its line only so
                self.entry = entry_for(self.module.replay, *arguments)
            return came
        try:
            return self.entry(*arguments)
        except Exception:
            with told(self.strategy, self.network):
                raise

    def check(self, came: int) -> None:
        """Refuse what a strategy may not do."""
        if came != DONE:
            raise CodeError(f"strategy '{self.strategy.name}': {WHY[came]}")


class CountsReplayer(Replayer):
    """For strategies that count bits, over networks in which a message is there at the next tick, or never."""

    template = "replay_counts"
    needs_stops = False

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        runs: int,
        longest: int,
        rows: int,
        messages: NDArray[np.void] | None,
        log: Log | None,
        timeline: Timeline | None,
    ) -> None:
        # What is lost is a number here: the kernel is the same for both networks.
        super().__init__(scenario, seed, runs, longest, rows, messages, log, network_of("ideal"))
        self.loss = loss_of(scenario)
        self.reach = NO_REACH if timeline is None else timeline.reach(seed, self.loss)
        if messages is None:
            self.messages = zero_rows(rows, self.strategy.message_type)
        self.counts = Counts(
            np.empty(longest + 1, dtype=np.int32),
            np.empty(longest, dtype=np.int32),
            np.empty((longest + 1, self.reach.words.shape[1]), dtype=np.uint64),
        )

    def go_on(
        self,
        rows: Rows,
        readings: Readings,
        stops: Stops,
        *,
        begins: bool = False,
        ends: bool = False,
        limit_s: float = np.inf,
        tracks: Tracks = NO_TRACKS,
    ) -> None:
        """``Replayer.go_on``."""
        if begins:
            self.clear()
        arguments = (
            rows, readings, self.taken, self.swarm, self.messages, self.counts, self.log, self.course, self.world,
            self.seed, self.loss, self.reach, begins, ends, limit_s,
        )  # fmt: skip
        self.check(self.call(arguments))


class MessagesReplayer(Replayer):
    """For every strategy and network, message by message."""

    template = "replay_messages"
    needs_stops = True

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        runs: int,
        longest: int,
        rows: int,
        messages: NDArray[np.void] | None,
        log: Log | None,
        network: Network,
    ) -> None:
        super().__init__(scenario, seed, runs, longest, rows, messages, log, network)
        self.robots = scenario.swarm.robots
        self.links, self.radio = zero_rows(1, network.params_type), zero_rows(1, network.state_type)
        self.links[0] = network.params_row(scenario.network.params)
        self.mail = self._mail(longest + 64)

    def _mail(self, room: int) -> Mail:
        strategy, network = self.strategy, self.network
        return Mail(
            messages=zero_rows(room, strategy.message_type),
            sender=np.empty(room, dtype=np.int64),
            tick=np.empty(room, dtype=np.int64),
            number=np.empty(room, dtype=np.int64),
            arrival=np.empty((room if network.send is not None else 0, self.robots), dtype=np.int64),
            filled=np.zeros(1, dtype=np.int64),
            agreement=np.zeros(2, dtype=np.int64),
            empty=zero_rows(1, strategy.message_type),
            blank=zero_rows(1, strategy.state_type),
            silent=zero_rows(1, network.state_type),
            x_m=np.zeros(self.robots if network.asks_places else 0),
            y_m=np.zeros(self.robots if network.asks_places else 0),
        )

    def go_on(
        self,
        rows: Rows,
        readings: Readings,
        stops: Stops,
        *,
        begins: bool = False,
        ends: bool = False,
        limit_s: float = np.inf,
        tracks: Tracks = NO_TRACKS,
    ) -> None:
        """``Replayer.go_on``."""
        came = self._go_on(rows, readings, stops, tracks, begins, ends, limit_s)
        while came == NO_ROOM:  # from the beginning, with more of it: nothing that was done so far is lost
            self.mail = self._mail(2 * self.mail.sender.size)
            came = self._go_on(rows, readings, stops, tracks, True, ends, limit_s)
        self.check(came)

    def _go_on(
        self,
        rows: Rows,
        readings: Readings,
        stops: Stops,
        tracks: Tracks,
        begins: bool,
        ends: bool,
        limit_s: float,
    ) -> int:
        if begins:
            self.clear()
        arguments = (
            rows, stops, readings, self.taken, self.swarm, self.messages, self.mail, tracks, self.log, self.course,
            self.world, self.links, self.radio, self.strategy.bytes_on_air, self.seed, begins, ends, limit_s,
        )  # fmt: skip
        return self.call(arguments)


def counts_only(strategy: Strategy, network: Network) -> bool:
    """Whether ``CountsReplayer`` does for this strategy over this network."""
    plain = network.name in ("ideal", "loss")
    return (
        plain and strategy.on_counts is not None and strategy.on_timer is None and strategy.decides == "once"
    )


def loss_of(scenario: Scenario) -> float:
    """The share of messages that is lost, over a network in which each is lost by itself."""
    return float(scenario.network.params.share) if scenario.network.name == "loss" else 0.0


def replayer_of(
    scenario: Scenario,
    seed: int,
    *,
    runs: int,
    longest: int,
    rows: int,
    messages: NDArray[np.void] | None = None,
    log: Log | None = None,
    timeline: Timeline | None = None,
) -> Replayer:
    """What replays the strategy of a scenario over its network; the faster where there are two.

    Args:
        as of ``Replayer``; timeline: where whole runs are replayed.
    """
    network = network_of(scenario.network.name)
    if counts_only(strategy_of(scenario.strategy.name), network):
        return CountsReplayer(scenario, seed, runs, longest, rows, messages, log, timeline)
    return MessagesReplayer(scenario, seed, runs, longest, rows, messages, log, network)
