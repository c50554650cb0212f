"""What robots ran with, from what they logged: threshold, gate, credible threshold, strategy, tau; with the evidence.

| name | symbol | from |
|---|---|---|
| rms_threshold | theta_E | samples whose bit is certain: alpha or beta did not grow, or the bit is logged |
| gate, min_observations | O_c | counts at first decisions, and at samples with a belief beyond p_c and no decision |
| credible_threshold | p_c | beliefs at decisions, and at undecided samples past the gate |
| strategy | u | the bits received, or sent, against what each strategy would have sent |
| sample_interval_ms | tau | time between undisturbed samples, less the stop and two ticks |

Between two of a robot's samples alpha grows by the own bit and the ones received, beta by the rest. So where alpha did
not grow the own bit was 0, where beta did not grow it was 1, and E of these samples encloses theta_E. Received bits are
not logged one by one: what arrived is set against the share of ones among what others would have sent in that time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.lab.log import Log
from vibroswarm.strategies import soft
from vibroswarm.strategies.bayes import GATES

TOLD_APART: Final = ("none", "positive", "soft")
"""The strategies of the study's robots."""

TICKS_S: Final = 0.04
"""Undisturbed samples are tau, two ticks and the stop apart."""
STOP_S: Final = 1.0
FLOOR_SHARE: Final = 0.01
"""No bit is quite certain: a share of ones of 0 or 1 counts as so much from it."""
LAG_S: Final = 0.25
"""Rows are written up to this late."""
UNDISTURBED_S: Final = 0.3


@dataclass(frozen=True)
class Inferred:
    """One setting: its value (None: the log cannot tell), the bounds within which it lies, and why."""

    name: str
    value: Any
    low: float | None
    high: float | None
    evidence: str

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return dict(self.__dict__)


@dataclass(frozen=True)
class Intervals:
    """Rows of all sessions, robot by robot, and what came since the robot's row before; (rows,) each."""

    session: NDArray[np.int64]
    robot: NDArray[np.int64]
    time_s: NDArray[np.float64]
    energy: NDArray[np.float64]
    new_alpha: NDArray[np.float64]
    new_beta: NDArray[np.float64]
    new_received: NDArray[np.float64]
    whole: NDArray[np.bool_]
    """No row is lost between."""
    spacing_s: NDArray[np.float64]
    avoid_s: NDArray[np.float64]
    stop_s: NDArray[np.float64]


def infer_settings(
    logs: Sequence[Log], *, prior: tuple[int, int] = (1, 1), eta: float = 1500.0, kappa: float = 2.0
) -> list[Inferred]:
    """All that can be told; a setting that cannot has the value None and says why.

    Args:
        logs: in order. prior: of the posterior. eta, kappa: that soft feedback is tried with.
    """
    between = _intervals(logs, prior)
    threshold = infer_threshold(logs, between)
    credible = 0.95
    gate = infer_gate(logs, credible)
    found = [threshold, *gate, infer_credible(logs, gate), infer_tau(between)]
    if threshold.value is not None:
        found.append(infer_strategy(logs, between, float(threshold.value), eta, kappa))
    else:
        found.append(Inferred("strategy.name", None, None, None, "the bits read are not known"))
    return found


def _intervals(logs: Sequence[Log], prior: tuple[int, int]) -> Intervals:
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
                step("received", 0.0).alias("new_received"),
                # Where messages are not counted, lost rows do not show.
                ((step("sent", -1.0) == 1).fill_null(False) | pl.col("sent").is_null()).alias("whole"),
                step("time_s", None).alias("spacing_s"),
                step("avoid_total_s", None).alias("avoid_s"),
                step("stop_total_s", None).alias("stop_s"),
            )
        )
    frame = pl.concat(parts)
    return Intervals(**{name: frame[name].to_numpy() for name in frame.columns})


