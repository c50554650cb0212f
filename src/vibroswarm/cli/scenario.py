"""``vibroswarm scenario``: write a scenario as TOML, with every field."""

from __future__ import annotations

import argparse
from typing import Any

from vibroswarm.cli.options import add_out, add_scenario_options


def add_parser(commands: Any) -> None:
    """Add the command ``scenario`` and its options to the program's commands."""
    parser = commands.add_parser(
        "scenario",
        help="write a scenario as TOML, with every field",
        description="Write a scenario as TOML, with every field, to edit and run again.",
        epilog="example: vibroswarm scenario --robots 8 --out mine.toml; vibroswarm run --scenario mine.toml",
    )
    add_scenario_options(parser)
    add_out(parser, "write to FILE (default: stdout)", metavar="FILE", force=True)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the scenario that the options describe to a file or to stdout; return the exit code."""
    from vibroswarm.cli.scenario_options import scenario_from
    from vibroswarm.core.atomic_io import whole_file

    scenario = scenario_from(arguments)
    if arguments.out is None:
        print(scenario.to_toml(), end="")
        return 0
    with whole_file(arguments.out, replace=arguments.force) as part:
        part.write_text(scenario.to_toml(), encoding="utf-8")
    print(f"Saved: {arguments.out} (scenario {scenario.hash})")
    return 0
