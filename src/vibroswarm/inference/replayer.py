"""Replayers: the state of the robots of some runs, with the kernel that replays their strategy.

The kernel is generated from the template ``replay_counts`` or ``replay_messages``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import entry_for, read_only, zero_rows
from vibroswarm.errors import CodeError
from vibroswarm.inference.agents import empty_swarm, set_failures, sizes_of, strategy_used, world_of
from vibroswarm.inference.code_errors import translate_errors
from vibroswarm.inference.deliveries import NO_REACH, Timeline
from vibroswarm.inference.generated_kernels import kernels, network_arrays_for
from vibroswarm.inference.replay_arrays import (
    BUFFER_FULL,
    DONE,
    ERROR_TEXT,
    NO_DELIVERIES,
    Counts,
    Deliveries,
    Log,
    MessageBuffer,
    Readings,
    Rows,
    Stops,
    empty_inbox,
    empty_log,
    start_capacity,
)
from vibroswarm.inference.sender_positions import NO_TRACKS, Tracks
from vibroswarm.inference.shared_deliveries import deliveries_of
from vibroswarm.networks import Network
from vibroswarm.networks import network as network_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies import Strategy

NO_VALUES: Final = read_only(np.empty(0))
"""A column of ``Readings`` that is not needed."""


class Replayer(ABC):
    """Replays some runs, in one or several calls of ``advance``, each from where the last one stopped.

    Args:
        scenario, seed: those of the runs. runs: number of runs. longest: number of samples of the longest run. rows:
            number of samples of all runs. Upper bounds will do for ``longest`` and ``rows``, as in a closed loop.
        messages, log: (rows,), written if given: the message sent at each sample, and the state after it. Both are
            given or neither, because ``MessagesReplayer`` writes no messages without a log.
        network: the network whose functions the kernel calls.
    """

    template: str
    """Name of the kernel's template, a module of this folder."""
    needs_stops: bool
    """Whether ``advance`` needs to know when robots stand."""

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
        """Generate the kernel, and allocate the robots' state (arguments: see the class).

        ``replayed`` counts the samples of each run that have been replayed. ``steering`` receives the turn (deg) and
        the leg (ms) that the strategy chooses at each sample, (rows, 2); it is 0 if the strategy does not steer.
        """
        self.strategy, self.network = strategy_used(scenario), network
        self.module = kernels(self.strategy, network, self.template)
        self.seed, self.world = seed, world_of(scenario, longest)
        self.scenario, self.swarm = scenario, empty_swarm(self.strategy, network, scenario, runs)
        self.replayed = np.zeros(runs, dtype=np.int64)
        # A log and messages without rows are not written.
        self.log = empty_log(0, self.strategy.state_type) if log is None else log
        self.messages = zero_rows(0, self.strategy.message_type) if messages is None else messages
        self.entry: Callable[..., int] | None = None  # the compiled kernel; see ``call``
        self.calls, self.is_new = 0, True  # is_new: states and arrays are zero still
        self.steering: Any = np.empty((rows, 2)) if self.strategy.steer is not None else 0

    @property
    def reads_positions(self) -> bool:
        """Whether the network reads robot positions."""
        return self.network.reads_positions

    @abstractmethod
    def arguments(self, rows: Rows, readings: Readings, stops: Stops, tracks: Tracks) -> tuple[Any, ...]:
        """Return the kernel's arguments, except its last three: ``from_start``, ``to_end`` and ``limit_s``."""

    def advance(
        self,
        rows: Rows,
        readings: Readings,
        stops: Stops,
        *,
        from_start: bool = False,
        to_end: bool = False,
        limit_s: float = np.inf,
        tracks: Tracks = NO_TRACKS,
    ) -> None:
        """Replay the samples that were added since the last call; ``swarm`` then holds the robots' new state.

        Args:
            rows, readings: all samples of the runs so far, and what the robots read. stops: when the robots stand;
                empty unless ``needs_stops``. tracks: the robots' moves; needed only if ``reads_positions``.
            from_start: begin at time 0, not where the last call stopped. to_end: also read the messages that arrive
                after the last sample. limit_s: do not replay samples after this time.
        Raises:
            CodeError: the strategy did something that strategies may not do.
        """
        status = BUFFER_FULL
        while status == BUFFER_FULL:
            if from_start:
                self.restart(rows)
            arguments = self.arguments(rows, readings, stops, tracks)
            status = self.call((*arguments, from_start, to_end, limit_s))
            if status == BUFFER_FULL:  # repeat everything with a larger buffer
                self.enlarge_buffer()
                from_start = True  # as the new buffer lacks the messages so far
        self.refuse(status)

    def refuse(self, status: int) -> None:
        """Raise an error if the kernel ended with an error code.

        Raises:
            CodeError: the strategy did something that strategies may not do.
        """
        if status != DONE:
            raise CodeError(f"strategy '{self.strategy.name}': {ERROR_TEXT[status]}")

    def enlarge_buffer(self) -> None:
        """Replace the buffer that was full by a buffer of twice its size."""
        raise NotImplementedError  # only a kernel with a buffer can say that it is full

    def restart(self, rows: Rows) -> None:
        """Prepare a replay from time 0: set failures, and zero all states and arrays, as ``begin`` expects."""
        set_failures(self.swarm, self.scenario, self.seed, rows.runs)
        if self.is_new:  # they are zero already
            self.is_new = False
            return
        # Viewed as bytes, all fields of the records are zeroed at once.
        self.swarm.states.view(np.uint8)[:] = 0
        # ``arrays`` is 0, not a tuple, if the strategy has none.
        for array in self.swarm.arrays if isinstance(self.swarm.arrays, tuple) else ():
            array[:] = 0

    def call(self, arguments: tuple[Any, ...]) -> int:
        """Call the kernel, and return its status; the arguments must have the same types at each call.

        From the third call on, the compiled function is called directly (``entry``), which is faster.
        """
        if self.entry is None:
            with translate_errors(self.strategy, self.network):
                status: int = self.module.replay(*arguments)
            self.calls += 1
            # A direct call loses the line at which an error occurred, which messages about a user's code state. So a
            # user's strategy or network is never called directly.
            if self.calls == 2 and not (self.strategy.code or self.network.code):
                self.entry = entry_for(self.module.replay, *arguments)
            return status
        try:
            return self.entry(*arguments)
        except Exception:
            with translate_errors(self.strategy, self.network):
                raise


