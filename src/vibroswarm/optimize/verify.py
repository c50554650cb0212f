"""Verify saved runs: simulate a sample of them again from their seed, and compare the tables bit by bit.

Every run is determined by its scenario, seed and number, so a run that differs was made by other code or other versions
of libraries, on another processor architecture, or its files were changed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
from polars.testing import assert_frame_equal

from vibroswarm.analysis.intervals import Interval, generator, wilson
from vibroswarm.core.folders import KINDS, read_manifest
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError, path_of, whole_number_of
from vibroswarm.inference.outcomes import ROBOTS, RUNS
from vibroswarm.optimize.evaluate import do_piece
from vibroswarm.optimize.loop import recorded_runs
from vibroswarm.optimize.spec import Search
from vibroswarm.optimize.steps import SEARCH, versions_of
from vibroswarm.result import TABLES, Result
from vibroswarm.simulation import simulate, versions
from vibroswarm.study.study_result import StudyResult

RUNS_AGAIN: Final = 20
"""Runs that are simulated again unless another number is asked for."""
COMPARED: Final[dict[str, Any]] = {
    "cell": pl.String,
    "run": pl.UInt32,
    "same": pl.Boolean,
    "tables": pl.String,
}
"""Columns of ``Verified.runs``; ``tables`` names the tables that differ."""


@dataclass(frozen=True)
class Verified(NotebookView):
    """Runs that were simulated again."""

    folder: Path
    runs: pl.DataFrame
    """One row for each run that was simulated again, ``COMPARED``."""
    saved: int
    """Number of runs in the folder."""
    other_versions: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Software of which another version made the runs: that version, and the one at hand."""

    @property
    def same(self) -> int:
        """Number of runs that came out the same."""
        return int(self.runs["same"].sum())

    @property
    def holds(self) -> bool:
        """Whether all of them came out the same."""
        return self.same == self.runs.height

    @property
    def share_that_differs(self) -> Interval:
        """Share of all saved runs that would differ, from the sample, with Wilson's 95 % limits."""
        return wilson(self.runs.height - self.same, self.runs.height)


def verify(
    folder: str | Path,
    runs: int = RUNS_AGAIN,
    seed: int = 1,
    progress: Callable[[float], None] | None = None,
) -> Verified:
    """Simulate a sample of the runs of a folder again, and compare their tables with the saved ones.

    Args:
        folder: of a result, a study (also of a league or a detection), or a search, whose steps are compared. runs:
            number of runs, drawn from all saved ones; if there are fewer, all. seed: of the draw. progress: called with
            the share of the runs that is done.
    Raises:
        InputError: the folder holds none of these, recorded runs (which no seed repeats), no runs, or user code that is
            not loaded.
    """
    folder = path_of(folder, "folder")
    runs = whole_number_of(runs, "runs", 1, 10**6)
    report = progress or (lambda done: None)
    kind = str(read_manifest(folder)["kind"])
    if kind == "study":
        return _of_study(StudyResult.open(folder), runs, seed, report)
    if kind == "search":
        return _of_search(folder, runs, seed, report)
    if kind == "result":
        return _of_result(folder, Result.read(folder), runs, seed, report)
    if kind == "recording":
        raise InputError(
            "holds recorded runs, which no seed repeats; 'lab replay' judges them", field=str(folder)
        )
    raise InputError(f"holds {KINDS[kind]}, without runs that could be simulated again", field=str(folder))


def _of_result(
    folder: Path, result: Result, runs: int, seed: int, report: Callable[[float], None]
) -> Verified:
    assert result.seed is not None  # only recordings have none
    saved = result.runs["run"].to_list()
    if not saved:
        raise InputError("holds no runs", field=str(folder))
    rows = []
    chosen = _drawn(saved, runs, seed)
    energies = result.observations["energy"].null_count() < result.observations.height
    for place, run in enumerate(chosen):
        again = simulate(
            result.scenario,
            result.seed,
            [run],
            motion=result.source,
            segments=result.segments is not None,
            moves=result.moves is not None,
            energies=energies,
        )
        pairs = {name: (_of_run(getattr(result, name), run), getattr(again, name)) for name in TABLES}
        rows.append(("", run, *_compared(pairs)))
        report((place + 1) / len(chosen))
    table = pl.DataFrame(rows, schema=COMPARED, orient="row")
    return Verified(folder, table, len(saved), _other_versions([result.versions]))


