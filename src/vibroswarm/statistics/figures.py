"""Figures of runs and of cells: each is declared here, once, and is then in tables, pages, pictures and comparisons.

A figure of a run is one number. That of a cell is made of its runs, which are the independent units:

| kind | figure of a cell | interval |
|---|---|---|
| mean | mean over the runs that have the figure | Student's t, within what a mean can be |
| runs | share of the runs, of those that have the figure, in which it is 1 and not 0 | Wilson |
| robots | sum of a number of robots over runs / sum of another | Wilson, with an effective number of robots |
| median | median over runs; a run without the figure counts as infinitely late | order statistics |

Numbers of robots (``robots``, right, wrong, undecided, and decided: right or wrong) stand beside them; right, wrong
and decided are nan in runs without a truth, where the fill ratio lies on the boundary.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import ArrayLike, NDArray

from vibroswarm.errors import InputError
from vibroswarm.inference.outcomes import (
    CONSENSUS,
    RUNS,
    Array,
    Columns,
    capped_time_s,
    forced_errors,
    mean_by_run,
    numbers,
    sum_by_run,
)
from vibroswarm.statistics.intervals import (
    Interval,
    bounded_mean,
    cluster_share,
    quantile_interval,
    rate_interval,
    wilson,
)

COUNTS: Final = ("right", "wrong", "undecided")
"""Columns of the table of runs with numbers of robots."""
STATED: Final = "stated"
"""Column of the table of figures by run: number of robots that state the spread of their estimate."""


WITHIN: Final = 1.6448536269514722
"""Half of a 90 % interval of a normal distribution, in standard deviations."""
ROOT_TAU, ROOT_PI = math.sqrt(2.0 * math.pi), math.sqrt(math.pi)


FOLLOWED: Final = (
    *("agreement_held", "right_at_decision", "right_time_share", "answer_delay_s", "false_changes_per_h"),
    *("change_time_error_s", "map_brier", "map_auc", "map_location_error_m", "detection_time_s"),
)
"""Columns of runs that only some have: of answers and maps that are followed over time."""


class Swarms:
    """Runs and their robots, from which the figures of runs are computed; nan where a value is missing.

    Args:
        robots: columns of the table of robots, (robots of all runs,), run by run. runs: of the table of runs, (runs,);
            ``consensus`` is an index into ``outcomes.CONSENSUS``. first: (runs,): index of each run's first robot.
        t_end_s: one number, or one for each run. costs: of ``outcomes.costs_of``, ([runs,] answers, answers).
    """

    def __init__(
        self,
        robots: Columns,
        runs: Columns,
        first: NDArray[np.intp],
        t_end_s: ArrayLike,
        costs: Array | None = None,
    ) -> None:
        self.robots, self.first, self.costs = robots, first, costs
        self.runs = dict.fromkeys(FOLLOWED, np.full(first.size, np.nan)) | {**runs}
        self.count: NDArray[np.int64] = np.diff(np.append(first, robots["decision"].size)).astype(np.int64)
        self.t_end_s = np.broadcast_to(np.asarray(t_end_s, dtype=np.float64), first.shape)

    @classmethod
    def of_tables(
        cls, robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float, costs: Array | None = None
    ) -> Swarms:
        """Read the tables of one cell, as a ``Result`` has them, in any order of rows."""
        robots, runs = robots.sort("run", "robot"), runs.sort("run")
        number = robots["run"].to_numpy()
        # A run starts at row 0, if the table has rows, and wherever the run number changes.
        first = np.flatnonzero(np.append(number.size > 0, number[1:] != number[:-1]))
        if number[first].tolist() != runs["run"].to_list():  # each run of the robots once, in ascending order
            raise InputError(
                "the tables of robots and of runs must have the same runs, once each", field="runs"
            )
        # Figures compare the integer codes of the categories. The cast gives a column of plain strings these codes too.
        runs = runs.with_columns(pl.col("consensus").cast(RUNS["consensus"]).to_physical())
        of_robots, of_runs = ({one.name: numbers(one) for one in table} for table in (robots, runs))
        return cls(of_robots, of_runs, first, t_end_s, costs)

    @classmethod
    def of_arrays(
        cls, robots: Columns, runs: Columns, t_end_s: ArrayLike, costs: Sequence[Array | None] = ()
    ) -> Swarms:
        """Read arrays, (..., runs, robots) and (..., runs), of runs whose swarms have the same size.

        Args:
            t_end_s: one number, or one for each cell. costs: ``outcomes.costs_of`` of each cell, along the first axis.
        """
        shape = robots["decision"].shape
        end_s = np.broadcast_to(np.asarray(t_end_s, dtype=np.float64)[..., None], shape[:-1])
        of_cells = stacked(costs)
        return cls(
            {name: column.ravel() for name, column in robots.items()},
            {name: np.broadcast_to(column, shape[:-1]).ravel() for name, column in runs.items()},
            np.arange(0, math.prod(shape), shape[-1]),
            end_s.ravel(),
            None if of_cells is None else np.repeat(of_cells, shape[-2], axis=0),
        )

    def sum(self, values: Array) -> Array:
        """Sum ``values``, one for each robot, over the robots of each run, shape (runs,)."""
        return sum_by_run(values, self.first)

    def mean(self, values: Array) -> Array:
        """Average ``values`` over the robots of each run that have one (not nan), (runs,); nan if no robot has one."""
        return mean_by_run(values, self.first)

    def by_robot(self, of_runs: Array) -> Array:
        """Repeat a value of each run for each of its robots."""
        return np.repeat(of_runs, self.count)

    @cached_property
    def time_s(self) -> Array:
        """Time of each robot's decision, s; the end of the run if it did not decide."""
        return capped_time_s(self.robots["decision_time_s"], self.by_robot(self.t_end_s))

    @cached_property
    def truth(self) -> Array:
        """The right answer of each run, 0 or 1; nan: neither is right."""
        return np.asarray(self.runs["truth"], dtype=np.float64)

    @cached_property
    def counts(self) -> dict[str, Array]:
        """Numbers of robots of each run: ``robots``, right, wrong, undecided and decided."""
        known = ~np.isnan(self.truth)
        right, wrong = (np.where(known, self.runs[name], np.nan) for name in ("right", "wrong"))
        undecided = np.asarray(self.runs["undecided"], dtype=np.float64)
        robots = self.count.astype(np.float64)
        return {
            "robots": robots,
            "right": right,
            "wrong": wrong,
            "undecided": undecided,
            "decided": right + wrong,
        }

    def ended(self, consensus: str, where_known: bool = False) -> Array:
        """Return in which runs the consensus was this: 1 or 0; with ``where_known``, nan in runs without a truth."""
        hit = np.asarray(self.runs["consensus"] == CONSENSUS.index(consensus), dtype=np.float64)
        return np.where(np.isnan(self.truth), np.nan, hit) if where_known else hit


