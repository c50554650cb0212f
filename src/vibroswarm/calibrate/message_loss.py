"""Measure how robots of a recording lose messages, one by one or in bursts, and fit the Gilbert-Elliott model.

A receiver is one robot in one run. Its windows are the intervals between its samples (the first begins at time 0). At
each sample of a robot, the log holds how many messages the robot had received so far, but not which ones. In a window,
``sent`` messages were sent by other robots, and the count of the receiver grew by ``received`` messages. The logged
times are up to a quarter of a second late, so a message may be counted one window too early or too late.

| name | symbol | unit | equation |
|---|---|---|---|
| state of a receiver at a message | z | - | good or bad; redrawn at each message with probability 1 - exp(-1 / c) |
| share of bad | b | - | probability that a redrawn state is bad |
| correlation length of the chain | c | messages | from the mean time in the bad state, see below |
| probability of loss | h_z | - | given the state |
| shift of a window's edge | e | messages | -3 to 3, with probability proportional to exp(-e^2 / (2 s^2)) |
| messages of window k | m_k | - | sent_k + e_k - e_(k-1) |

The likelihood of a receiver is the likelihood of its counts, summed over states and shifts (forward algorithm).
Receivers are independent. The model counts time in messages, because the other robots send them rather regularly. The
mean time in the bad state is c / (1 - b) messages, which the mean time between messages turns into seconds.

Bursts are compared with independent losses, of receivers alike and of each receiver by itself: receivers that differ
would look like bursts otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from vibroswarm.core.arrays import Floats, Ints
from vibroswarm.errors import InputError
from vibroswarm.result import Result
from vibroswarm.statistics.intervals import jackknife_error
from vibroswarm.statistics.sampling import late_robots

MOST_SHIFTED: Final = 3
SHIFTS: Final = np.arange(-MOST_SHIFTED, MOST_SHIFTED + 1)
"""Possible shifts of a window's edge, messages, ascending; the one in the middle is 0."""
LEAST_GAIN: Final = 10.0
"""By how much the AIC of bursts must be lower than that of independent losses, of receivers alike or each by itself."""
NAMES: Final = ("bad_share", "bad_s", "lost_in_bad", "lost_in_good", "shift")
"""Parameters of bursts; of independent losses the last two."""
START: Final = {"bad_share": 0.02, "bad_s": 15.0, "lost_in_bad": 0.8, "lost_in_good": 0.01, "shift": 0.5}
INDEPENDENT: Final = {"bad_share": 0.0, "bad_s": 1.0, "lost_in_bad": 0.0, "lost_in_good": 0.02, "shift": 0.5}
"""Typical values, from which fits start."""


@dataclass(frozen=True, eq=False)
class Windows:
    """The windows of one robot in one run, in order of time, (windows,) each."""

    run: int
    robot: int
    sent: Ints
    """Messages that the other robots sent in each window."""
    received: Ints
    """Messages by which the robot's count grew in each window."""
    length_s: Floats


@dataclass(frozen=True)
class LossModel:
    """A model of receivers: the parameters by name (``NAMES``); without bursts ``bad_share`` is 0."""

    values: dict[str, float]
    log_likelihood: float = 0.0
    parameters: int = 0
    """Number of fitted parameters."""

    @property
    def lost(self) -> float:
        """Share of all messages that are lost."""
        bad = self.values["bad_share"]
        return bad * self.values["lost_in_bad"] + (1.0 - bad) * self.values["lost_in_good"]

    @property
    def aic(self) -> float:
        """Akaike's information criterion; the model with the smaller one predicts better."""
        return 2.0 * self.parameters - 2.0 * self.log_likelihood


@dataclass(frozen=True)
class LossFits:
    """Models of the loss of messages, fitted to recordings (``compare_models``)."""

    windows: list[Windows]
    independent: LossModel
    bursts: LossModel
    aic_by_receiver: float
    """AIC of independent losses of which each receiver has its own share."""
    errors: dict[str, float]
    """Standard errors of the model with bursts; empty if they were not computed."""

    @property
    def gain(self) -> float:
        """By how much the AIC of bursts is lower than that of independent losses, of receivers alike or not."""
        return min(self.independent.aic, self.aic_by_receiver) - self.bursts.aic


