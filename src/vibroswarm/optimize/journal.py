"""Record a search in a folder whose journal gets a line for each step, so that no finished step runs again.

    search.toml     the search, self-contained
    search.json     format, hash, versions
    journal.jsonl   a line for each step: the requests and the figures of every run
    .lock           the process that uses the folder, while it does

A step is one set of requests of the search's method, with the results of its runs. A search is resumed by running its
method from the beginning with the results in the journal: nothing is unpickled, and the same history leads to exactly
the same next request. A line that was being written when the process was killed is dropped. Only one process at a time
may write: see ``Journal.alone``.
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
from vibroswarm.core.atomic_io import folder_lock, remove_leftovers, temporary_stem, write_files
from vibroswarm.core.untrusted_files import entry, read_bytes, read_json, texts
from vibroswarm.errors import InputError, RunError, check_format, warn_once
from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.methods import Ask
from vibroswarm.optimize.spec import FORMAT, Search, differences
from vibroswarm.result import code_files, write_code
from vibroswarm.simulation import versions
from vibroswarm.study.executors import check_begun_by

SEARCH: Final = "search.toml"
"""File with the definition of the search."""
HEAD: Final = "search.json"
"""File with format, hash and versions; it is written last, so that a folder with it holds a search."""
JOURNAL: Final = "journal.jsonl"
"""File with one line per step."""
MOST_JOURNAL: Final = 2**30
"""Most bytes of a journal, enough for about 20 million runs."""


@dataclass
class Step:
    """One step: the requested runs and their results."""

    asks: list[Ask]
    """The requests."""
    origins: list[str]
    """For each request the origin of its candidate."""
    found: list[list[Any]]
    """For each request the results of its pieces in order. A piece is a part of the request's runs that one worker
    simulates (see ``evaluate``). Its result is an array of figures, (runs, cases, columns), from which scores are
    computed, or for a failed piece (reason, number of runs)."""


class Journal:
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
        self._code = code_files((cell.scenario for cell in search.cases), search.study.motion)
        if not self._is_there() and self._is_foreign():
            raise InputError(
                "exists but is not a search; give the name of a new folder", field=str(self.folder)
            )

    def _is_there(self) -> bool:
        """Return whether the folder holds this search; false if it holds no search.

        Raises:
            InputError: it holds another search, or one that cannot be continued.
        """
        if not (self.folder / HEAD).is_file():
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
        if path.name == JOURNAL:
            return path.is_file() and path.stat().st_size == 0
        if path.name in self._code:
            return path.is_file() and path.read_bytes() == self._code[path.name].encode()
        # Files that were being written have temporary names that begin in this way.
        temporary = tuple(temporary_stem(name) for name in (SEARCH, JOURNAL, HEAD, *self._code))
        return path.name == LOCK or path.name.startswith(temporary)

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Make the folder if it does not exist, and lock it for this process until the end of the block.

        Raises:
            InputError: another process uses the folder, or it holds another search. RunError: it cannot be written.
        """
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RunError(f"could not write '{self.folder}': {error.strerror or error}") from error
        with folder_lock(self.folder):
            remove_leftovers(self.folder)
            # ``__init__`` checked this before the folder was locked: another process may have made a search since.
            if not self._is_there():
                self._make()
            yield

    def _make(self) -> None:
        """Write the files of a new search. The head is written last, since a folder with a head counts as a search."""
        head = {"format": FORMAT, "hash": self.search.hash, "versions": versions()}
        write_code(self.folder, (cell.scenario for cell in self.search.cases), self.search.study.motion)
        write_files(self.folder, {SEARCH: self._text, JOURNAL: "", HEAD: json.dumps(head, indent=1) + "\n"})

    def steps(self) -> Iterator[Step]:
        """Read the recorded steps in order; see ``steps_in``."""
        return steps_in(self.folder)

    def cut(self) -> None:
        """Cut off an incomplete last line of the journal, which a killed process leaves, and log a warning."""
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
            archive: has the candidates of the requests. asks: the requests of the step.
            found: their results, see ``Step.found``.
        Raises:
            RunError: the journal cannot be written.
        """
        step = {
            "asks": [list(ask) for ask in asks],
            "origins": [archive[ask.key].origin for ask in asks],
            # The values are written for people who read the file; no program reads them.
            "values": [archive[ask.key].values for ask in asks],
            "found": [
                [
                    piece.tolist()
                    if isinstance(piece, np.ndarray)  # figures
                    else list(piece)  # (reason, number of runs) of a failed piece
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
        """Check that the folder holds the given search, and that this version of the programs may continue it.

        Raises:
            InputError: the folder holds another search, has another format or a damaged head, or was begun by other
                versions of the programs and ``mixed`` is false.
        """
        path = self.folder / HEAD
        head = read_json(path, "the head of a search")
        version, saved_hash = entry(head, "format", int, path), entry(head, "hash", str, path)
        made_by = texts(entry(head, "versions", dict, path), "versions", path)
        check_format(version, FORMAT, str(self.folder))
        if saved_hash != search.hash:
            saved = Search.read(self.folder / SEARCH)
            # The number of fresh runs changes nothing in the search, and more of them may be needed after it.
            other = search.with_settings(fresh=saved.settings.fresh)
            if saved_hash != other.hash:
                different = differences(saved, other)
                raise InputError(
                    f"holds another search: {'; '.join(different[:3]) or 'its scenario differs'}; take another folder",
                    field=str(self.folder),
                )
        if not mixed:
            check_begun_by(made_by, self.folder)


def steps_in(folder: Path) -> Iterator[Step]:
    """Yield the steps in the journal of a search's folder in order; an incomplete last line is left out.

    Raises:
        InputError: the journal is missing, cannot be read, or has a damaged line that ends with a newline.
    """
    path = folder / JOURNAL
    if not path.exists():
        raise InputError(f"{JOURNAL} is missing", field=str(folder))
    lines = read_bytes(path, MOST_JOURNAL, "the journal of a search").split(b"\n")
    # What follows the last newline is left out: it is empty, or a line whose writer was killed.
    for k, line in enumerate(lines[:-1]):
        try:
            yield _step(json.loads(line))
        # what the parsers of JSON and of steps raise for damaged lines of any kind
        except (ValueError, LookupError, TypeError, OverflowError, AttributeError, RecursionError):
            raise InputError(
                f"line {k + 1} is damaged; restore the file from a copy, or cut it before that line, from where the "
                "search then continues",
                field=str(path),
            ) from None


def _step(step: Any) -> Step:
    """Make a step from ``step``, the parsed line of a journal, and check it.

    The results of each request must have the requested number of runs, and all arrays of figures must have the same
    numbers of cases and columns.

    Raises:
        ValueError, LookupError, TypeError, ...: the line is damaged; the caller writes the message for the user.
    """
    asks = [Ask(_count(key, 0), _count(runs, 1)) for key, runs in step["asks"]]
    results = [[_piece(piece) for piece in pieces] for pieces in step["found"]]
    origins = [str(origin) for origin in step["origins"]]
    if not len(asks) == len(results) == len(origins):
        raise ValueError("not one result and one origin per request")
    for ask, pieces in zip(asks, results, strict=True):
        # A piece p is an array of figures, with runs along its first axis, or (reason, number of failed runs).
        if sum(len(p) if isinstance(p, np.ndarray) else p[1] for p in pieces) != ask.runs:
            raise ValueError("not as many runs as requested")
    if len({piece.shape[1:] for pieces in results for piece in pieces if isinstance(piece, np.ndarray)}) > 1:
        raise ValueError("figures of different numbers of cases or columns")
    return Step(asks, origins, results)


def _count(value: Any, low: int) -> int:
    """Return ``value`` if it is a whole number from ``low`` to 10^9, else raise ``ValueError``."""
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= 10**9:
        raise ValueError("no count")
    return value


def is_search(folder: Path) -> bool:
    """Return whether a folder holds a search."""
    return (folder / HEAD).is_file() and (folder / SEARCH).is_file()


def held(folder: Path) -> dict[str, Any]:
    """Describe what a search's folder holds in plain values, without running anything.

    ``runs_there`` is the number of runs in the journal, ``runs_wanted`` the number planned for the whole search. A
    finished search may have slightly fewer: methods other than pso request a fixed number of runs of each candidate,
    which may not divide their budget.

    Raises:
        InputError: a file in the folder is damaged.
    """
    search = Search.read(folder / SEARCH)
    steps = list(steps_in(folder))
    # In ``Step.found``, a failed piece is (reason, number of runs).
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
    }


def _piece(given: Any) -> Any:
    """Convert the result of a piece, as parsed from JSON, to an array of figures, (runs, cases, columns).

    The result of a failed piece becomes the tuple (reason, number of runs).

    Raises:
        ValueError, LookupError, TypeError, ...: it is neither.
    """
    if isinstance(given[0], str):
        return given[0], _count(given[1], 0)
    rows = np.array(given, dtype=np.float64)
    if rows.ndim != 3 or 0 in rows.shape[1:] or not np.isfinite(rows).all():
        raise ValueError("figures are not finite numbers (runs, cases, columns)")
    return rows