def infer_threshold(logs: Sequence[Log], between: Intervals) -> Inferred:
    """theta_E: at least the largest energy that read as 0, less than the smallest that read as 1."""
    name = "sensor.rms_threshold"
    bits = _logged_bits(logs)
    if not np.isnan(bits).all():
        zero, one = bits == 0, bits == 1
        how = "whose bit is logged"
    elif np.isnan(between.new_alpha).all():
        return Inferred(name, None, None, None, "neither bits nor posteriors are logged")
    else:
        zero = between.whole & (between.new_alpha == 0)
        one = between.whole & (between.new_beta == 0)
        how = "whose bit follows from alpha or beta not growing"
    zeros, ones = np.sort(between.energy[zero]), np.sort(between.energy[one])
    if zeros.size == 0 or ones.size == 0:
        return Inferred(
            name, None, None, None, f"{zeros.size} samples read as 0 for certain, {ones.size} as 1: too few"
        )
    low, high = float(zeros[-1]), float(ones[0])
    words = f"{zeros.size} samples {how} to be 0 and {ones.size} to be 1: "
    if low < high:
        value = _beside(low, high, zeros.size >= ones.size)
        return Inferred(name, value, low, high, f"{words}all zeros up to {low:g}, all ones from {high:g} on")
    # Some contradict: the threshold with the fewest of them.
    edges = np.unique(np.concatenate([zeros, ones]))
    errors = (
        zeros.size - np.searchsorted(zeros, edges, side="right") + np.searchsorted(ones, edges, side="right")
    )
    best = int(np.argmin(errors))
    share = errors[best] / (zeros.size + ones.size)
    words += f"at the best threshold {int(errors[best])} of them contradict it"
    if share > 0.02:
        return Inferred(
            name, None, None, None, words + "; robots or sessions may have run with different ones"
        )
    upper = float(edges[min(best + 1, edges.size - 1)])
    lower = float(edges[best])
    return Inferred(name, _beside(lower, upper, zeros.size >= ones.size), lower, upper, words)


def _logged_bits(logs: Sequence[Log]) -> NDArray[np.float64]:
    """The bits read, in the order of ``Intervals``; nan where a log does not tell."""
    bits = [log.samples.sort("robot", "time_s")["observation"].cast(pl.Float64).to_numpy() for log in logs]
    return np.concatenate(bits)


def _beside(low: float, high: float, at_low: bool) -> float:
    """A number of two digits in [low, high), next to the bound that more samples hold; the middle where none is."""
    found = math.ceil(low * 100 - 1e-9) / 100 if at_low else (math.ceil(high * 100 - 1e-9) - 1) / 100
    return found if low - 1e-12 <= found < high else (low + high) / 2


def _roundest(low: float, high: float) -> float:
    """The number with the fewest digits in [low, high)."""
    for digits in range(7):
        scale = 10.0**digits
        first = math.ceil(low * scale - 1e-9) / scale
        if low - 1e-12 <= first < high:
            return first
    return (low + high) / 2


