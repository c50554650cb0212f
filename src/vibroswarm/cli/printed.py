"""What a command printed, kept in its folder as ``printed.json``, so that ``vibroswarm show`` can print it again.

    format   1
    command  the words of the command, such as "league"
    work     a hash of what the folder holds, where no other file of it says that
    blocks   paragraphs, lines and tables, as of ``output.put``

Tables are laid out anew for the width of the terminal, with all columns if ``--wide``.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from vibroswarm.cli.output import Block, collected, print_json, put
from vibroswarm.core.untrusted_files import entry, read_json, words
from vibroswarm.errors import InputError, check_format

NAME: Final = "printed.json"
FORMAT: Final = 1


class Printed(NamedTuple):
    """What a command printed."""

    command: str
    work: str
    blocks: list[Block]


def hash_of(*parts: object) -> str:
    """Return 16 hexadecimal digits of what a command computes, from its settings."""
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


def deliver(
    arguments: argparse.Namespace,
    folder: Path | None,
    command: str,
    show: Callable[[], None],
    document: Callable[[], Any],
    *,
    work: str = "",
) -> None:
    """Print what ``show`` prints, or ``document`` as JSON if ``--json``; keep the former in ``folder``."""
    with collected() as blocks:
        show()
    if folder is not None:
        write(folder, Printed(command, work, blocks))
    if getattr(arguments, "json", False):
        print_json(document())
    else:
        play(blocks)


def play(blocks: Sequence[Block]) -> None:
    """Print blocks."""
    for block in blocks:
        put(block)


def write(folder: Path, printed: Printed) -> None:
    """Write what was printed into a folder.

    Raises:
        RunError: it cannot be written.
    """
    from vibroswarm.core.atomic_io import write_files

    text = json.dumps({"format": FORMAT, **printed._asdict()}, indent=1, ensure_ascii=False)
    write_files(folder, {NAME: text + "\n"})


def read(folder: Path) -> Printed | None:
    """Read what was printed; None if the folder has none.

    Raises:
        InputError: the file is damaged, or of a newer format.
    """
    path = folder / NAME
    if not path.is_file():
        return None
    about = read_json(path, "what a command printed")
    check_format(entry(about, "format", int, path), FORMAT, str(path))
    blocks = [_block(block, path) for block in entry(about, "blocks", list, path)]
    return Printed(entry(about, "command", str, path), entry(about, "work", str, path), blocks)


def _block(given: Any, path: Path) -> Block:
    """Check a block; characters that a terminal would act on are replaced."""
    for kind in ("text", "line"):
        if isinstance(given, dict) and kind in given:
            return {kind: _plain(entry(given, kind, str, path))}
    columns = [_plain(name) for name in words(entry(given, "columns", list, path), "columns", path)]
    rows = [[_plain(cell) for cell in words(row, "rows", path)] for row in entry(given, "rows", list, path)]
    names, texts = entry(given, "names", int, path), entry(given, "texts", int, path)
    if any(len(row) != len(columns) for row in rows) or not 0 <= names <= len(columns):
        raise InputError("is damaged: a row has more or fewer cells than columns", field=str(path))
    more = words(entry(given, "more", list, path), "more", path)
    return {"columns": columns, "rows": rows, "names": names, "texts": texts, "more": more}


def _plain(text: str) -> str:
    return "".join(c if c.isprintable() else " " if c.isspace() else "?" for c in text)
