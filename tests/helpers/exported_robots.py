"""The robots' program driven through an inspection: as plain Python, exported by gcc, and on QEMU's Cortex-M0.

All are fed the same events of one robot: what it measured, and what the others sent. If each then does what it did in
the simulation, all do together.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import math
import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.plain_program import plain_program
from vibroswarm import sensors, strategies
from vibroswarm.export.assembly import parts_of
from vibroswarm.export.c_library import COMMON
from vibroswarm.export.c_program import c_sources
from vibroswarm.export.parameters import ASSETS, HEADER_FILE, header_text
from vibroswarm.robot.walk import STOP
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies import strategy as strategy_of

HERE = Path(__file__).parent
SOURCES = ("vibroswarm.c", "robot_harness.c")
LOG_SOURCE = "vibroswarm_radio.c"
START, STEP, SAMPLE, RECEIVE, HEAR, TIMER, TICK, ACCELERATE, OBSERVED = range(9)
NOT_EXPORTED = ("places", "explore", "fading")
"""Strategies of the package that read places or steer."""
EXPORTED = [name for name in strategies.names() if name not in NOT_EXPORTED]
STRICT = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off")
ARM = (
    "arm-none-eabi-gcc", "-std=c99", "-Os", "-mcpu=cortex-m0", "-mthumb", "-ffunction-sections", "-fdata-sections",
    "-nostartfiles", "-Wl,--gc-sections", "--specs=nano.specs",
)  # fmt: skip

HAS_ARM = shutil.which("arm-none-eabi-gcc") is not None and shutil.which("qemu-system-arm") is not None
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
needs_arm = pytest.mark.skipif(
    not HAS_ARM,
    reason="arm-none-eabi-gcc or qemu-system-arm is not installed (Debian: gcc-arm-none-eabi, "
    "libnewlib-arm-none-eabi, qemu-system-arm)",
)


def message_fields(scenario: Scenario) -> list[str]:
    """Return the fields of a message."""
    return list(parts_of(scenario).strategy.message_type.names or ())


class SameMath:
    """``math`` with the C library's functions, which gcc's programs call too: Python has a log-gamma of its own."""

    def __init__(self) -> None:
        library = ctypes.CDLL(ctypes.util.find_library("m"))
        for name in (
            "exp",
            "log",
            "log1p",
            "sin",
            "cos",
            "tan",
            "atan",
            "erf",
            "erfc",
            "lgamma",
            "atan2",
            "pow",
        ):
            function = getattr(library, name)
            function.restype = ctypes.c_double
            function.argtypes = [ctypes.c_double] * (2 if name in ("atan2", "pow") else 1)
            setattr(self, name, function)

    def __getattr__(self, name: str) -> Any:
        return getattr(math, name)


GENERATED: dict[str, dict[str, str]] = {}
"""Texts of the sources that are generated, by the hash of their scenario: a robot is compiled several times."""
SHIPPED = frozenset((*strategies.names(), *sensors.names()))
"""Strategies and sensors whose code does not change while tests run, as that of files may."""


def generated(scenario: Scenario) -> dict[str, str]:
    """Return the texts of the sources that are generated, by name."""
    if {scenario.strategy.name, scenario.sensor.model} <= SHIPPED and scenario.hash in GENERATED:
        return GENERATED[scenario.hash]
    parts = parts_of(scenario)
    sources = c_sources(parts, for_tests=True)
    texts = {"vibroswarm.h": sources.header, "vibroswarm.c": sources.program}
    GENERATED[scenario.hash] = texts | {HEADER_FILE: header_text(scenario, parts)}
    return GENERATED[scenario.hash]


def write_sources(scenario: Scenario, folder: Path) -> list[str]:
    """Write the C sources and the harness; return the definitions that it needs."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in generated(scenario).items():
        (folder / name).write_text(text)
    for name in COMMON:
        shutil.copy(ASSETS / name, folder)
    for name in ("robot_harness.c", "microbit.ld"):
        shutil.copy(HERE / name, folder)
    fields = " ".join(f"F({field})" for field in message_fields(scenario))
    return [f"-DMESSAGE_FIELDS={fields}"]


