"""Run a league and compute its standings: time and error of each strategy over all floors, with intervals.

A league runs entries (strategies with settings) on the same floors, with the same motion. (Entries whose settings set
fields of motion move in their own way; they share only the random numbers of motion.)

| column | what it is |
|---|---|
| forced_error | share of robots wrong, or undecided and leaning to the wrong side |
| right, wrong, undecided | shares of robots |
| decision_time_s | mean of min(decision time, T_end), s |
| sent | messages that a robot sends in a run |
| bytes_sent | ``sent`` times the bytes of one message |

**The unit is the motion of a run**: a run number and a swarm size. All strategies and floors share the motion of a
unit, so outcomes on different floors are dependent. Each figure is therefore averaged over the floors first, and
intervals are over units. Strategies are compared with a reference unit by unit. The p-values of each figure are
corrected over the strategies, or over strategies and floors (Holm). The floors are a given set, not a random sample:
figures hold for this set, in which every floor counts the same.

**Worst floor**: the floor with the largest forced error among those with a fill ratio nearest to 1/2. One half of the
units chooses the floor and the other half estimates its error, since the largest of several estimates is too large.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.numbers import stated
from vibroswarm.errors import InputError
from vibroswarm.inference.agents import strategy_used
from vibroswarm.inference.outcomes import Array, numbers
from vibroswarm.league.entries import SIZE, Entry, LeagueFloor, main_entries, reference_in
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.statistics.figures import BY_NAME
from vibroswarm.statistics.intervals import (
    Interval,
    columns_of,
    mean_interval,
    plain,
    within,
)
from vibroswarm.statistics.map_figures import MAPPED, keeps_map
from vibroswarm.statistics.paired import Paired, compare, holm
from vibroswarm.strategies import strategy
from vibroswarm.strategies.static_analysis import told
from vibroswarm.study.factors import LABEL
from vibroswarm.study.runs import Runs
from vibroswarm.study.spec import Study
from vibroswarm.study.summary import outcome_of

SHOWN: Final = {
    "forced_error": "forced_error",
    "right": "robots_right",
    "wrong": "robots_wrong",
    "undecided": "robots_undecided",
    "decision_time_s": "decision_time_s",
    "sent": "sent",
}
"""Names in ``statistics.figures`` of the figures that are declared there."""
FIGURES: Final = (*SHOWN, "bytes_sent")
"""Figures of the standings; the table of the module's docstring explains them."""
COMPARED: Final = ("forced_error", "decision_time_s")
"""Figures that are compared with the reference."""
DIFFERENCES: Final[dict[str, Any]] = {
    **dict.fromkeys(("name", "reference", "figure"), pl.String),
    **dict.fromkeys(("difference", "difference_low", "difference_high", "p_value", "p_holm"), pl.Float64),
}
"""Columns of ``Standings.differences`` and their types."""
FLOOR_DIFFERENCES: Final[dict[str, Any]] = {
    **dict.fromkeys(("name", "reference", "pattern"), pl.String),
    "fill_ratio": pl.Float64,
    "figure": pl.String,
    **dict.fromkeys(("difference", "p_value", "p_holm"), pl.Float64),
}
"""Columns of ``Standings.floor_differences`` and their types."""


