"""Run a league and compute its standings: time and error of each strategy over all floors, with intervals.

| column | what it is |
|---|---|
| forced_error | share of robots wrong, or undecided and leaning to the wrong side (``analysis.forced_error``) |
| right, wrong, undecided | shares of robots |
| decision_time_s | mean of min(decision time, T_end), s |
| sent | messages that a robot sends in a run |
| bytes_sent | the same in bytes: ``sent`` times the bytes of one message |

**The unit is the motion of a run.** All strategies and floors share the motion of run r of a swarm size, so outcomes on
different floors are dependent. Each figure is therefore averaged over the floors first, and intervals are over the
(size, run) pairs. Strategies are compared with a reference pair by pair; the p-values of each figure are corrected over
the strategies, or over strategies and floors (Holm). The floors are given, not drawn: figures hold for them, and every
floor counts the same.

**Worst floor**: among the floors nearest to 1/2, that with the largest forced error. It is chosen by half of the units
and measured with the other half, as the largest of several estimates is too large.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.stats import ttest_1samp

from vibroswarm.analysis.forced_error import forced_errors
from vibroswarm.analysis.intervals import Interval, mean_interval, plain, sign_flip
from vibroswarm.analysis.paired import holm
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError, check_choice, shown
from vibroswarm.inference.outcomes import capped_time_s, numbers
from vibroswarm.league.entries import SIZE, Entry, LeagueFloor
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies import strategy
from vibroswarm.strategies.static_analysis import told
from vibroswarm.study.factors import LABEL
from vibroswarm.study.spec import Study
from vibroswarm.study.study_result import StudyResult, run

FIGURES: Final = ("forced_error", "right", "wrong", "undecided", "decision_time_s", "sent", "bytes_sent")
NEEDED: Final = ("cell", "run", "decision", "decision_time_s", "belief_in_truth", "sent", "truth")
"""Columns of a study's rows that are read."""
COMPARED: Final = ("forced_error", "decision_time_s")
Array = NDArray[np.float64]


@dataclass(frozen=True)
class League(NotebookView):
    """Strategies that meet on the same floors, motion, readings and radio.

    Args:
        base: what strategies do not set. entries: the strategies; the first is the reference. floors: all equally
            important. robots: swarm sizes. runs: of each cell. seed: of all.
    Raises:
        InputError: a scenario cannot be run.
    """

    base: Scenario
    entries: tuple[Entry, ...]
    floors: tuple[LeagueFloor, ...]
    robots: tuple[int, ...] = (5, 10)
    runs: int = 1000
    seed: int = 1

    @cached_property
    def study(self) -> Study:
        """The study of all cells: entries, then floors, then sizes, the last varying fastest."""
        players = [
            {LABEL: entry.label, "strategy.name": entry.code or entry.strategy, **entry.settings}
            for entry in self.entries
        ]
        where = {
            "floor.source": [floor.source for floor in self.floors],
            "swarm.robots": list(self.robots),
        }
        floors = {floor.source: floor.tiles for floor in self.floors if floor.tiles is not None}
        return Study(
            self.base.with_values(SIZE),
            {"list": players, "grid": where},
            runs=self.runs,
            seed=self.seed,
            floors=floors,
            name="League",
        )

    def play(self, folder: Path | None = None, **how: Any) -> Standings:
        """Run all cells that are missing in ``folder``.

        Args:
            how: workers and progress, as of ``study.study_result.run``.
        """
        return standings_of(self, run(self.study, folder, **how))


