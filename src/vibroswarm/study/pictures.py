"""Choose and draw the pictures that fit a study.

A picture is chosen here together with the function that draws it, and drawn later, in the style of a page or a paper.
Most pictures are drawn from the figures of the study's cells. The pictures of samples need the samples themselves,
which a study rarely saves: some of its runs are simulated again from the seed, and the picture says how many.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
import polars as pl
from scipy.special import betainc

from vibroswarm.analysis.incidence import robot_incidence, swarm_incidence
from vibroswarm.observation.decision_boundary import readings_boundary
from vibroswarm.plots.comparisons import draw_forest, draw_outcomes
from vibroswarm.plots.curves import draw_belief, draw_detection, draw_incidence
from vibroswarm.plots.distributions import draw_boxes
from vibroswarm.plots.error_bars import draw_error_bars
from vibroswarm.plots.front import draw_front
from vibroswarm.plots.heat import draw_density, draw_heat
from vibroswarm.plots.picture import Picture
from vibroswarm.study.cell_comparison import Compared
from vibroswarm.study.picture_axes import Layout, label_of, layout_of, name_of, number_of, plane_of
from vibroswarm.study.spec import SOURCE
from vibroswarm.study.summary import CellOutcome, Outcome

MOST_ROWS: Final = 48
"""Most cells in a picture with one row for each cell."""
MOST_SERIES: Final = 8
"""Most lines in a picture."""
MOST_PANELS: Final = 6
"""Most pictures of a kind."""
SIMULATED_RUNS: Final = 100
"""Most runs of a cell simulated again for a picture of samples."""
MOST_POINTS: Final = 400
"""Most points of the picture of detection."""
TIMES: Final = 121
"""Number of points of a curve over time."""


@dataclass(frozen=True)
class NamedPicture:
    """A picture's file name, its title, and the function that draws it."""

    name: str
    title: str
    draw: Callable[..., Picture]
    """Takes the style by keyword."""


def pictures_of(outcome: Outcome) -> Iterator[NamedPicture]:
    """Yield all pictures that fit the study, the most informative first.

    A picture with a row for each cell is left out if there are more than ``MOST_ROWS`` cells, boxes at more than half
    as many. Figures along a numeric field are always yielded: ``_bars`` limits their lines and rows. The name
    of a picture is its file name without a suffix; ``StudyResult.plot`` takes it too.
    """
    cells, layout = outcome.cells, layout_of([row.cell for row in outcome.cells])
    if len(cells) <= MOST_ROWS:
        yield NamedPicture("outcomes", "Outcomes of the swarms", partial(_outcomes, cells))
    for figure, title, label, percent in _FIGURES:
        if layout.x is not None or len(cells) <= MOST_ROWS:
            yield NamedPicture(figure, title, _bars(cells, layout, figure, label, percent))
    yield from _planes(cells)
    yield from _incidences(outcome, layout)
    if len(cells) <= MOST_ROWS // 2:
        yield NamedPicture("consensus-box", "Time of consensus, run by run", _spread(outcome))
    yield from _fronts(cells)
    yield from _forests(outcome.comparisons)
    # ``swarm_right.n`` counts the runs with a truth: those in which one of the two decisions is right.
    if layout.field == SOURCE and any(row.summary.swarm_right.n for row in cells):
        yield NamedPicture("detection", "Which fill ratios are judged correctly", _detection(cells, layout))
    yield from _samples(outcome)


_FIGURES: Final = (
    ("decision_time_s", "Decision time (restricted mean)", "decision time (s)", False),
    ("belief_in_truth", "Belief in the truth (the paper's accuracy)", "belief in the truth", False),
    ("robots_right", "Robots that decided rightly", "robots right", True),
    ("robots_wrong", "Robots that decided wrongly", "robots wrong", True),
)
"""Figures with a picture: field of ``cell_summary.CellSummary``, title, label of the axis, whether it is a share."""


