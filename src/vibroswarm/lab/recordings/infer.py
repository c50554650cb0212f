"""Infer the settings with which robots ran from their logs.

| name | symbol | inferred from |
|---|---|---|
| rms_threshold | theta_E | energies E of samples whose bit is certain (logged, or alpha or beta did not grow) |
| gate, min_observations | O_c | counts at first decisions, and at samples with a belief beyond p_c and no decision |
| credible_threshold | p_c | beliefs at decisions, and at samples past the gate without a decision |
| strategy | u | bits received, compared with those that the others would have sent under each strategy |
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
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Floats
from vibroswarm.lab.recordings.log import Log
from vibroswarm.strategies import soft
from vibroswarm.strategies.bayes import GATES

TICKS_S: Final = 0.04
"""Two ticks of the simulator: undisturbed samples are tau + stop + two ticks apart."""
USUAL_S: Final = 0.3
"""Intervals without avoidance are the usual one if they differ by no more from the most frequent duration, s."""
FAR: Final = 0.25
"""Bounds of theta_E that are apart by a larger share of the upper one are far apart: it is their middle."""
CONTRADICT: Final = 0.02
"""Share of samples that may contradict a threshold."""
CREDIBLE: Final = 0.95
"""p_c of the study; the gate is inferred from robots that are surer than this."""
STRATEGIES: Final = ("none", "positive", "soft")
"""Strategies of the study's robots."""
STOP_S: Final = 1.0
"""Duration of a stop of the study's robots, s."""
FLOOR_SHARE: Final = 0.01
"""Mean probabilities of received bits are clipped to at least this distance from 0 and 1."""
LAG_S: Final = 0.25
"""A row may be written this long after its sample."""
CLEAR_LEAD: Final = 9.2
"""Difference of log likelihoods from which a strategy is inferred: a likelihood ratio of 10^4. A smaller ratio is not
enough, since the bits of an interval are dependent."""
MOST_SURPRISE: Final = 3.0
"""Standard errors by which bits received may be farther from what a strategy says that was sent than chance allows."""


class Inferred(NamedTuple):
    """One inferred setting."""

    name: str
    """Field of the scenario."""
    value: Any = None
    """None: undetermined."""
    low: float | None = None
    high: float | None = None
    """Bounds of the value; None: there are none."""
    number: int = 0
    """Number of samples, decisions, intervals or bits that it is inferred from."""


def infer_settings(
    logs: Sequence[Log],
    *,
    prior: tuple[int, int] = (1, 1),
    eta: float = 1500.0,
    kappa: float = 2.0,
    stop_s: float = STOP_S,
) -> list[Inferred]:
    """Infer all settings of the module's table; a setting that cannot be determined has the value None.

    Args:
        prior: alpha and beta before the first observation. eta, kappa: parameters of soft feedback with which that
            strategy is tried. stop_s: duration of a stop for tau, if times spent standing are not logged, s.
    """
    between = intervals_of(logs, prior)
    threshold, gate = infer_threshold(between), infer_gate(logs)
    strategy = Inferred("strategy.name")
    if threshold.value is not None:
        strategy = infer_strategy(logs, between, float(threshold.value), eta, kappa)
    return [threshold, *gate, infer_credible(logs, *gate), infer_tau(between, stop_s), strategy]


def intervals_of(logs: Sequence[Log], prior: tuple[int, int]) -> pl.DataFrame:
    """Return all samples, with the changes since the previous sample of the same robot.

    A change is null if its column is not logged. At a robot's first row it is null too, except that at sample 0 alpha
    and beta grow from the prior, the messages received from 0, and the messages sent from -1.

    Returns:
        One row per sample, ordered by session, robot and time: session, the index of the log; robot; time_s; energy;
        bit, as logged; new_alpha and new_beta, their growth; new_received, the messages received; whole, whether no row
        is missing between this sample and the previous one, as far as the count of messages sent tells; spacing_s,
        avoid_s and stop_s, the time passed, spent avoiding and spent standing.
    """

    def step(name: str, first: float | None = None) -> pl.Expr:
        """The change since the robot's previous sample; at sample 0 since ``first``."""
        value = pl.col(name).cast(pl.Float64)
        return value - pl.coalesce(value.shift(1).over("robot"), pl.when(pl.col("sent") == 0).then(first))

    return pl.concat(
        log.samples.sort("robot", "time_s").select(
            pl.lit(session, dtype=pl.Int64).alias("session"), "robot", "time_s", "energy", bit="observation",
            new_alpha=step("alpha", first=prior[0]),
            new_beta=step("beta", first=prior[1]),
            new_received=step("messages_received", first=0.0),
            whole=(step("sent", first=-1.0) == 1).fill_null(False) | pl.col("sent").is_null(),
            spacing_s=step("time_s"),
            avoid_s=step("avoid_total_s"),
            stop_s=step("stop_total_s"),
        )
        for session, log in enumerate(logs)
    )  # fmt: skip


