"""The files of a search: numbers as CSV, and the winner as a scenario.

best.toml        the winner's scenario, for ``vibroswarm run --scenario``
search.toml      the search
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
from vibroswarm.result import write_code
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.search.loop import Found
from vibroswarm.search.validation import Front
from vibroswarm.statistics.intervals import plain


def best_scenario(found: Found) -> Scenario:
    """Return the scenario of the search's first case with the values of the winner."""
    return found.search.cases[0].scenario.with_values(found.values)


def history_table(found: Found) -> pl.DataFrame:
    """Tabulate the iterations of the search, then the rounds of the finalists, a row each.

    Besides scores and numbers of runs, a row has, for each field, the mean coordinate in the unit cube of the
    candidates of the iteration: converted to a value, and itself, as a fraction of the field's bounds. Of the finalists
    both are those of the best one. Scores that are not finite are null.
    """
    rows = []
    space = found.search.space
    for stage, history in (("search", found.history), ("race", found.race)):
        for one in history:
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
    rows = []
    for c in found.archive.candidates:
        row: dict[str, Any] = {
            "key": c.key,
            "origin": c.origin,
            **c.values,
            "runs": c.count,
            "failed": c.failed,
        }
        for k, objective in enumerate(found.search.objectives):
            # The column of the first objective, often the only one, is just "score".
            row[f"score {objective.words}" if k else "score"] = plain(found.archive.score(c.key, k))
        rows.append(row)
    return pl.DataFrame(rows, infer_schema_length=None)


def write_search(found: Found, folder: Path, front: Front | None = None) -> None:
    """Write the files of a search (see the head of this module), and users' code that it needs, into a folder.

    Raises:
        RunError: a file cannot be written.
    """
    search = found.search
    choices = [value for one in search.space for value in one.choices if plugins.is_code(value)]
    scenarios = [cell.scenario for cell in search.cases]
    contents: dict[str, str | bytes] = {
        "search.toml": search.to_toml(),
        "history.csv": csv_bytes(history_table(found)),
        "candidates.csv": csv_bytes(candidate_table(found)),
        "best.toml": best_scenario(found).to_toml(),
    }
    if front is not None:
        contents["front.csv"] = csv_bytes(front.table)
    write_files(folder, contents)
    write_code(folder, scenarios, search.study.motion, search.settings.method, *choices)
