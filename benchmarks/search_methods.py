"""Which method should a user take? True score reached against runs spent, 20 seeds each, on a landscape that is known.

    python benchmarks/search_methods.py --seeds 20
    python benchmarks/search_methods.py --seeds 3 --simulated       with the simulation itself, scored on fresh runs

The made-up cost of a run is a gamma variate of shape 1/2 (standard deviation 1.4 times its mean, like the paper's cost)
times a level that rises from 1 at the optimum; scores are given as multiples of the best there is. All methods have the
same account: so many runs, two fifths of them in the race of the finalists.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any

import numpy as np

from vibroswarm.search.archive import Archive
from vibroswarm.search.loop import run_search, stage_of
from vibroswarm.search.methods import Stage
from vibroswarm.search.objective import Objective
from vibroswarm.search.pso import PsoSettings
from vibroswarm.search.race import Race
from vibroswarm.search.response_surface import optima
from vibroswarm.search.spec import Search, SearchSettings
from vibroswarm.search.validation import truth_of
from vibroswarm.study.spec import Study

OPTIMUM = np.array([0.35, 1.0, 1.0, 0.0, 1.0])
WEIGHTS = np.array([0.1, 0.3, 0.5, 0.2, 0.6])
WAVES = 0.3
SCORE_OF_1 = 0.5 + 0.5**0.5
"""Mean + standard deviation of the gamma variate."""


def bowl(u: np.ndarray[Any, Any]) -> float:
    return 1.0 + float((WEIGHTS * np.abs(u - OPTIMUM) ** 1.5).sum())


def waves(u: np.ndarray[Any, Any]) -> float:
    """The bowl with ridges and further valleys."""
    wave = np.sin(5 * u[0]) * np.cos(4 * u[1]) + 0.5 * abs(u[2] - u[4])
    return bowl(u) + WAVES * (1.0 + float(wave))


LANDSCAPES = {"bowl": (bowl, 1.0), "waves": (waves, 1.0454)}


def search_of(method: str, budget: int, seed: int, **settings: Any) -> Search:
    pso = PsoSettings(noise="fixed") if method == "pso, the paper's way" else PsoSettings()
    name = "pso" if method.startswith("pso") else method.split()[0]
    return Search(
        Study(seed=seed), settings=SearchSettings(method=name, budget=budget, **settings), pso=pso, start=()
    )


def made_up(method: str, budget: int, seed: int, landscape: str, **settings: Any) -> tuple[float, float]:
    """The winner's true level over the best there is, and what was believed over what is true."""
    level, best = LANDSCAPES[landscape]
    search = replace(search_of(method, budget, seed, **settings), objectives=(Objective("intended"),))
    archive = Archive(search.space, search.objectives)
    random = np.random.Generator(np.random.Philox(seed))

    def drive(stage: Stage) -> None:
        while asks := stage.ask():
            for ask in asks:
                candidate = archive[ask.key]
                candidate.rows.append(level(candidate.point) * random.gamma(0.5, 1.0, (ask.runs, 1, 1)))
                candidate.count += ask.runs
            stage.tell()

    first = stage_of(search, archive)
    drive(first)
    if not search.final_runs:
        key = first.best()
        believed = first.history[-1].best
    else:
        points = optima(archive, range(len(archive)), seed) if search.settings.surface else []
        keys = first.finalists(search.settings.finalists - len(points))
        race = Race(archive, [*keys, *(archive.new(p, "surface") for p in points)], search.final_runs)
        drive(race)
        key = race.best()
        believed = archive.estimate(key)[0]
    true = level(archive[key].point)
    return true / best, believed / SCORE_OF_1 / true


def simulated(method: str, budget: int, seed: int, **settings: Any) -> tuple[float, float]:
    """The winner's score on fresh runs, and what was believed over it."""
    found = run_search(search_of(method, budget, seed, **settings))
    truth = truth_of(found, runs=2000)
    return truth.winner.score.estimate, truth.believed / truth.winner.score.estimate


METHODS: dict[str, dict[str, Any]] = {
    "pso, the paper's way": {},
    "pso": {},
    "pso without surface": {"surface": False},
    "random": {},
    "random without surface": {"surface": False},
    "sobol": {},
    "tpe": {},
    "cmaes": {},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--budgets", default="3000,15000")
    parser.add_argument("--simulated", action="store_true")
    arguments = parser.parse_args()
    for budget in (int(text) for text in arguments.budgets.split(",")):
        for landscape in ["simulation"] if arguments.simulated else list(LANDSCAPES):
            print(f"{landscape}, {budget:,} runs, {arguments.seeds} seeds: true score; believed / true")
            for method, settings in METHODS.items():
                score = []
                for seed in range(arguments.seeds):
                    if arguments.simulated:
                        score.append(simulated(method, budget, seed, **settings))
                    else:
                        score.append(made_up(method, budget, seed, landscape, **settings))
                true, believed = np.array(score).T
                error = true.std(ddof=1) / np.sqrt(true.size) if true.size > 1 else np.nan
                print(
                    f"  {method:<26} {true.mean():7.3f} +- {error:.3f} (worst {true.max():.3f});  "
                    f"{believed.mean():.2f} ({believed.min():.2f} to {believed.max():.2f})",
                    flush=True,
                )


if __name__ == "__main__":
    main()
