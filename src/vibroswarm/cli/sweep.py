"""``vibroswarm sweep``: run a study from its file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from vibroswarm.cli.options import add_out, whole
from vibroswarm.cli.studies import add_outcome_options, add_running_options, do_study

EPILOG = """\
a study file:
  runs = 1000                       # or: until = "2%"
  [scenario]
  preset = "paper"                  # any sections of a scenario may follow; or: scenario = "file.toml"
  [grid]                            # all combinations; also zip, list, random, sobol
  "floor.source" = ["random:0.44", "random:0.48"]
  "strategy.name" = ["none", "positive", "soft"]
  "decision.credible_threshold" = { from = 0.9, to = 0.99, steps = 4 }

examples:
  vibroswarm sweep study.toml --out out/study              run again to resume
  vibroswarm sweep study.toml --out out/part3 --shard 3/16
  vibroswarm sweep study.toml --out out/study --executor dask://head:8786
"""


def add_parser(commands: Any) -> None:
    """Add the command ``sweep`` and its options to the program's commands."""
    parser = commands.add_parser(
        "sweep",
        help="run a study: many runs of a scenario with varied fields",
        description="Run a study from its file, or resume it, then summarise and draw it.",
        epilog=EPILOG,
    )
    parser.add_argument("study", metavar="STUDY.toml", type=Path, help="the study file")
    add_out(parser, "save the runs here, or resume the study here", force=True)
    parser.add_argument("--runs", metavar="N", type=whole, help="runs per cell (default: those of the file)")
    add_running_options(parser)
    add_outcome_options(parser)
    # After Ctrl-C, the work saved in the folder --out can be resumed.
    parser.set_defaults(run=run, resumes="folder")


def run(arguments: argparse.Namespace) -> int:
    """Read a study from its file, run it and print its results; return the exit code."""
    from vibroswarm.study.spec import Study

    study = Study.read(arguments.study)
    if arguments.runs is not None:
        study = study.with_runs(arguments.runs)
    return do_study(study, arguments)
