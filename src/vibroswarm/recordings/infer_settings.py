"""Infer the settings of robots from their log, with the evidence.

| name | symbol | inferred from |
|---|---|---|
| rms_threshold | theta_E | samples whose bit is certain: alpha or beta did not grow, or the bit is logged |
| gate, min_observations | O_c | counts at first decisions, and at samples with a belief beyond p_c and no decision |
| credible_threshold | p_c | beliefs at decisions, and at undecided samples past the gate |
| strategy | u | bits received or sent, compared with what each strategy would have sent |
| sample_interval_ms | tau | time between undisturbed samples, minus the stop and two ticks |

Between two samples of a robot alpha grows by its own bit and the ones received, beta by the rest. So where alpha did
not grow the own bit was 0, where beta did not grow it was 1, and E of these samples encloses theta_E. Received
bits are
not logged individually: their sum is compared with the share of ones that others would have sent in that time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.recordings.log import Log
from vibroswarm.strategies import soft
from vibroswarm.strategies.bayes import GATES

STRATEGIES: Final = ("none", "positive", "soft")
"""Strategies of the study's robots."""

TICKS_S: Final = 0.04
"""Undisturbed samples are tau, the stop and two ticks apart."""
STOP_S: Final = 1.0
FLOOR_SHARE: Final = 0.01
"""Probabilities of a bit are clipped to this distance from 0 and 1."""
LAG_S: Final = 0.25
"""Rows are written up to this late."""
UNDISTURBED_S: Final = 0.3


@dataclass(frozen=True)
class Inferred:
    """One setting: its value (None: undetermined), its bounds, and the evidence."""

    name: str
    value: Any
    low: float | None
    high: float | None
    evidence: str


def _undetermined(name: str, evidence: str) -> Inferred:
    return Inferred(name, None, None, None, evidence)


@dataclass(frozen=True)
class Intervals:
    """Samples of all sessions by robot, with changes since the robot's previous sample; (samples,) each."""

    session: NDArray[np.int64]
    robot: NDArray[np.int64]
    time_s: NDArray[np.float64]
    energy: NDArray[np.float64]
    new_alpha: NDArray[np.float64]
    new_beta: NDArray[np.float64]
    new_received: NDArray[np.float64]
    whole: NDArray[np.bool_]
    """No row is missing in between."""
    spacing_s: NDArray[np.float64]
    avoid_s: NDArray[np.float64]
    stop_s: NDArray[np.float64]


def infer_settings(
    logs: Sequence[Log], *, prior: tuple[int, int] = (1, 1), eta: float = 1500.0, kappa: float = 2.0
) -> list[Inferred]:
    """Infer all settings; one that cannot be determined has the value None and says why.

    Args:
        logs: sessions, each from ``log.in_order``. prior: alpha and beta before the first observation.
        eta, kappa: parameters with which soft feedback is tried.
    """
    between = _intervals(logs, prior)
    threshold = infer_threshold(logs, between)
    credible = 0.95
    gate = infer_gate(logs, credible)
    settings = [threshold, *gate, infer_credible(logs, gate), infer_tau(between)]
    if threshold.value is not None:
        settings.append(infer_strategy(logs, between, float(threshold.value), eta, kappa))
    else:
        settings.append(_undetermined("strategy.name", "the bits read are unknown"))
    return settings