def infer_gate(logs: Sequence[Log], credible: float) -> list[Inferred]:
    """What O_c counts, and O_c (strictly more are needed, the current sample not counted)."""
    names = ("decision.gate", "decision.min_observations")
    bounds: dict[str, tuple[float, float, int]] = {}
    for gate in GATES:
        low, high, decisions = -math.inf, math.inf, 0
        for log in logs:
            for _, own in log.samples.sort("time_s").group_by("robot", maintain_order=True):
                if own.select("sent", "decision", "belief").null_count().sum_horizontal()[0]:
                    continue
                count = _counts(own, gate)
                decision, belief = own["decision"].to_numpy(), own["belief"].to_numpy()
                undecided = (decision == -1) & ((belief > credible + 1e-3) | (belief < 1 - credible - 1e-3))
                low = max(low, float(count[undecided].max(initial=-math.inf)))
                decided = np.flatnonzero(decision != -1)
                if decided.size:
                    high, decisions = min(high, float(count[decided[0]])), decisions + 1
        bounds[gate] = (low, high, decisions)
    decisions = bounds["own"][2]
    if decisions == 0:
        return [
            Inferred(name, None, None, None, "no robot decided, or decisions are not logged")
            for name in names
        ]
    possible = [gate for gate, (low, high, _) in bounds.items() if low < high]
    said = "; ".join(
        f"{gate}: {_held(low)} while undecided and sure, at least {high:g} at a first decision"
        for gate, (low, high, _) in bounds.items()
    )
    if len(possible) != 1 or math.isinf(bounds[possible[0]][0]):
        found = ", ".join(possible) or "none"
        if len(possible) == 1:
            found += " only, and it never held a robot back"
        words = f"{decisions} first decisions; possible: {found} ({said})"
        return [Inferred(name, None, None, None, words) for name in names]
    gate = possible[0]
    low, high, _ = bounds[gate]
    words = f"{decisions} first decisions; only '{gate}' fits ({said})"
    return [
        Inferred(names[0], gate, None, None, words),
        Inferred(names[1], int(low), low, high - 1, words + f"; {low + 1:g} if the current sample counts"),
    ]


def _counts(own: pl.DataFrame, gate: str) -> NDArray[np.float64]:
    sent, received = own["sent"].to_numpy().astype(float), own["received"].cast(pl.Float64).to_numpy()
    return sent if gate == "own" else (received if gate == "received" else sent + received)


def infer_credible(logs: Sequence[Log], gate: list[Inferred]) -> Inferred:
    """p_c: at least the largest belief of an undecided robot past the gate, at most the least at a decision."""
    name = "decision.credible_threshold"
    low, high, decisions = 0.5, 1.0, 0
    for log in logs:
        for _, own in log.samples.sort("time_s").group_by("robot", maintain_order=True):
            if own.select("sent", "decision", "belief").null_count().sum_horizontal()[0]:
                continue
            decision, belief = own["decision"].to_numpy(), own["belief"].to_numpy()
            sure = np.maximum(belief, 1.0 - belief)
            decided = np.flatnonzero(decision != -1)
            if decided.size:
                high, decisions = min(high, float(sure[decided[0]])), decisions + 1
            if gate[0].value is not None and gate[1].high is not None:
                open_to_test = (decision == -1) & (_counts(own, gate[0].value) > gate[1].high)
                low = max(low, float(sure[open_to_test].max(initial=0.5)))
    if decisions == 0:
        return Inferred(name, None, None, None, "no robot decided, or beliefs are not logged")
    value = _roundest(low, high + 1e-9) if low > 0.5 and low <= high else None
    return Inferred(
        name, value, low, high,
        f"least belief at one of {decisions} first decisions {high:g}; largest of a robot past the gate that did not "
        f"decide {low:g} (logged beliefs may be cut to three digits)",
    )  # fmt: skip


def infer_tau(between: Intervals) -> Inferred:
    """tau, from the spacing of samples between which nothing was avoided."""
    name = "sample.sample_interval_ms"
    calm = between.whole & ~np.isnan(between.spacing_s)
    which = "(avoidance is not logged)"
    if not np.isnan(between.avoid_s).all():
        calm &= between.avoid_s == 0
        which = "without avoidance"
    spacing = between.spacing_s[calm]
    if spacing.size < 20:
        return Inferred(name, None, None, None, f"{spacing.size} undisturbed intervals: too few")
    # Leg-end turns lengthen some; the others are alike.
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
    """none, positive or soft: which of them makes the bits that were sent, or received, likeliest."""
    name = "strategy.name"
    sent = _from_sent(logs, threshold, eta, kappa)
    likelihood, used, words = (
        sent if sent is not None else _from_received(logs, between, threshold, eta, kappa)
    )
    if used == 0:
        return Inferred(name, None, None, None, "neither bits sent nor posteriors and decisions are logged")
    order = sorted(TOLD_APART, key=lambda one: -likelihood[one])
    lead = likelihood[order[0]] - likelihood[order[1]]
    said = f"{used} {words}; log likelihood " + ", ".join(
        f"{one} {likelihood[one]:.1f}" for one in TOLD_APART
    )
    # 10 to the 4 against 1: bits of one interval are not independent, so that no less will do.
    value = order[0] if lead > 9.2 else None
    if value is None:
        said += ": too near each other"
    return Inferred(name, value, None, None, said)


