"""Untrusted files, opened as data: regular files of a bounded size, and nothing else.

A pipe or a device may never end, so it is refused before it is opened. Sizes are checked before memory is
allocated.
"""

from __future__ import annotations

import json
import os
import re
import stat
import tomllib
from pathlib import Path
from typing import Any, Final, NoReturn, TypeVar

from vibroswarm.core.numbers import stated
from vibroswarm.errors import InputError, shown

T = TypeVar("T")

_KINDS: Final = {int: "a whole number", str: "a text", list: "a list", dict: "a table of names", bool: "true or false",
                 float: "a number"}  # fmt: skip
"""The types of JSON values in words, for errors."""

MAX_NUMBER: Final = 1e300
"""Numbers of a larger size are refused."""

MAX_TEXT: Final = 64 * 2**20
"""Size limit of a TOML or JSON file, bytes."""


def check_plain(path: Path, most: int, what: str) -> int:
    """Check that a file is a regular file of a limited size; return its size, bytes.

    Args:
        most: size limit, bytes. what: the kind of file expected, for errors: "a scenario".
    Raises:
        InputError: the file is missing, out of reach, not a regular file, or too large. Whether it can be opened is not
            checked.
    """
    name = _named(path)
    try:
        status = path.stat()
    except FileNotFoundError:
        raise InputError("cannot be read: there is no such file", field=name) from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise InputError(f"cannot be read: {_why(error)}", field=name) from None
    if stat.S_ISDIR(status.st_mode):
        raise InputError("is a folder; give the name of a file", field=name)
    if not stat.S_ISREG(status.st_mode):
        raise InputError("is not a regular file; give the name of a file", field=name)
    if status.st_size > most:
        raise InputError(f"is larger than {sized(most)}; that is not {what}", field=name)
    return status.st_size


def read_bytes(path: Path, most: int, what: str) -> bytes:
    """Read a regular file of at most ``most`` bytes; arguments and errors are those of ``check_plain``."""
    check_plain(path, most, what)
    try:
        # The file may have been replaced by a pipe since the check. With O_NONBLOCK, opening it does not wait forever.
        with os.fdopen(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)), "rb") as stream:
            # One byte more shows that the file has grown beyond the limit; None: a device of the system has no data.
            data = stream.read(most + 1) or b""
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {_why(error)}", field=_named(path)) from None
    if len(data) > most:
        raise InputError(f"is larger than {sized(most)}; that is not {what}", field=_named(path))
    return data


def read_text(path: Path, what: str, most: int = MAX_TEXT, *, filled: bool = False) -> str:
    """Read a regular file of at most ``most`` bytes as UTF-8 text; ``what`` names the kind of file, for errors.

    Args:
        filled: whether to refuse a file without text: of a file that was cut off when it was written, all values would
            be defaults.
    Raises:
        InputError: the file does not pass ``check_plain``, is not UTF-8 text, or has none.
    """
    try:
        text = read_bytes(path, most, what).decode("utf-8-sig")  # some editors write a byte order mark
    except UnicodeDecodeError:
        raise InputError(f"is not text in UTF-8; {what} is", field=_named(path)) from None
    if filled and not text.strip():
        raise InputError(f"is empty; {what} has at least one field or comment", field=_named(path))
    return text


def read_json(path: Path, what: str) -> Any:
    """Read a JSON file and return its value; ``what`` names the kind of file, for errors.

    Raises:
        InputError: ``read_text`` or ``parsed_json`` refuses the file.
    """
    return parsed_json(read_text(path, what), _named(path))


def parsed_json(text: str | bytes, name: str) -> Any:
    """Parse a JSON text and return its value; ``name`` is the name of its file, for errors.

    Raises:
        InputError: the text is not JSON, or holds ``NaN`` or ``Infinity``. A number too large for a float, such as
            1e999, is not refused: it becomes infinite.
    """
    try:
        return json.loads(text, parse_constant=_no_number)  # Python would accept NaN and Infinity
    except (ValueError, RecursionError) as error:
        # The text is not JSON, is nested too deeply, or holds a number of thousands of digits.
        where = f" in line {error.lineno}" if isinstance(error, json.JSONDecodeError) else ""
        raise InputError(f"is damaged: not JSON{where}", field=name) from None


