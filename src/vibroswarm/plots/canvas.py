"""Figures and axes that every kind of picture begins with: plain axes, rows of cells, a legend that fits."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

from vibroswarm.plots.palette import FAINT, LINE
from vibroswarm.plots.style import Style
from vibroswarm.plots.words import fitted, fitted_names, plain, width_pt

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LINE_SPACING = 1.2
TALLEST_ROW = 2.5
"""Times what a row wishes for; a slide of few rows has air above and below them."""
LABEL_SHARE = 0.36
"""Of the width, at most, for the names beside rows."""


def new_figure(style: Style, *, height_in: float | None = None, title: str = "") -> Figure:
    """An empty figure of the style's width; the title is broken to fit."""
    from matplotlib.figure import Figure

    height = style.height_in if height_in is None else height_in
    if style.fixed_height:
        height = max(height, style.height_in)
    figure = Figure(figsize=(style.width_in, height), layout="constrained")
    if title:
        room = style.width_in * 72 * 0.95
        figure.suptitle(fitted(title, style.font_pt * 1.1, room, 3), fontsize=style.font_pt * 1.1)
    return figure


def plain_axes(
    style: Style, x_label: str, y_label: str, *, title: str = "", legend: Sequence[str] = ()
) -> tuple[Figure, Axes]:
    """A figure with one pair of numeric axes; it grows for a long legend, a slide only for a very long one."""
    free = 7 if style.fixed_height else 2
    more = max(0, legend_lines(style, legend) - free) * style.small_pt * 1.4 / 72
    figure = new_figure(style, title=title, height_in=style.height_in + more)
    axes = figure.add_subplot()
    name_axes(axes, style, x_label, y_label)
    axes.grid(True)
    return figure, axes


def name_axes(axes: Axes, style: Style, x_label: str, y_label: str, *, share_of_height: float = 0.8) -> None:
    """Put the axes' names, broken to fit, and few enough ticks that their numbers stay apart."""
    figure: Any = axes.figure
    width, height = style.width_in * 72 * 0.78, float(figure.get_figheight()) * 72 * share_of_height
    axes.set_xlabel(fitted(x_label, style.font_pt, width, 2))
    axes.set_ylabel(fitted(y_label, style.font_pt, height, 2))
    axes.margins(0.03)


def axes_size_pt(figure: Figure, axes: Axes) -> tuple[float, float]:
    """Width and height that the layout leaves to the axes, points."""
    figure.draw_without_rendering()
    box = axes.get_window_extent()
    return box.width * 72 / figure.dpi, box.height * 72 / figure.dpi


def colour_bar(
    figure: Figure, axes: Axes, style: Style, mesh: Any, label: str, y_label: str, **how: Any
) -> Any:
    """A scale of colours beside a map; its name and that of y are broken to the height that the map got."""
    tall = max(1.0, figure.get_figheight() / style.height_in)
    bar = figure.colorbar(mesh, ax=axes, pad=0.02, aspect=25 * tall, **how)
    bar.outline.set_linewidth(style.line_pt * 0.5)
    bar.set_label(fitted(label, style.font_pt, axes_size_pt(figure, bar.ax)[1], 2))
    axes.set_ylabel(fitted(y_label, style.font_pt, axes_size_pt(figure, axes)[1], 2))
    return bar


def few_ticks(axis: Any, style: Style) -> None:
    """So few numbers along an axis that they stay apart."""
    from matplotlib.ticker import MaxNLocator

    axis.set_major_locator(MaxNLocator(4 if style.width_in < 5 else 7, steps=[1, 2, 2.5, 3, 4, 5, 10]))


def whole_ticks(axis: Any) -> None:
    """Whole numbers only along an axis of counts."""
    axis.get_major_locator().set_params(integer=True)


