"""Compute the score of a candidate from the figures of its runs; lower is better.

| statistic | score of the runs |
|---|---|
| mean+sd | mean + standard deviation with ddof 0: the paper's (Eq. 22) |
| mean | mean |

| composite objective | score of the runs |
|---|---|
| expected_time_to_right | sum of times / runs with a right consensus, s: the time if runs without one are repeated |
| time_at_error | mean time + T_end (excess of errors / max_error + excess of undecided / max_undecided), s |

The errors of ``time_at_error`` are the share of wrong robots among those that decided, the undecided a share of all
robots; the excess is the part above the limit, at least 0. Cases are the cells of the study, such as several floors;
the score is that of the worst case.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.user_code import errors_in
from vibroswarm.errors import InputError, check_choice, check_kind, check_known_keys, keep_plain, number_of
from vibroswarm.inference.outcomes import Array
from vibroswarm.search import costs
from vibroswarm.search.outcomes import Outcomes
from vibroswarm.statistics.figures import BY_NAME
from vibroswarm.statistics.intervals import (
    Interval,
    draw_limits,
    generator,
    jackknife_error,
    mean_interval,
    wilson,
    within,
)

AIMS: Final = {"expected_time_to_right": (costs.consensus, 2), "time_at_error": (costs.at_error, 5)}
"""Composite objectives, without a statistic: the figures of a run from which they are computed; their number."""
NAMES: Final = (*costs.COSTS, *AIMS)
"""Names of all built-in costs and composite objectives."""
PARAMETERS: Final[dict[str, dict[str, float]]] = {
    "errors": {"false_alarm": costs.WRONG, "miss": costs.WRONG, "undecided": costs.UNDECIDED},
    "time_at_error": {"max_error": 0.05, "max_undecided": 0.10},
}
"""The parameters that each cost takes, with their defaults; the others take none."""
DRAWS: Final = 1000
"""Resamples of a bootstrap."""
LEAST_DIFFERING: Final = 6
"""With fewer runs that differ, from the usual run or from their pairs, a score or difference has no limits: all of
these may favour one side by chance (a sign test of 5 has p = .06)."""
LEAST_SPREAD: Final = 50
"""With fewer runs a mean + sd has no limits: they do not know what seldom happens, such as a wrong consensus."""
NOTHING: Final = 1e-300
"""Least divisor."""

Rows = NDArray[np.float64]
"""Figures of a candidate: (runs, cases, columns)."""


@dataclass(frozen=True)
class Objective:
    """A score to be minimised."""

    name: str = "authors_code"
    """Name of the cost: one of ``NAMES``, or any other name if ``function`` is given."""
    statistic: str = "mean+sd"
    """Statistic over the runs, for costs with one figure per run: ``mean+sd`` or ``mean``."""
    parameters: Mapping[str, float] = field(default_factory=dict)
    """Parameters of the cost by name, see ``PARAMETERS``; those that are left out have their default."""
    function: Callable[[Outcomes], Any] | None = field(default=None, compare=False)
    """A user's cost, from ``Outcomes`` to one number per run. It is never read from a file."""

    def __post_init__(self) -> None:
        keep_plain(self)
        if self.function is None:
            check_choice(self.name, "objective.cost", NAMES)
        elif self.name in NAMES:
            raise InputError(f"'{self.name}' is a built-in cost; choose another name", field="objective.cost")
        check_choice(self.statistic, "objective.statistic", ("mean+sd", "mean"))
        check_known_keys(self.parameters, "objective", PARAMETERS.get(self.name, {}))
        bounds = (1e-9, 1.0) if self.name == "time_at_error" else (0.0, 1e300)
        for name, value in self.parameters.items():
            number_of(value, f"objective.{name}", *bounds)

    def as_values(self) -> dict[str, Any]:
        """Return the table of a search's file from which ``objectives_from`` makes it."""
        return {"cost": self.name, "statistic": self.statistic, **self.parameters}

    @property
    def source(self) -> str:
        """Source text of a user's cost, by which saved runs are known; empty if there is none."""
        with suppress(OSError, TypeError):
            return inspect.getsource(self.function) if self.function else ""
        return ""

    @property
    def words(self) -> str:
        """A short description."""
        name = self.name.replace("_", " ")
        return name if self.name in AIMS else f"{name}, {self.statistic.replace('+', ' + ')}"

    @property
    def width(self) -> int:
        """Number of figures of a run from which the score is computed."""
        return AIMS[self.name][1] if self.name in AIMS else 1

    @property
    def unit(self) -> str:
        """The unit of the score; empty if it has none."""
        if self.name in (*AIMS, "decision_time"):
            return "s"
        return BY_NAME[self.name].unit if self.name in BY_NAME else ""

    def figures(self, outcomes: Outcomes) -> Array:
        """Compute the figures of each run of ``outcomes``, (runs, width)."""
        if self.function is not None:
            place = f"cost '{self.name}'"
            code = getattr(self.function, "__code__", None)
            with errors_in(f"{code.co_filename if code else place}:{self.name}", otherwise=place):
                values = self.function(outcomes)
        elif self.name in AIMS:
            values = AIMS[self.name][0](outcomes)
        else:
            values = costs.COSTS[self.name](outcomes, **self.parameters)
        return costs.check_figures(values, (outcomes.run.size, self.width), f"cost '{self.name}'")

    def score(self, rows: Rows) -> float:
        """Compute the score from the figures ``rows``, (runs, cases, columns), at least those of one run."""
        return max(self._of_case(rows[:, case]) for case in range(rows.shape[1]))

    def interval(self, rows: Rows, level: float = 0.95, seed: int = 0) -> Interval:
        """Compute the score with its confidence interval.

        The interval of a mean is Student's, of a mean + sd a bootstrap-t, of a mean of shares that of the figure, and
        of a composite objective a bootstrap over runs; of several cases that of ``worst_case``. Limits that few runs do
        not give are infinite.
        """
        if (cases := rows.shape[1]) > 1:
            return worst_case(lambda k, at: self.interval(rows[:, k : k + 1], at, seed), cases, level)
        least = 0.0 if self.function is None else -math.inf
        found = within(self._of_one_case(rows, level, seed), least, math.inf)
        return without_limits(found) if (found.low, found.high) == (least, math.inf) else found

    def _of_one_case(self, rows: Rows, level: float, seed: int) -> Interval:
        values, figure = rows[:, 0, 0], None if self.function else BY_NAME.get(self.name)
        if self.name in AIMS:
            found = bootstrap(self.score, rows, level, seed)
            never_right = self.name == "expected_time_to_right" and not rows[:, 0, 1].any()
            return without_limits(found) if never_right else found
        if self.statistic == "mean+sd":
            return self._bootstrap_t(rows, level, seed)
        if figure is not None and figure.kind == "runs":  # 1 in the runs that count, 0 in the others
            return wilson(int(values.sum()), values.size, level)
        if figure is not None and figure.is_share:
            return figure.mean(values, level)
        found = mean_interval(values, level)
        return without_limits(found) if few_differ(values) else found

    def are_too_few(self, runs: int) -> bool:
        """Return whether the score of so many runs has no limits."""
        return runs < (2 if self.name in AIMS or self.statistic == "mean" else LEAST_SPREAD)

    def _bootstrap_t(self, rows: Rows, level: float, seed: int) -> Interval:
        """Compute a mean + sd with the limits score - (quantiles of t*) times its standard error.

        t* is the deviation of a resample's score in its own standard errors. Both are large together where costs are
        skew, which percentiles of the resamples' scores leave out: of 50 exponential costs they are below the true
        score in 12 of 100 searches, of 5 in 28.
        """
        values, estimate = rows[:, 0, 0].copy(), self.score(rows)
        if self.are_too_few(values.size) or few_differ(values):
            return Interval(estimate, -math.inf, math.inf, level, values.size, "bootstrap-t")
        _, error = _mean_sd(values)
        drawn, errors = drawn_scores(_mean_sd, values, seed).T
        with np.errstate(divide="ignore"):  # a resample of equal costs
            t = (drawn - estimate) / errors
        low, high = estimate - error * np.quantile(t, [0.5 + level / 2, 0.5 - level / 2])
        return Interval(estimate, float(low), float(high), level, values.size, "bootstrap-t")

    def estimate(self, rows: Rows) -> tuple[float, float]:
        """Estimate the score of ``rows``, (runs, cases, columns), and the standard error of the estimate.

        Only a mean + sd of one case is corrected for its small-sample bias: the others have none, or are not smooth.
        """
        bias_free, error = corrected(self.score, rows)
        is_smooth = rows.shape[1] == 1 and self.name not in AIMS and self.statistic == "mean+sd"
        return (bias_free if is_smooth else self.score(rows)), error

    def _of_case(self, rows: Array) -> float:
        """Compute the score of one case from its figures, (runs, columns)."""
        if self.name == "expected_time_to_right":
            time_s, right = rows[:, 0].sum(), rows[:, 1].sum()
            # With no right run, half a run counts as right: the score stays finite, and is worse than with one.
            return float(time_s / max(right, 0.5))
        if self.name == "time_at_error":
            return time_at_error(rows, **(PARAMETERS[self.name] | dict(self.parameters)))
        cost = rows[:, 0]
        mean = float(cost.mean())
        return mean if self.statistic == "mean" else mean + float(cost.std())


