"""The paper's search as its program ran it, against a small re-implementation that shares nothing but the chance."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from helpers import search_functions as functions
from vibroswarm.search import evaluate
from vibroswarm.search.loop import run_search
from vibroswarm.search.methods import Archive, chance
from vibroswarm.search.pso import Pso, PsoSettings, shared_run
from vibroswarm.search.space import Space
from vibroswarm.search.spec import Search

PARTICLES, ITERATIONS, EVALUATIONS, EXTRA, BEST = 6, 5, 4, 3, 2


def noisy(point: np.ndarray[Any, Any], run: int) -> float:
    """A cost whose noise depends on the number of the run alone, as a floor drawn by it."""
    wobble = math.sin(12.9898 * run) * 43758.5453
    return functions.sphere(point) + 0.2 * (wobble - math.floor(wobble))


def crashes(run: int, place: float) -> bool:
    return (run * 7 + int(1000 * place)) % 9 == 0


def by_hand(seed: int) -> tuple[list[np.ndarray[Any, Any]], float, int]:
    """Positions in each iteration, the score that wins, and crashed runs: velocity and inertia as stated."""
    random = chance(seed, "pso begins")
    x = random.random((PARTICLES, 3))
    v = np.zeros_like(x)
    best, best_score = x.copy(), [math.inf] * PARTICLES
    inertia = np.linspace(1.0, 0.4, ITERATIONS)
    where, dropped = [], 0
    for k in range(ITERATIONS):
        where.append(x.copy())
        costs: list[list[float]] = []
        for i in range(PARTICLES):
            runs = [r * (k + 1) for r in range(2, 2 + EVALUATIONS)]
            lost = [crashes(run, x[i, 0]) for run in runs]
            dropped += sum(lost)
            costs.append([noisy(x[i], run) for run, gone in zip(runs, lost, strict=True) if not gone])

        def score(own: list[float]) -> float:
            return float(np.mean(own) + np.std(own)) if own else math.inf

        order = sorted(range(PARTICLES), key=lambda i: (score(costs[i]), i))
        for i in order[:BEST]:
            for r in range(2 + EVALUATIONS, 2 + EVALUATIONS + EXTRA):
                run = r * (k + 1)
                if crashes(run, x[i, 0]):
                    dropped += 1
                else:
                    costs[i].append(noisy(x[i], run))
        for i in range(PARTICLES):
            if score(costs[i]) < best_score[i]:
                best[i], best_score[i] = x[i], score(costs[i])
        if k + 1 == ITERATIONS:
            break
        r_1, r_2 = chance(seed, f"pso {k + 2}").random((2, PARTICLES, 3))
        leader = best[int(np.argmin(best_score))]
        v = inertia[k] * v + 0.75 * r_1 * (best - x) + 0.75 * r_2 * (leader - x)
        x = np.clip(x + v, 0.0, 1.0)
    return where, min(best_score), dropped


def as_written(seed: int, noise: str = "as-ran") -> tuple[list[np.ndarray[Any, Any]], Pso, Archive]:
    """The same by our classes, with the function in place of the simulation."""
    archive = functions.archive_for("mean+sd")
    archive.drops_failed = True
    settings = PsoSettings(
        particles=PARTICLES, iterations=ITERATIONS, evaluations=EVALUATIONS, extra=EXTRA,
        extra_share=BEST / PARTICLES, noise=noise,
    )  # fmt: skip
    found = Pso(archive, seed, settings)
    where = []
    while asks := found.ask():
        if len(asks) == PARTICLES:
            where.append(found.position.copy())
        for ask in asks:
            one = archive[ask.key]
            runs = [shared_run(one.count + e, one.iteration) for e in range(ask.runs)]
            good = [noisy(one.point, run) for run in runs if not crashes(run, one.point[0])]
            archive.add(ask.key, np.reshape(good, (-1, 1, 1)), ask.runs - len(good), "crashed")
        found.tell()
    return where, found, archive


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_it_moves_and_scores_as_the_re_implementation(seed: int) -> None:
    where, score, dropped = by_hand(seed)
    found_where, found, archive = as_written(seed)
    np.testing.assert_allclose(found_where, where, atol=1e-14)
    assert found.history[-1].best == pytest.approx(score, abs=1e-12)
    assert archive.failed == dropped > 0
    # Control: the paper as printed moves otherwise, from the first move on.
    other = as_written(seed, noise="fixed")[0]
    np.testing.assert_allclose(other[0], where[0])
    assert np.abs(other[1] - where[1]).max() > 1e-3


def test_265_of_the_studys_500_seeds_are_distinct() -> None:
    settings = PsoSettings(noise="as-ran")
    runs = [shared_run(e, k) for k in range(settings.iterations) for e in range(settings.evaluations)]
    assert len(runs) == 500
    assert len(set(runs)) == 265


def small(**settings: Any) -> Search:
    bounds = {"walk.walk_duration_scale_ms": {"from": 0, "to": 20000}}
    pso = PsoSettings(particles=2, iterations=2, evaluations=3, extra=1, noise="as-ran", **settings)
    return Search(space=Space.of(bounds), pso=pso)


def test_a_search_counts_its_crashed_runs_and_still_has_a_winner(monkeypatch: pytest.MonkeyPatch) -> None:
    def piece(part: Any, objectives: Any) -> Any:
        return [(None, [float(run % 5)]) for run in part.runs]

    monkeypatch.setattr(evaluate, "do_piece", piece)
    found = run_search(small(crash_share=0.4))
    assert 0 < found.archive.failed < found.archive.runs == 14
    assert math.isfinite(found.believed)
    good = sum(len(rows) for one in found.archive.candidates for rows in one.rows)
    assert good == 14 - found.archive.failed
    # Control: elsewhere a candidate with a failed run cannot win.
    found.archive.drops_failed = False
    scores = [found.archive.score(key) for key in range(len(found.archive)) if found.archive[key].failed]
    assert scores
    assert all(math.isinf(score) for score in scores)
