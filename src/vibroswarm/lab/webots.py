"""The console log of the study's simulator: lines of numbers among others, samples only.

A data line is ``1, time s, robot, energy, bit sent, belief, alpha, beta, sent, received, posterior mean, own mean,
x m, z m, walking ms, avoiding ms, pause ms, decision time s, decision``, with y = 1 - z. Samples of the first 5 s are
not printed, and each robot's last line stands twice. The settings stand in one of the first lines:
``gamma_0 gamma tau theta_c O_c feedback eta seed ...``.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.lab.cells import check_values, text_of
from vibroswarm.lab.log import SAMPLES, TRACKS, Log, log_frame

CELLS: Final = 19
_PLACES: Final = {
    "time_s": 1, "robot": 2, "energy": 3, "message": 4, "belief": 5, "alpha": 6, "beta": 7, "sent": 8,
    "received": 9, "x_m": 12, "y_m": 13, "avoid_total_s": 15, "stop_total_s": 16, "decision": 18,
}  # fmt: skip
_SETTINGS: Final = re.compile(
    r"^(\d+) (\d+) (\d+) (\d+) (\d+) ([012]) (\d+) (\d+) 1 (\d+) (\d+) 0 0\s*$", re.M
)
_FEEDBACK: Final = ("none", "positive", "soft")


def looks_like_webots(head: str) -> bool:
    """Whether a text is such a log: one of its lines is a data line."""
    return any(line.startswith("1,") and line.count(",") == CELLS - 1 for line in head.splitlines())


def read_webots(path: Path) -> Log:
    """A console log.

    Raises:
        InputError: no data line, a data line of another length, text in numbers; with the line's number.
    """
    name, text = str(path), text_of(path)
    rows, numbers = [], []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.count(",") < 10 or not line.startswith("1,"):
            continue
        cells = line.split(",")
        if len(cells) != CELLS:
            raise InputError(
                f"{len(cells)} cells where a data line has {CELLS}", field=f"{name}, row {number}"
            )
        rows.append([_number(cell, name, number) for cell in cells])
        numbers.append(number)
    if not rows:
        raise InputError("holds no data line (19 numbers with a comma between them)", field=name)
    table = np.array(rows)
    lines = pl.Series("line", numbers, dtype=pl.UInt32)
    found: dict[str, Any] = {"line": lines}
    for use, place in _PLACES.items():
        values = table[:, place]
        if use == "y_m":
            values = 1.0 - values
        elif use in ("avoid_total_s", "stop_total_s"):
            values = values / 1000.0
        series = pl.Series(use, values)
        check_values(series, lines, name, use, f"{place + 1}")
        found[use] = series
    settings = _settings(text)
    found["observation"] = _bits_read(settings.get("strategy.name"), found["message"], found["decision"])
    return Log(
        name=path.name,
        reader="webots",
        samples=log_frame(found, SAMPLES),
        tracks=log_frame({}, TRACKS).clear(),
        settings=settings,
        told={"rows": len(rows)},
    )


def _bits_read(strategy: str | None, sent: pl.Series, decision: pl.Series) -> pl.Series:
    """The bits that were read, as far as those that were sent tell: always without feedback, until it decides with
    positive feedback, else never (null)."""
    known = pl.lit(strategy == "none") | (pl.lit(strategy == "positive") & (pl.col("decision") == -1))
    frame = pl.DataFrame([sent.alias("sent"), decision.alias("decision")])
    return frame.select(pl.when(known).then("sent").alias("observation")).to_series()


def _number(cell: str, name: str, line: int) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"'{cell[:40]}' is no number", field=f"{name}, row {line}")
    return value


def _settings(text: str) -> dict[str, Any]:
    """What the log says of its own settings; nothing where it does not."""
    found = _SETTINGS.search(text)
    if found is None:
        return {}
    location, scale, tau, theta_c, least, feedback, eta, *_ = (int(one) for one in found.groups())
    return {
        "walk.walk_duration_location_ms": float(location),
        "walk.walk_duration_scale_ms": float(scale),
        "sample.sample_interval_ms": float(tau),
        "walk.avoidance_threshold_mm": float(theta_c),
        "decision.min_observations": least,
        "strategy.name": _FEEDBACK[feedback],
        "strategy.soft.eta": float(eta),
    }