def _outcomes(cells: Sequence[CellOutcome], style: str) -> Picture:
    """Draw how many swarms of each cell ended with each kind of consensus."""
    kinds = ("right", "wrong", "split", "incomplete", "truth_undefined")
    rows = []
    for cell_outcome in cells:
        shares = {kind: getattr(cell_outcome.summary, f"swarm_{kind}") for kind in kinds}
        # The share of ``n`` runs, times ``n``, is a number of runs; a share of no runs is undefined (nan).
        counts = {kind: round(share.estimate * share.n) if share.n else 0 for kind, share in shares.items()}
        limits = {"right_low": shares["right"].low, "right_high": shares["right"].high}
        rows.append({"cell": name_of(cell_outcome.cell), **counts, **limits})
    return draw_outcomes(_frame(rows), interval="95 % Wilson interval", style=style)


def _bars(
    cells: Sequence[CellOutcome], layout: Layout, figure: str, label: str, percent: bool
) -> Callable[..., Picture]:
    """Return the function that draws a figure with its intervals.

    It is drawn along ``layout.x`` with a line for each series. If there is no x, or if there are more than
    ``MOST_SERIES`` lines, each cell has a row of its own instead, up to ``MOST_ROWS`` cells.

    Args:
        figure: name in ``CellSummary``. label: of its axis. percent: whether it is a share, shown in percent.
    """
    rows = []
    for cell_outcome in cells:
        estimated, number = getattr(cell_outcome.summary, figure), cell_outcome.cell.number
        x = name_of(cell_outcome.cell) if layout.x is None else layout.x[number]
        series = {} if layout.x is None else {"series": layout.series[number]}
        interval = {"estimate": estimated.estimate, "low": estimated.low, "high": estimated.high}
        rows.append({"x": x, **series, **interval, "runs": cell_outcome.summary.runs})
    frame = _frame(rows)
    too_many_lines = layout.x is not None and frame["series"].n_unique() > MOST_SERIES
    if too_many_lines:  # each cell gets a row under its own name
        frame = frame.select(
            pl.Series("x", [name_of(cell_outcome.cell) for cell_outcome in cells]),
            pl.all().exclude("x", "series"),
        )
        frame = frame.head(MOST_ROWS)
    return partial(
        draw_error_bars,
        frame,
        x_label="" if too_many_lines else layout.label,
        label=label,
        interval="95 % interval",
        percent=percent,
    )


def _planes(cells: Sequence[CellOutcome]) -> Iterator[NamedPicture]:
    """Yield heat maps of decision time and of swarms right over two numeric fields.

    There are two maps for each combination of the values of the other varied fields, up to ``MOST_PANELS``
    combinations. Nothing is yielded unless exactly two fields fit (``plane_of``).
    """
    plane = plane_of([cell_outcome.cell for cell_outcome in cells])
    if plane is None:
        return
    panels: dict[str, list[CellOutcome]] = {}  # the cells of each map, by the other values as text
    for cell_outcome in cells:
        rest = ", ".join(f"{v}" for k, v in cell_outcome.cell.point.items() if k not in plane)
        panels.setdefault(rest, []).append(cell_outcome)
    for number, (rest, part) in enumerate(
        list(panels.items())[:MOST_PANELS]
    ):  # ``part``: the cells of this map
        for figure, label, best in (
            ("decision_time_s", "decision time (s)", "low"),
            ("swarm_right", "swarms right", "high"),
        ):
            name = f"heat-{figure.replace('_', '-')}" + (f"-{number + 1}" if len(panels) > 1 else "")
            title = f"{label} over {label_of(plane[0])} and {label_of(plane[1])}" + (
                f": {rest}" if rest else ""
            )
            yield NamedPicture(name, title, _heat(part, plane, figure, label, best))


