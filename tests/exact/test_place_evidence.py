"""Maps of places with options: against the map without them, against enumeration of all floors, and Rubin's rules."""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.special import expit
from scipy.stats import gamma

from vibroswarm.strategies import place_samples, place_summaries, places
from vibroswarm.strategies.base import arrays_of
from vibroswarm.strategies.place_evidence import (
    RATIO_STEP,
    RATIO_STEPS,
    add_evidence,
    chance_of_bit,
    ratio_of_bit,
    rounded_ratio,
    score_of_maps,
)
from vibroswarm.strategies.place_map import add_reading, score, share_place, weigh_pairs
from vibroswarm.strategies.world import DetailedReading

SIDE, TILE_M, ROBOTS = 3, 0.2, 3
TILES = SIDE * SIDE


def world(**values: Any) -> Any:
    return SimpleNamespace(
        **{
            "robot": 0, "robots": ROBOTS, "rows": SIDE, "columns": SIDE, "left_m": 0.0, "bottom_m": 0.0,
            "tile_width_m": TILE_M, "tile_height_m": TILE_M, "false_positive": 0.1, "false_negative": 0.2,
            "decision_boundary": 0.5, "credible_threshold": 0.95, "t_end_s": 1200.0,
        }
        | values
    )  # fmt: skip


def params(**values: Any) -> Any:
    defaults = {name: field.default for name, field in places.places.params.model_fields.items()}
    return SimpleNamespace(**defaults | values)


def memory(arrays: type, maps: int = 1) -> Any:
    sizes = {"robots": ROBOTS, "rows": SIDE, "columns": SIDE, "tiles": TILES}
    a = SimpleNamespace(**{name: np.zeros(of.size(sizes)) for name, of in arrays_of(arrays).items()})
    if not hasattr(a, "odds"):
        a.odds = np.zeros(maps * ROBOTS * TILES)
    a.weight[:] = [0.9, 0.5, 1.0]
    return a


@pytest.mark.parametrize("reach_m", [0.0, 0.02])
def test_bits_are_weighed_as_without_options(reach_m: float) -> None:
    """The same log odds, and the same probability of each bit, reading by reading; with twice the ratio not."""
    rng, p, w = np.random.default_rng(1), params(edge_reach_m=reach_m), world()
    a, b, doubled = memory(places.Arrays), memory(place_samples.Arrays), memory(place_samples.Arrays)
    weigh_pairs(a, 1)
    for _ in range(60):
        j, bit = int(rng.integers(ROBOTS)), int(rng.integers(2))
        x_m, y_m, spread_m = rng.random() * 0.6, rng.random() * 0.6, 0.001 + 0.1 * rng.random()
        spans = share_place(a, x_m, y_m, spread_m, spread_m, p, w)
        chance = add_reading(a, j, bit, *spans, p, w)
        share_place(b, x_m, y_m, spread_m, spread_m, p, w)
        vibration = add_evidence(b, 0, j, ratio_of_bit(bit, w), *spans, w)
        assert chance_of_bit(bit, vibration, w) == pytest.approx(chance, rel=1e-10)
        share_place(doubled, x_m, y_m, spread_m, spread_m, p, w)
        add_evidence(doubled, 0, j, 2.0 * ratio_of_bit(bit, w), *spans, w)
    of_one_pair = a.odds[: ROBOTS * TILES]
    assert b.odds == pytest.approx(of_one_pair, rel=1e-9, abs=1e-11)
    assert np.abs(doubled.odds - of_one_pair).max() > 0.1
    assert score_of_maps(b, 1, 2.0, w) == pytest.approx(score(a, params(variance_factor=2.0), w), rel=1e-9)