def infer_threshold(between: pl.DataFrame) -> Inferred:
    """Infer theta_E, which lies between the largest energy that was read as 0 and the smallest that was read as 1.

    It may equal the former, but not the latter, as a bit is 1 if E > theta_E. Only samples whose bit is certain count:
    those with a logged bit, or if no bit is logged, those at which alpha or beta did not grow. If no threshold agrees
    with all of these samples, the result is the one that the fewest contradict, if these are few (``CONTRADICT``).
    """
    name, known = "sensor.rms_threshold", between.drop_nulls("energy")
    read_zero, read_one = pl.col("bit") == 0, pl.col("bit") == 1
    if known["bit"].null_count() == known.height:
        read_zero, read_one = (pl.col("whole") & (pl.col(grown) == 0) for grown in ("new_alpha", "new_beta"))
    zeros, ones = (known.filter(read)["energy"].sort().to_numpy() for read in (read_zero, read_one))
    if zeros.size == 0 or ones.size == 0:
        return Inferred(name, number=zeros.size + ones.size)
    low, high = float(zeros[-1]), float(ones[0])
    if low >= high:
        # Contradictory samples, counted for a threshold at each energy: zeros above it, and ones up to it.
        edges = np.unique(np.concatenate([zeros, ones]))
        above = zeros.size - np.searchsorted(zeros, edges, side="right")
        errors = above + np.searchsorted(ones, edges, side="right")
        best = int(np.argmin(errors))
        if errors[best] > CONTRADICT * (zeros.size + ones.size):
            return Inferred(name, number=zeros.size + ones.size)
        low, high = float(edges[best]), float(edges[min(best + 1, edges.size - 1)])
    value = _beside(low, high, at_low=zeros.size >= ones.size)
    return Inferred(name, value, low, high, zeros.size + ones.size)


def _beside(low: float, high: float, at_low: bool) -> float:
    """Return the number with two decimals in [low, high) nearest to the bound of more samples; or the middle."""
    near = math.ceil(low * 100 - 1e-9) / 100 if at_low else (math.ceil(high * 100 - 1e-9) - 1) / 100
    is_near = high - low <= FAR * high and low - 1e-12 <= near < high
    return near if is_near else (low + high) / 2


def _roundest(low: float, high: float) -> float:
    """Return the number in [low, high) with the fewest decimals; the middle if it would have more than six."""
    # The 1e-9 and 1e-12 keep rounding errors from excluding ``low`` itself.
    for digits in range(7):
        scale = 10.0**digits
        first = math.ceil(low * scale - 1e-9) / scale
        if low - 1e-12 <= first < high:
            return first
    return (low + high) / 2


def infer_gate(logs: Sequence[Log]) -> tuple[Inferred, Inferred]:
    """Infer which observations the gate counts (``decision.gate``), and O_c (``decision.min_observations``).

    A robot decides only if it has counted more than O_c observations before its current sample. So with the right kind
    of gate, all counts of robots that are sure but undecided are smaller than all counts at first decisions. Both
    settings are undetermined unless exactly one kind of gate has this property, and held at least one sure robot back.
    """
    names = ("decision.gate", "decision.min_observations")
    bounds: dict[str, tuple[float, float]] = {}
    decisions = 0
    for gate in GATES:
        low, high, decisions = -math.inf, math.inf, 0
        for own, decision, belief in _deciding_robots(logs):
            counted = _counts(own, gate)
            # Logged beliefs may be cut to three digits.
            is_sure = np.maximum(belief, 1.0 - belief) > CREDIBLE + 1e-3
            low = max(low, float(counted[(decision == -1) & is_sure].max(initial=-math.inf)))
            decided = np.flatnonzero(decision != -1)
            if decided.size:
                high, decisions = min(high, float(counted[decided[0]])), decisions + 1
        bounds[gate] = (low, high)
    possible = [gate for gate, (low, high) in bounds.items() if low < high]
    if not decisions or len(possible) != 1 or math.isinf(bounds[possible[0]][0]):
        return Inferred(names[0], number=decisions), Inferred(names[1], number=decisions)
    low, high = bounds[possible[0]]
    # O_c is at least the largest count without a decision, and below the smallest count at a first decision.
    counts = Inferred(names[1], int(low), low, high - 1, decisions)
    return Inferred(names[0], possible[0], number=decisions), counts