def _messages(log: Log, threshold: float, eta: float, kappa: float) -> dict[str, NDArray[np.float64]]:
    """Probability that each of a session's samples sent a one, by strategy; rows in the order of time."""
    frame = log.samples.sort("time_s")
    bit = (frame["energy"].to_numpy() > threshold).astype(float)
    logged = frame["observation"].cast(pl.Float64).to_numpy()
    bit = np.where(np.isnan(logged), bit, logged)
    found = {"none": bit}
    decision = frame["decision"].cast(pl.Float64).to_numpy()
    found["positive"] = np.where(decision >= 0, decision, bit)
    columns = (frame["alpha"].to_list(), frame["beta"].to_list(), frame["belief"].to_list(), bit.tolist())
    found["soft"] = np.array(
        [
            np.nan if a is None or b is None or p is None else soft.probability(int(o), a, b, p, eta, kappa)
            for a, b, p, o in zip(*columns, strict=True)
        ]
    )
    return found


def _from_sent(
    logs: Sequence[Log], threshold: float, eta: float, kappa: float
) -> tuple[dict[str, float], int, str] | None:
    if any(log.samples["message"].null_count() for log in logs):
        return None
    total, used = dict.fromkeys(TOLD_APART, 0.0), 0
    for log in logs:
        bit = log.samples.sort("time_s")["message"].to_numpy()
        for one, share in _messages(log, threshold, eta, kappa).items():
            likely = np.clip(share, FLOOR_SHARE / 10, 1 - FLOOR_SHARE / 10)
            total[one] += float(np.log(np.where(bit == 1, likely, 1 - likely)).sum())
        used += bit.size
    return total, used, "bits sent"


def _from_received(
    logs: Sequence[Log], between: Intervals, threshold: float, eta: float, kappa: float
) -> tuple[dict[str, float], int, str]:
    total, used = dict.fromkeys(TOLD_APART, 0.0), 0
    own_bit = (between.energy > threshold).astype(float)
    for session, log in enumerate(logs):
        if (
            log.samples.select("alpha", "beta", "received", "decision", "belief")
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
        found: list[tuple[float, ...]] = []
        for k in rows:
            end = between.time_s[k] - STOP_S
            first, last = np.searchsorted(times, [end - between.spacing_s[k] - LAG_S, end + LAG_S])
            others = np.flatnonzero(sender[first:last] != between.robot[k]) + first
            n = int(between.new_received[k])
            ones = int(between.new_alpha[k] - own_bit[k])
            if others.size == 0 or not 0 <= ones <= n:
                continue
            used += n
            found.append((ones, n, *(float(chance[one][others].mean()) for one in TOLD_APART)))
        if not found:
            continue
        of_ones, of_all, *shares = np.array(found).T
        for one, share in zip(TOLD_APART, shares, strict=True):
            likely = np.clip(share, FLOOR_SHARE, 1 - FLOOR_SHARE)
            total[one] += math.fsum(_log_binomial(of_ones, of_all, likely))
    return total, used, "bits received"


def _log_binomial(
    ones: NDArray[np.float64], n: NDArray[np.float64], share: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Logarithms of the probabilities of so many ones among n, each with probability ``share`` in (0, 1)."""
    from scipy.special import gammaln

    ways = gammaln(n + 1) - gammaln(ones + 1) - gammaln(n - ones + 1)
    return np.asarray(ways + ones * np.log(share) + (n - ones) * np.log1p(-share))


def _held(most: float) -> str:
    return "never" if math.isinf(most) else f"at most {most:g}"
