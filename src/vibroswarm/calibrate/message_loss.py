"""How robots of a recording lose messages: one by one, or in bursts; the Gilbert-Elliott model fitted to them.

A log tells how many messages a robot had received at each own sample, not which. Between two samples of a robot,
``sent`` messages were sent by others, and ``received`` counted; times are those of rows, up to a quarter of a second
late, so that a message may be counted a window early or late.

| name | symbol | unit | equation |
|---|---|---|---|
| state of a receiver at a message | z | - | good or bad; Markov chain, drawn anew with probability 1 - exp(-1 / c) |
| share of bad | b | - | stationary |
| correlation, in messages | c | - | of the chain |
| probability of loss | h_z | - | given the state |
| shift of a window's edge | e | messages | -3 to 3, with probability proportional to exp(-e^2 / (2 s^2)) |
| messages of window k | m_k | - | sent_k + e_k - e_(k-1) |

The likelihood of a receiver is that of its counts, summed over states and shifts (forward algorithm). Receivers are
independent. Time is counted in messages, which other robots send evenly enough for this: a mean time in the bad state
is c / (1 - b) messages, times the mean time between messages.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.result import Result

MOST_SHIFTED: Final = 3
SHIFTS: Final = np.arange(-MOST_SHIFTED, MOST_SHIFTED + 1)
STEPS: Final = (1, 2, 3, 5, 10, 20)
"""Smallest size of each class of gaps, messages."""


@dataclass(frozen=True, eq=False)
class Windows(NotebookView):
    """The intervals between a robot's samples; one entry each, in order of time."""

    run: int
    robot: int
    sent: NDArray[np.int64]
    """By the other robots."""
    received: NDArray[np.int64]
    length_s: NDArray[np.float64]


@dataclass(frozen=True)
class Bursts(NotebookView):
    """A Gilbert-Elliott model of receivers; without bursts if ``bad_share`` is 0."""

    bad_share: float
    bad_s: float
    lost_in_bad: float
    lost_in_good: float
    shift: float
    """The s of the shifts, messages."""
    log_likelihood: float
    parameters: int

    @property
    def lost(self) -> float:
        """Share of all messages that are lost."""
        return self.bad_share * self.lost_in_bad + (1.0 - self.bad_share) * self.lost_in_good

    @property
    def aic(self) -> float:
        """Akaike's information criterion; the model with the smaller one predicts better."""
        return 2.0 * self.parameters - 2.0 * self.log_likelihood


def windows_of(result: Result) -> list[Windows]:
    """Return the windows of each robot of each run; robots whose log does not count messages are left out.

    The time of a sample whose row is missing is taken to be half-way between its neighbours'.
    """
    tables = []
    joined = result.motion.with_columns(received=result.inference["messages_received"])
    for run in joined["run"].unique(maintain_order=True).to_list():
        of_run = joined.filter(pl.col("run") == run)
        rows = {robot: of_run.filter(pl.col("robot") == robot) for robot in sorted(of_run["robot"].unique())}
        sent_s = {
            robot: _times(own["sample"].to_numpy(), own["time_s"].to_numpy()) for robot, own in rows.items()
        }
        for robot, own in rows.items():
            if own["received"].null_count():
                continue
            others_s = np.sort(
                np.concatenate([np.empty(0), *(sent_s[other] for other in rows if other != robot)])
            )
            edges_s = own["stop_start_s"].to_numpy()
            sent = np.diff(np.searchsorted(others_s, edges_s), prepend=0)
            received = np.diff(own["received"].to_numpy().astype(np.int64), prepend=0)
            tables.append(Windows(run, robot, sent, received, np.diff(edges_s, prepend=0.0)))
    return tables