def _intervals(logs: Sequence[Log], prior: tuple[int, int]) -> Intervals:
    """Return the samples of all logs with the changes since each robot's previous sample; NaN where not logged.

    A robot's first sample (number 0) has changes too: from the prior, and from counters of 0.
    """
    parts = []
    for session, log in enumerate(logs):
        ordered = log.samples.sort("robot", "time_s")

        def step(name: str, first: float | None) -> pl.Expr:
            before = pl.col(name).cast(pl.Float64).shift(1).over("robot")
            start = pl.when(pl.col("sent") == 0).then(first)
            return pl.col(name).cast(pl.Float64) - pl.coalesce(before, start)

        parts.append(
            ordered.select(
                pl.lit(session, dtype=pl.Int64).alias("session"),
                "robot",
                "time_s",
                "energy",
                step("alpha", prior[0]).alias("new_alpha"),
                step("beta", prior[1]).alias("new_beta"),
                step("messages_received", 0.0).alias("new_received"),
                # Without a count of messages, lost rows cannot be detected.
                ((step("sent", -1.0) == 1).fill_null(False) | pl.col("sent").is_null()).alias("whole"),
                step("time_s", None).alias("spacing_s"),
                step("avoid_total_s", None).alias("avoid_s"),
                step("stop_total_s", None).alias("stop_s"),
            )
        )
    frame = pl.concat(parts)
    return Intervals(**{name: frame[name].to_numpy() for name in frame.columns})


def infer_threshold(logs: Sequence[Log], between: Intervals) -> Inferred:
    """Infer theta_E: at least the largest energy read as 0, less than the smallest read as 1.

    If no threshold agrees with all samples, the one that the fewest contradict is taken; it is undetermined if more
    than 2 % do, or if no sample was read as 0, or none as 1, for certain.
    """
    name = "sensor.rms_threshold"
    bits = _logged_bits(logs)
    if not np.isnan(bits).all():
        read_zero, read_one = bits == 0, bits == 1
        source = "whose bit is logged"
    elif np.isnan(between.new_alpha).all():
        return _undetermined(name, "neither bits nor posteriors are logged")
    else:
        read_zero = between.whole & (between.new_alpha == 0)
        read_one = between.whole & (between.new_beta == 0)
        source = "whose bit follows from alpha or beta not growing"
    zeros, ones = np.sort(between.energy[read_zero]), np.sort(between.energy[read_one])
    if zeros.size == 0 or ones.size == 0:
        return _undetermined(name, f"{zeros.size} samples read as 0 for certain, {ones.size} as 1: too few")
    low, high = float(zeros[-1]), float(ones[0])
    words = f"{zeros.size} samples {source} to be 0 and {ones.size} to be 1: "
    if low < high:
        value = _beside(low, high, zeros.size >= ones.size)
        return Inferred(name, value, low, high, f"{words}all zeros up to {low:g}, all ones from {high:g} on")
    # Contradictory samples: take the threshold with the fewest of them.
    edges = np.unique(np.concatenate([zeros, ones]))
    errors = (
        zeros.size - np.searchsorted(zeros, edges, side="right") + np.searchsorted(ones, edges, side="right")
    )
    best = int(np.argmin(errors))
    share = errors[best] / (zeros.size + ones.size)
    words += f"at the best threshold {int(errors[best])} of them contradict it"
    if share > 0.02:
        return _undetermined(name, words + "; robots or sessions may have run with different ones")
    upper = float(edges[min(best + 1, edges.size - 1)])
    lower = float(edges[best])
    return Inferred(name, _beside(lower, upper, zeros.size >= ones.size), lower, upper, words)


def _logged_bits(logs: Sequence[Log]) -> NDArray[np.float64]:
    """Return logged bits in the order of ``Intervals``; nan if not logged."""
    bits = [log.samples.sort("robot", "time_s")["observation"].cast(pl.Float64).to_numpy() for log in logs]
    return np.concatenate(bits)


def _beside(low: float, high: float, at_low: bool) -> float:
    """Return the number with two decimals in [low, high) nearest to one bound; if there is none, the middle.

    Args:
        at_low: whether that bound is ``low``; it should be the one that more samples determine.
    """
    rounded = math.ceil(low * 100 - 1e-9) / 100 if at_low else (math.ceil(high * 100 - 1e-9) - 1) / 100
    return rounded if low - 1e-12 <= rounded < high else (low + high) / 2


def _roundest(low: float, high: float) -> float:
    """Return the number with the fewest decimals in [low, high); the middle if none has six or fewer."""
    for digits in range(7):
        scale = 10.0**digits
        first = math.ceil(low * scale - 1e-9) / scale
        if low - 1e-12 <= first < high:
            return first
    return (low + high) / 2


