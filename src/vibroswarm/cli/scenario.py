"""``vibroswarm scenario``: a whole scenario as TOML, to be read, kept and edited."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vibroswarm.cli.options import add_scenario_options


def add_parser(commands: Any) -> None:
    """Make the command known."""
    parser = commands.add_parser(
        "scenario",
        help="write a scenario down as TOML, every field of it",
        description="Write a scenario down as TOML, every field of it: to be read, kept, edited and run again.",
        epilog="example: vibroswarm scenario --robots 8 --out mine.toml; vibroswarm run --scenario mine.toml",
        allow_abbrev=False,
    )
    add_scenario_options(parser)
    out = parser.add_argument_group("where")
    out.add_argument("--out", metavar="FILE", type=Path, help="into this file (without: here)")
    out.add_argument("--force", action="store_true", help="replace a file that is there")
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Write the scenario that the options ask for."""
    from vibroswarm.cli.scenarios import scenario_from
    from vibroswarm.files import whole_file

    scenario = scenario_from(arguments)
    if arguments.out is None:
        print(scenario.to_toml(), end="")
        return 0
    with whole_file(arguments.out, replace=arguments.force) as part:
        part.write_text(scenario.to_toml(), encoding="utf-8")
    print(f"Written: {arguments.out} (scenario {scenario.hash}).")
    return 0