def _heat(
    cells: Sequence[CellOutcome], plane: tuple[str, str], figure: str, label: str, best: str
) -> Callable[..., Picture]:
    """Return the function that draws a figure as a map over the two fields of ``plane``.

    Args:
        figure: name in ``CellSummary``. label: of its colours. best: whether ``low`` or ``high`` values are better.
    """
    rows = [
        {
            "x": number_of(cell_outcome.cell, plane[0]),
            "y": number_of(cell_outcome.cell, plane[1]),
            "value": getattr(cell_outcome.summary, figure).estimate,
            "runs": cell_outcome.summary.runs,
        }
        for cell_outcome in cells
    ]
    x_label, y_label = label_of(plane[0]), label_of(plane[1])
    return partial(draw_heat, _frame(rows), x_label=x_label, y_label=y_label, label=label, best=best)


def _incidences(outcome: Outcome, layout: Layout) -> Iterator[NamedPicture]:
    """Yield pictures of decisions over time, each once for robots and once for swarms.

    In a picture each cell has two lines: right decisions upwards and wrong decisions downwards. If there are at most
    ``MOST_SERIES // 2`` cells, one picture shows all of them, with at most ``MOST_SERIES`` lines. Otherwise there is a
    picture for each value of x, the numeric field along the axis; without such a field there is none. A picture for one
    value may show up to ``MOST_SERIES`` cells, and is left out if the value has more. Of the pictures that remain, the
    first ``MOST_PANELS`` are yielded. A cell is left out if none of its runs has a truth, that is, a right decision.
    """
    # ``swarm_right.n`` counts the runs with a truth, whether or not their swarms decided rightly.
    cells = [cell_outcome for cell_outcome in outcome.cells if cell_outcome.summary.swarm_right.n]
    if 0 < len(cells) <= MOST_SERIES // 2:
        panels = {"": cells}  # the cells of each picture, by the words that its title adds
    elif layout.x is not None:
        panels = {}
        for cell_outcome in cells:
            panels.setdefault(f"{layout.label} {layout.x[cell_outcome.cell.number]:g}", []).append(
                cell_outcome
            )
    else:
        return
    # Here ``MOST_SERIES`` limits the cells of a picture, so the lines in either direction.
    panels_shown = [(words, part) for words, part in panels.items() if len(part) <= MOST_SERIES][:MOST_PANELS]
    for number, (words, part) in enumerate(panels_shown):
        for unit in ("robot", "swarm"):
            name = f"incidence-{unit}s" + (f"-{number + 1}" if len(panels_shown) > 1 else "")
            title = f"Decisions of {unit}s over time" + (f": {words}" if words else "")
            # ``words`` is empty for the picture of all cells, in which curves are named by cell and not by series.
            yield NamedPicture(name, title, _incidence(outcome, part, layout if words else None, unit))


def _incidence(
    outcome: Outcome, cells: Sequence[CellOutcome], layout: Layout | None, unit: str
) -> Callable[..., Picture]:
    """Return the function that draws decisions over time, with the curves of each cell.

    Args:
        layout: names the curves by their series; None: they are named by their cells.
        unit: ``robot`` or ``swarm``, whose decisions are drawn.
    """
    frames = []
    for cell_outcome in cells:
        robots, runs = outcome.result.tables(cell_outcome.cell.number)
        t_end_s = cell_outcome.summary.t_end_s
        times_s = np.linspace(0.0, t_end_s, TIMES)
        incidence = robot_incidence if unit == "robot" else swarm_incidence
        series = name_of(cell_outcome.cell) if layout is None else layout.series[cell_outcome.cell.number]
        frames.append(incidence(robots, runs, t_end_s, times_s).with_columns(series=pl.lit(series)))
    # The caption gives one number of runs and one of robots for all cells. The smallest of each is what every cell has.
    count = min(cell_outcome.summary.runs for cell_outcome in cells)
    size = min(cell_outcome.cell.scenario.swarm.robots for cell_outcome in cells)
    t_end_s = max(cell_outcome.summary.t_end_s for cell_outcome in cells)
    return partial(
        draw_incidence,
        pl.concat(frames),
        runs=count * size if unit == "robot" else count,
        unit="robot" if unit == "robot" else "run",
        interval=f"95 % interval over {count} runs",
        t_end=t_end_s,
    )


