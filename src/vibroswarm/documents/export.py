"""The documents of an export: what was written, and how an exported header differs from a scenario."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import polars as pl

from vibroswarm.export.c_library import COMPILER, SIZE_TOOL, Memory
from vibroswarm.export.timing import CLOCK_HZ, EMULATOR, Timing, ms, other_robot, unfit
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.show.document import Document, Table
from vibroswarm.show.numbers import count


def export_document(
    scenario: Scenario,
    files: Sequence[str],
    memory: Memory | None,
    timing: Timing | None,
    *,
    has_compiler: bool,
) -> Document:
    """Return what was exported, how much memory and time a robot's program takes, and whether that fits the robots.

    Args:
        memory: None if it was not measured, because the compiler for the robot's processor is not installed, or the
            tool that lists sizes is missing or fails. timing: None if it was not measured, because compiler or emulator
            are not installed. has_compiler: whether the compiler is installed.
    """
    answer = [_memory_words(memory, has_compiler=has_compiler)]
    reasons = []
    if memory is not None:
        answer.append(_timing_words(timing))
        reasons = unfit(scenario, memory, timing)
        answer += [f"NOT FIT for the study's robots: {reason}." for reason in reasons]
    if other := other_robot(scenario):
        answer.insert(0, f"NOT FIT for {other[0]}: {other[1]}. What follows is of the study's robots.")
        reasons.append(other[1])
    return Document(
        title="Exported program",
        answer=tuple(answer),
        data={
            "files": pl.DataFrame({"file": list(files)}),
            "memory": pl.DataFrame([] if memory is None else [asdict(memory)]),
            "timing": pl.DataFrame([] if timing is None else [asdict(timing)]),
            "unfit": pl.DataFrame({"reason": reasons}, schema={"reason": pl.String}),
        },
    )


def _timing_words(timing: Timing | None) -> str:
    if timing is None:
        return f"Time not measured: {EMULATOR} is not installed or fails (Debian: qemu-system-arm)."
    return (
        f"At {CLOCK_HZ / 1e6:g} MHz wheels are set at most {timing.late_ms:.1f} ms after a control period begins. "
        f"Localisation and strategy work in between, {timing.load:.1%} of the time, and are at most "
        f"{ms(timing.waits):.0f} ms late."
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
