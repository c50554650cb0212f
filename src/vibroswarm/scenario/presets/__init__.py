"""Presets: scenarios of this package, by name, such as ``paper``, ``paper-empirical`` (P^0) and ``e-puck``."""

from __future__ import annotations

from pathlib import Path

from vibroswarm.errors import check_choice

FILES = {path.stem: path for path in sorted(Path(__file__).parent.glob("*.toml"), key=lambda path: path.stem)}
"""The presets' files, by name."""


def preset_names() -> list[str]:
    """Return the names of all presets, sorted."""
    return list(FILES)


def preset_text(name: str) -> str:
    """Return the TOML text of a preset."""
    check_choice(name, "preset", FILES)
    return FILES[name].read_text(encoding="utf-8")


def describe(name: str) -> str:
    """Return a one-line description of a preset, one of ``preset_names``: the first line of its file, a comment."""
    return preset_text(name).splitlines()[0].removeprefix("# ")
