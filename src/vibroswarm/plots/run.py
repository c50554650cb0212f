"""Pictures of floors, of one run, and of the robots' maps of a floor; all are legible in grey."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.numbers import count, number
from vibroswarm.floors.floor import Floor
from vibroswarm.motion.pose import pose
from vibroswarm.observation.observe import kinds_at
from vibroswarm.plots.layout import panels_of
from vibroswarm.plots.picture import Picture, drawn, save_figure
from vibroswarm.plots.style import (
    COLOUR_MAP,
    FAINT,
    INK,
    LINE,
    ON_DARK,
    PAPER,
    RUN,
    SERIES,
    kind_colours,
    kind_hatch,
)
from vibroswarm.result import Result
from vibroswarm.statistics.verdict import answers_of, estimates_in_words, verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def floor_figure(tiles: NDArray[np.uint8], title: str = "") -> Figure:
    """Draw a floor as a matplotlib figure; all but still tiles are hatched, and row 0 is at the top."""
    from matplotlib.figure import Figure

    rows, columns = tiles.shape
    inches = 5.0 / max(rows, columns)
    figure = Figure(figsize=(max(columns * inches, 3.0) + 0.8, rows * inches + 1.2), layout="constrained")
    axes = figure.add_subplot()
    kinds = range(2, int(tiles.max()) + 1)
    labels = {0: "still", 1: "vibrating"} | {kind: f"kind {kind}" for kind in kinds}
    _draw_floor(axes, Floor(tiles, 1.0, 1.0, 0.0, 0.0, title), labels)
    axes.set(aspect="equal", xlim=(0, columns), ylim=(0, rows), xticks=[], yticks=[], title=title)
    figure.legend(loc="outside lower center", ncols=4)
    return figure


def draw_floor(path: Path | str, tiles: NDArray[np.uint8], title: str = "", *, replace: bool = False) -> None:
    """Write a picture of a floor in the format of the path's suffix. The same floor gives the same bytes."""
    save_figure(lambda: floor_figure(tiles, title), Path(path), replace=replace)


POINTS_PER_S = 2
"""Points of a path per second of simulated time."""
VIBRATES: Final = 1
"""The value of an observation, or of a decision, that stands for vibrating."""


def run_figure(result: Result, run: int = 0) -> Figure:
    """Draw floor, paths, samples and robots of one run, to scale; callers draw within ``style.settings``."""
    from matplotlib.figure import Figure

    scenario = result.scenario
    width, height = scenario.arena.width_m, scenario.arena.height_m
    scale = 6.4 / max(width, height)  # inches per metre
    size_in = max(width * scale, 2.4) + 0.4, max(height * scale, 2.4) + 1.2 + 0.1 * scenario.sensor.kinds
    figure = Figure(figsize=size_in, layout="constrained")
    axes = figure.add_subplot()
    floor = result.floor(run).at(result.runs.filter(run=run)["end_s"][0])
    _draw_floor(axes, floor, _words_of_kinds(result, "tile vibrates", "tile is still", "tile of kind {kind}"))
    _draw_paths(axes, result, run)
    _draw_samples(axes, result, run)
    _draw_robots(axes, result, run)
    axes.set(xlim=(0, width), ylim=(0, height), aspect="equal", xlabel="x (m)", ylabel="y (m)")
    origin = f"recorded, session {run + 1}" if result.seed is None else f"seed {result.seed}"
    fill_ratio = number(floor.fill_ratio_within(width, height), digits=3)
    share = "fill ratio" if scenario.sensor.kinds == 2 else "share of kind 1:"
    # A dollar in a name does not begin a formula. It is escaped, since matplotlib ignores parse_math=False in a title
    # that it wraps.
    floor_name = floor.name.replace("$", r"\$")
    title = f"{count(scenario.swarm.robots, 'robot')}, {floor_name}, {share} {fill_ratio}, {scenario.strategy.name}"
    axes.set_title(f"{title}, {origin}: {_outcome_in_words(result, run)}", wrap=True)
    figure.legend(loc="outside lower center", ncols=4)
    return figure


def _outcome_in_words(result: Result, run: int) -> str:
    found = verdict(result, run)
    if found.estimated:
        told, _ = estimates_in_words(found)
        return f"estimates {told}" if told else "no estimates"
    return (found.consensus or "decisions not logged").replace("_", " ")


