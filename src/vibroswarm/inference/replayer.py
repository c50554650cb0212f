"""Replayers: the state of the robots of some runs, with the kernel that replays their strategy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import entry_for, read_only, zero_rows
from vibroswarm.core.user_code import errors_in
from vibroswarm.errors import CodeError
from vibroswarm.inference.agents import empty_swarm, set_failures, sizes_of, strategy_used, world_of
from vibroswarm.inference.deliveries import NO_TRACKS, Tracks
from vibroswarm.inference.generated_kernels import kernels, network_arrays_for
from vibroswarm.inference.replay_arrays import (
    BUFFER_FULL,
    DONE,
    ERROR_TEXT,
    Log,
    MessageBuffer,
    Readings,
    Rows,
    Stops,
    empty_inbox,
    empty_log,
)
from vibroswarm.networks import Network
from vibroswarm.networks import network as network_of
from vibroswarm.scenario.scenario import Scenario

NO_VALUES: Final = read_only(np.empty(0))
"""A column of ``Readings`` that is not needed."""


class Replayer:
    """Replays some runs, in one or several calls of ``advance``, each from where the last one stopped.

    Args:
        scenario, seed: those of the runs. runs: number of runs. longest: number of samples of the longest run. rows:
            number of samples of all runs. Upper bounds will do for ``longest`` and ``rows``, as in a closed loop.
        messages, log: (rows,), written if given: the message sent at each sample, and the state after it. Both are
            given or neither.
        lists_arrivals: whether ``buffer`` lists when each message of the last run arrives.
        network, network_params: take the place of the scenario's.
    """

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        *,
        runs: int,
        longest: int,
        rows: int,
        messages: NDArray[np.void] | None = None,
        log: Log | None = None,
        lists_arrivals: bool = False,
        network: Network | None = None,
        network_params: Any = None,
    ) -> None:
        """Generate the kernel, and allocate the robots' state (arguments: see the class)."""
        params = scenario.network.params if network is None else network_params
        self.strategy, self.network = strategy_used(scenario), network or network_of(scenario.network.name)
        strategy, network = self.strategy, self.network
        self.module = kernels(strategy, network)
        self.seed, self.world = seed, world_of(scenario, longest)
        self.scenario, self.swarm = scenario, empty_swarm(strategy, network, scenario, runs)
        self.replayed, self.decided_s = np.zeros(runs, dtype=np.int64), np.full(runs, np.inf)
        self.no_limits = np.full(runs, np.inf)
        # A log and messages without rows are not written.
        self.log = empty_log(0, strategy.state_type) if log is None else log
        self.messages = zero_rows(0, strategy.message_type) if messages is None else messages
        self.entry: Callable[..., int] | None = None  # the compiled kernel; see ``call``
        self.calls, self.is_new = 0, True  # is_new: states and arrays are zero still
        self.steering: Any = np.empty((rows, 2)) if strategy.steer is not None else 0
        self.robots, self.lists_arrivals = scenario.swarm.robots, lists_arrivals
        self.network_params, self.network_state = (
            zero_rows(1, network.params_type),
            zero_rows(1, network.state_type),
        )
        self.network_params[0] = network.params_row(params)
        self.network_arrays = network_arrays_for(strategy, network, params, sizes_of(scenario))
        # Room for a message at each sample, and for seven times as many sent by timers; it is enlarged if needed.
        at_samples = longest if strategy.on_timer is None else 8 * longest
        # Room for one unread message from each robot to each other robot, but for 2^19 (16 MiB) at most; it is enlarged
        # if needed.
        self.under_way = min(self.robots * self.robots, 2**19) + 64
        self.buffer = self._message_buffer(at_samples + 64)

    def advance(
        self,
        rows: Rows,
        readings: Readings,
        stops: Stops,
        *,
        from_start: bool = False,
        to_end: bool = False,
        limits_s: NDArray[np.float64] | None = None,
        tracks: Tracks = NO_TRACKS,
    ) -> None:
        """Replay the samples that were added since the last call; ``swarm`` then holds the robots' new state."""
        status = BUFFER_FULL
        while status == BUFFER_FULL:
            if from_start:
                self.restart(rows)
            status = self.call(
                rows, stops, readings, self.replayed, self.swarm, self.messages, self.buffer, tracks, self.log,
                self.steering, self.world, self.network_params, self.network_state, self.network_arrays,
                self.strategy.bytes_on_air, self.seed, self.decided_s, from_start, to_end,
                self.no_limits if limits_s is None else limits_s,
            )  # fmt: skip
            if status == BUFFER_FULL:  # repeat everything with a larger buffer
                self.under_way *= 2
                self.buffer = self._message_buffer(2 * self.buffer.sender.size)
                from_start = True  # as the new buffer lacks the messages so far
        if status != DONE:
            raise CodeError(f"strategy '{self.strategy.name}': {ERROR_TEXT[status]}")

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

    def call(self, *arguments: Any) -> int:
        """Call the kernel, and return its status; from the third call on without Numba's dispatch."""
        if self.entry is not None:
            return self.entry(*arguments)
        code = self.strategy.code or self.network.code
        with errors_in(code):
            status: int = self.module.replay(*arguments)
        self.calls += 1
        # A direct call loses the line at which an error occurred, which messages about a user's code state. So a
        # user's strategy or network is never called directly.
        if self.calls == 2 and not code:
            self.entry = entry_for(self.module.replay, *arguments)
        return status

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
            ones=np.empty(room + 1, dtype=np.int64),
            arrivals=np.empty((room, self.robots) if self.lists_arrivals else (0, 0), dtype=np.int64),
            agreement=np.zeros(2, dtype=np.int64),
            zero_message=zero_rows(1, strategy.message_type),
            zero_state=zero_rows(1, strategy.state_type),
            zero_network_state=zero_rows(1, network.state_type),
            x_m=np.zeros(seen) if sends else 0,
            y_m=np.zeros(seen) if sends else 0,
        )
