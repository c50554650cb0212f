"""``vibroswarm evaluate``: many runs of one scenario, or of several side by side."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import add_motion, add_out, add_scenario_options, add_seed, whole
from vibroswarm.cli.studies import add_outcome_options, add_running_options, do_study
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.study.spec import Study

EPILOG = """\
examples:
  vibroswarm evaluate --runs 1000                                     the paper's setting
  vibroswarm evaluate --runs 1000 --strategy none,positive,soft --out out/strategies
  vibroswarm evaluate --until 2% --vary swarm.robots=5,6,7,8,9,10 --strategy soft
"""


def add_parser(commands: Any) -> None:
    """Add the command ``evaluate`` and its options to the program's commands."""
    parser = commands.add_parser(
        "evaluate",
        help="run a scenario many times, or several side by side",
        description="Run a scenario many times: figures with intervals, comparisons, pictures.",
        epilog=EPILOG,
    )
    scenario = add_scenario_options(parser)
    add_seed(scenario, "same study and seed: same result")
    add_motion(scenario)
    many = parser.add_argument_group("runs and cells")
    many.add_argument("--runs", metavar="N", type=whole, help="runs per cell (default 100)")
    many.add_argument(
        "--until", metavar="P%", help="run until the half-width of a figure's interval is below P %%"
    )
    many.add_argument("--figure", metavar="NAME", help="figure for --until (default decision_time_s)")
    many.add_argument("--max-runs", metavar="N", type=whole, help="upper limit for --until (default 100000)")
    many.add_argument(
        "--vary",
        metavar="FIELD=A,B,...",
        action="append",
        default=[],
        help="one cell per value; repeat for all combinations (--strategy a,b also varies)",
    )
    many.add_argument("--keep-samples", action="store_true", help="also save a table of samples")
    add_out(parser, "save runs, numbers and report here, or resume", force=True)
    add_running_options(parser)
    add_outcome_options(parser)
    # After Ctrl-C, the work saved in the folder --out can be resumed.
    parser.set_defaults(run=run, resumes="folder")


def run(arguments: argparse.Namespace) -> int:
    """Run the study that the options describe, and print and save its results; return the exit code."""
    return do_study(study_from(arguments), arguments)


def study_from(arguments: argparse.Namespace) -> Study:
    """Return the study that the options describe: its base scenario, the varied fields, and the number of runs.

    If ``--strategy`` lists several strategies, they are a varied field like those of ``--vary``, and
    ``arguments.strategy`` is set to None.

    Raises:
        InputError: options conflict, or a name, field or value is wrong.
    """
    from vibroswarm.cli.scenario_options import chosen, scenario_from
    from vibroswarm.study.precision import Precision
    from vibroswarm.study.spec import Study

    vary = _varied(arguments.vary)
    strategies = [] if arguments.strategy is None else arguments.strategy.split(",")
    if len(strategies) > 1:
        names = [chosen("strategy", name.strip()) for name in strategies]
        if "strategy.name" in vary:
            raise InputError("is also varied by --strategy; use one of them", field="--vary strategy.name")
        vary["strategy.name"] = names
        arguments.strategy = None  # scenario_from would take the list for one name
    # If presets are varied, the base holds only the fields that options set; all others come from each preset.
    base = (
        _base_of_presets(arguments)
        if "preset" in vary
        else scenario_from(arguments).model_dump(exclude_none=True)
    )
    until = None
    if arguments.until is not None:
        if arguments.runs is not None:
            raise InputError("use --runs or --until, not both", field="--until")
        until = Precision.from_words(arguments.until, arguments.figure, arguments.max_runs)
    elif arguments.figure is not None or arguments.max_runs is not None:
        raise InputError("needs --until", field="--figure" if arguments.figure is not None else "--max-runs")
    fixed_runs = 100 if arguments.runs is None else arguments.runs
    return Study(
        base=base,
        vary={"grid": vary} if vary else {},
        runs=fixed_runs if until is None else None,
        until=until,
        seed=arguments.seed,
        motion=chosen("motion", arguments.motion),
        keep=("samples",) if arguments.keep_samples else (),
        folder=Path(),  # floor files that options name are relative to the current folder
    )


def _base_of_presets(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the base of a study that varies presets: only the fields that options set, by section and field.

    These fields override those of every preset. All other fields of a cell come from the cell's preset.

    Raises:
        InputError: --preset or --scenario is given too.
    """
    from vibroswarm.cli.scenario_options import values_from
    from vibroswarm.scenario.scenario import preset

    for option in ("preset", "scenario"):
        if getattr(arguments, option) is not None:
            raise InputError("conflicts with --vary preset; use one of them", field=f"--{option}")
    base: dict[str, Any] = {}
    # The paper's preset gives the size of a random floor if --tiles does not.
    for name, value in values_from(arguments, preset("paper")).items():
        # Split at the first dot: strategy.soft.eta is the field soft.eta of the section strategy.
        section, _, field = name.partition(".")
        if value is not None:  # a study's base cannot hold None: TOML has no such value
            base.setdefault(section, {})[field] = value
    return base


def _varied(options: list[str]) -> dict[str, list[Any]]:
    """Return the varied values by dotted field name, parsed from the values of ``--vary``, texts ``FIELD=A,B``.

    If a value is user code (FILE.py:NAME), the file is loaded, so that the code's name and fields are known.

    Raises:
        InputError: a text is not of this form, a field is given twice, or a value of user code cannot be loaded.
    """
    from vibroswarm.cli.scenario_options import chosen
    from vibroswarm.scenario import plugins
    from vibroswarm.scenario.scenario import parse_setting

    vary: dict[str, list[Any]] = {}
    for text in options:
        name, separator, values = text.partition("=")
        name = name.strip()
        if not separator or not values.strip():
            raise InputError(f"'{text}' is not of the form section.field=value,value", field="--vary")
        if name in vary:
            raise InputError("is varied twice", field=f"--vary {name}")
        # `parse_setting` returns the name and the value, converted to its type
        vary[name] = [parse_setting(f"{name}={value}")[1] for value in values.split(",")]
        kind = name.removesuffix(".name")  # such as strategy, of strategy.name
        if kind in plugins.KINDS:
            vary[name] = [chosen(kind, item) if plugins.is_code(item) else item for item in vary[name]]
    return vary
