"""Robots that are localised from sample to sample, as they move, come to the same places as by whole tables."""

from __future__ import annotations

import pytest
from polars.testing import assert_frame_equal

from helpers.closed_loop import followed, reads_as_tables
from helpers.result_outcomes import assert_same_outcomes, from_result
from vibroswarm.localisation.locate import place_frame
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.search.outcomes import outcomes_of
from vibroswarm.simulation import simulate

SEED = 31
PLACES = Scenario().with_values(
    {
        "strategy.name": "places",
        "localisation.method": "mixture",
        "swarm.robots": 7,
        "odometry.level": "poor",
        "odometry.rezero_noise_deg_s": 0.5,
        "rays.noise_m": 0.01,
    }
)
EXPLORE = PLACES.with_values({"strategy.name": "explore", "run.t_end_s": 300.0})


@pytest.mark.parametrize("motion", ["event", "fixed-step"])
def test_outcomes_are_those_of_tables(motion: str) -> None:
    scenarios = [PLACES, PLACES.with_values({"strategy.places.variance_factor": 2.0})]
    if motion == "fixed-step":
        scenarios = [scenario.with_values({"run.t_end_s": 200.0}) for scenario in scenarios]
    for scenario, found in zip(scenarios, outcomes_of(scenarios, SEED, [0, 3], motion), strict=True):
        tables = from_result(simulate(scenario, SEED, [0, 3], motion=motion, energies=False))
        assert_same_outcomes(found, tables)


def test_a_run_that_ends_early_has_the_places_of_the_whole_run() -> None:
    whole = simulate(PLACES, SEED, 2)
    early = simulate(PLACES.with_values({"run.stop": "all_decided"}), SEED, 2)
    assert whole.places is not None
    assert early.places is not None
    keys = ["run", "robot", "sample"]
    assert 100 < early.places.height < whole.places.height
    assert_frame_equal(early.places, early.places.select(keys).join(whole.places, on=keys), check_exact=True)
    decided = whole.robots.filter(whole.robots["decision"] >= 0).select("run", "robot", "decision_time_s")
    assert_frame_equal(
        decided, early.robots.select(decided.columns).join(decided.select("run", "robot"), on=keys[:2])
    )


def test_robots_that_are_steered_by_their_places_are_where_tables_have_them() -> None:
    """What steered them is what the same moves give at once; of other errors of the gyro they steer elsewhere."""
    loop, result = followed(EXPLORE, SEED)
    count = loop.samples
    assert result.places is not None
    assert count == result.places.height > 100
    assert_frame_equal(
        place_frame(result.motion, loop.readings.estimates[:count]), result.places, check_exact=True
    )
    assert reads_as_tables(loop, result)
    other = simulate(EXPLORE.with_values({"odometry.level": "good"}), SEED, 1)
    assert not other.motion["x_m"].head(count).equals(result.motion["x_m"].head(count))


def test_robots_drive_to_where_their_map_is_unsure() -> None:
    """In the first minute three robots that steer see more tiles than three that walk at random, of 25 in 24 runs."""

    def seen(strategy: str, method: str) -> int:
        values = {
            "strategy.name": strategy,
            "localisation.method": method,
            "swarm.robots": 3,
            "run.t_end_s": 60.0,
        }
        at = simulate(EXPLORE.with_values(values), SEED, 24, energies=False).motion
        tiles = at.select("run", (at["x_m"] * 5).floor().alias("c"), (at["y_m"] * 5).floor().alias("r"))
        return tiles.unique().height

    walking = seen("places", "mixture")
    assert walking == seen("places", "true")
    assert seen("explore", "mixture") > walking + 24 * 1
    assert seen("explore", "true") > walking + 24 * 2