def infer_gate(logs: Sequence[Log], credible: float) -> list[Inferred]:
    """Infer which observations O_c counts (``decision.gate``), and O_c (``decision.min_observations``).

    To decide, a robot must have counted more than O_c before its current sample. So under the right gate, counts of
    robots that are sure but undecided are all smaller than counts at first decisions. Both settings are undetermined
    unless exactly one gate has this property and held a sure robot back.
    """
    names = ("decision.gate", "decision.min_observations")
    bounds: dict[str, tuple[float, float, int]] = {}
    for gate in GATES:
        low, high, decisions = -math.inf, math.inf, 0
        for own, decision, belief in _deciding_robots(logs):
            count = _counts(own, gate)
            undecided = (decision == -1) & ((belief > credible + 1e-3) | (belief < 1 - credible - 1e-3))
            low = max(low, float(count[undecided].max(initial=-math.inf)))
            decided = np.flatnonzero(decision != -1)
            if decided.size:
                high, decisions = min(high, float(count[decided[0]])), decisions + 1
        bounds[gate] = (low, high, decisions)
    decisions = bounds["own"][2]
    if decisions == 0:
        return [_undetermined(name, "no robot decided, or decisions are not logged") for name in names]
    possible = [gate for gate, (low, high, _) in bounds.items() if low < high]
    counts = "; ".join(
        f"{gate}: {_held(low)} while undecided and sure, at least {high:g} at a first decision"
        for gate, (low, high, _) in bounds.items()
    )
    if len(possible) != 1 or math.isinf(bounds[possible[0]][0]):
        options = ", ".join(possible) or "none"
        if len(possible) == 1:
            options += " only, and it never held a robot back"
        words = f"{decisions} first decisions; possible: {options} ({counts})"
        return [_undetermined(name, words) for name in names]
    gate = possible[0]
    low, high, _ = bounds[gate]
    words = f"{decisions} first decisions; only '{gate}' fits ({counts})"
    return [
        Inferred(names[0], gate, None, None, words),
        Inferred(names[1], int(low), low, high - 1, words + f"; {low + 1:g} if the current sample counts"),
    ]


def _deciding_robots(
    logs: Sequence[Log],
) -> Iterator[tuple[pl.DataFrame, NDArray[np.float64], NDArray[np.float64]]]:
    """Yield samples, decisions and beliefs of each robot whose log has them all, in the order of time."""
    for log in logs:
        for own in log.samples.sort("time_s").partition_by("robot", maintain_order=True):
            if not own.select("sent", "decision", "belief_below").null_count().sum_horizontal()[0]:
                yield own, own["decision"].to_numpy(), own["belief_below"].to_numpy()


def _counts(own: pl.DataFrame, gate: str) -> NDArray[np.float64]:
    """Return the observations that count under a gate, at each sample."""
    sent, received = (
        own["sent"].to_numpy().astype(float),
        own["messages_received"].cast(pl.Float64).to_numpy(),
    )
    return sent if gate == "own" else (received if gate == "received" else sent + received)


def infer_credible(logs: Sequence[Log], gate: list[Inferred]) -> Inferred:
    """Infer p_c: from the largest belief of an undecided robot past the gate to the smallest at a first decision.

    A belief counts for the likelier side, max(p, 1 - p). There is no value, only bounds, if no undecided robot was
    past a known gate, or if the bounds contradict each other.
    """
    name = "decision.credible_threshold"
    low, high, decisions = 0.5, 1.0, 0
    for own, decision, belief in _deciding_robots(logs):
        sure = np.maximum(belief, 1.0 - belief)
        decided = np.flatnonzero(decision != -1)
        if decided.size:
            high, decisions = min(high, float(sure[decided[0]])), decisions + 1
        if gate[0].value is not None and gate[1].high is not None:
            open_to_test = (decision == -1) & (_counts(own, gate[0].value) > gate[1].high)
            low = max(low, float(sure[open_to_test].max(initial=0.5)))
    if decisions == 0:
        return _undetermined(name, "no robot decided, or beliefs are not logged")
    value = _roundest(low, high + 1e-9) if low > 0.5 and low <= high else None
    return Inferred(
        name, value, low, high,
        f"least belief at one of {decisions} first decisions {high:g}; largest of a robot past the gate that did not "
        f"decide {low:g} (logged beliefs may be cut to three digits)",
    )  # fmt: skip


