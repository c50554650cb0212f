"""The documents of what a scenario may name: strategies, networks, tasks, sources of motion, sensors, presets."""

from __future__ import annotations

from typing import Final

import polars as pl

import vibroswarm.simulation  # noqa: F401  (registers the engines)
from vibroswarm.core.numbers import count
from vibroswarm.scenario import plugins
from vibroswarm.scenario.presets import describe, preset_names
from vibroswarm.show.document import Document, Table

NOUNS: Final = {
    "strategy": ("strategy", "strategies"),
    "network": ("network", "networks"),
    "task": ("task", "tasks"),
    "motion": ("source of motion", "sources of motion"),
    "sensor": ("sensor", "sensors"),
    "preset": ("preset", "presets"),
}
"""One and several of each kind."""
USES: Final = {
    "strategy": "--strategy NAME",
    "network": "--network NAME",
    "task": "--task NAME",
    "motion": "--motion NAME",
    "sensor": "--set sensor.model=NAME",
    "preset": "--preset NAME",
}
"""How a command selects one of a kind."""


def known_document(kind: str) -> Document:
    """Return the names of a kind, with one line each, those of installed packages included.

    Args:
        kind: a key of ``NOUNS``.
    """
    if kind == "preset":
        named = {name: describe(name) for name in preset_names()}
    else:
        plugins.load_installed(kind)
        named = {name: one.about for name, one in plugins.KINDS[kind].known().items()}
    title = NOUNS[kind][1]
    frame = pl.DataFrame({kind: list(named), "about": list(named.values())})
    answer = f"{count(len(named), *NOUNS[kind])}; select one with {USES[kind]}."
    return Document(
        title[:1].upper() + title[1:], (answer,), parts=(Table(frame, name=title.replace(" ", "_"), names=1),)
    )
