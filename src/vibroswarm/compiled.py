"""The one door to Numba: ``@kernel`` compiles a scalar function where Numba is, and leaves it plain elsewhere.

Numba's own disk cache looks only at the file of the function itself, so a change in a function that it
calls from another file would go unseen. The cache folder is therefore named by a hash of all sources of
the package and of the versions that matter: a changed kernel is never run stale.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

PLAIN = os.environ.get("VIBROSWARM_PLAIN", "") == "1"
"""Set the environment variable VIBROSWARM_PLAIN to 1 to step through the kernels as plain Python."""


def _user_cache() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", str(Path.home() / "AppData/Local")))
    if sys.platform == "darwin":
        return Path.home() / "Library/Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


@cache
def cache_folder() -> Path | None:
    """Folder of the compiled kernels of exactly these sources and versions, or None if none can be written."""
    import llvmlite
    import numba
    import numpy

    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(source.name.encode() + b"\0" + source.read_bytes())
    versions = (sys.version, numba.__version__, llvmlite.__version__, numpy.__version__, platform.machine())
    digest.update(repr(versions).encode())
    try:
        folder = _user_cache() / "vibroswarm" / "kernels" / digest.hexdigest()[:20]
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except (OSError, RuntimeError):  # a read-only or missing home: compile anew each time
        return None


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile ``function`` in nopython mode (IEEE arithmetic, no fastmath), cached on disk."""
    if PLAIN:
        return function
    try:
        import numba
    except ImportError:
        return function
    folder = cache_folder()
    config: Any = numba.config
    before = config.CACHE_DIR
    config.CACHE_DIR = str(folder) if folder else before
    try:
        compiled: Callable[P, R] = numba.njit(cache=folder is not None, nogil=True)(function)
    finally:
        config.CACHE_DIR = before
    return compiled
