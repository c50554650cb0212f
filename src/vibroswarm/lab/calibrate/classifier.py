"""Train a classifier to distinguish real robots' samples from simulated ones, and test it on other robots and sessions.

A session is one run. A stretch is ``STRETCH`` consecutive samples of one robot in one session, about a minute. The
classifier is a logistic regression, with a ridge and classes of equal weight, on standardised features of a stretch:
mean and standard deviation of energies by kind of tile, distances, times, avoidance, positions, turns from step to
step, and the correlation of neighbouring samples. A single sample says little; a stretch shows that a robot keeps its
speed, veers, or reads similar energies twice in a row.

The classifier is tested on other robots and other sessions than it was trained on, so it cannot recognise a robot by
its speed or a session by its battery. The result is the balanced accuracy, the mean of the two classes' shares of
correct predictions; 0.5 is chance.

The classifiers of n held-out sessions share most of their training, so that accuracies vary together. The variance of
their mean is taken as s^2 (1 / n + 1 / (n - 1)), s their standard deviation: 1 session is tested, n - 1 are trained on
(Nadeau and Bengio 2003).

Classifier and accuracy are scikit-learn's (extra ``lab``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import polars as pl
from threadpoolctl import threadpool_limits

from vibroswarm.core.arrays import Floats, wrapped
from vibroswarm.core.optional_library import needed
from vibroswarm.lab.calibrate.samples import ROUNDING_S, lag_one
from vibroswarm.statistics.intervals import Interval, bounded_mean

Stretches = dict[int, Floats]
"""Features of one session's stretches by robot: ``columns_of`` each, (stretches, columns)."""
STRETCH: Final = 20
"""Samples of a stretch."""
RIDGE: Final = 3.0
"""Penalty on weights of standardised columns: a prior of standard deviation 0.6."""


def recognised(real: Sequence[pl.DataFrame], simulated: Sequence[pl.DataFrame]) -> Interval | None:
    """Return the balanced accuracy of a classifier of real and simulated sessions, with its interval over real ones.

    Real session i is tested against simulated session i, robot by robot, by classifiers trained on the other robots in
    the other sessions; simulated sessions are used again from the first if there are fewer of them. A session that is
    the only one of its kind is used for the training too.

    Args:
        real, simulated: samples of each session (``samples.by_session``).
    Returns:
        None with fewer than two robots that have a stretch in each session.
    """
    theirs, ours = ([_stretches(session) for session in sessions] for sessions in (real, simulated))
    robots = sorted(set.intersection(*(set(session) for session in (*theirs, *ours))))
    if len(robots) < 2:
        return None
    accuracies = np.array([_held_out(theirs, ours, k, robots) for k in range(len(real))])
    n, mean = accuracies.size, accuracies.mean()
    return bounded_mean(mean + math.sqrt(1.0 + n / max(n - 1, 1)) * (accuracies - mean))


def columns_of(samples: pl.DataFrame) -> Floats:
    """Return the features of a robot's stretches, (stretches, columns).

    Samples without a previous sample or without a time spent avoiding are left out, and so is an incomplete last
    stretch. Energies, times and distances from the wall have skewed distributions, so their logarithms are used, of
    values that are raised to a smallest value far below the usual ones.

    Args:
        samples: samples of one robot in one session, ordered by time (``sample_table``).
    """
    stepped = samples.drop_nulls(["dx_m", "avoid_s"])
    course = np.arctan2(stepped["dy_m"].to_numpy(), stepped["dx_m"].to_numpy())
    columns = {name: stepped[name].to_numpy().astype(float) for name in ("vibrating", "avoid_s")} | {
        "energy": np.log(np.maximum(stepped["energy"].to_numpy(), 0.05)),
        "distance": stepped["distance_m"].to_numpy() / 0.1,  # in units of about the usual distance
        "spacing": np.log(np.maximum(stepped["spacing_s"].to_numpy(), 0.1)),
        "wall": np.log(np.maximum(stepped["wall_m"].to_numpy(), 0.005)),
        "turned": np.append(np.zeros(min(course.size, 1)), wrapped(np.diff(course))),
    }
    rows = []
    for first in range(0, stepped.height - STRETCH + 1, STRETCH):
        one = {name: column[first : first + STRETCH] for name, column in columns.items()}
        on, turned = one["vibrating"] == 1, one["turned"]
        avoided = np.log1p(np.maximum(one["avoid_s"], 0.0))  # often 0, so 1 s is added
        energies = (one["energy"][on], one["energy"][~on])
        spread = (*energies, one["distance"], one["spacing"], avoided, one["wall"], turned)
        rows.append(
            [
                *(part.mean() if part.size else 0.0 for part in spread),
                *(part.std() if part.size else 0.0 for part in spread),
                *(np.median(part) for part in (one["distance"], turned, np.abs(turned))),
                (one["avoid_s"] > ROUNDING_S).mean(),
                on.mean(),
                lag_one(one["energy"]) or 0.0,
                lag_one(one["distance"]) or 0.0,
            ]
        )
    return np.array(rows)


def stretch_classifier() -> Any:
    """Return the untrained classifier of stretches: standardised columns, and a logistic regression with a ridge."""
    pipeline, preprocessing, linear = (
        needed(f"sklearn.{name}", "lab", "calibrate")
        for name in ("pipeline", "preprocessing", "linear_model")
    )
    # Its penalty is |w|^2 / (2 C): C is the inverse of the ridge.
    regression = linear.LogisticRegression(C=1.0 / RIDGE, class_weight="balanced", max_iter=1000)
    return pipeline.make_pipeline(preprocessing.StandardScaler(), regression)


def _stretches(samples: pl.DataFrame) -> Stretches:
    found = {int(key[0]): columns_of(own) for key, own in samples.group_by("robot", maintain_order=True)}
    return {robot: own for robot, own in found.items() if len(own)}


def _held_out(
    real: Sequence[Stretches], simulated: Sequence[Stretches], session: int, robots: Sequence[int]
) -> float:
    """Return the accuracy on real session number ``session`` and one simulated session, mean over robots."""
    other = session % len(simulated)
    rest_real = [one for i, one in enumerate(real) if i != session] or real
    rest_simulated = [one for i, one in enumerate(simulated) if i != other] or simulated
    score = needed("sklearn.metrics", "lab", "calibrate").balanced_accuracy_score
    shares = []
    with threadpool_limits(1):  # threads cost more than they save with so few rows
        for robot in robots:
            others = [one for one in robots if one != robot]
            rows, label = _rows(rest_real, rest_simulated, others)
            tested, truth = _rows([real[session]], [simulated[other]], [robot])
            shares.append(score(truth, stretch_classifier().fit(rows, label).predict(tested)))
    return float(np.mean(shares))


def _rows(
    real: Sequence[Stretches], simulated: Sequence[Stretches], robots: Sequence[int]
) -> tuple[Floats, Floats]:
    """Return the stretches of these robots, (rows, columns), and whether they are simulated, (rows,)."""
    parts = [
        np.concatenate([session[robot] for session in sessions for robot in robots])
        for sessions in (real, simulated)
    ]
    return np.concatenate(parts), np.repeat([0.0, 1.0], [len(part) for part in parts])
