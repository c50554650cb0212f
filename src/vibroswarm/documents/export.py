"""The documents of an export: what was written, and how an exported header differs from a scenario."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import polars as pl

from vibroswarm.core.numbers import count
from vibroswarm.export.c_library import COMPILER, FLASH_BYTES, RAM_BYTES, SIZE_TOOL, Exported
from vibroswarm.show.document import Document, Table


def export_document(found: Exported) -> Document:
    """Return what was exported, how much memory a robot's program takes, and whether that fits the robots."""
    memory = found.memory
    answer = [f"Size not measured: {COMPILER} or {SIZE_TOOL} is not installed (Debian: gcc-arm-none-eabi)."]
    if memory is not None:
        answer = [
            f"Size on a Cortex-M0+: {memory.flash} bytes of flash, {memory.ram} bytes of static RAM, with the "
            "mathematics, without your drivers and stack."
        ]
        if not memory.fits:
            answer.append(f"NOT FIT for the study's robots: at most {FLASH_BYTES} and {RAM_BYTES} bytes.")
    return Document(
        title="Exported program",
        answer=tuple(answer),
        data={
            "files": pl.DataFrame({"file": list(found.files)}),
            "memory": pl.DataFrame([] if memory is None else [asdict(memory)]),
        },
    )


def differences_document(header: str, different: Sequence[tuple[str, str, str]]) -> Document:
    """Return how an exported header differs from a scenario.

    Args:
        different: of ``export.parameters.differences``.
    """
    rows = pl.DataFrame(
        different, schema=dict.fromkeys(("name", "header", "scenario"), pl.String), orient="row"
    )
    words = (
        f"{header} differs from the scenario in {count(len(different), 'field or constant', 'fields and constants')}."
        if different
        else f"{header} is that of the scenario."
    )
    return Document(
        title="Header and scenario",
        answer=(words,),
        parts=(Table(rows, name="differences"),) if different else (),
        data={"differences": rows},
    )
