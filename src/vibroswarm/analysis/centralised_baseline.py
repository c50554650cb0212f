"""Compute pooled counting, a centralised baseline: the decision if all bits of a swarm were in one place at once.

| name | symbol | equation |
|---|---|---|
| bits so far, ones among them | n, S | of all robots of the run, in order of time |
| evidence by count | X | S - x n, with x the tested boundary (``observation.boundary``) |
| evidence by belief | X | ln[(1 - p) / p], p = I_x(a0 + S, b0 + n - S) with the scenario's prior Beta(a0, b0) |
| threshold | h | decide 1 once X >= h, 0 once X <= -h; undecided if never |
| error | - | share wrong + u (share undecided), the same u for both |

h is tuned on one half of the runs: the smallest threshold whose error is at most the strategy's error (or that with the
least error, if none is). Both are judged on the other half, run by run. With u above 0, a strategy with many undecided
robots may have the error of a coin toss: then h is almost 0, and u = 0 is more informative.

This is a reference, not a bound: another rule on the same bits may do better. It shows the cost in time, at equal
error, of deciding as a swarm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import betainc

from vibroswarm.analysis.cell_summary import run_figures
from vibroswarm.analysis.intervals import (
    Interval,
    check_level,
    mean_interval,
    plain,
    sign_flip_interval,
    wilson,
)
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.observation.decision_boundary import readings_boundary
from vibroswarm.result import Result

Rule = Literal["count", "belief"]
RULES: Final = ("count", "belief")
THRESHOLDS: Final = 400
"""Number of thresholds tried, evenly spaced up to the largest evidence in the tuning half."""


@dataclass(frozen=True)
class PooledCounting(NotebookView):
    """The reference and the strategy on the judged half of the runs; times in s."""

    rule: Rule
    threshold: float
    undecided_counts: float
    runs_tuned: int
    runs_judged: int
    tuned_error: float
    """Error of the reference on the tuning half."""
    strategy_tuned_error: float
    """Error of the strategy on the tuning half, the target."""
    time_s: Interval
    wrong: Interval
    undecided: Interval
    error: Interval
    strategy_time_s: Interval
    strategy_wrong: Interval
    strategy_undecided: Interval
    strategy_error: Interval
    time_difference_s: Interval
    """Strategy - reference, paired by run; above 0 if the swarm is slower."""
    error_difference: Interval
    """Strategy - reference; close to 0 if the tuning generalised."""

    def as_dict(self) -> dict[str, Any]:
        """Return nested plain values for JSON."""
        return {
            name: value.as_dict() if isinstance(value, Interval) else plain(value)
            for name, value in self.__dict__.items()
        }


def pooled_counting(
    result: Result,
    rule: Rule = "count",
    undecided_counts: float = 0.0,
    level: float = 0.95,
    seed: int = 0,
) -> PooledCounting:
    """Compute pooled counting at the strategy's own error.

    Args:
        result: complete runs with the strategy's decisions; those without a truth are left out.
        rule: which evidence has the threshold. undecided_counts: u of the module's head, in [0, 1].
    Raises:
        InputError: an unknown rule, u outside [0, 1], fewer than 4 runs with a truth, or runs that stopped early.
    """
    check_level(level)
    if rule not in RULES:
        raise InputError(f"'{rule}' is not a rule of pooled counting; count or belief", field="rule")
    if not 0.0 <= undecided_counts <= 1.0:
        raise InputError(f"{undecided_counts!r} is not a share; from 0 to 1", field="undecided_counts")
    t_end_s = result.scenario.run.t_end_s
    table = run_figures(result.robots, result.runs, t_end_s).filter(pl.col("truth").is_not_null())
    if table.height < 4:
        raise InputError(
            "at least 4 runs with a truth are needed: half to tune, half to test", field="result"
        )
    if result.runs["stopped_early"].any():
        raise InputError("runs that stopped early lack the samples after; run to t_end", field="result")
    passages = first_passages(result, table["run"].to_list(), rule)
    tuning = np.arange(table.height) % 2 == 0
    wrong, undecided = table["wrong_share"].to_numpy(), table["undecided_share"].to_numpy()
    target = float((wrong + undecided_counts * undecided)[tuning].mean())
    truth = table["truth"].to_numpy()
    index, tuned = _tune(passages, truth, tuning, target, undecided_counts)
    judged = ~tuning
    decision, time_s = passages.decision[judged, index], passages.time_s[judged, index]
    pooled_wrong = ((decision != -1) & (decision != truth[judged])).astype(np.float64)
    pooled_left = (decision == -1).astype(np.float64)
    time_s = np.where(decision == -1, t_end_s, time_s)
    strategy_time_s = table["decision_time_s"].to_numpy()[judged]
    strategy_error = (wrong + undecided_counts * undecided)[judged]
    error = pooled_wrong + undecided_counts * pooled_left
    n = int(judged.sum())
    return PooledCounting(
        rule=rule,
        threshold=float(passages.thresholds[index]),
        undecided_counts=undecided_counts,
        runs_tuned=int(tuning.sum()),
        runs_judged=n,
        tuned_error=tuned,
        strategy_tuned_error=target,
        time_s=mean_interval(time_s, level),
        wrong=wilson(int(pooled_wrong.sum()), n, level),
        undecided=wilson(int(pooled_left.sum()), n, level),
        error=mean_interval(error, level),
        strategy_time_s=mean_interval(strategy_time_s, level),
        strategy_wrong=mean_interval(wrong[judged], level),
        strategy_undecided=mean_interval(undecided[judged], level),
        strategy_error=mean_interval(strategy_error, level),
        time_difference_s=sign_flip_interval(strategy_time_s - time_s, level, seed),
        error_difference=sign_flip_interval(strategy_error - error, level, seed),
    )


@dataclass(frozen=True)
class Passages(NotebookView):
    """Time and side at which the evidence of each run first passes each threshold; arrays (runs, thresholds).

    Where it never passes, the decision is -1 and the time infinite.
    """

    thresholds: NDArray[np.float64]
    decision: NDArray[np.int8]
    time_s: NDArray[np.float64]


def first_passages(
    result: Result, runs: list[int], rule: Rule, thresholds: NDArray[np.float64] | None = None
) -> Passages:
    """Find the first passages of the evidence of ``runs`` through increasing thresholds; by default an even grid."""
    at = result.motion["run"].to_numpy()
    paths = []
    for run in runs:
        low, high = np.searchsorted(at, [run, run + 1])
        bits = result.observations["observation"][int(low) : int(high)].to_numpy()
        times = result.motion["time_s"][int(low) : int(high)].to_numpy()
        paths.append((evidence(bits, result, rule), times))
    if thresholds is None:
        furthest = max((float(np.abs(x).max(initial=0.0)) for x, _ in paths), default=0.0)
        thresholds = np.linspace(0.0, furthest, THRESHOLDS + 1)[1:]
    decision = np.full((len(paths), thresholds.size), -1, dtype=np.int8)
    time_s = np.full((len(paths), thresholds.size), np.inf)
    for r, (x, times) in enumerate(paths):
        up, down = (np.searchsorted(np.maximum.accumulate(side), thresholds - 1e-9) for side in (x, -x))
        first = np.minimum(up, down)
        passed = first < x.size
        decision[r, passed] = up[passed] < down[passed]
        time_s[r, passed] = times[first[passed]]
    return Passages(thresholds, decision, time_s)


def evidence(bits: NDArray[np.uint8], result: Result, rule: Rule) -> NDArray[np.float64]:
    """Compute X after each bit, shape as ``bits``; positive values are evidence for 1."""
    decision, boundary = result.scenario.decision, readings_boundary(result.scenario)
    ones, n = np.cumsum(bits, dtype=np.int64), np.arange(1, bits.size + 1)
    if rule == "count":
        return np.asarray(ones - boundary * n)  # S - x n
    alpha, beta = decision.prior_alpha + ones, decision.prior_beta + n - ones
    # Both tails are computed, so that a belief near 1 keeps its precision.
    below = betainc(alpha, beta, boundary)
    above = betainc(beta, alpha, 1.0 - boundary)
    smallest = np.finfo(np.float64).tiny
    # ln[(1 - p) / p]
    return np.asarray(np.log(np.maximum(above, smallest)) - np.log(np.maximum(below, smallest)))


def _tune(
    passages: Passages,
    truth: NDArray[np.int8],
    tuning: NDArray[np.bool_],
    aim: float,
    undecided_counts: float,
) -> tuple[int, float]:
    """Return the index of the smallest threshold whose error on the tuning half is at most ``aim``, and that error.

    If there is none, it is the threshold with the smallest error.
    """
    decision = passages.decision[tuning]
    wrong = ((decision != -1) & (decision != truth[tuning][:, None])).mean(axis=0)
    error = wrong + undecided_counts * (decision == -1).mean(axis=0)
    enough = np.flatnonzero(error <= aim + 1e-12)
    index = int(enough[0]) if enough.size else int(np.argmin(error))
    return index, float(error[index])
