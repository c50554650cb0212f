"""The reports of an export: what was written, and how an exported header differs from a scenario."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import polars as pl

from vibroswarm.core.numbers import count
from vibroswarm.export.c_library import COMPILER, FLASH_BYTES, RAM_BYTES, SIZE_TOOL, Exported
from vibroswarm.report.report import Report, Table, report


@report.register
def of_export(exported: Exported) -> Report:
    """Return what was exported, how much memory a robot's program takes, and whether that fits the robots."""
    memory = exported.memory
    files = {"files": Table(pl.DataFrame({"file": list(exported.files)}), "Files", folded=True)}
    if memory is None:
        answer = f"Size not measured: {COMPILER} or {SIZE_TOOL} is not installed (Debian: gcc-arm-none-eabi)."
        return Report("Exported program", (answer,), files)
    answer = (
        f"{memory.flash} bytes of flash and {memory.ram} bytes of RAM on a Cortex-M0+, without your drivers."
    )
    too_large = f"It does not fit the robots: {FLASH_BYTES} bytes of flash and {RAM_BYTES} of RAM."
    parts = {"memory": Table(pl.DataFrame([asdict(memory)]), "Memory", folded=True), **files}
    return Report("Exported program", (answer,), parts, warnings=() if memory.fits else (too_large,))


def of_differences(header: str, different: Sequence[tuple[str, str, str]]) -> Report:
    """Return how an exported header differs from a scenario (``export.parameters.differences``)."""
    schema = dict.fromkeys(("name", "header", "scenario"), pl.String)
    frame = pl.DataFrame(different, schema=schema, orient="row")
    answer = f"{header}: {count(frame.height, 'difference')} from the scenario."
    return Report("Header and scenario", (answer,), {"differences": Table(frame)})
