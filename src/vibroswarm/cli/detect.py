"""``vibroswarm detect``: the robots and time needed for few misses and false alarms."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import (
    add_json,
    add_out,
    add_scenario_options,
    add_seed,
    add_style,
    between,
    list_of,
    real,
    whole,
)
from vibroswarm.cli.studies import add_running_options
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    import polars as pl

    from vibroswarm.scenario.scenario import Scenario
    from vibroswarm.study.spec import Study

EPILOG = """\
examples:
  vibroswarm detect                                             more than half? fill ratios 0.24 to 0.76
  vibroswarm detect --robots 5,10,20 --error 10% --out out/detect
  vibroswarm detect --fills 0,0.02,0.06,0.08 --tiles 10x10 --set decision.decision_boundary=0.03
  vibroswarm detect --false-alarms 1% --boundary-of readings    robots that ignore their sensor's errors
"""
FILLS = (0.24, 0.32, 0.36, 0.40, 0.44, 0.48, 0.52, 0.56, 0.60, 0.64, 0.68, 0.76)
"""Default fill ratios around a boundary of one half."""


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "detect",
        help="how many robots and how much time for few misses and false alarms",
        description="Estimate how often floors above the boundary are missed and floors below it raise a false alarm, "
        "and what it takes to make both rare enough.",
        epilog=EPILOG,
    )
    add_seed(add_scenario_options(parser, robots=list_of(whole)))
    options = parser.add_argument_group("detection")
    options.add_argument(
        "--fills",
        metavar="F,...",
        type=list_of(between(real, 0, 1)),
        help="fill ratios of random floors (default: around the boundary); if none is below it, some are added",
    )
    options.add_argument(
        "--error", metavar="P%", default="5%", help="tolerated probability of a miss (default 5%%)"
    )
    options.add_argument(
        "--false-alarms", metavar="P%", help="tolerated probability of a false alarm (default: as --error)"
    )
    options.add_argument(
        "--boundary-of",
        choices=("tiles", "readings"),
        help="tiles (default): robots allow for their sensor's errors; readings: they ignore them, as in the paper",
    )
    options.add_argument("--runs", metavar="N", type=whole, default=300, help="runs per cell (default 300)")
    add_json(options)
    add_out(options, "save runs, tables, pictures and report here, or resume", force=True)
    add_style(options)
    add_running_options(parser)
    parser.set_defaults(run=run, resumes="folder")


def run(arguments: argparse.Namespace) -> int:
    """Simulate fills x robots, report what each needs."""
    from vibroswarm.analysis.detection import detection_curve, needed, pairs
    from vibroswarm.cli.out_folder import deliver
    from vibroswarm.cli.output import print_paragraph, print_saved
    from vibroswarm.cli.scenario_options import scenario_from
    from vibroswarm.cli.studies import run_study_of
    from vibroswarm.study.precision import share_from
    from vibroswarm.study.spec import Study

    error = share_from(arguments.error, "--error")
    false_alarms = share_from(arguments.false_alarms or arguments.error, "--false-alarms")
    robots, arguments.robots = arguments.robots, None  # varied here, not a field of the scenario
    base = scenario_from(arguments).with_values(_boundary_of(arguments))
    if base.task.name != "fill_ratio":
        raise InputError(f"must be fill_ratio for this command, not '{base.task.name}'", field="task.name")
    fills, added = _fills(arguments.fills, base)
    study = Study.of(
        base,
        arguments.runs,
        arguments.seed,
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
    distinguished = pairs(need)
    warnings = _warnings(study)
    if arguments.out is not None:
        tables = {"detection": curve, "needed": need, "pairs": distinguished}
        _save(base, tables, (error, false_alarms), warnings, arguments)

    def show() -> None:
        print_detection(need, distinguished, base, error, false_alarms)
        if added:
            print_paragraph(
                f"Fill ratios added to count false alarms: {', '.join(f'{fill:g}' for fill in added)}."
            )
        for warning in warnings:
            print_paragraph(f"Warning: {warning}")

    def document() -> dict[str, Any]:
        named = {"pairs": distinguished.to_dicts(), "needed": need.to_dicts(), "curve": curve.to_dicts()}
        return named | {"warnings": warnings}

    deliver(arguments, arguments.out, "detect", show, document)
    print_saved(arguments, "tables (CSV), pictures, the runs (shards)", "report.html")
    return 0


def _boundary_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the field ``boundary_of``: tiles, unless an option sets it."""
    from vibroswarm.scenario.scenario import parse_setting

    field = "decision.boundary_of"
    values = [value for name, value in map(parse_setting, arguments.settings) if name == field]
    if values and arguments.boundary_of is not None:
        raise InputError(f"is also set by --set {field}; use one of them", field="--boundary-of")
    return {} if values else {field: arguments.boundary_of or "tiles"}


