"""Belief and truth in a league: against plain loops, with robots that are too sure, and what robots are told."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from vibroswarm.league import belief_calibration as module
from vibroswarm.league.belief_calibration import (
    ALL,
    AS_PLAYED,
    AT_95,
    COMMON,
    COUNTS,
    OWN,
    TILES,
    belief_calibration,
    prior_weights,
    ratio_interval,
)
from vibroswarm.league.entries import Entry, entries_of, floors_of
from vibroswarm.league.standings import League
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate
from vibroswarm.statistics.intervals import wilson_limits
from vibroswarm.strategies import known, strategy
from vibroswarm.strategies.static_analysis import told

BASE = preset("paper").with_values({"run.t_end_s": 300.0})


def league(*entries: Entry, runs: int = 8) -> League:
    return League(BASE, entries, floors_of(["random"], [0.48]), (4,), runs=runs, seed=5)


def test_shares_are_those_of_plain_loops(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three floors, simulated one by one, with weights counted tile by tile."""
    counts = (30, 49, 70)
    monkeypatch.setattr(module, "COUNTS", counts)
    entry = Entry("none", "none", {"decision.min_observations": 30})
    found = {(row["settings"], row["prior"]): row for row in belief_calibration(
        league(entry), runs=6
    ).iter_rows(named=True)}  # fmt: skip
    assert set(found) == {(a, b) for a in (AS_PLAYED, AT_95) for b in (OWN, COMMON)}
    asked = BASE.with_values({
        "decision.min_observations": 30, "swarm.robots": 4, "floor.rows": 10, "floor.columns": 10,
    })  # fmt: skip
    binomial = {k: math.comb(TILES, k) for k in ALL.tolist()}
    for prior, weight in ((OWN, dict.fromkeys(ALL.tolist(), 1)), (COMMON, binomial)):
        sums = np.zeros(4)
        for k in counts:
            mine = sum(w for j, w in weight.items() if min(counts, key=lambda c: abs(c - j)) == k)
            result = simulate(asked.with_values({"floor.source": f"random:{k / 100}"}), 6, 6)
            for row in result.robots.iter_rows(named=True):
                says = row["decision"]
                sums += mine * np.array([
                    says >= 0,
                    0.0 if says < 0 else row["belief_below"] if says == 0 else 1.0 - row["belief_below"],
                    says == (k > 50),
                    1.0,
                ])  # fmt: skip
        row = found[AS_PLAYED, prior]
        assert row["confidence"] == pytest.approx(sums[1] / sums[0])
        assert row["right"] == pytest.approx(sums[2] / sums[0])
        assert row["decided"] == pytest.approx(sums[0] / sums[3])


def test_weights_are_those_of_the_prior() -> None:
    bots = Entry("bots", "bayes_bots", {"strategy.bayes_bots.prior": 98})
    none = Entry("none", "none", {})
    weights = {name: prior_weights(OWN, entry, league(entry)) for name, entry in (("b", bots), ("n", none))}
    counts = np.array(COUNTS)
    for found in weights.values():
        assert found.sum() == pytest.approx(1.0)
        assert found @ counts == pytest.approx(50.0)
    assert math.sqrt(weights["n"] @ (counts - 50.0) ** 2) == pytest.approx(
        math.sqrt((101**2 - 1) / 12), rel=0.02
    )
    leaning = Entry("leaning", "none", {"decision.prior_alpha": 6, "decision.prior_beta": 2})
    assert prior_weights(OWN, leaning, league(leaning)) @ counts == pytest.approx(75.0, rel=0.02)
    # Beta-binomial: N a b (a + b + N) / ((a + b)^2 (a + b + 1)), with a = b = 98; without k = 50 it is wider.
    variance = 100 * 98 * 98 * 296 / (196**2 * 197)
    chance_of_half = 0.0653
    assert weights["b"] @ (counts - 50.0) ** 2 == pytest.approx(variance / (1 - chance_of_half), rel=0.01)


