"""Exported robots driven through an inspection: in Python, by gcc, and on QEMU's Cortex-M0.

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
import types
from pathlib import Path
from typing import Any

import numpy as np

from vibroswarm.export.assembly import parts_of
from vibroswarm.export.c_library import ASSETS
from vibroswarm.export.c_program import c_sources
from vibroswarm.export.parameters import HEADER_FILE, header_text
from vibroswarm.export.python_program import python_source
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies import strategy as strategy_of

HERE = Path(__file__).parent
START, STEP, SAMPLE, RECEIVE, HEAR, TIMER, TICK, TOLD, MOVED, STOPPED, ACCELERATE, OBSERVED = range(12)
STRICT = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-Wno-unused-parameter", "-ffp-contract=off")
ARM = (
    "arm-none-eabi-gcc", "-std=c99", "-Os", "-mcpu=cortex-m0", "-mthumb", "-ffunction-sections", "-fdata-sections",
    "-nostartfiles", "-Wl,--gc-sections", "--specs=nano.specs",
)  # fmt: skip


def message_fields(scenario: Scenario) -> list[str]:
    """Return the fields of a message."""
    return list(strategy_of(scenario.strategy.name).message_type.names or ())


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


def python_module(scenario: Scenario) -> types.ModuleType:
    """Return the exported Python module, with the C library's ``math``."""
    module = types.ModuleType("exported")
    exec(compile(python_source(parts_of(scenario)), "exported", "exec"), vars(module))  # noqa: S102 - our own text
    vars(module)["math"] = SameMath()
    return module


def run_in_python(scenario: Scenario, events: list[float]) -> list[float]:
    """Return what the exported Python does."""
    module, fields = python_module(scenario), message_fields(scenario)
    robot, out, numbers = module.Robot(), list[float](), iter(events)

    def content() -> Any:
        message = module.Message()
        for field in fields:
            value = next(numbers)
            setattr(message, field, value if isinstance(getattr(message, field), float) else int(value))
        return message

    def note(kind: int) -> None:
        out.extend((kind, robot.tick, robot.sends, robot.decision, robot.belief, robot.heard))
        out.extend(getattr(robot.out, field) for field in fields)

    def state() -> tuple[int, int, int]:
        return robot.walk.mode, robot.walk.legs, robot.walk.avoidances

    for kind in numbers:
        if kind == START:
            module.start(robot, int(next(numbers)), int(next(numbers)), int(next(numbers)))
        elif kind == STEP:
            before, timers = state(), robot.timers
            module.step(robot, next(numbers), next(numbers))
            if state() != before:
                out.extend((robot.tick, *state(), robot.walk.leg_ms, robot.walk.error_deg))
            if robot.timers != timers:
                note(TIMER)
        elif kind == SAMPLE:
            module.sample(robot, int(next(numbers)))
            note(SAMPLE)
        elif kind == RECEIVE:
            module.receive(robot, int(next(numbers)), int(next(numbers)), content())
        elif kind == HEAR:
            robot.tick = int(next(numbers))
            module.hear(robot, int(next(numbers)), int(next(numbers)), content())
        elif kind == TIMER:
            robot.tick = int(next(numbers))
            module.timer(robot)
            note(TIMER)
        elif kind == TICK:
            robot.tick = int(next(numbers))
        elif kind == TOLD:
            module.told_simulated(robot, next(numbers), next(numbers), next(numbers))
        elif kind == MOVED:
            module.moved(robot, *(next(numbers) for _ in range(6)))
        elif kind == STOPPED:
            module.stopped(robot)
            out.extend(robot.estimate if hasattr(robot, "estimate") else ())
        elif kind == ACCELERATE:
            module.accelerate(robot, next(numbers), next(numbers), next(numbers))
        else:
            out.append(-1 - module.observed(robot))
    return [float(value) for value in out]


