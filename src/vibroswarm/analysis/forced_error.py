"""Compute forced errors, and compare two strategies at equal error: is one faster, or only wrong more often?

The forced error is the share of robots that would be wrong if every undecided robot had to decide at the end of the run
by its belief. A strategy that seldom decides is seldom wrong; the forced error also counts what its undecided robots
would get wrong (1/2 for a robot without a belief). Report the shares right, wrong and undecided with it.

Every strategy can be made faster by letting it err more often. So two strategies are compared over the settings of
each: all combinations of the values that ``fronts.toml`` lists for its fields. Each setting is a point (decision time,
forced error). The front consists of the points for which no other point is at least as good in both, joined by straight
lines. Every point of a line can be reached: a swarm that draws one of two settings for each run has a weighted mean of
their times and of their errors.

| name | symbol | equation |
|---|---|---|
| wrong | W | robots that decided wrong / robots |
| leaning wrong | U | undecided robots with a belief in the truth below 1/2, + half of those at 1/2 or without belief |
| forced error | e | W + U / robots |
| matched error, time | e*, T* | of the strategy that errs more with its own settings (point 0) |
| time at equal error | T(e*) | shortest time on a front at which the error is at most e* |
| difference in time | - | T(e*) of the first - T(e*) of the reference, each on its own front |
| error at equal time | E(T*) | smallest error on a front at a time of at most T* |

Limits are percentiles of a bootstrap over runs. The same draws of runs serve both strategies, so that the comparison
stays paired; each draw has its own fronts and its own e* and T*. Where a front does not reach e* in a draw, its time is
infinite; so a limit is infinite if that happens in more than one draw in 40. The error of a draw is undefined if a
front does not reach T*; if more than one draw in twenty is undefined, no limits are given. The best of many points are
partly lucky, so both fronts are somewhat too good; with fewer than ``FEWEST`` runs the luck is larger than the limits,
and none are given (with 100 runs they missed up to 3 in 10 true differences, with 300 at most 1 in 10).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from itertools import product
from typing import Any, Final

import numpy as np

from vibroswarm.analysis.intervals import Interval
from vibroswarm.analysis.paired import DRAWS, drawn_interval, drawn_means
from vibroswarm.core.untrusted_files import parsed_toml
from vibroswarm.errors import InputError
from vibroswarm.inference.outcomes import Array
from vibroswarm.scenario.scenario import Scenario

DEFAULT: Final[dict[str, tuple[Any, ...]]] = {
    "decision.credible_threshold": (0.7, 0.8, 0.9, 0.95, 0.98, 0.995),
    "decision.min_observations": (0, 100, 250, 417),
}
"""Settings of strategies that ``fronts.toml`` does not list."""


@dataclass(frozen=True)
class Reached:
    """Decision time (s) and forced error of each point (setting) in each run, both of shape (points, runs).

    Point 0 is the scenario as given.
    """

    time_s: Array
    error: Array

    @property
    def is_fixed(self) -> bool:
        """Whether all points are the same: the strategy uses none of the settings that were tried."""
        return bool((self.time_s == self.time_s[0]).all() and (self.error == self.error[0]).all())


@dataclass(frozen=True)
class MatchedError:
    """Two strategies at equal error, and at equal time; times in s, errors as shares."""

    of_first: bool
    """Whether the first strategy, as given, errs more than the reference, so that e* and T* are its error and time."""
    error: float
    """e*, the forced error at which times are compared."""
    time_s: float
    """T*, the decision time at which errors are compared."""
    time_difference_s: Interval
    """First - reference, at equal error; a limit is infinite if the strategy that errs less may not reach it."""
    error_difference: Interval
    """First - reference, at equal time; nan if a front does not reach it."""
    as_run: bool = False
    """Whether no setting changes what the strategy that errs more does, so that it is compared only as it was run."""


FEWEST: Final = 300
"""Least number of runs for which there are limits."""
METHOD: Final = "bootstrap of fronts"
"""Name of the method by which limits are computed."""


def front_settings() -> dict[str, dict[str, Any]]:
    """Read ``fronts.toml``: for each strategy the fields that trade time against error, and the values to try."""
    text = files("vibroswarm.analysis").joinpath("fronts.toml").read_text(encoding="utf-8")
    return parsed_toml(text, "fronts.toml")


def settings_of(scenario: Scenario) -> list[Scenario]:
    """Return a scenario that runs to t_end, and then the same with each combination of its strategy's settings.

    A combination that the scenario refuses is left out.
    """
    base = scenario.with_values({"run.stop": "t_end"})
    fields: Mapping[str, Sequence[Any]] = front_settings().get(base.strategy.name, DEFAULT)
    points = [base]
    for values in product(*fields.values()):
        try:
            points.append(base.with_values(dict(zip(fields, values, strict=True))))
        except InputError:  # a setting that this scenario refuses
            continue
    return points


def matched_error(first: Reached, reference: Reached, seed: int = 0) -> MatchedError:
    """Compare two strategies at the error, and at the time, of the strategy that errs more as given (point 0).

    Args:
        first, reference: on the same runs. seed: seed of the bootstrap.
    """
    runs = reference.time_s.shape[1]
    time_means, error_means = (
        [drawn_means(values, seed, "matched error") for values in of_both]
        for of_both in ((first.time_s, reference.time_s), (first.error, reference.error))
    )
    # Lists: index 0 is the first strategy, 1 the reference. Arrays: row 0 is the strategy as given, column 0 all runs.
    # The strategy that errs more in all runs gives e* and T* of every draw.
    of_first = bool(error_means[0][0, 0] > error_means[1][0, 0])
    matched = 0 if of_first else 1
    time_as_given, error_as_given = time_means[matched][0], error_means[matched][0]
    time_differences_s, error_differences = np.full((2, DRAWS + 1), np.nan)
    # Draw 0 is the estimate from all runs; the others are bootstrap draws.
    for draw in range(DRAWS + 1 if runs >= FEWEST else 1):
        fronts = [
            front_of(time_s[:, draw], error[:, draw])
            for time_s, error in zip(time_means, error_means, strict=True)
        ]
        # ``_least`` wants rising x and falling y. Along a front time rises and error falls; so the front is reversed to
        # look up the time at an error.
        time_at_error = [_least(error_as_given[draw], error[::-1], time_s[::-1]) for time_s, error in fronts]
        error_at_time = [_least(time_as_given[draw], time_s, error) for time_s, error in fronts]
        time_differences_s[draw] = np.subtract(*np.nan_to_num(time_at_error, nan=np.inf))
        error_differences[draw] = error_at_time[0] - error_at_time[1]
    return MatchedError(
        of_first=of_first,
        error=float(error_as_given[0]),
        time_s=float(time_as_given[0]),
        time_difference_s=drawn_interval(time_differences_s, runs, METHOD),
        error_difference=drawn_interval(error_differences, runs, METHOD),
        as_run=(first, reference)[matched].is_fixed,
    )


def _least(value: float, x: Array, y: Array) -> float:
    """Return the smallest y of a front at x of at most ``value``; nan if all x are larger. ``x`` rises, ``y`` falls."""
    return float(y[-1]) if value > x[-1] else on_line(value, x, y)


def front_of(time_s: Array, error: Array) -> tuple[Array, Array]:
    """Return the times and errors of the points on the front, sorted by rising time.

    A point is left out if another point is at least as good in both figures; of equal points one is kept.

    Args:
        time_s, error: of each point, (points,) each.
    """
    order = np.lexsort((error, time_s))  # by time, at equal times by error
    x, y = time_s[order], error[order]
    best = np.minimum.accumulate(y)
    # The fastest point is on the front. Any other point is on it if its error is below the errors of all faster points.
    on_front = np.append(True, y[1:] < best[:-1])
    return x[on_front], y[on_front]


def on_line(value: float, x: Array, y: Array) -> float:
    """Interpolate y linearly at x = ``value``; nan outside the range of ``x``, which rises."""
    return float(np.interp(value, x, y)) if x[0] <= value <= x[-1] else np.nan
