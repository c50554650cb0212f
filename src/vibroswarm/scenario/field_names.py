"""Names of fields as attributes, which sessions complete: ``fields.swarm.robots`` is "swarm.robots".

They stand wherever a dotted name does: ``scenario.with_values({fields.swarm.robots: 8})``.
"""

from __future__ import annotations

from typing import Final

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import nearest
from vibroswarm.scenario.scenario import field_names


class FieldNames(NotebookView):
    """The fields below a section, or all: each attribute is a dotted name, or the fields below it.

    Args:
        section: dotted name; empty: all sections.
    """

    __slots__ = ("_section",)

    def __init__(self, section: str = "") -> None:
        self._section = section

    def _below(self) -> list[str]:
        """Return the dotted names below this section, without it."""
        start = f"{self._section}." if self._section else ""
        return [name.removeprefix(start) for name in field_names() if name.startswith(start)]

    def __dir__(self) -> list[str]:
        return list(dict.fromkeys(name.partition(".")[0] for name in self._below()))

    def __getattr__(self, name: str) -> str | FieldNames:
        """Return the dotted name of a field, or the fields of a section.

        Raises:
            AttributeError: there is none; the nearest is named.
        """
        below = [] if name.startswith("_") else self._below()
        full = f"{self._section}.{name}" if self._section else name
        if name in below:
            return full
        if any(known.startswith(f"{name}.") for known in below):
            return FieldNames(full)
        raise AttributeError(f"there is no field {full!r}{nearest(name, dir(self)) if below else ''}")

    def __repr__(self) -> str:
        return f"FieldNames({self._section or 'all'}: {len(self._below())} fields)"


fields: Final = FieldNames()
"""All fields of a scenario: ``fields.walk.leg_min_ms`` is "walk.leg_min_ms"."""
