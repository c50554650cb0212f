"""Methods other than the swarm: known optima, the account of runs, continuing."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers import search_functions as functions
from vibroswarm.search.loop import run_search
from vibroswarm.search.methods import Archive, Stage, method
from vibroswarm.search.objective import Objective
from vibroswarm.search.searched import candidate_table
from vibroswarm.search.space import Space
from vibroswarm.search.spec import Search
from vibroswarm.search.validation import front_of

pytest.importorskip("optuna")
GP = ("gp",) if importlib.util.find_spec("torch") else ()
SMALL = """
seed = 3
[scenario]
preset = "paper"
[scenario.run]
t_end_s = 60.0
[scenario.swarm]
robots = 2
[space]
"sample.sample_interval_ms" = { from = 1000, to = 6000, scale = "log" }
"decision.min_observations" = { from = 0, to = 60 }
"strategy.name" = ["none", "positive"]
[search]
budget = 160
final = 60
finalists = 3
evaluations = 2
"""


def made(name: str, archive: Archive, budget: int) -> Stage:
    search = Search(space=Space.of(functions.BOWL)).with_settings(
        method=name, evaluations=1, final=0, budget=budget
    )
    search = replace(search, objectives=archive.objectives)
    return method(name).begin(archive, search)


@pytest.mark.parametrize(
    ("name", "near"),
    [("random", 0.02), ("sobol", 0.02), ("tpe", 0.002), ("cmaes", 1e-4), *((gp, 1e-3) for gp in GP)],
)
def test_the_optimum_of_a_bowl_is_found(name: str, near: float) -> None:
    archive = functions.archive_for()
    budget = 60 if name == "gp" else 300  # it takes its time, and needs few
    stage = made(name, archive, budget)
    assert functions.drive(stage, archive, functions.sphere) == budget
    assert functions.sphere(archive[stage.best()].point) < near
    assert stage.history[-1].best == pytest.approx(functions.sphere(archive[stage.best()].point))


def test_a_front_is_found() -> None:
    """Two bowls: what none beats lies on the line between their optima."""
    archive = functions.archive_for(objectives=2)

    def both(u: Any) -> Any:
        return np.array([((u - 0.2) ** 2).sum(), ((u - 0.8) ** 2).sum()])

    stage = made("nsga2", archive, 600)
    functions.drive(stage, archive, both)
    front = archive.front()
    assert len(front) >= 10
    off = [np.ptp(archive[key].point) for key in front]
    assert float(np.median(off)) < 0.25
    assert float(np.median([np.ptp(c.point) for c in archive.candidates[:24]])) > 0.35  # the control
    scores = [archive.scores(key) for key in front]
    assert all(a[0] <= b[0] and a[1] >= b[1] for a, b in pairwise(scores))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["random", "sobol", "tpe", "cmaes", "nsga2", *GP])
def test_every_method_keeps_its_account_and_continues(tmp_path: Path, name: str) -> None:
    search = Search.from_toml(SMALL.replace("[search]", f'[search]\nmethod = "{name}"'))
    if name == "nsga2":
        search = replace(search, objectives=(Objective("decision_time", "mean"), Objective("errors", "mean")))
        search = search.with_settings(budget=100)
    whole = run_search(search)
    assert whole.archive.runs == search.budget

    def stop(runs: int, best: float) -> None:
        if runs > 50:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_search(search, tmp_path, progress=stop)
    again = run_search(search, tmp_path)
    assert candidate_table(again).equals(candidate_table(whole))
    assert again.best == whole.best
    if name == "nsga2":
        front = front_of(whole)
        assert front is not None
        assert front["key"].to_list() == (keys := whole.archive.front())
        assert front["runs"].to_list() == [max(2000 // len(keys), 200)] * len(keys)
