"""A library that was written, and whether its program fits the memory of the study's robots."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.export.c_library import Memory, has_compiler, measured, write_library
from vibroswarm.scenario.scenario import Scenario, preset

FLASH_BYTES: Final = 256 * 1024
"""Flash of the study's robots (SAMD21G18)."""
RAM_BYTES: Final = 32 * 1024
"""RAM of the study's robots."""
STACK_BYTES: Final = 4 * 1024
"""RAM that is left to the stack, drivers and radio."""
OTHER_ROBOTS: Final = {
    "kilobot": (
        "a Kilobot",
        "its ATmega328P has 8 bits, a double of 4 bytes and 2 KiB of RAM, and the program is for 32 bits",
    ),
}
"""Robots of presets on whose processor no program runs: what they are called, and why."""


@dataclass(frozen=True)
class Exported(NotebookView):
    """A library that was written, and what its program takes of the robot's memory."""

    scenario: Scenario
    files: tuple[str, ...]
    """Paths in the folder of the library."""
    memory: Memory | None
    """None if it was not measured: the compiler is not installed, or the tool that lists sizes is missing or fails."""
    has_compiler: bool


def export_library(scenario: Scenario, folder: Path) -> Exported:
    """Write the library of a scenario's robots into a folder, and measure its program.

    Raises:
        InputError: the program cannot be exported. RunError: the compiler failed.
    """
    files = write_library(scenario, folder)
    return Exported(scenario, tuple(files), measured(folder / "src"), has_compiler=has_compiler())


def other_robot(scenario: Scenario) -> tuple[str, str] | None:
    """Return the entry of ``OTHER_ROBOTS`` whose body a scenario's robots have; None if there is none."""
    for name, robot in OTHER_ROBOTS.items():
        bodies = [(one.body_radius_m, one.drive_track_m) for one in (scenario.robot, preset(name).robot)]
        if bodies[0] == bodies[1]:
            return robot
    return None


def unfit(memory: Memory) -> list[str]:
    """Return in words why a program does not fit the study's robots; nothing if it does."""
    found = []
    if memory.flash > FLASH_BYTES:
        found.append(f"it takes {memory.flash} bytes of flash, and there are {FLASH_BYTES}")
    if memory.ram > RAM_BYTES - STACK_BYTES:
        found.append(
            f"it takes {memory.ram} bytes of static RAM, and there are {RAM_BYTES} with {STACK_BYTES} for the stack"
        )
    return found