def compare_models(windows: list[Windows], *, errors: bool = False) -> LossFits:
    """Fit independent losses and bursts to the counts of received messages.

    Args:
        windows: the receivers, from ``windows_of``.
        errors: whether to compute standard errors, for which the fit is repeated without each receiver.
    Raises:
        InputError: no message is lost, or standard errors of fewer than two receivers.
    """
    if not windows or sum(int((one.sent - one.received).sum()) for one in windows) <= 0:
        raise InputError("no received messages are counted, or none is lost", field="the recordings")
    if errors and len(windows) < 2:
        raise InputError("needs the counts of at least two receivers; leave it out", field="--errors")
    bursts = fit_loss_model(windows, START)
    left_out = [
        fit_loss_model([other for other in windows if other is not one], bursts.values).values
        for one in (windows if errors else ())
    ]
    return LossFits(
        windows,
        independent=fit_loss_model(windows, INDEPENDENT),
        bursts=bursts,
        aic_by_receiver=sum(fit_loss_model([one], INDEPENDENT).aic for one in windows),
        errors={name: jackknife_error([fit[name] for fit in left_out]) for name in NAMES if left_out},
    )


def windows_of(result: Result) -> list[Windows]:
    """Return the windows of each robot of each run, by run and robot; robots without counts of messages are left out.

    A robot sends one message at each sample, so the times of samples are the times of messages; those of lost rows are
    interpolated. A window ends when the robot stops to sample, not at the sample, because a robot reads messages only
    while it walks. The first window of a robot that may have been switched on late is left out
    (``statistics.sampling.late_robots``).
    """
    tables = []
    late = set(late_robots(result).iter_rows())
    joined = result.motion.with_columns(received=result.inference["messages_received"])
    for of_run in joined.partition_by("run", maintain_order=True):
        rows = {
            own["robot"][0]: own for own in of_run.sort("robot", maintain_order=True).partition_by("robot")
        }
        sent_s = {}
        for robot, own in rows.items():
            number = own["sample"].to_numpy()
            every = np.arange(number[0], number[-1] + 1)
            sent_s[robot] = np.interp(every, number, own["time_s"].to_numpy())
        for robot, own in rows.items():
            run = int(own["run"][0])
            known = slice(int((run, robot) in late), None)
            if own["received"].null_count() or not own["received"][known].len():
                continue
            others = [times for other, times in sent_s.items() if other != robot]
            others_s = np.sort(np.concatenate([np.empty(0), *others]))
            edges_s = own["stop_start_s"].to_numpy()
            sent = np.diff(np.searchsorted(others_s, edges_s), prepend=0)
            received = np.diff(own["received"].to_numpy().astype(np.int64), prepend=0)
            lengths_s = np.diff(edges_s, prepend=0.0)
            tables.append(Windows(run, robot, sent[known], received[known], lengths_s[known]))
    return tables


def fit_loss_model(windows: Sequence[Windows], start: dict[str, float]) -> LossModel:
    """Fit a model by maximum likelihood; from a start without bad states, a model of independent losses.

    The optimiser works on logits of shares and logarithms of the time and the shift, which have no bounds.
    """
    from scipy.optimize import minimize  # here, because importing it takes long

    fitted = NAMES if start["bad_share"] > 0.0 else NAMES[3:]
    log_likelihood = _likelihood_of(windows)

    def values_at(at: Any) -> dict[str, float]:
        own = {
            name: math.exp(one) if name in ("bad_s", "shift") else 1.0 / (1.0 + math.exp(-one))
            for name, one in zip(fitted, at, strict=True)
        }
        return start | own

    inside = {name: min(max(start[name], 1e-9), 1e9) for name in fitted}
    first = [
        math.log(one) if name in ("bad_s", "shift") else math.log(one / max(1.0 - one, 1e-9))
        for name, one in inside.items()
    ]
    # In logits and logarithms, 1e-3 is a relative error of about 0.1 %, far below the standard errors.
    options: Any = {"xatol": 1e-3, "fatol": 1e-3, "maxiter": 1500}
    best: Any = minimize(
        lambda at: -log_likelihood(values_at(at)), first, method="Nelder-Mead", options=options
    )
    return LossModel(values_at(best.x), -float(best.fun), len(fitted))


