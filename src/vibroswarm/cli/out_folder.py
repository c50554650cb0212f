"""The folder of ``--out``: one rule for all commands if the folder exists already, and a copy of what they printed.

| the folder | what happens |
|---|---|
| is missing or empty | it is used |
| holds results with the same settings | finished runs are not repeated; tables and pictures are made again |
| holds anything else | it is refused, exit code 2; ``--force`` replaces it if vibroswarm wrote it |

The file ``printed.json`` in the folder holds what the command printed, so that ``vibroswarm show`` can print it again:

    format   1
    command  the words of the command, such as "league"
    work     a hash of the command's settings; empty if another file of the folder, such as study.toml, has them
    document the document, without its figures (``show.stored``)
    blocks   of commands that have none yet: paragraphs, lines and tables, in the form that ``output.put`` takes

``show`` lays tables out for the width of its own terminal, with all columns if ``--wide``.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from vibroswarm.cli.output import Block, collected, print_json, put
from vibroswarm.cli.terminal import plain
from vibroswarm.core.atomic_io import OURS, remove_folder, write_files
from vibroswarm.core.untrusted_files import entry, read_json, words
from vibroswarm.errors import InputError, check_format

if TYPE_CHECKING:
    from vibroswarm.scenario.scenario import Scenario
    from vibroswarm.show.document import Document

ADVICE = re.compile(r"; (take another folder|give the name of a new folder|choose another name.*)$")
"""Advice at the end of some error messages of the library; ``claim`` replaces it by advice on options."""


def claim(arguments: argparse.Namespace, check: Callable[[], object], *, at_once: bool = True) -> None:
    """Refuse the folder of ``--out`` before the work begins, unless ``check`` accepts it or ``--force`` replaces it.

    A missing or empty folder is accepted; otherwise ``check`` decides. With ``--force``, a folder that ``check``
    refuses is removed if vibroswarm wrote it. Without ``--out``, nothing happens.

    Args:
        check: raises ``InputError`` unless the folder holds results of this command with the same settings. It is
            called if the folder exists and is not empty.
        at_once: whether ``--force`` removes the folder now. False if the caller writes a new folder and puts it in the
            place of the old one when it is complete.
    Raises:
        InputError: ``check`` refuses the folder, and ``--force`` is not given or vibroswarm did not write the folder;
            or ``--force`` is given without ``--out``.
    """
    out: Path | None = arguments.out
    if out is None:
        if arguments.force:
            raise InputError("has no effect without --out DIR", field="--force")
        return
    # A missing or empty folder is accepted. A link is checked even if it leads to such a folder or to nothing.
    try:
        if not out.is_symlink() and (not out.exists() or (out.is_dir() and not any(out.iterdir()))):
            return
    except (OSError, ValueError):
        # The name is impossible, or the folder cannot be read: `check` raises an error with a better message.
        check()
        return
    try:
        check()
    except InputError as error:
        # the message without its field and its advice, for the new messages below
        why = ADVICE.sub("", str(error).removeprefix(f"{error.field}: "))
        if not out.is_dir():  # --force replaces folders only
            raise InputError(why, field=str(out)) from None
        if not arguments.force:
            raise InputError(
                f"{why}; give another --out, or add --force to replace it", field=str(out)
            ) from None
        if out.is_symlink() or not any((out / name).exists() for name in OURS):
            raise InputError(
                f"'{out}' is not a vibroswarm result, so --force does not replace it",
                field="--out",
            ) from None
        if at_once:  # --force is given, and vibroswarm wrote the folder
            remove_folder(out)


def refuse_other(folder: Path, command: str, work: str) -> None:
    """Refuse a folder unless its ``printed.json`` states the same command and the same settings.

    Args:
        command: the words of the command, such as "lab import".
        work: hash of the command's settings (``hash_of``), which ``deliver`` saves in ``printed.json``.
    Raises:
        InputError: the folder is refused.
    """
    there = read_printed(folder) if folder.is_dir() else None
    if there is None:
        raise InputError(f"exists already but holds no results of '{command}'", field=str(folder))
    if there.command != command:
        raise InputError(f"exists already and holds results of '{there.command}'", field=str(folder))
    if there.work != work:
        raise InputError(
            f"exists already and holds results of '{command}' with other settings", field=str(folder)
        )


def refuse_other_run(folder: Path, scenario: Scenario, seed: int, motion: str) -> None:
    """Refuse a folder unless it holds the result of the same run, made by the same version of the code.

    A run is the same if scenario, seed and motion source are equal.

    Raises:
        InputError: the folder is refused.
    """
    from vibroswarm.core.code_version import code_hash
    from vibroswarm.result import Result

    if not folder.is_dir():
        raise InputError("is a file; give the name of a folder", field=str(folder))
    try:
        there = Result.read(folder)
    except InputError as error:
        raise InputError(
            f"exists already: {str(error).removeprefix(f'{error.field}: ')}", field=str(folder)
        ) from None
    if there.scenario != scenario:
        raise InputError("exists already and holds a run of another scenario", field=str(folder))
    if (there.seed, there.source) != (seed, motion):
        what = f"a run with seed {there.seed} by '{there.source}'"
        raise InputError(f"exists already and holds {what}", field=str(folder))
    if there.versions.get("code") != code_hash():
        raise InputError("exists already and was made by another version of vibroswarm", field=str(folder))


PRINTED: Final = "printed.json"
"""Name of the file with what a command printed."""
FORMAT: Final = 1
"""Format of ``printed.json``, by which a newer format is recognised."""


class Printed(NamedTuple):
    """What a command printed: the content of ``printed.json``, whose fields the module's docstring explains."""

    command: str
    work: str
    blocks: list[Block] = []  # noqa: RUF012 - a named tuple's default is not changed
    document: Document | None = None


