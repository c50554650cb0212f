"""Errors that users see, and warnings that are given once.

``InputError`` is the user's to fix (exit code 2); ``RunError`` is a failure of the machine or of the program
(exit code 1). Both are printed as one message, never as a traceback. Warnings go through ``logging``, which shows
them on stderr.
"""

from __future__ import annotations

import difflib
import logging
import multiprocessing
import operator
from collections.abc import Iterable
from functools import cache
from pathlib import Path


class InputError(ValueError):
    """The request cannot be met; the message names the field, the value, and what would be right.

    Args:
        message: what is wrong with the value, and what would be right.
        field: the field, option or file that is wrong, as the user would write it.
    """

    def __init__(self, message: str, *, field: str | None = None) -> None:
        self.field = field
        super().__init__(f"{field}: {message}" if field else message)


class RunError(RuntimeError):
    """Something failed during the work: a full disk, a folder that cannot be written."""


class CodeError(RunError):
    """A user's strategy, network, task or motion source failed while it ran, and would fail again."""


def nearest(word: object, known: Iterable[str]) -> str:
    """Return ``", did you mean 'x'?"`` for the known word nearest to ``word``, or an empty string."""
    match = difflib.get_close_matches(str(word)[:100], list(known), n=1, cutoff=0.6)
    return f", did you mean '{match[0]}'?" if match else ""


def check_format(version: object, newest: int, field: str | None = None) -> None:
    """Refuse a file or folder whose format is not the one that this version writes.

    Raises:
        InputError: the format is older or newer.
    """
    if not isinstance(version, int) or version > newest:
        raise InputError(
            f"is of format {version!r}; this version reads up to {newest}: update vibroswarm", field=field
        )
    if version < newest:
        raise InputError(
            f"is of an older format ({version}), which this version does not read; recreate it", field=field
        )


def shown(value: object) -> str:
    """Return a value as shown in messages: on one line, and short."""
    try:
        text = repr(value)
    except ValueError:  # an integer with more digits than Python converts to text
        return "a number of thousands of digits"
    return text if len(text) <= 60 else f"{text[:57]}..."


def whole_number_of(value: object, field: str, low: int, high: int) -> int:
    """Convert a Python or NumPy integer in a range to a Python one.

    Raises:
        InputError: another type (booleans are not numbers), or outside ``low`` to ``high``.
    """
    try:
        number = None if isinstance(value, bool) else operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = None
    if number is None or not low <= number <= high:
        raise InputError(
            f"{shown(value)} is wrong; give a whole number from {low} to {in_words(high)}", field=field
        )
    return number


def number_of(value: object, field: str, low: float = 0.0, high: float = 1e300) -> float:
    """Return a number from ``low`` to ``high`` as it is.

    Raises:
        InputError: the value is of another type (true and false are no numbers), not finite, or out of range.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise InputError(f"{shown(value)} is wrong; give a number from {low:g} to {high:g}", field=field)
    return value


def check_choice(value: object, field: str, choices: Iterable[str]) -> None:
    """Refuse a value that is not among the choices.

    Raises:
        InputError: it lists the choices and suggests the nearest.
    """
    known = list(choices)
    if value not in known:
        raise InputError(
            f"there is no {shown(value)}{nearest(value, known)} (choices: {', '.join(known)})", field=field
        )


def check_kind(value: object, kind: type | tuple[type, ...], field: str, words: str) -> None:
    """Refuse a value of another type.

    Args:
        kind: as of ``isinstance``. field: its name. words: what the value is not: "a Result, as simulate returns".
    Raises:
        InputError: it is of another type.
    """
    if not isinstance(value, kind):
        raise InputError(f"{shown(value)} is not {words}", field=field)


def check_callable(value: object, field: str) -> None:
    """Refuse a value that is neither a function nor None.

    Raises:
        InputError: it is something else.
    """
    if value is not None and not callable(value):
        raise InputError(f"{shown(value)} is not a function", field=field)


def path_of(value: object, field: str = "path") -> Path:
    """Return a path that is given as text or as a path.

    Raises:
        InputError: it is something else.
    """
    check_kind(value, (str, Path), field, "a path")
    return Path(value)  # type: ignore[arg-type]


def check_keywords(given: Iterable[str], function: str, known: Iterable[str]) -> None:
    """Refuse keyword arguments that a function does not have.

    Raises:
        InputError: it suggests the nearest.
    """
    for name in given:
        if name not in (choices := list(known)):
            raise InputError(f"{function}() has no such argument{nearest(name, choices)}", field=name)


def in_words(number: int) -> str:
    """Write 2^63 - 1 and the like as powers of two; other numbers as they are."""
    power = (number + 1).bit_length() - 1
    return f"2^{power} - 1" if number > 10**9 and number == 2**power - 1 else str(number)


@cache
def warn_once(message: str) -> None:
    """Log a warning once; worker processes stay silent."""
    if multiprocessing.parent_process() is None:
        logging.getLogger("vibroswarm").warning("vibroswarm: %s", message)