def _draw_floor(axes: Axes, floor: Floor, labels: dict[int, str]) -> None:
    from matplotlib import rc_context
    from matplotlib.colors import LinearSegmentedColormap, ListedColormap
    from matplotlib.patches import Ellipse, Rectangle

    rows, columns, tile_w, tile_h, left, bottom = floor.geometry
    edges = left + tile_w * np.arange(columns + 1), bottom + tile_h * np.arange(rows, -1, -1)
    between = (floor.levels > 0) & (floor.levels < 1)
    shades = LinearSegmentedColormap.from_list("value", [RUN["tile-still"], RUN["ripple"]])
    for kind in np.unique(floor.tiles).tolist():
        lines = {0: LINE, VIBRATES: RUN["ripple"]}.get(kind, RUN["trail"])
        looks: dict[str, Any] = {"edgecolor": lines, "lw": 0 if kind else 0.4, "hatch": kind_hatch(kind)}
        # matplotlib 3.11 and later take the colour of a hatch from this setting, earlier versions from the edge
        with rc_context({"hatch.color": lines}):
            colour, others = kind_colours(kind)[0], (floor.tiles != kind) | between
            axes.pcolor(*edges, np.ma.array(floor.tiles, mask=others), cmap=ListedColormap([colour]), **looks)
            if kind in labels and not floor.has_contrasts:  # a tile without size, for the legend
                axes.add_patch(Rectangle((left, bottom), 0, 0, facecolor=colour, label=labels[kind], **looks))
    axes.pcolor(
        *edges, np.ma.array(floor.levels, mask=~between), cmap=shades, vmin=0, vmax=1, edgecolor=LINE, lw=0.4
    )
    for patch in floor.patches:
        looks = {
            "facecolor": shades(patch.contrast),
            "edgecolor": RUN["vibrating"],
            "lw": 0.6,
            "hatch": "////",
        }
        corner = patch.x_m - patch.width_m / 2, patch.y_m - patch.height_m / 2
        disc = Ellipse((patch.x_m, patch.y_m), patch.width_m, patch.height_m, **looks)
        axes.add_patch(disc if patch.is_disc else Rectangle(corner, patch.width_m, patch.height_m, **looks))
    axes.add_patch(Rectangle((left, bottom), columns * tile_w, rows * tile_h, fill=False, ec=FAINT, lw=0.8))
    axes.spines[:].set_visible(True)


def _draw_paths(axes: Axes, result: Result, run: int) -> None:
    """Draw the robots' paths, with ``POINTS_PER_S`` points per second; nothing without poses."""
    if result.poses is None:
        return
    ends = result.ends.filter(run=run)
    for robot, end_s in ends.select("robot", "end_s").iter_rows():
        times = np.arange(0.0, end_s, 1.0 / POINTS_PER_S)
        path = pose(result.poses, run, robot, times)
        label = "path" if robot == 0 else None  # one entry in the legend stands for all paths
        axes.plot(path[:, 0], path[:, 1], color=RUN["trail"], lw=0.35, alpha=0.6, label=label)


def _draw_samples(axes: Axes, result: Result, run: int) -> None:
    from matplotlib.path import Path as Outline

    samples = result.motion.filter(run=run).join(result.observations, on=["run", "robot", "sample"])
    observation, tile = samples["observation"].to_numpy(), samples["tile"].to_numpy()
    # a sample beside the floor has tile -1, and cannot be misread
    kinds = kinds_at(result.floor(run), tile, samples["time_s"].to_numpy())
    misread = (tile >= 0) & (kinds != observation)
    x, y = samples["x_m"].to_numpy(), samples["y_m"].to_numpy()
    if result.scenario.floor.has_surface:  # what lies between still and vibrating is not misread
        contrast = result.floor(run).contrast_at(x, y)
        misread = (tile >= 0) & (np.abs(contrast - observation) == 1.0)
    stroke = Outline([(-1.0, -1.0), (1.0, 1.0)])
    axes.plot(
        x[misread], y[misread], ls="", marker=stroke, ms=6, color=INK, mew=0.8, zorder=2.9, label="misread"
    )  # fmt: skip
    for value, label in _words_of_kinds(result, "read vibrating", "read still", "read kind {kind}").items():
        chosen, colour = observation == value, kind_colours(value)[1]
        axes.scatter(
            x[chosen],
            y[chosen],
            s=9,
            c=colour if value > 0 else PAPER,
            edgecolors=colour,
            linewidths=0.7,
            marker=_marker(value),
            label=label,
            zorder=3,
        )


