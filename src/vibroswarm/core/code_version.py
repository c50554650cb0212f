"""The version of the code that made a result: a hash of its syntax, unaffected by comments and docstrings.

A hash of the files' bytes takes 10 ms, and that of their syntax half a second. The second is therefore saved under the
first, as a file in the folder of cached kernels.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Final

from vibroswarm.core.atomic_io import whole_file
from vibroswarm.core.jit import (
    PACKAGE,
    cache_folder,
    compiles,
    hash_of_files,
    simulation_sources,
    source_hash,
)
from vibroswarm.errors import InputError, RunError

DIGITS: Final = 16
"""Number of hexadecimal digits of the hash."""
IMPLIED: Final = frozenset({"ctx", "kind", "type_comment"})
"""Fields of syntax trees that follow from the others or mean nothing to Python."""


@cache
def code_hash() -> str:
    """Return 16 hexadecimal digits that identify all code that a simulation may depend on."""
    return saved_syntax_hash(PACKAGE, simulation_sources(), source_hash())


def saved_syntax_hash(package: Path, sources: Sequence[Path], of_bytes: str | None = None) -> str:
    """Return ``syntax_hash``; it is saved in the folder of cached kernels, under a hash of the files' bytes.

    Args:
        of_bytes: that hash, if it is known.
    """
    folder = cache_folder() if compiles() else None
    if folder is None:
        return syntax_hash(package, sources)
    of_bytes = of_bytes or hash_of_files(package, sources)
    path = folder / f"syntax-hash-{of_bytes}.txt"
    digest = _saved(path)
    if digest is None:
        digest = syntax_hash(package, sources)
        if hash_of_files(package, sources) == of_bytes:  # else a file was changed in between
            _save(path, digest)
    return digest


def _saved(path: Path) -> str | None:
    """Return the hash that a file holds; None if there is no such file, or it is damaged."""
    with suppress(OSError, UnicodeError):
        saved = path.read_text(encoding="ascii")
        digest = saved[:DIGITS]
        if saved == _sealed(digest):
            return digest
    return None


def _sealed(digest: str) -> str:
    """Return the text that is saved for a hash: with one changed digit, results would name code that does not exist."""
    return f"{digest} {hashlib.sha256(digest.encode()).hexdigest()}"


def _save(path: Path, digest: str) -> None:
    """Save a hash in a file; without effect if the file cannot be written."""
    with suppress(InputError, RunError), whole_file(path, replace=True) as part:
        part.write_text(_sealed(digest), encoding="ascii")


def syntax_hash(package: Path, sources: Iterable[Path]) -> str:
    """Return a hash (16 hexadecimal digits) of Python files and their names, ignoring comments, docstrings and layout.

    Versions of Python may make other syntax trees of the same text, so the hash may depend on the version.

    Args:
        package: folder to which the names that are hashed are relative, so that the hash does not depend on where the
            package is installed.
        sources: the files, in an order that must always be the same.
    """
    digest = hashlib.sha256()
    for source in sources:
        words = [source.relative_to(package).as_posix()]
        _list_words(ast.parse(source.read_bytes()), words)
        digest.update("\0".join([*words, ""]).encode())
    return digest.hexdigest()[:DIGITS]


def _list_words(value: Any, words: list[str]) -> None:
    """Append what tells a value of a syntax tree from others, without docstrings; ``ast.dump`` takes twice the time."""
    if isinstance(value, ast.AST):
        kind = type(value)
        words.append(kind.__name__)
        for name in kind._fields:
            if name not in IMPLIED:
                _list_words(getattr(value, name, None), words)
    elif isinstance(value, list):
        words.append("[")
        for each in value:
            if not _is_text(each):
                _list_words(each, words)
        words.append("]")
    else:
        words.append(repr(value))


def _is_text(node: Any) -> bool:
    """Return whether a statement is only a text: the docstring of a module, class, function or field."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