@pytest.mark.slow
def test_robots_that_think_their_sensors_too_good_are_found_too_sure() -> None:
    """Negative control. At their own error rates, over their own prior, robots are as right as they believe."""
    tiles = {"decision.boundary_of": "tiles", "decision.min_observations": 0}
    fooled = {**tiles, "decision.assumed_false_positive": 0.02, "decision.assumed_false_negative": 0.3}
    table = belief_calibration(
        league(Entry("fair", "none", tiles), Entry("fooled", "none", fooled)), runs=100
    )
    rows = {
        row["name"]: row
        for row in table.iter_rows(named=True)
        if (row["settings"], row["prior"]) == (AT_95, OWN)
    }
    assert rows["fair"]["right_high"] > rows["fair"]["confidence_low"]
    assert abs(rows["fair"]["right"] - rows["fair"]["confidence"]) < 0.03
    assert rows["fooled"]["right_high"] < rows["fooled"]["confidence_low"] - 0.05


def test_intervals_of_ratios() -> None:
    """Of units that are alike, others may have been missed. By simulation, 95 % hold the truth."""
    same, rare = ratio_interval(np.full(30, 1.0), np.full(30, 2.0)), float(wilson_limits(0, 30)[1])
    assert same == pytest.approx((0.5, 0.5 - rare, 0.5 + rare))
    # So too if units are of different sizes (thirds are rounded); units without robots that decided show nothing.
    sizes = np.repeat([1.0, 4.0, 0.0], [15, 15, 70])
    assert ratio_interval(sizes / 3, sizes) == pytest.approx((1 / 3, 1 / 3 - rare, 1 / 3 + rare))
    assert all(math.isnan(value) for value in ratio_interval(np.zeros(3), np.zeros(3)))
    random = np.random.default_rng(1)
    held = 0
    for _ in range(400):
        bottom = random.integers(1, 20, size=30).astype(float)
        top = random.binomial(bottom.astype(int), 0.8).astype(float)
        _, low, high = ratio_interval(top, bottom)
        held += low <= 0.8 <= high
    assert 0.91 < held / 400 < 0.985  # four standard errors about 0.95


def test_ratios_that_few_units_change_hold_the_truth() -> None:
    """Robots of 3 runs in 100 are wrong; the jackknife alone held it in 84 of 100 cases."""
    random, held = np.random.default_rng(2), 0
    for _ in range(400):
        bottom = random.integers(4, 7, size=100).astype(float)
        _, low, high = ratio_interval(bottom * (random.random(100) > 0.03), bottom)
        held += low <= 0.97 <= high
    assert held / 400 > 0.91
    right = np.repeat([0.0, 1.0], [3, 97])
    of_larger_units = ratio_interval(5.0 * right, np.full(100, 5.0))
    assert of_larger_units == pytest.approx(ratio_interval(right, np.ones(100)))


def test_what_a_robot_is_told_is_as_documented() -> None:
    """Read from the sources here, written by hand in the documentation."""
    page = Path(__file__).parents[2] / "docs" / "strategies.md"
    rows = [
        line.split("|")[1:-1]
        for line in page.read_text(encoding="utf-8").splitlines()
        if line.startswith("| `")
    ]
    stated = {
        name.strip(" `"): cells[-1].strip()
        for cells in rows
        if len(cells) == 5
        for name in cells[0].split(",")
    }
    assert set(stated) == set(known())
    for name, text in stated.items():
        facts = [fact for fact in told(strategy(name), "tiles") if fact != "boundary"]
        assert (", ".join(facts) or "-") == text, name
    assert all("boundary" in told(strategy(name), "readings") for name in known())
    assert "error rates" not in told(strategy("none"), "readings")


def test_who_is_without_a_belief_is_left_out() -> None:
    assert belief_calibration(league(*entries_of(["dc"], {})), runs=2).is_empty()