def stacked(costs: Sequence[Array | None]) -> Array | None:
    """Return the costs of several cells in one array, (cells, answers, answers); None if all are."""
    if all(one is None for one in costs):
        return None
    tables = [1.0 - np.eye(2) if one is None else one for one in costs]
    most = max(len(one) for one in tables)
    of_cells = np.full((len(tables), most, most), np.nan)
    for table, one in zip(of_cells, tables, strict=True):
        table[: len(one), : len(one)] = one
    return of_cells


@dataclass(frozen=True)
class RunFigure:
    """A figure: how it is computed for each run, how runs make it a figure of a cell, and how it is shown."""

    name: str
    """Its name as a figure of a cell; tables have its limits as ``name_low`` and ``name_high``."""
    title: str
    """What tables and axes call it."""
    of_run: Callable[[Swarms], Array]
    """Computes it for each run, (runs,); nan in runs that do not have it."""
    kind: str = "mean"
    """How runs make it a figure of a cell: "mean", "rate", "share", "runs", "robots" or "median"."""
    better: int = 0
    """1 if larger values are better, -1 if smaller values are, 0 if neither: then it cannot be compared."""
    unit: str = ""
    """``s``, or empty."""
    column: str = ""
    """Its name in the table of figures by run, if that is another one."""
    counted: tuple[str, str] = ("", "")
    """Kind "robots": which robots are counted, and among which; columns of ``Swarms.counts``."""
    of_decisions: bool = False
    """Whether searches know what it is computed from: decisions, their times, and beliefs at the end."""
    compared: bool = False
    """Whether cells are compared by it unless other figures are asked for."""
    least: float = -math.inf
    most: float = math.inf
    """Values that a mean can have at least and at most; times are at most the end of a run."""

    @property
    def by_run(self) -> str:
        """Its name in the table of figures by run."""
        return self.column or self.name

    @property
    def read(self) -> tuple[str, ...]:
        """The columns of the table of figures by run of which runs make it a figure of a cell."""
        if self.kind == "robots":
            return self.counted
        return (self.by_run, STATED) if self.kind == "share" else (self.by_run,)

    @property
    def is_cost(self) -> bool:
        """Whether searches can minimise it."""
        return self.of_decisions and self.better < 0

    @property
    def is_share(self) -> bool:
        """Whether it is a share, which is shown in percent."""
        shares = ("forced_error", "estimate_coverage", "right_at_decision", "right_time_share")
        return self.kind in ("runs", "robots") or self.name in shares

    @property
    def most_apart(self) -> float:
        """By how much two runs can differ; nan if that is not known."""
        width = 1.0 if self.is_share else self.most - self.least
        return width if math.isfinite(width) else math.nan

    def mean(self, by_run: ArrayLike, level: float = 0.95, t_end_s: float = math.nan) -> Interval:
        """Average it over runs, with Student's limits within what a mean can be, see ``intervals.bounded_mean``."""
        if self.is_share:
            return bounded_mean(by_run, 0.0, 1.0, level)
        is_time = self.unit == "s" and self.least == 0.0
        return bounded_mean(by_run, self.least, t_end_s if is_time else self.most, level)