@dataclass(frozen=True)
class Standings(NotebookView):
    """What came of a league.

    Args:
        league: the league. values: (entries, floors, sizes * runs) of each figure, in the order of the league; nan
            where the task has no right answer. study: with all tables.
    """

    league: League
    values: Mapping[str, Array]
    study: StudyResult

    def __repr__(self) -> str:
        league = self.league
        return (
            f"Standings({len(league.entries)} entries, {len(league.floors)} floors, {league.runs:,} runs of each; "
            f"smallest forced error: {shown(self.table['name'][0])})"
        )

    def interval(self, entry: int, figure: str, floors: Sequence[int] | None = None) -> Interval:
        """Return the mean of a figure over floors (by default all) and its 95 % interval."""
        return mean_interval(self.by_unit(entry, figure, floors))

    def by_unit(self, entry: int, figure: str, floors: Sequence[int] | None = None) -> Array:
        """Average a figure over floors, for each size and run: (sizes * runs,)."""
        of_floors = self.values[figure][entry]
        mean: Array = (of_floors if floors is None else of_floors[list(floors)]).mean(axis=0)
        return mean

    def boundary_of(self, entry: Entry) -> str:
        """Return ``decision.boundary_of`` as this entry plays."""
        found: str = entry.settings.get("decision.boundary_of", self.league.base.decision.boundary_of)
        return found

    def worst_floor(self, entry: int) -> tuple[LeagueFloor, Interval]:
        """Return the floor with the largest forced error among those nearest to 1/2, and that error.

        One half of the runs chooses the floor and the other half estimates its error, so that the choice does not
        bias it.
        """
        floors = self.league.floors
        nearest = min(abs(floor.fill_ratio - 0.5) for floor in floors) + 1e-9
        hard = [k for k, floor in enumerate(floors) if abs(floor.fill_ratio - 0.5) <= nearest]
        errors = self.values["forced_error"][entry][hard]
        worst = int(errors[:, ::2].mean(axis=1).argmax())
        return floors[hard[worst]], mean_interval(errors[worst, 1::2])

    @cached_property
    def table(self) -> pl.DataFrame:
        """One row an entry, those with the smallest forced error first: figures with ``_low`` and ``_high``."""
        rows = []
        for k, entry in enumerate(self.league.entries):
            row: dict[str, Any] = {
                "name": entry.label,
                "strategy": entry.strategy,
                "bytes_on_air": entry.bytes_on_air,
                "told": ", ".join(told(strategy(entry.strategy), self.boundary_of(entry))),
            }
            for figure in FIGURES:
                found = self.interval(k, figure)
                row |= _columns(figure, found)
            floor, found = self.worst_floor(k)
            row |= {
                "worst_floor": f"{floor.pattern} {floor.fill_ratio:g}",
                **_columns("worst_floor_error", found),
            }
            rows.append(row)
        return pl.DataFrame(rows).sort("forced_error", "decision_time_s", "name")

    @cached_property
    def floor_table(self) -> pl.DataFrame:
        """One row an entry and floor, with all figures."""
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
                    found = self.interval(k, figure, [place])
                    row |= _columns(figure, found)
                rows.append(row)
        return pl.DataFrame(rows)

    def differences(self, reference: str | None = None) -> pl.DataFrame:
        """Compare each strategy with a reference, pair by pair.

        Args:
            reference: the label of an entry; by default the first.
        Returns: name, reference, figure, difference (entry - reference), its 95 % limits, p_value, p_holm (corrected
        over the entries).
        Raises:
            InputError: the reference does not take part.
        """
        names = [entry.label for entry in self.league.entries]
        against = names[0] if reference is None else reference
        check_choice(against, "reference", names)
        rows = []
        for figure in COMPARED:
            base = self.by_unit(names.index(against), figure)
            others = [k for k, name in enumerate(names) if name != against]
            found = [sign_flip(self.by_unit(k, figure) - base) for k in others]
            corrected = holm([one.p_value for one in found])
            for k, one, p_holm in zip(others, found, corrected, strict=True):
                rows.append(
                    {
                        "name": names[k],
                        "reference": against,
                        "figure": figure,
                        **_columns("difference", one.interval),
                        "p_value": plain(one.p_value),
                        "p_holm": plain(p_holm),
                    }
                )
        return pl.DataFrame(rows)

    def floor_differences(self, reference: str | None = None) -> pl.DataFrame:
        """Compare each strategy with a reference on each floor, pair by pair.

        Args:
            reference: the label of an entry; by default the first.
        Returns: name, reference, pattern, fill_ratio, figure, difference (entry - reference), p_value of a paired
        t-test, p_holm (corrected over the entries and floors).
        Raises:
            InputError: the reference does not take part.
        """
        names = [entry.label for entry in self.league.entries]
        against = names[0] if reference is None else reference
        check_choice(against, "reference", names)
        others = [k for k, name in enumerate(names) if name != against]
        rows = []
        for figure in COMPARED:
            values = self.values[figure]
            differences = values[others] - values[names.index(against)]  # entries, floors, units
            p_values = np.array([[_p_of_mean(d) for d in of_entry] for of_entry in differences])
            corrected = np.array(holm(p_values.ravel().tolist())).reshape(p_values.shape)
            for place, k in enumerate(others):
                for number, floor in enumerate(self.league.floors):
                    rows.append(
                        {
                            "name": names[k],
                            "reference": against,
                            "pattern": floor.pattern,
                            "fill_ratio": floor.fill_ratio,
                            "figure": figure,
                            "difference": plain(float(differences[place, number].mean())),
                            "p_value": plain(float(p_values[place, number])),
                            "p_holm": plain(float(corrected[place, number])),
                        }
                    )
        return pl.DataFrame(rows, infer_schema_length=None)


