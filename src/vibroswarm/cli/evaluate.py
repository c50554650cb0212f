"""``vibroswarm evaluate``: many runs of one scenario, or of several side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.options import Compared, Comparisons, Drawn, Execution, Parts, Unsaved
from vibroswarm.cli.studies import confirm_and_print, do_study
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.study.spec import Study


def evaluate(
    study: Annotated[Path | None, Option("a study file, in the place of a scenario", "STUDY.toml")] = None,
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
    if study is None:
        made = study_of(scenario, vary, runs, until, figure, max_runs, keep_samples=keep_samples)
    else:
        own = {
            "vary": vary,
            "until": until,
            "figure": figure,
            "max_runs": max_runs,
            "keep_samples": keep_samples,
        }
        made = _study_in(study, runs, scenario, own)
    do_study(made, comparison, execution, output)


def merge(
    out: Annotated[Path, Option("new folder, or one of the same study", "OUT")],
    /,
    *shards: Annotated[Path, Option("folders of shards", "SHARD")],
    force: Annotated[bool, Option("replace OUT if it holds something else")] = False,
    comparison: Comparisons,
    execution: Execution,
    output: Unsaved,
) -> None:
    """Join folders made with --shard, and summarise the study.

    example:
      vibroswarm evaluate merge out/whole out/part1 out/part2
    """
    from vibroswarm.cli.out_folder import claim
    from vibroswarm.study.cell_comparison import pairs_of
    from vibroswarm.study.run import jobs_of_one_study
    from vibroswarm.study.run import merge as merge_shards
    from vibroswarm.study.store import Store
    from vibroswarm.study.study_result import StudyResult

    whole = Drawn(out=out, force=force, **vars(output))
    # Shards that cannot be merged are refused now, since `--force` removes the folder.
    study = jobs_of_one_study(shards)[0].study
    pairs_of(study, comparison.reference)  # refuses an unknown reference before anything is written
    claim(whole, lambda folder: Store.existing(folder, study, shards=False))
    store = merge_shards(out, shards)
    every_cell = tuple(cell.number for cell in store.study.cells)
    confirm_and_print(StudyResult(store.study, store, selected=every_cell), comparison, execution, whole)


def _study_in(file: Path, runs: int | None, scenario: Compared, own: dict[str, Any]) -> Study:
    """Read the study of a file.

    Args:
        scenario, own: options for a scenario without a file, by name.
    Raises:
        InputError: one of these is given, or the file is wrong.
    """
    from vibroswarm.study.spec import Study

    usual = Compared()
    names = [field.name for field in fields(Compared)]
    given = [name for name in names if getattr(scenario, name) not in ([], getattr(usual, name))]
    given += [name for name, value in own.items() if value]
    if given:
        name = "set" if given[0] == "settings" else given[0].replace("_", "-")
        raise InputError("is not for a study file, which says what is simulated", field=f"--{name}")
    study = Study.read(file)
    return study if runs is None else study.with_runs(runs)


def study_of(
    scenario: Compared,
    vary: Sequence[str] = (),
    runs: int | None = None,
    until: str | None = None,
    figure: str | None = None,
    max_runs: int | None = None,
    *,
    keep_samples: bool = False,
) -> Study:
    """Return the study that options describe: its base scenario, the varied fields, and the number of runs.

    Raises:
        InputError: options conflict, or a name, field or value is wrong.
    """
    from vibroswarm.cli.scenario_options import chosen, scenario_from
    from vibroswarm.study.precision import Precision
    from vibroswarm.study.spec import Study

    varied = _varied(vary)
    strategies, robots = scenario.strategy or (), scenario.robots or ()
    several: dict[str, tuple[str, Sequence[Any]]] = {}
    if len(strategies) > 1:
        several["strategy.name"] = "--strategy", [chosen("strategy", name) for name in strategies]
        # The base has the first: the paper's strategy may not go together with the other options.
        scenario = replace(scenario, strategy=strategies[:1])
    if len(robots) > 1:
        several["swarm.robots"] = "--robots", list(robots)
        scenario = replace(scenario, robots=None)
    for field, (option, values) in several.items():
        if field in varied:
            raise InputError(f"is also varied by {option}; use one of them", field=f"--vary {field}")
        varied[field] = list(values)
    # If presets are varied, the base holds only the fields that options set; all others come from each preset.
    base = (
        _base_of_presets(scenario)
        if "preset" in varied
        else scenario_from(scenario).model_dump(exclude_none=True)
    )
    precision = None
    if until is not None:
        if runs is not None:
            raise InputError("use --runs or --until, not both", field="--until")
        precision = Precision.from_words(until, figure, max_runs)
    elif figure is not None or max_runs is not None:
        raise InputError("needs --until", field="--figure" if figure is not None else "--max-runs")
    fixed_runs = 100 if runs is None else runs
    return Study(
        base=base,
        vary={"grid": varied} if varied else {},
        runs=fixed_runs if precision is None else None,
        until=precision,
        seed=scenario.seed,
        motion=chosen("motion", scenario.motion),
        keep=("samples",) if keep_samples else (),
        folder=Path(),  # floor files that options name are relative to the current folder
    )


def _base_of_presets(scenario: Compared) -> dict[str, Any]:
    """Return the base of a study that varies presets: only the fields that options set, by section and field.

    These fields override those of every preset. All other fields of a cell come from the cell's preset.

    Raises:
        InputError: --preset or --scenario is given too.
    """
    from vibroswarm.cli.scenario_options import values_from
    from vibroswarm.scenario.scenario import preset

    for option in ("preset", "scenario"):
        if getattr(scenario, option) is not None:
            raise InputError("conflicts with --vary preset; use one of them", field=f"--{option}")
    base: dict[str, Any] = {}
    # The paper's preset gives the size of a random floor if --tiles does not.
    for name, value in values_from(scenario, preset("paper")).items():
        # Split at the first dot: strategy.soft.eta is the field soft.eta of the section strategy.
        section, _, field = name.partition(".")
        if value is not None:  # a study's base cannot hold None: TOML has no such value
            base.setdefault(section, {})[field] = value
    return base


def _varied(options: Sequence[str]) -> dict[str, list[Any]]:
    """Return the varied values by dotted field name, parsed from the values of ``--vary``, texts ``FIELD=A,B``.

    If a value is user code (FILE.py:NAME), the file is loaded, so that the code's name and fields are known.

    Raises:
        InputError: a text is not of this form, a field is given twice, or a value of user code cannot be loaded.
    """
    from vibroswarm.cli.scenario_options import chosen
    from vibroswarm.scenario import plugins
    from vibroswarm.scenario.scenario import parse_values

    vary: dict[str, list[Any]] = {}
    for text in options:
        name, values = parse_values(text)
        if name in vary:
            raise InputError("is varied twice", field=f"--vary {name}")
        vary[name] = values
        kind = name.partition(".")[0]
        if kind in plugins.KINDS and name == plugins.field_of(kind):
            vary[name] = [chosen(kind, item) if plugins.is_code(item) else item for item in vary[name]]
    return vary
