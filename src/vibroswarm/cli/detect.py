"""``vibroswarm detect``: which fill ratios a swarm tells, how many robots it takes, and how long."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import add_scenario_options
from vibroswarm.cli.studies import STYLES, add_running_options, check_style
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    import polars as pl

    from vibroswarm.study.result import StudyResult
    from vibroswarm.study.spec import Study

EPILOG = """\
examples:
  vibroswarm detect                                             fills 0.24 to 0.48, error 5 %
  vibroswarm detect --robots 5,10,20 --error 10% --out out/detect
  vibroswarm detect --fills 0.01,0.02,0.04,0.05 --tiles 10x10 --set decision.decision_boundary=0.03
"""
FILLS = "0.24,0.32,0.36,0.40,0.44,0.48"


def add_parser(commands: Any) -> None:
    """Make the command known."""
    parser = commands.add_parser(
        "detect",
        help="how many robots, and how long, for a wanted error",
        description="How probably floors of given fill ratios are missed, and what it takes to miss fewer.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    what = add_scenario_options(parser)
    what.add_argument(
        "--seed", metavar="S", default="1", help="same scenario and seed: same result (default 1)"
    )
    how = parser.add_argument_group("what is asked")
    how.add_argument(
        "--fills", metavar="F,...", default=FILLS, help=f"fill ratios of random floors ({FILLS})"
    )
    how.add_argument("--error", metavar="P%", default="5%", help="wanted probability of a miss (default 5%%)")
    how.add_argument("--runs", metavar="N", default="300", help="runs a cell (default 300)")
    how.add_argument(
        "--json", action="store_true", help="give the tables as JSON, and nothing else, on stdout"
    )
    how.add_argument("--out", metavar="DIR", type=Path, help="keep runs, tables and pictures here")
    how.add_argument("--style", metavar="NAME", default="column", help=f"of pictures: {', '.join(STYLES)}")
    add_running_options(parser)
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate fills x robots, tell what each needs."""
    from vibroswarm.analysis.detection import detection_curve, needed
    from vibroswarm.cli.scenarios import scenario_from, whole_number
    from vibroswarm.cli.studies import run_study_of
    from vibroswarm.study.precision import share_from
    from vibroswarm.study.spec import Study

    check_style(arguments.style)
    error = share_from(arguments.error, "--error")
    fills = [_fill(text) for text in arguments.fills.split(",")]
    robots = [whole_number(text, "--robots") for text in (arguments.robots or "").split(",") if text]
    arguments.robots = None
    base = scenario_from(arguments)
    study = Study.of(
        base,
        whole_number(arguments.runs, "--runs"),
        whole_number(arguments.seed, "--seed"),
        swarm__robots=robots or [base.swarm.robots],
        floor__source=[f"random:{fill:g}" for fill in fills],
    )
    result = run_study_of(study, arguments)
    if result is None:
        return 0
    cells = [result.tables(number) for number in result.selected]
    t_end_s = base.run.t_end_s
    curve, need = detection_curve(cells, t_end_s), needed(cells, t_end_s, error)
    if arguments.out is not None:
        _keep(result, curve, need, error, arguments)
    warnings = _warnings(study)
    if arguments.json:
        told = {"needed": need.to_dicts(), "curve": curve.to_dicts(), "warnings": warnings}
        print(json.dumps(told, indent=2, allow_nan=False))
    else:
        _say(need, error, t_end_s)
        for warning in warnings:
            print(f"Warning: {warning}")
    sys.stdout.flush()
    return 0


def _fill(text: str) -> float:
    try:
        fill = float(text)
    except ValueError:
        fill = float("nan")
    if not 0 <= fill <= 1:
        raise InputError(
            f"'{text}' is no fill ratio; give numbers from 0 to 1, such as {FILLS}", field="--fills"
        )
    return fill


def _warnings(study: Study) -> list[str]:
    """Fill ratios that no number of robots, and no waiting, will tell."""
    from vibroswarm.analysis.decidability import decidability

    found = [decidability(cell.scenario) for cell in study.cells]
    return list(
        dict.fromkeys(
            f"fill ratio {one.fill_ratio:g}: {one.says}" for one in found if one.verdict != "decidable"
        )
    )


def _keep(
    result: StudyResult, curve: pl.DataFrame, need: pl.DataFrame, error: float, arguments: argparse.Namespace
) -> None:
    from vibroswarm.study.detection import detection_pictures
    from vibroswarm.study.outcome import write_table

    write_table(curve, arguments.out / "detection")
    write_table(need, arguments.out / "needed")
    boundary = result.study.cells[0].scenario.decision.decision_boundary
    for name, picture in detection_pictures(curve, boundary, error, arguments.style):
        picture.write(arguments.out / name)


def _say(need: pl.DataFrame, error: float, t_end_s: float) -> None:
    print(
        f"{'fill ratio':>10} {'robots':>7} {'runs':>6}   missed by the end      needed for {100 * error:g} %"
    )
    for row in need.iter_rows(named=True):
        missed = "not defined (on the boundary)"
        if row["missed"] is not None:
            missed = f"{100 * row['missed']:5.1f} % (below {100 * row['missed_high']:.1f} %)"
        time = "-" if row["missed"] is None else f"more than {t_end_s:g} s"
        if row["needed_s"] is not None:
            time = f"{row['needed_s']:.0f} s" + (" (fewest robots)" if row["fewest"] else "")
        print(f"{row['fill_ratio']:>10.4g} {row['robots']:>7} {row['runs']:>6}   {missed:<21} {time}")
    print(
        "Missed: no right consensus by then; undecided counts. In brackets the upper limit (95 %, Wilson over runs), "
        "which has to lie below the wanted error."
    )
