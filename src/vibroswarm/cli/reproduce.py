"""``vibroswarm reproduce``: the paper's figures and tables, and a verdict on each of its claims."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

from vibroswarm.cli.command_line import Option, refuse
from vibroswarm.cli.deliver import claim, deliver
from vibroswarm.cli.options import Drawn, Workers
from vibroswarm.cli.terminal import counting_runs
from vibroswarm.errors import InputError, check_choice

RECORDINGS = "VIBROSWARM_RUGBOT"
"""The environment variable with the folder of the recordings, used if ``--recordings`` is not given."""


def reproduce(
    *,
    only: Annotated[list[str] | None, Option("only these items; 'list' lists them")] = None,
    runs: Annotated[int, Option("runs per cell")] = 1000,
    seed: Annotated[int, Option("seed of all cells", "S", low=0, high=2**62)] = 1,
    columns: Annotated[
        tuple[str, ...] | None, Option("only these presets: paper, text, calibrated", "A,B")
    ] = None,
    workers: Workers = None,
    recordings: Annotated[
        Path | None,
        Option(f"the study's recordings (default: environment variable {RECORDINGS})", "DIR"),
    ] = None,
    output: Drawn,
) -> None:
    """Compute every figure and table of the paper, and report which of its claims hold.

    Runs that are in the folder --out already are not simulated again.

    examples:
      vibroswarm reproduce --out out/paper                          everything; run again to resume
      vibroswarm reproduce --only fill-ratios swarm-sizes --runs 200 --out out/some
    """
    from vibroswarm.paper.columns import COLUMNS
    from vibroswarm.paper.item import Settings, all_items, items_named
    from vibroswarm.paper.reproduce import reproduce as computed
    from vibroswarm.study.run import MOST_RUNS

    if only == ["list"]:
        for item in all_items():
            print(f"{item.name:<18} {item.title}")
        return
    if output.out is None:
        raise InputError("is required", field="--out")
    for column in columns or ():
        check_choice(column, "--columns", COLUMNS)
    refuse(not 2 <= runs <= MOST_RUNS, "--runs", f"{runs} is not from 2 to {MOST_RUNS}")
    if recordings is None and os.environ.get(RECORDINGS):
        recordings = Path(os.environ[RECORDINGS])
    wanted = tuple(column for column in COLUMNS if column in (columns or COLUMNS))
    settings = Settings(runs, seed, wanted, recordings, workers)
    claim(output, "reproduce")
    with counting_runs("reproducing") as progress:
        reproduction = computed(settings, output.out, items_named(only), progress)
    deliver(reproduction, output)