def write_sources(scenario: Scenario, folder: Path) -> list[str]:
    """Write the C sources and the harness; return the definitions that it needs."""
    parts = parts_of(scenario)
    sources = c_sources(parts)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "vibroswarm.h").write_text(sources.header)
    (folder / "vibroswarm.c").write_text(sources.program)
    (folder / HEADER_FILE).write_text(header_text(scenario, parts))
    shutil.copy(ASSETS / "vibroswarm_runtime.h", folder)
    for name in ("robot_harness.c", "microbit.ld"):
        shutil.copy(HERE / name, folder)
    fields = " ".join(f"F({field})" for field in message_fields(scenario))
    return [f"-DMESSAGE_FIELDS={fields}", *(["-DHAS_PLACES"] if parts.mixture is not None else [])]


def built(scenario: Scenario, folder: Path, *, precision: int, optimise: str = "-O1") -> Path:
    """Compile the robot with gcc; return the program."""
    defined = write_sources(scenario, folder)
    program = folder / f"precision-{precision}"
    flags = [*STRICT, optimise, f"-DVS_PRECISION={precision}", *(["-fno-builtin"] if precision == 3 else [])]
    command = ["gcc", *flags, *defined, "vibroswarm.c", "robot_harness.c", "-o", str(program), "-lm"]
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


def built_for_arm(scenario: Scenario, folder: Path) -> Path:
    """Compile the robot for a Cortex-M0; return the program."""
    defined = write_sources(scenario, folder)
    command = [*ARM, *defined, "vibroswarm.c", "robot_harness.c", "-T", "microbit.ld", "-o", "m0.elf", "-lm"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
    return folder / "m0.elf"


def run_on_arm(program: Path, events: list[float]) -> list[float]:
    """Return what the robot does on QEMU's Cortex-M0."""
    folder = program.parent
    (folder / "in.bin").write_bytes(as_bytes(events))
    command = [
        "qemu-system-arm", "-M", "microbit", "-nographic", "-monitor", "none", "-serial", "none",
        "-semihosting-config", "enable=on,target=native", "-kernel", program.name,
    ]  # fmt: skip
    subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=300)
    return np.frombuffer((folder / "out.bin").read_bytes(), dtype="<f8").tolist()


