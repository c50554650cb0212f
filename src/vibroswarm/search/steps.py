"""The folder of a search: a table for each step, so that no finished step runs again.

    search.toml          the search, self-contained
    vibroswarm.json      the manifest: hash of the search, versions
    steps/00001.*        the first step: a row for each run and case, with its description (``core.folders``)
    fresh/NAME.*         fresh runs of a set of values, by which the search is validated; NAME is a hash of what ran
    .lock                the process that uses the folder, while it does

A step is one set of requests of the search's method, with the results of its runs:

| column | what it is |
|---|---|
| candidate, origin | key of the candidate, and the step that proposed it |
| run | number of the run among those requested, from 0 |
| case | number of the case |
| failed | why the run failed, else null |
| figure_0, ... | figures of the run, from which the scores of the objectives are computed; null if it failed |

A search is resumed by running its method from the beginning with the results in the tables: nothing is unpickled, and
the same history leads to exactly the same next request. A table that is damaged or missing is computed again. Only one
process at a time may write: see ``SearchFolder.alone``.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.atomic_io import (
    MANIFEST,
    make_folder,
    write_files,
)
from vibroswarm.core.folders import (
    DAMAGED,
    has_manifest,
    manifest_text,
    read_described,
    read_manifest,
    write_described,
)
from vibroswarm.core.numbers import count
from vibroswarm.core.tables import Schema, parquet_bytes, read_table
from vibroswarm.errors import InputError, plain_value, shown, warn_once
from vibroswarm.result import code_files, write_code
from vibroswarm.search.evaluate import Piece, Result, RunFigures, Simulations
from vibroswarm.search.objective import Rows
from vibroswarm.search.spec import Search, differences
from vibroswarm.simulation import versions
from vibroswarm.study.store import registered_sources

SEARCH: Final = "search.toml"
"""File with the definition of the search."""
STEPS: Final = "steps"
"""Folder of the steps."""
FRESH: Final = "fresh"
"""Folder of the fresh runs."""
REQUEST: Final = ("candidate", "run", "case")
"""Columns that say what was requested."""


def _figures(width: int) -> dict[str, Any]:
    return {f"figure_{k}": pl.Float64 for k in range(width)}


def schema_of(search: Search) -> Schema:
    """Return the columns of a step of a search."""
    figures = _figures(sum(objective.width for objective in search.objectives))
    numbers = {"candidate": pl.UInt32, "origin": pl.String, "run": pl.UInt32, "case": pl.UInt16}
    return Schema({**numbers, "failed": pl.String, **figures}, frozenset({"failed", *figures}), REQUEST)


def step_table(search: Search, origins: Mapping[int, str], results: Sequence[Result]) -> pl.DataFrame:
    """Return the table of a step.

    Args:
        origins: of the candidates, by key. results: of all requests, in order; those of a candidate stand together.
    """
    schema, cases = schema_of(search), len(search.cases)
    names = [name for name in schema.columns if name.startswith("figure_")]
    rows: list[Rows] = []
    failed: list[str | None] = []
    for _, found, runs in results:
        rows.append(np.full((runs, cases, len(names)), np.nan) if isinstance(found, str) else found)
        failed += [found if isinstance(found, str) else None] * (runs * cases)
    values = np.concatenate(rows).reshape(-1, len(names))
    candidate = np.repeat([key for key, *_ in results], [runs * cases for *_, runs in results])
    columns: dict[str, Any] = {
        "candidate": candidate,
        "origin": [origins[key] for key in candidate.tolist()],
        "run": 0,
        "case": np.tile(np.arange(cases), len(candidate) // cases),
        "failed": failed,
        **{name: values[:, k] for k, name in enumerate(names)},
    }
    table = pl.DataFrame(columns, schema=dict(schema.columns), nan_to_null=True)
    return table.with_columns(run=(pl.int_range(pl.len()) // cases).over("candidate").cast(pl.UInt32))


def results_in(table: pl.DataFrame, cases: int) -> Iterator[Result]:
    """Yield the results in the table of a step: for each candidate its good runs together, failed ones one by one."""
    candidate, failed = table["candidate"].to_numpy(), table["failed"].to_list()
    figures = table.select(r"^figure_\d+$").to_numpy()
    is_good = table["failed"].is_null().to_numpy()
    firsts = np.flatnonzero(np.append(True, candidate[1:] != candidate[:-1]))
    for first, end in pairwise([*firsts.tolist(), len(failed)]):
        key, good = int(candidate[first]), figures[first:end][is_good[first:end]]
        if good.size:
            yield key, good.reshape(-1, cases, figures.shape[1]), len(good) // cases
        yield from ((key, why, 1) for why in failed[first:end:cases] if why is not None)


class SearchFolder:
    """The folder of a search: its files are written here, and its recorded steps are read."""

    def __init__(self, folder: str | Path, search: Search, *, mixed: bool = False) -> None:
        """Check that the folder can be used for this search: it does not exist, is empty, or holds this search.

        A folder that has only files that ``_is_begun`` recognises can be used, too.

        Nothing is written here; ``alone`` makes the folder.

        Args:
            folder: of the search. search: its definition.
            mixed: whether the search may be continued if other versions of the programs began it.
        Raises:
            InputError: the folder holds something else, or a search that ``_check`` refuses; or the cost of ``search``
                is a function, which a file cannot hold.
        """
        self.folder, self.search, self.mixed = Path(folder), search, mixed
        self._text = search.to_toml()
        # name -> text of the users' code files that the search needs; ``_make`` writes copies of them into the folder
        self._code = code_files(*search.code_used)
        if not self._is_there() and self._is_foreign():
            raise InputError(
                "exists but is not a search; give the name of a new folder", field=str(self.folder)
            )

    def _is_there(self) -> bool:
        """Return whether the folder holds this search; refuse another one, or one that cannot be continued."""
        if not has_manifest(self.folder):
            return False
        self._check(self.search, self.mixed)
        return True

    def _is_foreign(self) -> bool:
        """Return whether the path is a file, or a folder with an entry that this search does not write at its start."""
        return self.folder.exists() and not (
            self.folder.is_dir() and all(self._is_begun(path) for path in self.folder.iterdir())
        )

    def _is_begun(self, path: Path) -> bool:
        """Return whether ``path`` is a file that this search writes before its first step.

        If a process is killed before the first step, its folder has only such files, and the search can begin there
        again.
        """
        if path.name == SEARCH:
            return path.is_file() and path.read_bytes() == self._text.encode()
        if path.name in self._code:
            return path.is_file() and path.read_bytes() == self._code[path.name].encode()
        return path.name == "command.json" or path.name.startswith(".")  # it was being written

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Make the folder if it does not exist; if no step was saved in the block, remove it again.

        Raises:
            InputError: it cannot be made.
        """
        is_new = not self.folder.exists()
        make_folder(self.folder)
        try:
            yield
        finally:
            if is_new:
                with suppress(OSError):  # it is not empty
                    self.folder.rmdir()

    def _make(self) -> None:
        """Write the files of a new search; the manifest last, since a folder with one counts as a search."""
        made_by = versions() | registered_sources(*self.search.selected)
        manifest = manifest_text("search", hash=self.search.hash, versions=made_by)
        write_code(self.folder, *self.search.code_used)
        write_files(self.folder, {SEARCH: self._text, MANIFEST: manifest})

    def read(self, number: int) -> pl.DataFrame | None:
        """Read a step, from 1; None if it is not there, or damaged, of which a warning is logged."""
        path = self.folder / STEPS / name_of(number)
        return intact_step(path, self.search) if os.path.lexists(path) else None

    def add(self, number: int, table: pl.DataFrame) -> None:
        """Write the table of a finished step; before the first of a new search, the files that define it.

        Raises:
            RunError: it cannot be written.
        """
        if not has_manifest(self.folder):
            self._make()
        name, tables = name_of(number).removesuffix(".json"), {"step": parquet_bytes(table)}
        write_described(self.folder / STEPS, name, "step", tables)

    def _check(self, search: Search, mixed: bool) -> None:
        """Check that the folder holds the given search, and that this version of the programs may continue it.

        Raises:
            InputError: the folder holds another search, has another format, a damaged manifest or a damaged definition,
                or was begun by other versions of the programs and ``mixed`` is false.
        """
        manifest, saved = read_manifest(self.folder, "search"), saved_search(self.folder)
        # The number of fresh runs changes nothing in the search, and more of them may be needed after it.
        other = search.with_settings(fresh=saved.settings.fresh)
        if manifest["hash"] not in (search.hash, other.hash) or saved.space.names != search.space.names:
            fields = differences(saved, other)
            raise InputError(
                f"holds another search: {'; '.join(fields[:3]) or 'its scenario differs'}; take another folder",
                field=str(self.folder),
            )
        theirs = manifest["versions"]
        changed = [
            name for name, now in registered_sources(*search.selected).items() if theirs.get(name) != now
        ]
        if changed:
            raise InputError(f"its runs were made with another {changed[0]}", field=str(self.folder))
        different = [
            f"{name} {theirs.get(name)}" for name, here in versions().items() if theirs.get(name) != here
        ]
        if different and not mixed:
            raise InputError(f"was begun by other versions ({', '.join(different)})", field=str(self.folder))


