"""Do maps, calls, regions and risks hold as often as they say? Each with a control that must fail."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import polars as pl
import pytest
from numpy.typing import NDArray
from scipy.special import expit
from scipy.stats import binom

from helpers.inspections import drawn_samples
from vibroswarm import preset, simulate
from vibroswarm.calibrate.dataset import dataset_of
from vibroswarm.inspection.assessment import Question, risk_curve, statistic_for
from vibroswarm.inspection.checks import law_checks
from vibroswarm.inspection.damage import drawn_parts, drawn_values, ratios_at, squares_at
from vibroswarm.inspection.inspection import inspect
from vibroswarm.inspection.laws import law_of_measured, law_of_scenario, law_of_sessions
from vibroswarm.inspection.patches import declared, log_likelihoods, scan_statistic, shares_of
from vibroswarm.inspection.samples import Law, Samples, ratios_of_values
from vibroswarm.inspection.scan import drawn_statistics, p_value, region_of
from vibroswarm.inspection.sources import samples_of_result
from vibroswarm.inspection.tile_map import tile_map
from vibroswarm.observation.energy_model import energy_of
from vibroswarm.statistics.map_figures import calibration, map_scores

Floats = NDArray[np.float64]
TRUTH = Law(preset("paper").sensor, "the truth")


@pytest.fixture(scope="module")
def inspected() -> list[Samples]:
    scenario = preset("optimised-places").with_values({"run.t_end_s": 320.0})
    return [inspect(scenario, seed=700, run=run).samples for run in range(20)]


def test_the_map_becomes_right_and_is_calibrated(inspected: list[Samples]) -> None:
    at_s = (60.0, 120.0, 300.0)
    maps = [tile_map(samples, at_s) for samples in inspected]
    brier = [
        [map_scores(p, one.grid)["brier"] for p in each] for each, one in zip(maps, inspected, strict=True)
    ]
    assert (np.mean(brier, axis=0) < [0.15, 0.08, 0.02]).all()
    p = np.concatenate([each[:2].ravel() for each in maps])
    x = np.concatenate([np.tile(samples.grid.tiles.ravel(), 2) for samples in inspected])
    table = calibration(p, x.astype(np.float64))
    assert (abs(table["probability"] - table["vibrating"]) < 0.15).all()


def test_the_map_at_wrong_places_must_fail(inspected: list[Samples]) -> None:
    mirrored = [samples.with_columns(x_m=1.0 - samples.column("x_m")) for samples in inspected[:10]]
    scores = [map_scores(tile_map(samples, [300.0])[0], samples.grid) for samples in mirrored]
    assert np.mean([score["brier"] for score in scores]) > 0.25  # worse than a map that knows nothing
    assert np.mean([score["surely_wrong"] for score in scores]) >= 4


@cache
def intact(name: str, until_s: float) -> Samples:
    scenario = preset(name).with_values({"run.t_end_s": until_s, "floor.source": "random:0.0"})
    return samples_of_result(simulate(scenario, 7, 1), 0, law_of_scenario(scenario, "the scenario"))


def cleared(
    judge: Samples, truth: Samples, contrast: float, number: int, tolerated: float
) -> tuple[int, int]:
    """How many intact and damaged surfaces are cleared that follow the law of ``truth``, by the risk by ``judge``."""
    question = Question(contrasts=(contrast,))
    statistic, random = statistic_for(judge, question), np.random.default_rng(3)
    t = []
    for samples in (judge, truth):
        squares = squares_at(random, np.full(number, question.least_m), samples.size_m, contrast)
        for patch in (None, squares):
            parts = drawn_parts(random, samples, number, patch)
            t.append(np.concatenate([statistic(part, True) for part in parts]))
    risk = risk_curve(t[0], t[1], question.prior)
    sound, damaged = (int((risk(one) <= tolerated).sum()) for one in t[2:])
    return sound, damaged


@pytest.mark.parametrize(("name", "contrast"), [("optimised-places", 1.0), ("calibrated", 0.5)])
def test_the_true_risk_after_clearing_is_at_most_the_stated_one(name: str, contrast: float) -> None:
    samples = intact(name, 900.0)
    for tolerated in (0.1, 0.05, 0.01):
        sound, damaged = cleared(samples, samples, contrast, 500, tolerated)
        assert damaged <= binom.ppf(0.999, sound + damaged, tolerated)


def test_a_risk_without_what_samples_share_must_fail() -> None:
    """T itself as log odds, as if samples were independent."""
    samples, random = intact("calibrated", 600.0), np.random.default_rng(3)
    statistic, number = statistic_for(samples, Question(contrasts=(0.5,))), []
    for patch in (None, squares_at(random, np.full(2000, 0.1), samples.size_m, 0.5)):
        parts = drawn_parts(random, samples, 2000, patch)
        number.append(sum(int((expit(statistic(part, True)) <= 0.02).sum()) for part in parts))
    assert number[1] > binom.ppf(0.999, sum(number), 0.02)


def test_larger_and_stronger_damage_is_cleared_less_often() -> None:
    samples, question = intact("optimised-places", 900.0), Question(contrasts=(0.75,))
    statistic, random, means = statistic_for(samples, question), np.random.default_rng(4), []
    for side_m, contrast in ((0.1, 0.75), (0.1, 1.0), (0.2, 0.75), (0.28, 1.0)):
        squares = squares_at(random, np.full(200, side_m), samples.size_m, contrast)
        means.append(np.quantile(statistic(drawn_values(random, samples, 200, squares), True), 0.05))
    assert means[0] == min(means)


def test_false_calls_are_as_stated_and_more_at_wrong_robots() -> None:
    samples = intact("calibrated", 600.0)
    patches = declared(samples.size_m)
    shares = shares_of(samples, patches)
    random = np.random.default_rng(5)
    drawn = drawn_statistics(random, samples, patches, shares, 499)
    fresh = drawn_statistics(random, samples, patches, shares, 500)
    for level in (0.1, 0.05):
        called = sum(p_value(t, drawn) <= level for t in fresh)
        assert binom.ppf(0.001, 500, 0.8 * level) <= called <= binom.ppf(0.999, 500, 1.2 * level)
    alike = samples.law.sensor.model_copy(update={"tile_spread": None, "robot_spread": None})
    exact = drawn_statistics(
        random, replace(samples, law=replace(samples.law, sensor=alike)), patches, shares, 499
    )
    assert sum(p_value(t, exact) <= 0.05 for t in fresh) > 100


@cache
def law_of(seed: int, values: int) -> Law:
    random = np.random.default_rng(seed)
    vibrating, still = (
        np.abs(energy_of(TRUTH.sensor, kind, random.random(values)).astype(np.float64)) for kind in (1, 0)
    )
    return law_of_measured(vibrating, still, f"{values} values of each kind")


def false_calls(with_error: bool, laws: int) -> int:
    """How many intact surfaces are called at 5 %, by laws of 30 measured values of each kind, 4 by each law."""
    called = 0
    for seed in range(laws):
        law = law_of(seed, 30)
        truth = replace(drawn_samples(seed, count=300, spread_m=0.0), law=TRUTH)
        measured = replace(truth, law=law if with_error else replace(law, draws=()))
        patches = declared(truth.size_m, (0.1, 0.2))
        shares, random = shares_of(truth, patches), np.random.default_rng([seed, 1])
        drawn = drawn_statistics(random, measured, patches, shares, 256)
        logs = log_likelihoods(shares, ratios_at(law, drawn_values(random, truth, 4)))
        called += sum(p_value(t, drawn) <= 0.05 for t in scan_statistic(patches, logs))
    return called


@pytest.mark.long
def test_intact_surfaces_are_seldom_called_by_a_law_of_few_values() -> None:
    """Drawn surfaces are judged as the surface is: by a law that has not seen the values that they measure."""
    assert false_calls(True, 12) <= binom.ppf(0.999, 48, 0.05)
    assert false_calls(False, 25) > binom.ppf(0.999, 100, 0.05)  # the control: as if the law were exact


@pytest.mark.long
def test_laws_of_sessions_are_as_wrong_as_they_say() -> None:
    scenario = preset("calibrated").with_values({"run.t_end_s": 600.0, "floor.source": "random:0.48"})
    found = dataset_of([simulate(scenario, 3, 6, poses=True)])
    laws = [law_of_sessions(found, [session], "one session", draws=10) for session in range(6)]

    def log_means(sensor: object) -> Floats:
        u = (np.arange(500) + 0.5) / 500
        return np.log([energy_of(sensor, kind, u).mean() for kind in (0, 1)])  # type: ignore[arg-type]

    errors = np.array([log_means(law.sensor) - log_means(scenario.sensor) for law in laws])
    stated = np.array([np.std([log_means(one.judge) for one in law.draws], axis=0, ddof=1) for law in laws])
    assert 0.4 < np.sqrt(np.mean((errors / stated) ** 2)) < 1.6


@pytest.mark.parametrize(("name", "contrast"), [("optimised-places", 1.0), ("calibrated", 0.75)])
def test_regions_hold_damage_and_not_damage_beside_it(name: str, contrast: float) -> None:
    samples, random, number = intact(name, 600.0), np.random.default_rng(6), 40
    patches, there = declared(samples.size_m), np.ones(samples.frame.height, dtype=bool)
    squares = squares_at(random, np.full(number, 0.17), samples.size_m, contrast)
    held, beside = 0, 0
    for k, value in enumerate(drawn_values(random, samples, number, squares).T):
        own = samples.with_columns(value=value, log_ratio=ratios_of_values(samples.law, value))
        region = region_of(own, patches, there)
        x_m, y_m = squares.x_m[k], squares.y_m[k]
        held += region.holds(x_m, y_m, 0.17, contrast)
        beside += region.holds(x_m + 0.15, y_m, 0.17, contrast)
    assert held >= binom.ppf(0.001, number, 0.9)
    assert beside <= number / 10


def test_right_laws_are_seldom_refused_and_a_robot_with_another_gain_often_is() -> None:
    scenario = preset("optimised-places").with_values({"run.t_end_s": 400.0})
    refused = {"right": 0, "gain": 0}
    for run in range(12):
        samples = inspect(scenario, seed=9, run=run).samples
        gain = pl.when(pl.col("robot") == 2).then(1.5).otherwise(1.0)
        value = samples.frame.select(pl.col("value") * gain)["value"].to_numpy()
        wrong = samples.with_columns(value=value, log_ratio=ratios_of_values(samples.law, value))
        for name, each in (("right", samples), ("gain", wrong)):
            refused[name] += "refused" in law_checks(each)["outcome"]
    assert refused["right"] <= binom.ppf(0.99, 12, 0.05)
    assert refused["gain"] >= 8