def parsed_toml(text: str, name: str) -> dict[str, Any]:
    """Parse a TOML text and return its table; ``name`` is the name of its file, for errors.

    Raises:
        InputError: the text is not TOML, or a key has more than ``MOST_PARTS`` parts.
    """
    check_keys(text, name)
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise InputError("is not TOML: its lists or tables are nested too deeply", field=name) from None
    except ValueError as error:  # the text is not TOML, or holds a number of thousands of digits
        hint = "; if the value is text, write it in quotes" if str(error).startswith("Invalid value") else ""
        raise InputError(f"is not TOML: {error}{hint}", field=name) from None


def check_keys(text: str, name: str) -> None:
    """Refuse a TOML text with a key of very many parts, ``a.b.c``, for which Python's parser takes minutes.

    Args:
        text: TOML; it may be wrong in any way. name: of its file, for errors.
    Raises:
        InputError: a key has more than ``MOST_PARTS`` parts.
    """
    for number, line in enumerate(text.split("\n"), start=1):
        if line.count(".") <= MOST_PARTS:
            continue
        # Points of numbers have no quotes beside them, and separators between them.
        quoted = len(_BESIDE_QUOTES.findall(line))
        if quoted > MOST_PARTS or any(part.count(".") > MOST_PARTS for part in _BETWEEN.split(line)):
            raise InputError(f"line {number} has a key of more than {MOST_PARTS} parts", field=name)


MOST_PARTS: Final = 200
"""Largest number of parts of a key in TOML, as in ``a.b.c``."""
_BESIDE_QUOTES: Final = re.compile(r"""["'][ \t]*\.|\.[ \t]*["']""")
"""A point between parts of a key of which one is in quotes."""
_BETWEEN: Final = re.compile(r"""[,=\[\]{}#"']""")
"""What separates keys without quotes from each other and from values."""


def entry(about: Any, key: str, kind: type[T], path: Path | str) -> T:
    """Return the value under a key of a JSON object, after checking its type.

    Args:
        about: the JSON value that should be the object. kind: type that the value must have, one of ``_KINDS``; for
            numbers that may be integers or floats, see ``number``. path: name of the file, for errors.
    Raises:
        InputError: ``about`` is not an object or lacks the key, or the value has another type. A boolean is no number.
    """
    if not isinstance(about, dict):
        raise InputError("is damaged: not a JSON object", field=str(path))
    if key not in about:
        raise InputError(f"is damaged: '{key}' is missing", field=str(path))
    value = about[key]
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise InputError(f"is damaged: '{key}' is {shown(value)}, expected {_KINDS[kind]}", field=str(path))
    return value


def number(about: Any, key: str, path: Path | str) -> float:
    """Return the number, an integer or a float of at most MAX_NUMBER in size, under a key of a JSON object.

    Raises:
        InputError: ``about`` is not an object, lacks the key, or its value is no such number.
    """
    value = about.get(key) if isinstance(about, dict) else None
    # ``not ... <=`` refuses NaN too, with which every comparison is false.
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= MAX_NUMBER:
        raise InputError(f"is damaged: '{key}' is {shown(value)}, expected a number", field=str(path))
    return value


def words(values: list[Any], key: str, path: Path | str) -> list[str]:
    """Return a list of a JSON file after checking that it holds only texts; ``key`` names the list, ``path`` the file.

    Raises:
        InputError: one of the values is not a text.
    """
    for value in values:
        if not isinstance(value, str):
            raise InputError(f"is damaged: '{key}' holds {shown(value)}, which is not text", field=str(path))
    return values


def texts(values: dict[str, Any], key: str, path: Path | str) -> dict[str, str]:
    """Return a table of a JSON file after checking that its values are texts; ``key`` names the table."""
    words(list(values.values()), key, path)
    return values


def sized(count: int) -> str:
    """Return a number of bytes in the largest fitting unit: "64 MiB", "1.5 GiB", "300 bytes"."""
    for unit, size in (("GiB", 2**30), ("MiB", 2**20)):
        if count >= size:
            return f"{stated(count / size)} {unit}"
    return f"{count} bytes"


def _no_number(text: str) -> NoReturn:
    raise ValueError(f"{text} is not a JSON number")


def _named(path: Path) -> str:
    """Return a path as text for an error; escaped if it holds characters that cannot be printed."""
    name = str(path)
    return name if name.isprintable() else repr(name)


def _why(error: OSError | ValueError) -> str:
    """Return the reason that an error gives; of an ``OSError`` without number and path, as errors name the path."""
    return error.strerror or str(error) if isinstance(error, OSError) else str(error)