def saved_search(folder: Path) -> Search:
    """Read the search for which a folder was made.

    Raises:
        InputError: the search or the manifest is damaged, or the search is not the one that the manifest names.
    """
    manifest, search = read_manifest(folder, "search"), Search.read(folder / SEARCH)
    if search.hash != manifest["hash"]:
        raise InputError(DAMAGED, field=str(folder / SEARCH))
    return search


def name_of(number: int) -> str:
    """Return the name of the description of a step, from 1."""
    return f"{number:05}.json"


def read_step(path: Path, search: Search) -> pl.DataFrame:
    """Read the table of a step from its description.

    Raises:
        InputError: it is damaged, or of another search.
    """
    table = _described_table(path, "step", schema_of(search))
    figures = [name for name in table.columns if name.startswith("figure_")]
    given = pl.all_horizontal(pl.col(figures).is_finite().fill_null(False))
    missing = pl.all_horizontal(pl.col(figures).is_null())
    is_good = pl.when(pl.col("failed").is_null()).then(given).otherwise(missing)
    if table.is_empty() or not table.select(is_good.all()).item():
        raise InputError(
            "lacks figures of a run, or has some of a failed one", field=str(path.with_suffix(".parquet"))
        )
    return table


def _described_table(path: Path, kind: str, schema: Schema) -> pl.DataFrame:
    _, files = read_described(path, kind)
    if list(files) != [kind]:
        raise InputError(f"is damaged: it must describe one table '{kind}'", field=str(path))
    return read_table(files[kind], schema, kind)