def _spread(outcome: Outcome) -> Callable[..., Picture]:
    """Return the function that draws the distribution of consensus times for each cell.

    A run without consensus has no such time (null); it is counted as "without consensus".
    """
    frames = []
    for cell_outcome in outcome.cells:
        _, runs = outcome.result.tables(cell_outcome.cell.number)
        frames.append(runs.select(cell=pl.lit(name_of(cell_outcome.cell)), value="consensus_time_s"))
    t_end_s = max(cell_outcome.summary.t_end_s for cell_outcome in outcome.cells)
    return partial(
        draw_boxes,
        pl.concat(frames),
        label="time of consensus (s)",
        t_end=t_end_s,
        missing="without consensus",
    )


def _fronts(cells: Sequence[CellOutcome]) -> Iterator[NamedPicture]:
    """Yield a picture of decision time against error for each floor, for at most the first ``MOST_PANELS`` floors.

    A front shows settings among which one may choose. The floor cannot be chosen, so cells on different floors are in
    different pictures. A floor with only one cell has no picture.
    """
    floors: dict[str, list[CellOutcome]] = {}
    for cell_outcome in cells:
        floors.setdefault(str(cell_outcome.cell.point.get(SOURCE, "")), []).append(cell_outcome)
    for number, (floor, part) in enumerate(list(floors.items())[:MOST_PANELS]):
        if len(part) > 1:
            name = "front" + (f"-{number + 1}" if len(floors) > 1 else "")
            title = "Time against error" + (f": {floor}" if floor else "")
            yield NamedPicture(name, title, partial(_front, part))


def _front(cells: Sequence[CellOutcome], style: str) -> Picture:
    """Draw decision time against forced error, one point for each cell.

    The forced error is the share of robots that are wrong, or undecided and leaning to the wrong side.
    """
    rows = []
    for cell_outcome in cells:
        time, error = cell_outcome.summary.decision_time_s, cell_outcome.forced_error
        rows.append(
            {
                "name": name_of(cell_outcome.cell),
                "time": time.estimate,
                "time_low": time.low,
                "time_high": time.high,
                "error": error.estimate,
                "error_low": error.low,
                "error_high": error.high,
                "runs": cell_outcome.summary.runs,
            }
        )
    return draw_front(_frame(rows), error_label="forced error", percent=True, style=style)


def _forests(compared: Sequence[Compared]) -> Iterator[NamedPicture]:
    """Yield one picture for each compared figure, with its paired differences and their intervals."""
    for figure, title, label, better in (
        ("decision_time_s", "Decision time, run by run", "difference in decision time (s)", "low"),
        ("right_share", "Robots right, run by run", "difference in robots right (percentage points)", "high"),
        ("wrong_share", "Robots wrong, run by run", "difference in robots wrong (percentage points)", "low"),
        (
            "undecided_share",
            "Robots undecided, run by run",
            "difference in robots undecided (percentage points)",
            "low",
        ),
    ):
        scale = 1.0 if figure == "decision_time_s" else 100.0  # shares are shown in percentage points
        # ``first``: the difference in the study's own runs, not in a second block from another seed.
        rows = [
            {
                "comparison": comparison.name,
                "difference": scale * comparison.first.difference.estimate,
                "low": scale * comparison.first.difference.low,
                "high": scale * comparison.first.difference.high,
                "wins": comparison.first.wins,
                "ties": comparison.first.ties,
                "losses": comparison.first.losses,
                "runs": comparison.first.pairs,
            }
            for comparison in compared
            if comparison.first.figure == figure
        ][:MOST_ROWS]
        if rows:
            draw = partial(draw_forest, _frame(rows), label=label, better=better)
            yield NamedPicture(f"compared-{figure.replace('_', '-')}", title, draw)


