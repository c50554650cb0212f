"""Record a search in a folder whose journal gets a line for each step, so that no finished step runs again.

    search.toml     the search, self-contained
    search.json     format, hash, versions
    journal.jsonl   a line for each step: the requests and the figures of every run
    .lock           the process that uses the folder, while it does

A search is resumed by running its method from the beginning with the results in the journal: nothing is unpickled, and
the same history leads to exactly the same next request. A line that was being written when the process was killed is
dropped. Only one process at a time may write: see ``Journal.alone``.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from vibroswarm.core.atomic_io import LOCK_FILE as LOCK
from vibroswarm.core.atomic_io import folder_lock, remove_leftovers, write_files
from vibroswarm.core.untrusted_files import entry, number, read_bytes, read_json, texts
from vibroswarm.errors import InputError, RunError, check_format, shown, warn_once
from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.methods import Ask
from vibroswarm.optimize.spec import FORMAT, Search, differences
from vibroswarm.result import write_code
from vibroswarm.simulation import versions
from vibroswarm.study.executors import check_begun_by

SEARCH: Final = "search.toml"
HEAD: Final = "search.json"
JOURNAL: Final = "journal.jsonl"
MOST_JOURNAL: Final = 2**30
"""Most bytes of a journal, enough for about 20 million runs."""


@dataclass
class Step:
    """One step: the requested runs and their results."""

    asks: list[Ask]
    origins: list[str]
    found: list[list[Any]]
    """For each request its pieces: rows, or the reason of a failure with the number of runs."""


class Journal:
    """A search's folder."""

    def __init__(self, folder: str | Path, search: Search, *, mixed: bool = False) -> None:
        """Open the folder of this search; ``alone`` makes it if it does not exist.

        Raises:
            InputError: the folder holds something else, another search, or one of other versions.
        """
        self.folder, self.search, self.mixed = Path(folder), search, mixed
        self._text = search.to_toml()
        if not self._is_there() and self._is_foreign():
            raise InputError(
                "exists but is not a search; give the name of a new folder", field=str(self.folder)
            )

    def _is_there(self) -> bool:
        """Tell whether the folder holds this search; raise if it holds another."""
        if not (self.folder / HEAD).is_file():
            return False
        self._check(self.search, self.mixed)
        return True

    def _is_foreign(self) -> bool:
        """Tell whether the folder holds anything that is not the beginning of this search."""
        return self.folder.exists() and not (
            self.folder.is_dir() and all(self._is_begun(path) for path in self.folder.iterdir())
        )

    def _is_begun(self, path: Path) -> bool:
        """Return whether a file is one that a search writes before its journal starts."""
        if path.name == SEARCH:
            return path.read_bytes() == self._text.encode()
        if path.name == JOURNAL:
            return path.stat().st_size == 0
        return path.name == LOCK or path.name.startswith((f".{SEARCH}.", f".{JOURNAL}.", f".{HEAD}."))

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Lock the folder for this process, and make it if it does not exist.

        Raises:
            InputError: another process uses it. RunError: it cannot be written.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RunError(f"could not write '{self.folder}': {error.strerror or error}") from error
        with folder_lock(self.folder):
            remove_leftovers(self.folder)
            if not self._is_there():
                self._make()
            yield

    def _make(self) -> None:
        head = {"format": FORMAT, "hash": self.search.hash, "versions": versions()}
        write_code(self.folder, (cell.scenario for cell in self.search.cases), self.search.study.motion)
        write_files(self.folder, {SEARCH: self._text, JOURNAL: "", HEAD: json.dumps(head, indent=1) + "\n"})

    def steps(self) -> Iterator[Step]:
        """Read the recorded steps in order; see ``steps_in``."""
        return steps_in(self.folder)

    def cut(self) -> None:
        """Drop an incomplete last line, whose writer was killed, and warn of it."""
        path = self.folder / JOURNAL
        data = path.read_bytes()
        end = data.rfind(b"\n") + 1
        if end < len(data):
            with path.open("r+b") as stream:
                stream.truncate(end)
            warn_once(f"{path}: the last line is incomplete; it is dropped, and its runs are repeated")

    def add(self, archive: Archive, asks: Sequence[Ask], found: Sequence[Sequence[Any]]) -> None:
        """Append a finished step to the journal and flush it to disk.

        Args:
            found: for each request, its pieces: figures as an array, or (cause, number of runs) of a failure.
        """
        step = {
            "asks": [list(ask) for ask in asks],
            "origins": [archive[ask.key].origin for ask in asks],
            "values": [archive[ask.key].values for ask in asks],
            "found": [
                [
                    piece.tolist() if isinstance(piece, np.ndarray) else [piece[0], piece[1]]
                    for piece in pieces
                ]
                for pieces in found
            ],
        }
        line = json.dumps(step, separators=(",", ":"), allow_nan=False) + "\n"
        try:
            with (self.folder / JOURNAL).open("a", encoding="utf-8") as stream:
                stream.write(line)
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            raise RunError(f"could not write '{self.folder / JOURNAL}': {error.strerror or error}") from error

    def _check(self, search: Search, mixed: bool) -> None:
        """Refuse a folder of another search, format or version."""
        path = self.folder / HEAD
        head = read_json(path, "the head of a search")
        version, saved_hash = entry(head, "format", int, path), entry(head, "hash", str, path)
        made_by = texts(entry(head, "versions", dict, path), "versions", path)
        check_format(version, FORMAT, str(self.folder))
        if saved_hash != search.hash:
            different = differences(Search.read(self.folder / SEARCH), search)
            raise InputError(
                f"holds another search: {'; '.join(different[:3]) or 'its scenario differs'}; take another folder",
                field=str(self.folder),
            )
        if not mixed:
            check_begun_by(made_by, self.folder)


