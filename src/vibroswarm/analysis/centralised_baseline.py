"""Compute pooled counting, a centralised baseline: one decision per run from the bits of all robots, without delay.

A bit is the 0 or 1 that one sample reads.

| name | symbol | equation |
|---|---|---|
| number of bits so far, number of ones | n, S | of all robots of the run, in order of time |
| evidence by count | X | S - x n, x the share of ones that robots test against (``observation.decision_boundary``) |
| evidence by belief | X | ln[(1 - p) / p], p = I_x(a0 + S, b0 + n - S) with the scenario's prior Beta(a0, b0) |
| threshold | h | decide 1 once X >= h, 0 once X <= -h; undecided if never |
| weight of undecided | u | ``undecided_counts``, 0 to 1: how much being undecided counts as an error |
| error | - | share wrong + u (share undecided), of runs for the baseline, of robots for the strategy |

h is tuned on one half of the runs: it is the smallest threshold at which the baseline's error is at most the
strategy's error, or the threshold with the smallest error if no threshold reaches that. The baseline and the strategy
are then compared on the other half of the runs, run by run. With u above 0, a strategy that leaves many robots
undecided may have an error near 1/2. The baseline reaches such an error by guessing, with h almost 0; then u = 0 is
more informative.

The baseline is a reference, not a bound: another rule on the same bits may do better. It shows how much longer, at
equal error, a swarm takes to decide.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import betainc

from vibroswarm.analysis.figures import BY_NAME, run_figures
from vibroswarm.analysis.intervals import ForJson, Interval, check_level, share_interval, wilson
from vibroswarm.analysis.paired import difference
from vibroswarm.errors import InputError, check_choice, number_of
from vibroswarm.observation.decision_boundary import readings_boundary
from vibroswarm.result import Result

Rule = Literal["count", "belief"]
RULES: Final = ("count", "belief")
"""The two kinds of evidence: by count, and by belief."""
THRESHOLDS: Final = 400
"""Number of thresholds tried, evenly spaced up to the largest evidence in any of the runs."""


@dataclass(frozen=True)
class PooledCounting(ForJson):
    """Pooled counting ("the reference") and the strategy, compared on the half of the runs that did not tune h.

    Times are in s; figures of the strategy have names that start with ``strategy_``.
    """

    rule: Rule
    threshold: float
    """h."""
    undecided_counts: float
    """u: how much being undecided counts as an error, 0 to 1."""
    runs_tuned: int
    """Number of runs that h was tuned on."""
    runs_judged: int
    """Number of runs of the comparison."""
    tuned_error: float
    """Error of the reference on the runs that h was tuned on."""
    strategy_tuned_error: float
    """Error of the strategy on the same runs, the target of the tuning."""
    time_s: Interval
    """Time of the reference's decision; the end of the run where it is undecided."""
    wrong: Interval
    """Share of runs in which the reference decides wrong."""
    undecided: Interval
    """Share of runs in which the reference does not decide."""
    error: Interval
    """Error of the reference: ``wrong`` + u ``undecided``."""
    strategy_time_s: Interval
    """Decision time of the strategy, the mean over robots; the end of the run for an undecided robot."""
    strategy_wrong: Interval
    """Share of robots that decide wrong."""
    strategy_undecided: Interval
    """Share of robots that do not decide."""
    strategy_error: Interval
    """Error of the strategy: ``strategy_wrong`` + u ``strategy_undecided``."""
    time_difference_s: Interval
    """Strategy - reference, paired by run; above 0 if the swarm is slower."""
    error_difference: Interval
    """Strategy - reference, paired by run; close to 0 if the tuning generalised."""


