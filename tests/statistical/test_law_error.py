"""The error of a fitted law: does it say how far laws of sessions are from the sensor that the sessions had?"""

from __future__ import annotations

import numpy as np
import pytest

from vibroswarm import preset, simulate
from vibroswarm.calibrate.dataset import dataset_of
from vibroswarm.inspection.laws import law_of_sessions
from vibroswarm.inspection.samples import Law
from vibroswarm.scenario.fields import Sensor

pytestmark = pytest.mark.slow
SESSIONS = range(6)


def log_means(sensor: Sensor) -> np.ndarray:
    """Log of the mean energy on still and on vibrating tiles."""
    return np.log(
        [
            sensor.still_shape * sensor.still_scale + sensor.still_location,
            sensor.vibrating_shape * sensor.vibrating_scale + sensor.vibrating_location,
        ]
    )


@pytest.fixture(scope="module")
def laws() -> list[Law]:
    scenario = preset("calibrated").with_values({"run.t_end_s": 600.0, "floor.source": "random:0.48"})
    found = dataset_of([simulate(scenario, 3, len(SESSIONS), segments=True)])
    return [law_of_sessions(found, [session], "one session", draws=10).law for session in SESSIONS]


def test_laws_are_as_wrong_as_they_say(laws: list[Law]) -> None:
    truth = log_means(preset("calibrated").sensor)
    errors = np.array([log_means(law.sensor) - truth for law in laws])
    stated = np.array([np.std([log_means(one) for one in law.draws], axis=0, ddof=1) for law in laws])
    assert 0.4 < np.sqrt(np.mean((errors / stated) ** 2)) < 1.6