def _mean_of(column: str) -> Callable[[Swarms], Array]:
    return lambda swarms: swarms.mean(swarms.robots[column])


def _estimate_misses(swarms: Swarms) -> Array:
    """Estimate minus true fill ratio of each robot."""
    return np.asarray(swarms.robots["estimate"] - swarms.by_robot(swarms.runs["fill_ratio"]))


def _estimate_coverage(swarms: Swarms) -> Array:
    spread = swarms.robots["estimate_spread"]
    hit = np.abs(_estimate_misses(swarms)) <= WITHIN * spread
    return swarms.mean(np.where(np.isnan(spread), np.nan, hit))


def _estimate_crps(swarms: Swarms) -> Array:
    """Continuous ranked probability score of Normal(estimate, spread): Gneiting and Raftery 2007, Eq. 20 ff."""
    from scipy.special import ndtr

    spread = np.asarray(swarms.robots["estimate_spread"])
    with np.errstate(
        invalid="ignore", divide="ignore"
    ):  # a robot that claims to be certain has a spread of 0
        z = -_estimate_misses(swarms) / spread
        score = spread * (z * (2.0 * ndtr(z) - 1.0) + 2.0 * np.exp(-0.5 * z * z) / ROOT_TAU - 1.0 / ROOT_PI)
    return swarms.mean(np.where(spread == 0.0, np.abs(_estimate_misses(swarms)), score))


def _forced_error(swarms: Swarms) -> Array:
    in_truth, truth = swarms.robots["belief_in_truth"], swarms.by_robot(swarms.truth)
    costs = swarms.costs
    if costs is not None and costs.ndim == 3:  # a table for each run
        costs = np.repeat(costs, swarms.count, axis=0)
    return swarms.mean(forced_errors(swarms.robots["decision"], in_truth, truth, costs))


def _agreed_on(chosen: Callable[[Array], NDArray[np.bool_]]) -> Callable[[Swarms], Array]:
    """Return whether all robots decided alike, on one of the chosen answers."""

    def of_run(swarms: Swarms) -> Array:
        decision = swarms.robots["decision"]
        first = decision[swarms.first]
        agreed = swarms.sum(1.0 * (decision == swarms.by_robot(first))) == swarms.count
        # The sum is nan if the decision of a robot is not logged.
        return np.where(np.isnan(swarms.sum(decision)), np.nan, agreed & chosen(first))

    return of_run


def _share(counted: str, among: str) -> Callable[[Swarms], Array]:
    def of_run(swarms: Swarms) -> Array:
        counts = swarms.counts
        with np.errstate(invalid="ignore", divide="ignore"):  # 0 / 0 where no robot decided
            shares: Array = counts[counted] / counts[among]
        return shares

    return of_run


def _wrong_among_agreed(swarms: Swarms) -> Array:
    right, wrong = swarms.ended("right", where_known=True), swarms.ended("wrong", where_known=True)
    return np.where(right + wrong == 1.0, wrong, np.nan)


