"""Convert docstrings, plain text with Markdown tables, to reStructuredText for Sphinx."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

CODE = re.compile(r"(``.*?``)")
BOLD = re.compile(r"(\*\*[^*]+\*\*)")
MARKUP = re.compile(r"(?<!\\)([*|`]|_(?!\w))")
BULLET = re.compile(r"\s*[*-] ")
ENTRY = re.compile(r"(?<=[.;]) (\w+(?:, \w+)*): ")
ERRORS = {"InputError", "RunError"}


def process(app: Any, kind: str, name: str, what: Any, options: Any, lines: list[str]) -> None:
    """Autodoc hook: convert the lines of one docstring in place."""
    lines[:] = list(converted(list(one_entry_a_line(lines, names_of(what)))))
    if kind in ("attribute", "data", "property"):
        lines[:0] = ["..", ""]  # an empty comment; otherwise words before a colon would be parsed as a type


def names_of(what: Any) -> set[str]:
    """Names that may begin an entry of a section: parameters and errors."""
    try:
        return ERRORS | set(inspect.signature(what).parameters)
    except (TypeError, ValueError):
        return ERRORS


def one_entry_a_line(lines: list[str], names: set[str]) -> Iterator[str]:
    """Split several entries on one line (``seed: of all. runs: how many.``) into lines."""
    for line in lines:
        begun = re.match(r"( +)(\w+(?:, \w+)*): ", line)
        if begun is None:
            yield line
            continue
        rest, depth = line, begun[1]
        for found in ENTRY.finditer(line):
            if set(found[1].split(", ")) <= names:
                before, rest = rest.split(found[0], 1)
                yield before
                rest = f"{depth}{found[1]}: {rest}"
        yield rest


def converted(lines: list[str]) -> Iterator[str]:
    """Convert tables and code blocks, and escape everything else that looks like markup."""
    k = 0
    depth = 0  # indentation of the previous paragraph
    while k < len(lines):
        line = lines[k]
        if line.lstrip().startswith("| "):
            end = next((i for i in range(k, len(lines)) if not lines[i].lstrip().startswith("|")), len(lines))
            yield from table(lines[k:end])
            k = end
        elif k and not lines[k - 1].strip() and indent(line) > depth:
            end = next(
                (i for i in range(k, len(lines)) if lines[i].strip() and indent(lines[i]) <= depth),
                len(lines),
            )
            yield from (" " * depth + "::", "", *lines[k:end], "")
            k = end
        else:
            if line.strip():
                if indent(line) < depth:
                    yield ""
                depth = indent(line)
            yield plain(line)
            k += 1


def indent(line: str) -> int:
    """Indentation of a line; 0 for an empty line."""
    return len(line) - len(line.lstrip())


def table(lines: list[str]) -> Iterator[str]:
    """Convert a Markdown table to a list-table."""
    rows = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in lines]
    yield from ("", ".. list-table::", "   :header-rows: 1", "")
    for row in [rows[0], *rows[2:]]:
        for k, cell in enumerate(row):
            yield f"   {'* -' if k == 0 else '  -'} {plain(cell)}"
    yield ""


def plain(line: str) -> str:
    """Escape stars, bars, underscores and single backticks in a line."""
    if line in ("-", "*", "+"):
        return "\\" + line  # alone it would start a list
    bullet = BULLET.match(line)
    if bullet:
        return bullet.group() + plain(line[bullet.end() :])
    parts = []
    for part in CODE.split(line):
        pieces = [part] if CODE.fullmatch(part) else BOLD.split(part)
        for piece in pieces:
            marked = CODE.fullmatch(piece) or BOLD.fullmatch(piece)
            parts.append(piece if marked else MARKUP.sub(r"\\\1", piece))
    return "".join(parts)
