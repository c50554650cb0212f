"""The figures of a study, in groups; each is declared with what draws it, and drawn when a page or a file needs it.

Most figures are drawn from the figures of the study's cells. Those of samples need the samples themselves, which a
study rarely saves: some of its runs are simulated again from the seed, and the caption says how many. The name of a
figure is its file name without a suffix; the document's ``figures`` have it too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

import numpy as np
import polars as pl
from scipy.special import betainc

from vibroswarm.core.numbers import count, drawn_of, first_of, listed, stated
from vibroswarm.documents.cell_figures import TIME_AND_ERROR
from vibroswarm.documents.figure_axes import Layout, layout_of, name_of, plane_of
from vibroswarm.documents.study_words import asks_numbers
from vibroswarm.observation.decision_boundary import readings_boundary
from vibroswarm.plots.comparisons import draw_forest, draw_outcomes
from vibroswarm.plots.curves import draw_belief, draw_detection, draw_incidence
from vibroswarm.plots.distributions import draw_boxes
from vibroswarm.plots.error_bars import draw_error_bars
from vibroswarm.plots.front import draw_front
from vibroswarm.plots.heat import draw_density, draw_heat
from vibroswarm.plots.labels import label_of
from vibroswarm.plots.picture import Picture
from vibroswarm.show.document import Figure, limits_of
from vibroswarm.statistics.figures import BY_COLUMN, ESTIMATES, FIGURES, RunFigure
from vibroswarm.statistics.incidence import robot_incidence, swarm_incidence
from vibroswarm.study.comparison import Compared, comparison_table
from vibroswarm.study.runs import groups_of
from vibroswarm.study.spec import SOURCE
from vibroswarm.study.summary import CellOutcome, Outcome

MOST_ROWS: Final = 48
"""Most cells in a figure with one row for each cell."""
MOST_SERIES: Final = 8
"""Most lines in a figure."""
MOST_PANELS: Final = 6
"""Most figures of a kind."""
SIMULATED_RUNS: Final = 100
"""Most runs of a cell simulated again for a figure of samples."""
DECADES: Final = 1000
"""An axis is logarithmic if its largest value is so many times the smallest."""
MOST_POINTS: Final = 400
"""Most points of the figure of detection."""
TIMES: Final = 121
"""Number of points of a curve over time."""


def outcome_figures(outcome: Outcome) -> Iterator[Figure]:
    """Yield outcomes, figures of the cells, maps over two fields, and which fill ratios are judged correctly.

    A figure with a row for each cell is left out if there are more than ``MOST_ROWS`` cells. Those along a numeric
    field are always yielded: ``_bars`` limits their lines and rows.
    """
    cells, layout = outcome.cells, layout_of([row.cell for row in outcome.cells])
    table = _table(outcome, layout)
    if len(cells) <= MOST_ROWS and not asks_numbers(outcome):
        yield _figure("outcomes", "Outcomes of the swarms", _outcomes, cells)
    # Under feedback, beliefs are not estimates of the fill ratio.
    # Where the task is to report a number, robots need not decide.
    senseless = ("decision_time_s",) if asks_numbers(outcome) else ESTIMATES
    for figure in FIGURES:
        if figure.name in senseless:
            continue
        is_there = any(row.summary.figures[figure.name].n for row in cells)
        if figure.picture and is_there and (layout.x is not None or len(cells) <= MOST_ROWS):
            yield _figure(figure.name, figure.picture, _bars, table, layout, figure)
    yield from _planes(cells, table, _MAPS_OF_NUMBERS if asks_numbers(outcome) else _MAPS)
    # ``swarm_right.n`` counts the runs with a truth: those in which one of the two decisions is right.
    if layout.field == SOURCE and any(row.summary.swarm_right.n for row in cells):
        yield _figure("detection", "Which fill ratios are judged correctly", _detection, outcome, table)


def time_figures(outcome: Outcome) -> Iterator[Figure]:
    """Yield decisions, consensus and beliefs over time.

    There are none if all cells ask for numbers. Boxes are left out if there are more than half of ``MOST_ROWS`` cells;
    beliefs if there are more than ``MOST_SERIES`` cells, or no robot sampled, and those of cells whose robots sampled
    and hold no belief.
    """
    if asks_numbers(outcome):
        return
    yield from _incidences(outcome)
    if len(outcome.cells) <= MOST_ROWS // 2:
        yield _figure("consensus-box", "Consensus time, run by run", _spread, outcome)
    if len(outcome.cells) <= MOST_SERIES:
        believes = {one.cell.number: _sampled(outcome, one, "belief_below") for one in outcome.cells}
        if any(believes.values()):
            cells = [one for one in outcome.cells if believes[one.cell.number] or not _sampled(outcome, one)]
            yield _figure("belief", "Belief over time", _belief, outcome, cells)


def not_drawn(outcome: Outcome) -> str:
    """Return a sentence on the figures that are left out because there are too many cells; empty if there are none."""
    cells = outcome.cells
    has_truth = any(one.summary.swarm_right.n for one in cells)
    decides = not asks_numbers(outcome)
    omitted = {
        "outcomes of the swarms": decides and len(cells) > MOST_ROWS,
        "each figure with its interval": len(cells) > MOST_ROWS
        and layout_of([one.cell for one in cells]).x is None,
        "decisions over time": has_truth and next(_incidences(outcome), None) is None,
        "consensus time of each run": decides and len(cells) > MOST_ROWS // 2,
        "belief over time": decides
        and len(cells) > MOST_SERIES
        and any(_sampled(outcome, one, "belief_below") for one in cells),
        "where robots sampled": len(groups_of(outcome.runs.cells)) > MOST_PANELS,
    }
    words = [what for what, is_omitted in omitted.items() if is_omitted]
    return f"Too many cells ({len(cells)}) to draw: {listed(words)}. Tables have all cells." if words else ""


def _figure(name: str, title: str, draw: Callable[..., Picture], *data: Any, **options: Any) -> Figure:
    """Declare a figure; ``draw`` takes the data and options, and the style by keyword."""
    return Figure(name, lambda style: draw(*data, style=style, **options), title)


def _outcomes(cells: Sequence[CellOutcome], style: str) -> Picture:
    """Draw how many swarms of each cell ended with each kind of consensus."""
    kinds = ("right", "wrong", "split", "incomplete", "truth_undefined")
    rows = []
    for cell_outcome in cells:
        shares = {kind: getattr(cell_outcome.summary, f"swarm_{kind}") for kind in kinds}
        # The share of ``n`` runs, times ``n``, is a number of runs; a share of no runs is undefined (nan).
        counts = {kind: round(share.estimate * share.n) if share.n else 0 for kind, share in shares.items()}
        # Limits are of the runs with a truth, and bars are of all runs.
        limits = (
            {"right_low": shares["right"].low, "right_high": shares["right"].high}
            if shares["right"].n == cell_outcome.summary.runs
            else {}
        )
        rows.append({"cell": name_of(cell_outcome.cell), **counts, **limits})
    return draw_outcomes(pl.DataFrame(rows), interval="95 % Wilson interval", style=style)


def _table(outcome: Outcome, layout: Layout | None = None) -> pl.DataFrame:
    """Return the figures of the cells, each with its name in figures (``label``), and its ``x`` and ``series``."""
    labels = {one.cell.number: name_of(one.cell) for one in outcome.cells}
    number = pl.col("cell")
    table = outcome.table.with_columns(label=number.replace_strict(labels))
    if layout is None or layout.x is None:
        return table.with_columns(x="label")
    return table.with_columns(x=number.replace_strict(layout.x), series=number.replace_strict(layout.series))


def _bars(table: pl.DataFrame, layout: Layout, figure: RunFigure, style: str) -> Picture:
    """Draw a figure of the cells with its intervals.

    It is drawn along ``layout.x`` with a line for each series. If there is no x, or if there are more than
    ``MOST_SERIES`` lines, each cell has a row of its own instead, up to ``MOST_ROWS`` cells.
    """
    low, high = limits_of(figure.name)
    frame = table.select("x", pl.col("^series$"), "runs", estimate=figure.name, low=low, high=high)
    too_many_lines = layout.x is not None and frame["series"].n_unique() > MOST_SERIES
    title = ""
    if too_many_lines:  # each cell gets a row under its own name
        title = first_of(MOST_ROWS, frame.height, "cell")
        frame = frame.drop("series").with_columns(x=table["label"]).head(MOST_ROWS)
    return draw_error_bars(
        frame,
        x_label="" if too_many_lines else layout.label,
        label=f"{figure.title} ({figure.unit})" if figure.unit else figure.title,
        interval="95 % interval",
        log=_spans_decades(layout),
        percent=figure.is_share,
        title=title,
        style=style,
    )


def _spans_decades(layout: Layout) -> bool:
    """Return whether x needs a logarithmic axis, on which small values do not fall on one place."""
    x = [] if layout.x is None else layout.x.values()
    return min(x, default=0.0) > 0.0 and max(x) >= DECADES * min(x)


_MAPS: Final = (("decision_time_s", "decision time (s)", "low"), ("swarm_right", "swarms right", "high"))
"""Figures drawn as maps: name, words, and whether low or high values are better."""
_MAPS_OF_NUMBERS: Final = (("estimate_error", "error of the estimate", "low"),)


def _planes(
    cells: Sequence[CellOutcome], table: pl.DataFrame, maps: Sequence[tuple[str, str, str]]
) -> Iterator[Figure]:
    """Yield heat maps of the figures ``maps`` over two numeric fields, without those that no cell has.

    There is one of each for each combination of the values of the other varied fields, up to ``MOST_PANELS``
    combinations. Nothing is yielded unless exactly two fields fit (``plane_of``).
    """
    plane = plane_of([cell_outcome.cell for cell_outcome in cells])
    if plane is None:
        return
    panels: dict[str, list[CellOutcome]] = {}  # the cells of each map, by the other values as text
    for cell_outcome in cells:
        rest = ", ".join(f"{v}" for k, v in cell_outcome.cell.point.items() if k not in plane)
        panels.setdefault(rest, []).append(cell_outcome)
    some = drawn_of(MOST_PANELS, len(panels), "combination")
    # ``part``: the cells of this map
    for number, (rest, part) in enumerate(list(panels.items())[:MOST_PANELS]):
        for figure, label, best in maps:
            if not any(one.summary.figures[figure].n for one in cells):
                continue
            name = f"heat-{figure.replace('_', '-')}" + (f"-{number + 1}" if len(panels) > 1 else "")
            title = (
                f"{label[0].upper()}{label[1:]} over {' and '.join(label_of(field).text for field in plane)}"
                + (f": {rest}" if rest else "")
            )
            yield _figure(name, f"{title}{some}", _heat, part, table, plane, figure, label, best)


def _heat(
    cells: Sequence[CellOutcome],
    table: pl.DataFrame,
    plane: dict[str, dict[int, float]],
    figure: str,
    label: str,
    best: str,
    style: str,
) -> Picture:
    """Draw a figure of the cells as a map over the two fields of ``plane``.

    Args:
        plane: as of ``plane_of``.
        figure: column of ``table``. label: of its colours. best: whether ``low`` or ``high`` values are better.
    """
    (x_field, x), (y_field, y) = plane.items()
    number = pl.col("cell")
    frame = table.filter(number.is_in([one.cell.number for one in cells])).select(
        x=number.replace_strict(x), y=number.replace_strict(y), value=figure, runs="runs"
    )
    x_label, y_label = label_of(x_field).text, label_of(y_field).text
    return draw_heat(
        frame,
        x_label=x_label,
        y_label=y_label,
        label=label,
        best=best,
        percent=figure == "swarm_right",
        style=style,
    )


def _incidences(outcome: Outcome) -> Iterator[Figure]:
    """Yield figures of decisions over time, each once for robots and once for swarms.

    In a figure each cell has two lines: right decisions upwards and wrong decisions downwards. If there are at most
    ``MOST_SERIES // 2`` cells, one figure shows all of them, with at most ``MOST_SERIES`` lines. Otherwise there is a
    figure for each value of x, the numeric field along the axis; without such a field there is none. A figure for one
    value may show up to ``MOST_SERIES`` cells, and is left out if the value has more. Of the figures that remain, the
    first ``MOST_PANELS`` are yielded. A cell is left out if none of its runs has a truth, that is, a right decision.
    """
    # ``swarm_right.n`` counts the runs with a truth, whether or not their swarms decided rightly.
    cells = [cell_outcome for cell_outcome in outcome.cells if cell_outcome.summary.swarm_right.n]
    layout = layout_of([cell_outcome.cell for cell_outcome in outcome.cells])
    if 0 < len(cells) <= MOST_SERIES // 2:
        panels = {"": cells}  # the cells of each figure, by the words that its title adds
    elif layout.x is not None:
        panels = {}
        for cell_outcome in cells:
            panels.setdefault(f"{layout.label} {stated(layout.x[cell_outcome.cell.number])}", []).append(
                cell_outcome
            )
    else:
        return
    # Here ``MOST_SERIES`` limits the cells of a figure, so the lines in either direction.
    panels_shown = [(words, part) for words, part in panels.items() if len(part) <= MOST_SERIES][:MOST_PANELS]
    some = drawn_of(len(panels_shown), len(panels), "value")
    for number, (words, part) in enumerate(panels_shown):
        for unit in ("robot", "swarm"):
            name = f"incidence-{unit}s" + (f"-{number + 1}" if len(panels_shown) > 1 else "")
            title = f"Decisions of {unit}s over time" + (f": {words}{some}" if words else "")
            # ``words`` is empty for the figure of all cells, in which curves are named by cell and not by series.
            yield _figure(name, title, _incidence, outcome, part, layout if words else None, unit)


def _incidence(
    outcome: Outcome, cells: Sequence[CellOutcome], layout: Layout | None, unit: str, style: str
) -> Picture:
    """Draw decisions over time, with the curves of each cell.

    Args:
        layout: names the curves by their series; None: they are named by their cells.
        unit: ``robot`` or ``swarm``, whose decisions are drawn.
    """
    frames = []
    for cell_outcome in cells:
        robots, runs = outcome.runs.tables(cell_outcome.cell)
        t_end_s = cell_outcome.summary.t_end_s
        times_s = np.linspace(0.0, t_end_s, TIMES)
        incidence = robot_incidence if unit == "robot" else swarm_incidence
        series = name_of(cell_outcome.cell) if layout is None else layout.series[cell_outcome.cell.number]
        frames.append(incidence(robots, runs, t_end_s, times_s).with_columns(series=pl.lit(series)))
    # The caption gives one number of runs and one of robots for all cells. The smallest of each is what every cell has.
    fewest = min(cell_outcome.summary.runs for cell_outcome in cells)
    size = min(cell_outcome.cell.scenario.swarm.robots for cell_outcome in cells)
    t_end_s = max(cell_outcome.summary.t_end_s for cell_outcome in cells)
    return draw_incidence(
        pl.concat(frames),
        runs=fewest * size if unit == "robot" else fewest,
        unit="robot" if unit == "robot" else "run",
        interval=f"95 % interval over {count(fewest, 'run')}",
        t_end=t_end_s,
        style=style,
    )


def _spread(outcome: Outcome, style: str) -> Picture:
    """Draw the distribution of consensus times for each cell.

    A run without consensus has no such time (null); it is counted as "without consensus".
    """
    frames = [
        outcome.runs.rows("consensus_time_s", cells=[one.cell]).select(
            cell=pl.lit(name_of(one.cell)), value="consensus_time_s"
        )
        for one in outcome.cells
    ]
    return draw_boxes(
        pl.concat(frames),
        label="consensus time (s)",
        t_end=max(cell_outcome.summary.t_end_s for cell_outcome in outcome.cells),
        missing="without consensus",
        style=style,
    )


def front_figures(outcome: Outcome) -> Iterator[Figure]:
    """Yield a figure of decision time against error for each of the first ``MOST_PANELS`` floors with several cells.

    A front shows settings among which one may choose. The floor cannot be chosen, so cells on different floors are in
    different figures. A floor with only one cell that has an error has no figure.
    """
    floors: dict[str, list[CellOutcome]] = {}
    for cell_outcome in outcome.cells:
        if not cell_outcome.summary.figures["forced_error"].n:
            continue
        floors.setdefault(str(cell_outcome.cell.point.get(SOURCE, "")), []).append(cell_outcome)
    fronts = [(number, *one) for number, one in enumerate(floors.items(), start=1) if len(one[1]) > 1]
    some = drawn_of(MOST_PANELS, len(fronts), "floor")
    for number, floor, part in fronts[:MOST_PANELS]:
        name = "front" + (f"-{number}" if len(floors) > 1 else "")
        title = "Time against error" + (f": {floor}{some}" if floor else "")
        yield _figure(name, title, _front, _table(outcome), [one.cell.number for one in part])


def _front(table: pl.DataFrame, cells: Sequence[int], style: str) -> Picture:
    """Draw decision time against forced error, one point for each cell.

    The forced error is the share of robots that are wrong, or undecided and leaning to the wrong side.
    """
    frame = table.filter(pl.col("cell").is_in(cells)).select("runs", name="label", **TIME_AND_ERROR)
    return draw_front(frame, error_label="forced error", percent=True, style=style)


def comparison_figures(compared: Sequence[Compared]) -> Iterator[Figure]:
    """Yield one figure for each compared quantity, with its paired differences and their intervals."""
    table = comparison_table([one for one in compared if one.is_defined])
    if table.is_empty():
        return
    for name in table["figure"].unique(maintain_order=True):
        figure = BY_COLUMN[name]
        scale, unit = (100.0, "percentage points") if figure.is_share else (1.0, figure.unit)
        frame = table.filter(figure=name).select(
            "wins", "ties", "losses", comparison="name", runs="pairs", difference=scale * pl.col("difference"),
            low=scale * pl.col("difference_low"), high=scale * pl.col("difference_high"),
        )  # fmt: skip
        label = f"difference in {figure.title}{f' ({unit})' if unit else ''}"
        first = first_of(MOST_ROWS, frame.height, "comparison")
        title = f"{figure.title[0].upper()}{figure.title[1:]}, run by run{f' ({first})' if first else ''}"
        yield _figure(
            f"compared-{name.replace('_', '-')}", title, draw_forest, frame.head(MOST_ROWS), label=label,
            better="low" if figure.better < 0 else "high",
        )  # fmt: skip


def _detection(outcome: Outcome, table: pl.DataFrame, style: str) -> Picture:
    """Draw the share of runs without a right consensus against the fill ratio, the ``x`` of ``table``."""
    frame = table.head(MOST_POINTS).select(
        "series",
        "runs",
        fill_ratio="x",
        missed=1 - pl.col("swarm_right"),
        # The share of misses is 1 - the share of right consensus, so the two limits change places.
        low=1 - pl.col("swarm_right_high"),
        high=1 - pl.col("swarm_right_low"),
    )
    boundary = _common_value(outcome.cells, "decision.decision_boundary")
    title = first_of(MOST_POINTS, table.height, "cell")
    return draw_detection(frame, boundary=boundary, title=title, style=style)


def _common_value(cells: Sequence[CellOutcome], field: str) -> float | None:
    values = {one.cell.scenario[field] for one in cells}
    return values.pop() if len(values) == 1 else None


def sampling_figures(outcome: Outcome) -> Iterator[Figure]:
    """Yield figures of where robots sampled.

    Cells of a group share their motion, so each group has one figure. There are none if there are more than
    ``MOST_PANELS`` groups, or if no robot sampled.
    """
    groups = groups_of(outcome.runs.cells)
    if len(groups) > MOST_PANELS:
        return
    for number, group in enumerate(groups):
        in_group = (cell_outcome for cell_outcome in outcome.cells if cell_outcome.cell in group)
        # Cells of a group may end at different times, so the first one may have no samples, unlike the others.
        one = next((cell_outcome for cell_outcome in in_group if _sampled(outcome, cell_outcome)), None)
        if one is not None:
            name = "density" + (f"-{number + 1}" if len(groups) > 1 else "")
            words = f": {name_of(one.cell)}" if len(groups) > 1 else ""
            yield _figure(name, f"Where robots sampled{words}", _density, outcome, one)


def _sampled(outcome: Outcome, one: CellOutcome, known: str = "samples") -> bool:
    """Return whether any robot sampled in those runs of a cell that are simulated again, and has what is ``known``."""
    robots = outcome.runs.tables(one.cell)[0]
    rows = robots.filter(
        pl.col("run") < outcome.runs.runs_again(one.cell, SIMULATED_RUNS), pl.col("samples") > 0
    )
    return bool(rows[known].is_not_null().any())


def _density(outcome: Outcome, one: CellOutcome, style: str) -> Picture:
    """Draw where the robots of a cell sampled, with the tiles of the floor if it is the same in all runs."""
    # At least one run: the cells of an outcome have stored runs.
    runs = outcome.runs.runs_again(one.cell, SIMULATED_RUNS)
    result = outcome.runs.again(one.cell, runs)
    arena, floor = one.cell.scenario.arena, result.floor(0)
    fixed = not one.cell.scenario.floor.drawn_by_run  # the floor is the same in all runs
    return draw_density(
        result.motion.select("x_m", "y_m"),
        width_m=arena.width_m,
        height_m=arena.height_m,
        tiles=floor.tiles if fixed else None,
        tile_size_m=(floor.tile_width_m, floor.tile_height_m) if fixed else None,
        corner_m=(floor.left_m, floor.bottom_m) if fixed else (0.0, 0.0),  # not used without tiles
        title=f"{runs} of {count(one.summary.runs, 'run')}" if runs < one.summary.runs else "",
        style=style,
    )


def _belief(outcome: Outcome, cells: Sequence[CellOutcome], style: str) -> Picture:
    """Draw quantiles of the robots' belief over time for each cell, from runs that are simulated again."""
    frames, runs = [], []
    for cell_outcome in cells:
        chosen = outcome.runs.runs_again(cell_outcome.cell, SIMULATED_RUNS)
        result = outcome.runs.again(cell_outcome.cell, chosen)
        runs.append(chosen)
        robots = chosen * cell_outcome.cell.scenario.swarm.robots
        # The tables ``inference`` and ``motion`` have the same samples in the same order.
        frames.append(
            _belief_bands(result.inference.with_columns(time_s=result.motion["time_s"]), robots, cell_outcome)
        )
    boundary = _common_value(cells, "decision.decision_boundary")
    threshold = _common_value(cells, "decision.credible_threshold")
    return draw_belief(
        pl.concat(frames),
        label=f"belief in a fill below {'the boundary' if boundary is None else stated(boundary)}",
        thresholds=() if threshold is None else (threshold, 1 - threshold),
        boundary=None,  # the boundary is a fill ratio, not a belief
        runs=min(runs),
        unit="robot",
        style=style,
    )


def _belief_bands(samples: pl.DataFrame, robots: int, one: CellOutcome) -> pl.DataFrame:
    """Tabulate the 5, 25, 50, 75 and 95 % quantiles of the belief over all robots and runs, at ``TIMES`` times.

    A robot's belief at a time is the belief after its latest sample up to that time, before its first sample that of
    the prior.

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
