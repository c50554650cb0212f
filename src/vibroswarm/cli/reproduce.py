"""``vibroswarm reproduce``: the paper's figures and tables, and a verdict on each of its claims."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import deliver
from vibroswarm.cli.option_values import refuse
from vibroswarm.cli.options import Drawn, Workers
from vibroswarm.cli.out_folder import claim
from vibroswarm.cli.progress import progress_bar
from vibroswarm.core.numbers import count
from vibroswarm.errors import InputError, check_choice

if TYPE_CHECKING:
    from vibroswarm.paper.item import Settings

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
        Option(
            f"the study's recordings, for the calibration (default: environment variable {RECORDINGS})", "DIR"
        ),
    ] = None,
    output: Drawn,
) -> None:
    """Compute every figure and table of the paper, and report which of its claims hold.

    Items whose results are in the folder --out already are not computed again.

    examples:
      vibroswarm reproduce --out out/paper                          everything; run again to resume
      vibroswarm reproduce --only fill-ratios swarm-sizes --runs 200 --out out/some
    """
    from vibroswarm.paper.items import all_items, items_named
    from vibroswarm.paper.reproduce import reproduce as computed
    from vibroswarm.paper.reproduction_tables import TABLES, write_tables

    if only == ["list"]:
        for item in all_items():
            print(f"{item.name:<16} {item.title}")
        return
    out = output.out
    if out is None:
        raise InputError("is required", field="--out")
    items, settings = items_named(only), settings_of(runs, seed, columns, recordings, workers)
    # Items that depend on a changed setting are computed again, so that other settings are no reason to refuse it.
    claim(output, "reproduce")
    with progress_bar(f"reproducing {count(len(items), 'item')}") as update:
        reproduction = computed(settings, out, items, lambda what, share: update(share, what=what))
    write_tables(reproduction, out / TABLES)
    deliver(reproduction, output)


def settings_of(
    runs: int = 1000,
    seed: int = 1,
    columns: tuple[str, ...] | None = None,
    recordings: Path | None = None,
    workers: int | None = None,
) -> Settings:
    """Return the settings of a reproduction that the options give.

    If ``recordings`` is not given, the environment variable ``RECORDINGS`` names their folder, unless it is empty.

    Raises:
        InputError: a column is unknown, or the number of runs is out of range.
    """
    from vibroswarm.paper.columns import COLUMNS
    from vibroswarm.paper.item import Settings
    from vibroswarm.study.run import MOST_RUNS

    wanted = columns or COLUMNS
    for column in wanted:
        check_choice(column, "--columns", COLUMNS)
    # A confidence interval over runs needs two.
    refuse(not 2 <= runs <= MOST_RUNS, "--runs", f"{runs} is not from 2 to {MOST_RUNS}")
    if recordings is None and os.environ.get(RECORDINGS):
        recordings = Path(os.environ[RECORDINGS])
    return Settings(
        runs=runs,
        seed=seed,
        columns=tuple(column for column in COLUMNS if column in wanted),  # in the order of the report
        recordings=recordings,
        workers=workers,
    )
