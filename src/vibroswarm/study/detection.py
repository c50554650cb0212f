"""Detection as a study: how many robots, and how much time, for few misses and few false alarms.

``detection_study`` makes the study of random floors around a boundary, ``detection_of`` reads its runs
(``statistics.detection``).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Final

import polars as pl

from vibroswarm.core.numbers import stated
from vibroswarm.errors import InputError
from vibroswarm.floors.source import source_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.statistics.decidability import decidability
from vibroswarm.statistics.detection import detection_curve, needed, pairs
from vibroswarm.statistics.intervals import wilson_limits
from vibroswarm.statistics.map_figures import MAPPED, keeps_map
from vibroswarm.study.runs import Runs
from vibroswarm.study.spec import Study
from vibroswarm.study.summary import outcome_of

FILLS: Final = (0.24, 0.32, 0.36, 0.40, 0.44, 0.48, 0.52, 0.56, 0.60, 0.64, 0.68, 0.76)
"""Fill ratios around a boundary of one half."""
TIMES_ROBOTS: Final = (1, 2, 4)
"""Numbers of robots that are tried, relative to the scenario's."""


@dataclass(frozen=True)
class Detection:
    """What a detection found."""

    tables: Mapping[str, pl.DataFrame]
    """``detection``, ``needed`` and ``pairs``, as ``statistics.detection`` makes them; ``maps`` if robots keep maps;
    and ``summary``, all figures of each cell (``Outcome.table``)."""
    scenario: Scenario
    """The scenario of all runs, in which floor and number of robots vary."""
    seed: int
    error: float
    """Tolerated probability of a miss."""
    false_alarms: float
    """Tolerated probability of a false alarm."""
    warnings: tuple[str, ...] = ()
    """Fill ratios on which the swarm cannot be right, however many samples robots take, each as a sentence."""

    @property
    def runs(self) -> int:
        """Runs of each fill ratio and number of robots."""
        return int(self.tables["needed"]["runs"].min())  # type: ignore[arg-type]

    @property
    def runs_needed(self) -> int:
        """Fewest runs that can show that misses and false alarms are rare enough: with none of them."""
        least = min(self.error, self.false_alarms)
        return next(n for n in count(1) if float(wilson_limits(0, n, 0.95)[1]) < least)


def detection_study(
    scenario: Scenario,
    robots: Sequence[int] | None = None,
    fills: Sequence[float] | None = None,
    runs: int = 300,
    seed: int = 1,
) -> Study:
    """Return the study of random floors of these fill ratios with these numbers of robots.

    Args:
        robots: by default ``TIMES_ROBOTS`` times the scenario's number.
        fills: by default those of ``fills_around``. False alarms need some below the boundary.
    Raises:
        InputError: the scenario asks another question than the fill ratio, its floor changes, or a value is wrong.
    """
    if scenario.task.name != "fill_ratio":
        raise InputError(f"must be fill_ratio to detect, not '{scenario.task.name}'", field="task.name")
    if scenario.change.is_given:
        raise InputError("must be left out: what is detected is on a floor that stays", field="change")
    sizes = [scenario.swarm.robots * times for times in TIMES_ROBOTS] if robots is None else list(robots)
    floors = [source_of("random", fill) for fill in (fills_around(scenario) if fills is None else fills)]
    return replace(
        Study.of(scenario, runs, seed, swarm__robots=sizes, floor__source=floors), name="Detection"
    )


def detection_of(runs: Runs, error: float = 0.05, false_alarms: float | None = None) -> Detection:
    """Return what the runs of a ``detection_study`` say.

    Args:
        error: tolerated probability of a miss. false_alarms: that of a false alarm; by default ``error``.
    """
    scenario, alarms = runs.cells[0].scenario, error if false_alarms is None else false_alarms
    runs.check_complete()
    cells = [runs.tables(cell) for cell in runs.cells]
    need = needed(cells, scenario.run.t_end_s, error, false_alarms=alarms)
    curve = detection_curve(cells, scenario.run.t_end_s)
    summary = outcome_of(runs, compare=False).table
    tables = {"detection": curve, "needed": need, "pairs": pairs(need), "summary": summary}
    if keeps_map(scenario):
        figures = [f"{name}{end}" for name in MAPPED for end in ("", "_low", "_high")]
        fills = pl.Series("fill_ratio", [table["fill_ratio"][0] for _, table in cells])
        maps = summary.with_columns(fills).select("fill_ratio", "runs", *figures, robots="swarm.robots")
        tables["maps"] = maps.sort("fill_ratio", "robots")
    verdicts = [decidability(cell.scenario) for cell in runs.cells]
    warnings = dict.fromkeys(
        f"fill ratio {stated(verdict.fill_ratio)}: {verdict.says}"
        for verdict in verdicts
        if verdict.is_warning
    )
    return Detection(tables, scenario, runs.seed, error, alarms, tuple(warnings))


def fills_around(scenario: Scenario) -> list[float]:
    """Return the fill ratios to simulate: some below the boundary, and others above it, whole numbers of tiles."""
    boundary, tiles = scenario.decision.decision_boundary, scenario.floor.rows * scenario.floor.columns

    def in_tiles(shares: Iterable[float]) -> list[float]:
        fills = dict.fromkeys(round(tiles * min(max(share, 0.0), 1.0)) / tiles for share in shares)
        # On a floor whose fill ratio is the boundary, no decision is right; 1e-9 allows for rounding errors.
        return [fill for fill in fills if abs(fill - boundary) > 1e-9]

    if boundary == 0.5:  # FILLS are chosen for this boundary
        return in_tiles(FILLS)
    below = [fill for fill in in_tiles((0.0, boundary / 3, boundary * 2 / 3)) if fill < boundary]
    # Floors are hardest near the boundary, so the fill ratios above it are dense there. The unit of distance is a third
    # of the way from the boundary to 0 or to 1, whichever is nearer.
    step = min(boundary, 1.0 - boundary) / 3
    above = in_tiles(boundary + step * times for times in (1, 2, 3, 5, 7))
    return below + [fill for fill in above if fill > boundary]
