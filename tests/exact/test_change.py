"""Floors that change: the truth by hand, Markov chains against theory, and no change equal bit by bit."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from numpy.typing import NDArray
from scipy import stats

from helpers.closed_loop import followed, reads_as_tables
from vibroswarm import Scenario, preset, replay, simulate
from vibroswarm.floors.changes import Changes, markov_changes
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.outcomes import truth_on, truth_over_time
from vibroswarm.observation.observe import kinds_at
from vibroswarm.report.report import report
from vibroswarm.result import Result

NAN = math.nan
INVERTED = {"change.at_s": 600, "change.to": "invert"}
SHORT = {"run.t_end_s": 120.0, "decision.min_observations": 10, "change.at_s": 60, "change.to": "invert"}


def on(*rows: str, **values: Any) -> Scenario:
    return preset("paper").with_values({"floor.tiles": list(rows), **values})


def given(scenario: Scenario, run: int = 0) -> list[tuple[float, float]]:
    since_s, truth = truth_over_time(scenario, scenario.floor_for(1, run))
    return list(zip(since_s.tolist(), truth.tolist(), strict=True))


# The truth, by hand: shares of vibrating tiles are named in the order of time.

CASES: dict[str, tuple[Scenario, list[tuple[float, float]]]] = {
    "3/4, still": (on("11", "10"), [(0, 1)]),
    "3/4, 1/4": (on("11", "10", **INVERTED), [(0, 1), (600, 0)]),
    "3/4, 1/4, 3/4": (
        on("11", "10", **{"change.at_s": [300, 900], "change.to": "invert"}),
        [(0, 1), (300, 0), (900, 1)],
    ),
    "3/4, other places": (on("11", "10", **{"change.at_s": 5, "change.to": "redraw"}), [(0, 1)]),
    "1/2, 1/2": (on("11", "00", **INVERTED), [(0, NAN)]),
    "1/2, 3/4": (on("11", "00", **{"change.at_s": 400, "change.to": "11/01"}), [(0, NAN), (400, 1)]),
    "1/4, 0: the same side": (on("01", "00", **{"change.at_s": 1, "change.to": "00/00"}), [(0, 0)]),
    "1/4, 1/2: boundary 0.3": (
        on("01", "00", **{"change.at_s": 100, "change.to": "01/01", "decision.decision_boundary": 0.3}),
        [(0, 0), (100, 1)],
    ),
    "0, 1/4, 1/2, 3/4: a patch grows": (
        on("00", "00", **{"change.at_s": [100, 200, 300], "change.to": ["00/01", "00/11", "01/11"]}),
        [(0, 0), (200, NAN), (300, 1)],
    ),
    "1/9, 5/9, 9/9: what vibrates grows": (
        on("000", "010", "000", **{"change.at_s": [100, 200], "change.to": "grow"}),
        [(0, 0), (100, 1)],
    ),
    "0, 1/4: a patch within one of four tiles": (
        on("00", "00", **{"change.at_s": 7, "change.to": "patch:0.01", "decision.decision_boundary": 0.2}),
        [(0, 0), (7, 1)],
    ),
    "1/4, 3/4, 1/4: there and back": (
        on("01", "00", **{"change.at_s": [10, 20], "change.to": ["10/11", "01/00"]}),
        [(0, 0), (10, 1), (20, 0)],
    ),
    "1/1 inside the arena, 1/2 with what is outside": (
        # two tiles of 1 m in an arena of 1 m: the right one lies outside
        on("10", **{"floor.tile_width_m": 1.0, "change.at_s": [10, 20], "change.to": ["11", "01"]}),
        [(0, 1), (20, 0)],
    ),
    "4/5 changed inside the arena, which is not more than 0.8, 1/1": (
        on(
            *["00000"] * 5,
            **{
                "floor.tile_width_m": 0.2,
                "floor.left_m": -0.2,
                "strategy.name": "reset",
                "strategy.reset.tells_change": True,
                "task.name": "changed",
                "task.changed.more_than": 0.8,
                "change.at_s": [10, 20],
                "change.to": ["00000/11111/11111/11111/11111", "/".join(["11111"] * 5)],
            },
        ),
        [(0, 0), (20, 1)],
    ),
    "kinds: 3 of 0, 3 of 2, then one each": (
        on(
            "0001",
            "0222",
            **{
                "sensor.model": "confusion",
                "task.name": "majority",
                "strategy.name": "dirichlet",
                "change.at_s": [50, 60],
                "change.to": ["0011/2222", "0011/2200"],
            },
        ),
        [(0, 0), (50, 2), (60, 0)],
    ),
}


@pytest.mark.parametrize("words", CASES)
def test_the_truth_by_hand(words: str) -> None:
    scenario, expected = CASES[words]
    found = given(scenario)
    assert [since for since, _ in found] == [since for since, _ in expected]
    np.testing.assert_array_equal([truth for _, truth in found], [truth for _, truth in expected])
    floor = scenario.floor_for(1, 0)
    for k, (since_s, truth) in enumerate(expected):
        until_s = expected[k + 1][0] if k + 1 < len(expected) else since_s + 1000.0
        for time_s in (
            since_s,
            (since_s + until_s) / 2,
            np.nextafter(until_s, 0.0),
        ):  # a change is in force at once
            assert truth_on(scenario, floor, time_s=time_s) == (None if math.isnan(truth) else truth)


@pytest.mark.parametrize("to", ["redraw", "random:0.6"])
def test_random_changes_are_new_floors_of_the_right_share(to: str) -> None:
    base = {"floor.source": "random:0.4", "floor.rows": 10, "floor.columns": 10}
    scenario = preset("paper").with_values({**base, "change.at_s": [10, 20], "change.to": to})
    same = []
    for run in range(50):
        floor = scenario.floor_for(3, run)
        first, then, last = (stage.tiles for _, stage in floor.stages())
        assert then.mean() == last.mean() == (0.4 if to == "redraw" else 0.6)
        same.append([np.mean(first == then), np.mean(then == last)])
    # Two independent floors of shares f and g agree on a tile with probability f g + (1 - f)(1 - g).
    expected = [0.52, 0.52] if to == "redraw" else [0.48, 0.52]
    np.testing.assert_allclose(np.mean(same, axis=0), expected, atol=0.02)
    of_a_study = scenario.with_values({"floor.redraw": "study"})
    assert of_a_study.floor_for(3, 7) == scenario.floor_for(3, 0) != scenario.floor_for(3, 7)


# A tile is a Markov chain.

RATE_PER_H, SHARES, UNTIL_S = 6.0, (0.5, 0.3, 0.2), 36_000.0


@cache
def chains(rate_per_h: float = RATE_PER_H) -> tuple[NDArray[np.uint8], Changes]:
    start = np.zeros((40, 50), dtype=np.uint8)
    return start, markov_changes(start, rate_per_h, SHARES, UNTIL_S, seed=5, run=2)


def holding_times(start: NDArray[np.uint8], changes: Changes, kind: int) -> NDArray[np.float64]:
    """How long tiles kept a kind, of spells that began in the first half, so that nearly none is cut off."""
    spells = []
    for tile in range(start.size):
        mine = changes.tile == tile
        times, kinds = changes.time_s[mine], changes.kind[mine]
        begin = np.flatnonzero((kinds[:-1] == kind) & (times[:-1] < UNTIL_S / 2))
        spells.append(times[begin + 1] - times[begin])
    return np.concatenate(spells)


def stationary_p(rate_per_h: float, shares: tuple[float, ...] = SHARES) -> float:
    start, changes = chains(rate_per_h)
    tiles = Floor(start, 1.0, 1.0, changes=changes).at(UNTIL_S).tiles
    return float(
        stats.chisquare(np.bincount(tiles.ravel(), minlength=3), start.size * np.array(shares)).pvalue
    )


def test_the_stationary_share_of_a_chain_is_that_of_theory() -> None:
    assert stationary_p(RATE_PER_H) > 0.01
    assert stationary_p(RATE_PER_H, (0.45, 0.35, 0.2)) < 1e-3  # negative control: other shares
    assert stationary_p(0.05) < 1e-6  # negative control: too slow to be stationary after ten hours


@pytest.mark.parametrize("kind", range(3))
def test_holding_times_of_a_chain_are_exponential(kind: int) -> None:
    held = holding_times(*chains(), kind)
    mean_s = 3600.0 / (RATE_PER_H * (1.0 - SHARES[kind]))
    assert len(held) > 1000
    assert stats.kstest(held, "expon", args=(0.0, mean_s)).pvalue > 0.01
    # Negative control: redraws to the same kind do not end a spell.
    assert stats.kstest(held, "expon", args=(0.0, 3600.0 / RATE_PER_H)).pvalue < 1e-3


def test_a_longer_run_has_the_changes_of_a_shorter_one_first() -> None:
    start, long = chains()
    short = markov_changes(start, RATE_PER_H, SHARES, UNTIL_S / 3, seed=5, run=2)
    for name in Changes._fields:
        np.testing.assert_array_equal(getattr(short, name), getattr(long, name)[: short.time_s.size])
    other = markov_changes(start, RATE_PER_H, SHARES, UNTIL_S / 3, seed=5, run=3)
    assert not np.array_equal(short.time_s, other.time_s)


# Runs.


def scenario(**values: Any) -> Scenario:
    return preset("paper").with_values({"floor.source": "random:0.4", **SHORT, **values})


def test_samples_read_the_floor_as_it_is() -> None:
    """With a sensor that does not err, bits are the kinds of the tiles at the time of the sample."""
    exact = {"sensor.model": "confusion", "sensor.confusion.kinds": 2, "sensor.confusion.accuracy": 1.0}
    for change in ({}, {"change.at_s": None, "change.to": None, "change.rate_per_h": 60.0}):
        result = simulate(scenario(**exact, **change), 4, 2)
        wrong = 0
        for run in range(2):
            samples = result.observations.filter(pl.col("run") == run)
            time_s = result.motion.filter(pl.col("run") == run)["time_s"].to_numpy()
            tile, floor = samples["tile"].to_numpy(), result.floor(run)
            np.testing.assert_array_equal(samples["observation"].to_numpy(), kinds_at(floor, tile, time_s))
            then_s, tiles = floor.changes.times_s[0], np.arange(floor.tiles.size)
            at_once = kinds_at(floor, tiles, np.full(tiles.size, then_s))
            np.testing.assert_array_equal(at_once, floor.at(then_s).tiles.ravel())
            wrong += int((samples["observation"].to_numpy() != floor.tiles.ravel()[tile]).sum())
        assert wrong > 20  # negative control: the floor at time 0 explains them badly


@pytest.mark.parametrize(
    ("values", "preset_name"),
    [({}, "calibrated"), ({"change.at_s": None, "change.to": None, "change.rate_per_h": 120.0}, "paper")],
    ids=["inverted", "chain"],
)
def test_closed_loop_and_stages_are_equal(values: dict[str, Any], preset_name: str) -> None:
    """With edges, factors of tiles and robots, and estimated places, too."""
    one = preset(preset_name).with_values(
        {"floor.source": "random:0.4", **SHORT, **values, "strategy.name": "explore"}
    )
    assert reads_as_tables(*followed(one, 4))


def test_the_closed_loop_would_differ_on_a_floor_that_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Negative control of the test before: it sees a closed loop that ignores changes."""
    monkeypatch.setattr(Result, "_changes_of", lambda self, run: Floor([[0]], 1.0, 1.0).changes)
    early = {"floor.source": "random:0.2", "change.at_s": 20, "strategy.name": "explore"}
    assert not reads_as_tables(*followed(scenario(**early), 4))


