"""Shared parts of pictures: text that fits, short numbers, axes, rows of cells, legends.

Names ending in ``_pt`` are lengths in points (1/72 inch), those ending in ``_in`` in inches.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from textwrap import TextWrapper
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from vibroswarm.core.numbers import counts as counted
from vibroswarm.core.numbers import is_missing, percent, rounded, stated
from vibroswarm.core.numbers import number as written
from vibroswarm.errors import InputError
from vibroswarm.plots.style import FAINT, INK, LINE, PAPER, Look, Style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


ELLIPSIS = "…"


class _Lines(TextWrapper):
    """Breaks lines after spaces, and after separators in paths and names; a longer word is cut anywhere.

    A point or comma before a digit is none: it may be that of a number.
    """

    wordsep_re = re.compile(r"(\s+|(?:[^\s/\\_=,;:.+-]|[.,](?=\d))*(?:[/\\_=;:+-]|[.,](?!\d))+)")


def plain(text: object) -> str:
    """Return text without characters that a picture format cannot hold.

    Control characters become spaces, and so do Unicode's separators of lines and paragraphs, which would break a line.
    Characters that are invalid in UTF-8 or XML become question marks.
    """
    cleaned = "".join(
        " " if unicodedata.category(letter) in ("Cc", "Zl", "Zp") else letter for letter in str(text)
    )
    return cleaned.encode("utf-8", "replace").decode("utf-8").replace("\ufffe", "?").replace("\uffff", "?")


def width_pt(text: str, size_pt: float) -> float:
    """Return the width of a line of text in the pictures' font as matplotlib lays it out, points."""
    return size_pt * _width_em(text)


@lru_cache(maxsize=4096)
def _width_em(text: str) -> float:
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    size = 100  # points; the width is divided by it
    font = FontProperties(family="DejaVu Sans", size=size)
    return float(text_to_path.get_text_width_height_descent(text, font, ismath=False)[0]) / size


LEAST_OF_LETTERS: Final = 0.7
"""Least width of a text in ASCII in units of its letters' widths together: kerning takes up to 0.23 (of "Y-")."""


def _cannot_fit(text: str, size_pt: float, room_pt: float, lines: int) -> bool:
    """Return whether a text needs more lines than these, whatever is broken: quickly, and no for most texts.

    Of texts in ASCII, but for an ellipsis, the least width is known. A line has at least one letter, however wide.
    """
    letters = text.replace(" ", "")
    if len(letters) <= lines or not letters.replace(ELLIPSIS, "").isascii():
        return False
    return LEAST_OF_LETTERS * size_pt * sum(map(_width_em, letters)) > lines * room_pt


def fitted(text: object, size_pt: float, room_pt: float, lines: int = 1) -> str:
    """Break text into at most ``lines`` lines of the width ``room_pt``, in letters of ``size_pt``.

    Lines break after spaces and after separators in paths and names. If the text is too long, an ellipsis replaces as
    much of its middle as necessary; if not even one letter fits, the ellipsis alone is left.
    """
    full = plain(text).strip()
    letters = len(full)
    while letters:
        shorter = full if letters == len(full) else _without_middle(full, letters)
        if not _cannot_fit(shorter, size_pt, room_pt, lines):
            broken = _broken(shorter, size_pt, room_pt)
            if len(broken) <= lines:
                return "\n".join(broken)
        letters = min(letters - 1, int(letters * 0.97))
    return ELLIPSIS if full else ""


def fitted_names(names: Sequence[object], size_pt: float, room_pt: float, lines: int = 1) -> list[str]:
    """Break or shorten each name so that it fits into ``lines`` lines of the width ``room_pt``; see ``fitted``.

    If different names are shortened to the same text, each gets its place in the list as a number before it.
    """
    shortened = [fitted(name, size_pt, room_pt, lines) for name in names]
    names_of: dict[str, set[str]] = {}  # for each shortened text the names that it stands for
    for name, short in zip(names, shortened, strict=True):
        names_of.setdefault(short, set()).add(str(name))
    return [
        short if len(names_of[short]) == 1 else fitted(f"{place}) {plain(name)}", size_pt, room_pt, lines)
        for place, (name, short) in enumerate(zip(names, shortened, strict=True), start=1)
    ]


def _without_middle(text: str, letters: int) -> str:
    """Shorten text to ``letters`` letters and an ellipsis: 40 % of the letters before the ellipsis, the rest after it.

    The end is favoured, since long names often differ only there.
    """
    head = math.ceil(letters * 0.4)
    tail = letters - head
    return text[:head].rstrip() + ELLIPSIS + (text[-tail:].lstrip() if tail else "")


