"""Shared parts of pictures: axes, rows of cells, ticks, legends, short numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from vibroswarm.core.numbers import counts as counted
from vibroswarm.core.numbers import is_missing, percent, stated
from vibroswarm.core.numbers import number as written
from vibroswarm.plots.style import FAINT, INK, LINE, PAPER, Look, Style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_TICKS: Final = 8
"""Most values of an axis that are its ticks."""
LETTER_EM: Final = 0.6
"""About the width of a letter, in units of its size."""


def number(value: float | None, digits: int = 3, decimals: int | None = None) -> str:
    """Write a number with a real minus; a missing one becomes a dash."""
    return "–" if is_missing(value) else written(value, decimals, digits=digits).replace("-", "−")


def share(part: float, whole: float) -> str:
    """Write part / whole in percent; only exact shares are "0 %" and "100 %"."""
    if not whole:
        return "–"
    found = part / whole
    if 0 < found < 0.001 or 0.999 < found < 1:
        return "< 0.1 %" if found < 0.5 else "> 99.9 %"
    return percent(found, 0 if found in (0, 1) or 0.01 <= found <= 0.99 else 1)


def of_runs(counts: Sequence[int], unit: str = "run") -> str:
    """Write the numbers of runs of several groups, such as "12 to 1,000 runs each"."""
    return counted(counts, unit) + (" each" if len(counts) > 1 else "")


def new_figure(style: Style, *, height_in: float | None = None, title: str = "") -> Figure:
    """Make an empty figure of the style's width."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(style.width_in, height_in or style.height_in), layout="constrained")
    if title:
        figure.suptitle(fill(title, int(style.width_in * 72 / (style.font_pt * LETTER_EM))))
    return figure


def panels_of(figure: Figure, count: int, across: int, **how: Any) -> Any:
    """Add panels to a figure, row by row; the rest of the last row stays empty. ``how`` is for ``subplots``."""
    across = min(across, count)
    grid = figure.subplots(math.ceil(count / across), across, squeeze=False, **how).ravel()
    for axes in grid[count:]:
        axes.set_visible(False)
    return grid[:count]


def plain_axes(style: Style, x_label: str, y_label: str, *, title: str = "") -> tuple[Figure, Axes]:
    """Make a figure with numeric axes and their labels."""
    figure = new_figure(style, title=title)
    axes = figure.add_subplot()
    axes.set_xlabel(x_label, wrap=True)
    axes.set_ylabel(y_label, wrap=True)
    axes.margins(0.03)
    axes.grid(True)
    few_ticks(axes.xaxis, style)
    return figure, axes


