"""``vibroswarm evaluate``: many runs of a scenario, or of a few side by side."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import add_scenario_options
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
    """Make the command known."""
    parser = commands.add_parser(
        "evaluate",
        help="run a scenario many times, or several side by side",
        description="Run a scenario many times: figures with intervals, comparisons, pictures.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    what = add_scenario_options(parser)
    what.add_argument("--seed", metavar="S", default="1", help="same study and seed: same result (default 1)")
    what.add_argument(
        "--motion",
        metavar="NAME",
        default="event",
        help="engine: event (default), fixed-step, or FILE.py:NAME",
    )
    many = parser.add_argument_group("how many")
    many.add_argument("--runs", metavar="N", help="runs a cell (default 100)")
    many.add_argument(
        "--until", metavar="P%", help="as many as it takes: until a figure's interval is +- P %% wide"
    )
    many.add_argument(
        "--figure", metavar="NAME", help="which figure --until looks at (default decision_time_s)"
    )
    many.add_argument("--max-runs", metavar="N", help="no more than so many with --until (default 100000)")
    many.add_argument(
        "--vary", metavar="FIELD=A,B,...", action="append", default=[],
        help="one cell a value; may be repeated: every combination. --strategy a,b varies too",
    )  # fmt: skip
    many.add_argument("--keep-samples", action="store_true", help="keep a table of samples too")
    parser.add_argument(
        "--out", metavar="DIR", type=Path, help="keep runs, numbers, pictures and report here"
    )
    add_running_options(parser)
    add_outcome_options(parser)
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Make a study of the options and do it."""
    return do_study(study_from(arguments), arguments)


def study_from(arguments: argparse.Namespace) -> Study:
    """The study that the options describe."""
    from vibroswarm.cli.scenarios import chosen, scenario_from, whole_number
    from vibroswarm.study.precision import Precision
    from vibroswarm.study.spec import Study

    vary = _varied(arguments.vary)
    strategies = [] if arguments.strategy is None else arguments.strategy.split(",")
    if len(strategies) > 1:
        names = [chosen("strategy", name.strip()) for name in strategies]
        if "strategy.name" in vary:
            raise InputError("is varied by --strategy too", field="--vary strategy.name")
        vary["strategy.name"] = names
        arguments.strategy = None
    base = scenario_from(arguments)
    until = None
    if arguments.until is not None:
        if arguments.runs is not None:
            raise InputError("say --runs or --until, not both", field="--until")
        most = None if arguments.max_runs is None else whole_number(arguments.max_runs, "--max-runs")
        until = Precision.from_words(arguments.until, arguments.figure, most)
    elif arguments.figure is not None or arguments.max_runs is not None:
        raise InputError(
            "goes with --until", field="--figure" if arguments.figure is not None else "--max-runs"
        )
    return Study(
        base=_base_of_presets(arguments) if "preset" in vary else base.model_dump(exclude_none=True),
        vary={"grid": vary} if vary else {},
        runs=None if until is not None else whole_number(arguments.runs or "100", "--runs"),
        until=until,
        seed=whole_number(arguments.seed, "--seed"),
        motion=chosen("motion", arguments.motion),
        keep=("samples",) if arguments.keep_samples else (),
        folder=Path(),
    )


def _base_of_presets(arguments: argparse.Namespace) -> dict[str, Any]:
    """Where presets are varied: only the fields that the options say, which go before those of each preset."""
    from vibroswarm.cli.scenarios import values_from
    from vibroswarm.presets import preset

    for option in ("preset", "scenario"):
        if getattr(arguments, option) is not None:
            raise InputError("says what --vary preset varies; leave one of them out", field=f"--{option}")
    base: dict[str, Any] = {}
    for name, value in values_from(arguments, preset("paper")).items():
        section, _, field = name.partition(".")
        if value is not None:
            base.setdefault(section, {})[field] = value
    return base


def _varied(options: list[str]) -> dict[str, list[Any]]:
    """``FIELD=A,B`` as field and values."""
    from vibroswarm import code_files
    from vibroswarm.cli.scenarios import chosen
    from vibroswarm.scenario import parse_setting

    vary: dict[str, list[Any]] = {}
    for text in options:
        name, separator, values = text.partition("=")
        name = name.strip()
        if not separator or not values.strip():
            raise InputError(f"'{text}' is not of the form section.field=value,value", field="--vary")
        if name in vary:
            raise InputError("is varied twice", field=f"--vary {name}")
        vary[name] = [parse_setting(f"{name}={value}")[1] for value in values.split(",")]
        kind = name.removesuffix(".name")
        if kind in code_files.KINDS:
            vary[name] = [chosen(kind, one) if code_files.is_code(one) else one for one in vary[name]]
    return vary
