"""``vibroswarm evaluate``: many runs of one scenario, or of several side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.option_values import refuse
from vibroswarm.cli.options import Compared, Comparisons, Drawn, Parts, Unsaved
from vibroswarm.cli.scenario_options import words_of
from vibroswarm.cli.studies import claim_study, do_study, summarise_and_print


def evaluate(
    study: Annotated[Path | None, Option("study file, in place of a scenario", "STUDY.toml")] = None,
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
    keep_samples: Annotated[bool, Option("also save a table of samples")] = False,
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

    a study file:
      runs = 1000                       # or: until = "2%"
      [scenario]
      preset = "paper"                  # any sections of a scenario may follow; or: scenario = "file.toml"
      [grid]                            # all combinations; also zip, list, random, sobol
      "floor.source" = ["random:0.44", "random:0.48"]
      "strategy.name" = ["none", "positive", "soft"]
      "decision.credible_threshold" = { from = 0.9, to = 0.99, steps = 4 }
    """
    from vibroswarm.study.words import study_of

    refuse(
        keep_samples and output.out is None, "--keep-samples", "needs --out DIR, where the samples are saved"
    )
    made = study_of(
        study,
        vary=vary,
        runs=runs,
        until=until,
        figure=figure,
        max_runs=max_runs,
        keep_samples=keep_samples,
        seed=scenario.seed,
        motion=scenario.motion,
        **words_of(scenario),
    )
    do_study(made, comparison, execution, output)


def merge(
    out: Annotated[Path, Option("new folder, or one of the same study", "OUT")],
    /,
    *shards: Annotated[Path, Option("folders of shards", "SHARD")],
    force: Annotated[bool, Option("replace OUT if it holds something else")] = False,
    mixed: Annotated[bool, Option("join results of other versions; the report says so")] = False,
    comparison: Comparisons,
    output: Unsaved,
) -> None:
    """Join folders made with --shard, and summarise the study.

    example:
      vibroswarm evaluate merge out/whole out/part1 out/part2
    """
    from vibroswarm.study.cell_comparison import pairs_of
    from vibroswarm.study.run import jobs_of_one_study
    from vibroswarm.study.run import merge as merge_shards
    from vibroswarm.study.study_result import StudyResult

    whole = Drawn(out=out, force=force, **vars(output))
    # Shards that cannot be merged are refused now, since `--force` removes the folder.
    study = jobs_of_one_study(shards, mixed=mixed)[0].study
    pairs_of(study, comparison.reference)  # refuses an unknown reference before anything is written
    claim_study(whole, study, mixed=mixed)
    store = merge_shards(out, shards, mixed=mixed)
    every_cell = tuple(cell.number for cell in store.study.cells)
    summarise_and_print(StudyResult(store.study, store, selected=every_cell), comparison, whole)