def _deciding_robots(logs: Sequence[Log]) -> Iterator[tuple[pl.DataFrame, Floats, Floats]]:
    """Yield (samples, decisions, beliefs) of each robot of each log, in the order of time.

    A robot is left out if the number of messages sent, the decision or the belief is missing in one of its samples.
    """
    for log in logs:
        for own in log.samples.partition_by("robot", maintain_order=True):
            if not own.select("sent", "decision", "belief_below").null_count().sum_horizontal()[0]:
                yield own, own["decision"].to_numpy(), own["belief_below"].to_numpy()


def _counts(own: pl.DataFrame, gate: str) -> Floats:
    """Return how many observations a gate has counted before each sample of a robot."""
    sent, received = (own[name].cast(pl.Float64).to_numpy() for name in ("sent", "messages_received"))
    by_gate: dict[str, Floats] = {"own": sent, "received": received, "total": sent + received}
    return by_gate[gate]


def infer_credible(logs: Sequence[Log], gate: Inferred, least: Inferred) -> Inferred:
    """Infer p_c from the beliefs of robots without a decision, and at first decisions.

    Here a belief is that of the likelier answer, max(p, 1 - p). p_c lies between the largest belief of a robot that was
    past the gate but did not decide, and the smallest belief at a first decision. The setting has bounds but no value
    if the gate is not known, no undecided robot was past it, or the bounds contradict each other.

    Args:
        gate, least: the two settings from ``infer_gate``.
    """
    low, high, decisions = 0.5, 1.0, 0
    for own, decision, belief in _deciding_robots(logs):
        confidence = np.maximum(belief, 1.0 - belief)
        decided = np.flatnonzero(decision != -1)
        if decided.size:
            high, decisions = min(high, float(confidence[decided[0]])), decisions + 1
        if gate.value is not None and least.high is not None:
            # O_c is at most ``high``: with a larger count a robot is past the gate for certain.
            past_gate = (decision == -1) & (_counts(own, gate.value) > least.high)
            low = max(low, float(confidence[past_gate].max(initial=0.5)))
    # The 1e-9 makes ``high`` itself a possible value: a logged belief may be cut to three digits and so equal p_c.
    value = _roundest(low, high + 1e-9) if decisions and 0.5 < low <= high else None
    if not decisions:
        return Inferred("decision.credible_threshold")
    return Inferred("decision.credible_threshold", value, low, high, decisions)


def infer_tau(between: pl.DataFrame, stop_s: float = STOP_S) -> Inferred:
    """Infer tau from the time between samples without avoidance, or between all samples if avoidance is not logged.

    It is undetermined with fewer than 20 such intervals, or if only one of them is near the most frequent duration.
    The usual interval is tau, a stop (``stop_s`` if times spent standing are not logged) and up to two ticks.
    """
    name = "sample.sample_interval_ms"
    calm = between.filter(pl.col("whole"), pl.col("spacing_s").is_not_null())
    if between["avoid_s"].null_count() < between.height:
        calm = calm.filter(pl.col("avoid_s") == 0)
    spacing = calm["spacing_s"].to_numpy()
    usual = _usual_of(spacing) if spacing.size >= 20 else spacing[:0]
    if usual.size < 2:  # one interval has no standard deviation
        return Inferred(name, number=usual.size)
    stops_s = calm["stop_s"].drop_nulls().to_numpy()
    tau_s = float(usual.mean()) - (float(np.median(stops_s)) if stops_s.size else stop_s) - TICKS_S
    if tau_s <= 0.0:  # intervals do not hold a stop
        return Inferred(name, number=usual.size)
    error_s = float(usual.std(ddof=1)) / math.sqrt(usual.size) + 0.01  # times are logged to 0.01 s
    # Two standard errors on each side. A robot whose control loop is faster than the simulator's takes less than two
    # ticks of 20 ms in addition, so its tau may be up to TICKS_S longer.
    low, high = tau_s - 2 * error_s, tau_s + TICKS_S + 2 * error_s
    return Inferred(name, round(1000 * _roundest(low, high), 3), 1000 * low, 1000 * high, usual.size)


def _usual_of(spacing_s: Floats) -> Floats:
    """Return the durations near the most frequent one of some intervals without avoidance, s.

    An interval is longer if the robot first had to finish a turn.
    """
    # Find the window of width USUAL_S (two neighbouring bins of a histogram) with the most intervals.
    edges = np.arange(0.0, spacing_s.max() + USUAL_S, USUAL_S / 2)
    in_windows = np.convolve(np.histogram(spacing_s, edges)[0], [1, 1], "valid")
    middle_s = edges[int(np.argmax(in_windows))] + USUAL_S / 2
    # The edges are those of bins, which may cut the usual intervals anywhere. A log with rows every 0.2 s has intervals
    # on both sides of the true one, of which only the mean is right: so take them around the window's median.
    middle_s = float(np.median(spacing_s[np.abs(spacing_s - middle_s) <= USUAL_S / 2]))
    return spacing_s[np.abs(spacing_s - middle_s) <= USUAL_S]


