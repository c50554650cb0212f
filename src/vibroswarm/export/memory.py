"""Flash and static RAM of an exported library on a Cortex-M0+, by the compiler for it if there is one."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from vibroswarm.errors import RunError
from vibroswarm.export.c_library import ASSETS

COMPILER: Final = "arm-none-eabi-gcc"
FLAGS: Final = (
    "-std=c99", "-mcpu=cortex-m0plus", "-mthumb", "-ffunction-sections", "-fdata-sections",
    "-nostartfiles", "-Wl,--gc-sections", "-Wl,-e,main", "--specs=nano.specs", "--specs=nosys.specs",
)  # fmt: skip
TRIED: Final = ("-Os", "-Os -fno-inline")
SECONDS: Final = 120


@dataclass(frozen=True)
class Memory:
    """Bytes of flash, and of static RAM, of the smallest program around one robot; its stack is not counted."""

    flash: int
    ram: int
    flags: str
    """Flags of the compiler, of those tried, that give the least flash."""


def measured(sources: Path) -> Memory | None:
    """Return the memory of the library in a folder of sources; None without the compiler.

    Raises:
        RunError: the compiler failed.
    """
    if shutil.which(COMPILER) is None:
        return None
    with tempfile.TemporaryDirectory(prefix="vibroswarm-") as folder:
        return min(
            (_measured(sources, Path(folder) / "program.elf", flags) for flags in TRIED),
            key=lambda m: m.flash,
        )


def _measured(sources: Path, program: Path, flags: str) -> Memory:
    """Compile with these flags and return the program's memory."""
    files = [str(sources / "vibroswarm.c"), str(ASSETS / "measured_program.c")]
    command = [COMPILER, *FLAGS, *flags.split(), "-I", str(sources), *files, "-o", str(program), "-lm"]
    try:
        subprocess.run(command, check=True, capture_output=True, text=True, timeout=SECONDS)
        sizes = ["arm-none-eabi-size", str(program)]
        size = subprocess.run(sizes, check=True, capture_output=True, text=True, timeout=SECONDS)
    except (OSError, subprocess.SubprocessError) as error:
        words = getattr(error, "stderr", None) or str(error)
        raise RunError(f"{COMPILER} failed: {words.strip()[:300]}") from error
    numbers = re.findall(r"^\s*(\d+)\s+(\d+)\s+(\d+)", size.stdout, re.MULTILINE)
    text, data, zeros = (int(word) for word in numbers[0])
    return Memory(text + data, data + zeros, flags)
