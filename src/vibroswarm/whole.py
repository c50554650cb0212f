"""The whole run, messages in the loop: the fixed-step engine with sampling minds and a radio.

It is what a strategy needs that changes how robots move or when they stop. For the replayable ones it
gives the same tables as motion, observation and inference one after the other, and a test holds it to that.
A period is sense, control, listen, move, contact, sample, communicate.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.compiled import kernel, zero_rows
from vibroswarm.draws import ALONE, MESSAGE, uniform
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.minds import MIND, begin_minds, final_frame, hear, mind_program, take_sample
from vibroswarm.inference.replay import Columns, empty_columns, inference_frame, write_row
from vibroswarm.motion.body import Setup, give_each, setup_of, speed_quantiles
from vibroswarm.motion.contract import Motion
from vibroswarm.motion.phases import ROBOT, Swarm, account, begin, contact, control, move, refresh, sense
from vibroswarm.motion.record import Record, Rows, empty_record, end_rows, tables, write_sample
from vibroswarm.observation.felt import factors_differ
from vibroswarm.observation.ground import Ground, grounds_of, read
from vibroswarm.observation.model import OBSERVATIONS, sensing_numbers, vibrating_at
from vibroswarm.observation.reading import energies_of
from vibroswarm.robot.walk import STOP
from vibroswarm.scenario import Scenario
from vibroswarm.strategies.belief_table import Beliefs, beliefs
from vibroswarm.strategies.program import MindProgram


class Radio(NamedTuple):
    """Messages in the order of sending, (room,) each; and how many there are, (1,)."""

    senders: NDArray[np.uint16]
    samples: NDArray[np.uint32]
    bits: NDArray[np.uint8]
    total: NDArray[np.int64]
    loss: float


class Notes(NamedTuple):
    """What is written down beside the motion: (room,) of the inference table; (room, 4) of
    tile, bit, tile felt and row of factors."""

    inference: Columns
    observations: NDArray[np.int64]


@kernel
def listen(swarm: Swarm, minds: NDArray[np.void], radio: Radio, seed: int, run: int) -> None:
    """Robots that walk read what was sent before this tick: all that is there, for nothing was sent in it yet."""
    for i in range(swarm.size):
        if swarm[i].mode != STOP:
            hear(minds, i, radio.total[0], radio.senders, radio.samples, radio.bits, seed, run, radio.loss)


@kernel
def sample_and_communicate(
    swarm: Swarm, setup: Setup, speeds: NDArray[np.float64], ground: Ground, minds: NDArray[np.void],
    radio: Radio, record: Record, notes: Notes, program: MindProgram, beliefs: Beliefs,
    seed: int, run: int, tick: int,
) -> None:  # fmt: skip
    """Robots whose stop is over observe, update, test, compose and send, in index order."""
    for i in range(swarm.size):
        if not swarm[i].sampled:
            continue
        k, index = record.filled[0], swarm[i].samples - 1
        tile, bit, felt, row = read(ground, swarm[i].x_m, swarm[i].y_m, seed, run, i, index)
        u = uniform(seed, run, i, MESSAGE, index, ALONE)
        message = take_sample(minds, i, k, bit, u, program, beliefs, True)
        notes.observations[k, 0], notes.observations[k, 1] = tile, bit
        notes.observations[k, 2], notes.observations[k, 3] = felt, row
        write_row(notes.inference, k, minds, i)
        radio.senders[k], radio.samples[k], radio.bits[k] = i, index, message
        radio.total[0] += 1
        write_sample(record, swarm, run, i, tick)
        refresh(swarm, setup, speeds, seed, run, i, tick)


@kernel
def all_decided(minds: NDArray[np.void]) -> bool:
    """Whether no robot is undecided."""
    undecided = 0
    for i in range(minds.size):
        undecided += minds[i].decision == -1
    return undecided == 0


@kernel
def run_whole(
    swarm: Swarm, setup: Setup, speeds: NDArray[np.float64], ground: Ground,
    minds: NDArray[np.void], radio: Radio, record: Record, notes: Notes, program: MindProgram,
    beliefs: Beliefs, seed: int, run: int, until: int, stop_early: bool,
) -> int:  # fmt: skip
    """A run from tick 1 to ``until``, or until the last robot has decided; gives the tick reached."""
    for tick in range(1, until):
        sense(swarm, setup)
        sampling = control(swarm, setup, seed, run, tick)
        listen(swarm, minds, radio, seed, run)
        move(swarm, setup)
        contact(swarm, setup)
        if sampling > 0:
            sample_and_communicate(
                swarm, setup, speeds, ground, minds, radio, record, notes, program, beliefs, seed, run, tick
            )
        account(swarm)
        if stop_early and sampling > 0 and all_decided(minds):
            return tick + 1
    return until


def whole_run(
    scenario: Scenario, seed: int, run: int, floor: Floor
) -> tuple[Motion, pl.DataFrame, pl.DataFrame, pl.DataFrame]:
    """Motion, observation table, inference table and final posteriors of one run, made in one loop."""
    robots, ticks = scenario.swarm.robots, scenario.ticks
    setup, speeds = setup_of(scenario), speed_quantiles(scenario.robot)
    tick_ms = scenario.run.control_period_ms
    between = 1 + int(scenario.sample.sample_interval_ms // tick_ms) + int(scenario.sample.stop_ms // tick_ms)
    room = robots * (ticks // between + 2)
    swarm, minds = zero_rows(robots, ROBOT), zero_rows(robots, MIND)
    radio = Radio(
        np.zeros(room, dtype=np.uint16), np.zeros(room, dtype=np.uint32), np.zeros(room, dtype=np.uint8),
        np.zeros(1, dtype=np.int64), scenario.network.loss,
    )  # fmt: skip
    record = empty_record(robots, room, 0)
    notes = Notes(empty_columns(room), np.zeros((room, 4), dtype=np.int64))
    program = mind_program(scenario)
    known = beliefs(program.boundary, program.prior_alpha + program.prior_beta + room)
    begin(swarm, setup, speeds, seed, run)
    give_each(swarm, scenario)
    begin_minds(minds, program)
    (ground,) = grounds_of(scenario, seed, [run], {run: floor})
    end = run_whole(
        swarm, setup, speeds, ground, minds, radio, record, notes, program, known,
        seed, run, ticks, scenario.run.stop == "all_decided",
    )  # fmt: skip
    count = int(record.filled[0])
    motion = tables(
        [Rows(record.samples[:count], None, end_rows(swarm, run, end))], scenario.run.control_period_ms
    )
    observations = _observation_frame(
        scenario, seed, floor, ground, motion.samples, notes.observations[:count]
    )
    inference = inference_frame(motion.samples, notes.inference)
    finals = final_frame(motion.ends, minds, motion.samples["time_s"].to_numpy())
    return motion, observations, inference, finals


def _observation_frame(
    scenario: Scenario,
    seed: int,
    floor: Floor,
    ground: Ground,
    samples: pl.DataFrame,
    notes: NDArray[np.int64],
) -> pl.DataFrame:
    """The observation table; the energies are those of the numbers that gave the bits."""
    tile, bit, felt, row = notes.T
    u = sensing_numbers(seed, *(samples[name].to_numpy() for name in ("run", "robot", "sample")))
    factors = ground.response.factors[row] if factors_differ(scenario.sensor) else None
    energy = energies_of(scenario.sensor, vibrating_at(floor, felt), u, factors)
    return samples.select("run", "robot", "sample").with_columns(
        tile=pl.Series(tile, dtype=OBSERVATIONS["tile"]),
        energy=pl.Series(energy),
        observation=pl.Series(bit.astype(np.uint8)),
    )
