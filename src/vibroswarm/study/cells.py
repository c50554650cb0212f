"""Cells: scenarios that are run many times, with the values in which they differ."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

from vibroswarm.scenario.scenario import Scenario
from vibroswarm.study.factors import Point, fields_as_text, value_as_text


@dataclass(frozen=True)
class Cell:
    """One scenario of a study, and the values in which it differs from others."""

    number: int
    point: Point
    """Its values of the varied fields."""
    scenario: Scenario
    name: str = ""
    """A name that no other cell has; the scenario's strategy if nothing is varied."""

    @cached_property
    def hash(self) -> str:
        """Hash of the scenario."""
        return self.scenario.hash

    @cached_property
    def texts(self) -> dict[str, str]:
        """Each varied value as text."""
        return {name: value_as_text(value) for name, value in self.point.items()}

    def text_of(self, fields: Iterable[str]) -> str:
        """Write the cell's values of these fields: ``random:0.44, soft, eta 1250``; fields not varied are left out."""
        return fields_as_text({name: self.texts[name] for name in fields if name in self.texts})