def _broken(text: str, size_pt: float, room_pt: float) -> list[str]:
    """Break text into lines of at most ``room_pt`` points, in letters of ``size_pt``, but of at least one letter."""
    letters = max(1, len(text))
    while True:
        lines = [line.strip() for line in _Lines(width=letters).wrap(text)]
        widest_pt = max((width_pt(line, size_pt) for line in lines), default=0.0)
        if widest_pt <= room_pt or letters == 1:
            return lines
        letters = max(1, min(letters - 1, int(max(map(len, lines)) * room_pt / widest_pt)))


def number(value: float | None, digits: int = 3, decimals: int | None = None) -> str:
    """Write a number with ``decimals``, by default with ``digits`` significant digits, and a real minus.

    A number that is missing becomes a dash.
    """
    return "–" if is_missing(value) else written(value, decimals, digits=digits).replace("-", "−")


def share(part: float, whole: float) -> str:
    """Write part / whole in percent; a dash if ``whole`` is 0.

    Only exact shares are written as "0 %" and "100 %". Shares near them have a decimal, or are "< 0.1 %" or "> 99.9 %".
    """
    if not whole:
        return "–"
    found = part / whole
    if 0 < found < 0.001:
        return "< 0.1 %"
    if 0.999 < found < 1:
        return "> 99.9 %"
    return percent(found, 0 if found in (0, 1) or 0.01 <= found <= 0.99 else 1)


def of_runs(counts: Sequence[int], unit: str = "run") -> str:
    """Write the numbers of runs of several groups, such as "1,000 runs each" or "12 to 1,000 runs each".

    With one group it is "1,000 runs". ``counts`` has at least one number. ``unit`` is what is counted, in the singular.
    """
    return counted(counts, unit) + (" each" if len(counts) > 1 else "")


LINE_SPACING = 1.2
"""Height of a line of text in units of the font size."""
TALLEST_ROW = 2.5
"""Greatest height of a row relative to its preferred height; a slide with few rows has empty space around them."""
LABEL_SHARE = 0.36
"""Greatest share of the width for the names of rows."""
LEAST_ROOM_EM = 5.0
"""A label always has room for this length, in units of its font size: "y (m)" beside very low axes."""
TICK_GAP_EM = 0.7
"""Least space between the labels of two ticks, in units of the font size."""
MOST_TICKS: Final = 60
"""Most values of an axis at which ticks are tried."""


def new_figure(style: Style, *, height_in: float | None = None, title: str = "") -> Figure:
    """Make an empty figure of the style's width, with a title that is broken to fit.

    ``height_in`` is the height of the figure, by default that of the style; a slide is never lower than its style.
    """
    from matplotlib.figure import Figure

    height = style.height_in if height_in is None else height_in
    if style.fixed_height:
        height = max(height, style.height_in)
    figure = Figure(figsize=(style.width_in, height), layout="constrained")
    if title:
        size = style.font_pt * 1.1
        figure.suptitle(fitted(title, size, style.width_in * 72 - size, lines=3), fontsize=size)
    return figure


def panels_of(figure: Figure, count: int, across: int, **how: Any) -> Any:
    """Add panels to a figure, row by row, and leave the rest of the last row empty.

    Args:
        across: most panels in a row. how: for ``Figure.subplots``.
    Returns:
        The axes of the panels, (count,).
    """
    across = min(across, count)
    grid = figure.subplots(math.ceil(count / across), across, squeeze=False, **how).ravel()
    for axes in grid[count:]:
        axes.set_visible(False)
    return grid[:count]


def plain_axes(style: Style, x_label: str, y_label: str, *, title: str = "") -> tuple[Figure, Axes]:
    """Make a figure with numeric axes and their labels."""
    figure = new_figure(style, title=title)
    axes = figure.add_subplot()
    axes.set(xlabel=x_label, ylabel=y_label)
    # Said to the axes too: matplotlib counts the ticks that fit by the settings of the moment when it draws.
    axes.tick_params(labelsize=style.small_pt)
    axes.margins(0.03)
    axes.grid(True)
    return figure, axes