def infer_strategy(
    logs: Sequence[Log], between: pl.DataFrame, threshold: float, eta: float, kappa: float
) -> Inferred:
    """Infer the strategy under which the bits received have the largest likelihood.

    Between two samples of a robot the number of ones among the bits received is known. It is taken as binomial, with
    the mean probability of a 1 of the messages that others sent in that time. A log is left out if its posterior,
    decision, belief or count of messages received is missing in any sample. The strategy is undetermined if no bit is
    left, if the second strategy has almost the same likelihood (``CLEAR_LEAD``), or if the bits received are not those
    that others sent under the first one either (``MOST_SURPRISE``), such as where clocks differ.

    The surprise of a strategy is the sum of (k - n q)^2 / (n q (1 - q)) over intervals with k ones of n bits, q their
    share under the strategy, less its expected value, 1 an interval, in standard errors: its variance is
    2 + (1 - 6 q (1 - q)) / (n q (1 - q)) an interval.

    Args:
        between: ``intervals_of`` the logs. threshold: theta_E, by which bits are read. eta, kappa: parameters of soft
            feedback.
    """
    from scipy.stats import binom

    intervals = [
        one
        for session, log in enumerate(logs)
        for one in _received(log, between.filter(session=session), threshold, eta, kappa)
    ]
    ones, received, *shares = np.array(intervals, dtype=np.float64).reshape(-1, 2 + len(STRATEGIES)).T
    likelihood, surprise = np.zeros(len(STRATEGIES)), np.zeros(len(STRATEGIES))
    for k, share in enumerate(shares):
        q = np.clip(share, FLOOR_SHARE, 1 - FLOOR_SHARE)
        spread = received * q * (1 - q)
        variance = 2 + (1 - 6 * q * (1 - q)) / spread
        likelihood[k] = np.sum(binom.logpmf(ones, received, q))
        surprise[k] = float(np.sum((ones - received * q) ** 2 / spread - 1)) / math.sqrt(
            max(variance.sum(), 1e-9)
        )
    second, first = np.argsort(likelihood)[-2:].tolist()
    is_clear = likelihood[first] - likelihood[second] > CLEAR_LEAD and surprise[first] <= MOST_SURPRISE
    return Inferred("strategy.name", STRATEGIES[first] if is_clear else None, number=int(received.sum()))


def _received(
    log: Log, between: pl.DataFrame, threshold: float, eta: float, kappa: float
) -> Iterator[tuple[float, ...]]:
    """Yield for each interval of a log: ones received, bits received, and the mean probability of a 1 by strategy."""
    needed = ("alpha", "beta", "messages_received", "decision", "belief_below", "energy")
    if log.samples.select(needed).null_count().sum_horizontal()[0]:
        return
    times, sender = log.samples["time_s"].to_numpy(), log.samples["robot"].to_numpy()
    chance = _messages(log, threshold, eta, kappa)
    own = between.filter(pl.col("whole") & (pl.col("new_received") > 0) & pl.col("spacing_s").is_not_null())
    columns = ("robot", "time_s", "spacing_s", "new_received", "new_alpha", "energy")
    for robot, time_s, spacing_s, received, grown, energy in own.select(columns).iter_rows():
        # Robots read messages only while they walk; a message that is sent while a robot stands is read after the
        # stop. So the messages of the interval were sent from the start of the robot's previous stop to the start
        # of this one. Times of rows may be up to LAG_S late: the robot's own, so that the previous stop may have
        # begun earlier, and those of the senders, so that their rows may follow the start of this stop.
        stop_began_s = time_s - STOP_S
        sent_s = [stop_began_s - spacing_s - LAG_S, stop_began_s + LAG_S]
        first, last = np.searchsorted(times, sent_s)
        others = np.flatnonzero(sender[first:last] != robot) + first
        ones = int(grown - (energy > threshold))  # alpha grew by the own bit and the ones received
        if others.size and 0 <= ones <= received:
            yield ones, received, *chance[:, others].mean(axis=1).tolist()


def _messages(log: Log, threshold: float, eta: float, kappa: float) -> Floats:
    """Return the probability that the message of each sample of a session was a 1, (strategies, samples)."""
    frame = log.samples.with_columns(
        bit=pl.coalesce("observation", (pl.col("energy") > threshold).cast(pl.Int64)).cast(pl.Float64)
    )
    columns = ("bit", "decision", "alpha", "beta", "belief_below")
    return np.array(
        [
            (
                bit,
                bit if decision < 0 else decision,
                soft.probability(int(bit), alpha, beta, belief, eta, kappa),
            )
            for bit, decision, alpha, beta, belief in frame.select(columns).iter_rows()
        ],
        dtype=np.float64,
    ).T
