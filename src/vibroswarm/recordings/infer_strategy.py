"""Infer the strategy of recorded robots by the likelihood of the bits that they sent, or that they received."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Floats
from vibroswarm.core.numbers import number
from vibroswarm.recordings.inferred import STOP_S, Inferred, undetermined
from vibroswarm.recordings.log import Log
from vibroswarm.strategies import soft

STRATEGIES: Final = ("none", "positive", "soft")
"""Strategies of the study's robots."""


FLOOR_SHARE: Final = 0.01
"""Mean probabilities of received bits are clipped to at least this distance from 0 and 1."""


FLOOR_OF_SENT: Final = FLOOR_SHARE / 10
"""Probabilities of single sent bits are clipped to at least this distance from 0 and 1. So a single bit that
contradicts a strategy lowers its log likelihood by 6.9, and does not exclude it."""


LAG_S: Final = 0.25
"""A row may be written this long after its sample."""


CLEAR_LEAD: Final = 9.2
"""Difference of log likelihoods from which a strategy is inferred: a likelihood ratio of 10^4. A smaller ratio is not
enough, since the bits of an interval are dependent."""


MOST_SURPRISE: Final = 3.0
"""Standard errors by which bits received may be farther from what a strategy says that was sent than chance allows."""


def infer_strategy(
    logs: Sequence[Log], between: pl.DataFrame, threshold: float, eta: float, kappa: float
) -> Inferred:
    """Infer the strategy under which the logged bits have the largest likelihood.

    The bits are those sent, or if these are not logged, those received. A bit whose probability under soft feedback is
    unknown, since its posterior is not logged, is left out for all strategies. The strategy is undetermined if no bit
    is left, if the second strategy has almost the same likelihood (``CLEAR_LEAD``), or if the bits received are not
    those that others sent under the first one either (``MOST_SURPRISE``), such as where clocks differ.

    Args:
        between: ``infer_settings.intervals_of`` the logs.
        threshold: theta_E, for bits read that are not logged. eta, kappa: parameters of soft feedback.
    """
    name = "strategy.name"
    sent = _from_sent(logs, threshold, eta, kappa)
    # Log likelihood by strategy, number of bits, what these bits are, and how much they surprise under each strategy.
    likelihood, used, words, surprise = sent or _from_received(logs, between, threshold, eta, kappa)
    if used == 0 and sent is not None:
        return undetermined(
            name, "bits sent are logged, but no posterior, without which soft feedback cannot be tested"
        )
    if used == 0:
        return undetermined(name, "bits sent are not logged, nor posteriors and decisions of several robots")
    order = sorted(STRATEGIES, key=lambda strategy: -likelihood[strategy])
    lead = likelihood[order[0]] - likelihood[order[1]]
    evidence = f"{used} {words}; log likelihood " + ", ".join(
        f"{strategy} {number(likelihood[strategy], 1)}" for strategy in STRATEGIES
    )
    value = order[0] if lead > CLEAR_LEAD else None
    if surprise[order[0]] > MOST_SURPRISE:
        value = None
        evidence += (
            ": none of them explains which bits were received when. Do the robots' clocks differ, or were they "
            "programmed otherwise?"
        )
    elif value is None:
        evidence += ": too close to each other"
    return Inferred(name, value, low=None, high=None, evidence=evidence)


def _messages(log: Log, threshold: float, eta: float, kappa: float) -> dict[str, Floats]:
    """Return, for each strategy, the probability that the message of each sample of a session was a 1, (samples,).

    Samples are ordered by time. For soft feedback the probability is nan if the posterior is not logged.

    Args:
        threshold: theta_E; a bit that is not logged is 1 if the energy is above it. eta, kappa: parameters of soft
            feedback.
    """
    frame = log.samples.sort("time_s")
    bit = (frame["energy"].to_numpy() > threshold).astype(float)
    logged = frame["observation"].cast(pl.Float64).to_numpy()
    bit = np.where(np.isnan(logged), bit, logged)
    chances = {"none": bit}
    decision = frame["decision"].cast(pl.Float64).to_numpy()
    chances["positive"] = np.where(decision >= 0, decision, bit)  # the decision once there is one
    alphas, betas, beliefs = (frame[name].to_list() for name in ("alpha", "beta", "belief_below"))
    chances["soft"] = np.array(
        [
            np.nan
            if alpha is None or beta is None or belief is None
            else soft.probability(int(own_bit), alpha, beta, belief, eta, kappa)
            for alpha, beta, belief, own_bit in zip(alphas, betas, beliefs, bit.tolist(), strict=True)
        ]
    )
    return chances


