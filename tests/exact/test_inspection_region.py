"""Discs of the declared set, and the joint region of place, size and contrast."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from helpers.inspections import drawn_samples
from vibroswarm.inspection.damage import (
    contrast_ratios,
    drawn_values,
    patch_of,
    ratios_at,
    tiles_below,
    values_at,
)
from vibroswarm.inspection.laws import law_of_measured
from vibroswarm.inspection.patches import Form, declared, log_likelihoods, raster, shares_of, strips_of
from vibroswarm.inspection.region import HELD, STRENGTHS, between, design_effects, posterior_of, region_of
from vibroswarm.inspection.samples import Law, Samples
from vibroswarm.inspection.scan import scan
from vibroswarm.observation.energy_model import energy_of
from vibroswarm.scenario.scenario import preset

LAW = Law(preset("paper").sensor, "preset paper")
DISC = Form(0.2, 0.2, True)


def test_strips_of_a_disc_have_its_area_and_stay_within_its_square() -> None:
    patches = declared((0.6, 0.6), [DISC, 0.1])
    strips = strips_of(patches, 0.01)
    areas = np.add.reduceat(
        (strips.right_m - strips.left_m) * (strips.top_m - strips.bottom_m), strips.first[:-1]
    )
    is_disc = patches.form == 0
    assert areas[is_disc] == pytest.approx(np.pi * 0.11**2)
    assert areas[~is_disc] == pytest.approx(0.12**2)
    assert strips.left_m.min() >= -0.01 - 0.002
    assert strips.bottom_m.min() == pytest.approx(-0.01)


def test_the_share_of_a_place_in_a_disc_is_that_of_draws_about_it() -> None:
    samples = drawn_samples(1, count=80, spread_m=0.03)
    patches = declared(samples.size_m, [DISC])
    shares = shares_of(samples, patches)
    random, j = np.random.default_rng(1), 30
    x_m, y_m = patches.left_m[j] + 0.1, patches.bottom_m[j] + 0.1
    found = np.zeros(80)
    part = slice(shares.first[j], shares.first[j + 1])
    found[shares.sample[part]] = shares.share[part]
    at_m = [
        samples.column(f"{axis}_m")[:, None] + 0.03 * random.standard_normal((80, 20_000)) for axis in "xy"
    ]
    direct = (np.hypot(at_m[0] - x_m, at_m[1] - y_m) < 0.1).mean(axis=1)
    assert found == pytest.approx(direct, abs=0.02)
    square = shares_of(samples, declared(samples.size_m, [0.2]))  # the control
    part = slice(square.first[j], square.first[j + 1])
    assert np.abs(square.share[part] - direct[square.sample[part]]).max() > 0.1


def test_the_raster_of_a_disc_is_round() -> None:
    patches = declared((0.2, 0.2), [DISC])
    cells = raster(patches, np.array([50.0]), 0.5, 40, (0.2, 0.2))
    assert cells.mean() == pytest.approx(np.pi / 4.0, abs=0.03)
    assert cells[0, 0] == cells[-1, -1] == 0.0
    assert cells[20, 20] == pytest.approx(1.0)


def damaged(seed: int, contrast: float) -> Samples:
    samples = replace(drawn_samples(seed, count=500, spread_m=0.01), law=LAW)
    random = np.random.default_rng(seed)
    patch = patch_of(np.array([0.33]), np.array([0.27]), 0.2, contrast, disc=True)
    return samples.with_columns(value=drawn_values(random, samples, 1, patch)[:, 0])


def test_a_region_holds_its_share_of_the_density() -> None:
    samples = damaged(2, 1.0)
    patches = declared(samples.size_m, [0.14, 0.2, DISC, Form(0.3, 0.1)])
    shares = shares_of(samples, patches)
    unseen = posterior_of(samples, patches, shares, np.zeros(500, dtype=bool))
    assert np.bincount(unseen.shape, unseen.p) == pytest.approx(
        [0.5, 0.25, 0.25], abs=1e-3
    )  # however many places
    posterior = posterior_of(samples, patches, shares, np.ones(500, dtype=bool))
    region = region_of(posterior)
    drawn = posterior.drawn(np.random.default_rng(5), 4000)
    inside = posterior.density(*drawn) >= region.least
    assert inside.mean() == pytest.approx(HELD, abs=0.02)
    cells = np.histogram2d(*drawn[1][:2, inside], bins=24, range=[[0.0, 0.6]] * 2)[0] > 0.0
    assert region.centre_m2 == pytest.approx(cells.sum() * 0.025**2, rel=0.25)
    assert posterior.p.sum() == pytest.approx(1.0)
    # The density integrates to 1: its mean over places drawn from another density, divided by that one.
    wide = replace(posterior, triangles=posterior.triangles + np.array([-0.02, 0.0, 0.02])[None, :, None])
    others = wide.drawn(np.random.default_rng(6), 20_000)
    assert (posterior.density(*others) / wide.density(*others)).mean() == pytest.approx(1.0, abs=0.05)


def test_size_and_contrast_of_damage_are_in_its_region_and_others_are_not() -> None:
    held = []
    for seed in range(10):
        for contrast in (1.0, 0.5):
            samples = damaged(seed, contrast)
            patches = declared(samples.size_m, [Form(side, side, True) for side in (0.1, 0.14, 0.2, 0.28)])
            region = region_of(
                posterior_of(samples, patches, shares_of(samples, patches), np.ones(500, dtype=bool))
            )
            held.append(region.holds(DISC, 0.33, 0.27, contrast))
            assert max(region.contrast or (2.0,)) <= 1.0
            assert not region.holds(
                DISC, 0.13, 0.47, contrast
            )  # controls: elsewhere, of another shape, much weaker
            assert not region.holds(Form(0.2, 0.2), 0.33, 0.27, contrast)
            assert not region.holds(DISC, 0.33, 0.27, 0.1)
    assert np.mean(held) >= 0.75


def test_sizes_far_apart_have_others_between_them() -> None:
    """Of 7 and 28 cm alone squares of 20 cm at full contrast were in 15 % of regions: as weaker ones of 28 cm."""
    squares = [Form(side, side) for side in (0.28, 0.07)]
    between_them = between((*squares, Form(0.3, 0.05), Form(0.14, 0.14, True)))
    sides = sorted(
        form.width_m for form in between_them if form.width_m == form.height_m and not form.is_disc
    )
    assert sides == pytest.approx([0.07, 0.07 * 2**0.5, 0.14, 0.14 * 2**0.5, 0.28])
    assert len(between_them) == 7
    usual = declared((1.0, 1.0)).forms
    assert between(usual) == usual
    samples = replace(drawn_samples(4, count=900, spread_m=0.01), law=LAW)
    value = drawn_values(np.random.default_rng(4), samples, 1, patch_of(*np.array([[0.33], [0.27]]), 0.2))[
        :, 0
    ]
    seen = samples.with_columns(value=value, log_ratio=ratios_at(LAW, value))
    patches = declared(samples.size_m, squares)
    found = scan(seen, patches, shares_of(seen, patches), replicates=19)
    assert found.regions[0].holds(Form(0.2, 0.2), 0.33, 0.27)


def test_factors_that_samples_share_make_a_region_wider() -> None:
    """By the design effect 1 + rho (m - 1): all samples on the patch are of one robot, of some tiles."""
    samples = damaged(3, 1.0)
    patches = declared(samples.size_m, [0.2])
    shares = shares_of(samples, patches)
    assert design_effects(samples, shares)[0] == 1.0
    differ = replace(LAW, sensor=LAW.sensor.model_copy(update={"robot_spread": 0.3}))
    alone = replace(samples, law=differ, frame=samples.frame.with_columns(robot=pl.lit(0, pl.UInt16)))
    log_value = np.log(energy_of(LAW.sensor, 1, (np.arange(20_000) + 0.5) / 20_000))
    rho = 0.3**2 / (0.3**2 + log_value.var())
    m = float(shares.share[: shares.first[1]].sum())
    assert design_effects(alone, shares)[0] == pytest.approx(1.0 + rho * (m - 1.0), rel=0.01)


def test_design_effects_are_those_of_all_groups_and_widen_a_region() -> None:
    samples = damaged(3, 1.0)
    spreads = {"tile_spread": 0.3, "robot_spread": 0.15}
    seen = replace(samples, law=replace(LAW, sensor=LAW.sensor.model_copy(update=spreads)))
    patches = declared(samples.size_m, [0.14, 0.3])
    shares = shares_of(seen, patches)
    found = design_effects(seen, shares)
    alone = np.log(energy_of(LAW.sensor, 1, (np.arange(20_000) + 0.5) / 20_000)).var()
    for j in (0, 40, patches.form.size - 1):
        own = slice(shares.first[j], shares.first[j + 1])
        sample, q = shares.sample[own], shares.share[own]
        effect = 1.0
        for group, spread in ((tiles_below(seen), 0.3), (seen.frame["robot"].to_numpy(), 0.15)):
            together = (np.bincount(group[sample], q) ** 2).sum() / q.sum()
            effect += spread**2 / (alone + 0.3**2 + 0.15**2) * max(together - 1.0, 0.0)
        assert found[j] == pytest.approx(effect, rel=0.01)
    ratios = np.stack([contrast_ratios(seen.law, seen.column("value"), c) for c in STRENGTHS], axis=1)
    logs = log_likelihoods(shares, ratios)
    p = patches.weights[:, None] * np.exp((logs - logs.max()) / found[logs.max(axis=1).argmax()])
    posterior = posterior_of(seen, patches, shares, np.ones(500, dtype=bool))
    assert np.sort(posterior.p)[-9:] == pytest.approx(np.sort(p / p.sum(), axis=None)[-9:], rel=1e-3)
    left, top, right = posterior.triangles[:2].swapaxes(0, 1)
    assert right - top == pytest.approx(top - left)  # places may lie on all sides


def test_the_design_effect_does_not_depend_on_the_unit_and_exists_for_equal_values() -> None:
    samples = drawn_samples(8, count=300, spread_m=0.0)
    shares = shares_of(samples, declared(samples.size_m, [0.3]))
    still, vibrating = np.random.default_rng(8).gamma(4.0, ([0.5], [1.5]), (2, 100))
    effects = [
        design_effects(
            replace(samples, law=law_of_measured(unit * vibrating, unit * still, "", (0.1, 0.1))), shares
        )[0]
        for unit in (1.0, 1e-6, 1e6)
    ]
    assert effects[0] > 1.01
    assert effects == pytest.approx([effects[0]] * 3, rel=1e-6)
    saturated = law_of_measured(np.full(100, 5.0), still, "")  # at its limit where it vibrates
    assert design_effects(replace(samples, law=saturated), shares)[0] == 1.0


def test_measured_values_fit_their_own_contrast_best() -> None:
    """Of the mean of the log likelihood the true law has most (Gibbs): half of the contrast fitted better."""
    exact = Law(preset("paper").sensor, "exact")
    for seed in range(2):
        random = np.random.default_rng(seed)
        vibrating, still = (np.abs(values_at(exact, random.random(300), kind == 1)) for kind in (1, 0))
        law = law_of_measured(vibrating, still, "300 values of each kind")
        for true in (0.5, 1.0):
            value = values_at(exact, random.random(5000), True, true)
            means = {contrast: contrast_ratios(law, value, contrast).mean() for contrast in STRENGTHS}
            assert max(means, key=lambda contrast: means[contrast]) == true
