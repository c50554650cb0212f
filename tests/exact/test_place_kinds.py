"""The map of places for several kinds of tile against enumeration of all floors, and against places with two kinds."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy.stats import norm

from vibroswarm import InputError, Scenario, preset, simulate
from vibroswarm.analysis.map_figures import floor_maps
from vibroswarm.cli import main
from vibroswarm.strategies import place_kinds, place_map, place_trust, places
from vibroswarm.strategies.base import arrays_of
from vibroswarm.strategies.place_kinds import add_sample, as_common, doubt_in, leader, on_sample, write_map
from vibroswarm.testing.plain_reference import plain_run
from vibroswarm.testing.runs import differences

SIDE, TILE_M, TILES = 2, 0.2, 4
RATES = np.array([[0.7, 0.2, 0.1], [0.15, 0.8, 0.05], [0.3, 0.1, 0.6]])
FLOORS = np.array(list(product(range(3), repeat=TILES)))
KINDS: dict[str, Any] = {
    "sensor.model": "confusion",
    "sensor.confusion.accuracy": 0.8,
    "task.name": "majority",
    "floor.source": "random:0.28,0.48,0.24",
    "strategy.name": "places",
}


def scenario(**values: Any) -> Scenario:
    return preset("paper").with_values(KINDS | values)


def world(rates: Any = RATES, robots: int = 2) -> Any:
    return SimpleNamespace(
        robot=0, robots=robots, kinds=len(rates), rates=np.ravel(rates), rows=SIDE, columns=SIDE, left_m=0.0,
        bottom_m=0.0, tile_width_m=TILE_M, tile_height_m=TILE_M, credible_threshold=0.95, t_end_s=100.0,
        decision_boundary=0.5, false_positive=rates[0][1], false_negative=rates[1][0],
    )  # fmt: skip


def params(**values: Any) -> Any:
    of: dict[str, Any] = {
        "edge_reach_m": 0.0,
        "variance_factor": 1.0,
        "broken_prior": 0.1,
        "trust_limit": 5.0,
    }
    return SimpleNamespace(**of | {"falls_from": 1.0, "min_samples": 0, "rate_pairs": False} | values)


def memory(declared: type, w: Any) -> Any:
    sizes = {"robots": w.robots, "rows": SIDE, "columns": SIDE, "tiles": TILES, "kinds": w.kinds}
    sizes["readings"] = w.rates.size // w.kinds
    made = {name: np.zeros(one.size(sizes), dtype=one.kind) for name, one in arrays_of(declared).items()}
    return SimpleNamespace(**made)


def middle(tile: int) -> tuple[float, float]:
    return (tile % SIDE + 0.5) * TILE_M, (SIDE - tile // SIDE - 0.5) * TILE_M


def trusting(w: Any) -> tuple[Any, Any, Any]:
    """State and arrays at time 0 of a robot that trusts all, and parameters."""
    s, p = SimpleNamespace(heard=0, decision=-1, needed=0.0), params(broken_prior=0.0, trust_limit=1000.0)
    a = memory(place_kinds.Arrays, w)
    place_kinds.begin(s, a, None, p, w)
    return s, a, p


def test_at_true_places_the_map_is_bayes_rule_over_all_floors() -> None:
    w, rng = world(), np.random.default_rng(3)
    s, a, p = trusting(w)
    chance = np.ones(len(FLOORS))
    for tile, reading, sender in zip(
        rng.integers(0, TILES, 12), rng.integers(0, 3, 12), rng.integers(0, 2, 12), strict=True
    ):
        add_sample(s, a, int(sender), int(reading), *middle(int(tile)), 0.0, 0.0, p, w)
        chance *= RATES[FLOORS[:, tile], reading]
    write_map(a, w)
    chance /= chance.sum()
    expected = [[chance[FLOORS[:, tile] == kind].sum() for kind in range(3)] for tile in range(TILES)]
    assert a.by_kind.reshape(TILES, 3) == pytest.approx(np.array(expected), abs=1e-12)
    # Doubts are sums over floors, too.
    count = np.stack([(kind == FLOORS).sum(axis=1) for kind in range(3)], axis=1)
    first = leader(a, w)
    assert first == (chance @ count).argmax()
    for kind in range(3):
        others = [other for other in range(3) if other != kind]
        for other in others:
            not_less = chance[count[:, other] >= count[:, kind]].sum()
            assert as_common(a, other, kind, w) == pytest.approx(not_less, abs=1e-12)
        is_most = (count[:, others] < count[:, [kind]]).all(axis=1)
        both = (count[:, others] >= count[:, [kind]]).all(axis=1)
        # Boole's inequality counts floors twice on which both others are as common.
        assert 1.0 - doubt_in(a, kind, w) == pytest.approx(
            chance[is_most].sum() - chance[both].sum(), abs=1e-12
        )
    assert chance[both].sum() > 0.0


@pytest.mark.parametrize("at", [(0.1, 0.1), (0.19, 0.32), (0.205, 0.205)])
@pytest.mark.parametrize("reading", [0, 1, 2])
def test_one_reading_at_an_unknown_place_weighs_every_floor(at: tuple[float, float], reading: int) -> None:
    """After readings at true places, which make tiles differ, the share of every tile is weighed over 81 floors."""
    w, spread_m = world(), 0.05
    s, a, p = trusting(w)
    before = ((0, 0), (0, 0), (1, 1), (2, 2))
    for tile, kind in before:
        add_sample(s, a, 1, kind, *middle(tile), 0.0, 0.0, p, w)
    add_sample(s, a, 0, reading, *at, spread_m, spread_m, p, w)
    write_map(a, w)
    edges = np.array([0.0, TILE_M, 2 * TILE_M])
    of_column, of_row = (np.diff(norm.cdf(edges, mean, spread_m)) for mean in at)
    share = np.outer(of_row[::-1], of_column).ravel() / (of_row.sum() * of_column.sum())
    chance = np.prod([RATES[FLOORS[:, tile], kind] for tile, kind in before], axis=0)
    chance *= (share * RATES[FLOORS, reading]).sum(axis=1)
    chance /= chance.sum()
    expected = [[chance[FLOORS[:, tile] == kind].sum() for kind in range(3)] for tile in range(TILES)]
    assert a.by_kind.reshape(TILES, 3) == pytest.approx(np.array(expected), abs=1e-6)


def test_with_two_kinds_it_is_places() -> None:
    """Map, trust and weights, at estimated places, of two senders, one of which reads 1 everywhere."""
    w, p, rng = world([[0.86, 0.14], [0.2, 0.8]]), params(), np.random.default_rng(5)
    ours, theirs = memory(place_kinds.Arrays, w), memory(places.Arrays, w)
    state = SimpleNamespace(heard=0, decision=-1, needed=0.0)
    place_kinds.begin(state, ours, None, p, w)
    theirs.weight[:], theirs.credence[0] = 1.0 - p.broken_prior, 1.0
    for step in range(60):
        x_m, y_m = rng.random(2) * 2 * TILE_M
        j, bit = step % 2, int(rng.random() < 0.5) if step % 2 else 1
        add_sample(state, ours, j, bit, x_m, y_m, 0.06, 0.04, p, w)
        left, right, upper, lower = place_map.share_place(theirs, x_m, y_m, 0.06, 0.04, p, w)
        chance = place_map.add_reading(theirs, j, bit, left, right, upper, lower, p, w)
        place_trust.judge(theirs, j, bit, chance, p)
        for name in ("surprise", "variance", "suspicion", "weight"):
            np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=1e-9, atol=1e-12)
    assert theirs.weight.min() < 0.8
    write_map(ours, w)
    odds = [place_map.total_odds(theirs, 0, tile, w) for tile in range(TILES)]
    np.testing.assert_allclose(
        ours.by_kind.reshape(TILES, 2)[:, 1], 1.0 / (1.0 + np.exp(-np.array(odds))), rtol=1e-9
    )


def test_the_score_needed_falls_to_that_of_a_guess() -> None:
    """One reading on each of three tiles gives kind 0 less than 95 %, but more than a guess."""
    for part, falls_from, expected in ((0.99, 0.5, 0), (0.99, 1.0, -1), (0.2, 0.5, -1)):
        w = world()
        s, a, p = trusting(w)
        place_kinds.begin(s, a, None, p, w)
        p.falls_from = falls_from
        for tile in range(3):
            add_sample(s, a, 0, 0, *middle(tile), 0.0, 0.0, p, w)
        x = SimpleNamespace(reading=0, t_s=100.0 * part, number=0, lagged_number=-1)
        assert not on_sample(s, a, x, SimpleNamespace(), None, p, w)
        assert s.decision == expected


def test_maps_of_a_swarm_are_right_where_readings_are_many() -> None:
    result = simulate(scenario(), 1, 3)
    assert result.runs["consensus"].to_list() == ["right"] * 3
    assert result.reports is not None
    maps = (
        result.reports.filter(pl.col("name") == "by_kind").sort("run", "robot", "index")["value"].to_numpy()
    )
    found = maps.reshape(3, 5, 25, 3).argmax(axis=-1)
    truth = np.stack([result.floor(run).tiles.ravel() for run in range(3)])
    assert (found == truth[:, None]).mean() > 0.99
    counting = simulate(scenario(**{"strategy.name": "dirichlet"}), 1, 3)
    assert result.robots["decision_time_s"].max() < counting.robots["decision_time_s"].min()


def test_the_plain_account_does_the_same() -> None:
    short = scenario(**{"faults.stuck_at_1": [0], "run.t_end_s": 200.0, "localisation.method": "true"})
    result = simulate(short, 2, [0])
    account = plain_run(short, 2, result.motion, result.ends, result.observations)
    assert list(differences(result, account)) == []


@pytest.mark.parametrize(
    ("values", "field", "words"),
    [
        ({"strategy.places.rate_pairs": True}, "strategy.places.rate_pairs", "two kinds"),
        ({"strategy.places.energies": True}, "strategy.places.energies", "two kinds"),
        ({"strategy.places.draws": 2}, "strategy.places.draws", "two kinds"),
        ({"strategy.places.share_map": True}, "strategy.places.share_map", "two kinds"),
        ({"strategy.places.edge_reach_m": 0.01}, "strategy.places.edge_reach_m", "two kinds"),
        ({"strategy.places.prior_median": 0.2}, "strategy.places.prior_median", "most common"),
        ({"decision.decision_boundary": 0.3}, "decision.decision_boundary", "most common"),
        ({"task.name": "fill_ratio"}, "task.name", "decides among 3"),
        ({"strategy.name": "explore"}, "strategy.name", "reads 0 or 1"),
    ],
)
def test_what_is_defined_for_two_kinds_is_refused(values: dict[str, Any], field: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        scenario(**values)
    assert caught.value.field == field


def test_a_run_with_page_and_pictures_has_no_map_of_two_kinds(tmp_path: Path, capsys: Any) -> None:
    fields = [text for name, value in KINDS.items() for text in ("--set", f"{name}={value}")]
    out = tmp_path / "three kinds"
    assert main(["run", *fields, "--set", "run.t_end_s=120", "--out", str(out), "--pictures"]) == 0
    assert (out / "run.html").exists()
    assert not (out / "maps.parquet").exists()
    assert "Traceback" not in capsys.readouterr().err
    with pytest.raises(InputError, match="two kinds"):
        floor_maps(simulate(scenario(**{"run.t_end_s": 20.0}), 1, 1))
