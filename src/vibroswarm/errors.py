"""Errors that users see, checks of arguments that raise them, and warnings that are given once.

``InputError`` is the user's to fix (exit code 2); ``RunError`` is a failure of the machine or of the program
(exit code 1). Both are printed as one message, never as a traceback. Warnings go through ``logging``, which shows
them on stderr.
"""

from __future__ import annotations

import difflib
import math
import operator
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
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
        super().__init__(f"{shown_name(field)}: {message}" if field else message)


def shown_name(name: object) -> str:
    """Return a name for a message; of more than 300 characters, only the first 200 and their number."""
    text = str(name)
    return text if len(text) <= 300 else f"{text[:200]}... ({len(text)} characters)"


@contextmanager
def in_file(path: Path) -> Iterator[None]:
    """Add to an ``InputError`` about a value the file that has it, unless the message names the file."""
    try:
        yield
    except InputError as error:
        if str(path) in str(error):
            raise
        raise InputError(f"{error.reason} (in {shown_name(path)})", field=error.field) from None


@contextmanager
def named(field: str, of: str | None = None) -> Iterator[None]:
    """Name the field in an ``InputError`` about a value that was given in it under another name.

    Args:
        of: the other name; errors about other fields are left as they are. None: all errors get the name.
    """
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
    """Return ``", did you mean 'x'?"`` for the known word most similar to ``word``, or "" if none is similar.

    Args:
        prefix: written before the known word. cutoff: least similarity, from 0 to 1.
    """
    text = word if isinstance(word, str) else shown(word)
    # Cut, because comparing a very long text would take long.
    match = difflib.get_close_matches(text[:100], list(known), n=1, cutoff=cutoff)
    return f", did you mean '{prefix}{match[0]}'?" if match else ""


def check_format(version: object, newest: int, field: str | None = None) -> None:
    """Refuse a file or folder whose format is not the one that this version of vibroswarm reads.

    Args:
        version: the format number found in the file, of any type. newest: number of the format that this version reads
            and writes, the only one.
        field: the file or folder, for the message.
    Raises:
        InputError: the format is older or newer. A ``version`` that is not an integer counts as newer.
    """
    if not isinstance(version, int) or version > newest:
        raise InputError(
            f"is of format {version!r}; this version reads format {newest}: update vibroswarm", field=field
        )
    if version < newest:
        raise InputError(
            f"is of an older format ({version}), which this version does not read; recreate it", field=field
        )


def shown(value: object) -> str:
    """Return the ``repr`` of a value for a message, cut to at most 60 characters."""
    try:
        text = repr(value)
    except ValueError:  # an integer with more digits than Python converts to text
        return "a number of thousands of digits"
    return text if len(text) <= 60 else f"{text[:57]}..."


