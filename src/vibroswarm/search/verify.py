"""Verify saved runs: simulate a sample of them again from their seed, and compare the tables bit by bit.

Every run is determined by its scenario, seed and number, so a run that differs was made by other code or other versions
of libraries, on another kind of processor, or its files were changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.atomic_io import MANIFEST
from vibroswarm.core.folders import KINDS, read_manifest
from vibroswarm.core.untrusted_files import read_text
from vibroswarm.errors import InputError, whole_number_of
from vibroswarm.result import TABLES, Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.search.evaluate import do_piece
from vibroswarm.search.loop import recorded_runs
from vibroswarm.search.steps import STEPS, FreshFolder, RecordedRun, read_step, saved_search, versions_of
from vibroswarm.simulation import simulate, versions
from vibroswarm.statistics.intervals import Interval, generator, wilson
from vibroswarm.study.batch import Task, simulate_runs
from vibroswarm.study.store import FOLDER, SCENARIOS, Store

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
class Verified:
    """Runs that were simulated again."""

    folder: Path
    runs: pl.DataFrame
    """One row for each run that was simulated again, ``COMPARED``."""
    saved: int
    """Number of runs in the folder."""
    damaged: tuple[str, ...] = ()
    """Files that cannot be read, whose runs are not among those that are drawn, with what is wrong."""
    other_versions: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Software of which another version made the runs: that version, and the one at hand."""

    @property
    def same(self) -> int:
        """Number of runs that came out the same."""
        return int(self.runs["same"].sum())

    @property
    def holds(self) -> bool:
        """Whether all of them came out the same, and no file is damaged."""
        return self.same == self.runs.height and not self.damaged

    @property
    def share_that_differs(self) -> Interval:
        """Share of all saved runs that would differ, from the sample, with Wilson's 95 % limits."""
        return wilson(self.runs.height - self.same, self.runs.height)


@dataclass(frozen=True)
class _Part:
    """A folder within the verified one that holds runs."""

    saved: Sequence[Any]
    """Its saved runs, in a form that ``again`` takes."""
    again: Callable[[Sequence[Any]], Iterator[tuple[str, int, bool, str]]]
    """Simulates some of them again; yields a row of ``COMPARED`` for each."""
    made_by: Sequence[Mapping[str, str]]
    """Versions that made it."""
    damaged: Sequence[str] = ()
    """As in ``Verified``."""


def verify(
    folder: str | Path,
    runs: int = RUNS_AGAIN,
    seed: int = 1,
    progress: Callable[[float], None] = lambda share: None,
) -> Verified:
    """Simulate a sample of the runs of a folder again, and compare their tables with the saved ones.

    Args:
        folder: of a result, a study (also of a league or a detection), a search (runs of its steps and fresh runs), or
            a reproduction. Runs of folders within, such as the tests of a league, are among those that are drawn, but
            not runs of studies that another version of the code made.
        runs: number of runs, drawn from all saved ones; if there are fewer, all. seed: of the draw.
        progress: called with the share of the runs that is done.
    Raises:
        InputError: the folder holds none of these, recorded runs (which no seed repeats), no runs, or user code that is
            not loaded.
    """
    folder = Path(folder)
    runs = whole_number_of(runs, "runs", 1, 10**6)
    kind = str(read_manifest(folder)["kind"])
    if kind == "recording":
        raise InputError(
            "holds recorded runs, which no seed repeats; 'lab replay' judges them", field=str(folder)
        )
    parts = _parts(folder)
    if not parts:
        raise InputError(
            f"holds {KINDS[kind]}, without runs that could be simulated again", field=str(folder)
        )
    saved = [(place, one) for place, part in parts.items() for one in part.saved]
    damaged = tuple(one for part in parts.values() for one in part.damaged)
    if not saved:
        raise InputError(f"holds no runs{''.join(f'; damaged: {one}' for one in damaged)}", field=str(folder))
    drawn = _drawn(saved, runs, seed)
    rows = []
    for place in dict.fromkeys(place for place, _ in drawn):
        within = "" if place == folder else place.relative_to(folder).as_posix()
        for cell, *row in parts[place].again([one for of, one in drawn if of == place]):
            rows.append((": ".join(filter(None, (within, cell))), *row))
            progress(len(rows) / len(drawn))
    made_by = [versions for part in parts.values() for versions in part.made_by]
    table = pl.DataFrame(rows, schema=COMPARED, orient="row")
    return Verified(folder, table, len(saved), damaged, _other_versions(made_by))