@dataclass(frozen=True)
class League:
    """Strategies that are compared on the same floors, motion, readings and radio, except for fields that they set."""

    base: Scenario
    """Scenario with all fields that entries do not set."""
    entries: tuple[Entry, ...]
    """The strategies with their settings; the first is the reference by default."""
    floors: tuple[LeagueFloor, ...]
    """Floors on which every entry runs; all count the same in averages."""
    robots: tuple[int, ...] = (5, 10)
    """Swarm sizes with which every entry runs."""
    runs: int = 1000
    """Number of runs of each entry, floor and swarm size."""
    seed: int = 1
    """Seed of all runs."""

    @property
    def boundaries(self) -> set[float]:
        """The decision boundaries of the entries."""
        name = "decision.decision_boundary"
        return {float(entry.settings.get(name, self.base[name])) for entry in self.entries}

    @property
    def cells_of_entry(self) -> int:
        """Number of cells of an entry in ``study``: one for each floor and swarm size."""
        return len(self.floors) * len(self.robots)

    def _check_floors(self) -> None:
        """Refuse floors with the fill ratio of a decision boundary: neither decision is right there, and none wrong.

        Raises:
            InputError: there is such a floor. (Other tasks than ``fill_ratio`` are not checked.) Or the task asks for a
                number, so that no decision is right.
        """
        if self.base.task.asks_number:
            raise InputError(
                f"'{self.base.task.name}' asks for a number, and a league compares how often decisions are wrong; "
                "compare estimates by 'vibroswarm evaluate'",
                field="task.name",
            )
        if self.base.task.name != "fill_ratio":
            return
        for floor in self.floors:
            for boundary in self.boundaries:
                if math.isclose(floor.fill_ratio, boundary):
                    raise InputError(
                        f"{floor.source} has the fill ratio of the decision boundary, {boundary:g}, so that neither "
                        "decision is right; give others with --fills, or another decision.decision_boundary",
                        field="floors",
                    )

    @cached_property
    def study(self) -> Study:
        """The study of all cells, ordered by entry, then floor, then swarm size.

        Raises:
            InputError: no decision is right on a floor, two entries have one label, or ``Study`` refuses a value, such
                as the scenario of a cell or the number of runs.
        """
        self._check_floors()
        labels = [entry.label for entry in self.entries]
        for label in labels:
            if labels.count(label) > 1:
                raise InputError(
                    f"two entries are called '{label}'; give values that differ", field="entries"
                )
        # Blocks of a study: a list with one point per entry, and a grid of all pairs of floor and swarm size.
        # A strategy that is not built in is named by its file and class (``code``).
        entry_points = [
            {LABEL: entry.label, "strategy.name": entry.code or entry.strategy, **entry.settings}
            for entry in self.entries
        ]
        grid = {
            "floor.source": [floor.source for floor in self.floors],
            "swarm.robots": list(self.robots),
        }
        # Floors that are not known patterns are defined in the study, by the name that ``floor.source`` uses.
        floors = {floor.source: floor.tiles for floor in self.floors if floor.tiles is not None}
        return Study(
            self.base.with_values(SIZE),  # random floors of the same size as the patterns
            {"list": entry_points, "grid": grid},
            runs=self.runs,
            seed=self.seed,
            floors=floors,
            name="League",
        )

    def play(self, folder: Path | None = None, **how: Any) -> Standings:
        """Run the cells that are missing in ``folder``, and compute the standings of all.

        Args:
            folder: where runs are saved; None: they are not saved. how: further arguments of ``study.run.run``,
                such as workers.
        Raises:
            InputError: the study is not valid, the folder cannot be used, or runs are missing (some failed, and ``how``
                allows failures).
            RunError: runs failed, or the disk is full.
        """
        return standings_of(self, self.study.run(folder, **how))