def _from_sent(
    logs: Sequence[Log], threshold: float, eta: float, kappa: float
) -> tuple[dict[str, float], int, str, dict[str, float]] | None:
    """Compute the log likelihood of each strategy from the bits sent.

    Args:
        threshold: theta_E; a bit read that is not logged is 1 if the energy is above it. eta, kappa: parameters of soft
            feedback.
    Returns: log likelihood by strategy, number of bits used (which may be 0), what these bits are in words, and no
        surprise (0); None if a log lacks bits sent.
    """
    if any(log.samples["message"].null_count() for log in logs):
        return None
    total, used, left_out = dict.fromkeys(STRATEGIES, 0.0), 0, 0
    for log in logs:
        chances = _messages(log, threshold, eta, kappa)
        # Without a posterior only the other strategies have a probability; the sums must be of the same bits.
        is_known = ~np.isnan(chances["soft"])
        bit = log.samples.sort("time_s")["message"].to_numpy()[is_known]
        for strategy, chance_of_one in chances.items():
            chance = np.clip(chance_of_one[is_known], FLOOR_OF_SENT, 1 - FLOOR_OF_SENT)
            total[strategy] += float(np.log(np.where(bit == 1, chance, 1 - chance)).sum())
        used += bit.size
        left_out += int((~is_known).sum())
    words = "bits sent" + (f" ({left_out} without a posterior left out)" if left_out else "")
    return total, used, words, dict.fromkeys(STRATEGIES, 0.0)


def _from_received(
    logs: Sequence[Log], between: pl.DataFrame, threshold: float, eta: float, kappa: float
) -> tuple[dict[str, float], int, str, dict[str, float]]:
    """Compute the log likelihood of each strategy from the bits received.

    Between two samples of a robot the number of ones among the bits received is known. It is taken as binomial, with
    the mean probability of a 1 of the messages that others sent in that time. A log is left out if its posterior,
    decision, belief or count of messages received is missing in any sample.

    The surprise of a strategy is the sum of (k - n q)^2 / (n q (1 - q)) over intervals with k ones of n bits, q their
    share under the strategy, less its expected value, 1 an interval, in standard errors: its variance is
    2 + (1 - 6 q (1 - q)) / (n q (1 - q)) an interval.

    Args:
        between: ``infer_settings.intervals_of`` the logs. threshold: theta_E; the own bit of a sample is taken as 1 if
            its energy is above it, also where the bit is logged. eta, kappa: parameters of soft feedback.
    Returns: log likelihood by strategy, number of bits used (which may be 0), the words "bits received", and the
        surprise by strategy.
    """
    total, used = dict.fromkeys(STRATEGIES, 0.0), 0
    excess, variance = dict.fromkeys(STRATEGIES, 0.0), dict.fromkeys(STRATEGIES, 0.0)
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
        own = between.filter(
            pl.col("session") == session,
            pl.col("whole"),
            pl.col("new_received") > 0,
            pl.col("spacing_s").is_not_null(),
        )
        # For each interval: ones received, bits received, and the mean probability of a 1 by strategy.
        intervals: list[tuple[float, ...]] = []
        for robot, time_s, spacing_s, received, grown, energy in own.select(
            "robot", "time_s", "spacing_s", "new_received", "new_alpha", "energy"
        ).iter_rows():
            # Robots read messages only while they walk; a message that is sent while a robot stands is read after the
            # stop. So the messages of the interval were sent from the start of the robot's previous stop to the start
            # of this one. Times of rows may be up to LAG_S late: the robot's own, so that the previous stop may have
            # begun earlier, and those of the senders, so that their rows may follow the start of this stop.
            stop_began_s = time_s - STOP_S
            sent_from_s = stop_began_s - spacing_s - LAG_S
            first, last = np.searchsorted(times, [sent_from_s, stop_began_s + LAG_S])
            others = np.flatnonzero(sender[first:last] != robot) + first
            ones = int(grown - (energy > threshold))  # alpha grew by the own bit and the ones received
            if others.size == 0 or not 0 <= ones <= received:
                continue
            used += int(received)
            intervals.append(
                (ones, received, *(float(chance[strategy][others].mean()) for strategy in STRATEGIES))
            )
        if not intervals:
            continue
        ones_received, bits_received, *shares = np.array(intervals).T
        for strategy, share in zip(STRATEGIES, shares, strict=True):
            likely = np.clip(share, FLOOR_SHARE, 1 - FLOOR_SHARE)
            total[strategy] += math.fsum(_log_binomial(ones_received, bits_received, likely))
            spread = bits_received * likely * (1 - likely)
            excess[strategy] += math.fsum((ones_received - bits_received * likely) ** 2 / spread - 1)
            variance[strategy] += math.fsum(2 + (1 - 6 * likely * (1 - likely)) / spread)
    surprise = {one: excess[one] / math.sqrt(variance[one]) if used else 0.0 for one in STRATEGIES}
    return total, used, "bits received", surprise


def _log_binomial(ones: Floats, n: Floats, share: Floats) -> Floats:
    """Return the log probability of ``ones`` ones among ``n`` bits that are 1 with probability ``share`` in (0, 1)."""
    from scipy.special import gammaln

    ways = gammaln(n + 1) - gammaln(ones + 1) - gammaln(n - ones + 1)
    return np.asarray(ways + ones * np.log(share) + (n - ones) * np.log1p(-share))
