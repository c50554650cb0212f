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
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.arrays import Floats, Ints
from vibroswarm.errors import InputError
from vibroswarm.result import Result
from vibroswarm.statistics.intervals import jackknife_error
from vibroswarm.statistics.sampling import late_robots

MOST_SHIFTED: Final = 3
"""Largest shift of a window's edge, messages."""
SHIFTS: Final = np.arange(-MOST_SHIFTED, MOST_SHIFTED + 1)
"""Possible shifts of a window's edge, messages, ascending; the one in the middle is 0."""
STEPS: Final = (1, 2, 3, 5, 10, 20)
"""Smallest size of each class of gaps, messages."""
LEAST_GAIN: Final = 10.0
"""By how much the AIC of bursts must be lower than that of independent losses, of receivers alike or each by itself."""


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
    """Duration of each window."""


@dataclass(frozen=True)
class Bursts:
    """A Gilbert-Elliott model of receivers; without bursts if ``bad_share`` is 0."""

    bad_share: float
    """Probability b that a redrawn state is bad; also the share of messages in the bad state."""
    bad_s: float
    """Mean time in the bad state."""
    lost_in_bad: float
    """Probability of loss in the bad state."""
    lost_in_good: float
    """Probability of loss in the good state."""
    shift: float
    """Standard deviation s of the normal law of the shifts of windows' edges, messages."""
    log_likelihood: float
    """Log likelihood of the counts that the model was fitted to."""
    parameters: int
    """Number of fitted parameters."""

    @property
    def lost(self) -> float:
        """Share of all messages that are lost."""
        return self.bad_share * self.lost_in_bad + (1.0 - self.bad_share) * self.lost_in_good

    @property
    def aic(self) -> float:
        """Akaike's information criterion; the model with the smaller one predicts better."""
        return 2.0 * self.parameters - 2.0 * self.log_likelihood


@dataclass(frozen=True)
class LossFits:
    """Both models of the loss of messages, fitted to recordings, and the gaps that they expect (``compare_models``)."""

    windows: list[Windows]
    models: dict[str, Bursts]
    """By name, "independent" and "bursts"; the bad state does not occur in the former."""
    gaps: Ints
    """Recorded number of gaps in each class of size (``by_size``)."""
    expected: dict[str, Floats]
    """Of each model, means and standard deviations of these numbers (``expected_by_size``)."""
    by_receiver: list[Bursts]
    """Independent losses fitted to each receiver by itself, in the order of ``windows``."""
    errors: dict[str, float]
    """Standard errors of the model with bursts; empty if they were not computed."""
    lost_in_long: float
    """Share of the lost messages that fall into long intervals (``lost_in_long_windows``)."""
    sent_in_long: float
    """Share of all messages that fall into long intervals."""

    @property
    def messages(self) -> int:
        """Number of messages addressed to the receivers."""
        return sum(int(one.sent.sum()) for one in self.windows)

    @property
    def aic_by_receiver(self) -> float:
        """AIC of independent losses of which each receiver has its own share."""
        return sum(one.aic for one in self.by_receiver)

    @property
    def gain(self) -> float:
        """By how much the AIC of bursts is lower than that of independent losses, of receivers alike or not."""
        return min(self.models["independent"].aic, self.aic_by_receiver) - self.models["bursts"].aic


def check_windows(windows: Sequence[Windows], source: str, *, errors: bool = False) -> None:
    """Refuse counts of received messages to which nothing can be fitted.

    Args:
        windows: of all receivers, from ``windows_of``. source: of the counts, for messages.
        errors: whether standard errors are wanted, which need two receivers.
    Raises:
        InputError: no robot has such counts, no message is lost, or ``errors`` is given for one receiver.
    """
    if not windows:
        raise InputError("no received messages are counted", field=source)
    if all(lost_for_good(one).sum() == 0 for one in windows):
        raise InputError("no message is lost; there is nothing to fit", field=source)
    if errors and len(windows) < 2:
        raise InputError("needs the counts of at least two receivers; leave it out", field="--errors")