def _detection(cells: Sequence[CellOutcome], layout: Layout) -> Callable[..., Picture]:
    """Return the function that draws the share of runs without a right consensus against the fill ratio.

    Args:
        layout: with the fill ratio along x.
    """
    assert layout.x is not None  # x is the fill ratio
    rows = []
    for cell_outcome in cells:
        right = cell_outcome.summary.swarm_right
        rows.append(
            {
                "fill_ratio": layout.x[cell_outcome.cell.number],
                "series": layout.series[cell_outcome.cell.number],
                "missed": 1 - right.estimate,
                # The share of misses is 1 - the share of right consensus, so the two limits change places.
                "low": 1 - right.high,
                "high": 1 - right.low,
                "runs": cell_outcome.summary.runs,
            }
        )
    # The picture has one boundary: that of the first cell.
    boundary = cells[0].cell.scenario.decision.decision_boundary
    return partial(draw_detection, _frame(rows).head(MOST_POINTS), boundary=boundary)


def _samples(outcome: Outcome) -> Iterator[NamedPicture]:
    """Yield pictures from samples: where robots sampled, and beliefs over time.

    Cells of a group share their motion, so each group has one picture of where robots sampled. These pictures are left
    out if there are more than ``MOST_PANELS`` groups. The picture of beliefs is left out if there are more than
    ``MOST_SERIES`` cells. Both are left out if no robot sampled.
    """
    groups = outcome.result.plan.groups
    if len(groups) <= MOST_PANELS:
        for group in groups:
            in_group = (cell_outcome for cell_outcome in outcome.cells if cell_outcome.cell in group.cells)
            # Cells of a group may end at different times, so the first one may have no samples, unlike the others.
            one = next((cell_outcome for cell_outcome in in_group if _sampled(outcome, cell_outcome)), None)
            if one is not None:
                name = "density" + (f"-{group.number + 1}" if len(groups) > 1 else "")
                words = f": {name_of(one.cell)}" if len(groups) > 1 else ""
                yield NamedPicture(name, f"Where robots sampled{words}", partial(_density, outcome, one))
    if len(outcome.cells) <= MOST_SERIES and any(_sampled(outcome, one) for one in outcome.cells):
        yield NamedPicture("belief", "Belief over time", partial(_belief, outcome))


def _sampled(outcome: Outcome, one: CellOutcome) -> bool:
    """Return whether any robot sampled in those runs of a cell that are simulated again for a picture."""
    number = one.cell.number
    of_robots = outcome.result.unsorted_rows(number).select("run", "samples")
    chosen = of_robots.filter(pl.col("run").is_in(outcome.result.runs_again(number, SIMULATED_RUNS)))
    return bool(chosen.select((pl.col("samples") > 0).any()).collect().item())


def _density(outcome: Outcome, one: CellOutcome, style: str) -> Picture:
    """Draw where the robots of a cell sampled, with the tiles of the floor if it is the same in all runs."""
    # At least one run: the cells of an outcome have stored runs.
    chosen = outcome.result.runs_again(one.cell.number, SIMULATED_RUNS)
    result, runs = outcome.result.result(one.cell.number, chosen), len(chosen)
    arena, floor = one.cell.scenario.arena, result.floor(chosen[0])
    fixed = not one.cell.scenario.floor.drawn_by_run  # the floor is the same in all runs
    return draw_density(
        result.motion.select("x_m", "y_m"),
        width_m=arena.width_m,
        height_m=arena.height_m,
        tiles=floor.tiles if fixed else None,
        tile_size_m=(floor.tile_width_m, floor.tile_height_m) if fixed else None,
        corner_m=(floor.left_m, floor.bottom_m) if fixed else (0.0, 0.0),  # not used without tiles
        title=f"{runs} of {one.summary.runs} runs" if runs < one.summary.runs else "",
        style=style,
    )


