"""Untrusted files, opened as data: regular files of a bounded size, and nothing else.

A pipe or a device may never end, so it is refused before it is opened. Sizes are checked before memory is
allocated.
"""

from __future__ import annotations

import json
import os
import stat
import tomllib
from pathlib import Path
from typing import Any, Final, NoReturn, TypeVar

from vibroswarm.errors import InputError, shown

T = TypeVar("T")

_KINDS: Final = {int: "a whole number", str: "a text", list: "a list", dict: "a table of names", bool: "true or false",
                 float: "a number"}  # fmt: skip

MAX_NUMBER: Final = 1e300

MAX_TEXT: Final = 64 * 2**20
"""Size limit of a TOML or JSON file, bytes."""


def check_plain(path: Path, most: int, what: str) -> int:
    """Return the size of a regular file.

    Args:
        most: size limit, bytes. what: its kind, for errors: "a scenario".
    Raises:
        InputError: it is missing, unreadable, not a regular file, or too large.
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
    """Read a regular file; arguments and errors as of ``check_plain``."""
    check_plain(path, most, what)
    try:
        # The file may have been replaced since the check: never block on a pipe.
        with os.fdopen(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)), "rb") as stream:
            data = stream.read(most + 1)
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {_why(error)}", field=_named(path)) from None
    if len(data) > most:
        raise InputError(f"is larger than {sized(most)}; that is not {what}", field=_named(path))
    return data


def read_text(path: Path, what: str, most: int = MAX_TEXT) -> str:
    """Read a regular file as UTF-8, up to ``most`` bytes; ``what`` names its kind in errors.

    Raises:
        InputError: as ``check_plain``, or it is not UTF-8 text.
    """
    try:
        return read_bytes(path, most, what).decode("utf-8")
    except UnicodeDecodeError:
        raise InputError(f"is not text in UTF-8; {what} is", field=_named(path)) from None


def read_json(path: Path, what: str) -> Any:
    """Read a JSON file.

    Raises:
        InputError: as ``read_text``, or it is not JSON, or holds numbers that are not finite.
    """
    return parsed_json(read_text(path, what), _named(path))


def parsed_json(text: str | bytes, name: str) -> Any:
    """Parse a JSON text; ``name`` is the file's, for errors.

    Raises:
        InputError: it is not JSON, or holds numbers that are not finite.
    """
    try:
        return json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:  # also numbers with thousands of digits
        raise InputError(f"is damaged: not JSON ({str(error)[:80]})", field=name) from None


def parsed_toml(text: str, name: str) -> dict[str, Any]:
    """Return the values in a TOML text; errors name the file ``name``.

    Raises:
        InputError: the text is not TOML.
    """
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # not TOML, or a number of thousands of digits
        raise InputError(f"is not TOML: {error}", field=name) from None


def entry(about: Any, key: str, kind: type[T], path: Path | str) -> T:
    """Return the value under a key of a JSON object.

    Raises:
        InputError: it is not an object, lacks the key, or has a value of another type (booleans are not numbers).
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
    """Return the number under a key of a JSON object; errors as of ``entry``."""
    value = about.get(key) if isinstance(about, dict) else None
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= MAX_NUMBER:
        raise InputError(f"is damaged: '{key}' is {shown(value)}, expected a number", field=str(path))
    return value


def words(values: list[Any], key: str, path: Path | str) -> list[str]:
    """Check that a list of a JSON file holds texts; ``path`` names the file, ``key`` the list."""
    for value in values:
        if not isinstance(value, str):
            raise InputError(f"is damaged: '{key}' holds {shown(value)}, which is not text", field=str(path))
    return values


def texts(values: dict[str, Any], key: str, path: Path | str) -> dict[str, str]:
    """Check that a table of a JSON file holds texts; ``path`` names the file, ``key`` the table."""
    words(list(values.values()), key, path)
    return values


def sized(count: int) -> str:
    """Return a number of bytes in words: 64 MiB."""
    for unit, size in (("GiB", 2**30), ("MiB", 2**20)):
        if count >= size:
            return f"{count / size:g} {unit}"
    return f"{count} bytes"


def _no_number(text: str) -> NoReturn:
    raise ValueError(f"{text} is not a JSON number")


def _named(path: Path) -> str:
    name = str(path)
    return name if name.isprintable() else repr(name)


def _why(error: OSError | ValueError) -> str:
    return error.strerror or str(error) if isinstance(error, OSError) else str(error)
