"""Infer the settings with which robots ran from their logs, with the evidence for each.

| name | symbol | inferred from |
|---|---|---|
| rms_threshold | theta_E | energies E of samples whose bit is certain (logged, or alpha or beta did not grow) |
| gate, min_observations | O_c | counts at first decisions, and at samples with a belief beyond p_c and no decision |
| credible_threshold | p_c | beliefs at decisions, and at samples past the gate without a decision |
| strategy | u | bits received or sent, compared with those that each strategy would have sent |
| sample_interval_ms | tau | time between undisturbed samples, minus the stop and two ticks |

The gate is the condition that a robot must have counted more than O_c observations before it may decide.

Between two samples of a robot alpha grows by the number of ones among its own bit and the bits received, and beta by
the number of zeros. So the own bit was 0 if alpha did not grow, and 1 if beta did not grow. The energies of these two
kinds of samples lie below and above theta_E. Received bits are not logged one by one: their sum is compared with the
share of ones that the other robots would have sent in that time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Floats
from vibroswarm.core.numbers import count, number, rounded, stated
from vibroswarm.recordings.infer_strategy import infer_strategy
from vibroswarm.recordings.inferred import STOP_S, Inferred, undetermined
from vibroswarm.recordings.log import Log
from vibroswarm.strategies.bayes import GATES

TICKS_S: Final = 0.04
"""Two ticks of the simulator: undisturbed samples are tau + stop + two ticks apart."""
USUAL_S: Final = 0.3
"""Intervals without avoidance are the usual one if they differ by no more from the most frequent duration, s."""


FAR: Final = 0.25
"""Bounds of theta_E that are apart by a larger share of the upper one are far apart."""


NEEDED: Final = "decisions, beliefs or numbers of messages sent"
"""What shows when robots decide (``_deciding_robots``)."""


def infer_settings(
    logs: Sequence[Log],
    *,
    prior: tuple[int, int] = (1, 1),
    eta: float = 1500.0,
    kappa: float = 2.0,
    stop_s: float = STOP_S,
) -> list[Inferred]:
    """Infer all settings of the module's table; a setting that cannot be determined has the value None and says why.

    Args:
        logs: sessions, each from ``log.in_order``. prior: alpha and beta before the first observation.
        eta, kappa: parameters of soft feedback with which that strategy is tried.
        stop_s: duration of a stop for tau, if times spent standing are not logged, s.
    """
    between = intervals_of(logs, prior)
    threshold = infer_threshold(between)
    credible = 0.95  # p_c of the study; the gate is inferred from robots that are surer than this
    gate = infer_gate(logs, credible)
    settings = [threshold, *gate, infer_credible(logs, gate), infer_tau(between, stop_s)]
    if threshold.value is not None:
        settings.append(infer_strategy(logs, between, float(threshold.value), eta, kappa))
    else:
        settings.append(undetermined("strategy.name", "the bits read are unknown"))
    return settings


def intervals_of(logs: Sequence[Log], prior: tuple[int, int]) -> pl.DataFrame:
    """Return all samples, with the changes since the previous sample of the same robot.

    A change is null if its column is not logged. At a robot's first row it is null too, except that at sample 0 alpha
    and beta grow from the prior, the messages received from 0, and the messages sent from -1.

    Args:
        prior: alpha and beta before the first observation.
    Returns:
        One row per sample, ordered by session, robot and time: session, the index of the log; robot; time_s; energy;
        bit, as logged; new_alpha and new_beta, their growth; new_received, the messages received; whole, whether no row
        is missing between this sample and the previous one (before sample 0: none), which is true for all samples of a
        log without the count of messages sent, since lost rows cannot be detected there; spacing_s, avoid_s and stop_s,
        the time passed, spent avoiding and spent standing.
    """
    parts = []
    for session, log in enumerate(logs):
        ordered = log.samples.sort("robot", "time_s")

        def step(name: str, first: float | None) -> pl.Expr:
            """Return the change of a column since the robot's previous sample.

            At sample 0 the change is that from ``first``, and null if ``first`` is None.
            """
            before = pl.col(name).cast(pl.Float64).shift(1).over("robot")
            start = pl.when(pl.col("sent") == 0).then(first)
            return pl.col(name).cast(pl.Float64) - pl.coalesce(before, start)

        parts.append(
            ordered.select(
                pl.lit(session, dtype=pl.Int64).alias("session"),
                "robot",
                "time_s",
                "energy",
                pl.col("observation").alias("bit"),
                step("alpha", first=prior[0]).alias("new_alpha"),
                step("beta", first=prior[1]).alias("new_beta"),
                step("messages_received", first=0.0).alias("new_received"),
                # No row is missing if the count of messages sent grew by 1, from -1 at sample 0. Without a count, lost
                # rows cannot be detected, and no row counts as missing.
                ((step("sent", first=-1.0) == 1).fill_null(False) | pl.col("sent").is_null()).alias("whole"),
                step("time_s", first=None).alias("spacing_s"),
                step("avoid_total_s", first=None).alias("avoid_s"),
                step("stop_total_s", first=None).alias("stop_s"),
            )
        )
    return pl.concat(parts)


def infer_threshold(between: pl.DataFrame) -> Inferred:
    """Infer theta_E, which lies between the largest energy that was read as 0 and the smallest that was read as 1.

    It may equal the former, but not the latter, as a bit is 1 if E > theta_E. Only samples whose bit is certain count:
    those with a logged bit, or if no bit is logged, those at which alpha or beta did not grow. If no threshold agrees
    with all of these samples, the result is the threshold that the fewest of them contradict. The setting is
    undetermined if more than 2 % of them contradict that threshold, if all of them have the same bit, or if neither
    bits nor posteriors are logged.
    """
    name = "sensor.rms_threshold"
    if between["bit"].null_count() < between.height:
        read_zero, read_one = pl.col("bit") == 0, pl.col("bit") == 1
        source = "as logged"
    elif between["new_alpha"].null_count() == between.height:
        return undetermined(name, "neither bits nor posteriors are logged")
    else:
        read_zero, read_one = (pl.col("whole") & (pl.col(grown) == 0) for grown in ("new_alpha", "new_beta"))
        source = "as alpha or beta did not grow"
    zeros, ones = (between.filter(read)["energy"].sort().to_numpy() for read in (read_zero, read_one))
    if zeros.size == 0 or ones.size == 0:
        return undetermined(
            name, f"{count(zeros.size, 'sample')} read as 0 for certain, {ones.size} as 1: too few"
        )
    low, high = float(zeros[-1]), float(ones[0])
    words = f"{count(zeros.size, 'sample')} read as 0 and {ones.size} as 1 ({source}): "
    if low < high:
        value = _beside(low, high, at_low=zeros.size >= ones.size)
        return Inferred(
            name, value, low, high, f"{words}all zeros up to {stated(low)}, all ones from {stated(high)} on"
        )
    # Contradictory samples, counted for a threshold at each energy: zeros above it, and ones up to it.
    edges = np.unique(np.concatenate([zeros, ones]))
    errors = (
        zeros.size - np.searchsorted(zeros, edges, side="right") + np.searchsorted(ones, edges, side="right")
    )
    best = int(np.argmin(errors))
    share = errors[best] / (zeros.size + ones.size)
    words += f"at the best threshold {int(errors[best])} of them contradict it"
    if share > 0.02:
        return undetermined(name, words + "; robots or sessions may have run with different ones")
    # Every threshold up to the next energy has the same errors.
    lower, upper = float(edges[best]), float(edges[min(best + 1, edges.size - 1)])
    value = _beside(lower, upper, at_low=zeros.size >= ones.size)
    return Inferred(name, value, lower, upper, words)


def _beside(low: float, high: float, at_low: bool) -> float:
    """Choose a threshold in [low, high): the number with two decimals that is nearest to one of the two bounds.

    If no number with two decimals lies in [low, high), return the middle of the bounds, with nine digits; likewise,
    with three digits, if they are apart by more than ``FAR`` of the upper one: then neither is near the true threshold.

    Args:
        at_low: whether that bound is ``low``; if not, it is ``high``. Callers choose the bound that more samples
            determine, because the true threshold is likely to be nearer to it.
    """
    if high - low > FAR * high:
        return rounded((low + high) / 2, 3)
    # The 1e-9 keeps rounding errors from moving a number with two decimals to the next one.
    near = math.ceil(low * 100 - 1e-9) / 100 if at_low else (math.ceil(high * 100 - 1e-9) - 1) / 100
    return near if low - 1e-12 <= near < high else rounded((low + high) / 2, 9)


def _roundest(low: float, high: float) -> float:
    """Return the number in [low, high) with the fewest decimals; the middle if it would have more than six."""
    # The 1e-9 and 1e-12 keep rounding errors from excluding ``low`` itself.
    for digits in range(7):
        scale = 10.0**digits
        first = math.ceil(low * scale - 1e-9) / scale
        if low - 1e-12 <= first < high:
            return first
    return (low + high) / 2


def infer_gate(logs: Sequence[Log], credible: float) -> list[Inferred]:
    """Infer which observations the gate counts (``decision.gate``), and O_c (``decision.min_observations``).

    A robot decides only if it has counted more than O_c observations before its current sample. So with the right kind
    of gate, all counts of robots that are sure but undecided are smaller than all counts at first decisions. Both
    settings are undetermined unless exactly one kind of gate has this property, and held at least one sure robot back.

    Args:
        credible: belief from which a robot counts as sure.
    Returns: the two settings.
    """
    names = ("decision.gate", "decision.min_observations")
    # By kind of gate: largest count of a sure but undecided robot, smallest count at a first decision, and number of
    # first decisions.
    bounds: dict[str, tuple[float, float, int]] = {}
    for gate in GATES:
        low, high, decisions = -math.inf, math.inf, 0
        for own, decision, belief in _deciding_robots(logs):
            counted = _counts(own, gate)
            # Logged beliefs may be cut to three digits.
            is_sure = (belief > credible + 1e-3) | (belief < 1 - credible - 1e-3)
            low = max(low, float(counted[(decision == -1) & is_sure].max(initial=-math.inf)))
            decided = np.flatnonzero(decision != -1)
            if decided.size:
                high, decisions = min(high, float(counted[decided[0]])), decisions + 1
        bounds[gate] = (low, high, decisions)
    decisions = bounds["own"][2]  # the same for every kind
    if decisions == 0:
        return [undetermined(name, f"no robot decided, or {NEEDED} are not logged") for name in names]
    first = count(decisions, "first decision")
    possible = [gate for gate, (low, high, _) in bounds.items() if low < high]
    counts = "; ".join(
        f"{gate}: {_held(low)} while undecided and sure, at least {stated(high)} at a first decision"
        for gate, (low, high, _) in bounds.items()
    )
    # The largest count is minus infinity if no robot was sure but undecided: then the gate held no robot back.
    if len(possible) != 1 or math.isinf(bounds[possible[0]][0]):
        options = ", ".join(possible) or "none"
        if len(possible) == 1:
            options += " only, and it never held a robot back"
        words = f"{first}; possible: {options} ({counts})"
        return [undetermined(name, words) for name in names]
    gate = possible[0]
    low, high, _ = bounds[gate]
    words = f"{first}; only '{gate}' fits ({counts})"
    # The current sample may count only where own readings do (``decision.gate_counts_current``).
    if_current = "" if gate == "received" else f"; {stated(low + 1)} if the current sample counts"
    # O_c is at least the largest count without a decision, and below the smallest count at a first decision.
    return [
        Inferred(names[0], gate, low=None, high=None, evidence=words),
        Inferred(names[1], int(low), low, high - 1, words + if_current),
    ]


def _deciding_robots(
    logs: Sequence[Log],
) -> Iterator[tuple[pl.DataFrame, Floats, Floats]]:
    """Yield (samples, decisions, beliefs) of each robot of each log, in the order of time.

    Decisions are -1, 0 or 1. A belief is the probability that the fill ratio is below the boundary. Both are arrays
    (samples,). A robot that never decides is yielded too. A robot is left out if the number of messages sent, the
    decision or the belief is missing in one of its samples.
    """
    for log in logs:
        for own in log.samples.sort("time_s").partition_by("robot", maintain_order=True):
            if not own.select("sent", "decision", "belief_below").null_count().sum_horizontal()[0]:
                yield own, own["decision"].to_numpy(), own["belief_below"].to_numpy()


def _counts(own: pl.DataFrame, gate: str) -> Floats:
    """Return how many observations a gate has counted before each sample of a robot.

    Args:
        own: samples of the robot. gate: "own", "received" or "total".
    """
    sent, received = (
        own["sent"].to_numpy().astype(float),
        own["messages_received"].cast(pl.Float64).to_numpy(),
    )
    return sent if gate == "own" else (received if gate == "received" else sent + received)


def infer_credible(logs: Sequence[Log], gate: list[Inferred]) -> Inferred:
    """Infer p_c from the beliefs of robots without a decision, and at first decisions.

    Here a belief is that of the likelier answer, max(p, 1 - p). p_c lies between the largest belief of a robot that was
    past the gate but did not decide, and the smallest belief at a first decision. The setting has bounds but no value
    in three cases: the gate is not known, no undecided robot was past it, or the bounds contradict each other. Without
    any decision it is undetermined.

    Args:
        gate: the two settings from ``infer_gate``.
    """
    name = "decision.credible_threshold"
    low, high, decisions = 0.5, 1.0, 0
    gate_kind, min_observations = gate
    for own, decision, belief in _deciding_robots(logs):
        confidence = np.maximum(belief, 1.0 - belief)
        decided = np.flatnonzero(decision != -1)
        if decided.size:
            high, decisions = min(high, float(confidence[decided[0]])), decisions + 1
        if gate_kind.value is not None and min_observations.high is not None:
            # O_c is at most ``high``: with a larger count a robot is past the gate for certain.
            past_gate = (decision == -1) & (_counts(own, gate_kind.value) > min_observations.high)
            low = max(low, float(confidence[past_gate].max(initial=0.5)))
    if decisions == 0:
        return undetermined(name, f"no robot decided, or {NEEDED} are not logged")
    # low is 0.5 if no undecided robot was past the gate. The 1e-9 makes ``high`` itself a possible value: a robot
    # decides only if its belief is larger than p_c, but a logged belief may be cut to three digits and so equal p_c.
    value = _roundest(low, high + 1e-9) if low > 0.5 and low <= high else None
    return Inferred(
        name, value, low, high,
        f"least belief at {count(decisions, 'first decision')} {stated(high)}; largest of a robot past the gate that "
        f"did not "
        f"decide {stated(low)} (logged beliefs may be cut to three digits)",
    )  # fmt: skip


def infer_tau(between: pl.DataFrame, stop_s: float = STOP_S) -> Inferred:
    """Infer tau from the time between samples without avoidance, or between all samples if avoidance is not logged.

    It is undetermined with fewer than 20 such intervals, or if only one of them is near the most frequent duration.
    The usual interval is tau, a stop (``stop_s`` if times spent standing are not logged) and up to two ticks.
    """
    name = "sample.sample_interval_ms"
    calm = between.filter(pl.col("whole"), pl.col("spacing_s").is_not_null())
    which = "(avoidance is not logged)"
    if between["avoid_s"].null_count() < between.height:
        calm = calm.filter(pl.col("avoid_s") == 0)
        which = "without avoidance"
    spacing = calm["spacing_s"].to_numpy()
    if spacing.size < 20:
        return undetermined(name, f"{count(spacing.size, 'undisturbed interval')}: too few")
    usual = _usual_of(spacing)
    if usual.size < 2:  # one interval has no standard deviation
        return undetermined(name, f"{spacing.size} undisturbed intervals: too different from each other")
    stops_s = calm["stop_s"].drop_nulls().to_numpy()
    stop_s = float(np.median(stops_s)) if stops_s.size else stop_s
    tau_s = float(usual.mean()) - stop_s - TICKS_S
    if tau_s <= 0.0:
        return undetermined(
            name, f"intervals of {number(usual.mean(), 3)} s do not hold a stop of {number(stop_s, 3)} s"
        )
    error_s = float(usual.std(ddof=1)) / math.sqrt(usual.size) + 0.01  # times are logged to 0.01 s
    # Two standard errors on each side. A robot whose control loop is faster than the simulator's takes less than two
    # ticks of 20 ms in addition, so its tau may be up to TICKS_S longer.
    low, high = tau_s - 2 * error_s, tau_s + TICKS_S + 2 * error_s
    return Inferred(
        name, round(1000 * _roundest(low, high), 3), 1000 * low, 1000 * high,
        f"{usual.size} of {spacing.size} intervals {which} are {number(usual.mean(), 3)} s; less a stop of "
        f"{number(stop_s, 3)} s and at most two ticks of 20 ms",
    )  # fmt: skip


def _usual_of(spacing_s: Floats) -> Floats:
    """Return the durations near the most frequent one of some intervals without avoidance, s.

    An interval is longer if the robot first had to finish a turn.

    Args:
        spacing_s: at least one duration, s.
    """
    # Find the window of width USUAL_S (two neighbouring bins of a histogram) with the most intervals.
    edges = np.arange(0.0, spacing_s.max() + USUAL_S, USUAL_S / 2)
    in_windows = np.convolve(np.histogram(spacing_s, edges)[0], [1, 1], "valid")
    middle_s = edges[int(np.argmax(in_windows))] + USUAL_S / 2
    # The edges are those of bins, which may cut the usual intervals anywhere. A log with rows every 0.2 s has intervals
    # on both sides of the true one, of which only the mean is right: so take them around the window's median.
    middle_s = float(np.median(spacing_s[np.abs(spacing_s - middle_s) <= USUAL_S / 2]))
    return spacing_s[np.abs(spacing_s - middle_s) <= USUAL_S]


def _held(most: float) -> str:
    """Write the largest count of a robot that was sure but undecided, in words; -inf: there was no such robot."""
    return "never" if math.isinf(most) else f"at most {stated(most)}"
