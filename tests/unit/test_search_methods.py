"""Methods other than the swarm: known optima, the account of runs, resuming."""

from __future__ import annotations

import importlib.util
import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from vibroswarm.documents.search import search_document

from helpers import search_functions as functions
from helpers.search_functions import steps_of
from vibroswarm.errors import InputError
from vibroswarm.search.archive import Archive
from vibroswarm.search.loop import Found, run_search
from vibroswarm.search.methods import Random, Sobol, Stage
from vibroswarm.search.objective import Objective
from vibroswarm.search.optuna_samplers import Cmaes, Gp, Nsga2, Tpe
from vibroswarm.search.search_files import candidate_table, write_search
from vibroswarm.search.spec import Search
from vibroswarm.search.validation import front_of
from vibroswarm.statistics.fronts import pareto_front

# Torch is too heavy for what `make test` sets up: with `pip install ".[gp]"` the Gaussian process is tested too.
GP = ("gp",) if importlib.util.find_spec("torch") else ()
LIBRARIES = ("tpe", "cmaes", "nsga2", *GP)
NEEDS = {"tpe": "optuna", "nsga2": "optuna", "gp": "torch", "cmaes": "cmaes"}
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


def need(name: str) -> None:
    """Skip where the library of a method is not there."""
    if name in NEEDS:
        pytest.importorskip(
            NEEDS[name],
            reason=f"method {name} needs {NEEDS[name]} (extra {'gp' if name == 'gp' else 'optimize'})",
        )


def made(name: str, archive: Archive, budget: int, starts: Any = ()) -> Stage:
    need(name)
    kinds = (Random, Sobol, Tpe, Gp, Cmaes, Nsga2)
    return {kind.name: kind for kind in kinds}[name](archive, 1, budget, 1, starts)


@pytest.mark.parametrize(
    ("name", "near"),
    [("random", 0.02), ("sobol", 0.02), ("tpe", 0.002), ("cmaes", 1e-5), *((gp, 1e-3) for gp in GP)],
)
def test_the_optimum_of_a_bowl_is_found(name: str, near: float) -> None:
    archive = functions.archive_for()
    budget = 60 if name == "gp" else 300  # it takes its time, and needs few
    method = made(name, archive, budget)
    assert functions.drive(method, functions.sphere) == budget
    assert functions.sphere(archive[method.best()].point) < near
    assert method.history[-1].best == pytest.approx(functions.sphere(archive[method.best()].point))


def test_a_front_is_found() -> None:
    """Two bowls: what none beats lies on the line between their optima."""
    archive = functions.archive_for(objectives=2)
    method = made("nsga2", archive, 600)

    def both(u: Any) -> Any:
        return np.array([((u - 0.2) ** 2).sum(), ((u - 0.8) ** 2).sum()])

    functions.drive(method, both)
    front = method.finalists(1000)
    assert len(front) >= 10
    off = [np.ptp(archive[key].point) for key in front]
    assert float(np.median(off)) < 0.25
    assert float(np.median([np.ptp(c.point) for c in archive.candidates[:24]])) > 0.35  # the control
    scores = [archive.scores(key) for key in front]
    assert all(a[0] <= b[0] and a[1] >= b[1] for a, b in pairwise(scores))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["random", "sobol", *LIBRARIES])
def test_every_method_keeps_its_account_and_resumes(tmp_path: Path, name: str) -> None:
    need(name)
    text = SMALL.replace("[search]", f'[search]\nmethod = "{name}"')
    search = Search.from_toml(text)
    if name == "nsga2":
        two = (Objective("decision_time", "mean"), Objective("errors", "mean"))
        search = replace(search.with_settings(final=None, budget=100), objectives=two)
    whole = run_search(search, tmp_path / "whole")
    assert whole.runs == 100 if name == "nsga2" else 150 <= whole.runs <= 160
    count = len(steps_of(tmp_path / "whole"))
    for done in sorted({1, count // 2, count}):
        run_again = Path(shutil.copytree(tmp_path / "whole", tmp_path / f"after {done}"))
        for name_of_step in list(steps_of(run_again))[done:]:
            (run_again / "steps" / name_of_step).unlink()
        again = run_search(search, run_again)
        assert candidate_table(again).equals(candidate_table(whole))
        assert (again.best, again.front) == (whole.best, whole.front)
    if name == "nsga2":
        assert not whole.race
        assert_front_is_scored_again(whole, tmp_path / "report")
    else:
        assert whole.race[-1].runs == whole.runs


def assert_front_is_scored_again(found: Found, folder: Path) -> None:
    front = front_of(found)
    assert front.runs == 2000 // len(found.front)
    assert [member.key for member in front.members] == list(found.front)
    for member in front.members:
        assert member.believed == tuple(found.archive.scores(member.key))
        assert all(score.low < score.estimate < score.high for score in member.true)
        assert all(score.n == front.runs for score in member.true)
    true = [[score.estimate for score in member.true] for member in front.members]
    assert [member.stays for member in front.members] == pareto_front(*zip(*true, strict=True)).tolist()
    assert front.too_little[0] == pytest.approx(
        np.median([1 - m.believed[0] / m.true[0].estimate for m in front.members])
    )
    write_search(found, folder, front)
    assert pl.read_csv(folder / "front.csv")["key"].to_list() == list(found.front)
    document = search_document(found, front=front)
    assert front.words in " ".join((*document.answer, *document.warnings))
    assert "true-front" in document.figures


def test_what_told_good_candidates_from_the_rest() -> None:
    pytest.importorskip("optuna")
    from vibroswarm.search.sensitivity import ped_anova

    text = SMALL.replace("budget = 160", 'method = "random"\nbudget = 460').replace(
        "evaluations = 2", "evaluations = 4"
    )
    search = Search.from_toml(text.replace("t_end_s = 60.0", "t_end_s = 200.0"))
    search = replace(search, objectives=(Objective("decision_time", "mean"),))
    found = run_search(search)
    shares = ped_anova(found, 0.2)
    assert sum(shares.values()) == pytest.approx(1.0)
    assert set(shares) == set(search.space.names)
    assert next(iter(shares)) != "strategy.name"  # two robots that know nothing of each other's decision
    with pytest.raises(InputError, match="not a share"):
        ped_anova(found, 2.0)
