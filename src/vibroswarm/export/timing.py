"""How long a robot's program takes on its processor, and whether that fits into a control period.

A small swarm runs on an emulated processor that counts instructions (``assets/timed_program.c``). A Cortex-M0+ takes
one clock cycle for most instructions, two for loads, stores and branches that are taken, and waits for its flash; so
each is counted as ``CYCLES`` cycles of ``CLOCK_HZ``.
"""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from vibroswarm.core.numbers import number, percent, stated
from vibroswarm.export.c_library import (
    ASSETS,
    Memory,
    compile_with,
    has_compiler,
    measured,
    output_of,
    write_library,
)
from vibroswarm.scenario.scenario import Scenario, preset

EMULATOR: Final = "qemu-system-arm"
"""The emulator by which instructions are counted."""
CLOCK_HZ: Final = 48e6
"""Clock of the study's robots (SAMD21G18)."""
CYCLES: Final = 2
"""Clock cycles that an instruction is taken to need: an upper bound of the mean."""
FLASH_BYTES: Final = 256 * 1024
"""Flash of the study's robots."""
RAM_BYTES: Final = 32 * 1024
"""RAM of the study's robots."""
STACK_BYTES: Final = 4 * 1024
"""RAM that is left to the stack, drivers and radio."""
TIMED_S: Final = 60
"""Time of an inspection for which the swarm runs, s."""


@dataclass(frozen=True)
class Timing:
    """What an emulated robot does: greatest numbers of instructions of its functions."""

    passes: bool
    """Whether it passes its test of itself."""
    step: int
    """Of ``vs_step`` with the commands of the wheels: what must be done in each control period."""
    stretch: int
    """Between two calls of ``vs_poll`` while the robot works: how late a step may be."""
    work: int
    """Of the work that one control period adds."""
    waits: int
    """Until that work is done, with the work that waits before it."""
    work_per_s: int
    """Mean per second of the inspection."""

    @property
    def late_ms(self) -> float:
        """Time from the moment at which a step is due until the wheels are set, ms."""
        return ms(self.step + self.stretch)

    @property
    def load(self) -> float:
        """Share of the processor's time that work takes."""
        return ms(self.work_per_s) / 1000.0


OTHER_ROBOTS: Final = {
    "kilobot": (
        "a Kilobot",
        "its ATmega328P has 8 bits, a double of 4 bytes and 2 KiB of RAM, and the program is for 32 bits",
    ),
}
"""Robots of presets on whose processor no program runs: what they are called, and why."""


@dataclass(frozen=True)
class Exported:
    """A library that was written, and what its program takes of the robot's memory and time."""

    scenario: Scenario
    files: tuple[str, ...]
    """Paths in the folder of the library."""
    memory: Memory | None
    """None if it was not measured: the compiler is not installed, or the tool that lists sizes is missing or fails."""
    timing: Timing | None
    """None if it was not measured: compiler or emulator are not installed, or the emulator fails."""
    has_compiler: bool


def export_library(scenario: Scenario, folder: Path) -> Exported:
    """Write the library of a scenario's robots into a folder, and measure its program.

    Raises:
        InputError: the program cannot be exported. RunError: the compiler failed.
    """
    files, sources = write_library(scenario, folder), folder / "src"
    memory = measured(sources)
    timing = None if memory is None else timed(sources, scenario, memory.flags)
    return Exported(scenario, tuple(files), memory, timing, has_compiler=has_compiler())


def ms(instructions: float) -> float:
    """Return the time that instructions take, ms."""
    return 1000.0 * CYCLES * instructions / CLOCK_HZ


def other_robot(scenario: Scenario) -> tuple[str, str] | None:
    """Return the entry of ``OTHER_ROBOTS`` whose body a scenario's robots have; None if there is none."""
    for name, robot in OTHER_ROBOTS.items():
        bodies = [(one.body_radius_m, one.drive_track_m) for one in (scenario.robot, preset(name).robot)]
        if bodies[0] == bodies[1]:
            return robot
    return None


def unfit(scenario: Scenario, memory: Memory, timing: Timing | None) -> list[str]:
    """Return in words why a program does not fit the study's robots; nothing if it does.

    Args:
        timing: None if it was not measured.
    """
    found = []
    if memory.flash > FLASH_BYTES:
        found.append(f"it takes {memory.flash} bytes of flash, and there are {FLASH_BYTES}")
    if memory.ram > RAM_BYTES - STACK_BYTES:
        found.append(
            f"it takes {memory.ram} bytes of static RAM, and there are {RAM_BYTES} with {STACK_BYTES} for the stack"
        )
    if timing is not None and not timing.passes:
        found.append(
            "it fails its test of itself: with such short numbers it does other than the simulated robot"
        )
    if timing is not None and timing.late_ms > 1000.0 * scenario.tick_s:
        found.append(
            f"wheels may be set {number(timing.late_ms, 1)} ms late, with a control period of "
            f"{stated(1000.0 * scenario.tick_s)} ms"
        )
    if timing is not None and (timing.load > 0.5 or ms(timing.waits) > scenario.sample.stop_ms):
        found.append(
            f"work takes {percent(timing.load, 0)} of the time and waits up to {number(ms(timing.waits), 0)} ms: "
            f"more than half, or "
            f"longer than the stop for a sample ({stated(scenario.sample.stop_ms)} ms)"
        )
    return found


def timed(sources: Path, scenario: Scenario, flags: str) -> Timing | None:
    """Return how long the functions of the library take.

    Args:
        sources: folder ``src`` of the library. flags: of the compiler, as ``Memory.flags``.
    Returns:
        The timing; None if compiler or emulator are not installed, or the emulator fails.
    Raises:
        RunError: the compiler failed.
    """
    if not has_compiler() or shutil.which(EMULATOR) is None:
        return None
    robot = scenario.robot
    given = {
        "SECONDS": TIMED_S,
        "PERIOD_INSTRUCTIONS": int(CLOCK_HZ / CYCLES * scenario.tick_s),
        "FULL_SPEED_M_S": robot.full_speed_m_s,
        "DRIVE_TRACK_M": robot.drive_track_m,
        "TURN_TRACK_M": robot.turn_track_m,
        "RADIUS_M": robot.body_radius_m,
    }
    defined = [f"-D{name}={value!r}" for name, value in given.items()]
    with tempfile.TemporaryDirectory(prefix="vibroswarm-") as folder:
        program = Path(folder) / "program.elf"
        script = ["-T", str(ASSETS / "timed_program.ld")]
        compile_with(sources, "timed_program.c", [*flags.split(), *defined, *script], program)
        command = [
            EMULATOR, "-M", "mps2-an385", "-display", "none", "-monitor", "none", "-serial", "none",
            "-semihosting-config", "enable=on,target=native", "-icount", "shift=0", "-kernel", str(program),
        ]  # fmt: skip
        found = [int(word) for word in output_of(command).split()]
    return Timing(bool(found[0]), *found[1:]) if found else None