class RecordedRun(NamedTuple):
    """A saved run of a search that can be simulated again."""

    table: str
    """``STEPS`` or ``FRESH``."""
    name: str
    """The candidate, or the file of fresh runs."""
    piece: Piece
    """What simulates this run alone."""
    figures: NDArray[np.float64]
    """(cases, columns); the columns are those of the first objectives, or of all."""


class FreshFolder:
    """Fresh runs in the folder of a search, each set of values with its runs under a name that says what ran."""

    def __init__(self, folder: str | Path, search: Search) -> None:
        self.folder, self.search = Path(folder) / FRESH, search

    def _name(self, values: Mapping[str, Any], runs: int, seed: int, width: int) -> str:
        cases = [cell.scenario.hash for cell in self.search.cases]
        what = [self.search.hash, cases, dict(values), runs, seed, width, versions()]
        return hashlib.sha256(json.dumps(what, sort_keys=True, default=str).encode()).hexdigest()[:24]

    def read(self, values: Mapping[str, Any], runs: int, seed: int, width: int) -> RunFigures | None:
        """Return the fresh runs of a set of values; None if they are missing or damaged.

        Args:
            values: by field. runs: number of runs. seed: of the runs. width: number of figures of a run and case.
        """
        path = self.folder / f"{self._name(values, runs, seed, width)}.json"
        if not os.path.lexists(path):
            return None
        try:
            return self._read(path, runs, width)
        except InputError as error:
            warn_once(f"{error}; these runs are repeated")
            return None

    def _read(self, path: Path, runs: int, width: int) -> RunFigures:
        """Read fresh runs from their description; arguments as of ``read``.

        Raises:
            InputError: they are damaged.
        """
        about, cases = read_manifest(path, "fresh"), len(self.search.cases)
        table = _described_table(path, "fresh", _fresh_schema(width))
        failed, why = about["failed"], about["why"]
        if table.is_empty() or table.height != (runs - failed) * cases:
            raise InputError(f"has {table.height} rows, not {(runs - failed) * cases}", field=str(path))
        figures = table.select(list(_figures(width))).to_numpy().reshape(-1, cases, width)
        numbers = table["run"].to_numpy()[::cases].astype(np.int64)
        return RunFigures(rows=figures, runs=numbers, failed=failed, why=why)

    def recorded(self) -> tuple[list[RecordedRun], list[str]]:
        """Return the saved runs, and what is wrong with damaged files.

        Older folders do not say what the runs were made from; these runs are left out, with a warning.
        """
        found, damaged, older = list[RecordedRun](), list[str](), 0
        cases = [cell.scenario for cell in self.search.cases]
        for path in sorted(self.folder.glob("[!.]*.json")):
            try:
                made_from = read_manifest(path, "fresh").get("made_from")
                if made_from is None:
                    older += 1
                    continue
                if not isinstance(made_from, list) or list(map(type, made_from)) != [dict, int, int, int]:
                    raise InputError(f"{DAMAGED}: made_from is {shown(made_from)}", field=str(path))
                values, runs, seed, width = made_from
                done = self._read(path, runs, width)
                simulations = Simulations(cases, seed, self.search.study.motion)
                pieces = [simulations.pieces(values, run, run + 1)[0] for run in done.runs.tolist()]
            except InputError as error:
                damaged.append(str(error))
            else:
                found += [RecordedRun(FRESH, path.stem, *one) for one in zip(pieces, done.rows, strict=True)]
        if older:
            warn_once(
                f"{count(older, 'file')} of fresh runs in {self.folder}, of an older version, without what the runs "
                "were made from: left out"
            )
        return found, damaged

    def add(self, values: Mapping[str, Any], runs: int, seed: int, done: RunFigures) -> None:
        """Write the fresh runs of a set of values; arguments as of ``read``.

        Raises:
            InputError, RunError: they cannot be written.
        """
        _, cases, width = done.rows.shape
        flat = done.rows.reshape(-1, width)
        columns = {
            "run": np.repeat(done.runs, cases),
            "case": np.tile(np.arange(cases), len(done.runs)),
            **{name: flat[:, k] for k, name in enumerate(_figures(width))},
        }
        table = pl.DataFrame(columns, schema=dict(_fresh_schema(width).columns))
        name = self._name(values, runs, seed, width)
        tables = {"fresh": parquet_bytes(table)}
        made_from = plain_value([values, runs, seed, width])
        write_described(
            self.folder, name, "fresh", tables, failed=done.failed, why=done.why, made_from=made_from
        )


