"""Reproduce the paper: run the cells of all items in one store, compute the items, decide the claims."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Final

from vibroswarm.paper.cells import Cells, cells_of, study
from vibroswarm.paper.claims import Decided, decide
from vibroswarm.paper.item import Item, Made, Settings, Work, all_items, make
from vibroswarm.paper.items import calibration
from vibroswarm.study.run import StudyProgress, run

ONLY: Final = {"pool": ("paper",), "feedback-cases": ("paper",)}
"""Columns of studies, where they are fewer than those of their item."""
READ: Final = (
    "decision_time_s", "belief_in_truth", "wrong_share", "avoid_per_sample_s", "distance_m", "estimate", "right",
    "wrong", "undecided", "robots",
)  # fmt: skip
"""Columns of the runs that are read."""


@dataclass(frozen=True)
class Reproduction:
    """Results of a reproduction."""

    settings: Settings
    made: tuple[Made, ...]
    """The items, skipped ones too, in the paper's order."""

    @cached_property
    def decided(self) -> list[Decided]:
        """Verdicts on the claims that were measured."""
        return decide([value for one in self.made for value in one.values])


def reproduce(
    settings: Settings,
    folder: str | Path,
    items: Sequence[Item] | None = None,
    progress: Callable[[StudyProgress], None] = lambda now: None,
) -> Reproduction:
    """Run what a folder does not hold yet, and compute items."""
    items, folder = all_items() if items is None else items, Path(folder)
    skipped = {item.name: _skipped(item, settings) for item in items}
    wanted = dict.fromkeys(
        (name, column)
        for item in items
        for name, column in product(item.studies, settings.columns)
        if column in ONLY.get(name, item.columns)
    )
    work = Work(settings, _run(list(wanted), settings, folder, progress), folder)
    made = (
        Made(item, skipped=skipped[item.name]) if skipped[item.name] else make(item, work) for item in items
    )
    return Reproduction(settings, tuple(made))


def _skipped(item: Item, settings: Settings) -> str:
    if not set(item.columns) & set(settings.columns):
        return f"needs a preset of {', '.join(item.columns)}"
    return calibration.missing(settings) if item.name == "calibration" else ""


def _run(
    wanted: Sequence[tuple[str, str]],
    settings: Settings,
    folder: Path,
    progress: Callable[[StudyProgress], None],
) -> dict[tuple[str, str], Cells]:
    """Run the cells of studies by study and column; those with as many runs at once, so that they share motion."""
    found = {}
    sizes = {name: min(study(name, column).runs or 1, settings.runs) for name, column in wanted}
    for runs in sorted(set(sizes.values()), reverse=True):
        parts = [(name, column) for name, column in wanted if sizes[name] == runs]
        cells = [cell for part in parts for cell in cells_of(*part)]
        numbered = [replace(cell, number=number) for number, cell in enumerate(cells)]
        result = run(
            numbered, runs, settings.seed, folder=folder, workers=settings.workers, progress=progress
        )
        rows = iter(result.rows(*READ).partition_by("cell", maintain_order=True))
        for part in parts:
            own = cells_of(*part)
            found[part] = Cells(part[1], own, [next(rows) for _ in own])
    return found