def ticks_at(axis: Any, style: Style, values: Sequence[float]) -> None:
    """Numbers at the values themselves where these are few and stand apart; else whole ones where all are whole."""
    from matplotlib.ticker import FixedLocator, FuncFormatter

    places = sorted({float(value) for value in values})
    wide_pt = max(width_pt(f"{place:g}", style.font_pt) for place in places) + 0.7 * style.font_pt
    span = places[-1] - places[0]
    room_pt = [0.7 * 72 * style.width_in * (after - before) / span for before, after in pairwise(places)]
    if all(room > wide_pt for room in room_pt):
        axis.set_major_locator(FixedLocator(places))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}".replace("-", "\u2212")))
    elif all(place.is_integer() for place in places):
        whole_ticks(axis)


def thin_ticks(figure: Figure, axes: Axes, style: Style) -> None:
    """Fewer numbers along x where, with all else in place, they would run into each other."""
    from matplotlib.ticker import MaxNLocator

    locator = axes.xaxis.get_major_locator()
    if not isinstance(locator, MaxNLocator):
        return
    low, high = sorted(axes.get_xlim())
    room_pt = axes_size_pt(figure, axes)[0]
    for bins in range(4 if style.width_in < 5 else 7, 0, -1):
        locator.set_params(nbins=bins)
        ticks = [tick for tick in locator.tick_values(low, high) if low <= tick <= high]
        words = axes.xaxis.get_major_formatter().format_ticks(ticks)
        wide = max((width_pt(word, style.font_pt) for word in words), default=0.0) + 0.7 * style.font_pt
        if len(ticks) < 2 or wide <= room_pt * (ticks[1] - ticks[0]) / (high - low):
            break
    power = axes.xaxis.get_major_formatter().get_offset()
    if power:  # it stands where the axis ends, and there the axis's name may stand too
        axes.xaxis.get_offset_text().set_visible(False)
        axes.set_xlabel(fitted(f"{axes.get_xlabel()}, {power}", style.font_pt, style.width_in * 72 * 0.62, 2))