def whole_number_of(value: object, field: str, low: int, high: int) -> int:
    """Return a Python or NumPy integer as a Python integer, if it is in the range from ``low`` to ``high``, inclusive.

    Args:
        field: name of the argument, for the message.
    Raises:
        InputError: the value is of another type (a boolean is refused too), or out of range.
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
    """Return a number of Python or NumPy as an ``int`` or ``float``, if it is from ``low`` to ``high``, inclusive.

    Args:
        field: name of the argument, for the message. high: its default is below infinity, so that infinity is refused.
    Raises:
        InputError: the value is of another type (a boolean is refused too), NaN, or out of range.
    """
    number = plain_value(value)
    if isinstance(number, bool) or not isinstance(number, int | float) or not low <= number <= high:
        raise InputError(f"{shown(value)} is wrong; give a number from {low:g} to {high:g}", field=field)
    return number


def share_from(text: object, field: str) -> float:
    """Parse a percentage: ``"2%"`` is 0.02.

    Args:
        field: name of the field or option, for the message.
    Raises:
        InputError: it is no number with a percent sign, or not between 0 % and 100 %.
    """
    from decimal import (  # only here: a command that reads no percentage starts faster
        Decimal,
        InvalidOperation,
    )

    share = math.nan
    if isinstance(text, str) and text.strip().endswith("%"):
        with suppress(InvalidOperation):  # divided as a decimal, so that 21.9 % is the float 0.219
            share = float(Decimal(text.strip()[:-1]) / 100)
    if not 0 < share < 1:
        raise InputError(
            f"{shown(text)} is not a percentage above 0% and below 100%; give one such as 2%", field=field
        )
    return share


def check_choice(value: object, field: str, choices: Iterable[str]) -> None:
    """Refuse a value that is not among the choices.

    Raises:
        InputError: the message lists the choices and suggests the one with the most similar spelling.
    """
    known = list(choices)
    if not isinstance(value, str) or value not in known:
        raise InputError(
            f"there is no {shown(value)}{nearest(value, known)} (choices: {', '.join(known)})", field=field
        )


def check_known_keys(keys: Iterable[object], field: str, known: Iterable[object]) -> None:
    """Refuse a table with a key that is not known.

    Raises:
        InputError: the message names the first such key and suggests the one with the most similar spelling.
    """
    there = list(map(str, known))
    unknown = [str(key) for key in keys if key not in there]
    if unknown:
        raise InputError(f"unknown key '{unknown[0]}'{nearest(unknown[0], there)}", field=field)


def check_kind(value: object, kind: type | tuple[type, ...], field: str, words: str) -> None:
    """Refuse a value that is not an instance of ``kind``.

    Args:
        kind: one type or several, as for ``isinstance``. field: the argument's name, for the message.
        words: what the value should be, for the message: "a Result, as simulate() returns".
    Raises:
        InputError: the value is of another type.
    """
    if not isinstance(value, kind):
        raise InputError(f"{shown(value)} is not {words}", field=field)


def check_flags(**flags: object) -> None:
    """Refuse arguments, by name, that are neither True nor False; those of NumPy are accepted.

    Raises:
        InputError: a value is something else, such as "no", which Python would take for true.
    """
    for name, value in flags.items():
        if type(value).__name__ not in ("bool", "bool_"):
            raise InputError(f"{shown(value)} is wrong; give True or False", field=name)


def check_callable(value: object, field: str) -> None:
    """Refuse a value that is neither callable nor None.

    Raises:
        InputError: the value is something else.
    """
    if value is not None and not callable(value):
        raise InputError(f"{shown(value)} is not a function", field=field)


def path_of(value: object, field: str = "path") -> Path:
    """Return a path, given as text or as an object that has one, as a ``Path``.

    Raises:
        InputError: the value is of another type.
    """
    check_kind(value, (str, os.PathLike), field, "a path")
    return Path(value)  # type: ignore[arg-type]


def check_keywords(given: Iterable[str], function: str, known: Iterable[str]) -> None:
    """Refuse keyword arguments that a function does not have.

    Args:
        given: names of the arguments in the call. function: its name, for the message. known: names that it accepts.
    Raises:
        InputError: the message names the argument and suggests the known name with the most similar spelling.
    """
    choices = list(known)
    for name in given:
        if name not in choices:
            raise InputError(f"{function}() has no such argument{nearest(name, choices)}", field=name)


def in_words(number: int) -> str:
    """Return a number as text, for messages: large numbers of the form 2^n - 1 as such, others in digits."""
    power = (number + 1).bit_length() - 1
    return f"2^{power} - 1" if number > 10**9 and number == 2**power - 1 else str(number)


_warned: dict[str, object] = {}
"""Warnings given so far, each with a mark of the call that gave it: of calls in several threads, one is the first."""


def warn_once(message: str) -> None:
    """Log a warning the first time that it is given; in worker processes do nothing, as the main process warns."""
    mark = object()
    if _warned.setdefault(message, mark) is not mark:
        return
    import logging  # both here, since most commands warn of nothing
    import multiprocessing

    if multiprocessing.parent_process() is None:
        logging.getLogger("vibroswarm").warning("vibroswarm: %s", message)