def hash_of(*parts: object) -> str:
    """Return 16 hexadecimal digits that identify a command's work: the hash of its settings.

    Args:
        parts: the settings. Their ``repr`` must be the same in every process.
    """
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
    """Print the results as text, or with ``--json`` as a document; save the text in ``folder`` in both cases.

    Args:
        folder: the folder in which the text is saved, as ``printed.json``; None to save nothing.
        command: the words of the command, such as "league".
        show: prints the results with the functions of ``output``.
        document: returns the document that ``--json`` prints; not called without ``--json``.
        work: hash of the settings (``hash_of``), by which ``refuse_other`` recognises the folder later; empty for
            commands that do not use ``refuse_other``.
    """
    with collected() as blocks:
        show()
    if folder is not None:
        write_printed(folder, Printed(command, work, blocks))
    if getattr(arguments, "json", False):
        print_json(document())
    else:
        print_blocks(blocks)


def print_blocks(blocks: Sequence[Block]) -> None:
    """Print paragraphs, lines and tables."""
    for block in blocks:
        put(block)


def write_printed(folder: Path, printed: Printed) -> None:
    """Write ``printed.json`` into a folder.

    Raises:
        RunError: it cannot be written.
    """
    from vibroswarm.show.stored import document_values

    about = {"format": FORMAT, "command": printed.command, "work": printed.work}
    if printed.document is None:
        about["blocks"] = printed.blocks
    else:
        about["document"] = document_values(printed.document)
    write_files(folder, {PRINTED: json.dumps(about, indent=1) + "\n"})


def read_printed(folder: Path) -> Printed | None:
    """Read ``printed.json`` of a folder; None if the folder has no such file.

    Raises:
        InputError: the file is damaged, of a newer format, or no plain file.
    """
    path = folder / PRINTED
    if not os.path.lexists(path):  # what is there but is no plain file is refused below
        return None
    about = read_json(path, "what a command printed")
    check_format(entry(about, "format", int, path), FORMAT, str(path))
    if "document" in about:
        from vibroswarm.show.stored import document_from

        document = document_from(about["document"], str(path))
        return Printed(entry(about, "command", str, path), entry(about, "work", str, path), document=document)
    blocks = [_block(block, path) for block in entry(about, "blocks", list, path)]
    return Printed(entry(about, "command", str, path), entry(about, "work", str, path), blocks)


def _block(given: Any, path: Path) -> Block:
    """Return a block of ``printed.json`` after checking its form: a paragraph, a line or a table.

    The file may come from someone else, so control characters, which a terminal would obey, are replaced in all that
    is printed. The entries of a table are the arguments of ``output.print_table``.

    Args:
        given: the block as it was read from JSON.
        path: the file, for error messages.
    Raises:
        InputError: the block has none of these forms.
    """
    for kind in ("text", "line"):
        if isinstance(given, dict) and kind in given:
            return {kind: plain(entry(given, kind, str, path))}
    # The block must be a table; `entry` refuses what is not. `names` is how many of the first columns name a row,
    # `texts` how many of the first columns hold text (a table can be laid out with any such number, so it is not
    # checked). `more` lists the columns that are printed with --wide only; it is compared with the headers, and not
    # printed.
    columns = [plain(name) for name in words(entry(given, "columns", list, path), "columns", path)]
    rows = [[plain(cell) for cell in words(row, "rows", path)] for row in entry(given, "rows", list, path)]
    names, texts = entry(given, "names", int, path), entry(given, "texts", int, path)
    if any(len(row) != len(columns) for row in rows):
        raise InputError("is damaged: a row has more or fewer cells than columns", field=str(path))
    if not 0 <= names <= len(columns):
        raise InputError(f"is damaged: 'names' is {names}, not from 0 to {len(columns)}", field=str(path))
    more = words(entry(given, "more", list, path), "more", path)
    return {"columns": columns, "rows": rows, "names": names, "texts": texts, "more": more}