@dataclass(frozen=True)
class Standings:
    """Results of a league."""

    league: League
    values: Mapping[str, Array]
    """Values of each figure by its name, (entries, floors, units), in the order of the league. The units are all runs
    of the first swarm size, then those of the next. Forced error, right and wrong are nan where neither decision is
    right."""
    study: Runs
    """The runs of the league's study."""

    @cached_property
    def main(self) -> Standings:
        """The standings of the entries that stand for their strategies (``main_entries``)."""
        entries = main_entries(self.league.entries)
        places = [self.league.entries.index(entry) for entry in entries]
        values = {name: of_entries[places] for name, of_entries in self.values.items()}
        return Standings(replace(self.league, entries=entries), values, self.study)

    def interval(self, entry: int, figure: str, floors: Sequence[int] | None = None) -> Interval:
        """Compute the mean of a figure of an entry over floors and units, with its 95 % interval over units.

        Units for which ``by_unit`` is nan are left out; the interval is nan if none remains.

        Args:
            entry: index of the entry. figure: one of ``FIGURES``. floors: indices of floors; by default all.
        """
        by_unit = self.by_unit(entry, figure, floors)
        if figure not in SHOWN:
            return within(mean_interval(by_unit), 0.0, math.inf)
        return BY_NAME[SHOWN[figure]].mean(by_unit, t_end_s=self.t_end_s)

    @cached_property
    def t_end_s(self) -> float:
        """The latest end of a run, s."""
        return max(cell.scenario.run.t_end_s for cell in self.study.cells)

    def by_unit(self, entry: int, figure: str, floors: Sequence[int] | None = None) -> Array:
        """Average a figure of an entry over floors (by default all), for each unit: (units,).

        The average of a unit is nan if the figure is nan on any of these floors.
        """
        of_floors = self.values[figure][entry]
        return np.asarray((of_floors if floors is None else of_floors[list(floors)]).mean(axis=0))

    def _compared(
        self, reference: str | None, parts: Sequence[Sequence[int] | None]
    ) -> Iterator[tuple[dict[str, str], int, Paired]]:
        """Compare each entry with a reference on parts of the floors, unit by unit; see ``paired.compare``.

        Args:
            reference: see ``reference_in``. parts: indices of the floors of each part; None: all floors.
        Yields: figure by figure, entry by entry and part by part: what names the row of a table; the part's place;
            the comparison, whose ``p_holm`` is corrected over entries and parts, for each figure by itself.
        """
        names = [entry.label for entry in self.league.entries]
        against = reference_in(self.league.entries, reference)
        of_reference = [self._by_unit(names.index(against), part) for part in parts]
        places = [(k, j) for k, name in enumerate(names) if name != against for j in range(len(parts))]
        compared = [compare(self._by_unit(k, parts[j]), of_reference[j], COMPARED) for k, j in places]
        for found in zip(*compared, strict=True):  # of each figure
            corrected = holm([one.p_value for one in found])
            for (k, j), one, p_holm in zip(places, found, corrected, strict=True):
                yield {"name": names[k], "reference": against}, j, replace(one, p_holm=p_holm)

    def _by_unit(self, entry: int, floors: Sequence[int] | None) -> pl.DataFrame:
        """Return the figures ``COMPARED`` of an entry by unit, with its number as ``run``; see ``by_unit``."""
        of_figures = {figure: self.by_unit(entry, figure, floors) for figure in COMPARED}
        return pl.DataFrame(of_figures, nan_to_null=True).with_row_index("run")

    def boundary_of(self, entry: Entry) -> str:
        """Return the value of the scenario field ``decision.boundary_of`` that an entry runs with."""
        return str(entry.settings.get("decision.boundary_of", self.league.base.decision.boundary_of))

    def worst_floor(self, entry: int) -> tuple[LeagueFloor, Interval]:
        """Return the floor on which an entry errs most, among those with a fill ratio nearest to 1/2, and the error.

        Every other unit serves to choose the floor, and the rest to estimate the forced error on it, so that the choice
        does not bias the estimate. Alternate units are taken because units are sorted by swarm size: with 2 or more
        runs, both halves contain all sizes. With a single unit there is none to estimate with, and the interval is nan.

        Args:
            entry: index of the entry.
        Returns: the floor, and the interval of the forced error.
        """
        floors = self.league.floors
        hard = list(range(len(floors)))
        if self.league.base.sensor.kinds == 2:
            # The 1e-9 is for rounding: f and 1 - f are equally near to 1/2.
            nearest = min(abs(floor.fill_ratio - 0.5) for floor in floors) + 1e-9
            hard = [k for k, floor in enumerate(floors) if abs(floor.fill_ratio - 0.5) <= nearest]
        errors = self.values["forced_error"][entry][hard]  # (hard floors, units)
        choosing, estimating = errors[:, ::2], errors[:, 1::2]
        worst = int(choosing.mean(axis=1).argmax())
        return floors[hard[worst]], BY_NAME["forced_error"].mean(estimating[worst])

    @cached_property
    def table(self) -> pl.DataFrame:
        """The standings, one row per entry, by rising forced error, then decision time, then name.

        An entry whose forced error is undefined (null) comes last.

        Columns: name, strategy, bytes_on_air, told (the prior knowledge that robots need), ``FIGURES``, worst_floor and
        worst_floor_error; figures also with ``_low`` and ``_high``.
        """
        cells, of_entry, rows = self.league.study.cells, self.league.cells_of_entry, []
        for k, entry in enumerate(self.league.entries):
            row: dict[str, Any] = {
                "name": entry.label,
                "strategy": entry.strategy,
                "bytes_on_air": strategy_used(cells[k * of_entry].scenario).bytes_on_air,
                "told": ", ".join(told(strategy(entry.strategy), self.boundary_of(entry))),
            }
            for figure in FIGURES:
                row |= columns_of(figure, self.interval(k, figure))
            floor, found = self.worst_floor(k)
            row |= {
                "worst_floor": f"{floor.pattern} {stated(floor.fill_ratio)}",
                **columns_of("worst_floor_error", found),
            }
            rows.append(row)
        return pl.DataFrame(rows).sort("forced_error", "decision_time_s", "name", nulls_last=True)

    @cached_property
    def summary(self) -> pl.DataFrame:
        """All figures of each cell of the ``main`` entries, as a study has them (``summary.Outcome.table``)."""
        labels = {entry.label for entry in main_entries(self.league.entries)}
        main = self.study.select(cell for cell in self.study.cells if cell.point[LABEL] in labels)
        return outcome_of(main, compare=False).table

    @cached_property
    def maps(self) -> pl.DataFrame:
        """How good the maps of entries are whose robots keep them: name, runs, ``map_figures.MAPPED`` with limits.

        Figures are averaged over the floors that have them, then over units. There are no rows if no robots keep maps.
        """
        unit = (
            pl.col("cell") % len(self.league.robots),
            "run",
        )  # cells are by entry, then floor, then swarm size
        labels, rows = {entry.label for entry in self.league.entries}, []
        with_maps = [cell for cell in self.study.cells if keeps_map(cell.scenario)]
        if not with_maps:
            return pl.DataFrame()
        by_entry = pl.col("cell") // self.league.cells_of_entry
        for (_,), own in self.study.rows(*MAPPED, cells=with_maps).group_by(by_entry, maintain_order=True):
            label = self.study.cells[own["cell"][0]].point[LABEL]
            units = own.group_by(*unit, maintain_order=True).agg(pl.col(MAPPED).mean())
            if label in labels:
                row: dict[str, Any] = {"name": label, "runs": units.height}
                for figure in MAPPED:
                    row |= columns_of(
                        figure, BY_NAME[figure].mean(numbers(units[figure]), t_end_s=self.t_end_s)
                    )
                rows.append(row)
        return pl.DataFrame(rows, infer_schema_length=None)

    @cached_property
    def floor_table(self) -> pl.DataFrame:
        """All figures, with limits, of each entry on each floor: one row per entry and floor."""
        rows = []
        for k, entry in enumerate(self.league.entries):
            for place, floor in enumerate(self.league.floors):
                row: dict[str, Any] = {
                    "name": entry.label,
                    "strategy": entry.strategy,
                    "pattern": floor.pattern,
                    "fill_ratio": floor.fill_ratio,
                }
                for figure in FIGURES:
                    row |= columns_of(figure, self.interval(k, figure, [place]))
                rows.append(row)
        return pl.DataFrame(rows)

    def differences(self, reference: str | None = None) -> pl.DataFrame:
        """Compare each entry with a reference, unit by unit.

        Args:
            reference: see ``reference_in``.
        Returns: one row per figure of ``COMPARED`` and entry: name, reference, figure, difference (entry - reference)
            with its 95 % limits, p_value of a paired t-test, p_holm (corrected over the entries, for each figure by
            itself). Empty for a single entry.
        Raises:
            InputError: no entry is so named.
        """
        rows = [
            {
                **named,
                "figure": one.figure,
                **columns_of("difference", one.difference),
                "p_value": plain(one.p_value),
                "p_holm": plain(one.p_holm),
            }
            for named, _, one in self._compared(reference, [None])
        ]
        return pl.DataFrame(rows, schema=DIFFERENCES)

    def floor_differences(self, reference: str | None = None) -> pl.DataFrame:
        """Compare each entry with a reference on each floor, unit by unit.

        Args:
            reference: see ``reference_in``.
        Returns: one row per figure of ``COMPARED``, entry and floor: name, reference, pattern, fill_ratio, figure,
            difference (entry - reference), p_value of a paired t-test, p_holm (corrected over entries and floors,
            for each figure by itself). Empty for a single entry.
        Raises:
            InputError: no entry is so named.
        """
        floors = self.league.floors
        rows = [
            {
                **named,
                "pattern": floors[place].pattern,
                "fill_ratio": floors[place].fill_ratio,
                "figure": one.figure,
                "difference": plain(one.difference.estimate),
                "p_value": plain(one.p_value),
                "p_holm": plain(one.p_holm),
            }
            for named, place, one in self._compared(reference, [[k] for k in range(len(floors))])
        ]
        return pl.DataFrame(rows, schema=FLOOR_DIFFERENCES)


def standings_of(league: League, study: Runs) -> Standings:
    """Compute the standings of a league from the result of its study.

    Args:
        league: the league. study: the result of ``league.study``.
    Raises:
        InputError: runs are missing, for example because some failed.
    """
    # The cells of a league are ordered by entry, then floor, then swarm size; the units by swarm size, then run.
    shape = (len(league.entries), len(league.floors), len(league.robots) * league.runs)
    of_run = study.by_run(list(SHOWN.values()))
    # Options of a strategy may change the size of its messages.
    bytes_on_air = [strategy_used(cell.scenario).bytes_on_air for cell in league.study.cells]
    found = {name: of_run[figure] for name, figure in SHOWN.items()}
    found["bytes_sent"] = found["sent"] * np.array(bytes_on_air)[:, None]
    values = {name: found[name].reshape(shape) for name in FIGURES}
    return Standings(league, values, study)