def _fills(given: list[float] | None, base: Scenario) -> tuple[list[float], list[float]]:
    """Return the fill ratios to simulate, and those of them that were added to the given ones.

    If none of the given ones is below the boundary, some below it are added: only they can show false alarms.
    """
    boundary, tiles = base.decision.decision_boundary, base.floor.rows * base.floor.columns

    def in_tiles(shares: Iterable[float]) -> list[float]:
        """Round to whole tiles, without repeats and without the boundary itself."""
        fills = dict.fromkeys(round(tiles * min(max(share, 0.0), 1.0)) / tiles for share in shares)
        return [fill for fill in fills if abs(fill - boundary) > 1e-9]

    below = [fill for fill in in_tiles((0.0, boundary / 3, boundary * 2 / 3)) if fill < boundary]
    if given is not None:
        added = [] if any(fill < boundary for fill in given) else below
        return added + given, added
    if boundary == 0.5:
        return in_tiles(FILLS), []
    step = min(boundary, 1.0 - boundary) / 3
    above = in_tiles(boundary + step * times for times in (1, 2, 3, 5, 7))
    return below + [fill for fill in above if fill > boundary], []


def _warnings(study: Study) -> list[str]:
    """Return a sentence for each fill ratio that no number of robots and no waiting time gets right."""
    from vibroswarm.analysis.decidability import decidability

    verdicts = [decidability(cell.scenario) for cell in study.cells]
    return list(
        dict.fromkeys(
            f"fill ratio {verdict.fill_ratio:g}: {verdict.says}"
            for verdict in verdicts
            if verdict.verdict != "decidable"
        )
    )


def _save(
    base: Scenario,
    tables: dict[str, pl.DataFrame],
    tolerated: tuple[float, float],
    warnings: list[str],
    arguments: argparse.Namespace,
) -> None:
    """Write tables, pictures and the report into the folder."""
    from vibroswarm.report.html import write_report
    from vibroswarm.study.detection_report import pictures_of, report_of
    from vibroswarm.study.summary import write_table

    for name, table in tables.items():
        write_table(table, arguments.out / name)
    boundary = base.decision.decision_boundary
    for name, picture in pictures_of(tables["detection"], boundary, tolerated[0], arguments.style):
        picture.write(arguments.out / name)
    report = report_of(tables, base, arguments.seed, *tolerated, warnings)
    write_report(arguments.out / "report.html", report)


def print_detection(
    need: pl.DataFrame, distinguished: pl.DataFrame, scenario: Scenario, error: float, false_alarms: float
) -> None:
    """Print which floors are distinguished and when, then every cell.

    Args:
        need, distinguished: from ``analysis.detection.needed`` and ``pairs``.
        error, false_alarms: tolerated probabilities.
    """
    from vibroswarm.cli.output import print_line, print_paragraph, print_table
    from vibroswarm.study.detection_report import answer, best

    t_end_s = scenario.run.t_end_s
    asked, *found = answer(distinguished, scenario, error, false_alarms)
    for sentence in (asked, *found):
        print_paragraph(sentence)
    print_line()
    if distinguished.height:
        print_table(
            ["fill ratio", "robots", "found within", "without false alarms on floors up to", ""],
            [_pair(row, t_end_s) for row in best(distinguished).iter_rows(named=True)],
            names=2,
            texts=0,
        )
    print_line()
    print_table(
        ["fill ratio", "robots", "runs", "missed, %", "false alarms, %", "needed", "clear until"],
        [
            [
                f"{row['fill_ratio']:.4g}",
                row["robots"],
                row["runs"],
                _share(row["missed"], row["missed_high"]),
                _share(row["false_alarm"], row["false_alarm_high"]),
                "-" if row["missed"] is None else _time(row["needed_s"], t_end_s),
                _clear(row),
            ]
            for row in need.iter_rows(named=True)
        ],
        names=2,
        texts=0,
        more=("runs",),
    )
    print_paragraph(
        f"Missed: no right consensus by {t_end_s:g} s; undecided counts. False alarm: a wrong consensus on 'more'. "
        "In brackets the upper limit (95 %, Wilson over runs), which must be below the tolerated probability. Needed: "
        "when that of misses falls below it; clear until: how long that of false alarms stays below it. Each limit "
        "holds separately."
    )


def _pair(row: dict[str, float | None], t_end_s: float) -> list[object]:
    start: list[object] = [f"{row['fill_ratio']:.4g}", row["robots"], _time(row["time_s"], t_end_s)]
    if row["time_s"] is None:
        return [*start, "-", ""]
    return [*start, f"{row['fill_ratio_below']:.4g}", "(fewest robots)" if row["fewest"] else ""]


def _share(share: float | None, high: float | None) -> str:
    return "-" if share is None or high is None else f"{100 * share:.1f} (below {100 * high:.1f})"


def _time(time_s: float | None, t_end_s: float) -> str:
    return f"not by {t_end_s:g} s" if time_s is None else f"{time_s:.0f} s"


def _clear(row: dict[str, float | None]) -> str:
    """Format the time until which false alarms are rare enough; ``-`` if they were not measured."""
    if row["false_alarm"] is None:
        return "-"
    until_s = row["clear_until_s"]
    if until_s is None:
        return "the end"
    return f"{until_s:.0f} s" if until_s > 0 else "never"
