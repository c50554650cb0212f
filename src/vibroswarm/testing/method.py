"""Checks of every method of search, each a function that yields what is wrong, in words; nothing if all is well.

The cost is made up: the squared distance from a point of the unit cube, with noise. Nothing is simulated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Final

import numpy as np

from vibroswarm.analysis.intervals import generator
from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.loop import requests_of, stage_of
from vibroswarm.optimize.methods import Ask, Stage, method
from vibroswarm.optimize.objective import Objective
from vibroswarm.optimize.spec import Search, SearchSettings
from vibroswarm.testing.runs import Finding, Pieces, require, run_checks, same_elsewhere

BUDGET: Final = 1200
"""Runs of a search; enough for four iterations of the paper's swarm."""
OPTIMUM: Final = 0.3
"""Each coordinate of the point at which the cost is lowest."""


def check_method(name: str) -> list[Finding]:
    """Run all checks of a registered method, and return their findings in order.

    Args:
        name: of the method, as in searches.
    """
    return run_checks(CHECKS, name, WARNINGS_ONLY)


def _search(name: str) -> Search:
    """Return a search with the method ``name`` over the paper's space."""
    count = 2 if method(name).several else 1
    costs = [Objective(cost, "mean") for cost in ("decision_time", "errors")]
    settings = SearchSettings(method=name, budget=BUDGET, final=0)
    return Search(objectives=tuple(costs[:count]), settings=settings, start=())


def _driven(name: str, fails: bool = False) -> tuple[Search, Stage, list[list[Ask]]]:
    """Run a method to its end; return the search, the method, and the requests of each step.

    Args:
        fails: whether every run of every third candidate fails.
    """
    search = _search(name)
    archive = Archive(search.space, search.objectives)
    stage, steps = stage_of(search, archive), list[list[Ask]]()
    while asks := requests_of(stage, method(name).code):
        steps.append(list(asks))
        require(len(steps) <= BUDGET, f"it has made {BUDGET} steps, and does not end")
        for ask in asks:
            point = archive[ask.key].point
            noise = generator(ask.key, "made-up cost").normal(
                0.0, 0.05, (ask.runs, 1, len(search.objectives))
            )
            rows = float(((point - OPTIMUM) ** 2).sum()) + noise
            archive.add_runs(ask.key, "made up" if fails and ask.key % 3 == 0 else rows, ask.runs)
        stage.tell()
    return search, stage, steps


def _account(name: str) -> Iterator[str]:
    """Check that the method requests at least half of its budget, and no more than all of it."""
    search, _, steps = _driven(name)
    runs = sum(ask.runs for asks in steps for ask in asks)
    if not search.search_budget <= 2 * runs <= 2 * search.search_budget:
        yield f"it requests {runs} runs; its budget is {search.search_budget}"


def _requests(name: str) -> tuple[list[list[Ask]], list[list[float]]]:
    """Return the requests of each step, and the points of all candidates."""
    _, stage, steps = _driven(name)
    return steps, [candidate.point.tolist() for candidate in stage.archive.candidates]


def _same_again(name: str) -> Iterator[str]:
    """Check that the same results lead to the same requests, as resuming a search requires."""
    if _requests(name) != _requests(name):
        yield "it requests other runs at a second time; draw random numbers from self.random() only"


def _pieces(name: str) -> Pieces:
    return {"a search": partial(_requests, name)}


def _ranks(name: str) -> Iterator[str]:
    """Check that the best candidate and the finalists are candidates with runs."""
    _, stage, _ = _driven(name)
    count = 3
    keys = stage.finalists(count)
    if not 0 < len(keys) <= count:
        yield f"of {count} finalists it returns {len(keys)}"
    for key in [stage.best(), *keys]:
        if not stage.archive[key].count:
            yield f"it ranks candidate {key}, which has no runs"


def _bears_failures(name: str) -> Iterator[str]:
    """Check that the method goes on if runs fail, and ranks no candidate with failed runs first."""
    _, stage, _ = _driven(name, fails=True)
    if stage.archive[stage.best()].failed:
        yield "it ranks a candidate first whose runs failed"


def _learns(name: str) -> Iterator[str]:
    """Check that the last fifth of the candidates is better on average than the first."""
    _, stage, _ = _driven(name)
    far = [float(((c.point - OPTIMUM) ** 2).sum()) for c in stage.archive.candidates]
    fifth = max(len(far) // 5, 1)
    if np.mean(far[-fifth:]) >= np.mean(far[:fifth]):
        yield "its last candidates are no better than its first"


CHECKS: Final[dict[str, Callable[[str], Iterator[str]]]] = {
    "it requests runs until its budget is spent": _account,
    "the same results lead to the same requests": _same_again,
    "the same in another process": partial(same_elsewhere, "method", _pieces),
    "it ranks candidates that have runs": _ranks,
    "it goes on if runs fail": _bears_failures,
    "it learns": _learns,
}
"""All checks of a method, in order, by what each requires."""
WARNINGS_ONLY: Final = ("it learns",)
"""Checks whose failure is not an error."""
