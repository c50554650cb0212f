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
    "-std=c99", "-mcpu=cortex-m0plus", "-mthumb", "-Os", "-ffunction-sections", "-fdata-sections",
    "-nostartfiles", "-Wl,--gc-sections", "-Wl,-e,main", "--specs=nano.specs", "--specs=nosys.specs",
)  # fmt: skip
FLASH_LIMIT: Final = 40 * 1024
SECONDS: Final = 120


@dataclass(frozen=True)
class Memory:
    """Bytes of flash, and of static RAM, of the smallest program around one robot; its stack is not counted."""

    flash: int
    ram: int


def measured(sources: Path) -> Memory | None:
    """Return the memory of the library in a folder of sources; None without the compiler.

    Raises:
        RunError: the compiler failed.
    """
    if shutil.which(COMPILER) is None:
        return None
    with tempfile.TemporaryDirectory(prefix="vibroswarm-") as folder:
        program = Path(folder) / "program.elf"
        files = [str(sources / "vibroswarm.c"), str(ASSETS / "measured_program.c")]
        command = [COMPILER, *FLAGS, "-I", str(sources), *files, "-o", str(program), "-lm"]
        try:
            subprocess.run(command, check=True, capture_output=True, text=True, timeout=SECONDS)
            size = subprocess.run(
                ["arm-none-eabi-size", str(program)],
                check=True,
                capture_output=True,
                text=True,
                timeout=SECONDS,
            )
        except (OSError, subprocess.SubprocessError) as error:
            words = getattr(error, "stderr", None) or str(error)
            raise RunError(f"{COMPILER} failed: {words.strip()[:300]}") from error
    numbers = re.findall(r"^\s*(\d+)\s+(\d+)\s+(\d+)", size.stdout, re.MULTILINE)
    text, data, zeros = (int(word) for word in numbers[0])
    return Memory(text + data, data + zeros)
