"""``vibroswarm list``: what a scenario may name."""

from __future__ import annotations

from typing import Annotated, Final

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import print_document
from vibroswarm.cli.options import Json
from vibroswarm.errors import check_choice

KINDS: Final = {
    "strategies": "strategy",
    "networks": "network",
    "sensors": "sensor",
    "motions": "motion",
    "tasks": "task",
    "presets": "preset",
}
"""Kinds of names, with the singular."""


def known(
    kind: Annotated[str, Option("strategies, networks, sensors, motions, tasks, presets or floors", "KIND")],
    /,
    *,
    json: Json = False,
) -> None:
    """List what a scenario may name: strategies, networks, sensors, sources of motion, tasks, presets or floors.

    example:
      vibroswarm list strategies
    """
    check_choice(kind, "KIND", [*KINDS, "floors"])
    if kind == "floors":
        from vibroswarm.documents.floor import floors_document
        from vibroswarm.floors.difficulty import measure
        from vibroswarm.floors.source import NAMES, pattern

        print_document(floors_document({name: measure(pattern(name)) for name in NAMES}), as_json=json)
    else:
        from vibroswarm.documents.known import known_document

        print_document(known_document(KINDS[kind]), as_json=json)