def compare_models(windows: list[Windows], *, errors: bool = False) -> LossFits:
    """Fit independent losses and bursts to the counts of received messages, and compare the gaps that both expect.

    Args:
        windows: the receivers, at least one that lost a message. errors: whether to compute standard errors, for which
            the fit is repeated without each receiver.
    Raises:
        InputError: standard errors of fewer than two receivers.
    """
    models = {"independent": fit_independent(windows), "bursts": fit_bursts(windows)}
    lost_in_long, sent_in_long = lost_in_long_windows(windows)
    return LossFits(
        windows,
        models,
        gaps=by_size(windows),
        expected={name: expected_by_size(windows, model) for name, model in models.items()},
        by_receiver=[fit_independent([one]) for one in windows],
        errors=jackknife(windows, models["bursts"]) if errors else {},
        lost_in_long=lost_in_long,
        sent_in_long=sent_in_long,
    )


def windows_of(result: Result) -> list[Windows]:
    """Return the windows of each robot of each run, by run and robot; robots without counts of messages are left out.

    A robot sends one message at each sample, so the times of samples are the times of messages (``_times``). A window
    ends when the robot stops to sample, not at the sample, because a robot reads messages only while it walks. The
    first window of a robot that may have been switched on late is left out (``statistics.sampling.late_robots``).
    """
    tables = []
    late = set(late_robots(result).iter_rows())
    joined = result.motion.with_columns(received=result.inference["messages_received"])
    for run in joined["run"].unique(maintain_order=True).to_list():
        of_run = joined.filter(pl.col("run") == run)
        rows = {robot: of_run.filter(pl.col("robot") == robot) for robot in sorted(of_run["robot"].unique())}
        sent_s = {
            robot: _times(own["sample"].to_numpy(), own["time_s"].to_numpy()) for robot, own in rows.items()
        }
        for robot, own in rows.items():
            known = slice(int((run, robot) in late), None)
            if own["received"].null_count() or not own["received"][known].len():
                continue
            # Times of the messages that the other robots sent. The empty array is for a run with one robot.
            others_s = np.sort(
                np.concatenate([np.empty(0), *(sent_s[other] for other in rows if other != robot)])
            )
            edges_s = own["stop_start_s"].to_numpy()
            sent = np.diff(np.searchsorted(others_s, edges_s), prepend=0)
            received = np.diff(own["received"].to_numpy().astype(np.int64), prepend=0)
            lengths_s = np.diff(edges_s, prepend=0.0)
            tables.append(Windows(run, robot, sent[known], received[known], lengths_s[known]))
    return tables


def _times(number: NDArray[Any], time_s: Floats) -> Floats:
    """Return the times of a robot's messages from its first to its last row, s; those of lost rows are interpolated."""
    all_numbers = np.arange(number[0], number[-1] + 1)
    return np.interp(all_numbers, number, time_s)


def second_s(windows: Sequence[Windows]) -> float:
    """Return the mean time between messages addressed to a robot, s; at least one message must have been sent."""
    return float(sum(w.length_s.sum() for w in windows) / sum(w.sent.sum() for w in windows))


def fit_bursts(windows: Sequence[Windows], start: Bursts | None = None) -> Bursts:
    """Fit the Gilbert-Elliott model by maximum likelihood.

    The optimiser works on logits of probabilities and logarithms of positive values, which have no bounds. In
    ``Bursts``, ``parameters`` is the number of fitted parameters.

    Args:
        windows: the receivers, at least one, to which at least one message was sent.
        start: model to start from; None: typical values.
    """
    spacing_s = second_s(windows)
    first = start or Bursts(
        bad_share=0.02, bad_s=15.0, lost_in_bad=0.8, lost_in_good=0.01, shift=0.5,
        log_likelihood=0.0, parameters=5,
    )  # fmt: skip
    x = [_logit(first.bad_share), math.log(first.bad_s / spacing_s), _logit(first.lost_in_bad),
         _logit(first.lost_in_good), math.log(first.shift)]  # fmt: skip

    def model(at: Any) -> Bursts:
        """Return the model at a point of the optimiser; its likelihood, not known yet, is 0.

        ``at``: logit of the share of bad, log mean bad time in messages, logits of both losses, log shift.
        """
        b, h_bad, h_good = (1.0 / (1.0 + math.exp(-at[k])) for k in (0, 2, 3))
        return Bursts(
            bad_share=b, bad_s=math.exp(at[1]) * spacing_s, lost_in_bad=h_bad, lost_in_good=h_good,
            shift=math.exp(at[4]), log_likelihood=0.0, parameters=5,
        )  # fmt: skip

    return _likeliest(windows, model, x)


