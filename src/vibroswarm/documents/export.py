"""The documents of an export: what was written, and how an exported header differs from a scenario."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import polars as pl

from vibroswarm.core.numbers import count
from vibroswarm.export.c_library import COMPILER, SIZE_TOOL, Memory
from vibroswarm.export.exported import Exported, other_robot, unfit
from vibroswarm.show.document import Document, Table


def export_document(found: Exported) -> Document:
    """Return what was exported, how much memory a robot's program takes, and whether that fits the robots."""
    memory = found.memory
    answer = [_memory_words(memory, has_compiler=found.has_compiler)]
    reasons = []
    if memory is not None:
        reasons = unfit(memory)
        answer += [f"NOT FIT for the study's robots: {reason}." for reason in reasons]
    if other := other_robot(found.scenario):
        answer.insert(0, f"NOT FIT for {other[0]}: {other[1]}. What follows is of the study's robots.")
        reasons.append(other[1])
    return Document(
        title="Exported program",
        answer=tuple(answer),
        data={
            "files": pl.DataFrame({"file": list(found.files)}),
            "memory": pl.DataFrame([] if memory is None else [asdict(memory)]),
            "unfit": pl.DataFrame({"reason": reasons}, schema={"reason": pl.String}),
        },
    )


def _memory_words(memory: Memory | None, *, has_compiler: bool) -> str:
    if memory is None and has_compiler:
        return f"Size not measured: {SIZE_TOOL} is missing or fails (Debian: binutils-arm-none-eabi)."
    if memory is None:
        packages = "gcc-arm-none-eabi and libnewlib-arm-none-eabi"
        return f"Size not measured: {COMPILER} is not installed (Debian: {packages})."
    return (
        f"Size on a Cortex-M0+: {memory.flash} bytes of flash, {memory.ram} bytes of static RAM ({memory.flags}), with "
        "the mathematics, without your drivers and stack."
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
