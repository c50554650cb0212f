"""``vibroswarm export``: the robot's program as C for microcontrollers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import print_report, print_saved_file
from vibroswarm.cli.options import Force, Json, ScenarioOptions
from vibroswarm.cli.scenario_options import scenario_from
from vibroswarm.core.atomic_io import check_folder, whole_folder


def c(
    folder: Annotated[Path, Option("folder to write", "DIR")],
    /,
    *,
    force: Force = False,
    json: Json = False,
    scenario: ScenarioOptions,
) -> None:
    """Write the program of a scenario's robots as a C99 library, with a sketch for Arduino and PlatformIO.

    The program is walk, sensing, belief and strategy.

    example:
      vibroswarm export c robot --strategy soft
    """
    from vibroswarm.export.c_library import MARKER, export_library

    # Refuse the folder before the work. --force replaces a folder only if it holds the file MARKER, as a library does.
    check_folder(folder, replace=force, marker=MARKER)
    made = scenario_from(scenario)
    with whole_folder(folder, replace=force, marker=MARKER) as part:
        found = export_library(made, part)
    print_report(found, as_json=json)
    begin = "examples/inspection/inspection.ino"
    print_saved_file(folder, f"{len(found.files)} files; begin with {begin}", as_json=json)


def check(
    folder: Annotated[Path, Option("exported folder, or vibroswarm_parameters.h", "DIR")],
    /,
    *,
    json: Json = False,
    scenario: ScenarioOptions,
) -> int:
    """Compare an exported header of parameters with a scenario: each field, and each constant of the program.

    The exit code is 0 if all are equal, else 1.

    example:
      vibroswarm export check robot --strategy soft
    """
    from vibroswarm.export.assembly import parts_of
    from vibroswarm.export.parameters import differences, read_header
    from vibroswarm.report.export import of_differences

    made = scenario_from(scenario)
    different = differences(read_header(folder), made, parts_of(made))
    print_report(of_differences(str(folder), different), as_json=json)
    return 1 if different else 0
