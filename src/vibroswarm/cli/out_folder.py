"""One rule for a folder that exists already, the same for all commands that save one with ``--out``.

| the folder | what happens |
|---|---|
| is missing or empty | it is used |
| holds the same work | the work continues; what takes a moment is done again |
| holds anything else | refused, exit code 2; ``--force`` replaces it, if vibroswarm wrote it |
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from vibroswarm.core.atomic_io import OURS, remove_folder
from vibroswarm.errors import InputError

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
        work: hash of the settings, as of ``printed.deliver``.
    """
    from vibroswarm.cli import printed

    there = printed.read(folder) if folder.is_dir() else None
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
