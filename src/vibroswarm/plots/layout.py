"""Shared parts of pictures: text that fits, short numbers, axes, rows of cells, legends."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

from vibroswarm.plots.style import FAINT, LINE, Style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


ELLIPSIS = "…"
NARROWEST_EM = 0.27
"""Slightly less than the width of the letter i: a limit on how many letters can fit."""


def plain(text: object) -> str:
    """Return the text for every format: control characters become spaces, lone surrogates a question mark."""
    cleaned = "".join(
        " " if unicodedata.category(letter) in ("Cc", "Zl", "Zp") else letter for letter in str(text)
    )
    return cleaned.encode("utf-8", "replace").decode("utf-8").replace("\ufffe", "?").replace("\uffff", "?")


def width_pt(text: str, size_pt: float) -> float:
    """Return the width of a line of text in the pictures' font, points; letter by letter, without kerning."""
    return size_pt * sum(map(_letter_em, text))


@lru_cache(maxsize=4096)
def _letter_em(letter: str) -> float:
    """Return the width of a letter in units of the font size."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(family="DejaVu Sans", size=100)
    between = f"|{letter}|"  # matplotlib measures a lone space as 0
    width, bars = (
        text_to_path.get_text_width_height_descent(text, font, ismath=False)[0] for text in (between, "||")
    )
    return float(width - bars) / 100


def fitted(text: object, size_pt: float, room_pt: float, lines: int = 1) -> str:
    """Break text into at most ``lines`` lines of ``room_pt``; text that is too long loses its middle.

    Lines break after spaces and after separators in paths and names.
    """
    full = plain(text).strip()
    most = int(lines * room_pt / (size_pt * NARROWEST_EM)) + 1
    for letters in range(min(len(full), most), 0, -1):
        shorter = full if letters == len(full) else _without_middle(full, letters)
        broken = _broken(shorter, size_pt, room_pt)
        if len(broken) <= lines:
            return "\n".join(broken)
    return ELLIPSIS if full else ""


def fitted_names(names: Sequence[object], size_pt: float, room_pt: float, lines: int = 1) -> list[str]:
    """Return many names as ``fitted`` does; different names that would look alike are numbered."""
    shortened = [fitted(name, size_pt, room_pt, lines) for name in names]
    seen: dict[str, set[str]] = {}
    for name, short in zip(names, shortened, strict=True):
        seen.setdefault(short, set()).add(str(name))
    return [
        short if len(seen[short]) == 1 else fitted(f"{place}) {plain(name)}", size_pt, room_pt, lines)
        for place, (name, short) in enumerate(zip(names, shortened, strict=True), start=1)
    ]


def _without_middle(text: str, letters: int) -> str:
    head = math.ceil(letters * 0.4)
    tail = letters - head
    return text[:head].rstrip() + ELLIPSIS + (text[-tail:].lstrip() if tail else "")


def _broken(text: str, size_pt: float, room_pt: float) -> list[str]:
    """Break text into lines of at most ``room_pt``, at spaces and punctuation."""
    lines = [""]
    for piece in re.findall(r"[^\s/\\_=,;:.+-]*[\s/\\_=,;:.+-]+|[^\s/\\_=,;:.+-]+", text):
        longer = lines[-1] + piece
        if lines[-1] and width_pt(longer.rstrip(), size_pt) > room_pt:
            lines.append(piece.lstrip())
        else:
            lines[-1] = longer
        while width_pt(lines[-1].rstrip(), size_pt) > room_pt and len(lines[-1]) > 1:
            cut = next(
                (n for n in range(len(lines[-1]) - 1, 1, -1) if width_pt(lines[-1][:n], size_pt) <= room_pt),
                1,
            )
            lines[-1:] = [lines[-1][:cut], lines[-1][cut:]]
    return [line.strip() for line in lines]


def number(value: float | None, digits: int = 3) -> str:
    """Return a number with ``digits`` significant digits and no trailing zeros; a dash if it is missing."""
    if value is None or not math.isfinite(value):
        return "–"
    if value and abs(value) >= 10**digits:
        text = f"{value:.0f}" if abs(value) < 1e6 else f"{value:.{digits - 1}e}"
    else:
        text = f"{value:.{digits}g}"
    return ("0" if text in ("-0", "0") else text).replace("-", "−")


def share(part: float, whole: float) -> str:
    """Return a share in percent; never rounds to 0 % or 100 % unless it is exact."""
    if not whole:
        return "–"
    percent = 100 * part / whole
    if 0 < percent < 0.1:
        return "< 0.1 %"
    if 99.9 < percent < 100:
        return "> 99.9 %"
    return f"{percent:.0f} %" if percent in (0, 100) or 1 <= percent <= 99 else f"{percent:.1f} %"


def of_runs(counts: Sequence[int], unit: str = "run") -> str:
    """Return numbers of runs in words: ``1000 runs each``, ``12 to 1000 runs each``, or of a single group ``1 run``."""
    least, most = min(counts), max(counts)
    units = unit if most == 1 else f"{unit}s"
    each = " each" if len(counts) > 1 else ""
    return f"{most} {units}{each}" if least == most else f"{least} to {most} {units}{each}"


LINE_SPACING = 1.2
TALLEST_ROW = 2.5
"""Greatest height of a row relative to its preferred height; a slide with few rows has space around them."""
LABEL_SHARE = 0.36
"""Greatest share of the width for the names of rows."""


def new_figure(style: Style, *, height_in: float | None = None, title: str = "") -> Figure:
    """Draw an empty figure of the style's width; the title is broken to fit."""
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
    """Return a figure with numeric axes; it grows for a long legend, a slide only for a very long one."""
    free = 7 if style.fixed_height else 2
    more = max(0, legend_lines(style, legend) - free) * style.small_pt * 1.4 / 72
    figure = new_figure(style, title=title, height_in=style.height_in + more)
    axes = figure.add_subplot()
    name_axes(axes, style, x_label, y_label, share_of_height=0.68 * style.height_in / figure.get_figheight())
    axes.grid(True)
    return figure, axes