def steps_in(folder: Path) -> Iterator[Step]:
    """Read the steps of a search's folder in order; an incomplete last line is left out.

    Raises:
        InputError: the journal cannot be read, or is damaged before its last line.
    """
    path = folder / JOURNAL
    if not path.exists():
        raise InputError(f"{JOURNAL} is missing", field=str(folder))
    lines = read_bytes(path, MOST_JOURNAL, "the journal of a search").split(b"\n")
    for k, line in enumerate(lines[:-1]):
        try:
            yield _step(json.loads(line))
        except (ValueError, LookupError, TypeError, OverflowError, AttributeError, RecursionError):
            raise InputError(
                f"line {k + 1} is damaged; restore the file from a copy, or cut it before that line, from where the "
                "search then continues",
                field=str(path),
            ) from None


def _step(step: Any) -> Step:
    """Check a line: the pieces of each request contain its runs, and all have the same cases and columns."""
    asks = [Ask(_count(key, 0), _count(runs, 1)) for key, runs in step["asks"]]
    results = [[_piece(piece) for piece in pieces] for pieces in step["found"]]
    origins = [str(origin) for origin in step["origins"]]
    if not len(asks) == len(results) == len(origins):
        raise ValueError("not as many pieces as asks")
    for ask, pieces in zip(asks, results, strict=True):
        if sum(len(p) if isinstance(p, np.ndarray) else p[1] for p in pieces) != ask.runs:
            raise ValueError("not as many runs as asked for")
    if len({piece.shape[1:] for pieces in results for piece in pieces if isinstance(piece, np.ndarray)}) > 1:
        raise ValueError("rows of different width")
    return Step(asks, origins, results)


def _count(value: Any, low: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= 10**9:
        raise ValueError("no count")
    return value


def is_search(folder: Path) -> bool:
    """Tell whether a folder holds a search."""
    return (folder / HEAD).is_file() and (folder / SEARCH).is_file()


def held(folder: Path) -> dict[str, Any]:
    """Describe the contents of a search's folder in plain values, without running anything.

    Raises:
        InputError: it is damaged.
    """
    search = Search.read(folder / SEARCH)
    steps = list(steps_in(folder))
    result = held_result(folder / "result.json")
    failed = [
        piece[1] for step in steps for pieces in step.found for piece in pieces if isinstance(piece, tuple)
    ]
    return {
        "folder": str(folder),
        "method": search.settings.method,
        "objectives": [objective.words for objective in search.objectives],
        "fields": search.space.names,
        "seed": search.seed,
        "runs_wanted": search.search_runs + search.final_runs,
        "runs_there": sum(ask.runs for step in steps for ask in step.asks),
        "runs_failed": sum(failed),
        "steps": len(steps),
        "result": result,
    }


def held_result(path: Path) -> dict[str, Any] | None:
    """Read the parts of a search's result that are displayed; None if it has not been scored yet.

    Raises:
        InputError: the file is damaged.
    """
    if not (path.exists() or path.is_symlink()):
        return None
    result = read_json(path, "the result of a search")
    best = entry(result, "best", dict, path)
    for name, value in best.items():
        if not isinstance(value, str | int | float):
            raise InputError(f"is damaged: 'best' has {shown(value)} for {name}", field=str(path))
    if (truth := result.get("truth")) is not None:
        score = entry(entry(truth, "true", dict, path), "score", dict, path)
        for part, name in ((truth, "believed"), (score, "low"), (score, "estimate"), (score, "high")):
            if part.get(name) is not None or name not in part:
                number(part, name, path)
        entry(truth, "says", str, path)
    if (front := result.get("front")) is not None:
        entry(front, "says", str, path)
    checked: dict[str, Any] = result
    return checked


def _piece(given: Any) -> Any:
    """Read a piece: rows as an array, (runs, cases, columns), or a failure as (why, runs)."""
    if isinstance(given[0], str):
        return given[0], _count(given[1], 0)
    rows = np.array(given, dtype=np.float64)
    if rows.ndim != 3 or 0 in rows.shape[1:] or not np.isfinite(rows).all():
        raise ValueError("no rows")
    return rows
