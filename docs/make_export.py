"""Make the table of figures/export.md again: flash, RAM and times of every strategy's program on a Cortex-M0+.

    python docs/make_export.py

It takes a minute, and needs arm-none-eabi-gcc with newlib, and qemu-system-arm.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from pathlib import Path
from typing import Any, Final

from vibroswarm import preset
from vibroswarm.export.assembly import parts_of
from vibroswarm.export.c_library import Memory, measured, write_library
from vibroswarm.export.c_program import precision_of
from vibroswarm.export.timing import Timing, ms, timed, unfit
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies import names

PAGE: Final = Path(__file__).parent / "figures" / "export.md"
HEAD: Final = (
    "| strategy | precision | flash, bytes | static RAM, bytes | wheels set within, ms | work, % of the time "
    "| longest work done within, ms | fit |\n|---|---|---|---|---|---|---|---|\n"
)
WORDS: Final = {1: "float", 2: "mixed", 3: "double"}
MOTORS: Final[dict[str, Any]] = {
    "strategy.name": "dirichlet",
    "task.name": "majority",
    "floor.source": "random:0.28,0.48,0.24",
    "sensor.model": "acceleration",
    "sensor.acceleration.motor_hz": [90.0, 140.0],
}
"""Robots that tell motors apart by their line."""


def table() -> str:
    """The table, of all strategies, and of robots that compute a spectrum."""
    rows = []
    chosen: dict[str, dict[str, Any]] = {f"`{name}`": {"strategy.name": name} for name in names()}
    chosen |= {f"`{name}`, two motors": MOTORS | {"strategy.name": name} for name in ("dirichlet", "places")}
    for name, values in chosen.items():
        scenario = preset("paper").with_values(values)
        precision, _ = precision_of(parts_of(scenario))
        memory, timing = measured_and_timed(scenario)
        is_fit = "no" if unfit(scenario, memory, timing) else "yes"
        rows.append(
            f"| {name} | {WORDS[precision]} ({precision}) | {memory.flash:,} | {memory.ram:,} | {timing.late_ms:.1f} "
            f"| {100 * timing.load:.1f} | {ms(timing.waits):.0f} | {is_fit} |\n"
        )
    return HEAD + "".join(rows)


def measured_and_timed(scenario: Scenario) -> tuple[Memory, Timing]:
    """Memory and time of a scenario's program, exported to a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        write_library(scenario, Path(folder))
        memory = measured(Path(folder) / "src")
        timing = None if memory is None else timed(Path(folder) / "src", scenario, memory.flags)
    if memory is None or timing is None:
        raise SystemExit("make_export: needs arm-none-eabi-gcc, arm-none-eabi-size and qemu-system-arm")
    return memory, timing


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    PAGE.write_text(
        re.sub(
            r"(<!-- made: strategies -->\n\n).*?(\n<!-- end -->)",
            lambda found: found[1] + table() + found[2],
            PAGE.read_text(encoding="utf-8"),
            flags=re.DOTALL,
        ),
        encoding="utf-8",
    )
