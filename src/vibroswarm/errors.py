"""Errors that users see, checks of arguments that raise them, and warnings that are given once.

``InputError`` is the user's to fix (exit code 2); ``RunError`` is a failure of the machine or of the program
(exit code 1). Both are printed as one message, never as a traceback. Warnings go through ``logging``, which shows
them on stderr.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any


class InputError(ValueError):
    """The request cannot be met; the message names the field, the value, and what would be right.

    Args:
        message: what is wrong with the value, and what would be right.
        field: the field, option or file that is wrong, as the user would write it.
    Attributes:
        reason: the message without the field.
    """

    def __init__(self, message: str, *, field: str | None = None) -> None:
        self.field, self.reason = field, message
        super().__init__(f"{field}: {message}" if field else message)


@contextmanager
def in_file(path: Path) -> Iterator[None]:
    """Add to an ``InputError`` about a value the file that has it, unless the message names the file."""
    try:
        yield
    except InputError as error:
        if str(path) in str(error):
            raise
        raise InputError(f"{error.reason} (in {path})", field=error.field) from None


@contextmanager
def named(field: str, of: str | None = None) -> Iterator[None]:
    """Name the field in an ``InputError`` about a value that was given in it under another name."""
    try:
        yield
    except InputError as error:
        if of is not None and error.field != of:
            raise
        raise InputError(error.reason, field=field) from None


class RunError(RuntimeError):
    """Something failed during the work: a full disk, a folder that cannot be written."""


class CodeError(RunError):
    """A user's strategy, network, task or motion source failed while it ran, and would fail again."""


def nearest(word: object, known: Iterable[str], *, prefix: str = "", cutoff: float = 0.6) -> str:
    """Return ``", did you mean 'x'?"`` for the known word most similar to ``word``, or "" if none is similar."""
    text = word if isinstance(word, str) else shown(word)
    # Cut, because comparing a very long text would take long.
    match = difflib.get_close_matches(text[:100], list(known), n=1, cutoff=cutoff)
    return f", did you mean '{prefix}{match[0]}'?" if match else ""


def shown(value: object) -> str:
    """Return the ``repr`` of a value for a message, cut to at most 60 characters."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def whole_number_of(value: object, field: str, low: int, high: int) -> int:
    """Return a Python or NumPy integer as a Python integer, if it is from ``low`` to ``high``, inclusive."""
    number = plain_value(value)
    if type(number) is not int or not low <= number <= high:
        raise InputError(f"{shown(value)} is wrong; give a whole number from {low} to {high}", field=field)
    return number


def plain_value(value: Any) -> Any:
    """Return a number or an array of NumPy as a number or lists of Python, also within tables, lists and tuples."""
    if isinstance(value, Mapping):
        return {key: plain_value(part) for key, part in value.items()}
    if type(value) in (list, tuple):
        return type(value)(map(plain_value, value))
    return value.tolist() if hasattr(value, "dtype") and hasattr(value, "tolist") else value


def keep_plain(settings: object) -> None:
    """Replace NumPy's numbers in the fields of a frozen dataclass by Python's, which are written and hashed alike."""
    for name, value in vars(settings).items():
        object.__setattr__(settings, name, plain_value(value))


def number_of(value: object, field: str, low: float = 0.0, high: float = 1e300) -> float:
    """Return a number of Python or NumPy as an ``int`` or ``float``, if it is from ``low`` to ``high``, inclusive."""
    number = plain_value(value)
    if isinstance(number, bool) or not isinstance(number, int | float) or not low <= number <= high:
        raise InputError(f"{shown(value)} is wrong; give a number from {low:g} to {high:g}", field=field)
    return number


def share_from(text: object, field: str) -> float:
    """Parse a percentage: ``"2%"`` is 0.02."""
    words = str(text).strip()
    try:  # as an exponent, so that 21.9 % is the float 0.219
        share = float(words.removesuffix("%").strip() + "e-2")
    except ValueError:
        share = 0.0
    if not words.endswith("%") or not 0 < share < 1:
        raise InputError(f"{shown(text)} is not a percentage between 0% and 100%, such as 2%", field=field)
    return share


def check_choice(value: object, field: str, choices: Iterable[str]) -> None:
    """Refuse a value that is not among the choices."""
    known = list(choices)
    if not isinstance(value, str) or value not in known:
        raise InputError(
            f"there is no {shown(value)}{nearest(value, known)} (choices: {', '.join(known)})", field=field
        )


def check_known_keys(keys: Iterable[object], field: str, known: Iterable[str]) -> None:
    """Refuse a table with a key that is not known; raises the error of ``check_choice``."""
    for key in keys:
        check_choice(key, field, known)


def check_kind(value: object, kind: type | tuple[type, ...], field: str, words: str) -> None:
    """Refuse a value that is not an instance of ``kind``."""
    if not isinstance(value, kind):
        raise InputError(f"{shown(value)} is not {words}", field=field)


@cache
def warn_once(message: str) -> None:
    """Log a warning the first time that it is given; in worker processes do nothing, as the main process warns."""
    import logging  # both here, since most commands warn of nothing
    import multiprocessing

    if multiprocessing.parent_process() is None:
        logging.getLogger("vibroswarm").warning("vibroswarm: %s", message)
