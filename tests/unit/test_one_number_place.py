"""How numbers look is decided in ``core/numbers.py`` alone: no other text that people read formats one."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[2] / "src" / "vibroswarm"
ALLOWED = {
    "core/numbers.py": "the one place",
    "cli/terminal.py": "[  0.12 s] in front of what --verbose reports",
    "floors/source.py": "names of floors in scenarios, such as random:0.48",
    "inspection/missed.py": "address of random numbers",
    "recordings/export.py": "logs, as the robots and the simulator write them",
    "show/page.py": "lengths and places in HTML",
    "study/precision.py": "an entry of a study's file, which is read again",
    "tracking/markers.py": "a file of markers in TOML",
    "view/picture.py": "MJCF",
}
"""Files with numbers for programs, and what these are."""

MAY_BE = re.compile(
    r":[^{}\n]*(?:\{[^{}\n]*\}[^{}\n]*)*[fgGe%,]\}"  # the end of a format, which may have a number in braces
    r"""|['"]e?s['"]\)*\s*\*"""  # a plural
)
"""What a program with such lines has in its text: to parse all others would take most of the time."""


def formatted(program: str) -> Iterator[int]:
    """Lines with a number that is formatted by hand, or a plural, but for those of errors, which quote the input."""
    if MAY_BE.search(program) is None:
        return
    tree = ast.parse(program)
    of_errors = {
        id(part) for node in ast.walk(tree) if isinstance(node, ast.Raise) for part in ast.walk(node)
    }
    for node in ast.walk(tree):
        if id(node) in of_errors:
            continue
        spec = node.format_spec if isinstance(node, ast.FormattedValue) else None
        if isinstance(spec, ast.JoinedStr) and any(
            isinstance(part, ast.Constant) and str(part.value)[-1:] in tuple("fgGe%,") for part in spec.values
        ):
            yield node.lineno
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
            plural = isinstance(node.left, ast.Constant) and node.left.value in ("s", "es")
            if plural and isinstance(node.right, ast.Compare):
                yield node.lineno


def test_numbers_are_written_in_one_place() -> None:
    found = {
        str(path.relative_to(PACKAGE)): lines
        for path in sorted(PACKAGE.rglob("*.py"))
        if (lines := list(formatted(path.read_text(encoding="utf-8"))))
    }
    assert {place: lines for place, lines in found.items() if place not in ALLOWED} == {}
    assert set(ALLOWED) <= set(found), "no exception is left over"


def test_one_that_is_formatted_by_hand_is_seen() -> None:
    """Negative control."""
    by_hand = "words = f\"{share:.1%} of {n:,} run{'s' * (n != 1)}\"\n"
    assert len(list(formatted(by_hand))) == 3
    assert not list(formatted('raise InputError(f"{speed:g} is not from 1 to 200")\n'))
