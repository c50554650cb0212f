"""The fit of the physics to simulated sessions, whose parameters are known."""

from __future__ import annotations

import numpy as np
import pytest

from vibroswarm import preset, simulate
from vibroswarm.calibrate import fit_vibration as module
from vibroswarm.calibrate.dataset import Dataset, dataset_of
from vibroswarm.calibrate.few_groups import limits_of
from vibroswarm.calibrate.fit_vibration import FIELDS, SEARCHED, _Simulator, feature_names, fit_vibration

TRUE = {"amplitude_m_s2": 4.0, "coupling": 0.3, "noise_m_s2": 0.6, "motor_jitter": 0.3}
BASE = preset("paper").with_values({"sensor.model": "acceleration", "floor.source": "random:0.48"})


def sessions(runs: int, motor_spread: float, gain_spread: float) -> Dataset:
    values = TRUE | {"motor_spread": motor_spread, "gain_spread": gain_spread}
    true = BASE.with_values({f"sensor.acceleration.{name}": value for name, value in values.items()})
    return dataset_of([simulate(true, 5, runs)])


def test_known_parameters_are_found() -> None:
    fitted = fit_vibration(sessions(2, 0.0, 0.0), BASE, draws=20, folds=False)
    assert fitted.misfit.value < 0.05
    assert fitted.folds == ()
    assert tuple(fitted.values) == FIELDS
    assert fitted.names == feature_names()
    for name in ("amplitude_m_s2", "coupling", "noise_m_s2"):
        # For other motors and robots, so up to three times those of these, which differ in nothing.
        assert fitted.draws[name].std(ddof=1) < 3.0 * 0.05 * TRUE[name], name
        assert abs(fitted.values[name] - TRUE[name]) < 3.0 * 0.05 * TRUE[name], name
    assert fitted.values["motor_jitter"] == pytest.approx(TRUE["motor_jitter"], abs=0.06)
    assert max(fitted.values["motor_spread"], fitted.values["gain_spread"]) < 0.05
    # Negative control: the start of the search, the study's robots, is far away.
    start = BASE.sensor.params
    assert abs(start.amplitude_m_s2 - TRUE["amplitude_m_s2"]) > 3.0 * 0.05 * TRUE["amplitude_m_s2"]
    assert abs(start.motor_jitter - TRUE["motor_jitter"]) > 3.0 * 0.06


def test_spreads_between_motors_and_robots_are_found() -> None:
    found = sessions(4, motor_spread=0.25, gain_spread=0.2)
    simulator, rows = _Simulator(found, BASE), np.arange(found.samples.height)
    theta = np.log([TRUE[name] for name in SEARCHED])
    spreads = simulator.spreads(theta, rows)
    # Standard deviations of 48 motors and 20 robots have errors of 10 and 17 % by themselves.
    assert spreads[0] == pytest.approx(0.25, rel=3 * 0.10)
    assert spreads[1] == pytest.approx(0.2, rel=3 * 0.17)
    # Of the variance of motors two thirds are seen in energies: without that their spread was a fifth too small.
    assert simulator.without_spreads(theta, rows)[1] == pytest.approx([0.67, 1.0], abs=0.1)


def test_errors_are_those_of_other_motors_and_robots(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a bootstrap of samples the amplitude had an error of 4 %, and limits of ``gain_spread`` were 8 % apart."""
    monkeypatch.setattr(module, "EVALUATIONS", (1, 1))  # it starts at the true parameters
    monkeypatch.setattr(module, "REPEATS", (1, 2))
    true = BASE.with_values({f"sensor.acceleration.{name}": value for name, value in TRUE.items()})
    found = sessions(4, motor_spread=0.25, gain_spread=0.2)
    draws = fit_vibration(found, true, draws=40, folds=False).draws
    of_few = np.hypot(0.25 / np.sqrt(48), 0.2 / np.sqrt(20))
    assert np.log(draws["amplitude_m_s2"]).std(ddof=1) > of_few
    for name, freedom in (("motor_spread", 44), ("gain_spread", 16)):
        low, high = limits_of(np.log(draws[name]))
        assert high - low > 0.7 * 2.0 * 1.96 / np.sqrt(2.0 * freedom), name


def test_errors_where_few_tiles_vibrate_are_of_draws_with_a_vibrating_tile(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Draws without one took the features of vibrating tiles from all draws: ``motor_jitter`` had errors of 250 %."""
    monkeypatch.setattr(module, "EVALUATIONS", (1, 1))
    monkeypatch.setattr(module, "REPEATS", (1, 2))
    true = BASE.with_values({f"sensor.acceleration.{name}": value for name, value in TRUE.items()})
    one = dataset_of([simulate(true.with_values({"floor.source": "random:0.08"}), 8, 1)])
    draws = fit_vibration(one, true, draws=40, folds=False).draws
    assert np.log(draws["motor_jitter"]).std(ddof=1) < 1.0
    assert np.log(draws["amplitude_m_s2"]).std(ddof=1) < 0.3


@pytest.mark.parametrize(("redraw", "motors"), [("run", [0, 1]), ("study", [0, 0])])
def test_sessions_on_one_floor_have_the_same_motors(redraw: str, motors: list[int]) -> None:
    short = BASE.with_values({"floor.redraw": redraw, "run.t_end_s": 100.0})
    assert dataset_of([simulate(short, 5, 2)]).ground_numbers.tolist() == motors
