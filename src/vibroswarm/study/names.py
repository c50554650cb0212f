"""What cells are called: all that tells a cell from the others of its study, and no more digits than that takes."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Final

from vibroswarm.code_files import is_code, name_in
from vibroswarm.study.varied import LABEL, PRESET, Point

PLAIN: Final = ("floor.source", "strategy.name", "network.name", PRESET, LABEL)
"""Fields whose values say what they are."""
DIGITS: Final = 6
MOST_DIGITS: Final = 17
"""With so many, numbers that differ are written differently."""
LONGEST: Final = 60


def told(words: Mapping[str, str]) -> str:
    """Values in words, by field: ``random:0.44, soft, eta 1250``."""
    return ", ".join(v if k in PLAIN else f"{k.rpartition('.')[2]} {v}" for k, v in words.items())


def in_digits(value: Any, digits: int = DIGITS) -> str:
    """One value as it is told; a long one by its length and a hash."""
    if is_code(value):
        return name_in(value)
    text = f"{value:.{digits}g}" if isinstance(value, float) else str(value)
    if len(text) <= LONGEST:
        return text
    count = f"{len(value)} " if isinstance(value, str | list | tuple | dict) else ""
    return f"{count}values {hashlib.sha256(text.encode('utf-8', 'replace')).hexdigest()[:6]}"


def words_of_points(points: Sequence[Point]) -> list[dict[str, str]]:
    """Each varied value of each point in words: different values of a field in different words."""
    texts: dict[str, dict[str, str]] = {}
    for name in dict.fromkeys(name for point in points for name in point):
        values = {repr(point[name]): point[name] for point in points if name in point}
        for digits in range(DIGITS, MOST_DIGITS + 1):
            texts[name] = {key: in_digits(value, digits) for key, value in values.items()}
            numbers = {key for key, value in values.items() if isinstance(value, float)}
            if len({texts[name][key] for key in numbers}) == len(numbers):
                break
    return [{name: texts[name][repr(value)] for name, value in point.items()} for point in points]


def names_of(words: Sequence[Mapping[str, str]], strategies: Sequence[str]) -> list[str]:
    """The names of cells: a label alone where no other cell has it, else with what is varied beside it.

    Cells that are equal in all that is varied (a point that stands twice) are told apart by their numbers.

    Args:
        words: of each cell (``words_of_points``). strategies: of each cell's scenario.
    """
    labels = Counter(point.get(LABEL) for point in words)
    names = []
    for point, strategy in zip(words, strategies, strict=True):
        label = point.get(LABEL)
        if label is None:
            names.append(told(point) or strategy)
            continue
        rest = told({k: v for k, v in point.items() if k != LABEL and _differs(words, label, k)})
        names.append(f"{label} ({rest})" if labels[label] > 1 and rest else label)
    count = Counter(names)
    return [f"{name} (cell {k})" if count[name] > 1 else name for k, name in enumerate(names)]


def _differs(words: Sequence[Mapping[str, str]], label: str, name: str) -> bool:
    """Whether a field is not the same in all cells of a label."""
    return len({point.get(name) for point in words if point.get(LABEL) == label}) > 1