class CountsReplayer(Replayer):
    """Replays strategies that count bits: over the networks ideal and loss, and over others if deliveries are given."""

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
        deliveries: Deliveries = NO_DELIVERIES,
    ) -> None:
        """Allocate the memory of a replay; other arguments: see ``Replayer``.

        Args:
            timeline: the samples, if all are known: which robots receive each message is then computed in advance.
                None: they are not all known.
            deliveries: deliveries of the network; needed unless the network is ideal or ``loss``.
        """
        # This kernel calls no function of a network: losses are given as a number, and deliveries as a table. So it is
        # always generated for the ideal network, and one kernel serves all networks.
        super().__init__(scenario, seed, runs, longest, rows, messages, log, network_of("ideal"))
        self.loss, self.deliveries = loss_of(scenario), deliveries
        self.reach = NO_REACH if timeline is None else timeline.reach(seed, self.loss)
        self.counts = Counts(
            messages=zero_rows(longest, self.strategy.message_type),
            zero_message=zero_rows(1, self.strategy.message_type),
            ones_sent=np.empty(longest + 1, dtype=np.int32),
            own_ones=np.empty(longest, dtype=np.int32),
            ones_reached=np.empty((longest + 1, self.reach.words.shape[1]), dtype=np.uint64),
        )

    def arguments(self, rows: Rows, readings: Readings, stops: Stops, tracks: Tracks) -> tuple[Any, ...]:
        """Return the arguments of ``replay_counts.replay``, except its last three."""
        return (
            rows, readings, self.replayed, self.swarm, self.messages, self.counts, self.log, self.steering, self.world,
            self.seed, self.loss, self.reach, self.deliveries,
        )  # fmt: skip