class Swarm:
    """An inspection by exported Python robots, over motion and readings of a simulation.

    ``events``: what each robot is fed. ``did``: what it did, as numbers.
    """

    def __init__(self, scenario: Scenario, seed: int, samples: Any, ends: Any, readings: list[int]) -> None:
        module, self.tick_ms = python_module(scenario), scenario.run.control_period_ms
        count = scenario.swarm.robots
        self.robots = [module.Robot() for _ in range(count)]
        self.events: list[list[float]] = [[] for _ in range(count)]
        self.did: list[list[float]] = [[] for _ in range(count)]
        self.fields = message_fields(scenario)
        self.module, self.unread = module, [list[Any]() for _ in range(count)]
        for i, robot in enumerate(self.robots):
            module.start(robot, seed, 0, i)
            self.events[i] += [START, seed, 0, i]
        self.end = self.tick(max(ends["end_s"]))
        self.sample_at: dict[tuple[int, int], int] = {}
        self.stop_at: dict[tuple[int, int], int] = {}
        self.standing: set[tuple[int, int]] = set()
        rows = samples.select("robot", "stop_start_s", "time_s").iter_rows()
        for (i, stop_s, time_s), reading in zip(rows, readings, strict=True):
            first, last = self.tick(stop_s), self.tick(time_s)
            self.sample_at[i, last] = reading
            self.standing |= {(i, tick) for tick in range(first, last + 1)}
        for i, stop_s in ends.select("robot", "stop_start_s").iter_rows():
            if stop_s is not None:
                self.standing |= {(i, tick) for tick in range(self.tick(stop_s), self.end + 1)}

    def tick(self, time_s: float) -> int:
        return round(time_s * 1000.0 / self.tick_ms)

    def run(self, before: Any = None) -> None:
        """Go through all control periods. ``before`` is called with robot and tick before each sample."""
        has_timer = hasattr(self.module, "timer_of_state")
        busy = {tick for _, tick in self.sample_at}
        for tick in range(1, self.end):
            if not has_timer and tick not in busy and not any(self.unread):
                continue
            sent = [item for i in range(len(self.robots)) for item in self.period(i, tick, before)]
            for sender, number, message in sent:
                for j, unread in enumerate(self.unread):
                    if j != sender:
                        unread.append((sender, number, message))

    def period(self, i: int, tick: int, before: Any) -> list[Any]:
        """Do what robot ``i`` does at a tick; return what it sends."""
        robot, events = self.robots[i], self.events[i]
        reading = self.sample_at.get((i, tick))
        if reading is not None:
            if before is not None:
                before(i, tick)
            robot.tick = tick
            self.module.sample(robot, reading)
            events += [TICK, tick, SAMPLE, reading]
            return self.note(i, SAMPLE)
        if (i, tick) in self.standing:
            return []
        for sender, number, message in self.unread[i]:
            robot.tick = tick
            self.module.hear(robot, sender, number, message)
            content = [float(getattr(message, field)) for field in self.fields]
            events += [HEAR, tick, sender, number, *content]
        self.unread[i].clear()
        due_s = getattr(robot.state, "next_s", math.inf)
        if hasattr(self.module, "timer_of_state") and due_s * 1000.0 / self.tick_ms - 1e-9 <= tick:
            robot.tick = tick
            self.module.timer(robot)
            events += [TIMER, tick]
            return self.note(i, TIMER)
        return []

    def note(self, i: int, kind: int) -> list[Any]:
        """Note what the robot has just done; return what it sends."""
        robot = self.robots[i]
        self.did[i] += [kind, robot.tick, robot.sends, robot.decision, robot.belief, robot.heard]
        self.did[i] += [float(getattr(robot.out, field)) for field in self.fields]
        return [(i, robot.sent - 1, robot.out)] if robot.sends else []


def moves_before_samples(scenario: Scenario, seed: int, result: Any) -> list[list[tuple[int, list[float]]]]:
    """Return what each robot's localisation is told: (tick, events), those of a tick before its sample."""
    from vibroswarm.localisation.odometry import measure_moves
    from vibroswarm.robot.walk import AVOID, DRIVE, KINDS, STOP

    tick_s = scenario.tick_s
    rows = measure_moves(scenario, seed, result.moves, result.ends)
    found: list[list[tuple[int, list[float]]]] = []
    for i in range(scenario.swarm.robots):
        start = result.moves.filter(robot=i).select("x_m", "y_m", "heading_rad").row(0)
        stops = set(result.motion.filter(robot=i)["stop_start_s"].to_list())
        told: list[tuple[int, list[float]]] = [(0, [TOLD, *start])]
        own = rows.filter(robot=i)
        kinds = own["kind"].to_physical().to_list()
        assert list(KINDS)[STOP] == "stop"
        values = own.select("start_s", "duration_s", "gyro_rad", "ray_m").rows()
        for m, (start_s, duration_s, gyro_rad, ray_m) in enumerate(values):
            tick = round(start_s / tick_s)
            if kinds[m] == STOP:
                if any(abs(start_s - stop_s) < 0.5 * tick_s for stop_s in stops):
                    told.append((tick, [STOPPED]))
                continue
            after_drive = m > 0 and kinds[m - 1] == DRIVE and values[m - 1][1] > 1.5 * tick_s
            at_obstacle = m + 1 < len(kinds) and kinds[m + 1] == AVOID
            ray = math.nan if ray_m is None else ray_m
            ended = round((start_s + duration_s) / tick_s)
            told.append((ended, [MOVED, kinds[m], duration_s, gyro_rad, ray, after_drive, at_obstacle]))
        found.append(told)
    return found
