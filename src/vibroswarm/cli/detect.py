"""``vibroswarm detect``: how many robots, and how long, for few enough misses and false alarms."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import add_scenario_options
from vibroswarm.cli.studies import STYLES, add_running_options, check_style
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    import polars as pl

    from vibroswarm.scenario import Scenario
    from vibroswarm.study.result import StudyResult
    from vibroswarm.study.spec import Study

EPILOG = """\
examples:
  vibroswarm detect                                             is it more than half? fills 0.24 to 0.76
  vibroswarm detect --robots 5,10,20 --error 10% --out out/detect
  vibroswarm detect --fills 0,0.02,0.06,0.08 --tiles 10x10 --set decision.decision_boundary=0.03
  vibroswarm detect --false-alarms 1% --boundary-of readings    robots that take each reading at its word
"""
FILLS = "0.24,0.32,0.36,0.40,0.44,0.48,0.52,0.56,0.60,0.64,0.68,0.76"
"""Around a boundary of one half."""


def add_parser(commands: Any) -> None:
    """Make the command known."""
    parser = commands.add_parser(
        "detect",
        help="how many robots, and how long, for few enough misses and false alarms",
        description="How probably floors above the boundary are missed and floors below it raise a false alarm, and "
        "what it takes to have both as rare as wanted.",
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
        "--fills", metavar="F,...",
        help="fill ratios of random floors (default: on both sides of the boundary); floors below it are added where "
        "none is given",
    )  # fmt: skip
    how.add_argument("--error", metavar="P%", default="5%", help="wanted probability of a miss (default 5%%)")
    how.add_argument(
        "--false-alarms", metavar="P%", help="wanted probability of a false alarm (default: as --error)"
    )
    how.add_argument(
        "--boundary-of", choices=("tiles", "readings"),
        help="tiles (default): robots allow for their sensor's errors; readings: they take each reading at its word, "
        "as in the paper",
    )  # fmt: skip
    how.add_argument("--runs", metavar="N", default="300", help="runs a cell (default 300)")
    how.add_argument(
        "--json", action="store_true", help="give the tables as JSON, and nothing else, on stdout"
    )
    how.add_argument("--out", metavar="DIR", type=Path, help="keep runs, tables and pictures here")
    how.add_argument("--style", metavar="NAME", default="column", help=f"of pictures: {', '.join(STYLES)}")
    add_running_options(parser)
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Simulate fills x robots, report what each needs."""
    from vibroswarm.analysis.detection import detection_curve, needed, pairs
    from vibroswarm.cli.detect_tables import say_detection
    from vibroswarm.cli.scenarios import scenario_from, whole_number
    from vibroswarm.cli.studies import run_study_of
    from vibroswarm.study.precision import share_from
    from vibroswarm.study.spec import Study

    check_style(arguments.style)
    error = share_from(arguments.error, "--error")
    false_alarms = share_from(arguments.false_alarms or arguments.error, "--false-alarms")
    robots = [whole_number(text, "--robots") for text in (arguments.robots or "").split(",") if text]
    arguments.robots = None
    base = scenario_from(arguments).with_values(_boundary_of(arguments))
    if base.task.name != "fill_ratio":
        raise InputError(f"asks for shares that vibrate; the task is '{base.task.name}'", field="task.name")
    fills, added = _fills(arguments.fills, base)
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
    curve = detection_curve(cells, t_end_s)
    need = needed(cells, t_end_s, error, false_alarms=false_alarms)
    told = pairs(need)
    if arguments.out is not None:
        _keep(result, {"detection": curve, "needed": need, "pairs": told}, error, arguments)
    warnings = _warnings(study)
    if arguments.json:
        tables = {"pairs": told.to_dicts(), "needed": need.to_dicts(), "curve": curve.to_dicts()}
        print(json.dumps(tables | {"warnings": warnings}, indent=2, allow_nan=False))
    else:
        say_detection(need, told, base, error, false_alarms)
        if added:
            print(f"Added, to count false alarms: fill ratio {', '.join(f'{fill:g}' for fill in added)}.")
        for warning in warnings:
            print(f"Warning: {warning}")
    sys.stdout.flush()
    return 0


def _boundary_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """The boundary is one of tiles, unless something else is said."""
    from vibroswarm.scenario import parse_setting

    field = "decision.boundary_of"
    said = [value for name, value in map(parse_setting, arguments.settings) if name == field]
    if said and arguments.boundary_of is not None:
        raise InputError(f"is set by --set {field} too; leave one of them out", field="--boundary-of")
    return {} if said else {field: arguments.boundary_of or "tiles"}


def _fills(text: str | None, base: Scenario) -> tuple[list[float], list[float]]:
    """The fill ratios to be simulated, and those among them that were added below the boundary."""
    boundary, tiles = base.decision.decision_boundary, base.floor.rows * base.floor.columns

    def whole(shares: Iterable[float]) -> list[float]:
        """In whole tiles; none on the boundary, none twice."""
        found = dict.fromkeys(round(tiles * min(max(share, 0.0), 1.0)) / tiles for share in shares)
        return [fill for fill in found if abs(fill - boundary) > 1e-9]

    below = [fill for fill in whole((0.0, boundary / 3, boundary * 2 / 3)) if fill < boundary]
    if text is not None:
        given = [_fill(part) for part in text.split(",")]
        added = [] if any(fill < boundary for fill in given) else below
        return added + given, added
    if boundary == 0.5:
        return whole(_fill(part) for part in FILLS.split(",")), []
    step = min(boundary, 1.0 - boundary) / 3
    above = whole(boundary + step * times for times in (1, 2, 3, 5, 7))
    return below + [fill for fill in above if fill > boundary], []


def _fill(text: str) -> float:
    try:
        fill = float(text)
    except ValueError:
        fill = float("nan")
    if not 0 <= fill <= 1:
        raise InputError(
            f"'{text}' is no fill ratio; give numbers from 0 to 1, such as 0.44,0.52", field="--fills"
        )
    return fill


def _warnings(study: Study) -> list[str]:
    """Fill ratios that are judged wrongly however many robots there are and however long they wait."""
    from vibroswarm.analysis.decidability import decidability

    found = [decidability(cell.scenario) for cell in study.cells]
    return list(
        dict.fromkeys(
            f"fill ratio {one.fill_ratio:g}: {one.says}" for one in found if one.verdict != "decidable"
        )
    )


def _keep(
    result: StudyResult, tables: Mapping[str, pl.DataFrame], error: float, arguments: argparse.Namespace
) -> None:
    from vibroswarm.study.detection import detection_pictures
    from vibroswarm.study.outcome import write_table

    for name, table in tables.items():
        write_table(table, arguments.out / name)
    boundary = result.study.cells[0].scenario.decision.decision_boundary
    for name, picture in detection_pictures(tables["detection"], boundary, error, arguments.style):
        picture.write(arguments.out / name)