def built(scenario: Scenario, folder: Path, *, precision: int, optimise: str = "-O1") -> Path:
    """Compile the robot with gcc; return the program."""
    defined = write_sources(scenario, folder)
    program = folder / f"precision-{precision}"
    flags = [*STRICT, optimise, f"-DVS_PRECISION={precision}", *(["-fno-builtin"] if precision == 3 else [])]
    command = ["gcc", *flags, *defined, *SOURCES, "-o", str(program), "-lm"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
    return program


def as_bytes(events: list[float]) -> bytes:
    """Return numbers as the harness reads them."""
    return struct.pack(f"<{len(events)}d", *events)


def run_program(program: Path, events: list[float]) -> list[float]:
    """Return what a program of gcc does."""
    done = subprocess.run(
        [str(program)], input=as_bytes(events), check=True, capture_output=True, timeout=300
    )
    return np.frombuffer(done.stdout, dtype="<f8").tolist()


def built_for_arm(scenario: Scenario, folder: Path, *, log: bool = False) -> Path:
    """Compile the robot for a Cortex-M0; return the program, which writes events, or else the lines of the log."""
    defined = write_sources(scenario, folder)
    if log:
        defined += ["-DLOG", LOG_SOURCE]
    command = [*ARM, *defined, *SOURCES, "-T", "microbit.ld", "-o", "m0.elf", "-lm"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
    return folder / "m0.elf"


def run_on_arm(program: Path, events: list[float]) -> list[float]:
    """Return what the robot does on QEMU's Cortex-M0."""
    return np.frombuffer(written_on_arm(program, events), dtype="<f8").tolist()


def written_on_arm(program: Path, events: list[float]) -> bytes:
    """Return what the harness writes on QEMU's Cortex-M0."""
    folder = program.parent
    (folder / "in.bin").write_bytes(as_bytes(events))
    command = [
        "qemu-system-arm", "-M", "microbit", "-nographic", "-monitor", "none", "-serial", "none",
        "-semihosting-config", "enable=on,target=native", "-kernel", program.name,
    ]  # fmt: skip
    subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=300)
    return (folder / "out.bin").read_bytes()


class Swarm:
    """An inspection by robots of the plain program that measure what those of a simulation measured.

    ``whole``: what each robot is fed, period by period. ``short``: the same without the walk, by what it heard, its
    samples and its timers. ``walked``: what it did for ``whole``. ``did``: likewise for ``short``.
    """

    def __init__(
        self, scenario: Scenario, seed: int, measured: np.ndarray[Any, Any], readings: list[list[int]]
    ) -> None:
        """Make the robots.

        Args:
            measured: as ``measured_at_each_tick`` returns it. readings: of each robot's samples.
        """
        self.standing = np.zeros(measured.shape[:2], dtype=bool)  # at each tick from 1 on, of each robot
        self.sampling = np.zeros(measured.shape[:2], dtype=bool)
        self.module, self.fields = plain_program(parts_of(scenario), SameMath()), message_fields(scenario)
        self.has_timer = strategy_of(scenario.strategy.name).on_timer is not None
        self.measured, self.readings = measured, readings
        self.robots = [self.module.Robot() for _ in readings]
        self.whole: list[list[float]] = [[] for _ in readings]
        self.short: list[list[float]] = [[] for _ in readings]
        self.walked: list[list[float]] = [[] for _ in readings]
        self.did: list[list[float]] = [[] for _ in readings]
        for i, robot in enumerate(self.robots):
            self.module.start(robot, seed, 0, i)
            for events in (self.whole[i], self.short[i]):
                events += [START, seed, 0, i]
        hear = self.module.hear

        def note_heard(robot: Any, sender: int, number: int, message: Any) -> None:
            content = [float(getattr(message, field)) for field in self.fields]
            self.short[robot.number] += [HEAR, robot.tick, sender, number, *content]
            hear(robot, sender, number, message)

        vars(self.module).update(hear=note_heard)

    def run(self) -> None:
        """Go through all control periods."""
        for row in self.measured.tolist():
            self.deliver([item for i, (gyro, ray) in enumerate(row) for item in self.period(i, gyro, ray)])

    def run_as(self, other: Swarm) -> None:
        """Go through the control periods of robots that walked and sampled as those of another inspection."""
        has_timer = self.has_timer
        sampling, standing = other.sampling, other.standing
        busy = set((np.flatnonzero(sampling.any(axis=1)) + 1).tolist())
        for tick in range(1, sampling.shape[0] + 1):
            if has_timer or tick in busy or any(robot.waiting for robot in self.robots):
                at, stands = sampling[tick - 1], standing[tick - 1]
                self.deliver(
                    [x for i in range(at.size) for x in self.event(i, tick, at[i], stands[i], has_timer)]
                )

    def event(self, i: int, tick: int, samples: bool, stands: bool, has_timer: bool) -> list[Any]:
        """Do what robot ``i`` does at a tick, but for its walk; return what it sends."""
        robot = self.robots[i]
        robot.tick, robot.sends = tick, False
        if samples:
            self.sample(i)
        elif not stands:
            self.module.read_inbox(robot)
            due = has_timer and robot.state.next_s * 1000.0 / robot.world.tick_ms - 1e-9 <= tick
            if due:
                self.module.timer(robot)
                self.short[i] += [TIMER, tick]
                self.note(i, TIMER)
        return [(i, robot.sent - 1, robot.out)] if robot.sends else []

    def deliver(self, sent: list[Any]) -> None:
        """Hand messages to all other robots."""
        for sender, number, message in sent:
            content = [float(getattr(message, field)) for field in self.fields]
            for j, robot in enumerate(self.robots):
                if j != sender:
                    assert self.module.receive(robot, sender, number, message)
                    self.whole[j] += [RECEIVE, sender, number, *content]

    def period(self, i: int, gyro_deg: float, ray_mm: float) -> list[Any]:
        """Do a control period of robot ``i``; return what it sends."""
        robot = self.robots[i]
        mode, legs, avoidances, timers = robot.walk.mode, robot.walk.legs, robot.walk.avoidances, robot.timers
        self.whole[i] += [STEP, gyro_deg, ray_mm]
        samples = self.module.step(robot, gyro_deg, ray_mm)
        walk = robot.walk
        if (mode, legs, avoidances) != (walk.mode, walk.legs, walk.avoidances):
            row = [robot.tick, walk.mode, walk.legs, walk.avoidances, walk.leg_ms, walk.error_deg]
            self.walked[i] += row
        self.standing[robot.tick - 1, i], self.sampling[robot.tick - 1, i] = walk.mode == STOP, samples
        if robot.timers != timers:
            self.short[i] += [TIMER, robot.tick]
            self.note(i, TIMER)
        elif samples:
            self.sample(i)
        return [(i, robot.sent - 1, robot.out)] if robot.sends else []

    def sample(self, i: int) -> None:
        """Let robot ``i`` sample."""
        robot = self.robots[i]
        reading = self.readings[i][robot.samples]
        self.module.sample(robot, reading)
        self.whole[i] += [SAMPLE, reading]
        self.short[i] += [TICK, robot.tick, SAMPLE, reading]
        self.note(i, SAMPLE)

    def note(self, i: int, kind: int) -> None:
        """Note what the robot has just done."""
        robot = self.robots[i]
        row = [kind, robot.tick, robot.sends, robot.decision, robot.belief, robot.heard]
        row += [float(getattr(robot.out, field)) for field in self.fields]
        for noted in (self.did, self.walked):
            noted[i] += row


def rows(numbers: list[float], swarm: Swarm) -> np.ndarray[Any, Any]:
    """Events: kind, tick, sends, decision, belief, heard, message."""
    return np.array(numbers).reshape(-1, 6 + len(swarm.fields))


def check_events(found: list[float], expected: list[float], swarm: Swarm) -> None:
    ours, theirs = rows(found, swarm), rows(expected, swarm)
    np.testing.assert_array_equal(ours[:, [0, 1, 2, 3, 5]], theirs[:, [0, 1, 2, 3, 5]])
    np.testing.assert_allclose(ours[:, 4], theirs[:, 4], rtol=0, atol=1e-5)


def measured_at_each_tick(scenario: Scenario, seed: int, ticks: int) -> np.ndarray[Any, Any]:
    """Return what robots of the fixed-step engine measure from tick 1 on, (ticks, robots, 2): gyro, deg; ray, mm."""
    from vibroswarm.core.jit import entry_for
    from vibroswarm.motion.fixed_step import FixedStepRun, steps

    run = FixedStepRun(scenario)
    run.begin(seed, 0)
    run.tick = 1  # at 0 they stand
    found = np.empty((ticks, scenario.swarm.robots, 2))
    arguments = (run.swarm, run.setup, run.speeds, run.record, seed, 0)
    entry = entry_for(steps, *arguments, 0, 1)
    for k in range(ticks):
        found[k, :, 0] = run.swarm["gyro_deg"]
        assert entry(*arguments, run.tick, run.tick + 1) == run.tick + 1
        run.tick += 1
        found[k, :, 1] = run.swarm["nearest_mm"]
    return found
