"""Compute the score of a candidate from the figures of its runs; lower is better.

| statistic | score of the runs |
|---|---|
| mean+sd | mean + standard deviation with ddof 0: the paper's |
| mean | mean |

| composite objective | score of the runs |
|---|---|
| expected_time_to_right | sum of times / runs with a right consensus, s: the time if runs without one are repeated |
| time_at_error | mean time + T_end (excess of errors / max_error + excess of undecided / max_undecided), s |

The errors of ``time_at_error`` are the share of wrong robots among those that decided, the undecided a share of all
robots; the excess is the part above the limit, at least 0.

Cases are the cells of the study, such as several floors. The score is that of the worst case, or the mean over cases.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.user_code import errors_in
from vibroswarm.errors import InputError, check_choice, keep_plain, nearest, number_of, shown
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
"""Composite objectives: the figures of a run from which their score is computed, without a statistic; their number."""
NAMES: Final = (*costs.COSTS, *AIMS)
"""Names of all built-in costs and composite objectives."""
OVER: Final = ("worst", "mean")
"""How the scores of several cases become one: the worst of them, or their mean."""
PARAMETERS: Final[dict[str, tuple[str, ...]]] = {
    "errors": ("false_alarm", "miss", "undecided"),
    "time_at_error": ("max_error", "max_undecided"),
}
"""The parameters that each cost takes; the others take none."""
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
    """A score to be minimised.

    Raises:
        InputError: unknown name, statistic or parameter.
    """

    name: str = "authors_code"
    """Name of the cost: one of ``NAMES``, or any other name if ``function`` is given."""
    statistic: str = "mean+sd"
    """Statistic over the runs, for costs with one figure per run: ``mean+sd`` or ``mean``."""
    over: str = "worst"
    """Whether the score is that of the ``worst`` case, or the ``mean`` over cases."""
    parameters: Mapping[str, float] = field(default_factory=dict)
    """Parameters of the cost by name, see ``PARAMETERS``; those that are left out have their default."""
    function: Callable[[Outcomes], Any] | None = field(default=None, compare=False)
    """A user's cost, from ``Outcomes`` to one number per run. It is never read from a file."""

    def __post_init__(self) -> None:
        """Check all fields.

        Raises:
            InputError: naming the field that is wrong.
        """
        keep_plain(self)
        if self.function is not None and self.name in NAMES:
            raise InputError(f"'{self.name}' is a built-in cost; choose another name", field="objective.cost")
        if self.function is None:
            check_choice(self.name, "objective.cost", NAMES)
        check_choice(self.over, "objective.over", OVER)
        check_choice(self.statistic, "objective.statistic", ("mean+sd", "mean"))
        known = PARAMETERS.get(self.name, ())
        for name, value in self.parameters.items():
            if name not in known:
                raise InputError(f"the cost '{self.name}' has no such parameter{nearest(name, known)}",
                                 field=f"objective.{name}")  # fmt: skip
            number_of(value, f"objective.{name}")
            if self.name == "time_at_error" and not 0 < value < 1:
                raise InputError(
                    f"{value!r} is not a share; give one between 0 and 1", field=f"objective.{name}"
                )

    @classmethod
    def of(cls, block: Mapping[str, Any]) -> Objective:
        """Make an objective from the table ``block`` of a search's file.

        Its keys are ``cost``, ``statistic`` and ``over``, all optional; every other key is a parameter of the cost.

        Raises:
            InputError: the cost, statistic or parameter does not exist, or has a wrong value.
        """
        values = dict(block)
        named = {"name": values.pop("cost", "authors_code")}
        named |= {key: values.pop(key) for key in ("statistic", "over") if key in values}
        return cls(**named, parameters=values)

    def as_values(self) -> dict[str, Any]:
        """Return the table that ``of`` reads."""
        return {"cost": self.name, "statistic": self.statistic, "over": self.over, **self.parameters}

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
    def limits(self) -> dict[str, float]:
        """The limits of ``time_at_error``, up to which there is no penalty; empty for other costs.

        The names are those of the figures that ``validation`` compares with the limits. ``robot_error`` limits the
        share of wrong robots among those that decided, ``robots_undecided`` the share of undecided robots among all.
        """
        if self.name != "time_at_error":
            return {}
        return {
            "robot_error": self.parameters.get("max_error", 0.05),
            "robots_undecided": self.parameters.get("max_undecided", 0.10),
        }

    @property
    def width(self) -> int:
        """Number of figures of a run from which the score is computed, see ``figures``."""
        return AIMS[self.name][1] if self.name in AIMS else 1

    @property
    def unit(self) -> str:
        """The unit of the score; empty if it has none."""
        is_time = self.name in (*AIMS, "decision_time") or (
            self.name in BY_NAME and BY_NAME[self.name].unit == "s"
        )
        return "s" if is_time else ""

    def figures(self, outcomes: Outcomes) -> Array:
        """Compute the figures of each run of ``outcomes``, (runs, columns).

        Most costs have one column. ``expected_time_to_right`` has the two of ``costs.consensus``; ``time_at_error`` has
        the five of ``costs.at_error``.

        Raises:
            InputError: the cost gives no finite number for a run, or is not defined on these outcomes.
            CodeError: a user's cost failed.
        """
        if self.function is not None:
            place = f"cost '{self.name}'"
            code = getattr(self.function, "__code__", None)
            with errors_in(f"{code.co_filename if code else place}:{self.name}", otherwise=place):
                figures = self.function(outcomes)
            return costs.check_figures(figures, outcomes.run.size, place)
        if self.name in AIMS:
            figures, _ = AIMS[self.name]
            return figures(outcomes)
        # the only built-in cost with parameters, apart from ``time_at_error`` above
        parameters = dict(self.parameters) if self.name == "errors" else {}
        return costs.check_figures(
            costs.COSTS[self.name](outcomes, **parameters), outcomes.run.size, self.name
        )

    def score(self, rows: Rows) -> float:
        """Compute the score from the figures ``rows``, (runs, cases, columns); without runs it is infinite.

        ``rows`` has only the columns of this objective.
        """
        if rows.shape[0] == 0:
            return math.inf
        by_case = [self._of_case(rows[:, case]) for case in range(rows.shape[1])]
        return max(by_case) if self.over == "worst" else float(np.mean(by_case))

    def interval(self, rows: Rows, level: float = 0.95, seed: int = 0) -> Interval:
        """Compute the score with its confidence interval.

        With one case and at least two runs, the interval of a mean is Student's, that of a mean of shares
        ``bounded_mean``, and that of a share of runs Wilson's. That of a
        mean + sd is a bootstrap-t. Every other interval is a bootstrap over runs. The limits of the worst of several
        cases are the highest of the cases. A score that cannot be negative has no finite limit below 0. Student's
        limits and those of a bootstrap are infinite where ``few_differ``, those of a mean + sd with fewer than
        ``LEAST_SPREAD`` runs, and those of ``expected_time_to_right`` where no run of a case is right.

        Args:
            rows: figures of the runs, (runs, cases, columns). level: of confidence. seed: of the bootstrap.
        """
        runs, cases = rows.shape[:2]
        if cases > 1 and self.over == "worst":
            return self._clipped(
                worst_case(lambda k, at: self.interval(rows[:, k : k + 1], at, seed), cases, level)
            )
        if cases == 1 and self.name not in AIMS and runs > 1 and self.statistic == "mean":
            return self._mean_interval(rows[:, 0, 0], level)
        if self.statistic == "mean+sd" and self.name not in AIMS:
            found = self._bootstrap_t(rows, level, seed)
        else:
            found = bootstrap(self.score, rows, level, seed)
        if self.name == "expected_time_to_right" and not rows[:, :, 1].any(axis=0).all():
            found = without_limits(found)
        return self._clipped(found)

    def are_too_few(self, runs: int) -> bool:
        """Return whether the score of so many runs has no limits, whatever their costs are."""
        return runs < (2 if self.name in AIMS or self.statistic == "mean" else LEAST_SPREAD)

    def _bootstrap_t(self, rows: Rows, level: float, seed: int) -> Interval:
        """Compute a mean + sd with the limits score - (quantiles of t*) times its standard error.

        t* is the deviation of a resample's score in its own standard errors. Both are large together where costs are
        skew, which percentiles of the resamples' scores leave out: of 50 exponential costs they are below the true
        score in 12 of 100 searches, of 5 in 28.
        """
        runs, estimate = rows.shape[0], self.score(rows)
        if self.are_too_few(runs) or few_differ(rows[:, :, :1]):
            return Interval(estimate, -math.inf, math.inf, level, runs, "bootstrap-t")
        _, error = self._mean_sd(rows)
        drawn, errors = drawn_scores(self._mean_sd, rows, seed).T
        with np.errstate(divide="ignore"):  # a resample of equal costs
            t = (drawn - estimate) / errors
        low, high = estimate - error * np.quantile(t, [0.5 + level / 2, 0.5 - level / 2])
        return Interval(estimate, float(low), float(high), level, runs, "bootstrap-t")

    def _mean_sd(self, rows: Rows) -> tuple[float, float]:
        """Return ``score``, mean + sd, and its standard error by the influence of each run (the delta method).

        Thousands of resamples are scored, so that the mean and the deviations of both are computed once.
        """
        of_cases = np.ascontiguousarray(rows[:, :, 0].T)
        means = of_cases.mean(axis=1, keepdims=True)
        apart = of_cases - means
        squares = apart**2
        sd = np.sqrt(squares.mean(axis=1, keepdims=True))
        influence = apart + (squares - sd**2) / (2.0 * np.maximum(sd, NOTHING))
        by_case = (means + sd)[:, 0]
        return float(by_case.mean()), float(influence.mean(axis=0).std(ddof=1)) / math.sqrt(len(rows))

    @property
    def _least(self) -> float:
        """The least value of a score: 0, but for a user's cost and negative prices."""
        may_be_negative = self.function is not None or min(self.parameters.values(), default=0.0) < 0.0
        return -math.inf if may_be_negative else 0.0

    def _clipped(self, found: Interval) -> Interval:
        """Return limits that are no lower than a score can be; limits that then say nothing are infinite."""
        clipped = within(found, self._least, math.inf)
        return without_limits(found) if clipped[1:3] == (self._least, math.inf) else clipped

    def _mean_interval(self, values: Array, level: float) -> Interval:
        """Compute the mean of one figure of each run, (runs,), with its interval."""
        figure = BY_NAME.get(self.name)
        if figure is None or self.function is not None or not figure.is_share:
            found = mean_interval(values, level)
            return without_limits(found) if few_differ(values) else self._clipped(found)
        if figure.kind == "runs":  # 1 in the runs that count, 0 in the others
            return wilson(int(values.sum()), values.size, level)
        return figure.mean(values, level)

    def estimate(self, rows: Rows) -> tuple[float, float]:
        """Estimate the score of ``rows``, (runs, cases, columns), and the standard error of the estimate.

        Only the statistic mean + sd, with one case or averaged over cases, is corrected for its small-sample bias. A
        mean has no bias. The other scores are not smooth in the data (the worst case, a penalty above a limit), so that
        the correction would be unstable.
        """
        averaged = rows.shape[1] == 1 or self.over == "mean"
        bias_free, error = corrected(self.score, rows)
        needs_correction = averaged and self.name not in AIMS and self.statistic == "mean+sd"
        return (bias_free if needs_correction else self.score(rows)), error

    def _of_case(self, rows: Array) -> float:
        """Compute the score of one case from its figures, (runs, columns)."""
        if self.name == "expected_time_to_right":
            time_s, right = rows[:, 0].sum(), rows[:, 1].sum()
            # With no right run, half a run counts as right: the score stays finite, and is worse than with one.
            return float(time_s / max(right, 0.5))
        if self.name == "time_at_error":
            return self._time_at_error(rows)
        cost = rows[:, 0]
        mean = float(cost.mean())
        return mean if self.statistic == "mean" else mean + float(cost.std())  # Eq. 22

    def _time_at_error(self, rows: Array) -> float:
        """Compute the score of ``time_at_error``: the mean time plus the penalty for exceeding the limits, s.

        The columns of ``rows``, (runs, 5), are the mean time over robots, s; the numbers of wrong, decided and all
        robots; and T_end, s, which is the same in all runs.
        """
        time_s, wrong, decided, robots = rows[:, :4].sum(axis=0)
        max_error, max_undecided = self.limits.values()  # in the order in which ``limits`` lists them
        error = wrong / max(decided, 1.0)  # 0 if no robot decided
        undecided = 1.0 - decided / robots
        excess = max(error - max_error, 0.0) / max_error + max(undecided - max_undecided, 0.0) / max_undecided
        t_end_s = rows[0, 4]
        return float(time_s / rows.shape[0] + t_end_s * excess)


