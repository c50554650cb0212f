"""The fit of the physics to simulated sessions, whose parameters are known."""

from __future__ import annotations

from vibroswarm import preset, simulate
from vibroswarm.calibrate.dataset import dataset_of
from vibroswarm.calibrate.fit_vibration import FIELDS, feature_names, fit_vibration

TRUE = {
    "amplitude_m_s2": 4.0,
    "coupling": 0.3,
    "noise_m_s2": 0.6,
    "motor_jitter": 0.3,
    "feet_m": 0.03,
    "contact_jitter": 0.2,
}


def test_known_parameters_are_found() -> None:
    base = preset("paper").with_values({"sensor.model": "acceleration", "floor.source": "random:0.48"})
    true = base.with_values({f"sensor.acceleration.{name}": value for name, value in TRUE.items()})
    found = dataset_of([simulate(true, 5, 2)])
    fitted = fit_vibration(found, base, draws=20, folds=False)
    assert fitted.misfit < 0.05
    assert fitted.folds == ()
    assert tuple(fitted.values) == FIELDS
    assert fitted.names == feature_names()
    for name in ("amplitude_m_s2", "coupling", "noise_m_s2"):
        assert fitted.draws[name].std(ddof=1) < 0.1 * TRUE[name], name
        assert abs(fitted.values[name] - TRUE[name]) < 3.0 * 0.05 * TRUE[name], name
    # Negative control: the start of the search, the study's robots, is far away.
    assert (
        abs(base.sensor.params.amplitude_m_s2 - TRUE["amplitude_m_s2"]) > 3.0 * 0.05 * TRUE["amplitude_m_s2"]
    )
