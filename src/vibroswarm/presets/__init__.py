"""Scenarios by name: ``paper``, ``paper-empirical`` (P0) and ``text``."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.resources import files

from vibroswarm.errors import InputError, nearest
from vibroswarm.scenario import Scenario


def preset_names() -> list[str]:
    """The names of all presets, sorted."""
    return sorted(p.name.removesuffix(".toml") for p in files(__name__).iterdir() if p.name.endswith(".toml"))


@cache
def preset(name: str) -> Scenario:
    """The scenario of that name.

    Raises:
        InputError: there is no such preset; the nearest is named.
    """
    known = preset_names()
    if name not in known:
        raise InputError(
            f"there is no preset '{name}'{nearest(name, known)} (there are {', '.join(known)})",
            field="preset",
        )
    return Scenario.from_toml((files(__name__) / f"{name}.toml").read_text(encoding="utf-8"), name=name)


@cache
def describe(name: str) -> str:
    """What the preset is, in one line: the comment at its head."""
    text = (files(__name__) / f"{name}.toml").read_text(encoding="utf-8")
    tomllib.loads(text)
    return text.splitlines()[0].removeprefix("# ")
