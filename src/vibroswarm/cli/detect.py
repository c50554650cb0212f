"""``vibroswarm detect``: the robots and time needed for few misses and false alarms."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import (
    add_json,
    add_out,
    add_pictures,
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
    """Add the command ``detect`` and its options to the program's commands."""
    parser = commands.add_parser(
        "detect",
        help="how many robots and how much time for few misses and false alarms",
        description="Estimate how often floors above the boundary are missed and floors below it raise a false alarm, "
        "and what it takes to make both rare enough.",
        epilog=EPILOG,
    )
    # --robots takes a list here: the numbers of robots that are varied.
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
    add_out(options, "save runs, tables and report here, or resume", force=True)
    add_style(options)
    add_pictures(options)
    add_running_options(parser)
    # After Ctrl-C, the work saved in the folder --out can be resumed.
    parser.set_defaults(run=run, resumes="folder")


def run(arguments: argparse.Namespace) -> int:
    """Simulate every fill ratio with every number of robots; print and save at which times errors are rare enough.

    Errors are misses of floors above the boundary, which fall with time, and false alarms on floors below it, which
    rise with time. They are rare enough while the upper limits of their shares of runs are below the tolerated
    probabilities (``--error``, ``--false-alarms``). Returns the exit code.
    """
    from vibroswarm.analysis.detection import detection_curve, needed, pairs
    from vibroswarm.cli.deliver import REPORT, print_result, save, save_requested_pictures
    from vibroswarm.cli.output import print_saved
    from vibroswarm.cli.scenario_options import scenario_from
    from vibroswarm.cli.studies import run_study_of
    from vibroswarm.documents.detection import Tolerated, detection_document
    from vibroswarm.errors import share_from
    from vibroswarm.show.document import without_pictures
    from vibroswarm.study.spec import Study
    from vibroswarm.study.summary import write_table

    error = share_from(arguments.error, "--error")
    false_alarms = share_from(arguments.false_alarms or arguments.error, "--false-alarms")
    # --robots is a list here, which the study varies; scenario_from must not take it for the field swarm.robots.
    robots, arguments.robots = arguments.robots, None
    base = scenario_from(arguments).with_values(_boundary_of(arguments))
    if base.task.name != "fill_ratio":
        raise InputError(f"must be fill_ratio for this command, not '{base.task.name}'", field="task.name")
    fills, added = _fills(arguments.fills, base)
    study = Study.of(
        base,
        arguments.runs,
        arguments.seed,
        # the varied fields; `__` stands for the dot in a field's name
        swarm__robots=robots or [base.swarm.robots],
        floor__source=[f"random:{fill:g}" for fill in fills],
    )
    result = run_study_of(study, arguments)
    if result is None:  # only a shard or a batch of the runs was requested
        return 0
    # for each cell: its table of robots and its table of runs
    cells = [result.tables(number) for number in result.selected]
    t_end_s = base.run.t_end_s
    curve = detection_curve(cells, t_end_s)
    need = needed(cells, t_end_s, error, false_alarms=false_alarms)
    tables = {"detection": curve, "needed": need, "pairs": pairs(need)}
    document = detection_document(
        tables,
        base,
        arguments.seed,
        Tolerated(error, false_alarms),
        added=added,
        warnings=_warnings(study),
    )
    if arguments.out is not None:
        for name, table in tables.items():
            write_table(table, arguments.out / name)
        save(without_pictures(document) if arguments.no_pictures else document, arguments.out, "detect")
        save_requested_pictures(document, arguments, arguments.out)
    print_result(document, arguments)
    pictures = "pictures, " if arguments.pictures else ""
    print_saved(arguments, f"tables (CSV), {pictures}the runs (shards)", REPORT)
    return 0


def _boundary_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the field ``decision.boundary_of`` with the value of ``--boundary-of``, by default "tiles".

    The result is passed to ``Scenario.with_values``. It is empty if ``--set``, or the file of ``--scenario`` alone,
    gives the field, because the scenario then has the value already.

    Raises:
        InputError: two options give the field.
    """
    from vibroswarm.core.untrusted_files import parsed_toml, read_text
    from vibroswarm.scenario.scenario import parse_setting

    field = "decision.boundary_of"
    values = [value for name, value in map(parse_setting, arguments.settings) if name == field]
    if values and arguments.boundary_of is not None:
        raise InputError(f"is also set by --set {field}; use one of them", field="--boundary-of")
    if arguments.boundary_of is None and arguments.scenario is not None:
        file = parsed_toml(read_text(arguments.scenario, "a scenario"), str(arguments.scenario))
        if "boundary_of" in file.get("decision", {}):
            return {}
    return {} if values else {field: arguments.boundary_of or "tiles"}


def _fills(given: list[float] | None, base: Scenario) -> tuple[list[float], list[float]]:
    """Return the fill ratios to simulate, and which of these were added to the given ones.

    False alarms can occur only on floors below the boundary. So if no given fill ratio is below the boundary, some fill
    ratios below it are added. Given fill ratios are not rounded: one that is no whole number of tiles is refused when
    the floor is made.

    Args:
        given: the values of ``--fills``; None to use fill ratios around the boundary.
    Returns:
        All fill ratios, the added ones first; and the added ones, an empty list if none was added or ``given`` is None.
    """
    boundary, tiles = base.decision.decision_boundary, base.floor.rows * base.floor.columns

    def in_tiles(shares: Iterable[float]) -> list[float]:
        """Limit fill ratios to 0..1 and round them to whole tiles; drop repeats and the boundary.

        On a floor whose fill ratio is the boundary, no decision is right.
        """
        fills = dict.fromkeys(round(tiles * min(max(share, 0.0), 1.0)) / tiles for share in shares)
        return [fill for fill in fills if abs(fill - boundary) > 1e-9]  # 1e-9 allows for rounding errors

    below = [fill for fill in in_tiles((0.0, boundary / 3, boundary * 2 / 3)) if fill < boundary]
    if given is not None:
        added = [] if any(fill < boundary for fill in given) else below
        return added + given, added
    if boundary == 0.5:  # FILLS are chosen for this boundary
        return in_tiles(FILLS), []
    # Floors are hardest near the boundary, so the fill ratios above it are dense there. The unit of distance is a third
    # of the way from the boundary to 0 or to 1, whichever is nearer.
    step = min(boundary, 1.0 - boundary) / 3
    above = in_tiles(boundary + step * times for times in (1, 2, 3, 5, 7))
    return below + [fill for fill in above if fill > boundary], []


def _warnings(study: Study) -> list[str]:
    """Return a sentence for each fill ratio on which the swarm cannot be right, however many samples robots take."""
    from vibroswarm.analysis.decidability import decidability

    verdicts = [decidability(cell.scenario) for cell in study.cells]
    return list(
        # Each sentence once: cells that differ only in the number of robots may give the same sentence.
        dict.fromkeys(
            f"fill ratio {verdict.fill_ratio:g}: {verdict.says}"
            for verdict in verdicts
            if verdict.verdict != "decidable"
        )
    )
