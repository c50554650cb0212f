"""``vibroswarm calibrate bursts``: the table for recordings or simulations, and what cannot be fitted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from helpers.commands import json_of, refusal_of
from vibroswarm.calibrate.message_loss import STEPS, Bursts, LossFits, Windows, _logit, _Table
from vibroswarm.cli import main
from vibroswarm.documents.calibration import message_loss_document
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


def test_without_losses_there_is_nothing_to_fit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    simulate(SHORT, 2, 1).write(tmp_path / "ideal")
    assert "no message is lost; there is nothing to fit" in refusal_of(
        capsys, "calibrate", "bursts", tmp_path / "ideal"
    )
    assert main(["calibrate", "bursts", str(tmp_path / "none")]) == 2


def test_one_receiver_has_no_standard_errors(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A recording in which only robot 0 counts the messages that it received."""
    result = simulate(SHORT.with_values({"network.name": "loss", "network.loss.share": 0.3}), 2)
    count = pl.when(pl.col("robot") == 0).then("messages_received")
    counted = replace(
        result,
        seed=None,
        source="recording",
        inference=result.inference.with_columns(messages_received=count),
    )
    counted.write(tmp_path / "one")
    assert main(["calibrate", "bursts", str(tmp_path / "one"), "--errors"]) == 2
    captured = capsys.readouterr()
    assert "--errors: needs the counts of at least two receivers" in captured.err
    assert captured.out == ""


def test_counts_that_cannot_be_are_not_held_against_later_windows() -> None:
    """More messages received than sent: without that window, the rest is as likely as from its beginning."""
    model = Bursts(0.1, 30.0, 0.8, 0.02, 0.5, 0.0, 5)

    def log_likelihood(sent: list[int], received: list[int]) -> float:
        windows = Windows(0, 0, np.array(sent), np.array(received), np.full(len(sent), 20.0))
        return _Table([windows]).log_likelihood(model, 5.0)

    rest = log_likelihood([10] * 5, [10, 9, 10, 4, 10])
    after = log_likelihood([10, *[10] * 5], [40, 10, 9, 10, 4, 10])
    excluded = float(np.log(1e-300))
    assert excluded + rest - 5.0 < after < excluded + rest + 5.0


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


def test_bursts_are_reported_by_a_margin_and_not_where_only_receivers_differ() -> None:
    """A gain in AIC of 0.1 was "in bursts", and so was one receiver that loses more than the others."""

    def answer(*given: object) -> str:
        return message_loss_document(fits(*given)).answer[0]  # type: ignore[arg-type]

    assert answer(-97.0, (-50.0, -50.0)).startswith("No bursts found: independent losses fit as well")
    assert answer(-92.5, (-50.0, -50.0)).startswith("Inconclusive: bursts fit better")
    assert "(AIC lower by 9.0; 10 are needed)" in answer(-92.5, (-50.0, -50.0))
    assert answer(-91.5, (-50.0, -50.0)).startswith("Messages are lost in bursts (AIC lower by 11.0")
    assert answer(-60.0, (-20.0, -30.0)).startswith(
        "No bursts found: independent losses, with a share of its own for each receiver, fit as well (AIC lower by 22"
    )


def test_log_odds_are_finite() -> None:
    assert -21.0 < _logit(0.0) < -20.0
    assert 20.0 < _logit(1.0) < 21.0
    assert _logit(0.5) == 0.0
