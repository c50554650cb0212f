"""Read the study's recordings of real robots, and draw histograms of recorded and simulated samples.

The recordings are three sessions of five robots on one floor (``world.txt``); three logs of the authors' simulator
belong to them.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.calibrate.features import FEATURES, sessions_of
from vibroswarm.calibrate.real_vs_simulated import AXES, SPANS
from vibroswarm.floors import read_tiles
from vibroswarm.floors.floor import Floor
from vibroswarm.plots.layout import new_figure, plain_axes
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import look, style_named
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.log_readers import read_log
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import preset

REAL_FLOOR: Final = "real-floor"
"""Name of the floor of the recordings in scenarios."""
ROWS: Final = ("01010", "10010", "10101", "01101", "10010")
"""Rows from the top; 12 of the 25 tiles vibrate."""


def real_floor() -> dict[str, Any]:
    """Return the fields, by dotted name, that put a scenario on the floor of the recordings."""
    return {"floor.source": REAL_FLOOR, "floor.tiles": ROWS}


REAL: Final = tuple(f"CAL_{session}.csv" for session in (1, 2, 3))
"""Files of the recordings."""
AUTHORS: Final = tuple(f"webots_log_{session}.txt" for session in (0, 1, 2))
"""Logs of the authors' simulator."""
FLOOR: Final = "world.txt"
"""File with the tiles of the floor."""
SIZE: Final = (5, 5)
"""Rows and columns of tiles in that file."""


def missing(folder: Path | None) -> str | None:
    """Return why the recordings in a folder cannot be read, as a sentence for the report; None if they can be read.

    Args:
        folder: folder of the recordings; None: the user named none.
    """
    if folder is None:
        return (
            "It needs the study's recordings, which are not part of this software: name their folder with "
            "`--recordings` "
            "or in `VIBROSWARM_RUGBOT`."
        )
    gone = [name for name in (*REAL, *AUTHORS, FLOOR) if not (folder / name).is_file()]
    return f"The folder of recordings lacks {', '.join(gone)}." if gone else None


def hash_of(folder: Path) -> str:
    """Return the SHA-256 of the contents of all files that are read in a folder: recordings, logs and floor.

    All these files must exist, see ``missing``.
    """
    digest = hashlib.sha256()
    for name in (*REAL, *AUTHORS, FLOOR):
        digest.update((folder / name).read_bytes())
    return digest.hexdigest()


def read_recordings(folder: Path, names: tuple[str, ...]) -> Recording:
    """Read the logs with these file names as one recording, in which each log is a session (run).

    The files must exist, see ``missing``. Fields of the recording's scenario that neither the logs nor the floor
    determine have the values of preset ``paper``.
    """
    floor = Floor.filling(read_tiles(folder / FLOOR, SIZE), name=FLOOR)
    return recording_of([read_log(folder / name) for name in names], floor, preset("paper"))


BINS: Final = {"avoidance": 40, "vibrating": 48, "still": 48, "places": 15, "distances": 24, "steps": 39}
"""Number of bins along each axis of the histograms, by feature."""
_SCHEMA: Final = {
    "source": pl.String,
    "feature": pl.String,
    "x": pl.Float64,
    "y": pl.Float64,
    "share": pl.Float64,
}
"""Columns of ``histograms_of``."""


def histograms_of(sources: Mapping[str, Result]) -> pl.DataFrame:
    """Return the histograms of all features: one row for each source, feature and bin.

    Columns: source; feature; x and y, the centre of the bin (y is null for a feature with one column); share, the
    number of values in the bin divided by the number of all values of the source, those beyond the bins included.

    Args:
        sources: results by name; their sessions are pooled.
    """
    frames = []
    for source, result in sources.items():
        sessions = sessions_of(result)
        for feature in FEATURES:
            values = np.concatenate(sessions.values(feature))
            spans, bins = SPANS[feature], BINS[feature]
            counts, edges = np.histogramdd(values, bins=[bins] * len(spans), range=spans)
            centres = [(edge[:-1] + edge[1:]) / 2 for edge in edges]
            grid = np.meshgrid(*centres, indexing="ij")
            frames.append(
                pl.DataFrame(
                    {
                        "source": [source] * counts.size,
                        "feature": [feature] * counts.size,
                        "x": grid[0].ravel(),
                        "y": grid[1].ravel() if len(grid) > 1 else [None] * counts.size,
                        "share": counts.ravel() / max(len(values), 1),
                    },
                    schema=_SCHEMA,
                )
            )
    return pl.concat(frames)


