"""Cells summed up, many at a time: from the rows of a study to figures of each run, and from those to one row a cell.

The numbers are those of ``analysis.swarm.summary`` and ``analysis.per_run.run_figures``, without what is not shown.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import cluster_share_of_distinct, mean_interval, plain, wilson
from vibroswarm.result import CONSENSUS, ROBOTS
from vibroswarm.study.rows import values_of

Arrays = Mapping[str, NDArray[Any]]
Figures = Mapping[str, NDArray[np.float64]]

WALKED: Final = ("avoid_per_sample_s", "distance_m", "spacing_s", "ones", "effective_samples")
OF_RUN: Final = ("truth", "consensus", "consensus_time_s", "right", "wrong", "undecided", *WALKED)
READ: Final = ("cell", *ROBOTS, *OF_RUN)
"""Columns of a study's rows that are summed up."""


def as_arrays(
    rows: pl.DataFrame, cells: Sequence[int], runs: int, robots: int
) -> tuple[dict[str, NDArray[Any]], dict[str, NDArray[Any]]]:
    """The columns ``READ`` in the order of cell, run, robot, whatever that of the rows.

    Args:
        rows: of all runs of these cells, each once. cells: by number, ascending.
    Returns: the table of robots, (cells, runs, robots) each, and that of runs, (cells, runs) each; not a number in
        place of null, the consensus by its place in ``CONSENSUS``.
    """
    shape = (len(cells), runs, robots)
    cell, run, robot = (rows[name].to_numpy().astype(np.int64) for name in ("cell", "run", "robot"))
    place = (np.searchsorted(np.array(cells), cell) * runs + run) * robots + robot
    if rows.height != math.prod(shape):
        raise ValueError(f"{rows.height} rows of {shape} cells, runs and robots")
    tables: tuple[dict[str, NDArray[Any]], dict[str, NDArray[Any]]] = {}, {}
    for name in READ[1:]:
        values = values_of(rows[name])
        sorted_ = np.empty(rows.height, dtype=values.dtype)
        sorted_[place] = values
        if name in ROBOTS:
            tables[0][name] = sorted_.reshape(shape)
        else:
            tables[1][name] = sorted_.reshape(shape)[:, :, 0].copy()
    return tables


def figures_of(robots: Arrays, runs: Arrays, t_end_s: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Of each run, (cells, runs) each: ``run_figures``, the walk, and the swarm's mean estimate of the fill ratio.

    Args:
        robots, runs: of ``as_arrays``. t_end_s: (cells,), end of a run, s.
    """
    count = robots["decision"].shape[-1]
    truth, time_s = runs["truth"].astype(np.float64), runs["consensus_time_s"]
    known = ~np.isnan(truth)
    shares = {name: np.where(known, runs[name], np.nan) for name in ("right", "wrong")}
    shares["undecided"] = runs["undecided"].astype(np.float64)
    swarm = {
        word: np.where(known, runs["consensus"] == CONSENSUS.index(word), np.nan)
        for word in ("right", "wrong")
    }
    swarm_time_s = np.minimum(np.where(np.isnan(time_s), t_end_s[:, None], time_s), t_end_s[:, None])
    estimate = robots["alpha"] / (robots["alpha"] + robots["beta"])
    return {
        "truth": truth,
        "decision_time_s": _mean(capped_time_s(robots["decision_time_s"], t_end_s)),
        "belief_in_truth": _mean(robots["belief_in_truth"]),
        "consensus_time_s": time_s,
        **shares,
        **{f"{name}_share": values / count for name, values in shares.items()},
        **{f"swarm_{word}": values for word, values in swarm.items()},
        "swarm_time_s": swarm_time_s,
        **{name: runs[name] for name in WALKED},
        "estimate": _mean(estimate),
    }


def capped_time_s(time_s: NDArray[np.float64], t_end_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """min(decision time, t_end) of each robot, (cells, runs, robots); t_end where there is no decision."""
    ends = t_end_s[:, None, None]
    return np.minimum(np.where(np.isnan(time_s), ends, time_s), ends)


def _mean(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means over the robots of each run that have the value, (cells, runs), summed as ``per_run.ByRun`` does."""
    there = ~np.isnan(values)
    first = np.arange(0, values.size, values.shape[-1])
    total = np.add.reduceat(np.where(there, values, 0.0).ravel(), first)
    with np.errstate(invalid="ignore", divide="ignore"):
        means: NDArray[np.float64] = (total / there.sum(axis=-1).ravel()).reshape(values.shape[:-1])
    return means


def row_of(robots: Arrays, figures: Arrays, t_end_s: float) -> dict[str, Any]:
    """One cell in the two forms.

    The paper's: means of time and belief, with the standard deviation over robots over the root of the runs as
    bar. As they should be: intervals over runs, and what became of the robots and of the swarms.

    Args:
        robots: the table of robots, (runs, robots) each. figures: (runs,) each.
    """
    runs, count = robots["decision"].shape
    row: dict[str, Any] = {"runs": runs}
    for name in ("decision_time_s", "belief_in_truth"):
        row |= _ends(name, mean_interval(figures[name]))
    capped = capped_time_s(robots["decision_time_s"][None], np.array([t_end_s]))
    row["decision_time_s_bar"] = float(capped.std()) / math.sqrt(runs)
    belief = robots["belief_in_truth"].ravel()
    belief = belief[~np.isnan(belief)]
    row["belief_in_truth_bar"] = float(belief.std()) / math.sqrt(runs) if belief.size else None
    known = ~np.isnan(figures["truth"])
    for name, values in (
        ("right", figures["right"][known]),
        ("wrong", figures["wrong"][known]),
        ("undecided", figures["undecided"]),
    ):
        times = np.bincount(values.astype(np.int64), minlength=count + 1)
        distinct = np.flatnonzero(times)
        share = cluster_share_of_distinct(distinct, np.full(distinct.size, count), times[distinct])
        row |= _ends(f"robots_{name}", share)
    for name in ("swarm_right", "swarm_wrong"):
        row |= _ends(name, wilson(int(np.nansum(figures[name])), int(known.sum())))
    for name in WALKED[:2]:
        row |= _ends(name, mean_interval(figures[name]))
    return row


def _ends(name: str, found: Sequence[Any]) -> dict[str, Any]:
    return {f"{name}{end}": plain(value) for end, value in zip(("", "_low", "_high"), found[:3], strict=True)}


def digest_of(robots: Arrays) -> str:
    """SHA-256 of the values of a table of robots, (runs, robots) each, bit by bit; a missing value counts as one."""
    found = hashlib.sha256()
    for name, kind in ROBOTS.items():
        values = robots[name]
        missing = np.isnan(values) if kind.is_float() else np.zeros(values.shape, dtype=np.bool_)
        found.update(name.encode() + b"\0" + missing.tobytes())
        filled = np.where(missing, 0.0, values).astype("<f8") if kind.is_float() else values.astype("<i8")
        found.update(filled.tobytes())
    return found.hexdigest()