def test_a_replay_with_a_change_is_a_simulation_with_it(tmp_path: Path) -> None:
    still = simulate(scenario(**{"change.at_s": None, "change.to": None}), 2, 3)
    changed = simulate(scenario(), 2, 3)
    assert replay(still, changed.scenario) == changed
    changed.write(tmp_path / "changed")
    assert Result.read(tmp_path / "changed") == changed
    assert replay(Result.read(tmp_path / "changed"), changed.scenario) == changed


def test_runs_are_judged_by_the_floor_at_their_end() -> None:
    still, changed = (
        simulate(scenario(**{"floor.source": "random:0.2", "run.t_end_s": 400.0, **values}), 1, 5).runs
        for values in ({"change.at_s": None, "change.to": None}, {"change.at_s": 399.0})
    )
    assert still["truth"].to_list() == [0] * 5
    assert changed["truth"].to_list() == [1] * 5
    assert changed["fill_ratio"].to_list() == [0.8] * 5
    assert still["right"].to_list() == changed["wrong"].to_list()
    assert still["right"].sum() > 10
    # A run that ends with the last decision ends before the change.
    early = scenario(**{"floor.source": "random:0.2", "change.at_s": 399.0, "run.t_end_s": 400.0})
    runs = simulate(early.with_values({"run.stop": "all_decided"}), 1, 5).runs
    ended = runs.filter("stopped_early")
    assert ended.height > 0
    assert ended["truth"].to_list() == [0] * ended.height


# What is refused, in words, before any run.


def test_expected_readings_of_each_kind_are_means_over_time() -> None:
    """A third of the time all tiles are of kind 0, then all of kind 2, of which 90 % read as such."""
    values = {
        "floor.tiles": ["00", "00"],
        "floor.source": "ours",
        "change.at_s": 20.0,
        "change.to": "22/22",
        "run.t_end_s": 60.0,
        "sensor.model": "confusion",
        "strategy.name": "dirichlet",
        "task.name": "majority",
    }
    table = report(simulate(preset("paper").with_values(values), 1, 1)).tables["readings"]
    shares = [100 * share for share in table.frame["expected_share"]]
    assert shares == pytest.approx([(0.9 + 2 * 0.05) / 0.03, 5.0, (0.05 + 2 * 0.9) / 0.03], abs=0.006)
