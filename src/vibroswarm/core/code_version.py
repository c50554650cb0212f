"""The version of the code that made a result: a hash of its syntax, unaffected by comments and docstrings.

The kernel cache is keyed by ``jit.source_hash``, a hash of the files as they are, which takes 10 ms. The syntax
hash takes up to a second, and so is cached beside the kernels of the same files.
"""

from __future__ import annotations

import ast
import hashlib
import string
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Final

from vibroswarm.core.atomic_io import whole_file
from vibroswarm.core.jit import (
    PACKAGE,
    cache_folder,
    compiles,
    hash_of_sources,
    simulation_sources,
    source_hash,
)
from vibroswarm.errors import InputError, RunError

DIGITS: Final = 16
HASH_FILE: Final = "syntax-hash.txt"


@cache
def code_hash() -> str:
    """Return 16 hexadecimal digits of all code that a simulation may depend on."""
    folder = cache_folder() if compiles() else None
    if folder is None:
        return syntax_hash(PACKAGE, simulation_sources())
    path = folder / HASH_FILE
    with suppress(OSError, UnicodeError):
        kept = path.read_text(encoding="ascii")
        if len(kept) == DIGITS and not set(kept) - set(string.hexdigits):
            return kept
    digest = syntax_hash(PACKAGE, simulation_sources())
    if hash_of_sources() == source_hash():  # else a file was changed since this process started
        with suppress(InputError, RunError), whole_file(path, replace=True) as part:
            part.write_text(digest, encoding="ascii")
    return digest


def syntax_hash(package: Path, sources: Iterable[Path]) -> str:
    """Return 16 hexadecimal digits of Python files and their names, ignoring comments, docstrings and layout.

    Args:
        package: names are relative to this folder.
    """
    digest = hashlib.sha256()
    for source in sources:
        tree = ast.parse(source.read_bytes())
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                node.body = [statement for statement in node.body if not _is_text(statement)]
        name = source.relative_to(package).as_posix()
        digest.update(f"{name}\0{ast.dump(tree)}\0".encode())
    return digest.hexdigest()[:DIGITS]


def _is_text(node: ast.stmt) -> bool:
    """Return whether a statement is a docstring of a module, class, function or field."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
