"""The record of a search: a folder whose journal grows by a line a step, so that nothing done is done again.

    search.toml     the search, standing alone
    search.json     format, hash, versions
    journal.jsonl   a line a step: what was asked for and the figures of every run
    .lock           the process that is at it, while it is

A search is resumed by asking its method anew, from the beginning, and telling it what the journal holds: nothing is
unpickled, and the same history gives the same next question, bit by bit. A line that was being written when the process
was killed is dropped. Only one process at a time may write: see ``Journal.alone``.
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

from vibroswarm.errors import InputError, RunError
from vibroswarm.files import whole_file
from vibroswarm.folder_lock import FILE as LOCK
from vibroswarm.folder_lock import folder_lock
from vibroswarm.leftovers import remove_leftovers
from vibroswarm.notices import say_once
from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.method import Ask
from vibroswarm.optimize.spec import FORMAT, Search, differences
from vibroswarm.simulation import versions

SEARCH: Final = "search.toml"
HEAD: Final = "search.json"
JOURNAL: Final = "journal.jsonl"


@dataclass
class Step:
    """One step: runs asked for, and what came of them."""

    asks: list[Ask]
    origins: list[str]
    found: list[list[Any]]
    """For each ask, the pieces: rows, or why there are none, with the number of runs."""


class Journal:
    """A search's folder."""

    def __init__(self, folder: str | Path, search: Search, *, mixed: bool = False) -> None:
        """The folder of this search: one that is there, or that ``alone`` makes.

        Raises:
            InputError: something else is there, another search, other versions.
        """
        self.folder, self.search, self.mixed = Path(folder), search, mixed
        self._text = search.to_toml()
        if not self._is_there() and self._is_foreign():
            raise InputError("is there and no search; give the name of a new folder", field=str(self.folder))

    def _is_there(self) -> bool:
        """Whether this search is in the folder; raises where another is."""
        if not (self.folder / HEAD).is_file():
            return False
        self._check(self.search, self.mixed)
        return True

    def _is_foreign(self) -> bool:
        """Whether something is there that is not of this search; what a killed process had begun is."""
        return self.folder.exists() and not (
            self.folder.is_dir() and all(self._is_begun(path) for path in self.folder.iterdir())
        )

    def _is_begun(self, path: Path) -> bool:
        if path.name == SEARCH:
            return path.read_bytes() == self._text.encode()
        if path.name == JOURNAL:
            return path.stat().st_size == 0
        return path.name == LOCK or path.name.startswith((f".{SEARCH}.", f".{JOURNAL}.", f".{HEAD}."))

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Be the one process that writes; make the folder if it is not there yet.

        Raises:
            InputError: another process is at it. RunError: it cannot be written.
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
        try:
            for name, content in (
                (SEARCH, self._text),
                (JOURNAL, ""),
                (HEAD, json.dumps(head, indent=1) + "\n"),
            ):
                with whole_file(self.folder / name) as part:
                    part.write_text(content, encoding="utf-8")
        except OSError as error:
            raise RunError(f"could not write '{self.folder}': {error.strerror or error}") from error

    def steps(self) -> Iterator[Step]:
        """The steps that are there, in order; see ``steps_in``."""
        return steps_in(self.folder)

    def cut(self) -> None:
        """Drop a last line that was not written whole, and say so."""
        path = self.folder / JOURNAL
        data = path.read_bytes()
        end = data.rfind(b"\n") + 1
        if end < len(data):
            with path.open("r+b") as stream:
                stream.truncate(end)
            say_once(
                f"{path}: the last line was not written whole; it is dropped, and its runs are done again"
            )

    def add(self, archive: Archive, asks: Sequence[Ask], found: Sequence[Sequence[Any]]) -> None:
        """A step is done."""
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
        try:
            head = json.loads((self.folder / HEAD).read_text(encoding="utf-8"))
            version, told, made_by = int(head["format"]), str(head["hash"]), dict(head["versions"])
        except (OSError, ValueError, KeyError, TypeError):
            raise InputError(f"{HEAD} is damaged", field=str(self.folder)) from None
        if version > FORMAT:
            raise InputError(f"is of format {version}; update vibroswarm", field=str(self.folder))
        if told != search.hash:
            different = differences(Search.read(self.folder / SEARCH), search)
            raise InputError(
                f"holds another search: {'; '.join(different[:3]) or 'its scenario differs'}; take another folder",
                field=str(self.folder),
            )
        mine = {} if mixed else versions()
        if told_apart := [
            f"{k} {made_by.get(k)} there, {v} here" for k, v in mine.items() if made_by.get(k) != v
        ]:
            raise InputError(
                f"was begun by other versions ({'; '.join(told_apart)}); go on with those, take a new folder, or say "
                "--mixed to go on all the same",
                field=str(self.folder),
            )


def steps_in(folder: Path) -> Iterator[Step]:
    """The steps of a search's folder, in order.

    Raises:
        InputError: the journal cannot be read, or is damaged before its last line.
    """
    try:
        lines = (folder / JOURNAL).read_bytes().split(b"\n")
    except FileNotFoundError:
        raise InputError(f"{JOURNAL} is missing", field=str(folder)) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", field=str(folder / JOURNAL)) from None
    for k, line in enumerate(lines[:-1]):
        try:
            step = json.loads(line)
            asks = [Ask(int(key), int(count)) for key, count in step["asks"]]
            found = [[_piece(piece) for piece in pieces] for pieces in step["found"]]
            if [ask.runs for ask in asks] != [sum(map(_runs_of, pieces)) for pieces in found]:
                raise ValueError("not the runs that were asked for")
            yield Step(asks, [str(origin) for origin in step["origins"]], found)
        except (ValueError, KeyError, TypeError, AttributeError, IndexError, OverflowError, RecursionError):
            raise InputError(
                f"line {k + 1} is damaged; put the file back from a copy, or cut it before that line, from where the "
                "search then goes on",
                field=str(folder / JOURNAL),
            ) from None


def is_search(folder: Path) -> bool:
    """Whether a folder holds a search."""
    return (folder / HEAD).is_file() and (folder / SEARCH).is_file()


def held(folder: Path) -> dict[str, Any]:
    """What a search's folder holds, in plain values; nothing is run.

    Raises:
        InputError: it is damaged.
    """
    search = Search.read(folder / SEARCH)
    steps = list(steps_in(folder))
    try:
        result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    except (
        OSError,
        ValueError,
    ):  # not there yet, or being looked at as it is damaged: it is written anew at the end
        result = None
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


def _piece(given: Any) -> Any:
    """Rows as an array; a failure as (why, runs)."""
    if isinstance(given[0], str):
        return str(given[0]), int(given[1])
    rows = np.array(given, dtype=np.float64)
    if rows.ndim != 3:
        raise ValueError("no rows")
    return rows


def _runs_of(piece: Any) -> int:
    """Runs of a piece, done or failed."""
    return int(piece.shape[0] if isinstance(piece, np.ndarray) else piece[1])
