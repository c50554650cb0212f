"""A search written down: a page, numbers as CSV and JSON, the winner as a scenario.

report.html      all of it to be read, see ``page``; with its pictures, unless none were asked for
result.json      believed, true and the difference, the starts beside it, runs, failures
history.csv      a row an iteration: best, mean, personal bests, mean of each field (as itself and between bounds)
candidates.csv   a row a candidate: its values, runs, failures, scores
best.toml        the winner's scenario; ``vibroswarm run --scenario`` takes it
front.csv        with several objectives: the candidates that none beats in all, believed and true

Of a grid: ``report.html``, ``grid.csv``, ``result.json``, ``best.toml`` (the lowest cell), ``grid.toml`` (itself).
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.csv_text import csv_bytes
from vibroswarm.errors import InputError, RunError
from vibroswarm.files import whole_file
from vibroswarm.optimize.fronts import Front
from vibroswarm.optimize.grid import Nodes
from vibroswarm.optimize.journal import HEAD
from vibroswarm.optimize.loop import Found
from vibroswarm.optimize.page import file_text, search_page
from vibroswarm.optimize.page_grid import grid_page
from vibroswarm.optimize.truth import Truth
from vibroswarm.page.report import write_report as write_page
from vibroswarm.plots import Picture, draw_front, draw_heat, draw_parameters, draw_search
from vibroswarm.plots.palette import SERIES_UP_TO
from vibroswarm.scenario import Scenario
from vibroswarm.simulation import versions
from vibroswarm.study.store import Store

REPORT: Final = "report.html"
IN_PAGE: Final = ("column", "page")
"""Styles of a page's pictures: those of a search stand two in a row, a front by itself."""


def best_scenario(found: Found) -> Scenario:
    """The search's first scenario with the values of the winner of ``found``."""
    return found.search.cases[0].scenario.with_values(found.values)


def history_table(found: Found) -> pl.DataFrame:
    """One row an iteration of the search, then of the race."""
    rows = []
    space = found.search.space
    for stage, history in (("search", found.history), ("race", found.race)):
        for one in history:
            row: dict[str, Any] = {
                "stage": stage, "iteration": one.number, "runs": one.runs, "best": _finite(one.best),
                "mean": _finite(one.mean), "best_key": one.best_key,
            }  # fmt: skip
            for name, value, share in zip(
                space.names, space.values(np.array(one.mean_point)).values(), one.mean_point, strict=True
            ):
                row |= {f"mean {name}": value, f"mean {name}, of its bounds": share}
            row |= {f"personal {k}": _finite(score) for k, score in enumerate(one.personal)}
            rows.append(row)
    return pl.DataFrame(rows, infer_schema_length=None)


def candidate_table(found: Found) -> pl.DataFrame:
    """One row a candidate."""
    rows = []
    for c in found.archive.candidates:
        row: dict[str, Any] = {"key": c.key, "origin": c.origin, **c.values}
        row |= {"runs": c.count, "failed": c.failed}
        for k, objective in enumerate(found.search.objectives):
            row[f"score {objective.words}" if k else "score"] = _finite(found.archive.score(c.key, k))
        rows.append(row)
    return pl.DataFrame(rows, infer_schema_length=None)


def pictures(found: Found, truth: Truth | None, style: str = "column") -> dict[str, Picture]:
    """How scores fell (personal bests, best, mean), and the mean of each field between its bounds, by name."""
    objective, space = found.search.objectives[0], found.search.space
    history = found.history
    label = f"cost ({objective.words})" + (f", {objective.unit}" if objective.unit else "")
    scores = pl.DataFrame(
        {
            "iteration": [one.number for one in history],
            "best": [_finite(one.best) for one in history],
            "mean": [_finite(one.mean) for one in history],
        },
        schema={"iteration": pl.Int64, "best": pl.Float64, "mean": pl.Float64},
    )
    rows = [(one.number, k, _finite(s)) for one in history for k, s in enumerate(one.personal)]
    own = pl.DataFrame(rows, schema=["iteration", "particle", "score"], orient="row") if rows else None
    shares = [
        (one.number, name.rpartition(".")[2], share)
        for one in history
        for name, share in zip(space.names, one.mean_point, strict=True)
    ]
    parameters = pl.DataFrame(shares, schema=["iteration", "series", "share"], orient="row")
    true = None if truth is None else truth.winner.score.estimate
    return {
        "scores": draw_search(scores, own, label=label, true=true, style=style),
        "parameters": draw_parameters(parameters, style=style),
    }


def front_picture(front: Front, style: str = "column") -> Picture:
    """A front of two objectives, on fresh runs."""
    rows = [
        {
            "name": ", ".join(f"{name.rpartition('.')[2]} {_short(value)}" for name, value in member.values.items()),
            "time": first.estimate, "time_low": first.low, "time_high": first.high,
            "error": second.estimate, "error_low": second.low, "error_high": second.high, "front": member.stays,
        }
        for member in front.members
        for first, second in [member.true]
    ]  # fmt: skip
    first, second = (f"{n}, {u}" if u else n for n, u in zip(front.names, front.units, strict=True))
    return draw_front(pl.DataFrame(rows), time_label=first, error_label=second, style=style)


