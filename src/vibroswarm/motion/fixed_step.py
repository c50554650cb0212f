"""The fixed-step engine: every control period of every robot in turn. It is simple, and the reference for tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import kernel
from vibroswarm.motion.control_step import Swarm, account, contact, control, move, refresh, sense
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.recorder import Record, note_moves, room, write_sample
from vibroswarm.motion.robot_params import Setup
from vibroswarm.motion.source import Source, register


@kernel
def step(
    swarm: Swarm,
    setup: Setup,
    speeds: NDArray[np.float64],
    record: Record,
    seed: int,
    run: int,
    tick: int,
) -> None:
    """Simulate one control period, from ``tick`` to the next, and write what happened at ``tick`` into ``record``."""
    sense(swarm, setup)
    sampling = control(swarm, setup, seed, run, tick)
    move(swarm, setup)
    contact(swarm, setup)
    if record.moves.size > 0:  # True: the robots have moved already, so moves start from the poses before
        note_moves(record.moves, record.under_way, record.filled, swarm, setup, run, tick, True)
    # Before ``account``: the control period that begins with a sample counts towards the next sample.
    if sampling > 0:
        sample(swarm, setup, speeds, record, seed, run, tick)
    account(swarm)


@kernel
def sample(
    swarm: Swarm, setup: Setup, speeds: NDArray[np.float64], record: Record, seed: int, run: int, tick: int
) -> None:
    """Record the samples taken at this tick, and update speed, veer and battery of the robots that took them."""
    for i in range(swarm.size):
        if swarm[i].sampled:
            write_sample(record, swarm, run, i, tick)
            refresh(swarm, setup, speeds, seed, run, i, tick)


@kernel
def steps(
    swarm: Swarm,
    setup: Setup,
    speeds: NDArray[np.float64],
    record: Record,
    seed: int,
    run: int,
    tick: int,
    until: int,
) -> int:
    """Simulate from ``tick`` up to ``until``, or while the buffers of ``record`` have room; return the tick reached."""
    until = min(until, tick + room(record, swarm.size))
    for now in range(tick, until):
        step(swarm, setup, speeds, record, seed, run, now)
    return max(tick, until)  # nothing has been simulated if ``until`` is not after ``tick``


class FixedStepRun(KernelRun):
    """A run simulated by the fixed-step engine (``MotionState``)."""

    def move_on(self, until: int) -> int:
        """Simulate up to the tick ``until``, or until the buffers might overflow; return the tick reached."""
        return steps(self.swarm, self.setup, self.speeds, self.record, self.seed, self.run, self.tick, until)


FIXED_STEP = register(
    Source("fixed-step", FixedStepRun, "every control period, one after the other", is_ours=True)
)