def lay_out(figure: Figure) -> None:
    """Give the axes of a figure their places, as drawing it does, but without drawing it.

    A label of x that would leave the figure, and one of y that is longer than its axis, is broken into two lines, and
    shortened if these are too long.

    What is read of the figure afterwards must follow from the places of its axes, such as the labels of ticks do.
    """
    _place_axes(figure)
    to_pt = 72 / figure.dpi
    for axes in figure.axes:
        box = axes.get_window_extent()
        middle = (box.x0 + box.x1) / 2  # of a label of x
        across = 2 * min(middle, figure.bbox.width - middle)
        for label, room in ((axes.xaxis.label, across), (axes.yaxis.label, box.height)):
            size = float(label.get_fontsize())
            room_pt = max(room * to_pt, LEAST_ROOM_EM * size)
            if any(width_pt(line, size) > room_pt for line in label.get_text().split("\n")):
                label.set_text(fitted(label.get_text(), size, room_pt, lines=2))
                figure.stale = True  # the label of an axis does not say that it has changed
    _place_axes(figure)


def _place_axes(figure: Figure) -> None:
    """Give the axes their places, unless nothing that matplotlib knows of has changed since they got them last."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    if not figure.stale:
        return
    for label in [axis.label for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)]:
        label.set_text("\n".join(map(plain, label.get_text().split("\n"))))
    if not isinstance(figure.canvas, FigureCanvasAgg):
        FigureCanvasAgg(figure)  # remembers the sizes of texts from one layout to the next
    engine: Any = figure.get_layout_engine()
    engine.execute(figure)
    renderer: Any = figure.canvas.get_renderer()  # type: ignore[attr-defined]
    for axes in figure.axes:
        locator: Any = axes.get_axes_locator()
        axes.apply_aspect(locator(axes, renderer) if locator else None)
    figure.stale = False


def give_height(figure: Figure, style: Style, column: Sequence[Axes], high_in: float) -> None:
    """Set the height of a figure so that axes get the height ``high_in`` together, whatever is around them.

    A slide is made no lower than its style, so that its axes may be higher.

    Args:
        column: axes of equal height below each other.
    """
    _place_axes(figure)
    own = sum(axes.get_position(original=True).height for axes in column)
    height = (1 - own) * figure.get_figheight() + high_in
    figure.set_figheight(max(height, style.height_in) if style.fixed_height else height)


def to_scale(
    figure: Figure, style: Style, column: Sequence[Axes], high_per_wide: float, *, least_in: float = 0.0
) -> None:
    """Set the height of a figure so that maps to scale fill the width that the layout leaves them.

    Call it when all else is drawn. Maps are smaller where the picture would be higher than ``style.tallest_in``.

    Args:
        column: axes of equal size below each other. high_per_wide: height of a map in units of its width.
        least_in: least height of the figure.
    """
    maps = [axes for axes in figure.axes if axes.get_aspect() != "auto"]
    # What is around the maps is measured about axes that are as large as the layout lets them be.
    for axes in maps:
        axes.set_aspect("auto")
    for _ in range(2):  # a colour bar is the wider the higher it is
        _place_axes(figure)
        wide_in = column[0].get_position(original=True).width * figure.get_figwidth()
        give_height(figure, style, column, len(column) * wide_in * high_per_wide)
        figure.set_figheight(min(max(figure.get_figheight(), least_in), style.tallest_in))
    for axes in maps:
        axes.set_aspect("equal")


def axes_size_pt(figure: Figure, axes: Axes) -> tuple[float, float]:
    """Return the width and height of the axes after layout, points."""
    lay_out(figure)
    box = axes.get_window_extent()
    return box.width * 72 / figure.dpi, box.height * 72 / figure.dpi


def colour_bar(figure: Figure, axes: Axes, style: Style, mesh: Any, **how: Any) -> Any:
    """Add a colour bar to a map and return it; ``how`` has further arguments of matplotlib's ``colorbar``."""
    tall = max(1.0, figure.get_figheight() / style.height_in)  # keeps the bar equally narrow in a high figure
    bar = figure.colorbar(mesh, ax=axes, pad=0.02, aspect=25 * tall, **how)
    bar.outline.set_linewidth(style.line_pt * 0.5)
    bar.ax.tick_params(labelsize=style.small_pt)  # as of ``plain_axes``
    return bar


def few_ticks(axis: Any, style: Style) -> None:
    """Limit the number of ticks to 5 in the style "column", to 8 in the wider ones, so that labels rarely overlap."""
    from matplotlib.ticker import MaxNLocator

    # n intervals have at most n + 1 ticks
    axis.set_major_locator(MaxNLocator(4 if style.width_in < 5 else 7, steps=[1, 2, 2.5, 3, 4, 5, 10]))