def _parts(folder: Path) -> dict[Path, _Part]:
    """Return a folder and those within it that hold runs, by path; unfinished temporary folders are left out."""
    kinds = {"result": _of_result, "search": _of_search}
    places = sorted(path.parent for path in folder.rglob(MANIFEST))
    parts = {
        place: kinds[kind](place)
        for place in places
        if not any(name.startswith(".") for name in place.relative_to(folder).parts)
        and (kind := str(read_manifest(place)["kind"])) in kinds
    }
    stores = sorted(path.parent for path in folder.rglob(f"{FOLDER}/{SCENARIOS}"))
    return parts | {path.parent: _of_store(path.parent) for path in stores}


def _of_result(folder: Path) -> _Part:
    result = Result.read(folder)
    seed = result.seed
    assert seed is not None  # only recordings have none
    energies = result.observations["energy"].null_count() < result.observations.height

    def again(chosen: Sequence[int]) -> Iterator[tuple[str, int, bool, str]]:
        for run in chosen:
            one = simulate(
                result.scenario,
                seed,
                [run],
                motion=result.source,
                poses=result.poses is not None,
                moves=result.moves is not None,
                energies=energies,
            )
            pairs = {name: (_of_run(getattr(result, name), run), getattr(one, name)) for name in TABLES}
            yield "", run, *_compared(pairs)

    return _Part(result.runs["run"].to_list(), again, [result.versions])


def _of_store(folder: Path) -> _Part:
    """Return the runs of a folder of studies, which are drawn by key and number."""
    stores = [Store(folder, seed, motion) for seed, motion in Store.worlds(folder)]
    saved = [
        (store, key, run)
        for store in stores
        for key, ranges in sorted(store.ranges.items())
        for run in sorted({run for first, last in ranges for run in range(first, last)})
    ]

    def again(chosen: Sequence[tuple[Store, str, int]]) -> Iterator[tuple[str, int, bool, str]]:
        for store, key, run in chosen:
            text = read_text(store.folder / SCENARIOS / f"{key}.toml", "a scenario")
            scenario = Scenario.from_toml(text)
            found = store.scan([key], run + 1)
            assert found is not None  # it is among those that are saved
            world = store.world
            task = Task(((key, text),), run, run + 1, world["seed"], world["motion"], world["code"])
            mine, theirs = found.filter(pl.col("run") == run).collect(), simulate_runs(task)
            differing = [
                name for name in mine.columns if not mine[name].equals(theirs[name], null_equal=True)
            ]
            yield scenario.strategy.name, run, not differing, ", ".join(differing)

    damaged = [str(path) for store in stores[:1] for path in store.damaged]
    return _Part(saved, again, [versions for store in stores for versions in store.made_by], damaged)


def _of_search(folder: Path) -> _Part:
    search = saved_search(folder)
    fresh, damaged = FreshFolder(folder, search).recorded()
    for path in sorted((folder / STEPS).glob("*.json")):
        try:
            read_step(path, search)
        except InputError as error:
            damaged.append(str(error))

    def again(chosen: Sequence[RecordedRun]) -> Iterator[tuple[str, int, bool, str]]:
        for saved in chosen:
            found = do_piece(saved.piece, search.objectives)
            width = saved.figures.shape[1]
            same = not isinstance(found, str) and np.array_equal(found[0, :, :width], saved.figures)
            yield saved.name, saved.piece.first, same, "" if same else saved.table

    return _Part([*recorded_runs(search, folder), *fresh], again, [versions_of(folder)], damaged)


def _drawn(saved: Sequence[Any], count: int, seed: int) -> list[Any]:
    """Draw some of the saved runs without replacement, in their order."""
    places = generator(seed, "runs to verify").permutation(len(saved))[:count]
    return [saved[place] for place in sorted(places)]


def _of_run(table: pl.DataFrame | None, run: int) -> pl.DataFrame | None:
    """Return the rows of a run; None without a table."""
    return None if table is None else table.filter(pl.col("run") == run)


def _compared(pairs: Mapping[str, tuple[pl.DataFrame | None, pl.DataFrame | None]]) -> tuple[bool, str]:
    """Return whether all tables are the same, bit by bit, and the names of those that are not."""
    differing = [name for name, (mine, theirs) in pairs.items() if not _same(mine, theirs)]
    return not differing, ", ".join(differing)


def _same(mine: pl.DataFrame | None, theirs: pl.DataFrame | None) -> bool:
    # A table that a result of several runs has, such as that of failures, is absent if this run has no row in it.
    if mine is None or theirs is None:
        return (mine is None or mine.is_empty()) and (theirs is None or theirs.is_empty())
    return mine.schema == theirs.schema and mine.equals(theirs)


def _other_versions(made_by: Sequence[Mapping[str, str]]) -> dict[str, tuple[str, str]]:
    own = versions()
    return {
        name: (of[name], own[name]) for of in made_by for name in own if name in of and of[name] != own[name]
    }