def _words_of_kinds(result: Result, vibrating: str, still: str, other: str) -> dict[int, str]:
    """Return a label for each kind of tile, or class of readings, that the result's sensor knows."""
    sensor = result.scenario.sensor
    if max(sensor.kinds, sensor.readings) == 2:
        return {0: still, 1: vibrating}
    return {kind: other.format(kind=kind) for kind in range(max(sensor.kinds, sensor.readings))}


_MARKERS: Final = (*"oDs^v<>pPX*hd", "$-$", "$/$", (4, 1, 0))
"""Marks of kinds, as matplotlib takes them."""


def _marker(kind: int) -> Any:
    return _MARKERS[kind % len(_MARKERS)]


def _draw_robots(axes: Axes, result: Result, run: int) -> None:
    ends = result.ends.filter(run=run)
    decisions = dict(result.robots.filter(run=run).select("robot", "decision").iter_rows())
    # The first robot with a decision takes the label of this decision, so that the legend has each label once.
    answers = enumerate(answers_of(result.scenario))
    words = {-1: "robot: undecided"} | {decision: f"robot: {answer}" for decision, answer in answers}
    for robot, x_m, y_m in ends.select("robot", "x_m", "y_m").iter_rows():
        decision = decisions.get(robot)
        decision = -1 if decision is None else int(decision)  # null: recordings without a log of decisions
        colour = INK if decision == -1 else kind_colours(decision)[1]
        axes.plot(
            x_m, y_m, ls="", marker="o" if decision == -1 else _marker(decision), ms=10, zorder=4,
            markerfacecolor=PAPER if decision == -1 else colour,
            markeredgecolor=colour if decision == -1 else PAPER, label=words.pop(decision, None),
        )  # fmt: skip
        axes.annotate(
            str(robot), (x_m, y_m), ha="center", va="center", fontsize=6.5, fontweight="bold", zorder=5,
            color=INK if decision == -1 else PAPER,
        )  # fmt: skip


@drawn
def draw_run(result: Result, run: int = 0, *, caption: str = "", style: str = "column") -> Picture:
    """Draw the floor, the robots' paths and their samples in one run, to scale."""
    samples = result.motion.filter(run=run).select("robot", "sample", "x_m", "y_m")
    return Picture(run_figure(result, run), samples, caption or f"Floor, paths and samples of run {run}.")


ACROSS: Final = 4
"""Most maps side by side."""
MOST_MAPS: Final = 11
"""Most robots whose maps are drawn; with the map of all robots together they fill three lines of ``ACROSS`` maps."""


def maps_figure(
    maps: pl.DataFrame,
    run: int = 0,
    *,
    tile_m: tuple[float, float] = (1.0, 1.0),
    label: str = "belief that a tile vibrates",
) -> Figure:
    """Draw the map of all robots together, then the maps of the ``MOST_MAPS`` robots with the lowest numbers."""
    from matplotlib.figure import Figure

    of_run = maps.filter(run=run)
    robots = [None, *of_run["robot"].drop_nulls().unique().sort().head(MOST_MAPS)]  # None: all robots
    rows, columns = (of_run[name].n_unique() for name in ("row", "column"))
    down, across = -(-len(robots) // ACROSS), min(len(robots), ACROSS)
    high_in = min(2.0 * rows * tile_m[1] / (columns * tile_m[0]), 4.0)
    figure = Figure(
        figsize=(2.0 * across + 0.7, max((high_in + 0.25) * down, 2.25) + 0.5), layout="constrained"
    )
    mesh: Any = None
    for axes, robot in zip(panels_of(figure, len(robots), ACROSS), robots, strict=True):
        own = of_run.filter(pl.col("robot").eq_missing(robot))
        belief = own["vibrating"].to_numpy().reshape(rows, columns)
        mesh = axes.pcolormesh(belief, cmap=COLOUR_MAP, vmin=0, vmax=1)
        wrong = own.filter((pl.col("vibrating") > 0.5) != (pl.col("vibrates") == 1))
        axes.plot(wrong["column"] + 0.5, wrong["row"] + 0.5, ls="", marker="x", color=ON_DARK, mec=SERIES[1])
        axes.set(aspect=tile_m[1] / tile_m[0], xlim=(0, columns), ylim=(rows, 0), xticks=[], yticks=[])
        axes.set_title("all robots" if robot is None else f"robot {robot}")
    figure.colorbar(mesh, ax=figure.axes, shrink=0.8, label=label)
    if of_run["vibrates"].is_not_null().any():
        figure.supxlabel("x: believed kind is wrong", fontsize="small")
    return figure