def fit_independent(windows: Sequence[Windows]) -> Bursts:
    """Fit the model without bursts: one probability of loss for all messages and receivers, by maximum likelihood."""

    def model(at: Any) -> Bursts:
        """Return the model at a point of the optimiser, (logit of the loss, log shift), without a bad state.

        ``bad_s`` and ``lost_in_bad`` have no effect, because no state is bad.
        """
        return Bursts(
            bad_share=0.0, bad_s=1.0, lost_in_bad=0.0, lost_in_good=1.0 / (1.0 + math.exp(-at[0])),
            shift=math.exp(at[1]), log_likelihood=0.0, parameters=2,
        )  # fmt: skip

    # Typical values: 2 % lost, s = 0.5 messages.
    return _likeliest(windows, model, [_logit(0.02), math.log(0.5)])


def _likeliest(windows: Sequence[Windows], model: Callable[[Any], Bursts], start: list[float]) -> Bursts:
    """Return the model of largest likelihood near a start, with its log likelihood.

    Args:
        model: the model at a point of the optimiser, (parameters,).
    """
    from scipy.optimize import minimize  # here, because importing it takes long

    table, spacing_s = _Table(windows), second_s(windows)
    # In logits and logarithms, 1e-3 is a relative error of about 0.1 %, far below the standard errors.
    options: Any = {"xatol": 1e-3, "fatol": 1e-3, "maxiter": 1500}

    def cost(at: Any) -> Any:
        return -table.log_likelihood(model(at), spacing_s)

    best: Any = minimize(cost, np.array(start), method="Nelder-Mead", options=options)
    found = model(best.x)
    return replace(found, log_likelihood=table.log_likelihood(found, spacing_s))


def _logit(share: float) -> float:
    """Return the log odds of a share; a share of 0 or 1, whose odds are infinite, counts as 1e-9 next to it."""
    inside = min(max(share, 1e-9), 1.0 - 1e-9)
    return math.log(inside / (1.0 - inside))


def jackknife(windows: Sequence[Windows], found: Bursts) -> dict[str, float]:
    """Return standard errors of a fit's figures by name: the fit is repeated without each receiver in turn.

    Args:
        windows: the receivers, at least two. found: their fit, from which the repeated fits start.
    Returns:
        Standard errors of bad_share, bad_s, lost_in_bad and lost_in_good.
    Raises:
        InputError: fewer than two receivers.
    """
    if len(windows) < 2:
        raise InputError("standard errors need at least two receivers", field="windows")
    names = ("bad_share", "bad_s", "lost_in_bad", "lost_in_good")
    left_out = [fit_bursts([w for w in windows if w is not one], found) for one in windows]
    return {name: jackknife_error([getattr(fit, name) for fit in left_out]) for name in names}


def _weights(spread: float) -> Floats:
    """Return the probability of each of ``SHIFTS``, proportional to exp(-e^2 / (2 ``spread``^2)), with the sum 1."""
    weight = np.exp(-0.5 * (SHIFTS / spread) ** 2)
    return np.asarray(weight / weight.sum())


