"""Compare cells in pairs, run by run, and again on a second block of seeds; strategies at equal error too.

Each cell is compared with those that differ from it in a single field: strategies in all pairs, other fields with their
first value; or with a named reference only. Compared are fields whose values are words (strategies, presets,
labels); numeric fields only if nothing else is varied, since several of them make a curve; floors never, since nobody
chooses them. The p-values are corrected over all comparisons of a study.

For a comparison at equal error the cells are replayed with other settings (``analysis.forced_error``).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.analysis.cell_summary import run_figures
from vibroswarm.analysis.forced_error import (
    MatchedError,
    Reached,
    forced_error_by_run,
    matched_error,
    reached,
)
from vibroswarm.analysis.paired import FIGURES, Confirmation, Paired, compare, confirmed, holm
from vibroswarm.errors import InputError, check_choice
from vibroswarm.simulation import steers
from vibroswarm.study.factors import LABEL, flat
from vibroswarm.study.runner import Progress
from vibroswarm.study.spec import SOURCE, Cell, Study
from vibroswarm.study.study_result import StudyResult, run

SECOND: Final = "second-block"
STRATEGY: Final = "strategy.name"
MOST_AGAIN: Final = 1000
"""Most runs of the second block, which only has to confirm a difference."""
MOST_VALUES: Final = 8
"""A field with more values makes a curve and is not compared value by value."""
MOST_PAIRS: Final = 200
KEPT: Final = 3
"""Number of cells whose figures are cached."""


@dataclass(frozen=True)
class Compared:
    """One figure compared between two cells, with its second block if there is one."""

    cell: Cell
    reference: Cell
    field: str
    first: Paired
    replicate: Confirmation | None

    @property
    def name(self) -> str:
        """The name of the comparison: ``soft - none (random:0.48)``."""
        first, reference, rest = self.names
        return f"{first} - {reference}" + (f" ({rest})" if rest else "")

    @property
    def names(self) -> tuple[str, str, str]:
        """What the cell and its reference are called, and the varied values that they share."""
        rest = self.cell.words_of(k for k in self.cell.point if k != self.field)
        first, reference = (cell.words_of([self.field]) or "-" for cell in (self.cell, self.reference))
        if self.field == LABEL or first == reference:
            return self.cell.name, self.reference.name, ""
        return first, reference, rest

    def as_row(self) -> dict[str, Any]:
        """Return a flat row for a table; with a second block also its difference and whether it confirms."""
        row: dict[str, Any] = {
            "name": self.name,
            "cell": self.cell.number,
            "reference": self.reference.number,
        }
        row |= self.first.as_row()
        if self.replicate is not None:
            replicate = {
                f"again_{k}": v
                for k, v in self.replicate.second.as_row().items()
                if k.startswith("difference")
            }
            row |= {
                **replicate,
                "again_pairs": self.replicate.second.pairs,
                "confirmed": self.replicate.confirmed,
            }
            row["says"] = self.replicate.says
        return row


def pairs_of(study: Study, reference: str | None = None) -> list[tuple[Cell, Cell, str]]:
    """List cells with their references and the field in which they differ; none if there are too many pairs.

    Args:
        reference: a value of a compared field, or a label, with which all others are compared; by default all pairs
            of strategies are compared, and the values of other fields with the first.
    Raises:
        InputError: no compared field has this value.
    """
    if reference is not None:
        _check_reference(study, reference)
    by_point: dict[str, Cell] = {}
    for cell in study.cells:
        by_point.setdefault(_key(cell.point), cell)  # of equal points the first
    pairs = []
    for name in _compared_fields(study):
        fields = _fields_of_labels(study) if name == LABEL else {name}
        groups: dict[str, list[Cell]] = {}  # cells that are equal in all else
        for cell in by_point.values():
            groups.setdefault(_key({k: v for k, v in cell.point.items() if k not in fields}), []).append(cell)
        named = reference in {cell.words.get(name) for cell in study.cells}
        of_strategies = STRATEGY in fields and reference is None
        for group in groups.values():
            chosen = [cell for cell in group if named and cell.words.get(name) == reference]
            if not named:
                first = study.cells[0].point.get(name)
                chosen = group[:1] if name == LABEL else [c for c in group if c.point.get(name) == first]
            for place, cell in enumerate(group):
                others = group[:place] if of_strategies else chosen[:1]
                pairs += [(cell, other, name) for other in others if other is not cell]
    return pairs if len(pairs) <= MOST_PAIRS else []


def _check_reference(study: Study, reference: str) -> None:
    """Refuse a reference that no compared field has as a value."""
    fields = _compared_fields(study)
    values = list(dict.fromkeys(cell.words[k] for cell in study.cells for k in fields if k in cell.words))
    if not values:
        raise InputError("this study compares no cells; remove it", field="--reference")
    check_choice(reference, "--reference", values)


def _compared_fields(study: Study) -> list[str]:
    """List the fields whose values are compared pairwise.

    These are labels and the fields whose values are words. Without any, it is the varied field if there is only one,
    unless that is the floor or has too many values.
    """
    if LABEL in study.varied:
        fields = [name for name in _word_fields(study) if name not in _fields_of_labels(study)]
        return [LABEL, *fields]
    values = {name: {repr(cell.point.get(name)) for cell in study.cells} for name in study.varied}
    several = [name for name, choices in values.items() if 1 < len(choices) <= MOST_VALUES and name != SOURCE]
    return _word_fields(study) or (
        several if len([name for name, choices in values.items() if len(choices) > 1]) == 1 else []
    )


def _word_fields(study: Study) -> list[str]:
    """List the varied fields whose few values are words; the floor is not one of them."""
    fields = []
    for name in study.varied:
        values = {repr(cell.point.get(name)) for cell in study.cells}
        if name not in (SOURCE, LABEL) and 1 < len(values) <= MOST_VALUES:
            fields += [name] if isinstance(study.cells[0].point.get(name), str | bool) else []
    return fields


def _fields_of_labels(study: Study) -> set[str]:
    """Return ``label`` and the fields that the ``list`` block sets: differences in these belong to the label."""
    return {LABEL} | {name for entry in study.vary.get("list", ()) for name in flat(entry)}


def second_seed(seed: int) -> int:
    """Derive the seed of the second block."""
    return int.from_bytes(hashlib.sha256(f"second block of {seed}".encode()).digest()[:7])


def second_block(
    result: StudyResult,
    *,
    executor: str | Executor = "threads",
    workers: int | None = None,
    mixed: bool = False,
    progress: Progress | None = None,
    allow_failures: bool = False,
) -> StudyResult:
    """Run the study on another seed, with fresh motion, floors and noise, in a folder inside its own."""
    runs = min(min(result.runs_of(cell) for cell in result.selected), MOST_AGAIN)
    study = replace(result.study, seed=second_seed(result.study.seed), runs=runs, until=None, keep=())
    folder: Path = result.store.folder / SECOND
    replicate = run(
        study,
        folder,
        executor=executor,
        workers=workers,
        mixed=mixed,
        progress=progress,
        allow_failures=allow_failures,
    )
    return replace(replicate, selected=result.selected)


def comparisons(
    result: StudyResult, replicate: StudyResult | None = None, reference: str | None = None
) -> list[Compared]:
    """Compare all pairs of the selected cells in all figures.

    Args:
        reference: as of ``pairs_of``.
    """
    pairs = [
        p for p in pairs_of(result.study, reference) if {p[0].number, p[1].number} <= set(result.selected)
    ]
    if not pairs:
        return []
    first, second = _Figures(result), None if replicate is None else _Figures(replicate)
    compared = []
    for cell, other, name in pairs:
        blocks = [_pair(figures, cell, other) for figures in (first, second)]
        for k, paired in enumerate(blocks[0] or ()):
            compared.append((cell, other, name, paired, blocks[1][k] if blocks[1] else None))
    corrected = holm([paired.p_value for *_, paired, _ in compared])
    return [_compared(*entry, p) for entry, p in zip(compared, corrected, strict=True)]


def _pair(of: _Figures | None, cell: Cell, reference: Cell) -> Sequence[Paired] | None:
    """Compare two cells in all figures; None if ``of`` is None or lacks one of them, or they have no run in common."""
    if of is None or not {cell.number, reference.number} <= set(of.result.selected):
        return None
    figures_of_cell, figures_of_reference = of(cell), of(reference)
    if figures_of_cell.join(figures_of_reference, on="run", how="semi").is_empty():
        return None
    return compare(figures_of_cell, figures_of_reference, (*FIGURES, "forced_error"))


def comparison_table(compared: Sequence[Compared]) -> pl.DataFrame:
    """Tabulate comparisons, one row per pair of cells and figure."""
    return pl.DataFrame([comparison.as_row() for comparison in compared], infer_schema_length=None)


def _compared(
    cell: Cell, reference: Cell, name: str, paired: Paired, replicate: Paired | None, p: float
) -> Compared:
    """Return a comparison with its corrected p-value and its replicate."""
    paired = replace(paired, p_holm=p)
    return Compared(
        cell, reference, name, paired, None if replicate is None else confirmed(paired, replicate)
    )


class _Figures:
    """Figures of runs by cell; the last few cells are cached, since pairs share their reference."""

    def __init__(self, result: StudyResult) -> None:
        self.result, self.found = result, dict[int, pl.DataFrame]()

    def __call__(self, cell: Cell) -> pl.DataFrame:
        figures = self.found.pop(cell.number, None)
        if figures is None:
            robots, runs = self.result.tables(cell.number)
            figures = run_figures(robots, runs, cell.scenario.run.t_end_s).join(
                forced_error_by_run(robots, runs), on="run", how="left", maintain_order="left"
            )
        self.found[cell.number] = figures  # the newest is last
        if len(self.found) > KEPT:
            del self.found[next(iter(self.found))]
        return figures


def _key(point: dict[str, Any]) -> str:
    return repr(sorted((k, repr(v)) for k, v in point.items()))


MATCHED_CELLS: Final = 12
"""With more cells nothing is compared at equal error."""
MATCHED_RUNS: Final = 1000
MATCHED_ROBOTS: Final = 5000
"""Most robots in all runs that are replayed with each setting, unless that is less than 100 runs."""
LEAST_RUNS: Final = 20
ENGINES: Final = ("event", "fixed-step")
"""Sources of the motion that strategies are replayed on at other settings: both give the same."""


def at_equal_error(
    result: StudyResult, compared: Sequence[Compared], progress: Callable[[float], None] | None = None
) -> dict[tuple[int, int], MatchedError]:
    """Compare each pair of cells with different strategies at equal error, by replay with other settings.

    Left out are strategies that steer, since their motion changes with the settings, and cells in which no decision is
    right in some run. The result is empty if more than ``MATCHED_CELLS`` cells remain, if these have fewer than
    ``LEAST_RUNS`` runs in common, or if the study's source of motion is not one of ``ENGINES``: the motion is simulated
    again by an engine.

    Args:
        progress: called with the share done.
    Returns: comparisons by the numbers of the two cells, the reference second.
    """
    if result.study.motion not in ENGINES:
        return {}
    pairs = {
        (one.cell.number, one.reference.number): (one.cell, one.reference)
        for one in compared
        if one.cell.scenario.strategy.name != one.reference.scenario.strategy.name
        and not steers(one.cell.scenario)
        and not steers(one.reference.scenario)
    }
    cells = {cell.number: cell for pair in pairs.values() for cell in pair}
    if len(cells) > MATCHED_CELLS:
        return {}
    runs = {number: _runs(result, cell) for number, cell in cells.items()}
    common = sorted(set.intersection(*map(set, runs.values()))) if runs else []
    if len(common) < LEAST_RUNS:
        return {}
    found: dict[int, Reached] = {}
    for done, (number, cell) in enumerate(cells.items()):
        try:
            found[number] = reached(cell.scenario, result.study.seed, common)
        except InputError:
            continue
        if progress is not None:
            progress((done + 1) / len(cells))
    return {(a, b): matched_error(found[a], found[b]) for a, b in pairs if a in found and b in found}


def _runs(result: StudyResult, cell: Cell) -> list[int]:
    """List the runs of a cell that are replayed."""
    return result.runs_there(
        cell.number, min(MATCHED_RUNS, max(MATCHED_ROBOTS // cell.scenario.swarm.robots, 100))
    )
