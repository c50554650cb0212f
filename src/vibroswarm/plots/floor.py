"""Pictures of floors, for print and screen, legible in grey."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.atomic_io import whole_file
from vibroswarm.floors.io import check_suffix
from vibroswarm.plots.style import MATPLOTLIB_LOCK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUFFIXES: Final = (".png", ".svg", ".pdf")
VIBRATING: Final = "#1d3a5f"
STILL: Final = "#ece7db"

_LINES_UP_TO: Final = 60  # tiles per side; with more, lines between tiles would hide them
_VECTORS_UP_TO: Final = 10_000  # tiles; more are drawn as an image in SVG and PDF


def floor_figure(tiles: NDArray[np.uint8], title: str = "") -> Figure:
    """The floor as a matplotlib figure; vibrating tiles dark, still ones light, row 0 at the top.

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