def _fresh_schema(width: int) -> Schema:
    return Schema({"run": pl.UInt32, "case": pl.UInt16, **_figures(width)}, key=("run", "case"))


def intact_step(path: Path, search: Search) -> pl.DataFrame | None:
    """Read the table of a step; None if it is damaged, of which a warning is logged."""
    try:
        return read_step(path, search)
    except InputError as error:
        warn_once(f"{error}; a search that goes on repeats these runs")
        return None


def held(folder: Path) -> dict[str, Any]:
    """Describe what a search's folder holds in plain values, without running anything.

    ``runs_there`` is the number of runs in the recorded steps, ``runs_wanted`` the number planned for the whole search.
    A finished search may have slightly fewer: methods other than pso request a fixed number of runs of each candidate,
    which may not divide their budget.

    Raises:
        InputError: the search is damaged.
    """
    search = saved_search(folder)
    paths = sorted((folder / STEPS).glob("[!.]*.json"))
    steps = [table for table in (intact_step(path, search) for path in paths) if table is not None]
    runs = [table.filter(pl.col("case") == 0) for table in steps]
    return {
        "folder": str(folder),
        "method": search.settings.method_name,
        "objectives": [objective.words for objective in search.objectives],
        "fields": search.space.names,
        "seed": search.seed,
        "runs_wanted": search.search_runs + search.final_runs,
        "runs_there": sum(table.height for table in runs),
        "runs_failed": sum(table.height - table["failed"].null_count() for table in runs),
        "steps": len(steps),
    }


def versions_of(folder: Path) -> dict[str, str]:
    """Return the versions of the programs that began the search in a folder.

    Raises:
        InputError: the manifest is not that of a search, or damaged.
    """
    return dict(read_manifest(folder, "search")["versions"])
