"""Modules whose text is generated: files in the folder of cached kernels, written once and never changed.

Their names have a hash of all that they are made of, so a file that is there is the right one; one that is damaged is
written again. Where files cannot be written, or kernels are not to be saved, the files are in a folder of this process
alone, and are removed at its end.
"""

from __future__ import annotations

import atexit
import shutil
import sys
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import ModuleType

from vibroswarm.core.atomic_io import whole_file
from vibroswarm.core.jit import cache_folder, compiles, never_cache
from vibroswarm.errors import InputError, RunError


def generated_module(name: str, text: str, *, is_saved: bool = True) -> ModuleType:
    """Return the module of a text, after writing it into a file and running it.

    Args:
        name: full name of the module; all but its last part names a folder. text: its source.
        is_saved: whether its kernels are cached for later processes.
    """
    file = _written(name, text) if is_saved and compiles() else None
    if file is None:
        file = _own_folder() / _place(name)
        never_cache(str(file))
        with suppress(OSError):  # without its file it has no lines in tracebacks
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
    module = ModuleType(name)
    module.__file__ = str(file)
    _register(module)
    # Not imported: Python would save bytecode, which has no checksum.
    exec(compile(text, str(file), "exec"), vars(module))  # noqa: S102  (our own text)
    return module


def _place(name: str) -> Path:
    return Path(*name.split(".")).with_suffix(".py")


def _written(name: str, text: str) -> Path | None:
    """Return the file in the folder of cached kernels that holds the text; None if it cannot be written."""
    folder = cache_folder()
    if folder is None:
        return None
    path, content = folder / _place(name), text.encode()
    with suppress(OSError):
        if path.read_bytes() == content:
            return path
    try:
        for place in (*reversed(path.relative_to(folder).parents[:-1]),):
            (folder / place).mkdir(mode=0o700, exist_ok=True)
        with whole_file(path) as part:
            part.write_bytes(content)
    except (OSError, InputError, RunError):
        return None
    return path


@cache
def _own_folder() -> Path:
    """Return an empty folder that is removed when this process ends."""
    folder = tempfile.mkdtemp(prefix="vibroswarm-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def _register(module: ModuleType) -> None:
    """Register a module and its parent packages in ``sys.modules``."""
    parts = module.__name__.split(".")
    for count in range(1, len(parts)):
        parent = ".".join(parts[:count])
        if parent not in sys.modules:
            package = ModuleType(parent)
            package.__path__ = []  # a module with a path is a package
            sys.modules[parent] = package
    sys.modules[module.__name__] = module
