"""Write the files of a search: numbers as CSV, and the winner as a scenario.

best.toml        the winner's scenario, for ``vibroswarm run --scenario``
history.csv      a row for each iteration: best, mean, personal bests, mean of each field (value and fraction)
candidates.csv   a row for each candidate: its values, runs, failures, scores
front.csv        with several objectives: the Pareto front, believed and true scores
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vibroswarm.core.atomic_io import write_files
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.search.loop import Found
from vibroswarm.search.spec import Search
from vibroswarm.search.steps import versions_of
from vibroswarm.search.validation import Front
from vibroswarm.simulation import versions
from vibroswarm.statistics.intervals import plain


def best_scenario(found: Found) -> Scenario:
    """Return the scenario of the search's first case with the values of the winner of ``found``.

    The winner is the same in all cases, and ``best.toml`` holds one scenario only.
    """
    return found.search.cases[0].scenario.with_values(found.values)


def history_table(found: Found) -> pl.DataFrame:
    """Tabulate the iterations of the search, then those of the race, one row each.

    Besides scores and numbers of runs, a row has, for each field, the mean coordinate in the unit cube of the
    candidates of the iteration: converted to a value, and itself, as a fraction of the field's bounds. On a log scale
    the value is therefore a geometric mean, and for a list of choices it is the choice at the mean coordinate. In a
    race both are those of the best candidate. The scores of the personal bests are given only for a particle swarm.
    Scores that are not finite are null.

    Args:
        found: result of a search.
    """
    rows = []
    space = found.search.space
    for stage, history in (("search", found.history), ("race", found.race)):
        for iteration in history:
            row: dict[str, Any] = {
                "stage": stage, "iteration": iteration.number, "runs": iteration.runs, "best": plain(iteration.best),
                "mean": plain(iteration.mean), "best_key": iteration.best_key,
            }  # fmt: skip
            for name, value, share in zip(
                space.names,
                space.values(np.array(iteration.mean_point)).values(),
                iteration.mean_point,
                strict=True,
            ):
                row |= {f"mean {name}": value, f"mean {name}, of its bounds": share}
            row |= {f"personal {k}": plain(score) for k, score in enumerate(iteration.personal)}
            rows.append(row)
    return pl.DataFrame(rows, infer_schema_length=None)


def candidate_table(found: Found) -> pl.DataFrame:
    """Tabulate the candidates, one row each: origin, values, runs, failures, and a score for each objective.

    Scores are null if a run failed, unless the search drops failed runs, and if no run succeeded.

    Args:
        found: result of a search.
    """
    rows = []
    for c in found.archive.candidates:
        row: dict[str, Any] = {"key": c.key, "origin": c.origin, **c.values}
        row |= {"runs": c.count, "failed": c.failed}
        for k, objective in enumerate(found.search.objectives):
            # The column of the first objective, often the only one, is just "score".
            row[f"score {objective.words}" if k else "score"] = plain(found.archive.score(c.key, k))
        rows.append(row)
    return pl.DataFrame(rows, infer_schema_length=None)


def write_search(found: Found, folder: str | Path, front: Front | None = None) -> None:
    """Write the files of a search (see the head of this module) into a folder.

    Args:
        found: the result of the search. front: the Pareto front on fresh runs, with several objectives.
    Raises:
        RunError: a file cannot be written.
    """
    contents: dict[str, str | bytes] = {
        "history.csv": csv_bytes(history_table(found)),
        "candidates.csv": csv_bytes(candidate_table(found)),
        "best.toml": best_scenario(found).to_toml(),
    }
    if front is not None:
        contents["front.csv"] = csv_bytes(front.table)
    write_files(Path(folder), contents)


def file_text(search: Search) -> str:
    """Return a search as TOML; the text is empty if a file cannot hold it, as its cost is a function."""
    try:
        return search.to_toml()
    except InputError:
        return ""


def made_by(folder: Path) -> list[dict[str, str]]:
    """Return the versions of the programs that made a folder, one entry for each set of versions.

    These are those that began the search, and the current ones if they differ.
    """
    now = versions()
    try:
        began = versions_of(folder)
    except InputError:
        return [now]
    return [began] if now.items() <= began.items() else [began, now]  # which also has ``registered_sources``
