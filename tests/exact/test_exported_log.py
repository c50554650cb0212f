"""Round trip: exported robots on an emulated Cortex-M0 write a log, which is imported and replayed as was simulated."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from polars.testing import assert_frame_equal

from helpers.exported_robots import (
    ACCELERATE,
    RECEIVE,
    SAMPLE,
    STEP,
    Swarm,
    built_for_arm,
    measured_at_each_tick,
    needs_arm,
    written_on_arm,
)
from vibroswarm import Floor, preset, simulate
from vibroswarm.cli import main
from vibroswarm.export.c_program import LOG_COLUMNS
from vibroswarm.lab.replay import replay_recording, with_beliefs
from vibroswarm.recordings.read import CAMERA_COLUMNS
from vibroswarm.recordings.recording import Recording
from vibroswarm.robot.sensing import SenseProgram, begin_sense, energy, sense_step

SEED, READINGS = 4, 175
PLACES = ("x_m", "y_m")
FIELDS = {
    "floor.source": "random:0.28",
    "run.stop": "t_end",
    "run.t_end_s": 300.0,
    "strategy.name": "soft",
    "decision.min_observations": 40,
}
SCENARIO = preset("paper").with_values(FIELDS)


def test_the_log_has_the_columns_that_are_read() -> None:
    assert tuple(LOG_COLUMNS) == CAMERA_COLUMNS


def shaken(events: list[float], energies: list[float], fields: int) -> list[float]:
    """Events of a robot, with readings of the accelerometer before each sample whose RMS is its energy."""
    state, program = begin_sense(), SenseProgram()
    for k in range(READINGS):
        state = sense_step(state, program, float(k % 2), 0.0, 0.0)
    unit = energy(state)  # the filter is linear
    found, at, taken = list[float](), 0, 0
    lengths = {STEP: 3, SAMPLE: 2, RECEIVE: 3 + fields}
    while at < len(events):
        kind = int(events[at])
        if kind == SAMPLE:
            for k in range(READINGS):
                found += [ACCELERATE, energies[taken] / unit * (k % 2), 0.0, 0.0]
            taken += 1
        length = lengths.get(kind, 4)
        found += events[at : at + length]
        at += length
    return found


@needs_arm
def test_a_log_of_emulated_robots_is_imported_and_replayed_as_was_simulated(tmp_path: Path) -> None:
    result = simulate(SCENARIO, SEED, [0])
    readings = [result.observations.filter(robot=i)["observation"].to_list() for i in range(5)]
    swarm = Swarm(SCENARIO, SEED, measured_at_each_tick(SCENARIO, SEED, 14_999), readings)
    swarm.run()
    program = built_for_arm(SCENARIO, tmp_path / "robot", log=True)
    lines = b""
    for i, events in enumerate(swarm.whole):
        energies = result.observations.filter(robot=i)["energy"].cast(pl.Float64).to_list()
        lines += written_on_arm(program, shaken(events, energies, len(swarm.fields)))
    log = pl.read_csv((",".join(LOG_COLUMNS) + "\n").encode() + lines)
    check_log(log, result)

    # A camera sees where the robots are: these do not know.
    assert log.select(PLACES).null_count().row(0) == (log.height, log.height)
    places = result.motion.select("robot", sent="sample", x_m="x_m", y_m="y_m").cast(
        {"robot": pl.Int64, "sent": pl.Int64}
    )
    seen = log.drop(PLACES).join(places, on=["robot", "sent"]).select(LOG_COLUMNS).sort("time_s")
    seen.write_csv(tmp_path / "log.csv")
    floor = SCENARIO.floor_for(SEED, 0)
    check_replay(imported(tmp_path, floor), result)


def check_log(log: pl.DataFrame, result: Any) -> None:
    made = result.motion.join(result.observations, on=["run", "robot", "sample"]).join(
        result.inference, on=["run", "robot", "sample"]
    )
    found, made = log.sort("robot", "sent"), made.sort("robot", "sample")
    assert found.height == made.height > 150
    for ours, theirs in (
        ("robot", "robot"), ("sent", "sample"), ("observation", "observation"), ("message", "message"),
        ("alpha", "alpha"), ("beta", "beta"), ("decision", "decision"), ("messages_received", "messages_received"),
    ):  # fmt: skip
        assert found[ours].to_list() == made[theirs].to_list(), ours
    np.testing.assert_allclose(found["time_s"], made["time_s"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found["energy"], made["energy"], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(found["belief_below"], made["belief_below"], rtol=0, atol=1e-5)


def imported(folder: Path, floor: Floor) -> Recording:
    tiles = "\n".join(" ".join(str(int(tile)) for tile in row) for row in floor.tiles)
    (folder / "floor.txt").write_text(tiles + "\n")
    stated = [
        f"{name}={getattr(getattr(SCENARIO, name.split('.')[0]), name.split('.')[1])}"
        for name in (
            "sensor.rms_threshold",
            "decision.min_observations",
            "decision.gate",
            "decision.credible_threshold",
        )
    ]
    options = [word for pair in stated for word in ("--set", pair)]
    arguments = [
        str(folder / "log.csv"),
        "--floor",
        str(folder / "floor.txt"),
        "--tiles",
        "5x5",
        "--any-floor",
    ]
    assert (
        main(["lab", "import", *arguments, "--strategy", "soft", *options, "--out", str(folder / "lab")]) == 0
    )
    return Recording.read(folder / "lab")


def check_replay(recording: Recording, result: Any) -> None:
    scenario = recording.scenario.with_values({"strategy.name": "soft"})
    uncounted = recording.inference.with_columns(
        messages_received=pl.lit(None, pl.UInt32)
    )  # so that all are heard
    found = with_beliefs(replace(recording, scenario=scenario, inference=uncounted), SEED).inference
    assert_frame_equal(found, result.inference.select(found.columns), check_exact=True)
    replayed = replay_recording(recording, scenario, draws=1, seed=SEED)
    assert replayed.robots["decision"].to_list() == result.robots["decision"].to_list()
    assert 0 in result.robots["decision"]
