"""``vibroswarm evaluate``: many runs of one scenario, or of several side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.options import Compared, Comparisons, Drawn, Parts
from vibroswarm.cli.scenario_options import words_of
from vibroswarm.cli.studies import do_study


def evaluate(
    study: Annotated[Path | None, Option("study or scenario, in place of options", "FILE.toml")] = None,
    other: Annotated[Path | None, Option("scenario or preset to compare with", "OTHER.toml")] = None,
    /,
    *,
    runs: Annotated[int | None, Option("runs per cell (default 100, or those of the file)")] = None,
    until: Annotated[
        str | None, Option("run until the half-width of a figure's interval is below P %", "P%")
    ] = None,
    figure: Annotated[str | None, Option("figure for --until (default decision_time_s)")] = None,
    max_runs: Annotated[int | None, Option("upper limit for --until (default 100000)")] = None,
    vary: Annotated[
        Sequence[str],
        Option(
            "one cell per value; repeat for all combinations (several strategies or robots also vary)",
            "FIELD=A,B,...",
        ),
    ] = (),
    cost: Annotated[
        str | None, Option("score each cell under this cost, and the best again on fresh runs")
    ] = None,
    scenario: Compared,
    comparison: Comparisons,
    execution: Parts,
    output: Drawn,
) -> None:
    """Run a scenario many times, or several side by side: figures with intervals, comparisons, pictures.

    examples:
      vibroswarm evaluate --runs 1000                                     the paper's setting
      vibroswarm evaluate --runs 1000 --strategy none,positive,soft --out out/strategies
      vibroswarm evaluate --until 2% --robots 5,6,7,8,9,10 --strategy soft
      vibroswarm evaluate study.toml --out out/study                      run again to resume
      vibroswarm evaluate study.toml --out out/part3 --shard 3/16
      vibroswarm evaluate study.toml --out out/study --executor dask://head:8786
      vibroswarm evaluate examples/grid.toml --cost authors_code          the paper's grid of eta and kappa
      vibroswarm evaluate out/pso/best.toml other.toml --cost authors_code

    a study file:
      runs = 1000                       # or: until = "2%"
      [scenario]
      preset = "paper"                  # any sections of a scenario may follow; or: scenario = "file.toml"
      [grid]                            # all combinations; also list
      "floor.source" = ["random:0.44", "random:0.48"]
      "strategy.name" = ["none", "positive", "soft"]
      "decision.credible_threshold" = { from = 0.9, to = 0.99, steps = 4 }
    """
    from vibroswarm.study.options import study_of

    made = study_of(
        *filter(None, (study, other)),
        vary=vary,
        runs=runs,
        until=until,
        figure=figure,
        max_runs=max_runs,
        seed=scenario.seed,
        motion=scenario.motion,
        **words_of(scenario),
    )
    do_study(made, comparison, execution, output, cost)
