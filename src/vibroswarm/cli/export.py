"""``vibroswarm export``: the robot's program as C for microcontrollers."""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path
from typing import Any

from vibroswarm.cli.deliver import print_result
from vibroswarm.cli.options import add_json, add_scenario_options

EPILOG = """\
examples:
  vibroswarm export c robot --strategy soft
  vibroswarm export check robot --strategy soft
"""


def add_parser(commands: Any) -> None:
    """Add the command ``export`` and its subcommands ``c`` and ``check``."""
    parser = commands.add_parser(
        "export",
        help="write the robot's program as C for microcontrollers",
        description="Write the program of a scenario's robots: walk, sensing, belief, localisation, strategy.",
        epilog=EPILOG,
    )
    parts = parser.add_subparsers(dest="part", metavar="PART", required=True)
    help = "C99 library with a sketch for Arduino and PlatformIO"
    part = parts.add_parser("c", help=help, description=f"{help}.")
    part.add_argument("folder", metavar="DIR", type=Path, help="folder to write")
    part.add_argument("--force", action="store_true", help="replace DIR if it is an export")
    add_json(part)
    add_scenario_options(part)
    part.set_defaults(run=_c)
    part = parts.add_parser(
        "check",
        help="compare an exported header of parameters with a scenario",
        description="Compare an exported header of parameters with a scenario: each field, and each constant of the "
        "program. Exit code 0 if all are equal, else 1.",
    )
    part.add_argument("folder", metavar="DIR", type=Path, help="exported folder, or vibroswarm_parameters.h")
    add_json(part)
    add_scenario_options(part)
    part.set_defaults(run=_check)


def _c(arguments: argparse.Namespace) -> int:
    """Write the C library and print the memory that it takes on a robot; return the exit code."""
    from vibroswarm.cli.scenario_options import scenario_from
    from vibroswarm.core.atomic_io import check_folder, whole_folder
    from vibroswarm.documents.export import export_document
    from vibroswarm.export.c_library import COMPILER, MARKER, library_files, measured

    # Refuse the folder before the work. --force replaces a folder only if it holds the file MARKER, as a library does.
    check_folder(arguments.folder, replace=arguments.force, marker=MARKER)
    scenario = scenario_from(arguments)
    files = library_files(scenario)
    with whole_folder(arguments.folder, replace=arguments.force, marker=MARKER) as part:
        for name, text in files.items():
            (part / name).parent.mkdir(parents=True, exist_ok=True)
            (part / name).write_text(text, encoding="utf-8")
        # None without the compiler and the tool for sizes of the robot's processor
        memory = measured(part / "src")
    document = export_document(list(files), memory, has_compiler=shutil.which(COMPILER) is not None)
    print_result(document, arguments)
    if not arguments.json:
        print(
            f"Saved: {arguments.folder} ({len(files)} files; begin with examples/inspection/inspection.ino)"
        )
    return 0


def _check(arguments: argparse.Namespace) -> int:
    """Compare an exported header of parameters with a scenario; return the exit code, 1 if they differ."""
    from vibroswarm.cli.scenario_options import scenario_from
    from vibroswarm.documents.export import differences_document
    from vibroswarm.export.assembly import parts_of
    from vibroswarm.export.parameters import differences, find_header, read_header

    path = find_header(arguments.folder)
    found = read_header(path)
    scenario = scenario_from(arguments)
    different = differences(found, scenario, parts_of(scenario))
    print_result(differences_document(str(path), different), arguments)
    return 1 if different else 0