def _likelihood_of(windows: Sequence[Windows]) -> Callable[[dict[str, float]], float]:
    """Return a function of a model's parameters: the log likelihood of all counts, by the forward algorithm.

    The windows of all receivers stand side by side, so that one forward algorithm handles all receivers at once;
    receivers with fewer windows than the longest are filled up at the end.
    """
    longest = max(one.sent.size for one in windows)
    sent, received = (np.zeros((longest, len(windows)), dtype=np.int64) for _ in range(2))
    is_there = np.zeros(sent.shape, dtype=bool)
    for k, one in enumerate(windows):
        rows = slice(one.sent.size)
        sent[rows, k], received[rows, k], is_there[rows, k] = one.sent, one.received, True
    spacing_s = float(sum(w.length_s.sum() for w in windows) / max(sent.sum(), 1))
    # Messages that a window gains by the shift of its first edge (row) and of its last edge (column).
    change = SHIFTS[None, :] - SHIFTS[:, None]

    def log_likelihood(values: dict[str, float]) -> float:
        b = values["bad_share"]
        # The shifts of its two edges may add 2 * MOST_SHIFTED messages to a window.
        chances = passing(values, int(sent.max()) + 2 * MOST_SHIFTED, int(received.max()), spacing_s)
        weight = np.exp(-0.5 * (SHIFTS / values["shift"]) ** 2)
        weight /= weight.sum()
        # Probability of each state and of each shift of the last edge, given the counts so far, (receivers, 2, shifts).
        # The edge at time 0 has no shift.
        forward = np.zeros((len(windows), 2, SHIFTS.size))
        forward[:, :, MOST_SHIFTED] = [1.0 - b, b]
        unknown = np.outer([1.0 - b, b], weight)  # the state's long-term shares, and any shift
        total = 0.0
        for sent_now, received_now, there in zip(sent, received, is_there, strict=True):
            # Messages of the window, (receivers, shift of the first edge, shift of the last edge).
            m = sent_now[:, None, None] + change
            step = chances[np.maximum(m, 0), received_now[:, None, None]] * (m >= 0)[..., None, None]
            # n: receiver; s, t: state before and after; a, b: shift before and after.
            new = np.einsum("nsa,nabst,b->ntb", forward, step, weight)
            likelihood = np.maximum(new.sum(axis=(1, 2)), 1e-300)
            # After counts that the model excludes, the state is not known.
            is_possible = (likelihood > 1e-300)[:, None, None]
            new = np.where(is_possible, new / likelihood[:, None, None], unknown)
            forward = np.where(there[:, None, None], new, forward)
            total += float(np.log(likelihood)[there].sum())
        return total

    return log_likelihood


def passing(values: dict[str, float], most_sent: int, most_received: int, spacing_s: float) -> Floats:
    """Return the probability that a number of messages is received, and that the receiver is in a state after them.

    Args:
        values: parameters. most_sent, most_received: largest numbers of messages. spacing_s: between messages.
    Returns:
        Shape (``most_sent`` + 1, ``most_received`` + 1, 2, 2): by number sent, number received, state before and state
        after (0: good, 1: bad).
    """
    b = values["bad_share"]
    # 1 - exp(-1 / c), with c = bad_s (1 - b) / spacing_s; 1e-9 avoids a division by 0 if b is 1.
    redrawn = -math.expm1(-spacing_s / max(values["bad_s"] * (1.0 - b), 1e-9))
    # Probability of the next state (column) after each state (row).
    step = (1.0 - redrawn) * np.eye(2) + redrawn * np.array([[1.0 - b, b], [1.0 - b, b]])
    lost = np.array([values["lost_in_good"], values["lost_in_bad"]])
    chances = np.zeros((most_sent + 1, most_received + 1, 2, 2))
    chances[0, 0] = np.eye(2)  # no message sent: none received, and the state stays
    for m in range(1, most_sent + 1):
        before_loss = chances[m - 1] @ step  # state at message m, with the count before it
        chances[m] = before_loss * lost  # message m is lost: the number received stays
        chances[m, 1:] += before_loss[:-1] * (1.0 - lost)  # message m is received
    return chances
