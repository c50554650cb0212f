"""Pictures of the maps that robots have of the floor: pooled, and one a robot."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from vibroswarm.core.atomic_io import whole_file
from vibroswarm.plots.run import STILL, VIBRATING
from vibroswarm.plots.style import MATPLOTLIB_LOCK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ACROSS: Final = 4
MOST: Final = 11
"""Robots whose maps are drawn; the table has all."""


def maps_figure(maps: pl.DataFrame, run: int = 0) -> Figure:
    """Draw the pooled map and those of the first robots; a cross marks a tile that is believed to be what it is not.

    Args:
        maps: as ``analysis.floor_maps.floor_maps`` returns them. run: one of its runs.
    """
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.figure import Figure

    of_run = maps.filter(pl.col("run") == run)
    robots = of_run["robot"].drop_nulls().unique().sort().to_list()[:MOST]
    count = 1 + len(robots)
    across = min(count, ACROSS)
    down = math.ceil(count / across)
    figure = Figure(figsize=(2.0 * across + 0.7, 2.25 * down + 0.5), layout="constrained")
    axes = figure.subplots(down, across, squeeze=False).ravel()
    colours: Any = LinearSegmentedColormap.from_list("floor", [STILL, VIBRATING])
    mesh: Any = None
    for ax, robot in zip(axes, [None, *robots], strict=False):
        own = of_run.filter(pl.col("robot").is_null() if robot is None else pl.col("robot") == robot)
        shape = (own["row"].n_unique(), own["column"].n_unique())
        belief = own["vibrating"].to_numpy().reshape(shape)
        mesh = ax.pcolormesh(belief, cmap=colours, vmin=0, vmax=1, edgecolors="#8a8578", linewidth=0.4)
        wrong = own.filter((pl.col("vibrating") > 0.5) != (pl.col("vibrates") == 1))
        ax.plot(wrong["column"].to_numpy() + 0.5, wrong["row"].to_numpy() + 0.5, "x", color="#c2410c", mew=2)
        ax.set(aspect="equal", xlim=(0, shape[1]), ylim=(shape[0], 0), xticks=[], yticks=[])
        ax.set_title("all robots" if robot is None else f"robot {robot}", fontsize=9)
    for ax in axes[count:]:
        ax.set_visible(False)
    bar = figure.colorbar(mesh, ax=list(axes), shrink=0.8)
    bar.set_label("belief that a tile vibrates", fontsize=9)
    figure.supxlabel("x: believed to be what it is not", fontsize=8)
    return figure


def write_maps_picture(maps: pl.DataFrame, path: Path, run: int = 0) -> None:
    """Write the picture as PNG.

    Raises:
        InputError: the folder cannot be written.
        RunError: the disk is full or failed.
    """
    with whole_file(path) as part, MATPLOTLIB_LOCK:
        maps_figure(maps, run).savefig(part, format="png", dpi=150)
