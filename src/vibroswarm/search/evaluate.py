"""Simulate runs of candidates on any executor, from values of fields to figures; runs that are saved are not simulated.

A run is known by its purpose, the values and its number. The purpose, such as "evaluations" or "fresh runs", gives the
seed. With a folder, all runs are saved in one file, which is written anew after each step; a damaged one is as if it
were not there.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.atomic_io import make_folder, write_file
from vibroswarm.core.tables import parquet_bytes
from vibroswarm.errors import InputError, RunError, plain_value
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.search.objective import Objective, Rows
from vibroswarm.search.outcomes import outcomes_of
from vibroswarm.search.spec import Search
from vibroswarm.simulation import versions
from vibroswarm.study.batch import scenario_of
from vibroswarm.study.run import Pool, do_all, pool_for

ARCHIVE: Final = "archive.parquet"
"""File with the runs of a search."""
SAVED: Final[dict[str, Any]] = {
    "purpose": pl.String, "values": pl.String, "run": pl.UInt32, "failed": pl.String,
    "figures": pl.List(pl.Float64),
}  # fmt: skip
"""Its columns; ``failed`` is why a run failed, ``figures`` are those of all cases in a row."""
NO_ROWS: Final = np.empty((0, 1, 1))
LEAST: Final = 5
MOST: Final = 50
"""Fewest and most runs in a piece of work."""


class Figures(NamedTuple):
    """Figures of requested runs."""

    rows: Rows
    """(runs, cases, columns), where the columns of all objectives stand side by side."""
    runs: NDArray[np.int64]
    """Numbers of the runs that succeeded, in the order of ``rows``."""
    failed: int = 0
    why: str = ""
    """Why the first of the failed runs failed."""


Outcome = tuple[str | None, list[float] | None]
"""Of a run: why it failed, or its figures of all cases in a row."""


class Piece(NamedTuple):
    """Runs of one set of values, in plain values, to be sent to a worker."""

    purpose: str
    values: str
    """JSON."""
    runs: tuple[int, ...]
    seed: int
    motion: str
    cases: tuple[str, ...]
    """Scenarios as TOML; each run is simulated in all of them."""
    code: tuple[tuple[str, str], ...]
    """References to users' code, and its text."""


def derived_seed(seed: int, purpose: str) -> int:
    """Derive a seed for one purpose of a search."""
    # 7 bytes, so that every derived seed is below ``rng.SEED_LIMIT``, 2^63.
    return int.from_bytes(hashlib.sha256(f"optimizer: {purpose} of {seed}".encode()).digest()[:7])


def do_piece(piece: Piece, objectives: tuple[Objective, ...]) -> list[Outcome]:
    """Simulate runs; a run fails if its values make no scenario, or its simulation or a cost fails."""
    try:
        plugins.install_all(piece.code)  # a worker process may not have loaded the user code yet
        scenarios = [_scenario(text, piece.values) for text in piece.cases]
        outcomes = outcomes_of(scenarios, piece.seed, piece.runs, piece.motion)
        figures = [np.hstack([o.figures(case) for o in objectives]) for case in outcomes]
        return [(None, of_run) for of_run in np.hstack(figures).tolist()]
    except (MemoryError, OSError):  # of the machine, not of the runs
        raise
    except Exception as error:
        if len(piece.runs) > 1:
            return [do_piece(piece._replace(runs=(run,)), objectives)[0] for run in piece.runs]
        is_worded = isinstance(error, InputError | RunError)
        return [(str(error) if is_worded else f"{type(error).__name__}: {error}", None)]


@lru_cache(maxsize=512)
def _scenario(text: str, values: str) -> Scenario:
    return scenario_of(text).with_values(dict(json.loads(values)))


