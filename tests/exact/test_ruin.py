"""One robot that decides by a lead of ten readings is a gambler, whose ruin has a closed form."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.ruin import ruin
from vibroswarm import preset, simulate
from vibroswarm.strategies import register
from vibroswarm.strategies.base import forget

LEAD, ONE = 10, 0.57


def test_samples_and_errors_are_those_of_the_gamblers_ruin() -> None:
    register(ruin)
    wrong = 1 / (1 + (ONE / (1 - ONE)) ** LEAD)
    samples = LEAD * (1 - 2 * wrong) / (2 * ONE - 1)
    assert (samples, wrong) == (pytest.approx(63.4, abs=0.05), pytest.approx(0.0563, abs=5e-5))
    values = {
        "swarm.robots": 1, "floor.source": "random:0.6", "run.t_end_s": 4000.0, "decision.min_observations": 0,
        "sensor.model": "confusion", "sensor.confusion.kinds": 2, "strategy.name": "ruin",
        "sensor.confusion.rates": [[1 - ONE, ONE], [1 - ONE, ONE]],
    }  # fmt: skip
    result = simulate(preset("paper").with_values(values), seed=1, runs=2000, energies=False)
    robots = result.robots
    assert (robots["decision"] >= 0).all()
    joined = result.motion.join(robots.select("run", "decision_time_s"), on="run")
    counts = (
        joined.filter(joined["time_s"] <= joined["decision_time_s"]).group_by("run").len()["len"].to_numpy()
    )
    missed = (robots["decision"] == 0).to_numpy()
    for found, exact in ((counts, samples), (missed, wrong)):
        error = found.std() / found.size**0.5
        print(f"{exact:.4f}: {found.mean():.4f} +- {1.96 * error:.4f}")
        assert abs(found.mean() - exact) < 3.5 * error
    assert abs(np.mean(counts) - samples) < 0.05 * samples
    forget("ruin")