class _Table:
    """The windows of all receivers side by side, so that one forward algorithm handles all receivers at once.

    ``sent``, ``received`` and ``is_there`` have the shape (windows, receivers). Receivers with fewer windows than the
    longest are filled up at the end, where ``is_there`` is False.
    """

    def __init__(self, windows: Sequence[Windows]) -> None:
        """Copy the windows of each receiver into a column of the arrays."""
        longest = max(w.sent.size for w in windows)
        self.sent = np.zeros((longest, len(windows)), dtype=np.int64)
        self.received = np.zeros_like(self.sent)
        self.is_there = np.zeros(self.sent.shape, dtype=bool)
        for k, w in enumerate(windows):
            size = w.sent.size
            self.sent[:size, k], self.received[:size, k], self.is_there[:size, k] = w.sent, w.received, True
        # Messages that a window gains by the shift of its first edge (row) and of its last edge (column).
        self.change = SHIFTS[None, :] - SHIFTS[:, None]

    def log_likelihood(self, model: Bursts, spacing_s: float) -> float:
        """Return the log likelihood of all counts, by the forward algorithm over windows.

        Args:
            model: the model. spacing_s: mean time between messages (``second_s``).
        """
        most_received = int(self.received.max())
        # The shifts of its two edges may add 2 * MOST_SHIFTED messages to a window.
        chances = passing(model, int(self.sent.max()) + 2 * MOST_SHIFTED, most_received, spacing_s)
        weight = _weights(model.shift)
        b = model.bad_share
        receivers = self.sent.shape[1]
        # Probability of each state and of each shift of the last edge, given the counts so far, (receivers, 2, shifts).
        # The edge at time 0 has no shift: ``SHIFTS[MOST_SHIFTED]`` is 0.
        forward = np.zeros((receivers, 2, SHIFTS.size))
        forward[:, :, MOST_SHIFTED] = [1.0 - b, b]
        unknown = np.outer([1.0 - b, b], weight)  # the state's long-term shares, and any shift
        total = 0.0
        for sent, received, is_there in zip(self.sent, self.received, self.is_there, strict=True):
            # Messages of the window, (receivers, shift of the first edge, shift of the last edge).
            m = sent[:, None, None] + self.change
            # Probability of the received number and the state after, by state before; 0 where m would be negative.
            step = np.where(
                (m >= 0)[..., None, None], chances[np.maximum(m, 0), received[:, None, None]], 0.0
            )
            # n: receiver; s, t: state before and after; a, b: shift before and after.
            new = np.einsum("nsa,nabst,b->ntb", forward, step, weight)
            likelihood = new.sum(axis=(1, 2))
            is_possible = likelihood > 0
            # A finite logarithm for counts that the model excludes. After them, the state is not known.
            likelihood = np.where(is_possible, likelihood, 1e-300)
            new = np.where(is_possible[:, None, None], new / likelihood[:, None, None], unknown)
            # Receivers without this window keep their probabilities.
            forward = np.where(is_there[:, None, None], new, forward)
            total += float(np.log(likelihood)[is_there].sum())
        return total


def passing(model: Bursts, most_sent: int, most_received: int, spacing_s: float) -> Floats:
    """Return the probability that a number of messages is received, and that the receiver is in a state after them.

    The probabilities are conditional on the number of messages sent and on the receiver's state before them.

    Args:
        model: the model. most_sent, most_received: largest numbers of messages.
        spacing_s: mean time between messages, s.
    Returns:
        Shape (``most_sent`` + 1, ``most_received`` + 1, 2, 2): by number sent, number received, state before and state
        after (0: good, 1: bad).
    """
    b = model.bad_share
    # 1 - exp(-1 / c), with c = bad_s (1 - b) / spacing_s; 1e-9 avoids a division by 0 if b is 1.
    redrawn = -math.expm1(-spacing_s / max(model.bad_s * (1.0 - b), 1e-9))
    # Probability of the next state (column) after each state (row).
    step = (1.0 - redrawn) * np.eye(2) + redrawn * np.array([[1.0 - b, b], [1.0 - b, b]])
    lost = np.array([model.lost_in_good, model.lost_in_bad])
    chances = np.zeros((most_sent + 1, most_received + 1, 2, 2))
    chances[0, 0] = np.eye(2)  # no message sent: none received, and the state stays
    for m in range(1, most_sent + 1):
        before_loss = chances[m - 1] @ step  # state at message m, with the count before it
        chances[m] = before_loss * lost  # message m is lost: the number received stays
        chances[m, 1:] += before_loss[:-1] * (1.0 - lost)  # message m is received
    return chances


