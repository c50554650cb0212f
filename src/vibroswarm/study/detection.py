"""Detection as a study: how many robots, and how much time, for few misses and few false alarms.

``detection_study`` makes the study of random floors around a boundary, ``detection_of`` reads its runs
(``analysis.detection``), ``detect`` does both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.analysis.decidability import decidability
from vibroswarm.analysis.detection import detection_curve, needed, pairs
from vibroswarm.analysis.incidence import READ
from vibroswarm.analysis.intervals import wilson_limits
from vibroswarm.analysis.map_figures import MAPPED, keeps_map
from vibroswarm.core.numbers import stated
from vibroswarm.errors import InputError, named
from vibroswarm.floors.source import resolve, source_of
from vibroswarm.inference.outcomes import costs_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.study.run import run
from vibroswarm.study.spec import Study
from vibroswarm.study.study_result import StudyResult
from vibroswarm.study.summary import outcome_of

FILLS: Final = (0.24, 0.32, 0.36, 0.40, 0.44, 0.48, 0.52, 0.56, 0.60, 0.64, 0.68, 0.76)
"""Fill ratios around a boundary of one half."""
TIMES_ROBOTS: Final = (1, 2, 4)
"""Numbers of robots that are tried, relative to the scenario's."""
LONGER: Final = (1, 2, 4)
"""Ends of the runs that are tried, relative to the scenario's, until some floor is found."""


@dataclass(frozen=True)
class Detection:
    """What a detection found."""

    tables: Mapping[str, pl.DataFrame]
    """``detection``, ``needed`` and ``pairs``, as ``analysis.detection`` makes them; ``maps`` if robots keep maps; and
    ``summary``, all figures of each cell (``Outcome.table``)."""
    scenario: Scenario
    """The scenario of all runs, in which floor and number of robots vary."""
    seed: int
    error: float
    """Tolerated probability of a miss."""
    false_alarms: float
    """Tolerated probability of a false alarm."""
    added: tuple[float, ...] = ()
    """Fill ratios below the boundary that were added to the given ones."""
    warnings: tuple[str, ...] = ()
    """Fill ratios on which the swarm cannot be right, however many samples robots take, each as a sentence."""

    @property
    def runs(self) -> int:
        """Runs of each fill ratio and number of robots; the fewest, if some failed."""
        return int(self.tables["needed"]["runs"].min())  # type: ignore[arg-type]

    @property
    def runs_needed(self) -> int:
        """Fewest runs that can show that misses and false alarms are rare enough: with none of them."""
        least = min(self.error, self.false_alarms)
        return next(n for n in count(1) if float(wilson_limits(0, n, 0.95)[1]) < least)

    @property
    def most_wrong(self) -> tuple[int, int]:
        """Most runs of a fill ratio that may be missed, and most that may be false alarms, to show that both are rare
        enough."""
        upper = wilson_limits(range(self.runs + 1), self.runs, 0.95)[1]
        missed, alarms = (int((upper < tolerated).sum()) - 1 for tolerated in (self.error, self.false_alarms))
        return missed, alarms

    @property
    def finds_nothing(self) -> bool:
        """Whether no floor above the boundary is distinguished from one below it, although there are enough runs."""
        found = self.tables["pairs"]["time_s"]
        return self.runs >= self.runs_needed and found.len() > 0 and found.is_null().all()


def detection_study(
    scenario: Scenario, robots: Sequence[int], fills: Sequence[float], runs: int = 300, seed: int = 1
) -> Study:
    """Return the study of random floors of these fill ratios with these numbers of robots.

    Raises:
        InputError: the scenario asks another question than the fill ratio, its floor changes, or a value is wrong.
    """
    if scenario.task.name != "fill_ratio":
        raise InputError(f"must be fill_ratio to detect, not '{scenario.task.name}'", field="task.name")
    if scenario.change.is_given:
        raise InputError(
            "must be left out: what is detected is on a floor that stays; evaluate judges answers on one that changes",
            field="change",
        )
    study = Study.of(
        scenario,
        runs,
        seed,
        # the varied fields; `__` stands for the dot in a field's name
        swarm__robots=list(robots),
        floor__source=[source_of("random", fill) for fill in fills],
    )
    return replace(study, name="Detection", command="detect")


def detection_of(
    result: StudyResult, error: float, false_alarms: float | None = None, added: Sequence[float] = ()
) -> Detection:
    """Return what the runs of a ``detection_study`` say.

    Args:
        error: tolerated probability of a miss. false_alarms: that of a false alarm; by default ``error``, or with
            ``task.costs`` as many as cost the same. added: fill ratios that the user did not ask for.
    """
    study = result.study
    scenario = study.cells[0].scenario
    alarms = _alarms_for(scenario, error) if false_alarms is None else false_alarms
    # for each cell: its table of robots and its table of runs
    cells = [result.tables(number, (*READ, "fill_ratio")) for number in result.selected]
    need = needed(cells, scenario.run.t_end_s, error, false_alarms=alarms)
    curve = detection_curve(cells, scenario.run.t_end_s)
    summary = outcome_of(result, compare=False).table
    tables = {"detection": curve, "needed": need, "pairs": pairs(need), "summary": summary}
    if keeps_map(scenario):
        fills = pl.Series("fill_ratio", [runs["fill_ratio"][0] for _, runs in cells])
        tables["maps"] = _maps(summary.with_columns(fills))
    return Detection(tables, scenario, study.seed, error, alarms, tuple(added), tuple(_warnings(study)))


