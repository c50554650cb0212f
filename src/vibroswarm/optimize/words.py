"""A search or a grid from the words of ``vibroswarm optimize``, so that Python runs the same with the same words::

searched(search_of(method="tpe", budget=5000), Path("out"))
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from vibroswarm.core.stages import SILENT, Stages
from vibroswarm.errors import InputError, whole_number_of
from vibroswarm.optimize.grid import FRESH, Grid, Nodes, scores_of, truth_of_grid
from vibroswarm.optimize.loop import Found, run_search
from vibroswarm.optimize.methods import SearchProgress
from vibroswarm.optimize.objective import Objective
from vibroswarm.optimize.search_files import made_by, write_grid, write_search
from vibroswarm.optimize.spec import Search
from vibroswarm.optimize.validation import Front, Truth, validated
from vibroswarm.scenario import plugins
from vibroswarm.study.run import run as run_study
from vibroswarm.study.runner import StudyProgress
from vibroswarm.study.scenario_words import CHOOSES_PLACES, OF_PLACES, chosen, refuse_without_effect
from vibroswarm.study.spec import Study


def search_of(
    file: Path | None = None,
    /,
    *,
    method: str | None = None,
    noise: str | None = None,
    cost: str | None = None,
    budget: int | None = None,
    fresh: int | None = None,
    seed: int | None = None,
    runs: int | None = None,
) -> Search:
    """Return the search of a file, or else the default search, changed by words.

    Args:
        cost: replaces all objectives by a single one, which keeps two settings of the first: its statistic, and whether
            the score is that of the worst case or the mean over cases (``over``).
        runs: only for a grid, and refused here.
    Raises:
        InputError: a word or the file is wrong.
    """
    if runs is not None:
        raise InputError("needs --method grid; a search has a --budget", field="--runs")
    method = None if method is None else chosen("method", method)
    # Reading checks how these words fit the other entries of the file; no entries are the default search.
    words: dict[str, Any] = {"method": method, "cost": cost, "budget": budget, "noise": noise}
    search = Search.from_toml("", **words) if file is None else Search.read(file, **words)
    if noise is not None and (method or search.settings.method) != "pso":
        raise InputError("applies to the method pso only", field="--noise")
    _refuse_without_effect(search)
    return replace(
        search,
        study=search.study if seed is None else replace(search.study, seed=seed),
        settings=search.settings if fresh is None else replace(search.settings, fresh=fresh),
    )


def _refuse_without_effect(search: Search) -> None:
    """Refuse fields, of the space or varied by the cases, of entries that neither the cases nor the space select."""
    varied = {*search.study.varied, *search.space.names}
    selected = {kind for kind in plugins.KINDS if plugins.field_of(kind) in search.space.names}
    fields = sorted(field for field in varied if field.partition(".")[0] not in selected)
    if not set(CHOOSES_PLACES).isdisjoint(search.space.names):
        fields = [field for field in fields if not OF_PLACES.fullmatch(field)]
    if "strategy.name" in search.space.names:
        fields = [field for field in fields if field != "decision.revise"]
    refuse_without_effect(fields, (cell.scenario for cell in search.cases))


def check_budgeted(search: Search) -> None:
    """Refuse a search whose file has a number of runs, which only a grid and comparisons of scenarios read.

    Raises:
        InputError: it has one.
    """
    if search.study.runs != Study().runs:
        raise InputError(
            "is for grids (--method grid); a search has a budget of runs, search.budget", field="runs"
        )


def grid_of(
    file: Path | None = None,
    /,
    *,
    cost: str | None = None,
    fresh: int | None = None,
    seed: int | None = None,
    runs: int | None = None,
    **others: Any,
) -> tuple[Grid, int]:
    """Return the grid of a file, or else the paper's, changed by words, and the number of its fresh runs.

    Args:
        cost: replaces the grid's objective by one with default statistic and parameters, even if the file has others.
        others: words of a search, of which a grid takes the method only.
    Raises:
        InputError: a word or the file is wrong.
    """
    for name, value in others.items():
        if value is not None and name != "method":
            raise InputError("does not apply to a grid", field=f"--{name}")
    grid = Grid.paper() if file is None else Grid.read(file)
    grid.study.check_effects()
    study = grid.study if runs is None else grid.study.with_runs(runs)
    command = "optimize --method grid"
    study = replace(study, seed=study.seed if seed is None else seed, command=command)
    fresh = FRESH if fresh is None else fresh
    fresh = whole_number_of(fresh, "--fresh", 2, 10**9)
    return Grid(study, grid.objective if cost is None else Objective(cost)), fresh


def searched(
    search: Search,
    folder: Path | None = None,
    *,
    progress: Callable[[SearchProgress], None] = lambda state: None,
    stages: Stages = SILENT,
    mixed: bool = False,
    **where: Any,
) -> tuple[Found, Truth | None, Front | None, list[dict[str, str]]]:
    """Run a search, score its winner or its Pareto front on fresh runs, and write its files.

    Args:
        folder: where it is saved, and continued; None: nowhere. progress: told the state of the search. stages: told
            how many fresh runs are done. mixed, where: as of ``run_search``.
    Returns: the search; its winner on fresh runs, None with several objectives; the Pareto front on fresh runs, None
        with one objective; and what made the folder, empty without one.
    Raises:
        InputError: the search or the folder is wrong.
    """
    check_budgeted(search)
    found = run_search(search, folder, progress=progress, mixed=mixed, **where)
    truth, front = validated(found, folder, counting(stages), **where)
    if folder is not None:
        write_search(found, folder, front)
    return found, truth, front, [] if folder is None else made_by(folder)


def grid_searched(
    grid: Grid,
    fresh: int = FRESH,
    folder: Path | None = None,
    *,
    stages: Stages = SILENT,
    mixed: bool = False,
    **where: Any,
) -> tuple[Nodes, Truth, list[dict[str, str]]]:
    """Run a grid, score its cell of lowest cost on fresh runs, and write its files; as ``searched`` does.

    Returns: the cells; the best one on fresh runs; and what made the folder, empty without one.
    """
    with stages.runs("simulating") as progress:
        result = run_study(grid.study, folder, progress=progress, mixed=mixed, **where)
    nodes = scores_of(grid, result)
    with stages.runs("scoring on fresh runs") as progress:
        truth = truth_of_grid(nodes, fresh, progress=progress, **where)
    if folder is not None:
        write_grid(nodes, folder)
    return nodes, truth, [] if folder is None else made_by(folder)


def counting(stages: Stages) -> Callable[[str, int], AbstractContextManager[Callable[[int], None]]]:
    """Return a function that begins a stage, given its name and number of runs; a stage takes how many are done."""

    @contextmanager
    def stage(what: str, runs: int) -> Iterator[Callable[[int], None]]:
        with stages.runs(what) as progress:
            # How many runs failed is not known here; the results report it.
            yield lambda done: progress(StudyProgress(done=done, wanted=runs, failed=0))

    return stage