def lost_for_good(windows: Windows) -> Ints:
    """Return how many messages were lost in each window, (windows,), without those that were only counted late.

    A message that is counted a window late is missing at first, and not missing any more after the next window. So the
    messages lost up to a window are the smallest number of messages that are missing after it or after any later one.
    """
    missing = np.cumsum(windows.sent - windows.received)  # messages missing so far, after each window
    lowest_from_here = np.minimum.accumulate(missing[::-1])[::-1]
    # Inner maximum: the count of missing messages is negative after a window that counted messages of the next window
    # too early. The outer one has no effect: the minima never decrease, so no difference is negative.
    return np.asarray(np.maximum(np.diff(np.maximum(lowest_from_here, 0), prepend=0), 0))


def gap_sizes(windows: Windows) -> Ints:
    """Return how many messages were lost in each gap, (gaps,).

    A gap is a longest sequence of successive windows in each of which messages were lost.
    """
    lost = lost_for_good(windows)
    total = np.append(0, np.cumsum(lost))  # messages lost before each window
    # Indices of the first window of a gap and of the first window after it, alternately.
    edges = np.flatnonzero(np.diff(np.concatenate([[0], lost > 0, [0]])))
    return np.asarray(total[edges[1::2]] - total[edges[::2]])


def by_size(windows: Sequence[Windows]) -> Ints:
    """Return the number of gaps in each class of size: 1, 2, 3 to 4, 5 to 9, ... messages (``STEPS``)."""
    return np.histogram(np.concatenate([gap_sizes(w) for w in windows]), bins=[*STEPS, np.inf])[0]


def lost_in_long_windows(windows: Sequence[Windows], times: float = 2.0) -> tuple[float, float]:
    """Return how much of the lost messages, and how much of all messages, belongs to long windows, as shares.

    If the first share is much larger than the second, a robot that receives nothing does not sample either: its window
    lasts until it samples again. The model has no such dependence of losses on the length of a window.

    Args:
        windows: the receivers. times: a window is long if it is longer than this many times the median length.
    """
    limit_s = times * float(np.median(np.concatenate([w.length_s for w in windows])))
    lost = np.concatenate([lost_for_good(w) for w in windows])
    sent = np.concatenate([w.sent for w in windows])
    is_long = np.concatenate([w.length_s for w in windows]) > limit_s
    return float(lost[is_long].sum() / max(lost.sum(), 1)), float(sent[is_long].sum() / max(sent.sum(), 1))


_SEED: Final = 1
"""Seed of the simulations of ``simulated``; each draw has random numbers of its own."""


def simulated(windows: Sequence[Windows], model: Bursts, spacing_s: float, draw: int) -> list[Windows]:
    """Return the same windows with received messages that are drawn from a model, shifts of the edges included.

    Args:
        windows: the receivers; their sent messages stay. model: the model.
        spacing_s: mean time between messages (``second_s``).
        draw: number of the draw; the same number gives the same messages.
    """
    rng = np.random.default_rng([_SEED, draw])
    # Probability that a state is redrawn, as in ``passing``.
    chance = -math.expm1(-spacing_s / max(model.bad_s * (1.0 - model.bad_share), 1e-9))
    made = []
    for w in windows:
        count = int(w.sent.sum())
        redrawn, bad = rng.random(count) < chance, rng.random(count) < model.bad_share
        # The message that drew the state of each one; the first message always draws a new state.
        drawn_at = np.maximum.accumulate(np.where(redrawn, np.arange(count), 0))
        heard = rng.random(count) >= np.where(bad[drawn_at], model.lost_in_bad, model.lost_in_good)
        shift = rng.choice(SHIFTS, w.sent.size, p=_weights(model.shift))
        # Message at which each window ends; shifts must not make a window end before the previous one.
        edges = np.maximum.accumulate(np.clip(np.cumsum(w.sent) + shift, 0, count))
        total = np.append(0, np.cumsum(heard))  # messages received before each message
        made.append(replace(w, received=np.diff(total[edges], prepend=0)))
    return made


def expected_by_size(windows: Sequence[Windows], model: Bursts, draws: int = 200) -> Floats:
    """Return the numbers of gaps in each class of size (``by_size``) that a model predicts for these windows.

    Returns: mean and standard deviation over ``draws`` simulations, (2, classes).
    """
    spacing_s = second_s(windows)
    counts = np.array([by_size(simulated(windows, model, spacing_s, draw)) for draw in range(draws)])
    return np.array([counts.mean(axis=0), counts.std(axis=0, ddof=1)])