def test_energies_at_known_places_weigh_all_floors() -> None:
    """p of each tile is that of all 512 floors, weighed by the densities of all energies."""
    rng, p, w = np.random.default_rng(2), params(), world()
    still, vibrating = gamma(2.0, 0.0, 0.5), gamma(3.0, 0.2, 0.6)
    floors = np.array(list(product((0, 1), repeat=TILES)))
    a, log_likelihood = memory(place_samples.Arrays), np.zeros(len(floors))
    a.weight[:] = 1.0
    for _ in range(20):
        t, energy = int(rng.integers(TILES)), float(rng.gamma(2.5, 0.6) + 0.25)
        of_still, of_vibrating = still.logpdf(energy), vibrating.logpdf(energy)
        log_likelihood += np.where(floors[:, t] == 1, of_vibrating, of_still)
        place = ((t % SIDE + 0.5) * TILE_M, (SIDE - t // SIDE - 0.5) * TILE_M)
        spans = share_place(a, *place, 0.001, 0.001, p, w)
        add_evidence(a, 0, int(rng.integers(ROBOTS)), of_vibrating - of_still, *spans, w)
    weight = np.exp(log_likelihood - log_likelihood.max())
    expected = weight @ floors / weight.sum()
    assert expit(a.odds.reshape(ROBOTS, TILES).sum(axis=0)) == pytest.approx(expected, abs=1e-9)


def test_the_score_of_several_maps_follows_rubin() -> None:
    rng, w, maps = np.random.default_rng(3), world(), 4
    a = memory(place_samples.Arrays, maps)
    a.odds[:] = rng.normal(0.0, 1.5, a.odds.size)
    p_tile = expit(np.einsum("kjt,j->kt", a.odds.reshape(maps, ROBOTS, TILES), a.weight))
    number, within = p_tile.sum(axis=1), (p_tile * (1.0 - p_tile)).sum(axis=1).mean()
    variance = 2.0 * within + 1.25 * number.var(ddof=1)
    assert score_of_maps(a, maps, 2.0, w) == pytest.approx((0.5 * TILES - number.mean()) / np.sqrt(variance))
    alike = a.odds.reshape(maps, -1)
    alike[:] = alike[0]
    one = (0.5 * TILES - number[0]) / np.sqrt(2.0 * (p_tile[0] * (1.0 - p_tile[0])).sum())
    assert score_of_maps(a, maps, 2.0, w) == pytest.approx(one), "maps that agree are as one"


def test_log_ratios_fit_into_a_byte() -> None:
    found = np.array([rounded_ratio(value) for value in np.linspace(-20.0, 20.0, 4001)])
    steps = np.round(found / RATIO_STEP)
    assert found == pytest.approx(steps * RATIO_STEP)
    assert np.abs(steps).max() == RATIO_STEPS <= 127
    assert np.abs(found - np.clip(np.linspace(-20.0, 20.0, 4001), -7.9375, 7.9375)).max() <= RATIO_STEP / 2


def reading(number: int, x_m: float, y_m: float, bit: int, spread_m: float = 0.03) -> DetailedReading:
    """A sample whose place is known at once."""
    place = (x_m, y_m)
    return DetailedReading(
        bit,
        5.0 * number,
        number,
        *place,
        0.0,
        spread_m,
        number,
        *place,
        spread_m,
        spread_m,
        np.nan,
        np.nan,
        np.empty(0),
    )


def test_a_map_that_was_sent_is_the_senders_but_for_rounding_and_the_newest_counts() -> None:
    rng, p = np.random.default_rng(4), params(share_map=True, broken_prior=0.0)
    sender, receiver = memory(place_summaries.Arrays), memory(place_summaries.Arrays)
    states = [SimpleNamespace(bits=0, heard=0, needed=0.0, decision=-1) for _ in range(2)]
    worlds = [world(robot=1), world(robot=0)]
    for s, a, w in zip(states, (sender, receiver), worlds, strict=True):
        place_summaries.begin(s, a, None, p, w)  # type: ignore[arg-type]
    for number in range(40):
        out = SimpleNamespace(number=0, samples=0, weight=0.0, steps=np.zeros(place_summaries.MOST_TILES))
        x = reading(number, rng.random() * 0.6, rng.random() * 0.6, int(rng.integers(2)))
        assert place_summaries.on_sample(states[0], sender, x, out, None, p, worlds[0])  # type: ignore[arg-type]
        if number % 7 == 4:  # the others are lost
            place_summaries.on_message(states[1], receiver, out, 1, 0.0, None, p, worlds[1])  # type: ignore[arg-type]
    place_summaries.on_message(states[1], receiver, out, 1, 0.0, None, p, worlds[1])  # type: ignore[arg-type]
    own, got = (a.odds.reshape(ROBOTS, TILES)[1].copy() for a in (sender, receiver))
    assert np.abs(own).max() > 0.5
    most = RATIO_STEP * RATIO_STEPS
    assert np.abs(np.clip(own, -most, most) - got).max() <= RATIO_STEP / 2 + 1e-12
    assert states[1].heard == 40
    assert receiver.weight[1] == pytest.approx(sender.weight[1], abs=0.002)
    place_summaries.opposite(out)
    place_summaries.on_message(states[1], receiver, out, 1, 0.0, None, p, worlds[1])  # type: ignore[arg-type]
    assert receiver.odds.reshape(ROBOTS, TILES)[1] == pytest.approx(-got)
    older = SimpleNamespace(number=0, samples=39, weight=0.5, steps=np.ones(place_summaries.MOST_TILES))
    place_summaries.on_message(states[1], receiver, older, 1, 0.0, None, p, worlds[1])  # type: ignore[arg-type]
    assert receiver.odds.reshape(ROBOTS, TILES)[1] == pytest.approx(-got), "it was overtaken, and is ignored"
    assert states[1].heard == 40


def test_a_robot_that_reads_one_everywhere_gives_itself_no_weight() -> None:
    """Judged by the maps of the others; a sound robot keeps its weight."""
    rng, p, w = np.random.default_rng(5), params(share_map=True), world()
    floor = np.array([1, 0, 1, 0, 1, 0, 1, 0, 0])
    weights = []
    for stuck in (True, False):
        a, s = memory(place_summaries.Arrays), SimpleNamespace(bits=0, heard=0, needed=0.0, decision=-1)
        place_summaries.begin(s, a, None, p, w)  # type: ignore[arg-type]
        a.odds.reshape(ROBOTS, TILES)[1] = np.where(floor == 1, 3.0, -3.0)
        for number in range(60):
            t = int(rng.integers(TILES))
            bit = 1 if stuck else int(rng.random() < (0.8 if floor[t] else 0.1))
            out = SimpleNamespace(number=0, samples=0, weight=0.0, steps=np.zeros(place_summaries.MOST_TILES))
            x = reading(number, (t % SIDE + 0.5) * TILE_M, (SIDE - t // SIDE - 0.5) * TILE_M, bit)
            place_summaries.on_sample(s, a, x, out, None, p, w)  # type: ignore[arg-type]
        weights.append(out.weight)
    assert weights[0] < 0.05
    assert weights[1] > 0.9