def hatched(style: Style, hatch: str) -> str:
    """A hatch as dense as the style's lines allow."""
    return hatch if style.font_pt < 12 else hatch[: (len(hatch) + 1) // 2]


def log_x(axes: Axes, values: Sequence[float]) -> None:
    """A logarithmic x axis whose ticks are 1, 2, 5, 10, ... in plain numbers; only 1, 10, ... over many decades."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    decades = max(values) / min(values)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(base=10, subs=(1, 2, 5) if decades < 300 else (1,)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def percent_axis(axis: Any) -> None:
    """Numbers along an axis of shares, in percent."""
    from matplotlib.ticker import FuncFormatter

    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{100 * abs(value):.6g} %"))


class Rows(NamedTuple):
    """Axes with one row for each cell, the first at the top, at y = 0, 1, 2, ..."""

    figure: Figure
    axes: Axes
    font_pt: float
    """Of what is written into a row."""
    line_pt: float
    """Of marks in a row: thinner where rows are low."""
    band: float
    """Height of one series' share of a row, in rows."""
    high_in: float
    """What the axes should measure."""

    def settle(self, style: Style) -> None:
        """Give the figure the height by which its axes get theirs; to be called when all else is in place."""
        self.figure.set_figheight(
            self.high_in + 4 * style.height_in
        )  # enough for whatever stands around them
        spare = self.figure.get_figheight() - axes_size_pt(self.figure, self.axes)[1] / 72
        height = spare + self.high_in
        self.figure.set_figheight(max(height, style.height_in) if style.fixed_height else height)
        thin_ticks(self.figure, self.axes, style)

    def place(self, row: int, series: int, of: int) -> float:
        """y of a series in a row; the first series is the upper one."""
        return row + (series - (of - 1) / 2) * self.band

    def note(self, y: float, text: str, *, colour: str = FAINT) -> None:
        """Write beside a row, right of the axes."""
        self.axes.annotate(
            plain(text), (1, y), xycoords=("axes fraction", "data"), xytext=(self.font_pt * 0.5, 0),
            textcoords="offset points", va="center", ha="left", fontsize=self.font_pt, color=colour,
            annotation_clip=False,
        )  # fmt: skip


def rows_of(
    style: Style,
    names: Sequence[object],
    x_label: str,
    *,
    series: int = 1,
    title: str = "",
    furniture: int = 0,
) -> Rows:
    """A figure that grows with its rows; names stand at the left, broken or shortened to fit.

    Args:
        style: where the picture is to stand.
        names: of the rows.
        x_label: of the axis below.
        series: how many share a row.
        title: above.
        furniture: lines of legend below, that take height.
    """
    around = style.font_pt * LINE_SPACING * (3.4 + furniture + (2 if title else 0)) / 72
    room_pt = style.width_in * 72 * LABEL_SHARE
    wished = _wished_row_in(style, names, series, room_pt)
    least = style.least_row_in * max(1.0, 0.75 * series)
    pitch = max(least, min(wished, (style.tallest_in - around) / len(names)))
    if style.fixed_height:
        pitch = max(least, (style.tallest_in - around) / len(names))
    font = min(style.small_pt, pitch / min(series, 1.6) * 72 / LINE_SPACING)
    lines = max(1, min(3, int(pitch * 72 / (font * LINE_SPACING))))
    figure = new_figure(style, height_in=around + pitch * len(names), title=title)
    axes = figure.add_subplot()
    air = max(0.0, len(names) * (1 - TALLEST_ROW * wished / pitch)) / 2
    axes.set_ylim(len(names) - 0.5 + air, -0.5 - air)
    few_ticks(axes.xaxis, style)
    axes.set_yticks(range(len(names)), labels=fitted_names(names, font, room_pt, lines), fontsize=font)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.grid(True, axis="x")
    axes.set_xlabel(fitted(x_label, style.font_pt, style.width_in * 72 * 0.62, 2))
    if len(names) > 1 and series > 1:
        for between in range(1, len(names)):
            axes.axhline(between - 0.5, color=LINE, linewidth=style.line_pt * 0.6)
    note_pt = min(font, 0.8 / series * pitch * 72 / 1.05)
    line_pt = min(style.line_pt, 0.8 / series * pitch * 72 / 8)
    high_in = (least if style.fixed_height else pitch) * len(names)
    return Rows(figure, axes, note_pt, line_pt, 0.8 / series, high_in)


def _wished_row_in(style: Style, names: Sequence[object], series: int, room_pt: float) -> float:
    line = style.small_pt * LINE_SPACING / 72
    broken = max(fitted(name, style.small_pt, room_pt, 3).count("\n") + 1 for name in names)
    return max(style.row_in * (0.4 + 0.6 * series), line * (broken + 0.35))


def legend_lines(style: Style, names: Sequence[str]) -> int:
    """How many lines ``legend_below`` takes."""
    return -(-len(names) // _columns(style, names)) if len(names) else 0


def legend_below(figure: Figure, style: Style, handles: Sequence[Any], names: Sequence[str]) -> None:
    """A legend below the axes in as many columns as fit; long names are shortened."""
    if not names:
        return
    room = style.width_in * 72 - style.small_pt * 5
    shown = fitted_names(names, style.small_pt, room)
    figure.legend(
        list(handles), shown, loc="outside lower center", ncols=_columns(style, names), columnspacing=1.4,
        borderaxespad=0.2, borderpad=0.1, labelspacing=0.35,
    )  # fmt: skip


def _columns(style: Style, names: Sequence[str]) -> int:
    room = style.width_in * 72 - style.small_pt * 2
    shown = fitted_names(names, style.small_pt, room - style.small_pt * 3)
    for columns in range(len(shown), 1, -1):
        widest = [max(width_pt(name, style.small_pt) for name in part) for part in _dealt(shown, columns)]
        if sum(widest) + columns * style.small_pt * 3 + (columns - 1) * style.small_pt * 1.4 <= room:
            return -(-len(shown) // -(-len(shown) // columns))  # no column that is almost empty
    return 1


def _dealt(names: Sequence[str], columns: int) -> list[Sequence[str]]:
    """The names as matplotlib deals them to a legend's columns: the first ones get one more."""
    least, more = divmod(len(names), columns)
    parts, start = [], 0
    for column in range(columns):
        end = start + least + (column < more)
        parts.append(names[start:end])
        start = end
    return parts
