"""The cells of a study in one column, their figures by run, and the values of claims that are figures of cells.

The paper's question can be asked of a cell if the expected share of ones lies on the same side of the boundary as
the fill ratio. An edge response fitted on tiles of one size is not known on smaller ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import repeat
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.numbers import number, percent
from vibroswarm.core.untrusted_files import parsed_toml
from vibroswarm.floors import is_random
from vibroswarm.floors.floor import Floor
from vibroswarm.observation.decision_boundary import expected_ones
from vibroswarm.paper.claims import Claim, Selection, Value, mean
from vibroswarm.paper.columns import adapted, published, real_floor
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.statistics.decidability import decidability, decidability_of_share
from vibroswarm.statistics.figures import interval
from vibroswarm.statistics.intervals import columns_of, mean_interval
from vibroswarm.study.batch import WALK
from vibroswarm.study.cells import Cell
from vibroswarm.study.run import MOST_RUNS
from vibroswarm.study.spec import Study

Array = NDArray[np.float64]
OUTCOMES: Final = ("decision_time_s", "belief_in_truth", "robots_right", "robots_wrong", "robots_undecided")
WALKED: Final = ("avoid_per_sample_s", "distance_m")
ANY: Final = "*"
"""Any value of a field, in a selection."""
SHARES: Final = ("belief_in_truth", "wrong_share")
"""Figures between 0 and 1."""
ABSENT: Final = ""
"""The field is not varied, in a selection."""


@cache
def study(name: str, column: str) -> Study:
    """Return a study of the reproduction with the preset of a column."""
    text = files("vibroswarm.paper").joinpath("studies", f"{name}.toml").read_text(encoding="utf-8")
    values = parsed_toml(text, name)
    return Study.from_values(
        {"runs": MOST_RUNS, **values, "scenario": {**values["scenario"], "preset": column}}
    )


@cache
def cells_of(name: str, column: str) -> tuple[Cell, ...]:
    """Return the cells of a study in a column."""
    own = study(name, column).cells
    return tuple(Cell(one.number, one.point, adapted(column, one.scenario), one.name) for one in own)


@dataclass(frozen=True)
class Cells:
    """Cells of a study in one column, and their runs, sorted by cell and run."""

    column: str
    cells: Sequence[Cell]
    rows: Sequence[pl.DataFrame]
    """Figures by run of each cell."""

    def by_run(self, place: int, figure: str) -> Array:
        """Return a figure of each run of a cell, (runs,); nan where a run does not have it."""
        return self.rows[place][figure].cast(pl.Float64).fill_null(math.nan).to_numpy()

    def where(self, wanted: Mapping[str, Any]) -> list[int]:
        """Return the places of the cells with these values of varied fields, see ``claims.toml``."""
        return [place for place, cell in enumerate(self.cells) if _matches(cell.point, wanted)]

    def value(self, **wanted: Any) -> int:
        """Return the place of the only cell with these values; dots in names are two underscores."""
        (place,) = self.where({name.replace("__", "."): value for name, value in wanted.items()})
        return place

    @property
    def table(self) -> pl.DataFrame:
        """A row for each cell: varied fields, runs, and figures with their 95 % limits over runs."""
        rows = []
        for cell, own in zip(self.cells, self.rows, strict=True):
            row = {"column": self.column, **cell.texts, "runs": own.height}
            for name in OUTCOMES:
                t_end_s = cell.scenario.run.t_end_s
                row |= columns_of(name, interval(name, own, t_end_s=t_end_s))
            for name in WALKED:
                row |= columns_of(name, mean_interval(own[name]))
            rows.append(row)
        return pl.DataFrame(rows, infer_schema_length=None)

    def measure(self, claim: Claim) -> Iterator[Value]:
        """Yield the values of a claim that is about figures of cells."""
        pairs = zip(_listed(claim.first), _paired(claim.second), _paired(claim.beyond), strict=False)
        places = [(place, second, beyond) for first, second, beyond in pairs for place in self.where(first)]
        less: list[float] = (
            [claim.less] * len(places) if isinstance(claim.less, float) else _published(claim.less)
        )
        for (place, second, beyond), printed in zip(places, less, strict=True):
            yield self._value(claim, place, second, beyond, printed)

    def _value(
        self, claim: Claim, place: int, second: Selection | None, beyond: Selection | None, less: float
    ) -> Value:
        point = self.cells[place].point
        values, sd, used = self._compared(claim, place, second)
        if beyond is not None:
            (there,) = self.where({**point, **beyond})
            others, _, further = self._compared(claim, there, second)
            values, used = values - others, used + further
        if claim.error_of is not None:
            values = np.abs(values - claim.error_of)
        if claim.spread is not None:
            sd = max(
                self.by_run(one, claim.figure).std(ddof=1) for one in self.where({**point, **claim.spread})
            )
        runs = claim.published_runs
        asked = claim.asked or claim.figure in WALK
        reasons = () if asked else filter(None, (cannot_ask(self.cells[one].scenario) for one in used))
        return mean(
            claim.id, self.column, self.cells[place].name, values, less,
            published_error=0.0 if runs is None else float(sd) / math.sqrt(runs),
            apart=1.0 if claim.figure in SHARES else math.nan,
            cannot=next(iter(reasons), ""),
        )  # fmt: skip

    def _compared(self, claim: Claim, place: int, second: Selection | None) -> tuple[Array, float, list[int]]:
        """Return a value of each run, the deviation of published runs, and the cells that were used."""
        own = self.by_run(place, claim.figure)
        if second is None:
            return own, own.std(ddof=1), [place]
        places = self.where({**self.cells[place].point, **second})
        others = [self.by_run(one, claim.figure) for one in places]
        other = min(others, key=np.mean) if claim.least else np.mean(others, axis=0)
        return *STATISTICS[claim.statistic](own, other), [place, *places]


def _difference(first: Array, second: Array) -> tuple[Array, float]:
    values = first - second
    return values, values.std(ddof=1)


def share_saved(first: Array, second: Array) -> tuple[Array, float]:
    """Return values of runs whose mean is 1 - mean(first) / mean(second), to first order, and their deviation."""
    saved = 1.0 - first.mean() / second.mean()
    values = saved - (first - (1.0 - saved) * second) / second.mean()
    return values, math.hypot(first.std(ddof=1), (1.0 - saved) * second.std(ddof=1)) / second.mean()


def log_spread(first: Array, second: Array) -> tuple[Array, float]:
    """Return values of runs whose mean is log(s1 / s2), the standard deviations, with its error to first order."""
    s1, s2 = first.std(ddof=1), second.std(ddof=1)
    if min(s1, s2) <= 0.0:
        return np.full(first.size, math.nan), math.nan
    values = ((first - first.mean()) ** 2 / s1**2 - (second - second.mean()) ** 2 / s2**2) / 2
    return values - values.mean() + math.log(s1 / s2), math.nan


STATISTICS: Final = {"difference": _difference, "share saved": share_saved, "log spread": log_spread}


def _matches(point: Mapping[str, Any], wanted: Mapping[str, Any]) -> bool:
    for field, value in wanted.items():
        own = point.get(field, ABSENT)
        if value != ANY and own != value and not (isinstance(value, list) and own in value):
            return False
    return True


def _listed(one: Selection | list[Selection]) -> list[Selection]:
    return one if isinstance(one, list) else [one]


def _paired(one: Selection | list[Selection] | None) -> Iterator[Selection | None]:
    return iter(one) if isinstance(one, list) else repeat(one)


def _published(paths: list[str]) -> list[float]:
    values = [published(path) for path in paths]
    return [float(each) for value in values for each in (value if isinstance(value, list) else [value])]


_reasons: dict[Any, str] = {}


def cannot_ask(scenario: Scenario) -> str:
    """Return why decisions in this scenario cannot answer the question; empty if they can."""
    key = scenario.arena, scenario.floor, scenario.change, scenario.sensor, scenario.task, scenario.decision
    if key not in _reasons:
        _reasons[key] = _edges(scenario) or _side(scenario)
    return _reasons[key]


def _side(scenario: Scenario) -> str:
    verdict = decidability(scenario)
    if is_random(scenario.floor.source) and scenario.sensor.edge_reach_m is not None:
        # Random floors of one fill ratio differ in the length of their edges: here the mean over floors counts.
        share = expected_ones(scenario, verdict.fill_ratio or 0.0)
        verdict = decidability_of_share(share, verdict.tested, verdict.truth)
    is_right = verdict.verdict == "decidable"
    return "" if is_right else f"{verdict.verdict}: {percent(verdict.share)} of the readings are ones"


def _edges(scenario: Scenario) -> str:
    reach_m = scenario.sensor.edge_reach_m
    if not reach_m:
        return ""
    side_m, fitted_m = _side_m(scenario.floor_for(seed=0, run=0)), _fitted_m()
    if side_m >= fitted_m * (1.0 - 1e-9):  # rounding errors
        return ""
    fitted, own = number(1000 * fitted_m, 0), number(1000 * side_m, 0)
    return f"edges of {number(1000 * reach_m, 0)} mm were fitted on tiles of {fitted} mm; these have {own} mm"


@cache
def _fitted_m() -> float:
    return _side_m(preset("calibrated").with_values(real_floor()).floor_for(0, 0))


def _side_m(floor: Floor) -> float:
    _, _, width_m, height_m, *_ = floor.geometry
    return float(min(width_m, height_m))
