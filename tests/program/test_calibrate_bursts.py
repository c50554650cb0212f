"""``vibroswarm calibrate bursts``: the table for recordings or simulations, and what cannot be fitted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from helpers.commands import json_of
from vibroswarm.calibrate.message_loss import STEPS, Bursts, LossFits, Windows
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate

SHORT = preset("paper").with_values({"run.t_end_s": 60.0, "swarm.robots": 3})


def test_a_fit_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    simulate(SHORT.with_values({"network.name": "loss", "network.loss.share": 0.3}), 2, 2).write(
        tmp_path / "lossy"
    )
    found = json_of(capsys, "calibrate", "bursts", tmp_path / "lossy", "--json")["tables"]
    fits = {one["model"]: one for one in found["fits"]}
    assert set(fits) == {"independent", "bursts"}
    assert 0.1 < fits["independent"]["lost_in_good"] < 0.5
    assert fits["bursts"]["log_likelihood"] >= fits["independent"]["log_likelihood"] - 0.1
    assert len(found["gaps"]) == len(STEPS)
    assert sum(one["found"] for one in found["gaps"]) > 5


def fits(log_likelihood: float, by_receiver: tuple[float, float]) -> LossFits:
    """Fits to two receivers: independent losses of log likelihood -100, and bursts."""
    windows = [Windows(0, robot, np.array([9, 9]), np.array([9, 8]), np.full(2, 20.0)) for robot in range(2)]
    models = {
        "independent": Bursts(0.0, 1.0, 0.0, 0.05, 0.5, -100.0, 2),
        "bursts": Bursts(0.1, 30.0, 0.8, 0.02, 0.5, log_likelihood, 5),
    }
    expected = dict.fromkeys(models, np.zeros((2, len(STEPS))))
    each = [replace(models["independent"], log_likelihood=one) for one in by_receiver]
    return LossFits(windows, models, np.zeros(len(STEPS), np.int64), expected, each, {}, 0.0, 0.0)
