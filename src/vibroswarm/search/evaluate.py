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
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

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
from vibroswarm.simulation import versions
from vibroswarm.study.batch import scenario_of
from vibroswarm.study.run import Pool, do_all

if TYPE_CHECKING:
    from vibroswarm.search.spec import Search

ARCHIVE: Final = "archive.parquet"
"""File with the runs of a search."""
MOST: Final = 50
"""Most runs in a piece of work."""


class Request(NamedTuple):
    """Runs of one set of values."""

    purpose: str
    values: Mapping[str, Any]
    runs: Sequence[int]


class Figures(NamedTuple):
    """Figures of the runs of a request."""

    rows: Rows
    """(runs, cases, columns), where the columns of all objectives stand side by side."""
    runs: NDArray[np.int64]
    """Numbers of the runs that succeeded, in the order of ``rows``."""
    failed: int = 0
    why: str = ""
    """Why the first of the failed runs failed."""


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


def do_piece(piece: Piece, objectives: tuple[Objective, ...]) -> list[Rows | str]:
    """Simulate runs; return the figures of each, (cases, columns), or why it failed.

    A run fails if its values make no scenario, or if the simulation or a cost fails.
    """
    try:
        plugins.install_all(piece.code)  # a worker process may not have loaded the user code yet
        scenarios = [_scenario(text, piece.values) for text in piece.cases]
        outcomes = outcomes_of(scenarios, piece.seed, piece.runs, piece.motion)
        figures = [np.hstack([o.figures(case) for o in objectives]) for case in outcomes]
        return list(np.stack(figures, axis=1))
    except (MemoryError, OSError):  # of the machine, not of the runs
        raise
    except Exception as error:
        if len(piece.runs) == 1:
            return [
                str(error) if isinstance(error, InputError | RunError) else f"{type(error).__name__}: {error}"
            ]
        return [do_piece(piece._replace(runs=(run,)), objectives)[0] for run in piece.runs]


@lru_cache(maxsize=512)
def _scenario(text: str, values: str) -> Scenario:
    return scenario_of(text).with_values(dict(json.loads(values)))


class Evaluator:
    """Simulates runs of the cases of a search.

    Args:
        folder: where runs are saved, and those of an earlier call are read; None: nowhere.
    Raises:
        InputError: the folder holds another search.
    """

    def __init__(self, search: Search, pool: Pool, folder: Path | None = None) -> None:
        self.search, self.pool, self.folder = search, pool, folder
        scenarios = [cell.scenario for cell in search.cases]
        self.cases = tuple(scenario.to_toml() for scenario in scenarios)
        self.code = plugins.texts_of([search.study.motion, *(c for one in scenarios for c in one.codes)])
        self.known: dict[tuple[str, str, int], Rows | str] = {}
        """Figures of each run, or why it failed, by purpose, values and number."""
        self.saved = pl.DataFrame()
        self.about = {
            "search": search.hash,
            "code": str(versions()["code"]),
            "iterations": str(search.pso_iterations),
        }
        if folder is not None:
            self._read(folder / ARCHIVE)

    def figures(
        self, requests: Sequence[Request], progress: Callable[[int], None] = lambda done: None
    ) -> list[Figures]:
        """Return the figures of each request; runs that are not known are simulated, then all are saved.

        Args:
            progress: called with the number of finished runs.
        """
        keys = [
            [(one.purpose, json.dumps(plain_value(dict(one.values))), run) for run in one.runs]
            for one in requests
        ]
        pieces = [
            piece for one in keys for piece in self._pieces([key for key in one if key not in self.known])
        ]
        done = sum(map(len, keys)) - sum(len(piece.runs) for piece in pieces)

        def take(results: list[Rows | str], piece: Piece) -> None:
            nonlocal done
            for run, found in zip(piece.runs, results, strict=True):
                self.known[piece.purpose, piece.values, run] = found
            done += len(piece.runs)
            progress(done)

        do_all(self.pool, do_piece, pieces, take, self.search.objectives)
        self._save(dict.fromkeys((p.purpose, p.values, run) for p in pieces for run in p.runs))
        return [self._joined(one) for one in keys]

    def _pieces(self, missing: Sequence[tuple[str, str, int]]) -> list[Piece]:
        """Divide missing runs of a request into nearly equal pieces, at least one for every second worker."""
        if not missing:
            return []
        purpose, values, _ = missing[0]
        code = self.code + plugins.texts_of(v for v in json.loads(values).values() if plugins.is_code(v))
        count = max(math.ceil(len(missing) / MOST), min(self.pool.width // 2, len(missing) // 5), 1)
        bounds = [len(missing) * k // count for k in range(count + 1)]
        seed = derived_seed(self.search.seed, purpose)
        return [
            Piece(purpose, values, tuple(run for *_, run in missing[low:high]), seed, self.search.study.motion,
                  self.cases, code)
            for low, high in pairwise(bounds)
        ]  # fmt: skip

    def _joined(self, keys: Sequence[tuple[str, str, int]]) -> Figures:
        good = [(run, rows) for *key, run in keys if not isinstance(rows := self.known[*key, run], str)]  # type: ignore[index]
        bad = [why for key in keys if isinstance(why := self.known[key], str)]
        rows = np.array([rows for _, rows in good]) if good else np.empty((0, 1, 1))
        return Figures(
            rows, np.array([run for run, _ in good], dtype=np.int64), len(bad), bad[0] if bad else ""
        )

    def _save(self, keys: Mapping[tuple[str, str, int], None]) -> None:
        if self.folder is None or not keys:
            return
        width = len(self.cases) * sum(objective.width for objective in self.search.objectives)
        found = [self.known[key] for key in keys]
        figures = [np.full(width, np.nan) if isinstance(one, str) else one.ravel() for one in found]
        new = pl.DataFrame(
            {
                "purpose": [purpose for purpose, *_ in keys],
                "values": [values for _, values, _ in keys],
                "run": pl.Series([run for *_, run in keys], dtype=pl.UInt32),
                "failed": pl.Series(
                    [one if isinstance(one, str) else None for one in found], dtype=pl.String
                ),
                "figures": pl.Series(np.array(figures), dtype=pl.Array(pl.Float64, width)),
            }
        )
        self.saved = pl.concat([self.saved, new], rechunk=True) if self.saved.height else new
        make_folder(self.folder)
        write_file(self.folder / ARCHIVE, parquet_bytes(self.saved, self.about))

    def _read(self, path: Path) -> None:
        if not path.is_file():
            return
        with suppress(pl.exceptions.PolarsError):  # damaged: as if it were not there
            data = path.read_bytes()
            about, saved = pl.read_parquet_metadata(io.BytesIO(data)), pl.read_parquet(io.BytesIO(data))
            if about["search"] != self.search.hash:
                raise InputError("holds another search", field=str(path.parent))
            if about["code"] != self.about["code"]:
                return
            self.saved, self.about["iterations"] = saved, about["iterations"]
            figures = saved["figures"].to_numpy().reshape(saved.height, len(self.cases), -1)
            rows = saved.select("purpose", "values", "run", "failed").iter_rows()
            for (*key, failed), of_run in zip(rows, figures, strict=True):
                self.known[tuple(key)] = failed or of_run
