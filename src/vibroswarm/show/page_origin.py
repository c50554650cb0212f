"""A page may say what it was made from, so that its pictures are not drawn again while that has not changed.

The last line of such a page is a comment with two hashes: of what it was made from, and of the page itself, without
which a page that was damaged or edited would count as up to date.
"""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from vibroswarm.core.jit import PACKAGE

DRAWN_BY: Final = ("matplotlib", "numpy", "polars", "scipy")
"""Packages whose versions may change a page."""
MOST_BYTES: Final = 1 << 28
"""A larger file is not read: it is no page of ours."""


@cache
def program() -> str:
    """Return a hash of all files of this package, templates too, and of the versions of what draws."""
    digest = hashlib.sha256(json.dumps({name: version(name) for name in DRAWN_BY}).encode())
    for file in sorted(PACKAGE.rglob("*")):
        if file.is_file() and file.suffix != ".pyc":
            digest.update(file.relative_to(PACKAGE).as_posix().encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()


def origin(content: Any) -> str:
    """Return a hash of what a page is made from, and of the program that makes it.

    Args:
        content: plain values, as JSON has them.
    """
    return hashlib.sha256(f"{program()}\n{json.dumps(content, sort_keys=True)}\n".encode()).hexdigest()


def with_origin(page: str, made_from: str) -> str:
    """Return the text of a page with the comment that says what it was made from (``origin``)."""
    return f"{page}<!-- made from {made_from}, sha256 {hashlib.sha256(page.encode()).hexdigest()} -->\n"


def is_made_from(path: Path, made_from: str) -> bool:
    """Return whether a file is a whole page that was made from the same (``origin``)."""
    text = _bytes_of(path).decode(errors="replace")
    page = text[: text.rfind("<!-- made from ")]
    return text == with_origin(page, made_from)


def _bytes_of(file: Path) -> bytes:
    """Return the content of a regular file; nothing if there is none, or if it cannot be read."""
    with suppress(OSError):
        if file.is_file() and file.stat().st_size <= MOST_BYTES:
            return file.read_bytes()
    return b""