def pooled_counting(
    result: Result,
    rule: Rule = "count",
    undecided_counts: float = 0.0,
    level: float = 0.95,
    seed: int = 0,
) -> PooledCounting:
    """Tune pooled counting to the strategy's error, and compare the two.

    Args:
        result: runs to t_end with the strategy's decisions. Runs without a truth (fill ratio on the boundary) are left
            out.
        rule: evidence that the threshold h applies to: "count" or "belief". undecided_counts: u, how much being
            undecided counts as an error, 0 to 1. level: confidence level. seed: of the intervals of differences.
    Raises:
        InputError: a level that is not between 0 and 1, an unknown rule, u outside [0, 1], fewer than 4 runs with a
            truth, or a run, with or without a truth, that stopped early.
    """
    check_level(level)
    check_choice(rule, "rule", RULES)
    undecided_counts = number_of(undecided_counts, "undecided_counts", 0.0, 1.0)
    t_end_s = result.scenario.run.t_end_s
    table = run_figures(result.robots, result.runs, t_end_s).filter(pl.col("truth").is_not_null())
    if table.height < 4:
        raise InputError(
            "at least 4 runs with a truth are needed: half to tune, half to test", field="result"
        )
    if result.runs["stopped_early"].any():
        raise InputError(
            "runs that stopped early lack the samples after they stopped; run to t_end", field="result"
        )
    passages = first_passages(result, table["run"].to_list(), rule)
    tuning = np.arange(table.height) % 2 == 0  # every other run tunes h, the rest are judged
    judged = ~tuning
    wrong, undecided = table["wrong_share"].to_numpy(), table["undecided_share"].to_numpy()
    target = float((wrong + undecided_counts * undecided)[tuning].mean())
    truth = table["truth"].to_numpy()
    index, tuned = _tune(passages, truth, tuning, target, undecided_counts)
    # Decisions and times of pooled counting with the tuned threshold, in the runs that are judged.
    decision, time_s = passages.decision[judged, index], passages.time_s[judged, index]
    pooled_wrong = ((decision != -1) & (decision != truth[judged])).astype(np.float64)
    pooled_undecided = (decision == -1).astype(np.float64)
    time_s = np.where(decision == -1, t_end_s, time_s)  # an undecided run counts with t_end, as a robot does
    strategy_time_s = table["decision_time_s"].to_numpy()[judged]
    strategy_error = (wrong + undecided_counts * undecided)[judged]
    error = pooled_wrong + undecided_counts * pooled_undecided
    n = int(judged.sum())
    return PooledCounting(
        rule=rule,
        threshold=float(passages.thresholds[index]),
        undecided_counts=undecided_counts,
        runs_tuned=int(tuning.sum()),
        runs_judged=n,
        tuned_error=tuned,
        strategy_tuned_error=target,
        time_s=BY_NAME["decision_time_s"].mean(time_s, level, t_end_s),
        wrong=wilson(int(pooled_wrong.sum()), n, level),
        undecided=wilson(int(pooled_undecided.sum()), n, level),
        error=share_interval(error, level),
        strategy_time_s=BY_NAME["decision_time_s"].mean(strategy_time_s, level, t_end_s),
        strategy_wrong=share_interval(wrong[judged], level),
        strategy_undecided=share_interval(undecided[judged], level),
        strategy_error=share_interval(strategy_error, level),
        time_difference_s=difference(strategy_time_s, time_s, level, seed, most=t_end_s).interval,
        error_difference=difference(strategy_error, error, level, seed, most=1.0).interval,
    )


@dataclass(frozen=True)
class Passages:
    """When, and on which side, the evidence of each run first passes each threshold."""

    thresholds: NDArray[np.float64]
    """Increasing, shape (thresholds,)."""
    decision: NDArray[np.int8]
    """1 if the evidence reaches the threshold first, 0 if it reaches minus the threshold first, -1 if it never reaches
    either; shape (runs, thresholds)."""
    time_s: NDArray[np.float64]
    """Time of the first passage, s, infinite if there is none; shape (runs, thresholds)."""


