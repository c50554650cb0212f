"""Write the results of a search: a page, numbers as CSV and JSON, and the winner as a scenario.

report.html      the page, see ``search_page``; with pictures unless they are turned off
scores, ...      on request the same pictures as files (svg, pdf, png), with their numbers (csv)
result.json      believed and true score, the difference, the starts, runs, failures
history.csv      a row for each iteration: best, mean, personal bests, mean of each field (value and fraction)
candidates.csv   a row for each candidate: its values, runs, failures, scores
best.toml        the winner's scenario, for ``vibroswarm run --scenario``
front.csv        with several objectives: the Pareto front, believed and true scores

For a grid: ``report.html``, ``grid.csv``, ``result.json``, ``best.toml`` (the lowest cell), ``grid.toml`` (itself).
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.intervals import plain
from vibroswarm.core.atomic_io import write_files
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError
from vibroswarm.optimize.grid import Nodes
from vibroswarm.optimize.grid_page import grid_page
from vibroswarm.optimize.journal import HEAD
from vibroswarm.optimize.loop import Found
from vibroswarm.optimize.search_page import file_text, search_page
from vibroswarm.optimize.validation import Front, Truth
from vibroswarm.plots import Picture, draw_front, draw_heat, draw_parameters, draw_search
from vibroswarm.plots.labels import label_of, setting_words
from vibroswarm.plots.style import SERIES_UP_TO
from vibroswarm.report.html import write_report as write_page
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import versions
from vibroswarm.study.store import Store

REPORT: Final = "report.html"
PICTURES: Final = ("scores.svg", "true-front.svg", "grid-score.svg")
"""A folder with pictures as files has at least one of these."""
Styles = tuple[str, str]
"""Styles of ``plots`` in which pictures are drawn: of the pictures of the iterations, and of the front."""
IN_PAGE: Final[Styles] = ("column", "page")
"""Styles in the page, where the pictures of the iterations stand side by side, and the front alone."""


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


def pictures(found: Found, truth: Truth | None, style: str = "column") -> dict[str, Picture]:
    """Draw two pictures over the iterations of a search, and return them by name.

    "scores" shows the best score so far and the mean score of each iteration, the scores of the personal bests of a
    particle swarm, and the true score as a line if ``truth`` is given. "parameters" shows the mean of each field over
    the candidates of an iteration, as a fraction of the field's bounds. ``style`` is that of both pictures, see
    ``plots``.
    """
    objective, space = found.search.objectives[0], found.search.space
    history = found.history
    label = f"cost ({objective.words})" + (f", {objective.unit}" if objective.unit else "")
    scores = pl.DataFrame(
        [(iteration.number, plain(iteration.best), plain(iteration.mean)) for iteration in history],
        schema={"iteration": pl.Int64, "best": pl.Float64, "mean": pl.Float64},
        orient="row",
    )
    rows = [
        (iteration.number, k, plain(s)) for iteration in history for k, s in enumerate(iteration.personal)
    ]
    # scores of the personal bests; only a particle swarm has them
    personal = pl.DataFrame(rows, schema=["iteration", "particle", "score"], orient="row") if rows else None
    texts = [label_of(name).text for name in space.names]
    # Fields of two sections may have one name; they are then named in full.
    series = {
        name: text if texts.count(text) == 1 else name for name, text in zip(space.names, texts, strict=True)
    }
    shares = [
        (iteration.number, series[name], share)
        for iteration in history
        for name, share in zip(space.names, iteration.mean_point, strict=True)
    ]
    parameters = pl.DataFrame(shares, schema=["iteration", "series", "share"], orient="row")
    true = None if truth is None else truth.winner.score.estimate
    return {
        "scores": draw_search(scores, personal, label=label, true=true, style=style),
        "parameters": draw_parameters(parameters, style=style),
    }


def front_picture(front: Front, style: str = "column") -> Picture:
    """Draw the scores on fresh runs of a front of two objectives.

    ``draw_front`` calls its axes time and error: the first objective is drawn as the time, the second as the error. The
    front has at least one candidate.
    """
    rows = [
        {
            "name": ", ".join(setting_words(name, value) for name, value in member.values.items()),
            "time": first.estimate, "time_low": first.low, "time_high": first.high,
            "error": second.estimate, "error_low": second.low, "error_high": second.high, "front": member.stays,
        }
        for member in front.members
        for first, second in [member.true]  # names the scores under both objectives
    ]  # fmt: skip
    first_label, second_label = (
        f"{name} ({unit})" if unit else name for name, unit in zip(front.names, front.units, strict=True)
    )
    return draw_front(pl.DataFrame(rows), time_label=first_label, error_label=second_label, style=style)


def as_dict(found: Found, truth: Truth | None, front: Front | None = None) -> dict[str, Any]:
    """Return the results of a search as plain values for JSON.

    Args:
        found: the result of the search. truth: the winner and the starts on fresh runs, if they were scored.
        front: the Pareto front on fresh runs, with several objectives.
    """
    search, archive = found.search, found.archive
    reasons = sorted({c.why for c in archive.candidates if c.why})
    return {
        "method": search.settings.method,
        "objective": [o.as_values() for o in search.objectives],
        "seed": search.seed,
        "runs": {
            "search": found.runs,
            "failed": archive.failed,
            "failed_because": reasons[:5],  # a few examples
            "candidates": len(archive),
            "fresh": _fresh(truth, front),
        },
        "best": found.values,
        "believed": plain(found.believed),
        "truth": None if truth is None else truth.as_dict(),
        "front": None if front is None else front.as_dict(),
    }


def _fresh(truth: Truth | None, front: Front | None) -> int:
    """Count the fresh runs, failed ones included, of the winner, of the others that were scored, and of the front."""
    scored = () if truth is None else (truth.winner, *truth.others)
    of_scored: int = sum(one.rows.shape[0] + one.failed for one in scored)
    return of_scored + (0 if front is None else front.runs * len(front.members))


def write_report(
    found: Found,
    truth: Truth | None,
    folder: str | Path,
    style: str | None = None,
    front: Front | None = None,
    *,
    with_pictures: bool = True,
) -> None:
    """Write the files of a search (see the head of this module) and its page.

    Args:
        found: the result of the search. truth: the winner and the starts on fresh runs, if they were scored.
        folder: where to write. style: of the picture files, see ``plots``; they are not written if it is None.
        front: the Pareto front on fresh runs, with several objectives.
        with_pictures: whether the page has pictures, which do not depend on ``style``.
    Raises:
        RunError: a file cannot be written.
    """
    folder = Path(folder)
    contents: dict[str, str | bytes] = {
        "history.csv": csv_bytes(history_table(found)),
        "candidates.csv": csv_bytes(candidate_table(found)),
        "result.json": _json(as_dict(found, truth, front)),
        "best.toml": best_scenario(found).to_toml(),
    }
    if front is not None:
        contents["front.csv"] = csv_bytes(front.table)
    write_files(folder, contents)

    def drawn(styles: Styles) -> dict[str, Picture]:
        return _all_pictures(found, truth, front, styles)

    _write_pictures(folder, style, drawn)
    drawn_for_page = drawn(IN_PAGE) if with_pictures else {}
    write_page(folder / REPORT, search_page(found, truth, front, drawn_for_page, made_by(folder)))


def _write_pictures(folder: Path, style: str | None, draw: Callable[[Styles], dict[str, Picture]]) -> None:
    """Write the pictures that ``draw`` returns by name as files into a folder, all in one style; None: no files."""
    if style is not None:
        for name, picture in draw((style, style)).items():
            picture.write(folder / name)


def _json(values: Any) -> str:
    return json.dumps(values, indent=2, allow_nan=False) + "\n"


def _all_pictures(
    found: Found, truth: Truth | None, front: Front | None, styles: Styles
) -> dict[str, Picture]:
    """Draw the pictures of a search by name: those of the iterations, and the front of two objectives.

    The pictures of the iterations are left out if the space has more fields than a picture can distinguish. The picture
    of the front is left out without a front, and with more than two objectives.
    """
    style_of_iterations, style_of_front = styles
    drawn = pictures(found, truth, style_of_iterations) if found.search.space.size <= SERIES_UP_TO else {}
    if front is not None and len(front.names) == 2:
        drawn["true-front"] = front_picture(front, style_of_front)
    return drawn


def made_by(folder: Path) -> list[dict[str, str]]:
    """Return the versions of the programs that began the search in a folder, and the current ones if they differ.

    If the folder has no readable head of a search, return the current versions only.
    """
    try:
        began = dict(json.loads((folder / HEAD).read_text(encoding="utf-8"))["versions"])
    except (OSError, ValueError, KeyError, TypeError):
        return [versions()]
    return [began] if began == versions() else [began, versions()]


def write_grid(
    nodes: Nodes,
    folder: str | Path,
    style: str | None = None,
    truth: Truth | None = None,
    *,
    with_pictures: bool = True,
) -> None:
    """Write the files of a grid (see the head of this module) and its page.

    There are pictures if the grid has two fields.

    Args:
        nodes: the scored cells. folder: where to write.
        style: of the picture files, see ``plots``; they are not written if it is None.
        truth: the lowest cell on fresh runs, if it was scored on them.
        with_pictures: whether the page has pictures, which do not depend on ``style``.
    Raises:
        RunError: a file cannot be written.
    """
    folder = Path(folder)
    contents: dict[str, str | bytes] = {
        "grid.csv": csv_bytes(nodes.table),
        "result.json": _json(nodes.as_dict(truth)),
        "best.toml": nodes.best.cell.scenario.to_toml(),
    }
    if text := file_text(nodes.grid):
        contents["grid.toml"] = text
    write_files(folder, contents)

    def drawn(styles: Styles) -> dict[str, Picture]:
        return grid_pictures(nodes, styles[0])  # a grid has no front, which has the second style

    _write_pictures(folder, style, drawn)
    drawn_for_page = drawn(IN_PAGE) if with_pictures else {}
    write_page(folder / REPORT, grid_page(nodes, truth, drawn_for_page, _grid_made_by(folder)))


def _grid_made_by(folder: Path) -> list[dict[str, str]]:
    """Return the versions of the programs that ran the study of a grid, one entry for each set of versions.

    If the folder holds no study, since the grid was not saved there, these are the current versions.
    """
    try:
        return Store.open(folder).made_by
    except InputError:
        return [versions()]


def grid_pictures(nodes: Nodes, style: str = "column") -> dict[str, Picture]:
    """Draw score, decision time and belief over the two varied fields as heat maps, and return them by name.

    The first varied field is x, the second y. If the grid does not vary exactly two fields, the result is empty.
    """
    varied, table = nodes.grid.study.varied, nodes.table
    if len(varied) != 2:
        return {}
    labels = {
        "score": f"cost ({nodes.grid.objective.words})",
        "decision_time_s": "decision time (s)",
        "belief_in_truth": "belief in the truth",
    }
    x_label, y_label = (label_of(field).text for field in varied)
    drawn = {}
    for name, label in labels.items():
        frame = table.select(x=varied[0], y=varied[1], value=name, runs="runs")
        best = "high" if name == "belief_in_truth" else "low"  # which end of the values is better
        drawn[f"grid-{name.replace('_', '-')}"] = draw_heat(
            frame, x_label=x_label, y_label=y_label, label=label, best=best, style=style
        )
    return drawn
