"""Files from anywhere, opened as data: plain files of a bounded size, and nothing else.

A pipe or a device may never end, so that it is refused before it is opened. A size is looked at before memory is taken.
"""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path
from typing import Any, Final, NoReturn, TypeVar

from vibroswarm.errors import InputError, shown

T = TypeVar("T")

_KINDS: Final = {int: "a whole number", str: "a text", list: "a list", dict: "a table of names", bool: "true or false",
                 float: "a number"}  # fmt: skip

MOST_NUMBER: Final = 1e300

MOST_TEXT: Final = 64 * 2**20
"""Of a TOML or JSON file, bytes."""


def check_plain(path: Path, most: int, what: str) -> int:
    """The size of a plain file.

    Args:
        most: bytes that it may have. what: it should be, for the errors: "a scenario".
    Raises:
        InputError: it is not there, cannot be reached, is no plain file, or is larger.
    """
    name = _named(path)
    try:
        about = path.stat()
    except FileNotFoundError:
        raise InputError("cannot be read: there is no such file", field=name) from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise InputError(f"cannot be read: {_why(error)}", field=name) from None
    if stat.S_ISDIR(about.st_mode):
        raise InputError("is no plain file but a folder; give the name of a file", field=name)
    if not stat.S_ISREG(about.st_mode):
        raise InputError("is no plain file; give the name of a file", field=name)
    if about.st_size > most:
        raise InputError(f"is larger than {sized(most)}; that is not {what}", field=name)
    return about.st_size


def read_bytes(path: Path, most: int, what: str) -> bytes:
    """All of a plain file; arguments and errors as of ``check_plain``."""
    check_plain(path, most, what)
    try:
        # Between the two a file may be put in the place of another: never wait for one that is a pipe by now.
        with os.fdopen(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)), "rb") as stream:
            data = stream.read(most + 1)
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {_why(error)}", field=_named(path)) from None
    if len(data) > most:
        raise InputError(f"is larger than {sized(most)}; that is not {what}", field=_named(path))
    return data


def read_text(path: Path, what: str, most: int = MOST_TEXT) -> str:
    """The text of a plain file in UTF-8; ``what`` it should be, for the errors; it has at most ``most`` bytes.

    Raises:
        InputError: as ``check_plain``, or it is no text in UTF-8.
    """
    try:
        return read_bytes(path, most, what).decode("utf-8")
    except UnicodeDecodeError:
        raise InputError(f"is not text in UTF-8; {what} is", field=_named(path)) from None


def read_json(path: Path, what: str) -> Any:
    """What a JSON file says.

    Raises:
        InputError: as ``read_text``, or it is no JSON, or holds numbers that are not finite.
    """
    return parsed_json(read_text(path, what), _named(path))


def parsed_json(text: str | bytes, name: str) -> Any:
    """What a JSON text says; ``name`` is that of the file, for errors.

    Raises:
        InputError: it is no JSON, or holds numbers that are not finite.
    """
    try:
        return json.loads(text, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:  # also a number of thousands of digits
        raise InputError(f"is damaged: no JSON ({str(error)[:80]})", field=name) from None


def entry(about: Any, key: str, kind: type[T], path: Path | str) -> T:
    """What a JSON object says under a key.

    Raises:
        InputError: it is no object, lacks the key, or says something of another type (true and false are no numbers).
    """
    if not isinstance(about, dict):
        raise InputError("is damaged: no table of names", field=str(path))
    if key not in about:
        raise InputError(f"is damaged: '{key}' is missing", field=str(path))
    value = about[key]
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise InputError(
            f"is damaged: '{key}' is {shown(value)}, where {_KINDS[kind]} is right", field=str(path)
        )
    return value


def number(about: Any, key: str, path: Path | str) -> float:
    """A number under a key of a JSON object; errors as of ``entry``."""
    value = about.get(key) if isinstance(about, dict) else None
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= MOST_NUMBER:
        raise InputError(f"is damaged: '{key}' is {shown(value)}, where a number is right", field=str(path))
    return value


def words(values: list[Any], key: str, path: Path | str) -> list[str]:
    """A list of texts of a JSON file, checked; the file is named by ``path``, the list by ``key``."""
    for value in values:
        if not isinstance(value, str):
            raise InputError(f"is damaged: '{key}' holds {shown(value)}, which is no text", field=str(path))
    return values


def texts(values: dict[str, Any], key: str, path: Path | str) -> dict[str, str]:
    """A table of texts by name of a JSON file, checked; the file is named by ``path``, the table by ``key``."""
    words(list(values.values()), key, path)
    return values


def sized(count: int) -> str:
    """So many bytes in words: 64 MiB."""
    for unit, size in (("GiB", 2**30), ("MiB", 2**20)):
        if count >= size:
            return f"{count / size:g} {unit}"
    return f"{count} bytes"


def _no_number(text: str) -> NoReturn:
    raise ValueError(f"{text} is no number of JSON")


def _named(path: Path) -> str:
    name = str(path)
    return name if name.isprintable() else repr(name)


def _why(error: OSError | ValueError) -> str:
    return error.strerror or str(error) if isinstance(error, OSError) else str(error)
