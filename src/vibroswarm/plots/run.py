"""Pictures of floors, and of one run: the floor, the robots' paths, and the samples; legible in grey."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.atomic_io import whole_file
from vibroswarm.errors import InputError
from vibroswarm.floors.io import check_suffix
from vibroswarm.motion.pose import pose
from vibroswarm.observation.observe import vibrating_at
from vibroswarm.plots.style import FAINT, INK, LINE, MATPLOTLIB_LOCK, OUTCOMES, PAPER
from vibroswarm.result import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


SUFFIXES: Final = (".png", ".svg", ".pdf")
VIBRATING: Final = "#1d3a5f"
STILL: Final = "#ece7db"

_LINES_UP_TO: Final = 60  # tiles per side; with more, lines between tiles would hide them
_VECTORS_UP_TO: Final = 10_000  # tiles; more are drawn as an image in SVG and PDF


def floor_figure(tiles: NDArray[np.uint8], title: str = "") -> Figure:
    """Draw the floor as a matplotlib figure; vibrating tiles dark, still ones light, row 0 at the top.

    Args:
        tiles: (rows, columns) of 0 and 1.
        title: above the floor.
    """
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    rows, columns = tiles.shape
    longer = max(rows, columns)
    width, height = 5.0 * columns / longer, 5.0 * rows / longer
    figure = Figure(figsize=(max(width, 3.0) + 0.8, height + 1.2), layout="constrained")
    axes = figure.add_subplot()
    axes.pcolormesh(
        tiles,
        cmap=ListedColormap([STILL, VIBRATING]),
        vmin=0,
        vmax=1,
        edgecolors="#8a8578" if longer <= _LINES_UP_TO else "none",
        linewidth=0.4,
        rasterized=tiles.size > _VECTORS_UP_TO,
    )
    axes.set(aspect="equal", xlim=(0, columns), ylim=(rows, 0), xticks=[], yticks=[])
    if title:
        axes.set_title(title, fontsize=10, parse_math=False)  # a file name may contain a dollar
    marks = [
        Patch(facecolor=colour, edgecolor="#8a8578", label=label)
        for colour, label in ((VIBRATING, "vibrating"), (STILL, "still"))
    ]
    figure.legend(handles=marks, loc="outside lower center", ncols=2, frameon=False)
    return figure


def draw_floor(path: Path | str, tiles: NDArray[np.uint8], title: str = "", *, replace: bool = False) -> None:
    """Write a picture of the floor in the format of the suffix. The same floor gives the same bytes.

    Args:
        path: ends with .png, .svg or .pdf.
        tiles: (rows, columns) of 0 and 1.
        title: above the floor. replace: whether an existing file may be replaced.
    Raises:
        InputError: another suffix, the file exists, or its folder cannot be written.
        RunError: the disk is full or failed.
    """
    from matplotlib import rc_context

    path = Path(path)
    kind = check_suffix(path, SUFFIXES)
    no_date: dict[str, Any] = {".png": {}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}[kind]
    with (
        whole_file(path, replace=replace) as part,
        MATPLOTLIB_LOCK,
        rc_context({"svg.hashsalt": "vibroswarm", "svg.fonttype": "none"}),
    ):
        floor_figure(tiles, title).savefig(part, format=kind[1:], dpi=150, metadata=no_date)


POINTS_PER_S = 2
WRONG = OUTCOMES["wrong"]


def run_figure(result: Result, run: int = 0) -> Figure:
    """Draw floor, paths and samples of one run, drawn to scale; legible in grey.

    Vibrating tiles are hatched. A sample is a mark at its place: filled when it read "vibrating", open when
    "still", in red with a cross when the reading is not the tile's kind. Colours are the palette's, so that a page may
    show it in dark ones.

    Args:
        run: one of the result's runs, which has to have a floor; paths are drawn where segments were kept.
    """
    from matplotlib.figure import Figure

    scenario = result.scenario
    width, height = scenario.arena.width_m, scenario.arena.height_m
    scale = 6.4 / max(width, height)
    figure = Figure(
        figsize=(max(width * scale, 2.4) + 0.4, max(height * scale, 2.4) + 1.2), layout="constrained"
    )
    axes = figure.add_subplot()
    _draw_floor(axes, result, run)
    _draw_paths(axes, result, run)
    _draw_samples(axes, result, run)
    axes.set(xlim=(0, width), ylim=(0, height), aspect="equal", xlabel="x (m)", ylabel="y (m)")
    summary = result.runs.filter(pl.col("run") == run).to_dicts()[0]
    feedback = "no" if scenario.strategy.name == "none" else scenario.strategy.name
    origin = f"recorded, session {run + 1}" if result.seed is None else f"seed {result.seed}"
    axes.set_title(
        f"{scenario.swarm.robots} robots, {result.floor(run).name}, fill ratio {summary['fill_ratio']:.3g}, "
        f"{feedback} feedback, {origin}: {summary['consensus'] or 'decisions not logged'}",
        fontsize=9,
        wrap=True,
    )
    figure.legend(loc="outside lower center", ncols=3, fontsize=7.5, frameon=False)
    return figure


def _draw_floor(axes: Axes, result: Result, run: int) -> None:
    """Draw the tiles of the floor."""
    from matplotlib import rc_context
    from matplotlib.patches import Rectangle

    floor = result.floor(run)
    rows, columns, tile_w, tile_h, left, bottom = floor.geometry
    label: str | None = "vibrating tile"
    with rc_context({"hatch.color": FAINT}):  # from matplotlib 3.11 on; before, it is the edge's
        for row, column in np.argwhere(floor.tiles == 1):
            corner = (left + column * tile_w, bottom + (rows - 1 - row) * tile_h)
            tile = Rectangle(
                corner, tile_w, tile_h, facecolor=LINE, edgecolor=FAINT, hatch="////", lw=0, label=label
            )
            axes.add_patch(tile)
            label = None
    outline = Rectangle((left, bottom), columns * tile_w, rows * tile_h, fill=False, edgecolor=FAINT, lw=0.8)
    axes.add_patch(outline)


def _draw_paths(axes: Axes, result: Result, run: int) -> None:
    """Draw the robots' paths."""
    if result.segments is None:
        return
    ends = result.ends.filter(pl.col("run") == run)
    for robot, end_s, x_m, y_m in ends.select("robot", "end_s", "x_m", "y_m").iter_rows():
        times = np.arange(0.0, end_s, 1.0 / POINTS_PER_S)
        path = pose(result.segments, run, robot, times)
        axes.plot(
            path[:, 0], path[:, 1], color="#4c78a8", lw=0.35, alpha=0.5, label="path" if robot == 0 else None
        )
        axes.annotate(str(robot), (x_m, y_m), ha="center", va="center", fontsize=6, color=PAPER, zorder=5)
    axes.plot(ends["x_m"], ends["y_m"], "o", ms=9, color=INK, ls="", zorder=4, label="robot at the end")


