"""The two ways in which a user's wish can fail.

``InputError`` is the user's to mend (exit code 2); ``RunError`` is a failure of the machine or of the
program while it worked (exit code 1). Both are printed as one message, never as a traceback.
"""

from __future__ import annotations

import difflib
import operator
from collections.abc import Iterable


class InputError(ValueError):
    """What was asked for cannot be done; the message names the field, the value, and what would be right.

    Args:
        message: what is wrong with the value, and what would be right.
        field: the field, option or file that is wrong, as the user would write it.
    """

    def __init__(self, message: str, *, field: str | None = None) -> None:
        self.field = field
        super().__init__(f"{field}: {message}" if field else message)


class RunError(RuntimeError):
    """Something failed while the work was being done: a full disk, a folder that cannot be written."""


class CodeError(RunError):
    """A strategy or network of the user's failed while it ran: the same run would fail again."""


def nearest(word: object, known: Iterable[str]) -> str:
    """``", did you mean 'x'?"`` for the known word nearest to ``word``, or an empty string."""
    match = difflib.get_close_matches(str(word)[:100], list(known), n=1, cutoff=0.6)
    return f", did you mean '{match[0]}'?" if match else ""


def older(version: object) -> str:
    """What is said of a file whose format is older than what is read."""
    return f"is of an older format ({version}), which this version does not read; make it anew"


def shown(value: object) -> str:
    """A value as it stands in a message: on one line, and not long."""
    try:
        text = repr(value)
    except ValueError:  # a whole number of more digits than Python turns into text
        return "a number of thousands of digits"
    return text if len(text) <= 60 else f"{text[:57]}..."


def whole_number_of(value: object, field: str, low: int, high: int) -> int:
    """A whole number of Python or NumPy in a range, as one of Python.

    Raises:
        InputError: of another type (true and false are no numbers), or outside of ``low`` to ``high``.
    """
    try:
        found = None if isinstance(value, bool) else operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        found = None
    if found is None or not low <= found <= high:
        raise InputError(
            f"{shown(value)} is wrong; give a whole number from {low} to {in_words(high)}", field=field
        )
    return found


def in_words(number: int) -> str:
    """A power of two less one as such: 2^63 - 1."""
    power = (number + 1).bit_length() - 1
    return f"2^{power} - 1" if number > 10**9 and number == 2**power - 1 else str(number)