def to_scale(figure: Figure, style: Style, column: Sequence[Axes], high_per_wide: float) -> None:
    """Set the height of a figure so that maps to scale, one below the other, nearly fill its width."""
    across = max(1, len([axes for axes in figure.axes if axes.get_aspect() != "auto"]) // len(column))
    wide_in = (0.82 * style.width_in) / across
    around_in = 9 * style.font_pt / 72
    figure.set_figheight(min(around_in + len(column) * wide_in * high_per_wide, 2.6 * style.height_in))


def few_ticks(axis: Any, style: Style) -> None:
    """Limit the number of ticks, to 5 in the style "column" and 8 in wider ones."""
    from matplotlib.ticker import MaxNLocator

    axis.set_major_locator(MaxNLocator(4 if style.width_in < 5 else 7, steps=[1, 2, 2.5, 3, 4, 5, 10]))


def whole_ticks(axis: Any) -> None:
    """Use ticks at whole numbers only, on an axis with ``few_ticks``."""
    axis.get_major_locator().set_params(integer=True)


def ticks_at(axis: Any, values: Sequence[float]) -> None:
    """Put ticks at the values themselves if they are few."""
    places = sorted(set(values))
    if len(places) <= MOST_TICKS:
        axis.set_ticks(places, labels=[stated(place).replace("-", "−") for place in places])


def log_x(axes: Axes) -> None:
    """Make x logarithmic, with ticks at 1, 2, 5, 10, ... without exponents."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(base=10, subs=(1, 2, 5), numticks=6))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: stated(value)))


def percent_axis(axis: Any) -> None:
    """Label an axis of shares in percent; those that are drawn downwards are not negative."""
    from matplotlib.ticker import FuncFormatter

    axis.set_major_formatter(FuncFormatter(lambda value, _: percent(abs(value), None, digits=6)))


class Rows(NamedTuple):
    """Axes with one row per cell at y = 0, 1, 2, ... from the top."""

    figure: Figure
    axes: Axes
    style: Style
    band: float
    """Height of one series within a row; a row has the height 1."""

    def place(self, row: int, series: int, of: int) -> float:
        """Return y of a series within a row that ``of`` series share; series 0 is the uppermost."""
        return row + (series - (of - 1) / 2) * self.band

    def estimate(self, y: float, values: tuple[float | None, ...], look: Look, **line: Any) -> None:
        """Draw an estimate (value, low, high) at the height ``y``; ``line`` is how its interval is drawn."""
        value, low, high = values
        if value is None:
            self.axes.annotate(
                "no value", (0.02, y), xycoords=("axes fraction", "data"), va="center", color=FAINT
            )
            return
        if low is not None and high is not None:
            bars: dict[str, Any] = {"color": look.colour, "marker": "|"} | line
            self.axes.plot([low, high], [y, y], zorder=2, **bars)
        face = PAPER if look.hollow else look.colour
        self.axes.plot(value, y, marker=look.marker, color=look.colour, markerfacecolor=face, zorder=3)

    def note(self, y: float, text: str) -> None:
        """Write text right of the axes at the height ``y``."""
        self.axes.annotate(
            text, (1, y), xycoords=("axes fraction", "data"), xytext=(self.style.font_pt * 0.5, 0), va="center",
            textcoords="offset points", fontsize=self.style.small_pt, color=FAINT, annotation_clip=False,
        )  # fmt: skip

    def heading(self, text: str, *, of_names: bool = False) -> None:
        """Write a heading above the notes, right of the axes, or above the names of rows."""
        self.axes.annotate(
            fill(text, 16), (0 if of_names else 1, 1), xycoords="axes fraction", va="bottom",
            xytext=(self.style.font_pt * (-0.5 if of_names else 0.5), 1), textcoords="offset points",
            ha="right" if of_names else "left", fontsize=self.style.small_pt, color=FAINT, annotation_clip=False,
        )  # fmt: skip


def rows_of(style: Style, names: Sequence[object], x_label: str, *, series: int = 1, title: str = "") -> Rows:
    """Make a figure that grows with its rows, whose names are at the left; ``series`` share a row."""
    letters = int(style.width_in * 72 * 0.36 / (style.small_pt * LETTER_EM))
    labels = [fill(str(name), letters) for name in names]
    lines = max(label.count("\n") + 1 for label in labels)
    row_in = max(style.row_in * (0.4 + 0.6 * series), lines * style.small_pt * 1.3 / 72)
    figure = new_figure(style, height_in=row_in * len(names) + 8 * style.font_pt / 72, title=title)
    axes = figure.add_subplot()
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_yticks(range(len(names)), labels=labels)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.grid(True, axis="x")
    axes.set_xlabel(x_label, wrap=True)
    few_ticks(axes.xaxis, style)
    for row in range(1, len(names) if series > 1 else 0):
        axes.axhline(row - 0.5, color=LINE, linewidth=style.line_pt * 0.6)
    return Rows(figure, axes, style, 0.8 / series)


def patch_handle(look: Look, *, edge: str = INK, filled: bool = True) -> Any:
    """Return a small area with the colour and the hatch of a look, for a legend."""
    from matplotlib.patches import Patch

    return Patch(facecolor=look.colour if filled else PAPER, edgecolor=edge, hatch=look.hatch)


def legend_below(figure: Figure, style: Style, handles: Sequence[Any], names: Sequence[str]) -> None:
    """Draw a legend below the axes in as many columns as fit; the figure grows with its lines."""
    if not names:
        return
    labels = [fill(name, int(style.width_in * 60 / (style.small_pt * LETTER_EM))) for name in names]
    wide_pt = (max(map(len, labels)) * LETTER_EM + 5) * style.small_pt
    columns = max(1, min(len(names), int(style.width_in * 72 / wide_pt)))
    figure.legend(list(handles), labels, loc="outside lower center", ncols=columns)
    lines = math.ceil(len(names) / columns)
    figure.set_figheight(figure.get_figheight() + lines * 1.4 * style.small_pt / 72)
