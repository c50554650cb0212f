"""What the package's source files import and name, each text parsed once in a process."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import vibroswarm

ROOT = Path(vibroswarm.__file__).parent


class Source(NamedTuple):
    """What a source file refers to, wherever in it."""

    imports: tuple[tuple[str, frozenset[str]], ...]
    """Modules of its ``from ... import`` statements, each with the names."""
    attributes: frozenset[str]
    """Names after a dot."""


def source_of(path: Path) -> Source:
    """Return what a source file refers to."""
    return _source(path.read_text(encoding="utf-8"))


@cache
def _source(text: str) -> Source:
    nodes = list(ast.walk(ast.parse(text)))
    return Source(
        tuple(
            (node.module, frozenset(alias.name for alias in node.names))
            for node in nodes
            if isinstance(node, ast.ImportFrom) and node.module is not None
        ),
        frozenset(node.attr for node in nodes if isinstance(node, ast.Attribute)),
    )


def imported(path: Path, wanted: dict[str, set[str]]) -> set[str]:
    """Names of ``wanted`` that a module imports, wherever in it."""
    if not spells_any(path, set().union(*wanted.values())):
        return set()
    found = (names & wanted[module] for module, names in source_of(path).imports if module in wanted)
    return set().union(*found)


def called(path: Path, wanted: set[str]) -> bool:
    """Whether a module names an attribute of ``wanted``."""
    return spells_any(path, wanted) and not wanted.isdisjoint(source_of(path).attributes)


def spells_any(path: Path, words: set[str]) -> bool:
    """Whether any of these words stands in a file, be it in a comment: what does not spell a name cannot use it."""
    text = path.read_text(encoding="utf-8")
    return any(word in text for word in words)


def modules() -> Iterator[tuple[str, Path]]:
    """Yield name and path of each module of the package."""
    for path in sorted(ROOT.rglob("*.py")):
        yield path.relative_to(ROOT).as_posix(), path
