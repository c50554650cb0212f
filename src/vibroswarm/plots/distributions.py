"""Outcomes and values over the runs of each cell: bars of outcomes, box pictures.

The outcomes are right, wrong, split (robots differ), incomplete (one is undecided), truth undefined. In a box picture
of known end, undecided runs count as later: a quantile among them is drawn in a band right of it.
"""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.numbers import verb
from vibroswarm.errors import InputError
from vibroswarm.plots.inputs import tidy, with_series
from vibroswarm.plots.layout import (
    Rows,
    legend_below,
    of_runs,
    patch_handle,
    percent_axis,
    rows_of,
    share,
)
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import (
    BAND,
    FAINT,
    INK,
    OUTCOME_HATCHES,
    OUTCOMES,
    PAPER,
    Look,
    looks_of,
    row_looks,
    style_named,
)


@drawn
def draw_outcomes(
    frame: pl.DataFrame,
    *,
    interval: str = "95 % interval",
    unit: str = "run",
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw one bar per cell, divided by the outcomes of its runs, with the share of right runs and its ``interval``."""
    kinds = list(OUTCOMES)
    frame = tidy(frame, texts=("cell",), optional=(*kinds, "right_low", "right_high"))
    frame = frame.with_columns(pl.col(kinds).fill_null(0.0)).with_columns(runs=pl.sum_horizontal(kinds))
    seen = [kind for kind in kinds if frame[kind].sum() > 0] or kinds[:1]
    shares = frame.with_columns(
        pl.when(pl.col("runs") > 0).then(pl.col(kind) / pl.col("runs")) for kind in kinds
    )
    rows = rows_of(style_named(style), frame["cell"].to_list(), f"share of {unit}s", title=title)
    for row, values in enumerate(shares.to_dicts()):
        _bar(rows, row, values, seen, unit)
    rows.axes.set_xlim(0, 1)
    percent_axis(rows.axes.xaxis)
    looks = [Look(OUTCOMES[kind], "", (0, ()), OUTCOME_HATCHES[kind], hollow=False) for kind in seen]
    words = {"incomplete": "undecided", "truth_undefined": "truth undefined"}
    names = [f"{words.get(kind, kind)}{'' if unit == 'run' else f' ({unit}s)'}" for kind in seen]
    legend_below(rows.figure, rows.style, [patch_handle(look) for look in looks], names)
    caption = f"What became of the {unit}s, by cell: {of_runs([int(runs) for runs in frame['runs']], unit)}."
    if frame["right_low"].is_not_null().any():
        caption += f" The bracket is the {interval} of the share right."
    numbers = shares.select("cell", pl.col("runs").cast(pl.UInt64), *kinds, "right_low", "right_high")
    return Picture(rows.figure, numbers, caption)


def _bar(rows: Rows, row: int, values: dict[str, Any], seen: list[str], unit: str) -> None:
    if not values["runs"]:
        rows.axes.text(0.5, row, f"no {unit}s", ha="center", va="center")
        return
    left = 0.0
    for kind in seen:
        looks: dict[str, Any] = {
            "facecolor": OUTCOMES[kind],
            "edgecolor": INK,
            "hatch": OUTCOME_HATCHES[kind],
        }
        rows.axes.barh(row, values[kind], rows.band, left=left, linewidth=0.6, zorder=2, **looks)
        left += values[kind]
    low, high = values["right_low"], values["right_high"]
    if low is not None and high is not None:
        rows.axes.plot([low, high], [row, row], color=INK, marker="|", zorder=3)
    rows.note(row, share(values["right"], 1.0))


QUANTILES = {"q05": 0.05, "q25": 0.25, "median": 0.5, "q75": 0.75, "q95": 0.95}
"""Quantiles of a box, by the names of their columns."""
BAND_SHARE = 0.07
"""Width of the band after the end of the runs, relative to the axis before it."""


@drawn
def draw_boxes(
    frame: pl.DataFrame,
    *,
    label: str = "decision time (s)",
    t_end: float | None = None,
    missing: str = "undecided",
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw one box per cell and series: median, quartiles, and 5 % to 95 % of the runs."""
    frame, series = with_series(tidy(frame, numbers=("value",), texts=("cell",)))
    latest: Any = frame["value"].max()
    if t_end is not None and latest is not None and latest > t_end:
        raise InputError(f"holds {latest:g}, later than the end at {t_end:g}", field="value")
    cells = frame["cell"].unique(maintain_order=True).to_list()
    looks, of_rows = looks_of(series), row_looks(cells) if len(series) == 1 else {}
    rows = rows_of(style_named(style), cells, label, series=len(series), title=title)
    in_band = _end_band(rows, t_end)
    parts = frame.partition_by("cell", "series", as_dict=True)
    numbers: list[dict[str, Any]] = []
    for (row, cell), (index, name) in product(enumerate(cells), enumerate(series)):
        if (part := parts.get((cell, name))) is None:
            continue
        values, undecided = np.sort(part["value"].drop_nulls().to_numpy()), part["value"].null_count()
        size = part.height if t_end is not None else values.size
        found = {key: quantile(values, q, size) for key, q in QUANTILES.items()}
        numbers.append({"cell": cell, "series": name, "runs": part.height, "undecided": undecided, **found})
        y = rows.place(row, index, len(series))
        _box(rows, y, of_rows.get(cell, looks[index]), found, in_band)
        if frame["value"].has_nulls():
            rows.note(y, share(undecided, part.height))
    if frame["value"].has_nulls():
        rows.heading(missing)
    if len(series) > 1:
        handles = [patch_handle(look, edge=look.colour, filled=False) for look in looks]
        legend_below(rows.figure, rows.style, handles, series)
    lost, total = frame["value"].null_count(), frame.height
    late = "counted as later than the end of the runs (shaded)" if t_end is not None else "not drawn"
    said = f"{lost} of {total} {verb(lost, 'are', 'is')} {missing}, {late}" if lost else f"none {missing}"
    caption = (
        f"{label}. Line: median; box: 25 % to 75 %; whiskers: 5 % to 95 % of the runs. "
        f"{of_runs([row['runs'] for row in numbers])}; {said}."
    )
    return Picture(rows.figure, pl.DataFrame(numbers, infer_schema_length=None), caption)


def _end_band(rows: Rows, end: float | None) -> float | None:
    """Draw the band for undecided runs, and return the x of its middle; None if the end is unknown."""
    if end is None:
        return None
    band = BAND_SHARE * end
    rows.axes.axvspan(end, end + band, color=BAND, linewidth=0, zorder=0)
    rows.axes.axvline(end, color=FAINT, zorder=0.5)
    rows.axes.set_xlim(0, end + band)
    return end + band / 2


def quantile(values: NDArray[np.float64], q: float, size: int) -> float | None:
    """Return a quantile of ``size`` runs, of which those beyond ``values`` (sorted) are later than all others."""
    place = q * (size - 1)
    low, high = math.floor(place), math.ceil(place)
    if size == 0 or high >= values.size:
        return None
    return float(values[low] + (place - low) * (values[high] - values[low]))


def _box(rows: Rows, y: float, look: Look, found: dict[str, float | None], in_band: float | None) -> None:
    """Draw quantiles as a box with whiskers; those later than the end of the runs are drawn at ``in_band``."""
    from matplotlib.patches import Rectangle

    if in_band is None and found["median"] is None:
        return
    x: dict[str, Any] = {name: in_band if value is None else value for name, value in found.items()}
    half = rows.band * 0.36
    box = Rectangle(
        (x["q25"], y - half), x["q75"] - x["q25"], 2 * half, facecolor=PAPER, edgecolor=look.colour
    )
    box.set(hatch=look.hatch, zorder=2)
    rows.axes.add_patch(box)
    for low, high, tip in (("q05", "q25", "q05"), ("q75", "q95", "q95")):
        rows.axes.plot([x[low], x[high]], [y, y], color=look.colour)
        rows.axes.plot([x[tip]] * 2, [y - half / 2, y + half / 2], color=look.colour)
    rows.axes.plot(
        [x["median"]] * 2, [y - half, y + half], color=INK, linewidth=2 * rows.style.line_pt, zorder=3
    )
