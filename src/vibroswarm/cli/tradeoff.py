"""``vibroswarm tradeoff``: time against error over p_c and O_c, all on the same motion."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import add_scenario_options
from vibroswarm.cli.studies import STYLES, check_style
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    import polars as pl

THRESHOLDS = "0.7,0.8,0.9,0.95,0.98,0.99"
OBSERVATIONS = "0,50,100,200,300,400,600"
MARKER = "tradeoff.csv"


def add_parser(commands: Any) -> None:
    """Make the command known."""
    parser = commands.add_parser(
        "tradeoff",
        help="time against error, over p_c and O_c",
        description="Decision time against error for each credible threshold and minimum of observations, by replay.",
        allow_abbrev=False,
    )
    what = add_scenario_options(parser)
    what.add_argument(
        "--seed", metavar="S", default="1", help="same scenario and seed: same result (default 1)"
    )
    how = parser.add_argument_group("what is asked")
    how.add_argument("--thresholds", metavar="P,...", default=THRESHOLDS, help=f"p_c ({THRESHOLDS})")
    how.add_argument("--observations", metavar="N,...", default=OBSERVATIONS, help=f"O_c ({OBSERVATIONS})")
    how.add_argument("--runs", metavar="N", default="300", help="runs (default 300)")
    how.add_argument("--workers", metavar="N", default="2", help="threads (default 2)")
    how.add_argument(
        "--json", action="store_true", help="give the table as JSON, and nothing else, on stdout"
    )
    how.add_argument("--out", metavar="DIR", type=Path, help="keep table, picture and scenario here")
    how.add_argument("--force", action="store_true", help="replace what is there")
    how.add_argument("--style", metavar="NAME", default="column", help=f"of the picture: {', '.join(STYLES)}")
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Replay all settings on the same runs; tell the front."""
    from vibroswarm.analysis.tradeoff import time_error_curve
    from vibroswarm.cli.progress import say_compiling
    from vibroswarm.cli.scenarios import scenario_from, whole_number
    from vibroswarm.files import check_folder, whole_folder

    check_style(arguments.style)
    scenario = scenario_from(arguments)
    if arguments.out is not None:
        check_folder(arguments.out, replace=arguments.force, marker=MARKER)
    say_compiling()
    curve = time_error_curve(
        scenario,
        whole_number(arguments.seed, "--seed"),
        whole_number(arguments.runs, "--runs"),
        [_number(text, "--thresholds") for text in arguments.thresholds.split(",")],
        [whole_number(text, "--observations") for text in arguments.observations.split(",")],
        workers=whole_number(arguments.workers, "--workers"),
    )
    if arguments.out is not None:
        from vibroswarm.study.outcome import write_table

        with whole_folder(arguments.out, replace=arguments.force, marker=MARKER) as part:
            write_table(curve, part / "tradeoff")
            _picture(curve, arguments.style).write(part / "front")
            (part / "scenario.toml").write_text(scenario.to_toml(), encoding="utf-8")
    if arguments.json:
        print(json.dumps(curve.to_dicts(), indent=2, allow_nan=False))
    else:
        _say(curve)
    sys.stdout.flush()
    return 0


def _number(text: str, option: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"'{text}' is no number", field=option) from None


def _picture(curve: pl.DataFrame, style: str) -> Any:
    import polars as pl

    from vibroswarm.plots.front import draw_front

    frame = curve.select(
        "error",
        "error_low",
        "error_high",
        "runs",
        name=pl.format("p_c {}, O_c {}", "credible_threshold", "min_observations"),
        time="decision_time_s",
        time_low="decision_time_s_low",
        time_high="decision_time_s_high",
        front="pareto",
    )
    return draw_front(frame, error_label="share of robots wrong", percent=True, style=style)


def _say(curve: pl.DataFrame) -> None:
    front = curve.filter("pareto").sort("decision_time_s")
    print(
        f"On the front, of {curve.height} settings and {curve['runs'][0]} runs each (95 % intervals over runs):"
    )
    print(f"{'p_c':>6} {'O_c':>6}   {'decision time, s':<22} {'robots wrong':<24} robots undecided")
    for row in front.iter_rows(named=True):
        time = f"{row['decision_time_s']:.0f} [{row['decision_time_s_low']:.0f}, {row['decision_time_s_high']:.0f}]"
        wrong = f"{100 * row['error']:.1f} % [{100 * row['error_low']:.1f}, {100 * row['error_high']:.1f}]"
        undecided = f"{100 * row['robots_undecided']:.1f} %"
        print(
            f"{row['credible_threshold']:>6g} {row['min_observations']:>6}   {time:<22} {wrong:<24} {undecided}"
        )
    print("Robots that never decide count with the whole time, and not as wrong: they are shown beside.")
