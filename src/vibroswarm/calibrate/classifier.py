"""Can a classifier tell a stretch of a real robot's samples from a simulated one? Split by robot and by session.

Logistic regression with a ridge on figures of ``STRETCH`` consecutive samples of one robot (about a minute): mean and
spread of energies by kind of tile, distances, times, avoidance, places, turns from step to step, and how alike neighbours
are. One sample alone tells little; that a robot keeps its speed, veers, or reads alike twice in a row is seen in a stretch.
It is trained on other robots and other sessions than it is asked about, so that it cannot know a robot by its speed or a
session by its battery. The share told apart is of both kinds alike (balanced); 0.5 is chance. Beside it stands the share
for real sessions against each other, split by robot: what differences between sessions alone give. (Below 0.5: what
distinguishes two sessions of some robots is the other way round for others.)

It is written here, in some tens of lines on scipy's optimiser, in place of a dependency on a library of learning: with some
hundred rows and some ten columns nothing more is needed, and what it looks at can be read.
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit

from vibroswarm.analysis.intervals import Interval, mean_interval
from vibroswarm.errors import InputError

Floats = NDArray[np.float64]
STRETCH: Final = 20
"""Samples."""
RIDGE: Final = 3.0
"""Of weights of standardised columns: a prior of standard deviation 0.6."""


@dataclass(frozen=True)
class ToldApart:
    """Share of stretches told apart, balanced over both kinds; interval over sessions."""

    simulated: Interval
    """Real against simulated: other robots and, where there are several, other sessions than trained on."""
    simulated_by_robot: Interval
    """The same split by robot only, session by session, as ``real`` is."""
    real: Interval | None
    """Real sessions against each other, split by robot; None with one session."""

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""

        def plain(one: Interval | None) -> dict[str, float] | None:
            return None if one is None else {"estimate": one.estimate, "low": one.low, "high": one.high}

        return {name: plain(value) for name, value in self.__dict__.items()}


def columns_of(samples: pl.DataFrame) -> Floats:
    """Figures of a robot's stretches, (stretches, columns); what is over at the end is left out.

    Args:
        samples: of one robot and session, in the order of time (``features.sample_table``).
    """
    stepped = samples.filter(pl.col("dx_m").is_not_null() & pl.col("avoid_s").is_not_null())
    x, y, avoid, kind = (
        stepped[name].to_numpy().astype(float) for name in ("x_m", "y_m", "avoid_s", "vibrating")
    )
    energy = np.log(np.maximum(stepped["energy"].to_numpy(), 0.05))
    distance, spacing = stepped["distance_m"].to_numpy(), stepped["spacing_s"].to_numpy()
    course = np.arctan2(stepped["dy_m"].to_numpy(), stepped["dx_m"].to_numpy())
    turned = np.append(0.0, (np.diff(course) + np.pi) % (2 * np.pi) - np.pi)
    wall = np.minimum(np.minimum(x, 1 - x), np.minimum(y, 1 - y))
    found = []
    for first in range(0, len(x) - STRETCH + 1, STRETCH):
        k = slice(first, first + STRETCH)
        shaking = kind[k] == 1
        found.append(
            [
                *_mean_and_spread(energy[k][shaking]),
                *_mean_and_spread(energy[k][~shaking]),
                *_mean_and_spread(distance[k] / 0.1),
                float(np.median(distance[k])) / 0.1,
                *_mean_and_spread(np.log(np.maximum(spacing[k], 0.1))),
                float((avoid[k] > 1e-9).mean()),
                *_mean_and_spread(np.log1p(np.maximum(avoid[k], 0.0))),
                *_mean_and_spread(np.log(np.maximum(wall[k], 0.005))),
                *_mean_and_spread(turned[k]),
                float(np.median(turned[k])),
                float(np.median(np.abs(turned[k]))),
                _alike(energy[k]),
                _alike(distance[k]),
                float(shaking.mean()),
            ]
        )
    return np.array(found).reshape(len(found), -1)


def _mean_and_spread(values: Floats) -> tuple[float, float]:
    return (float(values.mean()), float(values.std())) if values.size else (0.0, 0.0)


def _alike(values: Floats) -> float:
    """Lag-1 correlation."""
    deviation = values - values.mean()
    square = float((deviation**2).mean())
    return float((deviation[1:] * deviation[:-1]).mean()) / square if square > 0 else 0.0


def fit_logistic(columns: Floats, label: NDArray[np.bool_]) -> Floats:
    """Weights (the first of the constant), with both kinds weighing alike; columns should be standardised."""
    design = np.column_stack([np.ones(len(columns)), columns])
    weight = np.where(label, 0.5 / max(label.mean(), 1e-9), 0.5 / max(1 - label.mean(), 1e-9))
    sign = np.where(label, 1.0, -1.0)
    ridge = np.append(0.0, np.full(columns.shape[1], RIDGE))

    def loss(w: Floats) -> float:
        return float(weight @ np.logaddexp(0.0, -sign * (design @ w))) + 0.5 * float(ridge @ w**2)

    def slope(w: Floats) -> Floats:
        return np.asarray(ridge * w - design.T @ (weight * sign * expit(-sign * (design @ w))))

    def curvature(w: Floats) -> Floats:
        share = expit(design @ w)
        return np.asarray((design.T * (weight * share * (1.0 - share))) @ design + np.diag(ridge))

    found = minimize(
        loss,
        np.zeros(design.shape[1]),
        jac=slope,
        hess=curvature,
        method="trust-exact",
        options={"gtol": 1e-4},
    )
    return np.asarray(found.x)


def share_told(train: tuple[Floats, Floats], test: tuple[Floats, Floats]) -> float:
    """Balanced share of the test rows that are told right; each pair holds the rows of both kinds."""
    columns = np.concatenate(train)
    mean, spread = columns.mean(axis=0), columns.std(axis=0)
    spread = np.where(spread > 1e-9, spread, 1.0)
    label = np.r_[np.zeros(len(train[0]), dtype=np.bool_), np.ones(len(train[1]), dtype=np.bool_)]
    weights = fit_logistic((columns - mean) / spread, label)
    shares = []
    for kind, rows in enumerate(test):
        says = (rows - mean) / spread @ weights[1:] + weights[0] > 0
        shares.append(float((says == bool(kind)).mean()))
    return float(np.mean(shares))


def tell_apart(
    real: Sequence[pl.DataFrame], simulated: Sequence[pl.DataFrame], level: float = 0.95
) -> ToldApart:
    """Train and ask, for every session, with one robot at a time held out.

    Args:
        real, simulated: sessions (``features.sessions_of``).
    Raises:
        InputError: fewer than two robots.
    """
    a, b = [_by_robot(one) for one in real], [_by_robot(one) for one in simulated]
    robots = sorted(set.intersection(*(set(one) for one in (*a, *b))))
    if len(robots) < 2:
        raise InputError("a classifier split by robot needs two robots at least", field="robots")
    return ToldApart(
        simulated=_share_interval([_held_out(a, b, i, robots) for i in range(len(a))], level),
        simulated_by_robot=_share_interval(
            [float(np.mean([_pair(one, other, robots) for other in b])) for one in a], level
        ),
        real=_among(a, robots, level),
    )


def _share_interval(shares: list[float], level: float) -> Interval:
    """``mean_interval`` within what a share can be."""
    found = mean_interval(shares, level)
    return found._replace(low=max(found.low, 0.0), high=min(found.high, 1.0))


def _by_robot(samples: pl.DataFrame) -> dict[int, Floats]:
    return {int(key[0]): columns_of(own) for key, own in samples.group_by("robot", maintain_order=True)}


def _rows(sessions: Sequence[dict[int, Floats]], robots: Sequence[int]) -> Floats:
    return np.concatenate([one[robot] for one in sessions for robot in robots])


def _held_out(
    real: list[dict[int, Floats]], simulated: list[dict[int, Floats]], session: int, robots: list[int]
) -> float:
    """Asked about one real session and one simulated one, trained on the others; by robot."""
    other = session % len(simulated)
    rest_real = [one for i, one in enumerate(real) if i != session] or real
    rest_simulated = [one for i, one in enumerate(simulated) if i != other] or simulated
    shares = []
    for robot in robots:
        others = [one for one in robots if one != robot]
        train = (_rows(rest_real, others), _rows(rest_simulated, others))
        shares.append(share_told(train, (real[session][robot], simulated[other][robot])))
    return float(np.mean(shares))


def _pair(one: dict[int, Floats], other: dict[int, Floats], robots: list[int]) -> float:
    shares = []
    for robot in robots:
        others = [each for each in robots if each != robot]
        shares.append(share_told((_rows([one], others), _rows([other], others)), (one[robot], other[robot])))
    return float(np.mean(shares))


def _among(sessions: list[dict[int, Floats]], robots: list[int], level: float) -> Interval | None:
    if len(sessions) < 2:
        return None
    pairs = {
        (i, j): _pair(sessions[i], sessions[j], robots) for i, j in combinations(range(len(sessions)), 2)
    }
    by_session = [
        float(np.mean([share for pair, share in pairs.items() if i in pair])) for i in range(len(sessions))
    ]
    return _share_interval(by_session, level)