def _times(number: NDArray[Any], time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the times of all messages of a robot, those of missing rows among them."""
    every = np.arange(number[0], number[-1] + 1)
    return np.interp(every, number, time_s)


def second_s(windows: Sequence[Windows]) -> float:
    """Return the mean time between messages addressed to a robot, s."""
    return float(sum(w.length_s.sum() for w in windows) / sum(w.sent.sum() for w in windows))


def fit_bursts(windows: Sequence[Windows], start: Bursts | None = None) -> Bursts:
    """Fit the model by maximum likelihood, from ``start`` or, without it, from typical values."""
    spacing_s = second_s(windows)
    table = _Table(windows)
    first = start or Bursts(0.02, 15.0, 0.8, 0.01, 0.5, 0.0, 5)
    x = [_logit(first.bad_share), math.log(first.bad_s / spacing_s), _logit(first.lost_in_bad),
         _logit(first.lost_in_good), math.log(first.shift)]  # fmt: skip

    def model(at: Any) -> Bursts:
        b, h_bad, h_good = (1.0 / (1.0 + math.exp(-at[k])) for k in (0, 2, 3))
        return Bursts(b, math.exp(at[1]) * spacing_s, h_bad, h_good, math.exp(at[4]), 0.0, 5)

    best = _minimum(lambda at: -table.log_likelihood(model(at), spacing_s), x)
    found = model(best)
    return replace(found, log_likelihood=table.log_likelihood(found, spacing_s))


def fit_independent(windows: Sequence[Windows]) -> Bursts:
    """Fit one probability of loss to all receivers."""
    table, spacing_s = _Table(windows), second_s(windows)

    def model(at: Any) -> Bursts:
        return Bursts(0.0, 1.0, 0.0, 1.0 / (1.0 + math.exp(-at[0])), math.exp(at[1]), 0.0, 2)

    found = model(
        _minimum(lambda at: -table.log_likelihood(model(at), spacing_s), [_logit(0.02), math.log(0.5)])
    )
    return replace(found, log_likelihood=table.log_likelihood(found, spacing_s))


def _minimum(cost: Any, start: list[float]) -> Any:
    from scipy.optimize import minimize

    found = minimize(
        cost, start, method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-3, "maxiter": 1500}
    )
    return found.x


def _logit(share: float) -> float:
    return math.log(share / (1.0 - share))


def jackknife(windows: Sequence[Windows], found: Bursts) -> dict[str, float]:
    """Return standard errors of a fit's figures: it is repeated without each receiver in turn."""
    names = ("bad_share", "bad_s", "lost_in_bad", "lost_in_good")
    left_out = [fit_bursts([w for w in windows if w is not one], found) for one in windows]
    count = len(windows)
    values = {name: np.array([getattr(fit, name) for fit in left_out]) for name in names}
    return {
        name: float(np.sqrt((count - 1) / count * ((v - v.mean()) ** 2).sum())) for name, v in values.items()
    }


def _weights(spread: float) -> NDArray[np.float64]:
    """Return the probabilities of the shifts."""
    weight = np.exp(-0.5 * (SHIFTS / spread) ** 2)
    return np.asarray(weight / weight.sum())


class _Table:
    """The windows of all receivers side by side, for a forward algorithm in one go."""

    def __init__(self, windows: Sequence[Windows]) -> None:
        steps = max(w.sent.size for w in windows)
        self.sent = np.zeros((steps, len(windows)), dtype=np.int64)
        self.received = np.zeros_like(self.sent)
        self.is_there = np.zeros(self.sent.shape, dtype=bool)
        for k, w in enumerate(windows):
            size = w.sent.size
            self.sent[:size, k], self.received[:size, k], self.is_there[:size, k] = w.sent, w.received, True
        self.change = SHIFTS[None, :] - SHIFTS[:, None]  # of the window, by shift before and after

    def log_likelihood(self, model: Bursts, spacing_s: float) -> float:
        """Return the log likelihood of all counts."""
        most_received = int(self.received.max())
        chances = passing(model, int(self.sent.max()) + 2 * MOST_SHIFTED, most_received, spacing_s)
        weight = _weights(model.shift)
        b = model.bad_share
        receivers = self.sent.shape[1]
        forward = np.zeros((receivers, 2, SHIFTS.size))
        forward[:, :, MOST_SHIFTED] = [1.0 - b, b]
        total = 0.0
        for sent, received, is_there in zip(self.sent, self.received, self.is_there, strict=True):
            m = sent[:, None, None] + self.change
            step = np.where(
                (m >= 0)[..., None, None], chances[np.maximum(m, 0), received[:, None, None]], 0.0
            )
            new = np.einsum("nsa,nabst,b->ntb", forward, step, weight)
            size = new.sum(axis=(1, 2))
            size = np.where(size > 0, size, 1e-300)
            forward = np.where(is_there[:, None, None], new / size[:, None, None], forward)
            total += float(np.log(size)[is_there].sum())
        return total


def passing(model: Bursts, most_sent: int, most_received: int, spacing_s: float) -> NDArray[np.float64]:
    """Return the probability of so many received messages and the state after, given those sent and the state before.

    Returns: (``most_sent`` + 1, ``most_received`` + 1, 2, 2): by sent, received, state before and state after (0: good,
        1: bad).
    """
    b = model.bad_share
    anew = -math.expm1(-spacing_s / max(model.bad_s * (1.0 - b), 1e-9))
    step = (1.0 - anew) * np.eye(2) + anew * np.array([[1.0 - b, b], [1.0 - b, b]])
    lost = np.array([model.lost_in_good, model.lost_in_bad])
    chances = np.zeros((most_sent + 1, most_received + 1, 2, 2))
    chances[0, 0] = np.eye(2)
    for m in range(1, most_sent + 1):
        reached = chances[m - 1] @ step
        chances[m] = reached * lost
        chances[m, 1:] += reached[:-1] * (1.0 - lost)
    return chances


def lost_for_good(windows: Windows) -> NDArray[np.int64]:
    """Return by how much the number of lost messages rose for good in each window.

    A message that is counted a window late makes a loss that the next window takes back; these are left out.
    """
    missing = np.cumsum(windows.sent - windows.received)
    for_good = np.minimum.accumulate(missing[::-1])[::-1]
    return np.asarray(np.maximum(np.diff(np.maximum(for_good, 0), prepend=0), 0))


def gap_sizes(windows: Windows) -> NDArray[np.int64]:
    """Return how many messages were lost in each gap: a stretch of windows of which each lost some."""
    lost = lost_for_good(windows)
    total = np.append(0, np.cumsum(lost))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], lost > 0, [0]])))
    return np.asarray(total[edges[1::2]] - total[edges[::2]])