def _robots(name: str, title: str, counted: str, among: str = "robots", **settings: Any) -> RunFigure:
    column = f"{counted}_share" if among == "robots" else name
    return RunFigure(
        name,
        title,
        _share(counted, among),
        kind="robots",
        counted=(counted, among),
        column=column,
        **settings,
    )


FIGURES: Final = (
    RunFigure(
        "decision_time_s",
        "decision time",
        lambda s: s.mean(s.time_s),
        better=-1,
        unit="s",
        compared=True,
        least=0.0,
    ),
    RunFigure(
        "belief_in_truth",
        "belief in the truth",
        _mean_of("belief_in_truth"),
        better=1,
        compared=True,
        least=0.0,
        most=1.0,
    ),
    _robots(
        "robots_right",
        "robots right",
        "right",
        better=1,
        compared=True,
    ),
    _robots(
        "robots_wrong",
        "robots wrong",
        "wrong",
        better=-1,
        of_decisions=True,
        compared=True,
    ),
    _robots("robots_undecided", "robots undecided", "undecided", better=-1, of_decisions=True, compared=True),
    RunFigure("forced_error", "forced error", _forced_error, better=-1, of_decisions=True, compared=True),
    RunFigure("estimate", "estimate", _mean_of("estimate")),
    RunFigure(
        "estimate_error",
        "error of the estimate",
        lambda s: s.mean(np.abs(_estimate_misses(s))),
        better=-1,
        least=0.0,
    ),
    RunFigure(
        "estimate_coverage", "robots whose 90 % interval holds the true number", _estimate_coverage, "share"
    ),
    RunFigure("estimate_crps", "CRPS of the estimate", _estimate_crps, better=-1, least=0.0),
    RunFigure("sent", "messages sent by a robot", _mean_of("sent"), least=0.0),
    _robots("robot_error", "wrong among robots that decided", "wrong", "decided"),
    RunFigure("swarm_right", "swarms right", lambda s: s.ended("right", True), "runs", better=1),
    RunFigure(
        "swarm_wrong", "swarms wrong", lambda s: s.ended("wrong", True), "runs", better=-1, of_decisions=True
    ),
    RunFigure("swarm_split", "swarms split", lambda s: s.ended("split"), "runs"),
    RunFigure("swarm_incomplete", "swarms undecided", lambda s: s.ended("incomplete"), "runs"),
    RunFigure(
        "swarm_truth_undefined", "without a right answer", lambda s: s.ended("truth_undefined"), "runs"
    ),
    RunFigure("swarm_error", "wrong among swarms that agreed", _wrong_among_agreed, "runs"),
    RunFigure(
        "consensus_time_s",
        "consensus time",
        lambda s: capped_time_s(s.runs["consensus_time_s"], s.t_end_s),
        better=-1,
        of_decisions=True,
        unit="s",
        column="swarm_time_s",
        least=0.0,
    ),
    RunFigure(
        "consensus_median_s",
        "median consensus time",
        lambda s: np.asarray(s.runs["consensus_time_s"]),
        "median",
        unit="s",
        column="consensus_time_s",
    ),
    RunFigure("agreed_on_0", "agreed on answer 0", _agreed_on(lambda answer: answer == 0), "runs"),
    RunFigure("agreed_on_1", "agreed on answer 1", _agreed_on(lambda answer: answer == 1), "runs"),
    RunFigure("agreed_on_other", "agreed on another answer", _agreed_on(lambda answer: answer > 1), "runs"),
    RunFigure(
        "agreement_lasted", "lasted", lambda s: s.runs["agreement_held"], "runs", column="agreement_held"
    ),
    RunFigure(
        "right_at_decision",
        "robots right when they decided",
        lambda s: s.runs["right_at_decision"],
        better=1,
    ),
    RunFigure("right_time_share", "share of the time right", lambda s: s.runs["right_time_share"], better=1),
    RunFigure(
        "answer_delay_s",
        "delay of the new answer",
        lambda s: s.runs["answer_delay_s"],
        better=-1,
        unit="s",
        least=0.0,
    ),
    RunFigure(
        "false_changes_per_h",
        "false changes an hour",
        lambda s: s.runs["false_changes_per_h"],
        "rate",
        better=-1,
    ),
    RunFigure(
        "change_time_error_s",
        "error of the time of the change",
        lambda s: s.runs["change_time_error_s"],
        better=-1,
        unit="s",
        least=0.0,
    ),
    RunFigure(
        "map_brier",
        "Brier score of the map",
        lambda s: s.runs["map_brier"],
        better=-1,
        least=0.0,
        most=1.0,
    ),
    RunFigure("map_auc", "AUC of the map", lambda s: s.runs["map_auc"], better=1, least=0.0, most=1.0),
    RunFigure(
        "map_location_error_m",
        "location error of the map",
        lambda s: s.runs["map_location_error_m"],
        better=-1,
        unit="m",
        least=0.0,
    ),
    RunFigure(
        "detection_time_s",
        "time to detection",
        lambda s: s.runs["detection_time_s"],
        better=-1,
        unit="s",
        least=0.0,
    ),
)
"""All figures, in the order in which tables have them."""