def whole_ticks(axis: Any) -> None:
    """Use ticks at whole numbers only, on an axis with matplotlib's automatic ticks or those of ``few_ticks``."""
    axis.get_major_locator().set_params(integer=True)
    axis.stale = True  # a locator does not say that it has changed


def ticks_at(figure: Figure, axis: Any, values: Sequence[float]) -> None:
    """Put ticks at the ``values`` themselves if their labels fit beside each other in the layout so far.

    If they do not fit, or a value was measured and has more digits than its label, put ticks at whole numbers if all
    values are whole; otherwise do not change the ticks.
    ``values`` has at least one number; it may have repeated ones.
    """
    from matplotlib.ticker import FixedLocator, FuncFormatter

    places = sorted({float(value) for value in values})
    are_stated = all(math.isclose(place, rounded(place, 6), rel_tol=1e-9) for place in places)
    if are_stated and len(places) <= MOST_TICKS:  # more never fit, and take long to lay out
        before = axis.get_major_locator(), axis.get_major_formatter()
        axis.set_major_locator(FixedLocator(places))
        axis.set_major_formatter(FuncFormatter(lambda value, _: stated(value).replace("-", "\u2212")))
        lay_out(figure)
        if not crowded(axis):
            return
        axis.set_major_locator(before[0])
        axis.set_major_formatter(before[1])
    if all(place.is_integer() for place in places):
        whole_ticks(axis)


def crowded(axis: Any) -> bool:
    """Return whether labels of neighbouring ticks along x overlap, or nearly so, as they were laid out last."""
    stale = axis.figure.stale
    labels = [label for label in axis.get_ticklabels() if label.get_text()]
    boxes = sorted((box.x0, box.x1) for box in (label.get_window_extent() for label in labels))
    axis.figure.stale = stale  # matplotlib takes looking at ticks for a change
    gap = TICK_GAP_EM * labels[0].get_fontsize() * axis.figure.dpi / 72 if labels else 0.0
    return any(after[0] - before[1] < gap for before, after in pairwise(boxes))


def thin_ticks(figure: Figure, axes: Axes, style: Style) -> None:
    """Use fewer ticks along x if their labels would overlap in the finished layout.

    If matplotlib divides the tick labels by a power of ten (or subtracts an offset from them), it writes this power (or
    the offset) at the end of the axis; here it is moved into the label of the axis. An axis whose ticks are set one by
    one, or that is logarithmic, is not changed.
    """
    from matplotlib.ticker import MaxNLocator

    locator = axes.xaxis.get_major_locator()
    if not isinstance(locator, MaxNLocator):
        return
    lay_out(figure)
    bins = 4 if style.width_in < 5 else 7  # as many as ``few_ticks`` sets
    while crowded(axes.xaxis) and bins > 1:
        bins -= 1
        locator.set_params(nbins=bins)
        axes.xaxis.stale = True
    power = axes.xaxis.get_major_formatter().get_offset()
    if power:  # at the end of the axis it could overlap the label of the axis
        axes.xaxis.get_offset_text().set_visible(False)
        axes.set_xlabel(f"{axes.get_xlabel()}, {power}")