def _draw_samples(axes: Axes, result: Result, run: int) -> None:
    """Draw the samples, with misread ones marked."""
    samples = result.motion.filter(pl.col("run") == run).join(
        result.observations, on=["run", "robot", "sample"]
    )
    bit = samples["observation"].to_numpy()
    tile = samples["tile"].to_numpy()
    amiss = (tile >= 0) & (vibrating_at(result.floor(run), tile) != (bit == 1))
    x, y = samples["x_m"].to_numpy(), samples["y_m"].to_numpy()
    for chosen, face, edge, marker, label in (
        ((bit == 1) & ~amiss, INK, INK, "o", "read as vibrating"),
        ((bit == 0) & ~amiss, PAPER, INK, "o", "read as still"),
        ((bit == 1) & amiss, WRONG, WRONG, "X", "vibrating, wrongly"),
        ((bit == 0) & amiss, PAPER, WRONG, "X", "still, wrongly"),
    ):
        axes.scatter(
            x[chosen],
            y[chosen],
            s=11,
            c=face,
            edgecolors=edge,
            linewidths=0.5,
            marker=marker,
            label=label,
            zorder=3,
        )


def write_run_picture(result: Result, path: Path, run: int = 0) -> None:
    """Draw one run into a file: PNG, SVG or PDF by its suffix.

    Raises:
        InputError: another suffix, or a folder that cannot be written.
    """
    if path.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise InputError(f"'{path.name}' ends in no known kind of picture; .png, .svg or .pdf", field="--out")
    with whole_file(path) as part, MATPLOTLIB_LOCK:
        run_figure(result, run).savefig(part, dpi=150, metadata={} if path.suffix.lower() != ".png" else None)