def first_passages(
    result: Result, runs: list[int], rule: Rule, thresholds: NDArray[np.float64] | None = None
) -> Passages:
    """Find when the evidence of each run first passes each threshold h, upwards (X >= h) or downwards (X <= -h).

    Args:
        result: its samples are sorted by run and time. runs: numbers of the runs to use.
        rule: evidence to compute, "count" or "belief". thresholds: values of h, increasing; by default ``THRESHOLDS``
            evenly spaced values up to the largest absolute evidence of these runs.
    Returns: passages whose arrays have one row per run, in the order of ``runs``. A run without samples passes no
        threshold.
    """
    run_of_sample = result.motion["run"].to_numpy()
    paths = []
    for run in runs:
        low, high = np.searchsorted(run_of_sample, [run, run + 1])
        bits = result.observations["observation"][int(low) : int(high)].to_numpy()
        times = result.motion["time_s"][int(low) : int(high)].to_numpy()
        paths.append((evidence(bits, result, rule), times))
    if thresholds is None:
        furthest = max((float(np.abs(x).max(initial=0.0)) for x, _ in paths), default=0.0)
        # Without h = 0, which any evidence passes at the first sample.
        thresholds = np.linspace(0.0, furthest, THRESHOLDS + 1)[1:]
    decision = np.full((len(paths), thresholds.size), -1, dtype=np.int8)
    time_s = np.full((len(paths), thresholds.size), np.inf)
    for r, (x, times) in enumerate(paths):
        # ``up``: for each h the index of the first sample with X >= h, found in the running maximum of X, which is
        # sorted; ``down``: likewise with -X. The index is the number of samples if X never passes h on that side. The
        # 1e-9 allows for rounding.
        up, down = (np.searchsorted(np.maximum.accumulate(side), thresholds - 1e-9) for side in (x, -x))
        first = np.minimum(up, down)
        passed = first < x.size
        decision[r, passed] = up[passed] < down[passed]  # 1 if X passes h upwards first, else 0
        time_s[r, passed] = times[first[passed]]
    return Passages(thresholds, decision, time_s)


def evidence(bits: NDArray[np.uint8], result: Result, rule: Rule) -> NDArray[np.float64]:
    """Compute the evidence X after each bit of one run; positive values are evidence for decision 1.

    Args:
        bits: readings of all robots of the run in order of time, (samples,). result: whose scenario has the prior and
            the boundary. rule: "count" or "belief".
    Returns: X, (samples,).
    """
    decision, boundary = result.scenario.decision, readings_boundary(result.scenario)
    ones, n = np.cumsum(bits, dtype=np.int64), np.arange(1, bits.size + 1)
    if rule == "count":
        return np.asarray(ones - boundary * n)  # S - x n
    alpha, beta = decision.prior_alpha + ones, decision.prior_beta + n - ones
    # Both tails are computed, so that a belief near 1 keeps its precision.
    below = betainc(alpha, beta, boundary)
    above = betainc(beta, alpha, 1.0 - boundary)
    smallest = np.finfo(np.float64).tiny  # in place of a tail that rounds to 0, whose logarithm is infinite
    # ln[(1 - p) / p]
    return np.asarray(np.log(np.maximum(above, smallest)) - np.log(np.maximum(below, smallest)))


def _tune(
    passages: Passages,
    truth: NDArray[np.int8],
    tuning: NDArray[np.bool_],
    aim: float,
    undecided_counts: float,
) -> tuple[int, float]:
    """Find the smallest threshold whose error is at most ``aim``, else the threshold with the smallest error.

    Args:
        truth: right decision of each run; tuning: whether the run tunes the threshold, (runs,) each.
        undecided_counts: u, how much an undecided run counts as an error.
    Returns: index of the threshold, and its error over the runs that tune it.
    """
    decision = passages.decision[tuning]
    wrong = ((decision != -1) & (decision != truth[tuning][:, None])).mean(axis=0)
    error = wrong + undecided_counts * (decision == -1).mean(axis=0)
    enough = np.flatnonzero(error <= aim + 1e-12)  # the tolerance allows for rounding of the means
    index = int(enough[0]) if enough.size else int(np.argmin(error))
    return index, float(error[index])
