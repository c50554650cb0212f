"""False calls of the scan, of the checks of the law, and told against true risks, on simulated inspections."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from scipy.stats import binom

from helpers.inspections import drawn_samples
from vibroswarm.inspection.checks import PLACES, law_checks
from vibroswarm.inspection.damage import drawn_values, patch_of, random_places, ratios_at, values_where
from vibroswarm.inspection.inspection import inspect
from vibroswarm.inspection.missed import pooled_trials
from vibroswarm.inspection.others import by_tiles
from vibroswarm.inspection.patches import Form, declared, log_likelihoods, raster, scan_statistic, shares_of
from vibroswarm.inspection.region import HELD, coarse_shares, posterior_of, region_of
from vibroswarm.inspection.samples import Law, Samples
from vibroswarm.inspection.scan import CELLS, intact_statistics, p_value, statistic_of
from vibroswarm.inspection.stopping import Question, rule_of
from vibroswarm.scenario.scenario import preset

RUNS = range(12)


def simulated(name: str, seed: int) -> list[Samples]:
    scenario = preset(name).with_values(
        {"run.t_end_s": 320.0, "floor.source": "random:0.0", "strategy.name": "places"}
    )
    return [inspect(scenario, seed=seed, run=run).samples for run in RUNS]


@pytest.fixture(scope="module")
def plain() -> list[Samples]:
    return simulated("optimised-places", 41)


@pytest.fixture(scope="module")
def calibrated() -> list[Samples]:
    return simulated("calibrated", 42)


def likely(count: int, of: int, share: float) -> bool:
    """Whether a count is within the 99.8 % range of a binomial with this share."""
    return bool(binom.ppf(0.001, of, share) <= count <= binom.ppf(0.999, of, share))


def test_p_values_of_intact_surfaces_are_right(plain: list[Samples], calibrated: list[Samples]) -> None:
    for inspections in (plain, calibrated):
        p = []
        for number, samples in enumerate(inspections):
            patches = declared(samples.size_m)
            shares = shares_of(samples, patches)
            drawn = intact_statistics(samples, patches, shares, 199, 1)
            p += [p_value(t, drawn) for t in intact_statistics(samples, patches, shares, 40, 1000 + number)]
        for level in (0.1, 0.05, 0.01):
            assert likely(int((np.array(p) <= level).sum()), len(p), level)


def test_intact_surfaces_without_the_spreads_of_the_law_call_too_often(calibrated: list[Samples]) -> None:
    """The control: differences between tiles look like damage to a scan that does not know of them."""
    called = 0
    for number, samples in enumerate(calibrated):
        patches = declared(samples.size_m)
        shares = shares_of(samples, patches)
        alike = samples.law.sensor.model_copy(update={"tile_spread": None, "robot_spread": None})
        law = type(samples.law)(alike, "without spreads")
        random = np.random.default_rng(number)
        values = drawn_values(random, samples, 20)
        blind = samples.with_columns()
        object.__setattr__(blind, "law", law)
        drawn = intact_statistics(blind, patches, shares, 199, 1)
        statistics = scan_statistic(patches, log_likelihoods(shares, ratios_at(law, values)))
        called += sum(p_value(t, drawn) <= 0.05 for t in statistics)
    assert called / 240 > 0.15


def measured(samples: Samples, value: np.ndarray) -> Samples:
    """Return samples with other values."""
    return samples.with_columns(value=value, log_ratio=ratios_at(samples.law, value))


def refused(samples: Samples, seed: int) -> set[str]:
    checks = law_checks(samples, by_tiles(samples), drawn=99, seed=seed)
    return set(checks.filter(pl.col("outcome") == "refused")["check"])


def test_right_laws_are_seldom_refused_and_a_wrong_gain_is(
    plain: list[Samples], calibrated: list[Samples]
) -> None:
    for inspections, power in ((plain, 1.0), (calibrated, 0.2)):
        right, wrong = 0, 0
        for number, samples in enumerate(inspections):
            for values in drawn_values(np.random.default_rng(number), samples, 4).T:
                right += bool(refused(samples.with_columns(value=values), number))
            gain = np.where(samples.frame["robot"].to_numpy() == 0, 1.5, 1.0)
            wrong += bool(refused(samples.with_columns(value=samples.column("value") * gain), number))
        assert right <= binom.ppf(0.999, 48, 0.05)
        assert wrong / len(inspections) >= power


def test_laws_are_seldom_refused_where_half_vibrates_and_a_wrong_gain_and_mirrored_places_are() -> None:
    """Selected by a map to which they had added, samples of right laws were refused in a quarter of inspections.

    Compared on still places alone, a gain of 1.5 was found in two thirds.
    """
    scenario = preset("optimised-places").with_values({"run.t_end_s": 600.0, "floor.source": "random:0.48"})
    of_law, of_places, mirrored, gained, weaker = 0, 0, 0, 0, 0
    for run in range(16):
        samples = inspect(scenario, seed=77, run=run).samples
        checks = refused(samples, run)
        of_law, of_places = of_law + bool(checks - {PLACES}), of_places + (PLACES in checks)
        is_first, x_m = samples.frame["robot"].to_numpy() == 0, samples.column("x_m")
        mirrored += PLACES in refused(samples.with_columns(x_m=np.where(is_first, 1.0 - x_m, x_m)), run)
        more = measured(samples, np.where(is_first, 1.5, 1.0) * samples.column("value"))
        gained += bool(refused(more, run) - {PLACES})
        # Weaker damage is another law, but no difference between robots.
        assert samples.floor is not None
        tile = samples.floor.tile_at(samples.column("true_x_m"), samples.column("true_y_m"))
        vibrates = np.append(samples.floor.tiles.ravel(), 0)[tile, None] == 1
        half = values_where(np.random.default_rng(run), samples, 1, vibrates, 0.7)[:, 0]
        read = measured(samples, half)
        weaker += bool(refused(read, run) & {"robots against each other", "drift"})
    assert of_law <= binom.ppf(0.999, 16, 0.05)
    assert of_places <= 6  # in a tenth of such inspections a robot is lost, and its places are wrong
    assert mirrored >= 14
    assert gained >= 14
    assert weaker <= binom.ppf(0.999, 16, 0.05)


def test_told_risks_are_not_below_true_ones_except_at_weaker_contrast(plain: list[Samples]) -> None:
    question = Question(least_m=0.2, contrasts=(1.0,))
    cleared = {"intact": 0, "damage": 0, "half": 0}
    random = np.random.default_rng(7)
    for samples in plain:
        patches = declared(samples.size_m)
        shares = shares_of(samples, patches)
        x_m, y_m = random_places(random, np.full(40, 0.2), samples.size_m)
        for name, patch in (
            ("intact", None),
            ("damage", patch_of(x_m, y_m, 0.2)),
            ("half", patch_of(x_m, y_m, 0.2, 0.5)),
        ):
            early = samples.by_time(120.0)
            some = shares_of(early, patches)
            values = drawn_values(random, early, 40, patch)
            told = rule_of(early, patches, question).told(values)[0]
            cleared[name] += int((told <= question.risk).sum())
        assert shares.first[-1] > some.first[-1]
    truly = cleared["damage"] / (cleared["damage"] + cleared["intact"])
    assert binom.sf(cleared["damage"] - 1, cleared["damage"] + cleared["intact"], 0.05) > 0.001
    assert truly < 0.09
    # The control: damage at half the contrast is cleared far more often than told.
    assert cleared["half"] / (cleared["half"] + cleared["intact"]) > 0.12


def test_regions_by_many_exact_places_hold_damage_between_declared_places() -> None:
    """The control: shares of exact places, of which the nearest declared one is as unlikely as any."""
    held = {coarse_shares: 0, shares_of: 0}
    for seed in range(40):
        random, law = np.random.default_rng(seed), Law(preset("paper").sensor, "the truth")
        samples = replace(drawn_samples(seed, count=1000, spread_m=0.0), law=law)
        side_m = random.uniform(0.2, 0.28)
        x_m, y_m = random_places(random, np.full(1, side_m), samples.size_m)
        values = drawn_values(random, samples, 1, patch_of(x_m, y_m, side_m))[:, 0]
        read, patches = samples.with_columns(value=values), declared(samples.size_m)
        for shares in held:
            region = region_of(posterior_of(read, patches, shares(read, patches), np.ones(1000, dtype=bool)))
            held[shares] += region.holds(Form(side_m, side_m), x_m[0], y_m[0])
    assert held[coarse_shares] >= binom.ppf(0.001, 40, HELD)
    assert held[shares_of] < binom.ppf(0.001, 40, HELD)


def test_the_region_holds_the_place_size_and_contrast_of_damage_that_was_called(
    plain: list[Samples], calibrated: list[Samples]
) -> None:
    """In 9 of 10 surfaces that were called, or nearly so; a region of the samples of another surface does not."""
    random = np.random.default_rng(11)
    held, of_another = [], []
    for number, samples in enumerate(plain[:6] + calibrated[:6]):
        patches = declared(samples.size_m)
        shares = shares_of(samples, patches)
        critical = np.quantile(intact_statistics(samples, patches, shares, 199, number), 0.95)
        x_m, y_m = random_places(random, np.full(8, 0.17), samples.size_m)
        values = drawn_values(random, samples, 8, patch_of(x_m, y_m, 0.17, 0.9))
        regions, there = [], np.ones(samples.frame.height, dtype=bool)
        weighed = coarse_shares(samples, patches)
        called = statistic_of(samples, patches, shares, values) >= critical
        for value in values.T:
            read = samples.with_columns(value=value)
            regions.append(region_of(posterior_of(read, patches, weighed, there)))
        for k in np.flatnonzero(called):
            damage = Form(0.17, 0.17), x_m[k], y_m[k], 0.9
            held.append(regions[k].holds(*damage))
            of_another.append(regions[(k + 1) % 8].holds(*damage))
    assert len(held) > 70
    assert np.sum(held) >= binom.ppf(0.001, len(held), HELD)
    assert np.mean(of_another) < 0.1


def test_larger_damage_is_found_more_often(plain: list[Samples]) -> None:
    trials = pooled_trials(plain[:6], plain[6:], until_s=300.0, each=5)
    pod = trials.fit()
    assert 0.08 < pod.a90_m < 0.18
    assert pod.a50_m < pod.a90_m < pod.a90_95_m
    assert likely(trials.false, trials.intact, 0.05)
    law = replace(plain[0].law, bits=True)
    read = [replace(samples, law=law) for samples in plain]
    bits = pooled_trials(read[:6], read[6:], until_s=300.0, each=5).fit()
    assert bits.a90_m > pod.a90_m


def test_cells_of_which_the_raster_is_sure_are_damaged_though_damage_lies_between_the_declared_patches() -> (
    None
):
    """With each patch just at its declared place, 86 % of the cells with more than 95 % were."""
    random, law = np.random.default_rng(12), Law(preset("paper").sensor, "preset paper")
    patches, told, damaged = declared((1.0, 1.0)), [], []
    x_m, y_m = np.meshgrid((np.arange(CELLS) + 0.5) / CELLS, 1.0 - (np.arange(CELLS) + 0.5) / CELLS)
    for seed in range(120):
        samples = replace(drawn_samples(seed, count=400, spread_m=0.0, rows=5), law=law)
        side_m = random.uniform(0.07, 0.28, 1)
        patch = patch_of(*random_places(random, side_m, samples.size_m), side_m)
        ratios = ratios_at(law, drawn_values(random, samples, 1, patch))
        logs = log_likelihoods(shares_of(samples, patches), ratios)[:, 0]
        told.append(raster(patches, logs, 0.5, CELLS, samples.size_m))
        damaged.append(patch.distance_m(x_m, y_m) < 0.0)
    sure = np.array(told) > 0.95
    assert np.array(damaged)[sure].mean() > 0.96
    some = (np.array(told) > 0.3) & (np.array(told) < 0.7)
    assert np.array(damaged)[some].mean() == pytest.approx(np.array(told)[some].mean(), abs=0.06)
