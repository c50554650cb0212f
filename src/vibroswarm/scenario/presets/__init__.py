"""Presets: scenarios of this package, by name, such as ``paper``, ``paper-empirical`` (P^0) and ``e-puck``."""

from __future__ import annotations

from importlib.resources import files
from itertools import takewhile

from vibroswarm.errors import InputError, nearest


def preset_names() -> list[str]:
    """Return the names of all presets, sorted."""
    return sorted(p.name.removesuffix(".toml") for p in files(__name__).iterdir() if p.name.endswith(".toml"))


def preset_text(name: str) -> str:
    """Return the TOML text of a preset.

    Raises:
        InputError: there is no such preset; the nearest name is suggested.
    """
    known = preset_names()
    if name not in known:
        raise InputError(
            f"there is no preset '{name}'{nearest(name, known)} (there are {', '.join(known)})",
            field="preset",
        )
    return (files(__name__) / f"{name}.toml").read_text(encoding="utf-8")


def comment_of(name: str) -> str:
    """Return the lines of comment at the head of a preset: what it is, and where its numbers are from."""
    return "".join(takewhile(lambda line: line.startswith("#"), preset_text(name).splitlines(keepends=True)))


def describe(name: str) -> str:
    """Return a one-line description of a preset, one of ``preset_names``: the first line of its file, a comment."""
    return preset_text(name).splitlines()[0].removeprefix("# ")
