"""The cells of a study in one column, with their figures by run, and the values of claims that are figures of cells."""

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

from vibroswarm.core.untrusted_files import parsed_toml
from vibroswarm.paper.claims import Claim, Selection, Value, mean
from vibroswarm.paper.columns import adapted, published
from vibroswarm.paper.decidable import cannot_ask
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
    """Return values of runs whose mean is 1 - mean(first) / mean(second), to first order, and their deviation.

    The deviation is that of published runs, as if those of the two were not paired.
    """
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
