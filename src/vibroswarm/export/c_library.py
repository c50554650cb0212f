"""The folder of an exported C library: sources, a sketch for Arduino and PlatformIO, and how much memory it takes.

Memory (flash and static RAM) is measured for a Cortex-M0+, if its compiler is installed.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Final

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import RunError
from vibroswarm.export.assembly import RobotParts, parts_of
from vibroswarm.export.c_program import c_sources
from vibroswarm.export.parameters import ASSETS, HEADER_FILE, header_text, rendered
from vibroswarm.scenario.scenario import Scenario

COMMON: Final = ("vibroswarm_runtime.h", "vibroswarm_mathematics.h", "vibroswarm_radio.c")
"""Sources that are the same for every scenario."""
MARKER: Final = "library.properties"
"""The file that marks a folder as an exported library."""
COMPILER: Final = "arm-none-eabi-gcc"
"""The compiler by which memory is measured."""
SIZE_TOOL: Final = "arm-none-eabi-size"
"""The tool that lists the sizes of the compiled program."""
FLAGS: Final = (
    "-std=c99", "-mcpu=cortex-m0plus", "-mthumb", "-Os", "-ffunction-sections", "-fdata-sections",
    "-nostartfiles", "-Wl,--gc-sections", "-Wl,-e,main", "--specs=nano.specs", "--specs=nosys.specs",
)  # fmt: skip
"""Flags of the compiler: for a Cortex-M0+, without functions that are not called, and without an operating system."""
FLASH_BYTES: Final = 256 * 1024
"""Flash of the study's robots (SAMD21G18)."""
RAM_BYTES: Final = 28 * 1024
"""RAM of the study's robots without the 4 KiB that are left to the stack, drivers and radio."""


@dataclass(frozen=True)
class Memory:
    """Memory of the smallest program around one robot, in bytes; the stack is not counted."""

    flash: int
    ram: int
    """Static RAM."""

    @property
    def fits(self) -> bool:
        """Whether the study's robots have as much."""
        return self.flash <= FLASH_BYTES and self.ram <= RAM_BYTES


@dataclass(frozen=True)
class Exported(NotebookView):
    """A library that was written, and what its program takes of the robot's memory."""

    files: tuple[str, ...]
    """Paths in the folder of the library."""
    memory: Memory | None
    """None if it was not measured, because the compiler or the tool that lists sizes is missing."""


def library_files(scenario: Scenario) -> dict[str, str]:
    """Return the texts of the library's files, by their paths in its folder."""
    parts = parts_of(scenario)
    sources = c_sources(parts)
    return {
        "src/vibroswarm.h": sources.header,
        "src/vibroswarm.c": sources.program,
        **{f"src/{name}": (ASSETS / name).read_text(encoding="utf-8") for name in COMMON},
        f"src/{HEADER_FILE}": header_text(scenario, parts),
        "examples/inspection/inspection.ino": sketch_text(parts),
        MARKER: rendered(MARKER, version=version("vibroswarm"), strategy=parts.strategy.name),
        "platformio.ini": (ASSETS / "platformio.ini").read_text(encoding="utf-8"),
    }


def sketch_text(parts: RobotParts) -> str:
    """Return the sketch; robots that do not measure vibration have a function for their own sensor."""
    reads = "energy"
    if parts.has_own_sensor:
        reads = "numbers" if parts.classifier else "value" if parts.borders else "class"
    return rendered(
        "inspection.ino",
        reads=reads,
        numbers=parts.classifier.names if parts.classifier else (),
        last_class=parts.scenario.sensor.readings - 1,
    )


def export_library(scenario: Scenario, folder: Path) -> Exported:
    """Write the library of a scenario's robots into a folder, and measure its program."""
    files = library_files(scenario)
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return Exported(tuple(files), measured(folder / "src"))


def measured(sources: Path) -> Memory | None:
    """Return the memory of the library with a small program around it; None if a tool for it is missing."""
    if not (shutil.which(COMPILER) and shutil.which(SIZE_TOOL)):
        return None
    files = [*map(str, sorted(sources.glob("*.c"))), str(ASSETS / "measured_program.c")]
    with tempfile.TemporaryDirectory(prefix="vibroswarm-") as folder:
        program = str(Path(folder) / "program.elf")
        compiling = [COMPILER, *FLAGS, "-I", str(sources), *files, "-o", program, "-lm"]
        done = subprocess.run(compiling, capture_output=True, text=True, check=False)
        if done.returncode:
            raise RunError(f"{COMPILER} failed: {done.stderr.strip()[:300]}")
        sizes = subprocess.run([SIZE_TOOL, program], check=True, capture_output=True, text=True).stdout
    # The tool lists the sizes of code, of initialised data and of data that is zero at the start, below a line of
    # headings. Initialised data takes flash, for the values, and RAM.
    text, data, zeros = map(int, re.findall(r"\d+", sizes.splitlines()[1])[:3])
    return Memory(flash=text + data, ram=data + zeros)