class MessagesReplayer(Replayer):
    """Replays every strategy over every network, message by message."""

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
        """Allocate the memory of a replay (arguments: see ``Replayer``)."""
        super().__init__(scenario, seed, runs, longest, rows, messages, log, network)
        self.robots = scenario.swarm.robots
        self.network_params, self.network_state = (
            zero_rows(1, network.params_type),
            zero_rows(1, network.state_type),
        )
        self.network_params[0] = network.params_row(scenario.network.params)
        self.network_arrays = network_arrays_for(
            self.strategy, network, scenario.network.params, sizes_of(scenario)
        )
        # Room for a message at each sample, and for seven times as many sent by timers; it is enlarged if needed.
        at_samples = longest if self.strategy.on_timer is None else 8 * longest
        self.under_way = start_capacity(self.robots)  # room for unread messages, of all receivers together
        self.buffer = self._message_buffer(at_samples + 64)

    def _message_buffer(self, room: int) -> MessageBuffer:
        """Allocate a buffer for so many messages of a run."""
        strategy, network = self.strategy, self.network
        sends, seen = network.send is not None, self.robots if network.reads_positions else 0
        return MessageBuffer(
            messages=zero_rows(room, strategy.message_type),
            sender=np.empty(room, dtype=np.int64),
            tick=np.empty(room, dtype=np.int64),
            number=np.empty(room, dtype=np.int64),
            arrival=np.empty(self.robots, dtype=np.int64) if sends else 0,
            inbox=empty_inbox(self.robots, self.under_way) if sends else 0,
            filled=np.zeros(1, dtype=np.int64),
            agreement=np.zeros(2, dtype=np.int64),
            zero_message=zero_rows(1, strategy.message_type),
            zero_state=zero_rows(1, strategy.state_type),
            zero_network_state=zero_rows(1, network.state_type),
            x_m=np.zeros(seen) if sends else 0,
            y_m=np.zeros(seen) if sends else 0,
        )

    def enlarge_buffer(self) -> None:
        """Replace the buffer of messages by an empty one with room for twice as many, sent and under way."""
        self.under_way *= 2
        self.buffer = self._message_buffer(2 * self.buffer.sender.size)

    def arguments(self, rows: Rows, readings: Readings, stops: Stops, tracks: Tracks) -> tuple[Any, ...]:
        """Return the arguments of ``replay_messages.replay``, except its last three."""
        return (
            rows, stops, readings, self.replayed, self.swarm, self.messages, self.buffer, tracks, self.log,
            self.steering, self.world, self.network_params, self.network_state, self.network_arrays,
            self.strategy.bytes_on_air, self.seed,
        )  # fmt: skip


def counts_only(strategy: Strategy) -> bool:
    """Return whether ``CountsReplayer`` can replay this strategy: it counts bits, has no timers and decides once."""
    return strategy.on_counts is not None and strategy.on_timer is None and strategy.decides == "once"


def loss_of(scenario: Scenario) -> float:
    """Return the share of messages that are lost if the network is ``loss``; 0 for all other networks."""
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
    """Return the fastest replayer that can replay a scenario's strategy over its network.

    Args:
        runs: number of runs. longest: number of samples of the longest run. rows: number of samples of all runs.
        messages, log: (rows,): message sent at each sample, and state after it; written unless None.
        timeline: all samples, if whole runs are replayed at once. Only then can deliveries be computed in advance.
    """
    network = network_of(scenario.network.name)
    # Counting requires that each robot sends at each sample and hears until the end, which a robot with a dead radio
    # does not.
    if counts_only(strategy_used(scenario)) and not scenario.faults.radio_dead:
        if network.name in ("ideal", "loss"):
            return CountsReplayer(scenario, seed, runs, longest, rows, messages, log, timeline)
        deliveries = None if timeline is None else deliveries_of(scenario, seed, timeline)
        if deliveries is not None:
            return CountsReplayer(scenario, seed, runs, longest, rows, messages, log, timeline, deliveries)
    return MessagesReplayer(scenario, seed, runs, longest, rows, messages, log, network)
