"""How the columns of a table are headed and written, by their names alone.

| name | heading and numbers |
|---|---|
| a figure (``statistics.figures``) | its title and unit; shares in percent |
| NAME_s, NAME_m, NAME_mm, NAME_ms, NAME_hz, NAME_deg | unit |
| NAME_share | percent |
| NAME_difference, difference | with sign; shares in points |
| p, p_holm | p-value |
| NAME_low, NAME_high | limits of NAME, written behind it |
| NAME_verdict | "better" or "worse": a mark beside NAME |
| figure | names a figure, whose are the numbers of its row |

Numbers that stand together get as many decimals as their intervals deserve: two digits of the half-width.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from statistics import median
from typing import Any, Final, NamedTuple

import polars as pl

from vibroswarm.core.numbers import number, p_value
from vibroswarm.statistics.figures import BY_COLUMN, BY_NAME

UNITS: Final = {
    "_ms": "ms",
    "_mm": "mm",
    "_s": "s",
    "_m": "m",
    "_hz": "Hz",
    "_deg": "°",
    "_share": "%",
}
COMPANIONS: Final = ("_low", "_high", "_verdict")
MARKS: Final = {"better": "●", "worse": "✕"}
TITLES: Final = {
    "p_holm": "p (Holm)",
    "strategy.name": "strategy",
    "floor.source": "floor",
    "network.name": "network",
    "task.name": "task",
    "error": "error",
}
PLAIN: Final = ("p", "p_holm", "better", "equal", "worse", "runs")
"""Columns that are written by their own name also beside a column ``figure``."""
MOST_DECIMALS: Final = 6
"""Smaller numbers are written with decimals of their own."""


class Format(NamedTuple):
    """Heading, unit, factor, and whether numbers have a sign."""

    title: str
    unit: str = ""
    factor: float = 1.0
    signed: bool = False


class Bar(NamedTuple):
    """Places of an interval on a strip from 0 to 100; ``zero`` is None where numbers have no sign."""

    low: float
    middle: float
    high: float
    zero: float | None


class Entry(NamedTuple):
    """A cell of a table: its text, limits, mark and bar, and the value by which it is sorted."""

    text: str
    limits: str = ""
    verdict: str = ""
    bar: Bar | None = None
    value: Any = ""


class Heading(NamedTuple):
    """Heading of a column, and whether it holds numbers."""

    title: str
    unit: str
    is_number: bool


class TextTable(NamedTuple):
    """A table whose cells are written."""

    headings: list[Heading]
    rows: list[list[Entry]]


class Value(NamedTuple):
    """A number with its limits, nan where there are none, in the unit in which it is written."""

    middle: float
    low: float = math.nan
    high: float = math.nan

    @property
    def has_limits(self) -> bool:
        """Whether both limits are finite."""
        return math.isfinite(self.middle) and math.isfinite(self.high - self.low)


def format_of(name: str) -> Format:
    """Return the format of a column by its name, or of a row by that of its figure."""
    base = name.removesuffix("_difference")
    signed = base != name or name == "difference"
    figure = BY_NAME.get(base) or BY_COLUMN.get(base)
    if figure is not None:
        unit = ("points" if signed else "%") if figure.is_share else figure.unit
        return Format(figure.title, unit, 100.0 if figure.is_share else 1.0, signed)
    suffix = next((suffix for suffix in UNITS if base.endswith(suffix)), "")
    title = TITLES.get(name) or base.removesuffix(suffix).rpartition(".")[2].replace("_", " ")
    factor = 100.0 if suffix == "_share" else 1.0
    unit = UNITS.get(suffix, "")
    return Format(title, "points" if signed and unit == "%" else unit, factor, signed)


def write_value(value: Value, unit: str = "", *, sign: bool = False) -> str:
    """Write a number with unit and limits, as in ``118 s [90, 147]``."""
    decimals = decimals_of([value])
    texts = [number(each, decimals, sign=sign) for each in value]
    limits = f" [{texts[1]}, {texts[2]}]" if value.has_limits else ""
    return f"{texts[0]}{f' {unit}' if unit else ''}{limits}"


def value_of(row: Mapping[str, Any], name: str, factor: float | None = None) -> Value:
    """Return a number of a row with its limits, in the unit in which it is written."""
    scale = format_of(name).factor if factor is None else factor
    values = [row.get(f"{name}{end}") for end in ("", "_low", "_high")]
    return Value(*(math.nan if each is None else each * scale for each in values))


def decimals_of(values: Iterable[Value]) -> int | None:
    """Return decimals for numbers that stand together: two digits of the half-width, or three of the largest."""
    known = [value for value in values if math.isfinite(value.middle)]
    halves = [(value.high - value.low) / 2 for value in known if value.has_limits and value.high > value.low]
    if not halves and all(value.middle.is_integer() for value in known):
        return 0
    size, digits = (median(halves), 2) if halves else (max(abs(value.middle) for value in known), 3)
    decimals = max(0, digits - 1 - math.floor(math.log10(size)))
    return decimals if decimals <= MOST_DECIMALS else None


def text_table(frame: pl.DataFrame, titles: Mapping[str, str]) -> TextTable:
    """Write the cells of a table."""
    names = [name for name in frame.columns if not _is_companion(name, frame.columns)]
    numbers = {name for name in names if frame.schema[name].is_numeric()}
    headings = [_heading(name, name in numbers, "figure" in names, titles) for name in names]
    rows = frame.to_dicts()
    written = _written_numbers(rows, [name for name in names if name in numbers])
    return TextTable(
        headings,
        [
            [
                written[place, name] if name in numbers else _text_entry(name, row[name], row, titles)
                for name in names
            ]
            for place, row in enumerate(rows)
        ],
    )


def clean(text: str) -> str:
    """Return text without characters that a terminal would act on, but for line breaks."""
    return "".join(c if c.isprintable() or c == "\n" else " " if c.isspace() else "?" for c in text)


def _is_companion(name: str, names: Collection[str]) -> bool:
    return any(name.endswith(end) and name.removesuffix(end) in names for end in COMPANIONS)


def _heading(name: str, is_number: bool, by_row: bool, titles: Mapping[str, str]) -> Heading:
    form = format_of(name)
    is_cell = by_row and is_number and name not in PLAIN and not form.signed
    title = clean(titles.get(name, name if is_cell else form.title))
    return Heading(title, "" if by_row or not is_number else form.unit, is_number)


def _written_numbers(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> dict[tuple[int, str], Entry]:
    """Write numbers by row and column; those of a column, or of one figure's rows, share decimals and a scale."""
    groups: dict[Any, list[tuple[int, str]]] = {}
    for place, row in enumerate(rows):
        for name in names:
            by_row = "figure" in row and name not in PLAIN
            key = (row["figure"], format_of(name).signed) if by_row else name
            groups.setdefault(key, []).append((place, name))
    entries = {}
    for members in groups.values():
        forms = [_format_in(rows[place], name) for place, name in members]
        values = [
            value_of(rows[place], name, form.factor)
            for (place, name), form in zip(members, forms, strict=True)
        ]
        for (place, name), entry in zip(members, _entries(values, forms[0].signed), strict=True):
            is_p = name in ("p", "p_holm") and entry.text
            text = p_value(rows[place][name]) if is_p else entry.text
            verdict = rows[place].get(f"{name}_verdict") or ""
            entries[place, name] = entry._replace(text=text, verdict=verdict)
    return entries