def name_axes(axes: Axes, style: Style, x_label: str, y_label: str, *, share_of_height: float = 0.8) -> None:
    """Set the axes' labels, broken to fit, and the margins."""
    figure: Any = axes.figure
    width, height = style.width_in * 72 * 0.78, float(figure.get_figheight()) * 72 * share_of_height
    axes.set_xlabel(fitted(x_label, style.font_pt, width, 2))
    axes.set_ylabel(fitted(y_label, style.font_pt, height, 2))
    axes.margins(0.03)


def axes_size_pt(figure: Figure, axes: Axes) -> tuple[float, float]:
    """Return the width and height of the axes after layout, points."""
    figure.draw_without_rendering()
    box = axes.get_window_extent()
    return box.width * 72 / figure.dpi, box.height * 72 / figure.dpi


def colour_bar(
    figure: Figure, axes: Axes, style: Style, mesh: Any, label: str, y_label: str, **how: Any
) -> Any:
    """Return a colour bar for a map; its label and that of y are broken to the height of the map."""
    tall = max(1.0, figure.get_figheight() / style.height_in)
    bar = figure.colorbar(mesh, ax=axes, pad=0.02, aspect=25 * tall, **how)
    bar.outline.set_linewidth(style.line_pt * 0.5)
    bar.set_label(fitted(label, style.font_pt, axes_size_pt(figure, bar.ax)[1], 2))
    axes.set_ylabel(fitted(y_label, style.font_pt, axes_size_pt(figure, axes)[1], 2))
    return bar


def few_ticks(axis: Any, style: Style) -> None:
    """Use few enough ticks that their labels do not overlap."""
    from matplotlib.ticker import MaxNLocator

    axis.set_major_locator(MaxNLocator(4 if style.width_in < 5 else 7, steps=[1, 2, 2.5, 3, 4, 5, 10]))


def whole_ticks(axis: Any) -> None:
    """Use ticks at whole numbers only."""
    axis.get_major_locator().set_params(integer=True)


def ticks_at(axis: Any, style: Style, values: Sequence[float]) -> None:
    """Put ticks at the values themselves if their labels fit; else at whole numbers if all values are whole."""
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
    """Use fewer ticks along x if their labels would overlap in the finished layout."""
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
    if power:  # at the end of the axis it may overlap the axis label
        axes.xaxis.get_offset_text().set_visible(False)
        axes.set_xlabel(fitted(f"{axes.get_xlabel()}, {power}", style.font_pt, style.width_in * 72 * 0.62, 2))


