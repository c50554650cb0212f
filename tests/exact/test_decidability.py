"""Whether it can be decided at all: by hand, and by simulation."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import stats

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor, place_of
from vibroswarm.observation.decision_boundary import tiled_share
from vibroswarm.observation.edge_response import vibration_probability
from vibroswarm.observation.energy_model import error_rates
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate
from vibroswarm.statistics.decidability import (
    decidability,
    decidability_of_share,
    observed_share,
    samples_needed,
)
from vibroswarm.statistics.intervals import generator
from vibroswarm.statistics.verdict import verdict

PAPER = preset("paper")


def at(**values: object) -> object:
    return decidability(PAPER.with_values({name.replace("__", "."): v for name, v in values.items()}))


def test_the_paper_can_be_decided_and_with_how_many_samples() -> None:
    d = decidability(PAPER)
    a, b = error_rates(PAPER.sensor)
    assert d.verdict == "decidable"
    assert d.share == pytest.approx(0.48 * (1 - b) + 0.52 * a)
    assert d.margin == pytest.approx(0.5 - d.share)
    assert d.samples_needed > 3000  # three runs of five robots: it is a hard floor
    json.dumps(d.as_dict(), allow_nan=False)


def test_the_printed_threshold_decides_more_than_half_wrongly() -> None:
    d = at(sensor__rms_threshold=1.55, floor__source="random:0.52")
    assert d.verdict == "wrong side"
    assert d.share < 0.5
    assert "more samples make the wrong answer more certain" in d.says
    became = {"floor__source": "random:0.48", "change__at_s": 900.0, "change__to": "random:0.52"}
    assert at(sensor__rms_threshold=1.55, **became).says == f"Floor at the end: {d.says}"


def test_robots_that_weigh_readings_by_error_rates_are_not_misled_by_the_share_of_ones() -> None:
    """False alarms alone exceed a boundary of 3 %."""
    asked = {"floor__source": "random:0.0", "decision__decision_boundary": 0.03}
    assert at(**asked, strategy__name="none").verdict == "wrong side"
    knowing = at(**asked, strategy__name="places")
    assert (knowing.verdict, knowing.is_warning) == ("not assessed", False)
    wrong = {"decision__assumed_false_positive": 0.05, "decision__assumed_false_negative": 0.6}
    assumed = at(strategy__name="places", floor__source="random:0.4", decision__boundary_of="tiles", **wrong)
    assert assumed.is_warning, "they weigh by rates that the sensor does not have"


def test_on_the_boundary_neither_is_right() -> None:
    d = at(floor__source="random:0.48", decision__decision_boundary=0.48)
    assert (d.verdict, d.truth, d.margin, d.samples_needed) == ("on the boundary", None, None, None)


def test_off_the_tiles_robots_read_as_on_still_ones() -> None:
    assert tiled_share(Floor(np.ones((2, 2)), 0.2, 0.25, 0.8, 0.0).geometry, (1.0, 1.0)) == pytest.approx(
        0.2 * 0.5
    )
    d = at(floor__source="stripe:0.48", floor__tile_width_m=0.05, floor__tile_height_m=0.05)
    assert d.share == pytest.approx(0.25 * at().share + 0.75 * error_rates(PAPER.sensor)[0])
    assert d.share < 0.3


def test_vibration_across_edges_counts() -> None:
    """What is expected on this very floor, edges and all; and what simulated samples all over it read."""
    d = at(floor__source="diagonal:0.48", sensor__edge_reach_m=0.01, sensor__edge_blur_m=0.008)
    scenario = PAPER.with_values(
        {"floor.source": "diagonal:0.48", "sensor.edge_reach_m": 0.01, "sensor.edge_blur_m": 0.008}
    )
    (a, b), floor = error_rates(scenario.sensor), scenario.floor_for(0, 0)
    place, tiles, side = place_of(floor), floor.tiles.ravel(), (np.arange(2000) + 0.5) / 2000
    rows = [
        [
            vibration_probability(x, y, floor.tile_at(x, y).item(), place, tiles, 0.01, 0.008)[0]
            for x in side[::7]
        ]
        for y in side[::7]
    ]
    felt = float(np.mean(rows))  # 82,000 places that know nothing of tiles and their edges
    assert d.share == pytest.approx(felt * (1 - b) + (1 - felt) * a, abs=2e-4)
    assert d.share > at(floor__source="diagonal:0.48").share + 0.01
    result = simulate(scenario, 3, 1)
    assert verdict(result).share_of_ones_expected == pytest.approx(d.share, abs=1e-6)


def test_ones_are_expected_of_each_stage_for_as_long_as_it_lasts() -> None:
    """Of 24 % for 30 s, then of 76 % for 70 s."""
    change = {"change.at_s": [30.0], "change.to": "invert", "run.t_end_s": 100.0}
    scenario = preset("paper").with_values({"floor.source": "random:0.24"} | change)
    positive, negative = error_rates(scenario.sensor)
    felt = 0.3 * 0.24 + 0.7 * 0.76
    expected = felt * (1.0 - negative) + (1.0 - felt) * positive
    assert verdict(simulate(scenario, 3, 1)).share_of_ones_expected == pytest.approx(expected)


def test_samples_needed_by_brute_force() -> None:
    assert samples_needed(0.5, 0.5) is None
    for share, boundary in ((0.7, 0.5), (0.3, 0.5), (0.02, 0.03), (0.9, 0.5)):
        needed = samples_needed(share, boundary, 0.05)
        n = np.arange(1, 3 * needed + 20)
        ones = np.arange(0, n[-1] + 1)
        wrong = np.array(
            [
                stats.binom.pmf(ones[: k + 1], k, share)[
                    (ones[: k + 1] / k - boundary) * (1 if share > boundary else -1) <= 1e-12
                ].sum()
                for k in n
            ]
        )
        assert (wrong[needed - 1 :] <= 0.05).all()
        assert needed == 1 or wrong[needed - 2] > 0.05
    near, nearer = samples_needed(0.501, 0.5), samples_needed(0.5001, 0.5)
    assert near == pytest.approx((stats.norm.isf(0.05) * 0.5 / 0.001) ** 2, rel=0.01)
    assert nearer > 90 * near


def test_a_measured_share_near_the_boundary_cannot_be_told_from_it() -> None:
    assert decidability_of_share(0.482, 0.5, 0).verdict == "decidable"
    assert decidability_of_share(0.506, 0.5, 0).verdict == "wrong side"
    assert decidability_of_share(0.5, 0.5, 0).verdict == "on the boundary"
    for share in (0.482, 0.506, 0.499):
        d = decidability_of_share(share, 0.5, 0, effective_samples=1500)
        assert d.verdict == "indistinguishable from the boundary"
        assert d.share_low < 0.5 < d.share_high
    assert decidability_of_share(0.44, 0.5, 0, effective_samples=1500).verdict == "decidable"


def test_an_observed_share_counts_tiles_alike() -> None:
    random = generator(8, "tiles")
    rates = random.beta(1.0, 1.0, 25)
    tile = np.repeat(np.arange(25), (20 + 150 * rates).astype(int))
    drawn = [random.random(tile.size) < rates[tile] for _ in range(200)]
    assert np.mean([observed_share(tile, bits) for bits in drawn]) == pytest.approx(rates.mean(), abs=0.005)
    assert abs(np.mean(drawn) - rates.mean()) > 0.01  # uneven visits: the plain share is another thing


def test_a_floor_outside_the_arena_is_refused() -> None:
    beside = Floor([[0, 1], [1, 0]], 0.5, 0.5, 2.0, 0.0)
    for call in (lambda: decidability(PAPER, floor=beside), lambda: beside.fill_ratio_within(1.0, 1.0)):
        with pytest.raises(InputError, match="lies outside the arena") as refused:
            call()
        assert refused.value.field == "floor"
