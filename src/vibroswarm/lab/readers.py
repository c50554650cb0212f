"""Readers of logs by name. A new one is a function from a path to a ``Log`` and one ``register`` call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from vibroswarm.errors import InputError, nearest
from vibroswarm.lab.cells import text_of
from vibroswarm.lab.log import Log
from vibroswarm.lab.mapped import column_map, read_mapped, rugbot_map
from vibroswarm.lab.webots import looks_like_webots, read_webots

HEAD: Final = 2**20
"""So much of a file is looked at to see what it is, characters."""


@dataclass(frozen=True)
class Reader:
    """A kind of log."""

    name: str
    about: str
    recognises: Callable[[str], bool]
    """Told the beginning of a file: is it of this kind?"""
    read: Callable[[Path], Log]


_READERS: dict[str, Reader] = {}


def register(reader: Reader) -> None:
    """Make a reader known by its name."""
    _READERS[reader.name] = reader


def readers() -> list[Reader]:
    """All that are known."""
    return list(_READERS.values())


def read_log(path: str | Path, reader: str | None = None, columns: str | Path | None = None) -> Log:
    """A log, by the reader of that name, by a column map, or by the reader that knows it.

    Raises:
        InputError: no reader knows it; or what that reader found wrong.
    """
    path = Path(path)
    if columns is not None:
        return read_mapped(path, column_map(text_of(Path(columns)), str(columns)))
    if reader is not None:
        if reader not in _READERS:
            raise InputError(
                f"there is no reader '{reader}'{nearest(reader, _READERS)} (there are {', '.join(_READERS)})",
                field="--reader",
            )
        return _READERS[reader].read(path)
    head = text_of(path)[:HEAD]
    for one in _READERS.values():
        if one.recognises(head):
            return one.read(path)
    raise InputError(
        f"is no log that is known ({', '.join(_READERS)}); any CSV can be read with --columns MAP.toml",
        field=str(path),
    )


def _has_head(head: str) -> bool:
    """Enough of the names are there to say what is missing."""
    first = head.split("\n", 1)[0].split(",")
    names = {column.name for column in rugbot_map().columns.values()}
    return len(names & {cell.strip() for cell in first}) >= 5


register(
    Reader(
        "rugbot",
        "CSV of the study's real robots (tracking rows and sample rows)",
        _has_head,
        lambda path: read_mapped(path, rugbot_map()),
    )
)
register(Reader("webots", "console log of the study's simulator", looks_like_webots, read_webots))
