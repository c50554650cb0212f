"""Untrusted files, opened as data: regular files of a bounded size, and nothing else."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any, Final

from vibroswarm.errors import InputError

MAX_TEXT: Final = 64 * 2**20
"""Size limit of a TOML or JSON file, bytes."""


def check_plain(path: Path, most: int, what: str) -> None:
    """Check that a file is a regular file of a limited size."""
    if not path.is_file():
        raise InputError("cannot be read: there is no such file", field=str(path))
    if path.stat().st_size > most:
        raise InputError(f"is larger than {most / 2**20:g} MiB; that is not {what}", field=str(path))


def read_bytes(path: Path, most: int, what: str) -> bytes:
    """Read a regular file of at most ``most`` bytes; arguments and errors are those of ``check_plain``."""
    check_plain(path, most, what)
    return path.read_bytes()


def read_text(path: Path, what: str, most: int = MAX_TEXT) -> str:
    """Read a regular file of at most ``most`` bytes as UTF-8 text; ``what`` names the kind of file, for errors."""
    try:
        return read_bytes(path, most, what).decode("utf-8-sig")  # some editors write a byte order mark
    except UnicodeDecodeError:
        raise InputError(f"is not text in UTF-8; {what} is", field=str(path)) from None


def read_json(path: Path, what: str) -> Any:
    """Read a JSON file and return its value; ``what`` names the kind of file, for errors."""
    try:
        return json.loads(read_text(path, what))
    except json.JSONDecodeError as error:
        raise InputError(f"is damaged: not JSON in line {error.lineno}", field=str(path)) from None


def parsed_toml(text: str, name: str) -> dict[str, Any]:
    """Parse a TOML text and return its table; ``name`` is the name of its file, for errors."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"is not TOML (texts stand in quotes): {error}", field=name) from None