def infer_tau(between: Intervals) -> Inferred:
    """Infer tau from the time between samples without avoidance; undetermined with fewer than 20 such intervals."""
    name = "sample.sample_interval_ms"
    calm = between.whole & ~np.isnan(between.spacing_s)
    which = "(avoidance is not logged)"
    if not np.isnan(between.avoid_s).all():
        calm &= between.avoid_s == 0
        which = "without avoidance"
    spacing = between.spacing_s[calm]
    if spacing.size < 20:
        return _undetermined(name, f"{spacing.size} undisturbed intervals: too few")
    # Turns at leg ends lengthen some intervals; the others agree.
    edges = np.arange(0.0, spacing.max() + UNDISTURBED_S, UNDISTURBED_S / 2)
    busiest = edges[int(np.argmax(np.convolve(np.histogram(spacing, edges)[0], [1, 1], "valid")))]
    alike = spacing[np.abs(spacing - busiest - UNDISTURBED_S / 2) <= UNDISTURBED_S]
    stop = between.stop_s[calm]
    stop_s = STOP_S if np.isnan(stop).all() else float(np.nanmedian(stop))
    tau_s = float(alike.mean()) - stop_s - TICKS_S
    error_s = float(alike.std(ddof=1)) / math.sqrt(alike.size) + 0.01
    # A robot whose loop is faster than the simulator's loses less than two ticks of 20 ms.
    low, high = tau_s - 2 * error_s, tau_s + TICKS_S + 2 * error_s
    return Inferred(
        name, round(1000 * _roundest(low, high), 3), 1000 * low, 1000 * high,
        f"{alike.size} of {spacing.size} intervals {which} are {alike.mean():.3f} s; less a stop of "
        f"{stop_s:.3f} s and at most two ticks of 20 ms",
    )  # fmt: skip


def infer_strategy(
    logs: Sequence[Log], between: Intervals, threshold: float, eta: float, kappa: float
) -> Inferred:
    """Infer the strategy: the one that makes the bits sent, or if these are not logged those received, most likely.

    Undetermined if neither are logged, or if the second likeliest strategy is too close.
    """
    name = "strategy.name"
    sent = _from_sent(logs, threshold, eta, kappa)
    likelihood, used, words = sent or _from_received(logs, between, threshold, eta, kappa)
    if used == 0:
        return _undetermined(name, "neither bits sent, nor posteriors and decisions, are logged")
    order = sorted(STRATEGIES, key=lambda strategy: -likelihood[strategy])
    lead = likelihood[order[0]] - likelihood[order[1]]
    evidence = f"{used} {words}; log likelihood " + ", ".join(
        f"{strategy} {likelihood[strategy]:.1f}" for strategy in STRATEGIES
    )
    # Likelihood ratio of 10^4: bits of one interval are dependent, so a smaller ratio is not enough.
    value = order[0] if lead > 9.2 else None
    if value is None:
        evidence += ": too close to each other"
    return Inferred(name, value, None, None, evidence)


