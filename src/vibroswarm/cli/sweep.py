"""``vibroswarm sweep``: a study from its file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vibroswarm.cli.studies import add_outcome_options, add_running_options, do_study

EPILOG = """\
a study's file:
  runs = 1000                       # or: until = "2%"
  [scenario]
  preset = "paper"                  # and any section of a scenario; or: scenario = "file.toml"
  [grid]                            # every combination; also zip, list, random, sobol
  "floor.source" = ["random:0.44", "random:0.48"]
  "strategy.name" = ["none", "positive", "soft"]
  "decision.credible_threshold" = { from = 0.9, to = 0.99, steps = 4 }

examples:
  vibroswarm sweep study.toml --out out/study              again: goes on where it was, or does nothing
  vibroswarm sweep study.toml --out out/part3 --shard 3/16
  vibroswarm sweep study.toml --out out/study --executor dask://head:8786
"""


def add_parser(commands: Any) -> None:
    """Make the command known."""
    parser = commands.add_parser(
        "sweep",
        help="run a study: a scenario with fields varied, many runs each",
        description="Run a study from its file, sum it up and draw it. What was begun is gone on with.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("study", metavar="STUDY.toml", type=Path, help="the study")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, help="keep the runs here, and go on with those that are here"
    )
    parser.add_argument("--runs", metavar="N", help="runs a cell, in place of what the file says")
    add_running_options(parser)
    add_outcome_options(parser)
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Read the study and do it."""
    from vibroswarm.cli.scenarios import whole_number
    from vibroswarm.study.spec import Study

    study = Study.read(arguments.study)
    if arguments.runs is not None:
        study = study.with_runs(whole_number(arguments.runs, "--runs"))
    return do_study(study, arguments)
