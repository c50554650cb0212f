"""The rates that robots claim of each shipped sensor, against draws; claims that are a little off fail."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vibroswarm import sensors
from vibroswarm.floors.floor import Place, place_at
from vibroswarm.observation.energy_model import claimed_rates, model_of
from vibroswarm.scenario.fields import Sensor
from vibroswarm.sensors import Samples
from vibroswarm.sensors.base import REFERENCE_RUNS, REFERENCE_SAMPLES

DRAWS = 1_000_000
LIMIT = 5.0
"""Standard errors that a claim may be off. Of 100 rates that are right, one in 10,000 tests then fails by chance."""
COLOUR = ((0.7, 0.1, 0.1, 0.1), (0.05, 0.85, 0.05, 0.05), (0.0, 0.2, 0.8, 0.0), (0.1, 0.2, 0.3, 0.4))
BY_KIND: dict[str, dict[str, Any]] = {
    "gamma": {"model": "gamma"},
    "gamma, tiles differ": {"model": "gamma", "rms_threshold": 1.55, "tile_spread": 0.3},
    "energies": {
        "model": "energies",
        "vibrating_energies": (3.0, 1.0, 2.5),
        "still_energies": (0.5, 1.5, 0.25, 1.33),
    },
    "five kinds": {"model": "confusion", "confusion": {"kinds": 5, "accuracy": 0.6}},
    "colours": {"model": "confusion", "confusion": {"rates": COLOUR}},
    "fewer classes than kinds": {
        "model": "confusion",
        "confusion": {"rates": [(*row[:2], row[2] + row[3]) for row in COLOUR]},
    },
}
"""Sensors whose values follow from the kind of tile alone."""
BY_PLACE: dict[str, dict[str, Any]] = {
    "one motor": {"model": "acceleration"},
    "two motors": {"model": "acceleration", "acceleration": {"motor_hz": (90.0, 140.0)}},
}
"""Sensors that measure at a place on a floor."""
GRIDS = {
    "5 x 5": place_at((5, 5, 0.2, 0.2, 0.0, 0.0)),
    "10 x 10": place_at((10, 10, 0.1, 0.1, 0.0, 0.0)),
}


def test_every_shipped_sensor_is_among_them() -> None:
    assert {case["model"] for case in (*BY_KIND.values(), *BY_PLACE.values())} == set(sensors.names())


@pytest.mark.parametrize("name", BY_KIND)
def test_claimed_rates_are_those_of_a_million_draws(name: str) -> None:
    sensor, rng = Sensor.model_validate(BY_KIND[name]), np.random.default_rng(7)
    model, claimed = model_of(sensor), claimed_rates(sensor)
    spread = sensor.tile_spread or 0.0
    for kind in range(sensor.kinds):
        values = model.values(kind, rng.random(DRAWS), sensor.params)
        if spread:
            values *= np.exp(spread * rng.standard_normal(DRAWS) - 0.5 * spread**2)
        read = np.bincount(model.classes(values, sensor.params), minlength=sensor.readings) / DRAWS
        error = np.sqrt(claimed[kind] * (1.0 - claimed[kind]) / DRAWS)
        assert (np.abs(read - claimed[kind]) <= LIMIT * error).all()
        # A control: claims that are off by twice what so many draws can tell, at most 0.5 %.
        assert (
            np.abs(read - (claimed[kind] + 2.0 * LIMIT * error))[error > 0.0] > LIMIT * error[error > 0.0]
        ).all()


@pytest.mark.parametrize(("name", "grid"), list(zip(BY_PLACE, reversed(GRIDS), strict=True)))
def test_claims_of_reference_places_are_those_of_draws_elsewhere(name: str, grid: str) -> None:
    """The claim's own error is larger than that of 125,000 draws: it is of few floors, each with one robot."""
    sensor = Sensor.model_validate(BY_PLACE[name])
    share, error, independent = read_on_floors(sensor, GRIDS[grid], 2500, 50, own_robot=True)
    assert (error < 1.15 * independent).all()  # so that they are worth as many independent draws
    _, of_claim, _ = read_on_floors(sensor, GRIDS[grid], REFERENCE_RUNS, REFERENCE_SAMPLES, own_robot=False)
    limit = LIMIT * np.hypot(error, of_claim)
    assert limit.max() < 0.02
    assert (np.abs(share - claimed_rates(sensor, GRIDS[grid])) < limit).all()
    # Controls: the rates on tiles of another size, and of a threshold that is off by 5 %.
    other_tiles = claimed_rates(sensor, place_at((20, 20, 0.05, 0.05, 0.0, 0.0)))
    higher = sensor.model_copy(update={"rms_threshold": 1.05 * sensor.rms_threshold})
    for other in (other_tiles, claimed_rates(higher, GRIDS[grid])):
        assert (np.abs(share - other) > limit).any()


def read_on_floors(
    sensor: Sensor, grid: Place, floors: int, samples: int, *, own_robot: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the share of samples on each kind that read as each class, (kinds, classes), and two errors of it.

    The first error is that of floors that differ, the second that of independent samples. Floors, places and chance
    are others than those from which rates are claimed.

    Args:
        own_robot: whether each sample is of a robot of its own, or all on a floor are of one, as in the claim.
    """
    model, rng, number = model_of(sensor), np.random.default_rng(8), np.arange(samples)
    p, robot = model.at_place(sensor.params, grid), number if own_robot else np.zeros_like(number)
    counts = np.zeros((floors, sensor.kinds, sensor.readings))
    for run in range(floors):
        tiles = rng.permutation(np.arange(run, run + grid.rows * grid.columns) % sensor.kinds).astype(
            np.uint8
        )
        x_m, y_m = rng.random((2, samples))
        read = model.classes(
            model.sensed(Samples(grid, tiles, x_m, y_m, 3.0 * number, robot, number, 12, run), p), p
        )
        row = grid.rows - 1 - (y_m / grid.height_m).astype(int)
        below = tiles[row * grid.columns + (x_m / grid.width_m).astype(int)]
        np.add.at(counts[run], (below, read), 1.0)
    on_kind = counts.sum(axis=(0, 2))[:, None]
    share = counts.sum(axis=0) / on_kind
    apart = counts - share * counts.sum(axis=2, keepdims=True)  # of each floor from what the share says
    return share, apart.std(axis=0) * np.sqrt(floors) / on_kind, np.sqrt(share * (1.0 - share) / on_kind)