def hatched(style: Style, hatch: str) -> str:
    """Return a hatch, less dense for styles with thick lines."""
    return hatch if style.font_pt < 12 else hatch[: (len(hatch) + 1) // 2]


def log_x(axes: Axes, values: Sequence[float]) -> None:
    """Make x logarithmic, with ticks at 1, 2, 5, 10, ... in plain numbers; over many decades at 1, 10, ..."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    decades = max(values) / min(values)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(base=10, subs=(1, 2, 5) if decades < 300 else (1,)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def percent_axis(axis: Any) -> None:
    """Label an axis of shares in percent."""
    from matplotlib.ticker import FuncFormatter

    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{100 * abs(value):.6g} %"))


class Rows(NamedTuple):
    """Axes with one row per cell at y = 0, 1, 2, ... from the top."""

    figure: Figure
    axes: Axes
    font_pt: float
    """Font size in a row."""
    line_pt: float
    """Line width in a row: thinner in low rows."""
    band: float
    """Height of one series in a row, in rows."""
    high_in: float
    """Wanted height of the axes."""

    def settle(self, style: Style) -> None:
        """Set the figure's height so that the axes get theirs; call when all else is drawn."""
        self.figure.set_figheight(self.high_in + 4 * style.height_in)  # enough for everything around the axes
        spare = self.figure.get_figheight() - axes_size_pt(self.figure, self.axes)[1] / 72
        height = spare + self.high_in
        self.figure.set_figheight(max(height, style.height_in) if style.fixed_height else height)
        thin_ticks(self.figure, self.axes, style)

    def place(self, row: int, series: int, of: int) -> float:
        """Return y of a series in a row; the first series is the upper one."""
        return row + (series - (of - 1) / 2) * self.band

    def note(self, y: float, text: str, *, colour: str = FAINT) -> None:
        """Write text next to a row, right of the axes."""
        self.axes.annotate(
            plain(text), (1, y), xycoords=("axes fraction", "data"), xytext=(self.font_pt * 0.5, 0),
            textcoords="offset points", va="center", ha="left", fontsize=self.font_pt, color=colour,
            annotation_clip=False,
        )  # fmt: skip

    def heading(self, text: str) -> None:
        """Write a heading above the notes."""
        room_pt = self.figure.get_figwidth() * 72 * 0.22
        self.axes.annotate(
            fitted(text, self.font_pt, room_pt, 2), (1, 1), xycoords="axes fraction",
            xytext=(self.font_pt * 0.5, 1), textcoords="offset points", va="bottom", ha="left",
            fontsize=self.font_pt, color=FAINT, annotation_clip=False,
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
    """Return a figure that grows with its rows; names are at the left, broken or shortened to fit.

    Args:
        style: sizes of the picture.
        names: of the rows.
        x_label: of the axis below.
        series: how many share a row.
        title: above.
        furniture: lines of text below, such as a legend.
    """
    around = style.font_pt * LINE_SPACING * (3.4 + furniture + (2 if title else 0)) / 72
    room_pt = style.width_in * 72 * LABEL_SHARE
    preferred = _preferred_row_in(style, names, series, room_pt)
    least = style.least_row_in * max(1.0, 0.75 * series)
    pitch = max(least, min(preferred, (style.tallest_in - around) / len(names)))
    if style.fixed_height:
        pitch = max(least, (style.tallest_in - around) / len(names))
    font = min(style.small_pt, pitch / min(series, 1.6) * 72 / LINE_SPACING)
    lines = max(1, min(3, int(pitch * 72 / (font * LINE_SPACING))))
    figure = new_figure(style, height_in=around + pitch * len(names), title=title)
    axes = figure.add_subplot()
    space = max(0.0, len(names) * (1 - TALLEST_ROW * preferred / pitch)) / 2
    axes.set_ylim(len(names) - 0.5 + space, -0.5 - space)
    few_ticks(axes.xaxis, style)
    axes.set_yticks(range(len(names)), labels=fitted_names(names, font, room_pt, lines), fontsize=font)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.grid(True, axis="x")
    axes.set_xlabel(fitted(x_label, style.font_pt, style.width_in * 72 * 0.62, 2))
    for row in range(1, len(names) if series > 1 else 0):
        axes.axhline(row - 0.5, color=LINE, linewidth=style.line_pt * 0.6)
    note_pt = min(font, 0.8 / series * pitch * 72 / 1.05)
    line_pt = min(style.line_pt, 0.8 / series * pitch * 72 / 8)
    high_in = (least if style.fixed_height else pitch) * len(names)
    return Rows(figure, axes, note_pt, line_pt, 0.8 / series, high_in)


def _preferred_row_in(style: Style, names: Sequence[object], series: int, room_pt: float) -> float:
    line = style.small_pt * LINE_SPACING / 72
    broken = max(fitted(name, style.small_pt, room_pt, 3).count("\n") + 1 for name in names)
    return max(style.row_in * (0.4 + 0.6 * series), line * (broken + 0.35))


def legend_lines(style: Style, names: Sequence[str]) -> int:
    """Return the number of lines of ``legend_below``."""
    return math.ceil(len(names) / _legend_columns(style, names)) if names else 0


def legend_below(figure: Figure, style: Style, handles: Sequence[Any], names: Sequence[str]) -> None:
    """Draw a legend below the axes in as many columns as fit; long names are shortened."""
    if not names:
        return
    room = style.width_in * 72 - style.small_pt * 5
    labels = fitted_names(names, style.small_pt, room)
    figure.legend(
        list(handles), labels, loc="outside lower center", ncols=_legend_columns(style, names), columnspacing=1.4,
        borderaxespad=0.2, borderpad=0.1, labelspacing=0.35,
    )  # fmt: skip


def _legend_columns(style: Style, names: Sequence[str]) -> int:
    """Return the largest number of legend columns that fits the width and leaves none almost empty."""
    room_pt = style.width_in * 72 - style.small_pt * 2
    handle_pt, gap_pt = style.small_pt * 3, style.small_pt * 1.4
    labels = fitted_names(names, style.small_pt, room_pt - handle_pt)
    for columns in range(len(labels), 1, -1):
        widest = [max(width_pt(name, style.small_pt) for name in part) for part in _dealt(labels, columns)]
        if sum(widest) + columns * handle_pt + (columns - 1) * gap_pt <= room_pt:
            lines = math.ceil(len(labels) / columns)
            return math.ceil(len(labels) / lines)
    return 1


def _dealt(names: Sequence[str], columns: int) -> list[Sequence[str]]:
    """Return the names in each column of a legend as matplotlib divides them: the first columns get one more."""
    least, more = divmod(len(names), columns)
    parts, start = [], 0
    for column in range(columns):
        end = start + least + (column < more)
        parts.append(names[start:end])
        start = end
    return parts