@drawn
def draw_shares(frame: pl.DataFrame, *, x_label: str = "", title: str = "", style: str = "column") -> Picture:
    """Draw histograms of one variable, a step line for each series.

    Args:
        frame: one row per bin: ``x`` (its centre), ``share``, ``series``. x_label: label of the x axis.
        title: text above the picture. style: "column", "page" or "slide".
    Returns:
        Picture; its numbers are ``series, x, share``.
    """
    sizes = style_named(style)
    series = frame["series"].unique(maintain_order=True).to_list()
    figure, axes = plain_axes(sizes, x_label, "share of samples", title=title)
    handles = []
    for index, name in enumerate(series):
        part, looks = frame.filter(pl.col("series") == name).sort("x"), look(index)
        handles += axes.step(
            part["x"].to_numpy(), part["share"].to_numpy(), where="mid", color=looks.colour, linestyle=looks.line,
            linewidth=sizes.line_pt, label=name,
        )  # fmt: skip
    axes.set_ylim(bottom=0.0)
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    caption = f"Share of samples by {x_label}, of {len(series)} sources."
    return Picture(figure, frame.select("series", "x", "share"), caption)


@drawn
def draw_maps(frame: pl.DataFrame, feature: str, *, title: str = "", style: str = "column") -> Picture:
    """Draw histograms of two variables side by side, on one grey scale.

    Args:
        frame: one row per bin: ``panel`` (its title), ``x`` and ``y`` (centre of the bin), ``share``.
        feature: name of a feature with two columns, which gives the labels and ranges of the axes.
        title: text above the picture. style: "column", "page" or "slide".
    Returns:
        Picture; its numbers are ``panel, x, y, share``.
    """
    sizes = style_named(style)
    panels = frame["panel"].unique(maintain_order=True).to_list()
    columns = 2
    rows = math.ceil(len(panels) / columns)
    # A panel is about half as wide as the figure, so 0.48 of the width as height makes it nearly square.
    figure = new_figure(sizes, height_in=rows * sizes.width_in * 0.48, title=title)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    # Not the maximum: a single extreme bin must not make all others pale.
    highest = float(np.quantile(frame["share"].to_numpy(), 0.999))
    for place, axes in enumerate(grid.ravel()):
        if place >= len(panels):
            axes.set_visible(False)
            continue
        # Shares as an image: one row per y, ascending, and one column per x, in the order of the frame.
        part = frame.filter(pl.col("panel") == panels[place])
        shares = part.pivot("x", index="y", values="share").sort("y").drop("y").to_numpy()
        extent = tuple(end for span in SPANS[feature] for end in span)  # left, right, bottom, top
        axes.imshow(
            shares, origin="lower", extent=extent, aspect="auto", cmap="Greys", vmin=0.0, vmax=highest,
            interpolation="nearest",
        )  # fmt: skip
        axes.set_title(panels[place], fontsize=sizes.small_pt)
        axes.locator_params(nbins=4)
        axes.xaxis.set_tick_params(labelbottom=place + columns >= len(panels))  # if no panel is below
        axes.tick_params(labelsize=sizes.small_pt)
    figure.supxlabel(AXES[feature][0], fontsize=sizes.font_pt)
    figure.supylabel(AXES[feature][1], fontsize=sizes.font_pt)
    caption = f"Shares of samples by {AXES[feature][0]} and {AXES[feature][1]}; darker is more, up to {highest:.3g}."
    return Picture(figure, frame.select("panel", "x", "y", "share"), caption)