def _format_in(row: Mapping[str, Any], name: str) -> Format:
    form = format_of(name)
    if "figure" in row and name not in PLAIN:
        return format_of(row["figure"])._replace(signed=form.signed)
    return form


def _entries(values: Sequence[Value], signed: bool) -> list[Entry]:
    decimals = decimals_of(values)
    ends = [each for value in values for each in value if math.isfinite(each)] + [0.0] * signed
    least, most = min(ends, default=0.0), max(ends, default=1.0)
    span = most - least or 1.0
    entries = []
    for value in values:
        if math.isnan(value.middle):
            entries.append(Entry(""))
            continue
        texts = [number(each, decimals, sign=signed).replace("-", "\u2212") for each in value]
        bar = None
        if value.has_limits and (signed or len(values) > 1):
            left, middle, right, zero = (
                4 + 92 * (each - least) / span for each in (value.low, value.middle, value.high, 0.0)
            )
            bar = Bar(left, middle, right, zero if signed else None)
        is_open = math.isfinite(value.low) and math.isnan(value.high)
        limits = f"[{texts[1]}, {texts[2]}]" if value.has_limits else f"[{texts[1]}, \u221e)" * is_open
        entries.append(Entry(texts[0], limits, "", bar, value.middle))
    return entries


def _text_entry(name: str, value: Any, row: Mapping[str, Any], titles: Mapping[str, str]) -> Entry:
    if name == "figure":
        form = format_of(value)
        title = titles.get(value, form.title)
        text = f"{title}, {form.unit}" if form.unit else title
    elif isinstance(value, bool):
        text = "yes" if value else "no"
    else:
        text = "" if value is None else clean(str(value))
    return Entry(text, verdict=row.get(f"{name}_verdict") or "", value=text)
