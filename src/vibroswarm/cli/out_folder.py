"""The folder of ``--out``: one rule, the same for all commands, if it exists already; and what was printed, kept in it.

| the folder | what happens |
|---|---|
| is missing or empty | it is used |
| holds the same work | the work continues; what takes a moment is done again |
| holds anything else | refused, exit code 2; ``--force`` replaces it, if vibroswarm wrote it |

``printed.json`` holds what a command printed, so that ``vibroswarm show`` can print it again:

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

ADVICE = re.compile(r"; (take another folder|give the name of a new folder|choose another name.*)$")


def claim(arguments: argparse.Namespace, check: Callable[[], object], *, at_once: bool = True) -> None:
    """Apply the rule to ``arguments.out`` before the work.

    Args:
        check: raises ``InputError`` if the folder, which is not empty, does not hold the same work.
        at_once: whether ``--force`` removes the folder now; otherwise it is replaced when the new one is complete.
    Raises:
        InputError: the folder holds something else.
    """
    out: Path | None = arguments.out
    if out is None:
        if arguments.force:
            raise InputError("has no effect without --out DIR", field="--force")
        return
    try:
        if not out.is_symlink() and (not out.exists() or (out.is_dir() and not any(out.iterdir()))):
            return
    except (OSError, ValueError):  # a name that is no name, or a folder that cannot be read
        check()
        return
    try:
        check()
    except InputError as error:
        why = ADVICE.sub("", str(error).removeprefix(f"{error.field}: "))
        if not out.is_dir():
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
        if at_once:
            remove_folder(out)


def refuse_other(folder: Path, command: str, work: str) -> None:
    """Refuse a folder that does not hold what a command printed with the same settings.

    Args:
        work: hash of the settings, as of ``deliver``.
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
    """Refuse a folder that does not hold the result of this run, made by the same code."""
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
FORMAT: Final = 1


class Printed(NamedTuple):
    """What a command printed."""

    command: str
    work: str
    blocks: list[Block]


def hash_of(*parts: object) -> str:
    """Return 16 hexadecimal digits that identify a command's work: the hash of its settings."""
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
    """Print what ``show`` prints, or with ``--json`` the document; save what ``show`` prints in ``folder``, if given.

    Args:
        work: hash of the settings, by which ``refuse_other`` recognises the same work.
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
    """Print blocks."""
    for block in blocks:
        put(block)


def write_printed(folder: Path, printed: Printed) -> None:
    """Write what was printed into a folder.

    Raises:
        RunError: it cannot be written.
    """
    text = json.dumps({"format": FORMAT, **printed._asdict()}, indent=1, ensure_ascii=False)
    write_files(folder, {PRINTED: text + "\n"})


def read_printed(folder: Path) -> Printed | None:
    """Read what was printed; None if the folder has none.

    Raises:
        InputError: the file is damaged, or of a newer format.
    """
    path = folder / PRINTED
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
            return {kind: plain(entry(given, kind, str, path))}
    columns = [plain(name) for name in words(entry(given, "columns", list, path), "columns", path)]
    rows = [[plain(cell) for cell in words(row, "rows", path)] for row in entry(given, "rows", list, path)]
    names, texts = entry(given, "names", int, path), entry(given, "texts", int, path)
    if any(len(row) != len(columns) for row in rows) or not 0 <= names <= len(columns):
        raise InputError("is damaged: a row has more or fewer cells than columns", field=str(path))
    more = words(entry(given, "more", list, path), "more", path)
    return {"columns": columns, "rows": rows, "names": names, "texts": texts, "more": more}