def by_size(windows: Sequence[Windows]) -> NDArray[np.int64]:
    """Return how many gaps are of 1, 2, 3 to 4, ... messages (``STEPS``)."""
    return np.histogram(np.concatenate([gap_sizes(w) for w in windows]), bins=[*STEPS, np.inf])[0]


def lost_in_long_windows(windows: Sequence[Windows], times: float = 2.0) -> tuple[float, float]:
    """Return the share of lost messages that fall into long windows, and the share of messages that do.

    Args:
        times: a window is long if it is longer than this many times the median.
    """
    limit_s = times * float(np.median(np.concatenate([w.length_s for w in windows])))
    lost = np.concatenate([lost_for_good(w) for w in windows])
    sent = np.concatenate([w.sent for w in windows])
    is_long = np.concatenate([w.length_s for w in windows]) > limit_s
    return float(lost[is_long].sum() / max(lost.sum(), 1)), float(sent[is_long].sum() / max(sent.sum(), 1))


def simulated(windows: Sequence[Windows], model: Bursts, spacing_s: float, draw: int) -> list[Windows]:
    """Draw the received messages of the same windows from a model, with its shifts; numbered draws are repeatable."""
    rng = np.random.default_rng([1, draw])
    anew = -math.expm1(-spacing_s / max(model.bad_s * (1.0 - model.bad_share), 1e-9))
    made = []
    for w in windows:
        count = int(w.sent.sum())
        is_bad, states = False, np.empty(count, dtype=bool)
        redrawn, bad = rng.random(count) < anew, rng.random(count) < model.bad_share
        for k in range(count):
            if k == 0 or redrawn[k]:
                is_bad = bool(bad[k])
            states[k] = is_bad
        heard = rng.random(count) >= np.where(states, model.lost_in_bad, model.lost_in_good)
        shift = rng.choice(SHIFTS, w.sent.size, p=_weights(model.shift))
        edges = np.clip(np.cumsum(w.sent) + shift, 0, count)
        total = np.append(0, np.cumsum(heard))
        made.append(replace(w, received=np.diff(total[np.maximum.accumulate(edges)], prepend=0)))
    return made


def expected_by_size(windows: Sequence[Windows], model: Bursts, draws: int = 200) -> NDArray[np.float64]:
    """Return ``by_size`` as a model expects it, by simulation: mean and standard deviation, (2, sizes)."""
    spacing_s = second_s(windows)
    counts = np.array([by_size(simulated(windows, model, spacing_s, draw)) for draw in range(draws)])
    return np.array([counts.mean(axis=0), counts.std(axis=0, ddof=1)])
