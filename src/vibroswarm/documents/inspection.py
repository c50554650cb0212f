"""The document of an inspection by place: where it vibrates, how sure that is, and what it is based on."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.map_scores import SURE, calibration
from vibroswarm.core.numbers import count, number, percent, size, verb, whole
from vibroswarm.documents.cell_figures import WIDEST_MAP, tile_lines
from vibroswarm.documents.damage import (
    damage_answer,
    damage_sections,
    map_figure,
    not_certified,
    vibrates,
)
from vibroswarm.inspection.inspection import Inspection
from vibroswarm.inspection.samples import Samples
from vibroswarm.show.document import Column, Document, Part, Section, Table, Text
from vibroswarm.simulation import versions

ROWS: Final = 12
"""Rows of the table of scores over time."""
NARROW: Final = 3
"""Tiles should be so many times as wide as places are uncertain."""


def inspection_document(found: Inspection) -> Document:
    """Return the document of an inspection."""
    samples = found.samples
    is_refused = found.assessment is not None and bool(found.assessment.refusals)  # the answer says why
    parts: list[Part] = [Text(_what(samples)), *map(Text, _presumed(samples))]
    if found.assessment is None:
        parts.append(Text("Whether the law of the sensor and the places hold is not checked; add --damage."))
    if found.by_kind is not None and samples.kinds is not None:
        parts += _kinds(found.by_kind, samples.kinds.at(found.times_s[-1]).tiles)
    if found.pooled is not None:
        parts += _map(found)
    if found.assessment is not None:
        parts += damage_sections(found)
    return Document(
        title=f"Inspection of {samples.source}",
        answer=_answer(found),
        knew=(f"Places: {samples.places}. Law of the sensor: {samples.law.origin}.",),
        warnings=() if is_refused else tuple(filter(None, (samples.warning,))),
        parts=tuple(parts),
        made_by={
            "law of the sensor": " ".join(filter(None, (samples.law.origin, samples.law.hash))),
            "samples": samples.hash,
            **versions(),
        },
    )


def _kinds(by_kind: NDArray[np.float64], tiles: NDArray[np.uint8]) -> list[Part]:
    """Return the most probable kind of each tile, beside the true one."""
    likely = by_kind.argmax(axis=1).reshape(tiles.shape)
    lines = [
        "  ".join(f"{one}{' ' if one == true else '!'}" for one, true in zip(row, of_row, strict=True))
        for row, of_row in zip(likely.tolist(), tiles.tolist(), strict=True)
    ]
    right = int((likely == tiles).sum())
    row, column = (index.ravel() for index in np.indices(tiles.shape))
    table = pl.DataFrame(
        {"row": row, "column": column, "kind": tiles.ravel(), "most_probable": likely.ravel()}
        | {f"kind_{kind}": by_kind[:, kind] for kind in range(by_kind.shape[1])}
    )
    columns = {f"kind_{kind}": Column(f"kind {kind}", share=True) for kind in range(by_kind.shape[1])}
    return [
        Text(
            f"Most probable kind of each tile, from all samples: {right} of {tiles.size} right; ! marks a wrong tile:"
        ),
        Text("\n".join(lines), "code"),
        Table(table, columns, "Probability of each kind of each tile.", "kinds", names=2, folded=True),
    ]


def _answer(found: Inspection) -> tuple[str, ...]:
    damage = () if found.assessment is None else damage_answer(found.assessment)
    if found.assessment is not None and found.assessment.refusals:
        damage = (not_certified(found.assessment), *damage)
    if found.pooled is None:
        return damage
    p = found.pooled[-1]
    vibrate, still = int((p > SURE).sum()), int((p < 1.0 - SURE).sum())
    two = found.by_kind is None
    vibrates = verb(vibrate, "vibrate") if two else f"{verb(vibrate, 'are', 'is')} of another kind than 0"
    unsure = p.size - vibrate - still
    words = [
        f"{whole(vibrate)} of {count(p.size, 'tile')} {vibrates} and {whole(still)} {verb(still, 'are', 'is')} "
        f"{'still' if two else 'of kind 0'}, each with more than {percent(SURE, 0)}; {whole(unsure)} "
        f"{verb(unsure, 'are', 'is')} open, after {number(found.times_s[-1], 0)} s. Expected number of tiles "
        f"that {'vibrate' if two else 'are of another kind than 0'}: {number(float(p.sum()), 1)}.",
    ]
    if found.samples.truth_known:
        last = found.scores.row(-1, named=True)
        right = round(last["right"] * p.size)
        since = (
            "" if found.right_from_s is None else f", all of them from {number(found.right_from_s, 0)} s on"
        )
        words.append(
            f"Against the true floor: {right} of {p.size} tiles right{since}, {int(last['surely_wrong'])} surely "
            f"wrong; Brier score {number(last['brier'], 4)} (0.25: knows nothing)."
        )
    return (*damage, *words)


def _what(samples: Samples) -> str:
    left_out = (
        f" {count(samples.left_out, 'row')} of the file without a value left out." if samples.left_out else ""
    )
    outside = int((samples.beyond > 0.0).any(axis=0).sum())
    beyond = f", {outside} of them outside of it" if outside else ""
    return (
        f"{count(samples.frame.height, 'sample')} of {count(len(samples.robots), 'robot')} on "
        f"{size(*samples.size_m)}{beyond}.{left_out}"
    )


def _presumed(samples: Samples) -> Iterator[str]:
    """Yield what the figures presume about places and tiles."""
    errors = samples.place_errors
    if errors is not None:
        shares = ", ".join(percent(share) for share in errors.within)
        yield (
            f"Places taken as independent: their errors within 1, 2 and 4 stated standard deviations are {shares} "
            f"(68.3, 95.4 and 100 % expected), correlated by {number(errors.lag_one, 2)} from sample to sample of a "
            "robot."
        )
    elif samples.column("spread_x_m").any():
        yield "Places taken as independent; how wrong they are is not known."
    elif samples.frame["true_x_m"].null_count():
        yield "Places taken as exact and independent; how wrong they are is not known (state it: --spread-mm)."
    else:
        yield "Places are exact."
    if samples.floor is not None:
        before = (
            "vibrating with probability 1/2" if samples.kinds is None else "of each kind equally probable"
        )
        yield f"Tiles taken as independent, each {before} before any sample; the grid is known."
        spreads_m = [samples.column(f"spread_{axis}_m") for axis in "xy"]
        times = min(samples.floor.geometry[2:4]) / max(float(np.sqrt(np.mean(np.square(spreads_m)))), 1e-9)
        if times < NARROW:
            yield (
                f"Tiles are {number(times, 1)} times as wide as places are uncertain (standard deviation): below "
                f"{NARROW} the map is surer of single tiles than it is right."
            )


def _map(found: Inspection) -> list[Part]:
    """Return the map as text, figure and table, and its scores over time where the truth is known."""
    maps = found.last_maps
    pooled = maps.filter(pl.col("robot").is_null())
    parts: list[Part] = []
    if found.samples.floor is not None and found.samples.floor.tiles.shape[1] <= WIDEST_MAP:
        words = f"Probability that each tile {vibrates(found)}, %, from all samples"
        parts.append(Text(f"{words}{'; ! marks a wrong tile' if found.samples.truth_known else ''}:"))
        parts.append(Text(tile_lines(pooled), "code"))

    parts.append(map_figure(found))
    columns = {"vibrating": Column(share=True), "spread": Column("standard deviation", share=True)}
    each = Table(maps.drop("run"), columns, name="map", names=3)
    parts.append(Section("Tile by tile", (each,), folded=True))
    scores = found.scores
    if not scores.is_empty():
        chosen = np.unique(np.linspace(0, scores.height - 1, ROWS).round().astype(int))
        columns = {
            "time_s": Column("time", "s", decimals=0),
            "brier": Column("Brier score", decimals=4),
            "log_score": Column("log score", decimals=4),
            "auc": Column("AUC", decimals=3),
            "right": Column("tiles right", share=True),
            "surely_wrong": Column("surely wrong", decimals=0),
            "location_error_m": Column("location error", "m", decimals=3),
        }
        table = Table(
            scores[chosen],
            columns,
            caption="The map over time, against the true floor at each time.",
            name="scores",
        )
        parts.append(Section("Over time", (table, _calibration(found))))
    return parts


def _calibration(found: Inspection) -> Table:
    """Return how often tiles of a probability vibrate, over all times: those of one inspection are not independent."""
    assert found.pooled is not None
    assert found.vibrates is not None
    columns = {
        **{name: Column(share=True) for name in ("from", "to", "probability")},
        "vibrating": Column("truly vibrating", share=True),
    }
    frame = calibration(found.pooled.ravel(), found.vibrates.ravel().astype(np.float64)).drop(
        "vibrating_low", "vibrating_high"
    )
    caption = "Calibration: tiles at all times, by their probability."
    return Table(frame, columns, caption=caption, name="calibration", names=2, folded=True)