class Evaluator:
    """Simulates runs of the cases of a search, and saves them in a folder, if there is one."""

    def __init__(self, search: Search, pool: Pool, folder: str | Path | None = None) -> None:
        self.search, self.pool = search, pool
        self.path = None if folder is None else Path(folder) / ARCHIVE
        self.cases = tuple(cell.scenario.to_toml() for cell in search.study.cells)
        self.code = plugins.texts_of(search.codes)
        self.known: dict[tuple[str, str], dict[int, Outcome]] = defaultdict(dict)
        """Outcome of each run by purpose and values, and by number."""
        self.saved = pl.DataFrame(schema=SAVED)
        code, iterations = str(versions()["code"]), str(search.pso_iterations)
        self.about = {"search": search.hash, "code": code, "iterations": iterations}
        if self.path is not None and self.path.is_file():
            self._read(self.path)

    def figures(
        self,
        purpose: str,
        requests: Iterable[tuple[Mapping[str, Any], Sequence[int]]],
        progress: Callable[[int], None] = lambda done: None,
    ) -> list[Figures]:
        """Return the figures of each request, a set of values with numbers of runs; those not known are simulated."""
        wanted = [((purpose, json.dumps(plain_value(dict(values)))), runs) for values, runs in requests]
        pieces = [piece for key, runs in wanted for piece in self._pieces(*key, runs)]
        done = sum(len(runs) for _, runs in wanted) - sum(len(piece.runs) for piece in pieces)

        def take(results: list[Outcome], piece: Piece) -> None:
            nonlocal done
            self.known[piece.purpose, piece.values] |= dict(zip(piece.runs, results, strict=True))
            done += len(piece.runs)
            progress(done)

        do_all(self.pool, do_piece, pieces, take, self.search.objectives)
        if self.path is not None and pieces:
            self._save(self.path, pieces)
        return [self._joined({run: self.known[key][run] for run in runs}) for key, runs in wanted]

    def _pieces(self, purpose: str, values: str, runs: Sequence[int]) -> list[Piece]:
        """Divide the missing runs of a request into pieces, at least one for every second worker."""
        missing = tuple(run for run in runs if run not in self.known[purpose, values])
        size = max(min(math.ceil(len(missing) / max(self.pool.width // 2, 1)), MOST), LEAST)
        seed, motion = derived_seed(self.search.study.seed, purpose), self.search.study.motion
        return [
            Piece(purpose, values, missing[low : low + size], seed, motion, self.cases, self.code)
            for low in range(0, len(missing), size)
        ]

    def _joined(self, found: Mapping[int, Outcome]) -> Figures:
        good = {run: figures for run, (_, figures) in found.items() if figures is not None}
        bad = [why for why, _ in found.values() if why is not None]
        rows = np.array([*good.values()]).reshape(len(good), len(self.cases), -1) if good else NO_ROWS
        return Figures(rows, np.array([*good], dtype=np.int64), len(bad), bad[0] if bad else "")

    def _save(self, path: Path, pieces: Sequence[Piece]) -> None:
        rows = [
            (piece.purpose, piece.values, run, *self.known[piece.purpose, piece.values][run])
            for piece in pieces
            for run in piece.runs
        ]
        self.saved = pl.concat([self.saved, pl.DataFrame(rows, SAVED, orient="row")], rechunk=True)
        make_folder(path.parent)
        write_file(path, parquet_bytes(self.saved, self.about))

    def _read(self, path: Path) -> None:
        with suppress(pl.exceptions.PolarsError):  # damaged: as if it were not there
            data = path.read_bytes()
            about, saved = pl.read_parquet_metadata(io.BytesIO(data)), pl.read_parquet(io.BytesIO(data))
            if about["search"] != self.search.hash:
                raise InputError("holds another search", field=str(path.parent))
            if about["code"] != self.about["code"]:
                return
            self.saved, self.about["iterations"] = saved, about["iterations"]
            for purpose, values, run, failed, figures in saved.iter_rows():
                self.known[purpose, values][run] = failed, figures


@contextmanager
def evaluator_for(
    search: Search,
    folder: str | Path | None = None,
    executor: str | Executor = "threads",
    workers: int | None = None,
) -> Iterator[Evaluator]:
    """Begin to evaluate; for executor and workers see ``study.run.pool_for``."""
    with pool_for(executor, workers) as pool:
        yield Evaluator(search, pool, folder)