def worst_case(of_case: Callable[[int, float], Interval], cases: int, level: float = 0.95) -> Interval:
    """Return the highest figure of several cases, with the highest lower and the highest upper limit of the cases.

    The highest of several estimates is too high: a bootstrap of it is above the true value of five equal cases in up to
    24 of 100 searches. The true value is that of one case, whose upper limit suffices; and at least that of each case,
    so that their lower limits must hold together (Bonferroni). Cases without the figure (nan) are left out.

    Args:
        of_case: computes the figure of a case, by its place, at a level of confidence.
    """
    alone = [of_case(k, level) for k in range(cases)]
    known = [k for k in range(cases) if not math.isnan(alone[k].estimate)]
    if cases == 1 or not known:
        return alone[0]
    low = max(of_case(k, 1.0 - (1.0 - level) / cases).low for k in known)
    worst = max((alone[k] for k in known), key=lambda found: found.estimate)
    return worst._replace(low=low, high=max(alone[k].high for k in known))


def few_differ(rows: Rows) -> bool:
    """Return whether fewer than ``LEAST_DIFFERING`` runs, and at most half of them, differ from the usual run.

    Limits from such runs would be too narrow, of width 0 if all are alike: others may have been missed by chance.

    Args:
        rows: figures, with runs along the first axis.
    """
    runs = len(rows)
    _, counts = np.unique(rows.reshape(runs, -1), axis=0, return_counts=True)
    others = runs - int(counts.max())
    return others < LEAST_DIFFERING and 2 * others <= runs