def _p_of_mean(differences: Array) -> float:
    """Return the two-sided p-value of a paired t-test; nan if it is undefined.

    If all differences are equal it is 1 if they are 0, else 0.
    """
    if differences.size < 2 or np.isnan(differences).any():
        return np.nan
    if np.ptp(differences) == 0.0:
        return 1.0 if differences[0] == 0.0 else 0.0
    return float(ttest_1samp(differences, 0.0).pvalue)


def _columns(name: str, interval: Interval) -> dict[str, float | None]:
    """Return an estimate and its limits; None for what is not finite."""
    values = (interval.estimate, interval.low, interval.high)
    return {f"{name}{end}": plain(value) for end, value in zip(("", "_low", "_high"), values, strict=True)}


def standings_of(league: League, study: StudyResult) -> Standings:
    """Read the figures of all runs of a league.

    Raises:
        InputError: runs are missing, for example because some failed.
    """
    sizes, runs = len(league.robots), league.runs
    shape = (len(league.entries), len(league.floors), sizes * runs)
    values = {name: np.full(shape, np.nan) for name in FIGURES}
    cells, of_entry = study.study.cells, len(league.floors) * sizes
    for k, entry in enumerate(league.entries):
        mine = cells[k * of_entry : (k + 1) * of_entry]
        rows = study.rows(*(cell.number for cell in mine)).select(NEEDED).collect()
        by_cell = rows.partition_by("cell", maintain_order=True, as_dict=True)
        for place, cell in enumerate(mine):
            floor, size = divmod(place, sizes)
            robots = by_cell.get((cell.number,), rows.clear())
            if robots.height != runs * league.robots[size]:
                there = robots["run"].n_unique()
                raise InputError(f"has {there} of {runs} runs; run it again", field=cell.name)
            figures = figures_by_run(robots, runs, cell.scenario.run.t_end_s, entry.bytes_on_air)
            for name, column in figures.items():
                values[name][k, floor, size * runs : (size + 1) * runs] = column
    return Standings(league, values, study)


def figures_by_run(robots: pl.DataFrame, runs: int, t_end_s: float, bytes_on_air: int) -> dict[str, Array]:
    """Average the figures over the robots of each run.

    Args:
        robots: rows of one cell, sorted by run and robot, with the columns ``NEEDED``. t_end_s: end of a run, s.
        bytes_on_air: of one message.
    Returns: ``FIGURES``, (runs,) each; forced error and shares right and wrong are nan if no decision is right.
    """
    shape = (runs, -1)
    decision = robots["decision"].to_numpy().reshape(shape)
    truth, time_s, in_truth, sent = (
        numbers(robots[name]).reshape(shape)
        for name in ("truth", "decision_time_s", "belief_in_truth", "sent")
    )
    unknown = np.isnan(truth)
    by_robot = {
        "forced_error": forced_errors(decision, in_truth, truth),
        "right": np.where(unknown, np.nan, decision == truth),
        "wrong": np.where(unknown, np.nan, decision == 1.0 - truth),
        "undecided": (decision == -1).astype(np.float64),
        "decision_time_s": capped_time_s(time_s, t_end_s),
        "sent": sent,
        "bytes_sent": sent * bytes_on_air,
    }
    return {name: by_robot[name].mean(axis=1) for name in FIGURES}
