"""Compute forced errors, and compare two strategies at equal error: is one faster, or only wrong more often?

The forced error is the share of robots that would be wrong if all had to answer at the end of the run. A strategy that
decides seldom is wrong seldom, and the forced error charges for that: a robot that guesses has 1/2. Right, wrong and
undecided are still to be given beside it.

Every strategy can be made faster by letting it err more often. So two strategies are compared along what each reaches
with its own settings: the fields of ``fronts.toml``, in all combinations. Each setting is a point (decision time,
forced error); the front joins those that no other beats in both by straight lines. Every point of a line can be
reached: a swarm that draws one of two settings for each run has the mean time and error of both.

| name | symbol | equation |
|---|---|---|
| wrong | W | robots that decided wrong / robots |
| leaning wrong | U | undecided robots whose belief in the truth is below 1/2; half of those at 1/2 or without one |
| forced error | e | W + U / robots |
| matched error | e* | e of the one of the two that errs more, as it was run; both can reach it |
| time at equal error | T(e*) | shortest time of a front at which its error is at most e* |
| difference in time | - | T(e*) of the first - T(e*) of the reference, both along their fronts |
| error at equal time | E(T*) | least error of a front at the time T* of the one that errs more, as it was run |

Limits are percentiles of a bootstrap over runs, drawn once for both strategies, so that the comparison stays paired;
each draw has its own fronts and its own e* and T*. A front that does not reach e* or T* has no value. If more than one
draw in twenty has no value, no limits are given. Both fronts are those of the estimates: the
best of many points are partly lucky, in both strategies alike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from itertools import product
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.cell_summary import ByRun
from vibroswarm.analysis.intervals import Interval, generator
from vibroswarm.analysis.tradeoff import replayed
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.untrusted_files import parsed_toml
from vibroswarm.errors import InputError
from vibroswarm.inference.outcomes import Array, numbers
from vibroswarm.scenario.scenario import Scenario

HALF = 0.5


def forced_errors(decision: NDArray[np.integer], belief_in_truth: Array, truth: Array) -> Array:
    """Return 1 for each robot that is wrong or leans to the wrong side, 1/2 for one that leans to neither, else 0.

    Args:
        decision: 0, 1, or -1 while undecided. belief_in_truth: at the end of the run for an undecided robot; nan: it
            has none. truth: 0 or 1; nan: neither decision is right.
    Returns: shape as they broadcast; nan where the truth is.
    """
    doubt = np.where(np.isnan(belief_in_truth), HALF, 1.0 - belief_in_truth)
    leaning = np.where(doubt > HALF, 1.0, np.where(doubt < HALF, 0.0, HALF))
    errors = np.where(decision == -1, leaning, decision != truth)
    return np.where(np.isnan(truth), np.nan, errors)


def forced_error_by_robot(robots: pl.DataFrame, runs: pl.DataFrame) -> Array:
    """Compute ``forced_errors`` of the rows of a table of robots.

    Args:
        robots, runs: tables of one cell, as a ``Result`` has them.
    Returns: (rows of robots,).
    """
    truth = robots.select("run").join(
        runs.select("run", "truth"), on="run", how="left", maintain_order="left"
    )
    return forced_errors(
        robots["decision"].to_numpy(), numbers(robots["belief_in_truth"]), numbers(truth["truth"])
    )


def forced_error_by_run(robots: pl.DataFrame, runs: pl.DataFrame) -> pl.DataFrame:
    """Average ``forced_errors`` over the robots of each run.

    Args:
        robots, runs: tables of one cell, as a ``Result`` has them.
    Returns: run, forced_error (null where no decision is right), by run.
    """
    errors = pl.Series("forced_error", forced_error_by_robot(robots, runs), nan_to_null=True)
    by_run = robots.select("run").with_columns(errors).sort("run").group_by("run", maintain_order=True)
    return by_run.agg(pl.col("forced_error").mean())


DRAWS: Final = 1000
LEAST_KNOWN: Final = 0.95
"""Least share of draws with a value for which limits are given."""
BATCH: Final = 100
DEFAULT: Final[dict[str, tuple[Any, ...]]] = {
    "decision.credible_threshold": (0.7, 0.8, 0.9, 0.95, 0.98, 0.995),
    "decision.min_observations": (0, 100, 250, 417),
}
"""Settings of strategies that ``fronts.toml`` does not list."""


@dataclass(frozen=True)
class Reached(NotebookView):
    """Decision time, s, and forced error of each setting in each run, (points, runs); point 0: the scenario itself."""

    time_s: Array
    error: Array


@dataclass(frozen=True)
class MatchedError(NotebookView):
    """Two strategies at equal error, and at equal time; times in s, errors as shares."""

    of_first: bool
    """Whether the first errs more, so that its error and time as it was run are those compared at."""
    error: float
    """Forced error at which times are compared."""
    time_s: float
    """Decision time at which errors are compared."""
    time_difference_s: Interval
    """First - reference, at equal error; nan if a front does not reach it."""
    error_difference: Interval
    """First - reference, at equal time; nan if a front does not reach it."""


def front_settings() -> dict[str, dict[str, Any]]:
    """Return, by strategy, the fields by which it trades time against error, with their values."""
    text = files("vibroswarm.analysis").joinpath("fronts.toml").read_text(encoding="utf-8")
    return parsed_toml(text, "fronts.toml")


def reached(scenario: Scenario, seed: int, runs: Sequence[int]) -> Reached:
    """Replay a scenario with each of its strategy's settings, on the same motion and readings.

    Args:
        scenario: its strategy must not steer. seed, runs: as ``simulate`` has them.
    Raises:
        InputError: no setting can be run, or in a run no decision is right.
    """
    base = scenario.with_values({"run.stop": "t_end"})
    fields: Mapping[str, Sequence[Any]] = front_settings().get(base.strategy.name, DEFAULT)
    points = [base]
    for values in product(*fields.values()):
        try:
            points.append(base.with_values(dict(zip(fields, values, strict=True))))
        except InputError:  # a setting that this scenario refuses
            continue
    time_s, error = np.empty((len(points), len(runs))), np.empty((len(points), len(runs)))
    at = 0
    for part in replayed(base, points, seed, runs, BATCH, 1):
        for k, (robots, of_runs) in enumerate(part):
            by_run = ByRun(robots)
            chosen = slice(at, at + by_run.runs.size)
            time_s[k, chosen] = by_run.mean(by_run.capped_time_s(base.run.t_end_s))
            error[k, chosen] = by_run.mean(forced_error_by_robot(by_run.robots, of_runs))
        at += by_run.runs.size
    if np.isnan(error).any():
        raise InputError("in some runs no decision is right", field="floor")
    return Reached(time_s, error)


def matched_error(first: Reached, reference: Reached, seed: int = 0) -> MatchedError:
    """Compare two strategies at the error, and at the time, of the one that errs more as it was run.

    Args:
        first, reference: on the same runs. seed: of the bootstrap.
    """
    runs = reference.time_s.shape[1]
    rng = generator(seed, "matched error")
    weights = rng.multinomial(runs, np.full(runs, 1.0 / runs), size=DRAWS) / runs
    times, errors = np.empty(DRAWS + 1), np.empty(DRAWS + 1)
    means = [
        tuple(np.column_stack([each.mean(axis=1), each @ weights.T]) for each in (one.time_s, one.error))
        for one in (first, reference)
    ]
    of_first = bool(means[0][1][0, 0] > means[1][1][0, 0])
    time_as_run, error_as_run = (each[0] for each in means[0 if of_first else 1])
    for draw in range(DRAWS + 1):
        fronts = [front_of(time_s[:, draw], error[:, draw]) for time_s, error in means]
        at_error = [_least(error_as_run[draw], y[::-1], x[::-1]) for x, y in fronts]
        at_time = [_least(time_as_run[draw], x, y) for x, y in fronts]
        times[draw], errors[draw] = at_error[0] - at_error[1], at_time[0] - at_time[1]
    return MatchedError(
        of_first, float(error_as_run[0]), float(time_as_run[0]), _limits(times, runs), _limits(errors, runs)
    )


def _least(value: float, x: Array, y: Array) -> float:
    """Return the least y that a front has up to x = ``value``; nan if all x are larger. ``x`` rises, ``y`` falls."""
    return float(y[-1]) if value > x[-1] else on_line(value, x, y)


def _limits(values: Array, runs: int) -> Interval:
    """Return the estimate ``values[0]`` with the 95 % percentile interval of its bootstrap draws ``values[1:]``.

    The limits are NaN if the estimate is, or if less than ``LEAST_KNOWN`` of the draws are numbers.
    """
    drawn = values[1:][~np.isnan(values[1:])]
    is_enough = drawn.size >= LEAST_KNOWN * DRAWS and not math.isnan(values[0])
    low, high = np.quantile(drawn, (0.025, 0.975)) if is_enough else (np.nan, np.nan)
    return Interval(float(values[0]), float(low), float(high), 0.95, runs, "bootstrap of fronts")


def front_of(time_s: Array, error: Array) -> tuple[Array, Array]:
    """Return the points that no other beats in both, by rising time and falling error.

    Args:
        time_s, error: (points,) each.
    """
    order = np.lexsort((error, time_s))
    x, y = time_s[order], error[order]
    best = np.minimum.accumulate(y)
    keep = np.append(True, y[1:] < best[:-1])
    return x[keep], y[keep]


def on_line(value: float, x: Array, y: Array) -> float:
    """Interpolate y at a value of x, which rises; nan beyond its ends."""
    return float(np.interp(value, x, y)) if x[0] <= value <= x[-1] else np.nan
