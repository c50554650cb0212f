"""The folder of ``--out``: one rule for all commands if the folder exists already.

| the folder | what happens |
|---|---|
| is missing or empty | it is used |
| holds results with the same settings | finished runs are not repeated; tables and pictures are made again |
| holds anything else | it is refused, exit code 2; ``--force`` replaces it if vibroswarm wrote it |
| is a file, lies in a file, or is a symbolic link to nothing | it is refused |
| may not be written to by the user | it is refused |
| would be replaced but is the working folder or holds it, or has a folder that may not be written to | it is refused |
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vibroswarm.cli.interruption import saves_in
from vibroswarm.cli.option_values import refuse
from vibroswarm.core.atomic_io import (
    check_folder,
    check_writable,
)
from vibroswarm.errors import InputError

ADVICE = re.compile(
    r"; (take another folder|give the name of a new folder|give the name of a file|choose another name.*)$"
)
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
            or it is no folder, or may not be written to; or ``--force`` is given without ``--out``.
    """
    out: Path | None = arguments.out
    saves_in(out, resumes=at_once)
    if out is None:
        refuse(arguments.force, "--force", "has no effect without --out DIR")
        return
    if os.path.lexists(out) and not out.is_dir():
        leads_nowhere = out.is_symlink() and not out.exists()
        what = "is a symbolic link to nothing" if leads_nowhere else "is a file"
        raise InputError(f"{what}; give the name of a folder", field=str(out))
    check_writable(out)
    if not at_once:
        check_writable(out.absolute().parent)  # in which the new folder is made
    # A missing or empty folder is accepted. A link is checked even if it leads to such a folder.
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
        # the message without its field and its advice, for the new messages below, which name the folder
        why = ADVICE.sub("", error.reason)
        file = Path(error.field or "")
        if out in file.parents:
            why = f"{file.relative_to(out)} {why}"
        if out.is_symlink():
            raise InputError(
                f"{why}; give another --out (--force replaces no symbolic link)", field=str(out)
            ) from None
        if not arguments.force:
            raise InputError(
                f"{why}; give another --out, or add --force to replace it", field=str(out)
            ) from None
        check_folder(out, replace=True)
        if at_once:
            shutil.rmtree(out)
