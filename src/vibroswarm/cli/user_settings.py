"""The user's settings file: how pictures look and how many workers run, never what is simulated.

The file is ``config.toml`` in the folder ``vibroswarm`` of ``$XDG_CONFIG_HOME`` (by default ``~/.config``; on Windows
``%APPDATA%``). The environment variable VIBROSWARM_CONFIG names another file; if it is set to an empty text, no file is
read. Options on the command line override the file.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from vibroswarm.cli.options import STYLES
from vibroswarm.core.child_python import MOST_WORKERS
from vibroswarm.errors import InputError, check_choice, nearest, whole_number_of

NAMES: Final = ("style", "workers")
"""Keys of the file, each the name of an option."""
VARIABLE: Final = "VIBROSWARM_CONFIG"
"""The environment variable that names another settings file, or none if it is empty."""


def location() -> Path | None:
    """Return the path of the settings file, which may not exist.

    It is None if VIBROSWARM_CONFIG is set to an empty text, or if the user has no home, as in some containers.
    """
    if (given := os.environ.get(VARIABLE)) is not None:
        return Path(given) if given else None
    on_windows = sys.platform == "win32"
    stated = Path(os.environ.get("APPDATA" if on_windows else "XDG_CONFIG_HOME", ""))
    try:
        # The standard ignores relative paths.
        folder = (
            stated if stated.is_absolute() else Path.home() / ("AppData/Roaming" if on_windows else ".config")
        )
    except RuntimeError:  # neither HOME nor an entry of this user
        return None
    return folder / "vibroswarm" / "config.toml"


def read() -> dict[str, Any]:
    """Read and check the settings file; return its values by key, empty if there is no file.

    Raises:
        InputError: the file cannot be read, or has an unknown key or a wrong value; or VIBROSWARM_CONFIG names a file
            that does not exist.
    """
    path = location()
    if path is None:
        return {}
    # Path.exists raises an error in the home of another user, as with HOME kept by sudo; nothing there is ours to read.
    if VARIABLE not in os.environ and not os.path.exists(path):  # noqa: PTH110
        return {}
    from vibroswarm.core.untrusted_files import parsed_toml, read_text

    settings = parsed_toml(read_text(path, "a settings file"), str(path))
    for name, value in settings.items():
        field = f"{path}: {name}"
        if name not in NAMES:
            raise InputError(
                f"is not a setting{nearest(name, NAMES)} (there are {' and '.join(NAMES)}; what is simulated belongs "
                "in a scenario)",
                field=field,
            )
        if name == "style":
            check_choice(value, field, STYLES)
        else:
            whole_number_of(value, field, 1, MOST_WORKERS)
    return settings


def apply(settings: dict[str, Any], values: argparse.Namespace, words: Sequence[str]) -> None:
    """Put each setting in the place of an option's value, unless the option is given or the command has none.

    A style is of pictures, which are saved in the folder of ``--out``.
    """
    for name, value in settings.items():
        given = any(word.partition("=")[0] == f"--{name}" for word in words)
        is_of_use = name != "style" or getattr(values, "out", None) is not None
        if hasattr(values, name) and not given and is_of_use:
            setattr(values, name, value)