def time_at_error(rows: Array, max_error: float, max_undecided: float) -> float:
    """Compute the mean time plus the penalty for exceeding the limits, s, from the figures ``costs.at_error``."""
    time_s, wrong, decided, robots = rows[:, :4].sum(axis=0)
    error = wrong / max(decided, 1.0)  # 0 if no robot decided
    undecided = 1.0 - decided / robots
    excess = max(error - max_error, 0.0) / max_error + max(undecided - max_undecided, 0.0) / max_undecided
    t_end_s = rows[0, 4]
    return float(time_s / rows.shape[0] + t_end_s * excess)


def _mean_sd(values: Array) -> tuple[float, float]:
    """Return mean + sd, and its standard error by the influence of each run (the delta method)."""
    mean = values.mean()
    apart = values - mean
    squares = apart**2
    sd = np.sqrt(squares.mean())
    influence = apart + (squares - sd**2) / (2.0 * max(sd, NOTHING))
    return float(mean + sd), float(influence.std(ddof=1)) / math.sqrt(values.size)


def worst_case(of_case: Callable[[int, float], Interval], cases: int, level: float = 0.95) -> Interval:
    """Return the highest figure of several cases, with the highest lower and the highest upper limit of the cases.

    The highest of several estimates is too high. The true value is that of one case, whose upper limit suffices; and at
    least that of each case, so that their lower limits must hold together (Bonferroni). Cases without it (nan) are left
    out.
    """
    alone = [of_case(k, level) for k in range(cases)]
    known = [k for k in range(cases) if not math.isnan(alone[k].estimate)]
    if cases == 1 or not known:
        return alone[0]
    low = max(of_case(k, 1.0 - (1.0 - level) / cases).low for k in known)
    worst = max((alone[k] for k in known), key=lambda found: found.estimate)
    return worst._replace(low=low, high=max(alone[k].high for k in known))


