"""The folder of ``--out``: one rule for all commands if the folder exists already, and a copy of what they printed.

| the folder | what happens |
|---|---|
| is missing or empty | it is used |
| holds results with the same settings | finished runs are not repeated; tables and pictures are made again |
| holds anything else | it is refused, exit code 2; ``--force`` replaces it if vibroswarm wrote it |

The file ``printed.json`` in the folder holds what the command printed, so that ``vibroswarm show`` can print it again:

    format   2
    command  the words of the command, such as "league"
    work     a hash of the command's settings; empty if another file of the folder, such as study.toml, has them
    document the document, without its figures (``show.stored``)

``show`` lays tables out for the width of its own terminal, with all columns if ``--wide``.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from vibroswarm.core.atomic_io import OURS, remove_folder, write_files
from vibroswarm.core.untrusted_files import entry, read_json
from vibroswarm.errors import InputError, check_format

if TYPE_CHECKING:
    from vibroswarm.scenario.scenario import Scenario
    from vibroswarm.show.document import Document

ADVICE = re.compile(r"; (take another folder|give the name of a new folder|choose another name.*)$")
"""Advice at the end of some error messages of the library; ``claim`` replaces it by advice on options."""


def claim(arguments: Any, check: Callable[[Path], object], *, at_once: bool = True) -> None:
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
    from vibroswarm.cli.interruption import saves_in

    out: Path | None = arguments.out
    saves_in(out, resumes=at_once)
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
        check(out)
        return
    try:
        check(out)
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
FORMAT: Final = 2
"""Format of ``printed.json``, by which a newer format is recognised."""


class Printed(NamedTuple):
    """What a command printed: the content of ``printed.json``, whose fields the module's docstring explains."""

    command: str
    work: str
    document: Document


def hash_of(*parts: object) -> str:
    """Return 16 hexadecimal digits that identify a command's work: the hash of its settings.

    Args:
        parts: the settings. Their ``repr`` must be the same in every process.
    """
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


def write_printed(folder: Path, printed: Printed) -> None:
    """Write ``printed.json`` into a folder.

    Raises:
        RunError: it cannot be written.
    """
    from vibroswarm.show.stored import document_values

    about = {
        "format": FORMAT,
        "command": printed.command,
        "work": printed.work,
        "document": document_values(printed.document),
    }
    write_files(folder, {PRINTED: json.dumps(about, indent=1) + "\n"})


def read_printed(folder: Path) -> Printed | None:
    """Read ``printed.json`` of a folder; None if the folder has no such file.

    Raises:
        InputError: the file is damaged, of a newer format, or no plain file.
    """
    from vibroswarm.show.stored import document_from

    path = folder / PRINTED
    if not os.path.lexists(path):  # what is there but is no plain file is refused below
        return None
    about = read_json(path, "what a command printed")
    check_format(entry(about, "format", int, path), FORMAT, str(path))
    command, work = entry(about, "command", str, path), entry(about, "work", str, path)
    return Printed(command, work, document_from(entry(about, "document", dict, path), str(path)))
