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

from vibroswarm.errors import InputError, RunError, older, shown
from vibroswarm.files import whole_file
from vibroswarm.folder_lock import FILE as LOCK
from vibroswarm.folder_lock import folder_lock
from vibroswarm.leftovers import remove_leftovers
from vibroswarm.notices import say_once
from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.method import Ask
from vibroswarm.optimize.spec import FORMAT, Search, differences
from vibroswarm.plain_files import entry, number, read_bytes, read_json, texts
from vibroswarm.result import write_code
from vibroswarm.simulation import versions

SEARCH: Final = "search.toml"
HEAD: Final = "search.json"
JOURNAL: Final = "journal.jsonl"
MOST_JOURNAL: Final = 2**30
"""Bytes of a journal: some 20 million runs."""


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
        write_code(self.folder, (cell.scenario for cell in self.search.cases), self.search.study.motion)
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
        path = self.folder / HEAD
        head = read_json(path, "the head of a search")
        version, told = entry(head, "format", int, path), entry(head, "hash", str, path)
        made_by = texts(entry(head, "versions", dict, path), "versions", path)
        if version < FORMAT:
            raise InputError(older(version), field=str(self.folder))
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
    path = folder / JOURNAL
    if not path.exists():
        raise InputError(f"{JOURNAL} is missing", field=str(folder))
    lines = read_bytes(path, MOST_JOURNAL, "the journal of a search").split(b"\n")
    for k, line in enumerate(lines[:-1]):
        try:
            yield _step(json.loads(line))
        except (ValueError, LookupError, TypeError, OverflowError, AttributeError, RecursionError):
            raise InputError(
                f"line {k + 1} is damaged; put the file back from a copy, or cut it before that line, from where the "
                "search then goes on",
                field=str(path),
            ) from None


def _step(step: Any) -> Step:
    """One line: for each ask as many pieces as make its runs, all of one shape beside the runs."""
    asks = [Ask(_count(key, 0), _count(runs, 1)) for key, runs in step["asks"]]
    found = [[_piece(piece) for piece in pieces] for pieces in step["found"]]
    origins = [str(origin) for origin in step["origins"]]
    if not len(asks) == len(found) == len(origins):
        raise ValueError("not as many pieces as asks")
    for ask, pieces in zip(asks, found, strict=True):
        if sum(len(p) if isinstance(p, np.ndarray) else p[1] for p in pieces) != ask.runs:
            raise ValueError("not as many runs as asked for")
    if len({piece.shape[1:] for pieces in found for piece in pieces if isinstance(piece, np.ndarray)}) > 1:
        raise ValueError("rows of different width")
    return Step(asks, origins, found)


def _count(value: Any, low: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= 10**9:
        raise ValueError("no count")
    return value


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
    """The result of a search, as far as it is shown again; None where it was not scored yet.

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
        for about, name in ((truth, "believed"), (score, "low"), (score, "estimate"), (score, "high")):
            if about.get(name) is not None or name not in about:
                number(about, name, path)
        entry(truth, "says", str, path)
    if (front := result.get("front")) is not None:
        entry(front, "says", str, path)
    checked: dict[str, Any] = result
    return checked


def _piece(given: Any) -> Any:
    """Rows as an array, (runs, cases, columns); a failure as (why, runs)."""
    if isinstance(given[0], str):
        return given[0], _count(given[1], 0)
    rows = np.array(given, dtype=np.float64)
    if rows.ndim != 3 or 0 in rows.shape[1:] or not np.isfinite(rows).all():
        raise ValueError("no rows")
    return rows