def few_differ(rows: Rows) -> bool:
    """Return whether few runs differ from the usual one, so that others may have been missed by chance."""
    runs = len(rows)
    _, counts = np.unique(rows.reshape(runs, -1), axis=0, return_counts=True)
    others = runs - int(counts.max())
    return others < LEAST_DIFFERING and 2 * others <= runs


def without_limits(found: Interval) -> Interval:
    """Return an interval with infinite limits."""
    return found._replace(low=-math.inf, high=math.inf)


def drawn_scores(score: Callable[[Rows], Any], rows: Rows, seed: int = 0, draws: int = DRAWS) -> Array:
    """Return the score, or several scores, of resamples of the runs with replacement, (draws, ...)."""
    random, runs = generator(seed, "bootstrap of a score"), rows.shape[0]
    return np.array([score(rows[random.integers(0, runs, runs)]) for _ in range(draws)])


def bootstrap(
    score: Callable[[Rows], float], rows: Rows, level: float = 0.95, seed: int = 0, draws: int = DRAWS
) -> Interval:
    """Compute ``score`` of ``rows`` with a percentile bootstrap interval over runs, corrected for the bootstrap bias.

    A resample repeats some runs and lacks others, so that its standard deviation is too low on average. The interval is
    therefore shifted by the difference between the score and the mean score of the resamples, and as much wider as few
    runs need (``draw_limits``). Its limits are infinite with fewer than two runs, or where ``few_differ``.
    """
    runs, estimate = rows.shape[0], score(rows)
    if runs < 2 or few_differ(rows):
        return Interval(estimate, -math.inf, math.inf, level, runs, "bootstrap")
    drawn = drawn_scores(score, rows, seed, draws)
    bias = drawn.mean() - estimate
    low, high = draw_limits(drawn - bias, runs, level)
    return Interval(estimate, low, high, level, runs, "bootstrap")


def corrected(score: Callable[[Rows], float], rows: Rows, groups: int = 10) -> tuple[float, float]:
    """Correct a score for its small-sample bias, and estimate its standard error, by the grouped jackknife.

    Mean + sd of 10 runs is too low by about a tenth. The corrected score is g * score - (g - 1) * mean of the scores
    without one of g groups of successive runs.
    """
    runs, estimate = rows.shape[0], score(rows)
    count = min(groups, runs)
    if count < 2 or not math.isfinite(estimate):
        return estimate, math.inf
    bounds = np.linspace(0, runs, count + 1).astype(np.int64).tolist()
    without = np.array([score(np.concatenate([rows[:low], rows[high:]])) for low, high in pairwise(bounds)])
    return count * estimate - (count - 1) * float(without.mean()), jackknife_error(without)


def objectives_from(block: Any) -> tuple[Objective, ...]:
    """Make objectives from a table of a search's file (cost, statistic, parameters of the cost), or from several."""
    blocks: list[dict[str, Any]] = [dict(block)] if isinstance(block, Mapping) else block
    check_kind(blocks, list, "objective", "a table with a cost, or a list of such tables")
    tables = [{"cost": Objective.name, "statistic": Objective.statistic} | table for table in blocks]
    return tuple(Objective(one.pop("cost"), one.pop("statistic"), one) for one in tables)