ESTIMATES: Final = ("estimate_error", "estimate_coverage", "estimate_crps")
"""Figures that stand in the place of right and wrong where a task asks for a number."""


BY_NAME: Final = {figure.name: figure for figure in FIGURES}
"""Each figure by its name as a figure of a cell."""
BY_COLUMN: Final = {figure.by_run: figure for figure in FIGURES}
"""Each figure by its name in the table of figures by run."""


def figures_of(swarms: Swarms) -> dict[str, Array]:
    """Compute the figures of each run, by name in the table of figures by run, (runs,) each, and numbers of robots."""
    counts = swarms.counts | {STATED: swarms.sum(1.0 * ~np.isnan(swarms.robots["estimate_spread"]))}
    return counts | {figure.by_run: figure.of_run(swarms) for figure in FIGURES}


def run_figures(
    robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float, costs: Array | None = None
) -> pl.DataFrame:
    """Compute one row of figures for each run, sorted by run; null where a run does not have one.

    Args:
        robots, runs: tables of one cell, as a ``Result`` has them. t_end_s: end of a run, s.
        costs: of the cell's scenario, ``outcomes.costs_of``; None: two answers, mistakes that cost the same.
    """
    swarms = Swarms.of_tables(robots, runs, t_end_s, costs)
    columns = [
        pl.Series(name, values, nan_to_null=True).cast(
            pl.Int64 if name in (*swarms.counts, STATED) else pl.Float64
        )
        for name, values in figures_of(swarms).items()
    ]
    return runs.sort("run").select("run", "truth", "consensus").with_columns(columns)


ByRun = Mapping[str, NDArray[Any]] | pl.DataFrame
"""Columns of ``figures_of``, (runs,) each, nan or null where a run does not have a figure."""


def summary(
    robots: pl.DataFrame,
    runs: pl.DataFrame,
    t_end_s: float,
    level: float = 0.95,
    *,
    costs: Array | None = None,
) -> dict[str, Interval]:
    """Compute all figures of a cell, by name; the arguments are those of ``run_figures`` and ``interval``."""
    return cell_figures(run_figures(robots, runs, t_end_s, costs), t_end_s, level)


def cell_figures(by_run: ByRun, t_end_s: float, level: float = 0.95) -> dict[str, Interval]:
    """Compute all figures of a cell from those of its runs, by name, in the order of ``FIGURES``."""
    return {figure.name: interval(figure.name, by_run, level, t_end_s) for figure in FIGURES}


def interval(name: str, by_run: ByRun, level: float = 0.95, t_end_s: float = math.nan) -> Interval:
    """Compute a figure of a cell, with its limits, from the figures of its runs; t_end_s: end of a run, s."""
    figure = BY_NAME[name]
    columns = [numbers(pl.Series(by_run[column])) for column in figure.read]
    if figure.kind == "robots":
        count, of = columns
        known = ~np.isnan(count)
        return cluster_share(count[known], of[known], level)
    values = columns[0]
    if figure.kind == "mean":
        return figure.mean(values, level, t_end_s)
    if figure.kind == "rate":
        return rate_interval(values, 3600.0 / t_end_s, level)
    known = ~np.isnan(values)
    if figure.kind == "share":
        robots = columns[1]  # only these have an interval that may hold the number
        return cluster_share(np.rint(values * robots)[known], robots[known], level)
    if figure.kind == "median":
        return quantile_interval(np.where(known, values, math.inf), 0.5, level)
    return wilson(int(values[known].sum()), int(known.sum()), level)