def hatched(style: Style, hatch: str) -> str:
    """Return a hatch for a style; on a slide, whose lines are thick, it is about half as dense.

    The density of a hatch is the number of times that its character is repeated: "////" is denser than "//".
    """
    return hatch if style.font_pt < 12 else hatch[: (len(hatch) + 1) // 2]


def log_x(axes: Axes, values: Sequence[float]) -> None:
    """Make x logarithmic, with ticks at 1, 2, 5, 10, ...

    From 0.0001 to below a million, their labels have no exponent. If ``values``, which are all x that are drawn, extend
    over 2.5 decades or more, the ticks are at 1, 10, 100, ...

    Raises:
        InputError: a value is not above 0.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    if min(values) <= 0:
        raise InputError("a logarithmic axis needs numbers above 0", field="x")
    ratio = max(values) / min(values)  # 300 is 2.5 decades
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(base=10, subs=(1, 2, 5) if ratio < 300 else (1,), numticks=6))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: stated(value)))


def percent_axis(axis: Any) -> None:
    """Label an axis of shares in percent.

    Labels have no minus sign: shares that are drawn downwards have negative y, but are not negative.
    """
    from matplotlib.ticker import FuncFormatter

    axis.set_major_formatter(FuncFormatter(lambda value, _: percent(abs(value), None, digits=6)))


class Rows(NamedTuple):
    """Axes with one row per cell at y = 0, 1, 2, ... from the top."""

    figure: Figure
    axes: Axes
    font_pt: float
    """Font size in a row."""
    line_pt: float
    """Line width in a row: thinner in low rows."""
    band: float
    """Height of one series within a row; a row has the height 1."""
    high_in: float
    """Height that ``settle`` gives to the axes; on a slide, their least height."""

    def settle(self, style: Style) -> None:
        """Set the figure's height so that the axes get the height ``high_in``; call it when all else is drawn.

        For this the layout is computed in a figure that is high enough in any case. At the end the ticks of x are
        thinned, which requires the final layout (``thin_ticks``).
        """
        self.figure.set_figheight(self.high_in + 4 * style.height_in)
        lay_out(self.figure)  # breaks long labels
        give_height(self.figure, style, [self.axes], self.high_in)
        thin_ticks(self.figure, self.axes, style)

    def place(self, row: int, series: int, of: int) -> float:
        """Return y of a series within a row that is shared by ``of`` series; series 0 is the uppermost."""
        return row + (series - (of - 1) / 2) * self.band

    def estimate(
        self, style: Style, y: float, values: tuple[float | None, ...], look: Look, **line: Any
    ) -> None:
        """Draw an estimate and its interval at the height ``y``; a missing one is written as "no value".

        Args:
            values: estimate, low and high; None: not known. look: of the mark. line: how the interval differs from a
                line with bars at its ends in the colour of the mark, as matplotlib's ``plot`` takes it.
        """
        value, low, high = values
        if value is None:
            self.axes.annotate(
                "no value", (0.02, y), xycoords=("axes fraction", "data"), va="center", fontsize=self.font_pt,
                color=FAINT,
            )  # fmt: skip
            return
        if low is not None and high is not None:
            bars: dict[str, Any] = {"color": look.colour, "linewidth": self.line_pt, "marker": "|"} | line
            self.axes.plot([low, high], [y, y], markersize=style.marker_pt, zorder=2, **bars)
        self.axes.plot(
            value, y, ls="", marker=look.marker, markersize=style.marker_pt, markeredgecolor=look.colour,
            markeredgewidth=self.line_pt, markerfacecolor=PAPER if look.hollow else look.colour, zorder=3,
        )  # fmt: skip

    def note(self, y: float, text: str, *, colour: str = FAINT) -> None:
        """Write text right of the axes at the height ``y``, in the unit of the axes: a row has the height 1."""
        self.axes.annotate(
            plain(text), (1, y), xycoords=("axes fraction", "data"), xytext=(self.font_pt * 0.5, 0),
            textcoords="offset points", va="center", ha="left", fontsize=self.font_pt, color=colour,
            annotation_clip=False,
        )  # fmt: skip

    def heading(self, text: str, *, of_names: bool = False) -> None:
        """Write a heading in up to two lines: above the texts of ``note``, right of the axes, or the rows' names."""
        room_pt = self.figure.get_figwidth() * 72 * 0.22
        gap_pt = self.font_pt * (-0.5 if of_names else 0.5)
        self.axes.annotate(
            fitted(text, self.font_pt, room_pt, 2), (0 if of_names else 1, 1), xycoords="axes fraction",
            xytext=(gap_pt, 1), textcoords="offset points", va="bottom", ha="right" if of_names else "left",
            fontsize=self.font_pt, color=FAINT, annotation_clip=False,
        )  # fmt: skip


def rows_of(
    style: Style,
    names: Sequence[object],
    x_label: str,
    *,
    series: int = 1,
    title: str = "",
) -> Rows:
    """Make a figure that grows with its rows; the names of the rows are at the left, broken or shortened to fit.

    When everything is drawn, the caller must call ``Rows.settle``, which sets the final height.

    Args:
        style: sizes of the picture.
        names: of the rows, at least one.
        x_label: of the axis below.
        series: how many series share a row.
        title: above the rows.
    """
    # What is around the rows takes about five lines, and a title two; ``Rows.settle`` measures it.
    around = style.font_pt * LINE_SPACING * (7 if title else 5) / 72
    room_pt = style.width_in * 72 * LABEL_SHARE
    preferred = _preferred_row_in(style, names, series, room_pt)
    # A series that shares its row may have 0.75 of the least height of a row.
    least = style.least_row_in * max(1.0, 0.75 * series)
    available = (style.tallest_in - around) / len(names)
    # Height of a row: on a slide the rows fill the picture. Otherwise they are lower than preferred only if the picture
    # would be too tall.
    pitch = max(least, available if style.fixed_height else min(preferred, available))
    # A line of letters fits into a row, or with several series into 1 / 1.6 of the row. By ``_preferred_row_in`` a row
    # with two series is 1.6 times as high as a row with one.
    font = min(style.small_pt, pitch / min(series, 1.6) * 72 / LINE_SPACING)
    lines = max(1, min(3, int(pitch * 72 / (font * LINE_SPACING))))  # lines of a name that fit into a row
    figure = new_figure(style, height_in=around + pitch * len(names), title=title)
    axes = figure.add_subplot()
    # Few rows on a slide would be too high. Empty space above and below, in rows, keeps each row at most TALLEST_ROW
    # times as high as preferred: the height len(names) * pitch is divided by that of such a row.
    space = max(0.0, len(names) * (pitch / (TALLEST_ROW * preferred) - 1)) / 2
    axes.set_ylim(len(names) - 0.5 + space, -0.5 - space)  # downwards
    few_ticks(axes.xaxis, style)
    axes.set_yticks(range(len(names)), labels=fitted_names(names, font, room_pt, lines), fontsize=font)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.grid(True, axis="x")
    axes.set_xlabel(x_label)
    # If rows have several series, lines between the rows show which series belong together.
    for row in range(1, len(names) if series > 1 else 0):
        axes.axhline(row - 0.5, color=LINE, linewidth=style.line_pt * 0.6)
    band = 0.8 / series  # a fifth of a row is space between the rows
    # A note is not higher than a band; 1.05: a line of letters with little space.
    note_pt = min(font, band * pitch * 72 / 1.05)
    line_pt = min(style.line_pt, band * pitch * 72 / 8)  # at most an eighth of a band
    # On a slide the axes fill what the texts leave of its height, which ``Rows.settle`` measures, so only the least
    # height of the rows is required here.
    high_in = (least if style.fixed_height else pitch) * len(names)
    return Rows(figure=figure, axes=axes, font_pt=note_pt, line_pt=line_pt, band=band, high_in=high_in)


def _preferred_row_in(style: Style, names: Sequence[object], series: int, room_pt: float) -> float:
    """Return the preferred height of a row, inches: it has room for its series, and for each name in up to three lines.

    ``room_pt`` is the width of a name.
    """
    line = style.small_pt * LINE_SPACING / 72
    broken = max(fitted(name, style.small_pt, room_pt, 3).count("\n") + 1 for name in names)
    # With one series the height is ``row_in``, and each further series adds 0.6 of that. A name has 0.35 of a line as
    # space.
    return max(style.row_in * (0.4 + 0.6 * series), line * (broken + 0.35))


def patch_handle(style: Style, look: Look, *, edge: str = INK, filled: bool = True) -> Any:
    """Return a small area with the colour and the hatch of a look, for a legend."""
    from matplotlib.patches import Patch

    face = look.colour if filled else PAPER
    return Patch(
        facecolor=face,
        edgecolor=edge,
        hatch=hatched(style, look.hatch),
        linewidth=style.line_pt * (1 - filled / 2),
    )


FREE_LINES: Final = 2
"""Lines of a legend for which a figure has room; a slide has room for ``FREE_LINES_OF_SLIDE``."""
FREE_LINES_OF_SLIDE: Final = 7


def legend_below(figure: Figure, style: Style, handles: Sequence[Any], names: Sequence[str]) -> None:
    """Draw a legend below the axes in as many columns as fit; the figure grows if it has many lines.

    Long names are shortened. Without names, nothing is drawn.
    """
    if not names:
        return
    labels = fitted_names(
        names, style.small_pt, style.width_in * 72 - style.small_pt * 5
    )  # 5: the mark, margins
    columns = len(names)
    while True:
        lines = math.ceil(len(names) / columns)
        legend = figure.legend(
            list(handles), labels, loc="outside lower center", columnspacing=1.4, borderaxespad=0.2,
            borderpad=0.1, labelspacing=0.35, ncols=math.ceil(len(names) / lines),
        )  # fmt: skip
        box = legend.get_window_extent()
        if columns == 1 or box.width < 0.97 * figure.bbox.width:
            break
        legend.remove()
        columns = min(columns - 1, int(columns * figure.bbox.width / box.width) + 1)
    room = (FREE_LINES_OF_SLIDE if style.fixed_height else FREE_LINES) / lines
    figure.set_figheight(figure.get_figheight() + max(0.0, box.height * (1 - room)) / figure.dpi)