def as_dict(found: Found, truth: Truth | None, front: Front | None = None) -> dict[str, Any]:
    """What came of a search, as plain values for JSON."""
    search, archive = found.search, found.archive
    failures = sorted({c.why for c in archive.candidates if c.why})
    return {
        "method": search.settings.method,
        "objective": [o.as_values() for o in search.objectives],
        "seed": search.seed,
        "runs": {
            "search": found.runs,
            "failed": archive.failed,
            "failed_because": failures[:5],
            "candidates": len(archive),
            "fresh": _fresh(truth, front),
        },
        "best": found.values,
        "believed": _finite(found.believed),
        "truth": None if truth is None else truth.as_dict(),
        "front": None if front is None else front.as_dict(),
    }


def _fresh(truth: Truth | None, front: Front | None) -> int:
    of_winner = 0 if truth is None else truth.winner.rows.shape[0] * (1 + len(truth.others))
    return of_winner + (0 if front is None else front.runs * len(front.members))


def write_report(
    found: Found,
    truth: Truth | None,
    folder: str | Path,
    style: str | None = "column",
    front: Front | None = None,
) -> None:
    """Keep what was ``found``, the ``truth`` of it and the ``front`` in ``folder``.

    Pictures are in a ``style`` of ``plots``; None: none.

    Raises:
        RunError: it cannot be written.
    """
    folder = Path(folder)
    tables = {"history.csv": history_table(found), "candidates.csv": candidate_table(found)}
    if front is not None:
        tables["front.csv"] = front.table
    texts = {
        "result.json": json.dumps(as_dict(found, truth, front), indent=2, allow_nan=False) + "\n",
        "best.toml": best_scenario(found).to_toml(),
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, table in tables.items():
            with whole_file(folder / name) as part:
                part.write_bytes(csv_bytes(table))
        for name, text in texts.items():
            with whole_file(folder / name) as part:
                part.write_text(text, encoding="utf-8")
        shown = {}
        if style is not None:
            for name, picture in _all_pictures(found, truth, front, (style, style)).items():
                picture.write(folder / name)
            shown = _all_pictures(found, truth, front, IN_PAGE)
        write_page(folder / REPORT, search_page(found, truth, front, shown, made_by(folder)))
    except OSError as error:
        raise RunError(f"could not write '{folder}': {error.strerror or error}") from error


def _all_pictures(
    found: Found, truth: Truth | None, front: Front | None, styles: tuple[str, str]
) -> dict[str, Picture]:
    """Those that can be drawn: of no more fields than can be told apart, and of fronts of two objectives."""
    drawn = pictures(found, truth, styles[0]) if found.search.space.size <= SERIES_UP_TO else {}
    if front is not None and len(front.names) == 2:
        drawn["true-front"] = front_picture(front, styles[1])
    return drawn


def made_by(folder: Path) -> list[dict[str, str]]:
    """The versions that began the search in a folder, where there is one, and those of now if they are others."""
    try:
        began = dict(json.loads((folder / HEAD).read_text(encoding="utf-8"))["versions"])
    except (OSError, ValueError, KeyError, TypeError):
        return [versions()]
    return [began] if began == versions() else [began, versions()]


def write_grid(
    nodes: Nodes, folder: str | Path, style: str | None = "column", truth: Truth | None = None
) -> None:
    """The cells of a grid as ``grid.csv`` and ``result.json``; with two varied fields also as pictures.

    Raises:
        RunError: it cannot be written.
    """
    folder = Path(folder)
    texts = {
        "result.json": json.dumps(nodes.as_dict(truth), indent=2, allow_nan=False) + "\n",
        "best.toml": nodes.best.cell.scenario.to_toml(),
    }
    if text := file_text(nodes.grid):
        texts["grid.toml"] = text
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with whole_file(folder / "grid.csv") as part:
            part.write_bytes(csv_bytes(nodes.table))
        for name, text in texts.items():
            with whole_file(folder / name) as part:
                part.write_text(text, encoding="utf-8")
        shown = {}
        if style is not None:
            for name, picture in grid_pictures(nodes, style).items():
                picture.write(folder / name)
            shown = grid_pictures(nodes)
        write_page(folder / REPORT, grid_page(nodes, truth, shown, _grid_made_by(folder)))
    except OSError as error:
        raise RunError(f"could not write '{folder}': {error.strerror or error}") from error


def _grid_made_by(folder: Path) -> list[dict[str, str]]:
    """The versions of the study's shards in a folder; those of now where there is no study."""
    try:
        return Store.open(folder).made_by
    except InputError:
        return [versions()]


def grid_pictures(nodes: Nodes, style: str = "column") -> dict[str, Picture]:
    """The cells by name as heat maps: score, time, belief; none unless two fields are varied."""
    varied, table = nodes.grid.study.varied, nodes.table
    if len(varied) != 2:
        return {}
    labels = {
        "score": f"cost ({nodes.grid.objective.words})",
        "decision_time_s": "decision time (s)",
        "belief_in_truth": "belief in the truth",
    }
    x_label, y_label = (field.rpartition(".")[2] for field in varied)
    drawn = {}
    for name, label in labels.items():
        frame = table.select(x=varied[0], y=varied[1], value=name, runs="runs")
        best = "high" if name == "belief_in_truth" else "low"
        drawn[f"grid-{name.replace('_', '-')}"] = draw_heat(
            frame, x_label=x_label, y_label=y_label, label=label, best=best, style=style
        )
    return drawn


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
