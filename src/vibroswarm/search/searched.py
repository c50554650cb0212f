"""A whole search, as ``vibroswarm optimize`` runs it; Python runs the same with the same keywords::

searched(search_of(method="tpe", budget=5000), Path("out"))

Files of a search:

best.toml        the winner's scenario, for ``vibroswarm run --scenario``
search.toml      the search
history.csv      a row for each iteration: best, mean, personal bests, mean of each field (value and fraction)
candidates.csv   a row for each candidate: its values, runs, failures, scores
front.csv        with several objectives: the Pareto front, believed and true scores
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vibroswarm.core.atomic_io import write_files
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError
from vibroswarm.result import write_code
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.search.loop import Found, Progress, run_search
from vibroswarm.search.spec import Search
from vibroswarm.search.validation import Truth, front_of, truth_of
from vibroswarm.statistics.intervals import plain
from vibroswarm.study.options import chosen, values_of


def search_of(
    file: Path | None = None,
    /,
    *,
    method: str | None = None,
    seed: int | None = None,
    strategy: str | None = None,
    robots: int | None = None,
    floor: str | None = None,
    **settings: Any,
) -> Search:
    """Return the search of a file, or else the default search, changed by options.

    Args:
        strategy, robots, floor: replace those of the file's scenario.
        settings: ``noise``, ``cost``, ``budget`` and ``fresh``, None as if left out, see ``Search.from_toml``.
    """
    settings["method"] = None if method is None else chosen("method", method)
    search = Search.from_toml("", **settings) if file is None else Search.read(file, **settings)
    study = search.study if seed is None else replace(search.study, seed=seed)
    base = study.base if isinstance(study.base, Scenario) else Scenario.from_base(dict(study.base))
    values = values_of(base, strategy=strategy, robots=robots, floor=floor)
    if values.keys() & {*study.varied, *search.space.names}:
        raise InputError("is searched over or varied by the file", field=next(iter(values)))
    return replace(search, study=replace(study, base=base.with_values(values)) if values else study)


@dataclass(frozen=True)
class Searched:
    """A search that was validated."""

    found: Found
    truth: Truth | None
    """The winner on fresh runs; None with several objectives."""
    front: pl.DataFrame | None
    """The Pareto front on fresh runs (``front_of``); None with one objective."""


def searched(
    search: Search,
    folder: Path | None = None,
    *,
    progress: Progress = lambda runs, best: None,
    validating: Callable[[int], None] = lambda done: None,
    **where: Any,
) -> Searched:
    """Run a search, score its winner or its Pareto front on fresh runs, and write its files.

    Args:
        folder: where it is saved, and continued; None: nowhere. progress: of the search. validating: called with the
            number of finished fresh runs. where: ``executor`` and ``workers``, see ``run_search``.
    """
    found = run_search(search, folder, progress=progress, **where)
    how = {"folder": folder, "progress": validating, **where}
    is_one = len(search.objectives) == 1
    truth, front = (truth_of(found, **how), None) if is_one else (None, front_of(found, **how))
    if folder is not None:
        write_search(found, folder, front)
    return Searched(found, truth, front)


def write_search(found: Found, folder: Path, front: pl.DataFrame | None = None) -> None:
    """Write the files of a search (see the head of this module), and users' code that it needs, into a folder."""
    search = found.search
    tables = {"history": history_table(found), "candidates": candidate_table(found)}
    if front is not None:
        tables["front"] = front
    contents = {"search.toml": search.to_toml(), "best.toml": best_scenario(found).to_toml()}
    write_files(folder, contents | {f"{name}.csv": csv_bytes(table) for name, table in tables.items()})
    write_code(folder, [cell.scenario for cell in search.study.cells], search.settings.method, *search.codes)


def best_scenario(found: Found) -> Scenario:
    """Return the scenario of the search's first case with the values of the winner."""
    return found.search.study.cells[0].scenario.with_values(found.values)


def history_table(found: Found) -> pl.DataFrame:
    """Tabulate the iterations of the search, then the rounds of the finalists, a row each.

    The means of a field are those of the candidates of an iteration, and of the finalists those of the best one. Scores
    that are not finite are null.
    """
    rows, space = [], found.search.space
    for stage, one in [*(("search", i) for i in found.history), *(("race", i) for i in found.race)]:
        row: dict[str, Any] = {
            "stage": stage, "iteration": one.number, "runs": one.runs, "best": plain(one.best),
            "mean": plain(one.mean), "best_key": one.best_key,
        }  # fmt: skip
        values = space.values(np.array(one.mean_point))
        for (name, value), share in zip(values.items(), one.mean_point, strict=True):
            row |= {f"mean {name}": value, f"mean {name}, of its bounds": share}
        rows.append(row | {f"personal {k}": plain(score) for k, score in enumerate(one.personal)})
    return pl.DataFrame(rows, infer_schema_length=None)


def candidate_table(found: Found) -> pl.DataFrame:
    """Tabulate the candidates, a row each: origin, values, runs, failures, and a score for each objective."""
    # The column of the first objective, often the only one, is just "score".
    scores = [f"score {one.words}" if k else "score" for k, one in enumerate(found.search.objectives)]
    rows = []
    for c in found.archive.candidates:
        row = {"key": c.key, "origin": c.origin, **c.values, "runs": c.count, "failed": c.failed}
        rows.append(row | dict(zip(scores, map(plain, found.archive.scores(c.key)), strict=True)))
    return pl.DataFrame(rows, infer_schema_length=None)
