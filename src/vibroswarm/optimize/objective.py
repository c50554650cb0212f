"""Compute the score of a candidate from the figures of its runs; lower is better.

| statistic | score of the runs |
|---|---|
| mean+sd | mean + standard deviation with ddof 0: the paper's |
| mean | mean |
| quantile 0.9 | the ceil(0.9 n)-th smallest |

| composite objective | score of the runs |
|---|---|
| expected_time_to_right | sum of times / runs with a right consensus, s: a failed inspection is repeated |
| time_at_error | mean time + T_end (excess of errors / max_error + excess of undecided / max_undecided), s |

Cases are the cells of the study, such as several floors. The score is that of the worst case, or the mean over cases.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import Interval, generator, mean_interval, quantile_interval
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError, check_choice, nearest, number_of
from vibroswarm.inference.outcomes import Array
from vibroswarm.optimize import costs
from vibroswarm.optimize.outcomes import Outcomes

AIMS: Final = ("expected_time_to_right", "time_at_error")
NAMES: Final = (*costs.COSTS, *AIMS)
OVER: Final = ("worst", "mean")
PARAMETERS: Final[dict[str, tuple[str, ...]]] = {
    "errors": ("false_alarm", "miss", "undecided"),
    "time_at_error": ("max_error", "max_undecided"),
}
DRAWS: Final = 1000

Rows = NDArray[np.float64]
"""Figures of a candidate: (runs, cases, columns)."""


@dataclass(frozen=True)
class Objective(NotebookView):
    """A score to be minimised.

    Args:
        name: one of ``NAMES``; with a function any other.
        statistic: ``mean+sd``, ``mean`` or ``quantile Q``, for costs of one figure per run.
        over: the ``worst`` case, or the ``mean`` over cases.
        parameters: of the cost, see ``costs`` and above.
        function: a user's cost, from ``Outcomes`` to one number per run. Never read from a file.
    Raises:
        InputError: unknown name, statistic or parameter.
    """

    name: str = "authors_code"
    statistic: str = "mean+sd"
    over: str = "worst"
    parameters: Mapping[str, float] = field(default_factory=dict)
    function: Callable[[Outcomes], Any] | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if self.function is not None and self.name in NAMES:
            raise InputError(f"'{self.name}' is a built-in cost; choose another name", field="objective.cost")
        if self.function is None:
            check_choice(self.name, "objective.cost", NAMES)
        check_choice(self.over, "objective.over", OVER)
        self._quantile()
        known = PARAMETERS.get(self.name, ())
        for name, value in self.parameters.items():
            if name not in known:
                raise InputError(f"the cost '{self.name}' has no such parameter{nearest(name, known)}",
                                 field=f"objective.{name}")  # fmt: skip
            number_of(value, f"objective.{name}")
            if self.name == "time_at_error" and not 0 < value < 1:
                raise InputError(f"{value!r} is not a share; give one above 0", field=f"objective.{name}")

    @classmethod
    def of(cls, block: Mapping[str, Any]) -> Objective:
        """Make an objective from a table, the ``block``, with the cost's name, statistic and parameters.

        Raises:
            InputError: no such cost, statistic or parameter.
        """
        values = dict(block)
        named = {"name": values.pop("cost", "authors_code")}
        named |= {key: values.pop(key) for key in ("statistic", "over") if key in values}
        for key, value in named.items():
            if not isinstance(value, str):
                key = "cost" if key == "name" else key
                raise InputError(f"{value!r} is not a text", field=f"objective.{key}")
        return cls(**named, parameters=values)

    def as_values(self) -> dict[str, Any]:
        """Return the table that ``of`` reads."""
        return {"cost": self.name, "statistic": self.statistic, "over": self.over, **self.parameters}

    @property
    def words(self) -> str:
        """A short description."""
        name = self.name.replace("_", " ")
        return name if self.name in AIMS else f"{name}, {self.statistic.replace('+', ' + ')}"

    @property
    def limits(self) -> dict[str, float]:
        """The limits of ``time_at_error``, up to which there is no penalty; empty for other costs.

        ``robot_error`` is the share wrong of the robots that decided, ``robots_undecided`` the share of all.
        """
        if self.name != "time_at_error":
            return {}
        return {
            "robot_error": self.parameters.get("max_error", 0.05),
            "robots_undecided": self.parameters.get("max_undecided", 0.10),
        }

    @property
    def unit(self) -> str:
        """The unit of the score."""
        return "s" if self.name in (*AIMS, "decision_time") else ""

    def figures(self, outcomes: Outcomes) -> Array:
        """Compute the figures of each run of ``outcomes``, (runs, columns).

        Raises:
            InputError: a user's cost gives no number.
        """
        if self.function is not None:
            return costs.check_figures(self.function(outcomes), outcomes.run.size, f"cost '{self.name}'")
        if self.name == "expected_time_to_right":
            return costs.consensus(outcomes)
        if self.name == "time_at_error":
            rows = costs.at_error(outcomes)
            return np.column_stack([rows, np.full(rows.shape[0], outcomes.t_end_s)])
        parameters = dict(self.parameters) if self.name == "errors" else {}
        return costs.check_figures(
            costs.COSTS[self.name](outcomes, **parameters), outcomes.run.size, self.name
        )

    def score(self, rows: Rows) -> float:
        """Compute the score from the figures ``rows`` (runs, cases, columns); infinite without runs."""
        if rows.shape[0] == 0:
            return math.inf
        by_case = [self._of_case(rows[:, case]) for case in range(rows.shape[1])]
        return max(by_case) if self.over == "worst" else float(np.mean(by_case))

    def interval(self, rows: Rows, level: float = 0.95, seed: int = 0) -> Interval:
        """Compute the score and limits: Student's for a mean, order statistics for a quantile, else a bootstrap.

        Args:
            rows: figures of the runs, (runs, cases, columns). level: of confidence. seed: of the bootstrap.
        """
        quantile = self._quantile()
        if rows.shape[1] == 1 and self.name not in AIMS and rows.shape[0] > 1:
            if quantile is not None:
                return quantile_interval(rows[:, 0, 0], quantile, level)
            if self.statistic == "mean":
                return mean_interval(rows[:, 0, 0], level)
        return bootstrap(self.score, rows, level, seed)

    def estimate(self, rows: Rows) -> tuple[float, float]:
        """Estimate the score of ``rows`` and its standard error, corrected for small-sample bias if it is mean + sd.

        The other scores are not smooth in the data, so that the correction would be unstable.
        """
        linear = rows.shape[1] == 1 or self.over == "mean"
        freed, error = corrected(self.score, rows)
        smooth = linear and self.name not in AIMS and self.statistic == "mean+sd"
        return (freed if smooth else self.score(rows)), error

    def _quantile(self) -> float | None:
        """Return the quantile of the statistic; None for a mean or mean + sd."""
        kind, _, share = self.statistic.partition(" ")
        if kind == "quantile":
            try:
                value = float(share)
            except ValueError:
                value = math.nan
            if 0 < value < 1:
                return value
        elif self.statistic in ("mean", "mean+sd"):
            return None
        raise InputError(
            f"'{self.statistic}' is unknown; give mean+sd, mean, or a quantile such as 'quantile 0.9'",
            field="objective.statistic",
        )

    def _of_case(self, rows: Array) -> float:
        """Compute the score of one case from its figures."""
        if self.name == "expected_time_to_right":
            return float(rows[:, 0].sum() / max(rows[:, 1].sum(), 0.5))
        if self.name == "time_at_error":
            return self._time_at_error(rows)
        costs_of = rows[:, 0]
        quantile = self._quantile()
        if quantile is not None:
            rank = math.ceil(quantile * costs_of.size) - 1
            return float(np.partition(costs_of, rank)[rank])
        mean = float(costs_of.mean())
        return mean if self.statistic == "mean" else mean + float(costs_of.std())  # Eq. 22

    def _time_at_error(self, rows: Array) -> float:
        """Compute the mean time plus the penalty for exceeding the limits."""
        time_s, wrong, decided, robots = rows[:, :4].sum(axis=0)
        max_error, max_undecided = self.limits.values()
        error, undecided = wrong / max(decided, 1.0), 1.0 - decided / robots
        excess = max(error - max_error, 0.0) / max_error + max(undecided - max_undecided, 0.0) / max_undecided
        return float(time_s / rows.shape[0] + rows[0, 4] * excess)


def bootstrap(
    score: Callable[[Rows], float], rows: Rows, level: float = 0.95, seed: int = 0, draws: int = DRAWS
) -> Interval:
    """Compute a statistic of runs with a percentile bootstrap interval over runs, shifted by the bootstrap bias.

    The bootstrap underestimates a standard deviation; without the shift the interval would be too low. With
    fewer than two runs the limits are infinite.
    """
    runs, estimate = rows.shape[0], score(rows)
    if runs < 2:
        return Interval(estimate, -math.inf, math.inf, level, runs, "bootstrap")
    random = generator(seed, "bootstrap of a score")
    drawn = np.array([score(rows[random.integers(0, runs, runs)]) for _ in range(draws)])
    low, high = np.quantile(drawn - (drawn.mean() - estimate), [0.5 - level / 2, 0.5 + level / 2])
    return Interval(estimate, float(low), float(high), level, runs, "bootstrap")


def corrected(score: Callable[[Rows], float], rows: Rows, groups: int = 10) -> tuple[float, float]:
    """Correct a score for its small-sample bias, and estimate its standard error, by the grouped jackknife.

    mean + sd of 10 runs is too low by about a tenth, so candidates with few runs would look better than others.
    With fewer than two runs the score is not corrected, and the error is infinite.
    """
    runs = rows.shape[0]
    count = min(groups, runs)
    estimate = score(rows)
    if count < 2:
        return estimate, math.inf
    bounds = np.linspace(0, runs, count + 1).astype(np.int64)
    keep = np.ones(runs, dtype=np.bool_)
    left = np.empty(count)
    for g in range(count):
        keep[bounds[g] : bounds[g + 1]] = False
        left[g] = score(rows[keep])
        keep[bounds[g] : bounds[g + 1]] = True
    if not math.isfinite(estimate):
        return estimate, math.inf
    mean = float(left.mean())
    error = math.sqrt((count - 1) / count * float(((left - mean) ** 2).sum()))
    return count * estimate - (count - 1) * mean, error


def objectives_from(block: Any) -> tuple[Objective, ...]:
    """Make one objective from a table, or several from a list of tables."""
    if isinstance(block, Mapping):
        return (Objective.of(block),)
    many = isinstance(block, Sequence) and not isinstance(block, str)
    if many and block and all(isinstance(entry, Mapping) for entry in block):
        return tuple(Objective.of(entry) for entry in block)
    raise InputError("is a table with a cost, or a list of such tables", field="objective")