def without_limits(found: Interval) -> Interval:
    """Return an interval with infinite limits: that its estimate cannot be said to have any."""
    return found._replace(low=-math.inf, high=math.inf)


def drawn_scores(score: Callable[[Rows], Any], rows: Rows, seed: int = 0, draws: int = DRAWS) -> Array:
    """Return the score, or several scores, of resamples of the runs with replacement, (draws, ...)."""
    random, runs = generator(seed, "bootstrap of a score"), rows.shape[0]
    return np.array([score(rows[random.integers(0, runs, runs)]) for _ in range(draws)])


def bootstrap(
    score: Callable[[Rows], float], rows: Rows, level: float = 0.95, seed: int = 0, draws: int = DRAWS
) -> Interval:
    """Compute ``score`` of ``rows`` with a percentile bootstrap interval over runs, corrected for the bootstrap bias.

    A resample repeats some runs and lacks others, so that its standard deviation is too low on average. The score of
    resamples, and with it the interval, would then be too low as well. The interval is therefore shifted by the
    difference between the score and the mean score of the resamples, and as much wider as few runs need
    (``draw_limits``).

    Args:
        score: computes the score of figures. rows: the figures, with runs along the first axis.
        level: of confidence. seed: of the resampling. draws: number of resamples.
    Returns:
        The interval; its limits are infinite with fewer than two runs, or where ``few_differ``.
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

    The jackknife scores the runs several times, each time without one group of runs. The bias matters: mean + sd of 10
    runs is too low by about a tenth, so that candidates with few runs would look better than others.

    Args:
        score: computes the score of figures. rows: the figures, with runs along the first axis.
        groups: number of groups, each of successive runs; with fewer runs, each run is a group.
    Returns:
        The corrected score and its standard error. With fewer than two runs, or if the score is not finite, the score
        is returned as it is, with an infinite error.
    """
    runs = rows.shape[0]
    count = min(groups, runs)
    estimate = score(rows)
    if count < 2:
        return estimate, math.inf
    bounds = np.linspace(0, runs, count + 1).astype(np.int64)
    keep = np.ones(runs, dtype=np.bool_)
    without_group = np.empty(count)
    for g in range(count):
        keep[bounds[g] : bounds[g + 1]] = False
        without_group[g] = score(rows[keep])
        keep[bounds[g] : bounds[g + 1]] = True
    if not math.isfinite(estimate):  # differences of infinite scores would be nan
        return estimate, math.inf
    # Jackknife with g groups: the corrected score is ``g * score_of_all - (g - 1) * mean``, where ``mean`` is that of
    # the g scores without one group.
    mean = float(without_group.mean())
    return count * estimate - (count - 1) * mean, jackknife_error(without_group)


def objectives_from(block: Any) -> tuple[Objective, ...]:
    """Make one objective from a table of a search's file, or several from a list of tables; see ``Objective.of``.

    Raises:
        InputError: ``block`` is neither, or a table is wrong.
    """
    if isinstance(block, Mapping):
        return (Objective.of(block),)
    many = isinstance(block, Sequence) and not isinstance(block, str)
    if many and block and all(isinstance(entry, Mapping) for entry in block):
        return tuple(Objective.of(entry) for entry in block)
    raise InputError(
        f"{shown(block)} is wrong; give a table with a cost, or a list of such tables", field="objective"
    )
