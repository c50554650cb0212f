"""A report: an answer of at most three sentences, warnings, tables, pictures, and how it was made.

``report(result)`` makes one, by a function registered for each kind of result.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, singledispatch
from importlib import import_module
from typing import Any, Final

import polars as pl

from vibroswarm.plots.picture import Picture


@dataclass(frozen=True)
class Table:
    """A frame, with headings that replace those that follow from the names of its columns."""

    frame: pl.DataFrame
    title: str = ""
    caption: str = ""
    titles: Mapping[str, str] = field(default_factory=dict)
    folded: bool = False
    """Whether a page shows it only on request, and a terminal not at all."""


@dataclass(frozen=True, eq=False)
class Figure:
    """A picture, drawn when it is first needed."""

    draw: Callable[[], Picture]
    title: str
    folded: bool = False
    """Whether a page shows it only on request."""

    @cached_property
    def picture(self) -> Picture:
        """The picture."""
        return self.draw()


@dataclass(frozen=True)
class Report:
    """What a result says."""

    title: str
    answer: tuple[str, ...]
    """What the reader wants to know: at most three sentences, or a line a cell."""
    parts: Mapping[str, Table | Figure]
    """Tables and pictures by name, the most important first; files are named alike."""
    setting: str = ""
    """What was simulated or measured, in one line."""
    warnings: tuple[str, ...] = ()
    """Reasons not to trust the answer."""
    made_by: Mapping[str, str] = field(default_factory=dict)
    """Seed, versions and the like."""

    @property
    def tables(self) -> dict[str, Table]:
        """The tables by name."""
        return {name: part for name, part in self.parts.items() if isinstance(part, Table)}

    @property
    def figures(self) -> dict[str, Figure]:
        """The pictures by name."""
        return {name: part for name, part in self.parts.items() if isinstance(part, Figure)}

    def _repr_html_(self) -> str:
        from vibroswarm.report.page import page

        return page(self, whole=False)


KINDS: Final = {
    "vibroswarm.result": "run",
    "vibroswarm.study.summary": "study",
    "vibroswarm.study.runs": "study",
    "vibroswarm.study.detection": "detection",
    "vibroswarm.scenario.scenario": "file",
    "vibroswarm.study.store": "file",
    "vibroswarm.search.sensitivity": "search",
    "vibroswarm.search.searched": "search",
    "vibroswarm.league.play": "league",
    "vibroswarm.inspection.inspection": "inspection",
    "vibroswarm.calibrate.compare": "calibration",
    "vibroswarm.calibrate.fit": "calibration",
    "vibroswarm.lab.tracking.track": "tracking",
    "vibroswarm.paper.reproduce": "reproduction",
    "vibroswarm.export.c_library": "export",
    "vibroswarm.lab.replay": "recording",
    "vibroswarm.lab.spectrum": "recording",
    "vibroswarm.recordings.threshold": "recording",
}
"""Module of a kind of report, by that of the result's class; it is imported when the first of its reports is made."""


@singledispatch
def report(result: Any, **options: Any) -> Report:
    """Return what a result says; a report says itself."""
    kind = type(result)
    if kind.__module__ in KINDS:
        import_module(f"vibroswarm.report.{KINDS[kind.__module__]}")
    if report.dispatch(kind) is report.dispatch(object):
        raise TypeError(f"there is no report of {kind.__name__}")
    return report(result, **options)


@report.register
def _itself(result: Report) -> Report:
    return result