def _messages(log: Log, threshold: float, eta: float, kappa: float) -> dict[str, NDArray[np.float64]]:
    """Return the probability that each sample of a session sent a one, by strategy; samples are ordered by time.

    NaN under soft feedback where the posterior is not logged.
    """
    frame = log.samples.sort("time_s")
    bit = (frame["energy"].to_numpy() > threshold).astype(float)
    logged = frame["observation"].cast(pl.Float64).to_numpy()
    bit = np.where(np.isnan(logged), bit, logged)
    chances = {"none": bit}
    decision = frame["decision"].cast(pl.Float64).to_numpy()
    chances["positive"] = np.where(decision >= 0, decision, bit)
    columns = (*(frame[name].to_list() for name in ("alpha", "beta", "belief_below")), bit.tolist())
    chances["soft"] = np.array(
        [
            np.nan if a is None or b is None or p is None else soft.probability(int(o), a, b, p, eta, kappa)
            for a, b, p, o in zip(*columns, strict=True)
        ]
    )
    return chances


def _from_sent(
    logs: Sequence[Log], threshold: float, eta: float, kappa: float
) -> tuple[dict[str, float], int, str] | None:
    """Return the log likelihood of each strategy, the number of bits sent, and their name; None if a log lacks them."""
    if any(log.samples["message"].null_count() for log in logs):
        return None
    total, used = dict.fromkeys(STRATEGIES, 0.0), 0
    for log in logs:
        bit = log.samples.sort("time_s")["message"].to_numpy()
        for strategy, share in _messages(log, threshold, eta, kappa).items():
            likely = np.clip(share, FLOOR_SHARE / 10, 1 - FLOOR_SHARE / 10)
            total[strategy] += float(np.log(np.where(bit == 1, likely, 1 - likely)).sum())
        used += bit.size
    return total, used, "bits sent"


def _from_received(
    logs: Sequence[Log], between: Intervals, threshold: float, eta: float, kappa: float
) -> tuple[dict[str, float], int, str]:
    """Return the log likelihood of each strategy, the number of bits received that were used, and their name.

    A log that lacks a column for this is left out, so the number may be 0.
    """
    total, used = dict.fromkeys(STRATEGIES, 0.0), 0
    own_bit = (between.energy > threshold).astype(float)
    for session, log in enumerate(logs):
        if (
            log.samples.select("alpha", "beta", "messages_received", "decision", "belief_below")
            .null_count()
            .sum_horizontal()[0]
        ):
            continue
        ordered = log.samples.sort("time_s")
        times, sender = ordered["time_s"].to_numpy(), ordered["robot"].to_numpy()
        chance = _messages(log, threshold, eta, kappa)
        rows = np.flatnonzero(
            (between.session == session)
            & between.whole
            & (between.new_received > 0)
            & ~np.isnan(between.spacing_s)
        )
        intervals: list[tuple[float, ...]] = []
        for k in rows:
            end = between.time_s[k] - STOP_S
            first, last = np.searchsorted(times, [end - between.spacing_s[k] - LAG_S, end + LAG_S])
            others = np.flatnonzero(sender[first:last] != between.robot[k]) + first
            n = int(between.new_received[k])
            ones = int(between.new_alpha[k] - own_bit[k])
            if others.size == 0 or not 0 <= ones <= n:
                continue
            used += n
            intervals.append((ones, n, *(float(chance[strategy][others].mean()) for strategy in STRATEGIES)))
        if not intervals:
            continue
        of_ones, of_all, *shares = np.array(intervals).T
        for strategy, share in zip(STRATEGIES, shares, strict=True):
            likely = np.clip(share, FLOOR_SHARE, 1 - FLOOR_SHARE)
            total[strategy] += math.fsum(_log_binomial(of_ones, of_all, likely))
    return total, used, "bits received"


def _log_binomial(
    ones: NDArray[np.float64], n: NDArray[np.float64], share: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the log probability of ``ones`` among ``n``, each with probability ``share`` in (0, 1)."""
    from scipy.special import gammaln

    ways = gammaln(n + 1) - gammaln(ones + 1) - gammaln(n - ones + 1)
    return np.asarray(ways + ones * np.log(share) + (n - ones) * np.log1p(-share))


def _held(most: float) -> str:
    return "never" if math.isinf(most) else f"at most {most:g}"