def _belief(outcome: Outcome, style: str) -> Picture:
    """Draw quantiles of the robots' belief over time for each cell, from runs that are simulated again."""
    frames, runs = [], SIMULATED_RUNS
    for cell_outcome in outcome.cells:
        number = cell_outcome.cell.number
        # ``min`` states the limit only: ``runs_again`` returns no more runs than the cell has.
        chosen = outcome.result.runs_again(number, min(cell_outcome.summary.runs, SIMULATED_RUNS))
        result = outcome.result.result(number, chosen)
        runs = len(chosen)  # the caption gives one number for all cells: that of the last one
        robots = len(chosen) * cell_outcome.cell.scenario.swarm.robots
        # The tables ``inference`` and ``motion`` have the same samples in the same order.
        frames.append(
            _belief_bands(result.inference.with_columns(time_s=result.motion["time_s"]), robots, cell_outcome)
        )
    decision = outcome.cells[0].cell.scenario.decision  # boundary and threshold are those of the first cell
    return draw_belief(
        pl.concat(frames),
        label=f"belief in a fill below {decision.decision_boundary:g}",
        thresholds=(decision.credible_threshold, 1 - decision.credible_threshold),
        boundary=None,  # the boundary is a fill ratio, not a belief
        runs=runs,
        unit="robot",
        style=style,
    )


def _belief_bands(samples: pl.DataFrame, robots: int, one: CellOutcome) -> pl.DataFrame:
    """Tabulate the 5, 25, 50, 75 and 95 % quantiles of the belief over all robots and runs, at ``TIMES`` times.

    A robot's belief at a time is the belief after its latest sample up to that time. Before its first sample, and if
    the strategy gives no belief, it is the belief of the prior.

    Args:
        samples: run, robot, time_s and belief_below of each sample, in any order. robots: number of robots in all runs.
    Returns: time_s, series (the cell's name), and the quantiles q05, q25, q50, q75 and q95.
    """
    times = np.linspace(0.0, one.summary.t_end_s, TIMES)
    decision = one.cell.scenario.decision
    belief = np.full((robots, TIMES), np.nan)  # a row for each robot and run, in any order
    keyed = samples.sort("run", "robot", "time_s").group_by("run", "robot", maintain_order=True)
    for row, (_, of_robot) in enumerate(keyed):
        # Index of the robot's latest sample up to each time; -1: no sample yet.
        latest = np.searchsorted(of_robot["time_s"].to_numpy(), times, side="right") - 1
        robot_beliefs = of_robot["belief_below"].to_numpy()
        # ``np.maximum`` only keeps the index valid where there is no sample yet; there the value is nan.
        belief[row] = np.where(latest >= 0, robot_beliefs[np.maximum(latest, 0)], np.nan)
    # Rows of robots that never sampled stay nan too. The belief before any sample is the probability that the Beta
    # prior gives to shares of ones below the boundary that readings are tested against, which may differ from that of
    # the fill ratio (``readings_boundary``): the regularised incomplete Beta function.
    prior = betainc(decision.prior_alpha, decision.prior_beta, readings_boundary(one.cell.scenario))
    belief[np.isnan(belief)] = float(prior)
    columns = {f"q{q:02d}": np.quantile(belief, q / 100, axis=0) for q in (5, 25, 50, 75, 95)}
    return pl.DataFrame({"time_s": times, "series": [name_of(one.cell)] * TIMES, **columns})


def _frame(rows: Sequence[dict[str, object]]) -> pl.DataFrame:
    """Return the rows as a table, with null in place of floats that are not finite: these are not drawn."""
    frame = pl.DataFrame(list(rows), infer_schema_length=None)
    floats = (pl.col(name) for name, kind in frame.schema.items() if kind == pl.Float64)
    return frame.with_columns(pl.when(column.is_finite()).then(column) for column in floats)