def _of_study(result: StudyResult, runs: int, seed: int, report: Callable[[float], None]) -> Verified:
    numbers = {cell: result.runs_there(cell, result.runs_of(cell)) for cell in result.selected}
    saved = [(cell, run) for cell, stored in numbers.items() for run in stored]
    if not saved:
        raise InputError("holds no runs", field=str(result.store.folder))
    drawn = _drawn(saved, runs, seed)
    rows = []
    for number in dict.fromkeys(cell for cell, _ in drawn):  # one cell in memory at a time
        cell = result.cell(number)
        robots, of_runs = result.tables(number)
        for run in (run for of, run in drawn if of == number):
            again = simulate(
                cell.scenario, result.study.seed, [run], motion=result.study.motion, energies=False
            )
            pairs = {
                "robots": (_of_run(robots, run), again.robots.select(list(ROBOTS))),
                "runs": (_of_run(of_runs, run, list(RUNS)), again.runs.select(list(RUNS))),
            }
            rows.append((cell.name, run, *_compared(pairs)))
            report(len(rows) / len(drawn))
    table = pl.DataFrame(rows, schema=COMPARED, orient="row")
    return Verified(result.store.folder, table, len(saved), _other_versions(result.store.made_by))


def _of_search(folder: Path, runs: int, seed: int, report: Callable[[float], None]) -> Verified:
    search = Search.read(folder / SEARCH)
    recorded = recorded_runs(search, folder)
    if not recorded:
        raise InputError("holds no runs", field=str(folder))
    rows = []
    drawn = _drawn(recorded, runs, seed)
    for one in drawn:
        again = do_piece(one.piece, search.objectives)
        same = not isinstance(again, str) and np.array_equal(again[0], one.figures)
        rows.append((f"candidate {one.candidate}", one.piece.first, same, "" if same else "steps"))
        report(len(rows) / len(drawn))
    table = pl.DataFrame(rows, schema=COMPARED, orient="row")
    return Verified(folder, table, len(recorded), _other_versions([versions_of(folder)]))


def _drawn(saved: Sequence[Any], count: int, seed: int) -> list[Any]:
    """Draw some of the saved runs without replacement, in their order."""
    places = generator(seed, "runs to verify").permutation(len(saved))[:count]
    return [saved[place] for place in sorted(places)]


def _of_run(table: pl.DataFrame | None, run: int, columns: Sequence[str] = ()) -> pl.DataFrame | None:
    """Return the rows of a run; None without a table, or if an optional table has no row of this run."""
    if table is None:
        return None
    rows = table.filter(pl.col("run") == run)
    return rows.select(columns) if columns else rows


def _compared(pairs: Mapping[str, tuple[pl.DataFrame | None, pl.DataFrame | None]]) -> tuple[bool, str]:
    """Return whether all tables are the same, bit by bit, and the names of those that are not."""
    differing = [name for name, (mine, theirs) in pairs.items() if not _same(mine, theirs)]
    return not differing, ", ".join(differing)


def _same(mine: pl.DataFrame | None, theirs: pl.DataFrame | None) -> bool:
    # A table that a result of several runs has, such as that of failures, is absent if this run has no row in it.
    if mine is None or theirs is None:
        return (mine is None or mine.is_empty()) and (theirs is None or theirs.is_empty())
    try:
        assert_frame_equal(mine, theirs, check_exact=True)
    except AssertionError:
        return False
    return True


def _other_versions(made_by: Sequence[Mapping[str, str]]) -> dict[str, tuple[str, str]]:
    own = versions()
    return {
        name: (of[name], own[name]) for of in made_by for name in own if name in of and of[name] != own[name]
    }
