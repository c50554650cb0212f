"""The folder of ``--out``: one rule for all commands.

| the folder | what happens |
|---|---|
| is missing or empty | it is used |
| was begun by the same command with the same settings | it is continued |
| was begun by another one | it is refused; ``--force`` removes all but finished runs of studies |
"""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any, Final

from vibroswarm.core.atomic_io import make_folder, write_file
from vibroswarm.errors import InputError

BEGUN: Final = "command.json"
"""The file that says which command has begun a folder, with which settings."""
RUNS: Final = "runs"
"""The folder of runs, whose files are named by what they hold, so that any study can use them."""


def claim(output: Any, command: str, *settings: object) -> None:
    """Make the folder of ``--out`` this command's, or refuse it before the work begins."""
    folder: Path | None = output.out
    if folder is None:
        return
    digest = hashlib.sha256(repr(settings).encode()).hexdigest()[:16]
    begun, text = folder / BEGUN, json.dumps({"command": command, "settings": digest})
    others = [path for path in folder.iterdir() if path.name != RUNS] if folder.exists() else []
    if others and not begun.is_file():
        raise InputError("holds something else; give another --out", field=str(folder))
    if others and begun.read_text(encoding="utf-8") != text:
        if not output.force:
            raise InputError(
                "holds results of another command or other settings; give another --out, or add --force to replace "
                "them",
                field=str(folder),
            )
        for path in others:
            remove = shutil.rmtree if path.is_dir() else Path.unlink
            remove(path)
    make_folder(folder)
    write_file(begun, text)