def detect(
    scenario: Scenario,
    error: float = 0.05,
    false_alarms: float | None = None,
    *,
    robots: Sequence[int] | None = None,
    fills: Sequence[float] | None = None,
    runs: int = 300,
    seed: int = 1,
    folder: Path | None = None,
    **how: Any,
) -> Detection:
    """Find out how many robots and how much time it takes to keep misses and false alarms rare.

    Runs end later if no floor is found by the scenario's end (``LONGER``).

    Args:
        scenario: such as one of ``words.detection_scenario``; its floor is not used.
        error, false_alarms: tolerated probabilities.
        robots: by default ``TIMES_ROBOTS`` times the scenario's number. fills: fill ratios of random floors; by default
            those of ``fills_around``. runs: per cell. folder: where runs are saved.
        how: further arguments of ``study.run.run``, such as workers.
    """
    found = detect_by(
        lambda study, place: run(study, place, **how),
        scenario,
        error,
        false_alarms,
        robots=robots,
        fills=fills,
        runs=runs,
        seed=seed,
        folder=folder,
    )
    assert found is not None  # `run` returns all runs
    return found


def detect_by(
    run_study: Callable[[Study, Path | None], StudyResult | None],
    scenario: Scenario,
    error: float,
    false_alarms: float | None,
    *,
    robots: Sequence[int] | None,
    fills: Sequence[float] | None,
    runs: int,
    seed: int,
    folder: Path | None,
) -> Detection | None:
    """Do what ``detect`` does with another function that runs a study in a folder.

    Args:
        run_study: returns None if it did only a part of the runs; then so does this function.
    """
    sizes = sizes_of(scenario) if robots is None else robots
    shares, added = fills_around(scenario, fills)
    found = None
    for longer in LONGER:
        later = {"run.t_end_s": scenario.run.t_end_s * longer} if longer > 1 else {}
        study = detection_study(scenario.with_values(later), sizes, shares, runs, seed)
        place = folder if folder is None or longer == 1 else folder / f"{longer}-times-longer"
        result = run_study(study, place)
        if result is None:
            return None
        found = detection_of(result, error, false_alarms, added)
        if not found.finds_nothing:
            break
    return found


def _maps(cells: pl.DataFrame) -> pl.DataFrame:
    """Return fill ratio, robots, runs and figures of maps with limits, a row for each cell."""
    figures = [f"{name}{end}" for name in MAPPED for end in ("", "_low", "_high")]
    rows = cells.select("fill_ratio", "runs", *figures, robots="swarm.robots")
    return rows.sort("fill_ratio", "robots")


def sizes_of(scenario: Scenario) -> tuple[int, ...]:
    """Return the numbers of robots that are tried for a scenario."""
    return tuple(scenario.swarm.robots * times for times in TIMES_ROBOTS)


def fills_around(scenario: Scenario, given: Sequence[float] | None = None) -> tuple[list[float], list[float]]:
    """Return the fill ratios to simulate, and which of these were added to the given ones.

    False alarms can occur only on floors below the boundary. So if no given fill ratio is below the boundary, some fill
    ratios below it are added. Given fill ratios are not rounded: one that is no whole number of tiles is refused.

    Args:
        given: None to use fill ratios around the boundary.
    Returns:
        All fill ratios, the added ones first; and the added ones, an empty list if none was added or ``given`` is None.
    Raises:
        InputError: a given fill ratio is no whole number of tiles.
    """
    boundary, tiles = scenario.decision.decision_boundary, scenario.floor.rows * scenario.floor.columns

    def in_tiles(shares: Iterable[float]) -> list[float]:
        """Limit fill ratios to 0..1 and round them to whole tiles; drop repeats and the boundary.

        On a floor whose fill ratio is the boundary, no decision is right.
        """
        fills = dict.fromkeys(round(tiles * min(max(share, 0.0), 1.0)) / tiles for share in shares)
        return [fill for fill in fills if abs(fill - boundary) > 1e-9]  # 1e-9 allows for rounding errors

    below = [fill for fill in in_tiles((0.0, boundary / 3, boundary * 2 / 3)) if fill < boundary]
    if given is not None:
        with named("fills"):  # refuses those that the scenario's floors cannot have
            for fill in given:
                resolve(source_of("random", fill), (scenario.floor.rows, scenario.floor.columns))
        added = [] if any(fill < boundary for fill in given) else below
        return [*added, *given], added
    if boundary == 0.5:  # FILLS are chosen for this boundary
        return in_tiles(FILLS), []
    # Floors are hardest near the boundary, so the fill ratios above it are dense there. The unit of distance is a third
    # of the way from the boundary to 0 or to 1, whichever is nearer.
    step = min(boundary, 1.0 - boundary) / 3
    above = in_tiles(boundary + step * times for times in (1, 2, 3, 5, 7))
    return below + [fill for fill in above if fill > boundary], []


MOST_ALARMS: Final = 0.5
"""Largest tolerated probability of a false alarm that follows from costs."""


def _alarms_for(scenario: Scenario, error: float) -> float:
    """Return the probability of false alarms that costs as much as this probability of misses."""
    costs = costs_of(scenario)
    if costs is None:
        return error
    miss, alarm = costs[1, 0], costs[0, 1]
    return float(min(error * miss / alarm, MOST_ALARMS)) if alarm > 0 else MOST_ALARMS


def _warnings(study: Study) -> list[str]:
    """Return a sentence for each fill ratio on which the swarm cannot be right, however many samples robots take."""
    verdicts = [decidability(cell.scenario) for cell in study.cells]
    return list(
        # Each sentence once: cells that differ only in the number of robots may give the same sentence.
        dict.fromkeys(
            f"fill ratio {stated(verdict.fill_ratio)}: {verdict.says}"
            for verdict in verdicts
            if verdict.is_warning
        )
    )
