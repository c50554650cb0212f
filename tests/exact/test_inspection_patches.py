"""Evidence for patches against direct sums, areas against Monte Carlo, and an exactly solved stopping rule."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from scipy.special import ndtr

from helpers.inspections import drawn_samples
from vibroswarm.errors import InputError
from vibroswarm.floors.surfaces import Patch
from vibroswarm.inspection.assessment import _visited
from vibroswarm.inspection.damage import (
    CRACK_M,
    contrast_ratios,
    drawn_patches,
    drawn_values,
    interpolated,
    patch_of,
    random_places,
    ratios_at,
    sensed,
    tables_of,
    values_at,
)
from vibroswarm.inspection.laws import law_of_measured, law_table
from vibroswarm.inspection.missed import SIDES_M as DRAWN_M
from vibroswarm.inspection.missed import lengths_within
from vibroswarm.inspection.patches import (
    LEAST_SHARE,
    declared,
    log_likelihoods,
    logs_at_looks,
    raster,
    scan_statistic,
    shares_of,
    told_risk,
)
from vibroswarm.inspection.samples import Draw, Floats, Law, Samples, ratios_of_values
from vibroswarm.inspection.scan import (
    CELLS,
    Box,
    critical_value,
    intact_statistics,
    looks_of,
    near,
    p_value,
    rasters,
    scan,
)
from vibroswarm.observation.energy_model import energy_of
from vibroswarm.scenario.scenario import preset

SIDES_M = (0.1, 0.2)
LAW = Law(preset("paper").sensor, "preset paper")
CALIBRATED = Law(preset("calibrated").sensor, "preset calibrated")


@pytest.mark.parametrize("points", [1, 2, 9, 4000])
def test_interpolation_is_numpys_bit_by_bit(points: int) -> None:
    random = np.random.default_rng(points)
    for at in (ndtr(np.linspace(-4.5, 4.5, points)), np.linspace(-1.0, 3.0, points)):
        values = random.standard_normal(points)
        x = random.uniform(at[0] - 0.1, at[-1] + 0.1, 500)
        x = np.concatenate([x, at, np.nextafter(at, 9.0), np.nextafter(at, -9.0), [np.nan] * (points > 1)])
        same = np.interp(x, at, values)
        assert np.array_equal(interpolated(x, at, values), same, equal_nan=True)
        assert np.array_equal(interpolated(x[::-1], at, values), same[::-1], equal_nan=True)


def test_random_places_keep_patches_within_the_surface() -> None:
    x, y = random_places(np.random.default_rng(4), np.full(1000, 0.3), (1.0, 0.5))
    for centres, whole in ((x, 1.0), (y, 0.5)):
        assert 0.15 <= centres.min() < 0.16
        assert whole - 0.16 < centres.max() <= whole - 0.15


def test_the_declared_set_covers_the_surface_and_stays_within_it() -> None:
    patches = declared((0.6, 0.9), SIDES_M)
    assert patches.left_m.min() == patches.bottom_m.min() == 0.0
    assert (patches.left_m + patches.width_m).max() == pytest.approx(0.6)
    assert (patches.bottom_m + patches.height_m).max() == pytest.approx(0.9)
    assert patches.weights.sum() == pytest.approx(1.0)
    with pytest.raises(
        InputError, match=r"20 cm x 20 cm is not within .* 0\.6 m x 0\.15 m; .* at most 15 cm"
    ):
        declared((0.6, 0.15), SIDES_M)
    assert declared((0.6, 0.9), [0.2, 0.2, (0.2, 0.2)]).forms == ((0.2, 0.2, False),)  # counts once
    with pytest.raises(InputError, match="size of the surface in m"):  # 1.2 m x 0.8 m, given in mm
        declared((1200.0, 800.0), SIDES_M)


def test_cracks_along_a_narrow_beam_are_declared() -> None:
    """A crack that is declared along both axes lies along the one that it fits; it was refused."""
    assert declared((2.0, 0.1), [(0.3, 0.05), (0.05, 0.3), 0.1]).forms == (
        (0.3, 0.05, False),
        (0.1, 0.1, False),
    )
    for wrong in ([(0.3, 0.15), (0.15, 0.3)], [], "10", [(0.1,)], [True], 0.1):
        with pytest.raises(InputError, match=r"^(sides_m|--sizes): "):
            declared((2.0, 0.1), wrong)  # type: ignore[arg-type]


def test_no_place_lies_between_those_of_narrow_damage() -> None:
    """Cracks of 1 cm were 2.5 cm apart: at a told risk of 5 %, 36 % of cleared surfaces had one between them."""
    patches = declared((0.6, 0.6), [(0.3, 0.01), (0.01, 0.3), 0.015])
    for number, form in enumerate(patches.forms):
        for at_m, side_m in ((patches.left_m, form.width_m), (patches.bottom_m, form.height_m)):
            assert np.diff(np.unique(at_m[patches.form == number])).max() <= side_m + 1e-9
    with pytest.raises(InputError, match="wider damage"):
        declared((1.0, 1.0), [(0.3, 0.001)])


@pytest.mark.parametrize(
    ("spread_m", "reach_m", "blur_m"), [(0.0, 0.0, 0.0), (0.03, 0.0, 0.0), (0.03, 0.02, 0.05)]
)
def test_log_likelihoods_are_direct_sums(spread_m: float, reach_m: float, blur_m: float) -> None:
    samples = drawn_samples(1, count=80, spread_m=spread_m)
    edges = samples.law.sensor.model_copy(update={"edge_reach_m": reach_m, "edge_blur_m": blur_m})
    samples = replace(samples, law=Law(edges, "with edges"))
    patches = declared(samples.size_m, SIDES_M)
    ratios = np.stack([samples.column("log_ratio"), -samples.column("log_ratio")], axis=1)
    found = log_likelihoods(shares_of(samples, patches), ratios)
    spread = max(np.hypot(spread_m, blur_m), 1e-9)
    for j in (0, 17, patches.left_m.size - 1):
        q = np.ones(80)
        for axis, low, side in (
            ("x", patches.left_m[j], patches.width_m[j]),
            ("y", patches.bottom_m[j], patches.height_m[j]),
        ):
            at = samples.column(f"{axis}_m")
            q *= ndtr((low + side + reach_m - at) / spread) - ndtr((low - reach_m - at) / spread)
        q[q <= LEAST_SHARE] = 0.0
        assert found[j] == pytest.approx(np.log1p(q[:, None] * np.expm1(ratios)).sum(axis=0), abs=2e-4)


def test_evidence_of_many_samples_on_a_patch_is_added_up() -> None:
    """The product of their factors is beyond what numbers can hold."""
    samples = drawn_samples(1, count=400, spread_m=0.0)
    found = log_likelihoods(shares_of(samples, declared(samples.size_m, [0.6])), np.full((400, 1), 5.0))
    assert found == pytest.approx(np.full(found.shape, 2000.0))


def test_the_raster_is_the_sum_over_patches_that_may_cover_a_cell() -> None:
    """Each patch lies anywhere within three quarters of a step of its place, but within the surface."""
    samples = drawn_samples(2, count=60, spread_m=0.02)
    patches = declared(samples.size_m, SIDES_M)
    logs = log_likelihoods(shares_of(samples, patches), samples.column("log_ratio")[:, None])[:, 0]
    cells = raster(patches, logs, 0.3, 12, samples.size_m)
    posterior = patches.weights * np.exp(logs.astype(float))
    posterior *= 0.3 / (0.7 + 0.3 * posterior.sum())
    around_m = 0.75 * np.array([form.step_m for form in patches.forms])[patches.form]
    for row, column in ((2, 7), (0, 0), (11, 5)):
        covered = posterior.copy()
        at = (column + 0.5) * 0.05, 0.6 - (row + 0.5) * 0.05
        for axis_m, low_m, side_m in zip(
            at, (patches.left_m, patches.bottom_m), (patches.width_m, patches.height_m), strict=True
        ):
            first_m, last_m = np.maximum(low_m - around_m, 0.0), np.minimum(low_m + around_m, 0.6 - side_m)
            places_m = first_m + (last_m - first_m) * (np.arange(4000)[:, None] + 0.5) / 4000
            covered *= ((places_m <= axis_m) & (axis_m < places_m + side_m)).mean(axis=0)
        assert cells[row, column] == pytest.approx(covered.sum(), abs=1e-4)
    assert told_risk(patches.weights @ np.exp(logs), 0.3) == pytest.approx(posterior.sum())
    unseen = raster(patches, np.zeros_like(logs), 0.3, 12, samples.size_m)
    assert unseen == pytest.approx(unseen[::-1, ::-1])  # all four walls are alike


def test_shares_of_patches_are_their_areas() -> None:
    random = np.random.default_rng(3)
    x, y = random.random((2, 40_000, 1))
    square = sensed(random, LAW.sensor, patch_of(np.array([0.4]), np.array([0.6]), 0.3), x, y)
    disc = sensed(random, LAW.sensor, patch_of(np.array([0.4]), np.array([0.6]), 0.3, disc=True), x, y)
    assert square.mean() == pytest.approx(0.09, abs=0.005)
    assert disc.mean() == pytest.approx(np.pi * 0.15**2, abs=0.005)
    reach = CALIBRATED.sensor.edge_reach_m or 0.0
    blurred = sensed(random, CALIBRATED.sensor, patch_of(np.array([0.4]), np.array([0.6]), 0.3), x, y)
    assert blurred.mean() == pytest.approx((0.3 + 2 * reach) ** 2, abs=0.006)


def test_tables_are_the_laws() -> None:
    u = np.array([0.01, 0.3, 0.7, 0.99])
    for law in (LAW, CALIBRATED):
        for inside in (False, True):
            wanted = energy_of(law.sensor, inside, u)
            assert values_at(law, u, np.full(4, inside)) == pytest.approx(wanted, rel=2e-3)
        value = values_at(law, u, np.full(4, True))
        assert ratios_at(law, value) == pytest.approx(ratios_of_values(law, value), abs=0.03)


def test_tables_of_values_with_a_long_tail_are_the_law() -> None:
    """Energies over several decades, or one value that is far from all others: most values are close together."""
    random = np.random.default_rng(7)
    still, vibrating = (np.exp(random.normal(mean, 2.0, 150)) for mean in (0.0, 3.0))
    with_one = np.exp(random.normal(1.2, 0.6, 150))
    with_one[0] = 1e5
    for law in (
        law_of_measured(vibrating, still, "two decades"),
        law_of_measured(with_one, still**0.3, "one value"),
    ):
        value = values_at(law, random.random(2000), random.random(2000) < 0.5)
        apart = np.abs(ratios_at(law, value) - ratios_of_values(law, value))
        assert apart.mean() < 0.03
        at = tables_of(law).value
        np.testing.assert_array_equal(interpolated(value, at, np.cos(at)), np.interp(value, at, np.cos(at)))


def test_ratios_of_contrasts_go_from_none_to_that_of_the_law() -> None:
    value = values_at(LAW, np.linspace(0.05, 0.95, 19), np.full(19, True))
    nearly = contrast_ratios(LAW, value, 0.9999)
    assert nearly == pytest.approx(ratios_of_values(LAW, value), abs=0.15)
    assert abs(contrast_ratios(LAW, value, 1e-6)).max() < 1e-3
    # A likelihood ratio has mean 1 where there is no damage.
    still = values_at(LAW, (np.arange(4000) + 0.5) / 4000, False)
    for contrast in (0.25, 0.5, 0.75):
        assert np.exp(contrast_ratios(LAW, still, contrast)).mean() == pytest.approx(1.0, abs=0.05)


def test_evidence_added_look_by_look_is_that_of_the_samples_until_then() -> None:
    samples = drawn_samples(count=60, seed=3, spread_m=0.03)
    shares = shares_of(samples, declared(samples.size_m, [0.2, 0.4]))
    ratios = np.random.default_rng(1).normal(size=(60, 5))
    look = np.random.default_rng(2).integers(0, 5, size=60)  # 4: at none of the looks
    for now, logs in enumerate(logs_at_looks(shares, ratios, look, 4)):
        direct = log_likelihoods(shares, np.where(look[:, None] <= now, ratios, 0.0))
        assert np.abs(logs - direct).max() < 1e-12
    # The control: the last samples count at no look.
    assert np.abs(logs - log_likelihoods(shares, ratios)).max() > 0.1


def test_the_scan_statistic_counts_places() -> None:
    patches = declared((0.6, 0.6), SIDES_M)
    logs = np.zeros((patches.left_m.size, 1))
    assert scan_statistic(patches, logs)[0] == pytest.approx(-np.log(patches.places.min()))


def test_the_table_of_a_law_has_the_spread_of_its_draws() -> None:
    """41 laws at even steps: a law more is in one of the 42 gaps around them, below the limits in 1.05 of these."""
    drawn = [LAW.sensor.model_copy(update={"still_scale": 0.2 + 0.01 * k}) for k in range(41)]
    table = law_table(Law(LAW.sensor, "fitted", draws=tuple(Draw(one, one) for one in drawn)))
    row = table.row(by_predicate=pl.col("field") == "sensor.still_scale", named=True)
    assert (row["low"], row["high"], row["value"]) == pytest.approx((0.2005, 0.5995, LAW.sensor.still_scale))
    assert row["error"] == pytest.approx(0.01 * np.sqrt(41 * 42 / 12))


def test_surfaces_are_drawn_from_the_error_of_the_law() -> None:
    samples = drawn_samples(3, count=200, spread_m=0.0)
    sensor = LAW.sensor
    louder = [sensor.model_copy(update={"still_scale": c * sensor.still_scale}) for c in (0.5, 1.0, 2.0)]
    unsure = Law(sensor, "unsure", draws=tuple(Draw(sensor, one) for one in louder))
    spreads = [
        drawn_values(np.random.default_rng(1), replace(samples, law=law), 300).mean(axis=0).std()
        for law in (LAW, unsure)
    ]
    # Means of 200 values differ by chance alone, or between three laws of still means .50, .86 and 1.59.
    means = np.array([0.5, 1.0, 2.0]) * sensor.still_scale * sensor.still_shape + sensor.still_location
    assert spreads[0] < 0.05
    assert spreads[1] == pytest.approx(means.std(), rel=0.05)


def test_differences_between_tiles_and_robots_keep_the_mean_of_the_law() -> None:
    samples = drawn_samples(3, count=200, spread_m=0.0)
    differ = LAW.sensor.model_copy(update={"tile_spread": 0.5, "robot_spread": 0.3})
    alike, apart = (
        drawn_values(np.random.default_rng(1), replace(samples, law=Law(sensor, "drawn")), 2000).mean()
        for sensor in (LAW.sensor, differ)
    )
    assert apart == pytest.approx(alike, rel=0.02)


def test_estimated_places_differ_along_each_axis_by_their_own_spread() -> None:
    """Along x they are unsure, which does not matter for a band across the surface."""
    sure = {"still_scale": 1e-6, "vibrating_scale": 1e-6, "vibrating_location": 5.0}
    samples = drawn_samples(4, count=300, spread_m=0.0).with_columns(spread_x_m=np.full(300, 0.2))
    unknown = samples.with_frame(samples.frame.with_columns(true_x_m=None, true_y_m=None))
    drawn = replace(unknown, law=Law(LAW.sensor.model_copy(update=sure), "drawn"))
    band = Patch(np.full(1, 0.3), np.zeros(1), np.full(1, 9.0), np.full(1, 0.6), np.ones(1))
    value = drawn_values(np.random.default_rng(1), drawn, 1, band)[:, 0]
    assert ((value > 2.0) == (samples.column("y_m") < 0.3)).all()


def test_cracks_lie_along_both_axes_within_the_surface() -> None:
    patch = drawn_patches(np.random.default_rng(2), np.full(2000, 0.3), (1.0, 0.5), 0.5, "crack")
    upright = patch.height_m == 0.3
    assert 0.45 < upright.mean() < 0.55
    assert (np.where(upright, patch.width_m, patch.height_m) == CRACK_M).all()
    assert np.abs(patch.x_m - 0.5).max() <= 0.5 * (1.0 - CRACK_M)
    assert np.abs(patch.y_m[upright] - 0.25).max() <= 0.1
    assert patch.area_m2 == pytest.approx(0.3 * CRACK_M)


def test_false_calls_of_repeated_looks_are_those_of_their_own_threshold() -> None:
    samples = replace(drawn_samples(5, count=240, spread_m=0.0), law=LAW)
    patches = declared(samples.size_m, SIDES_M)
    shares = shares_of(samples, patches)
    once, often = (
        np.quantile(intact_statistics(samples, patches, shares, 1000, 1, looks=looks), 0.95)
        for looks in (1, 8)
    )
    fresh = intact_statistics(samples, patches, shares, 1000, 2, looks=8)
    assert 0.03 < (fresh >= often).mean() < 0.07
    assert (fresh >= once).mean() > 0.09  # the control: the threshold of one look
    # Damage is called at the first look that reaches its threshold.
    value = drawn_values(np.random.default_rng(5), samples, 1, patch_of(*np.full((2, 1), 0.3), 0.2, 0.5))[
        :, 0
    ]
    damaged = samples.with_columns(value=value, log_ratio=ratios_at(LAW, value))
    found, (times_s, _) = scan(damaged, patches, shares, replicates=99, looks=8), looks_of(damaged, 8)
    logs = log_likelihoods(shares, np.stack([drawn_until(damaged, time_s) for time_s in times_s], axis=1))
    reached = scan_statistic(patches, logs) >= found.critical
    assert 0 < reached.argmax() < 7
    assert reached[-1]
    assert (found.looks, found.called_s) == (8, times_s[reached.argmax()])
    # Of damage that is repaired, patches are called by the samples of the look at which it was most evident.
    still = values_at(LAW, np.random.default_rng(6).random(240), False)
    value = np.where(samples.column("time_s") < 120.0, value, still)
    repaired = samples.with_columns(value=value, log_ratio=ratios_at(LAW, value))
    at_looks, at_end = (scan(repaired, patches, shares, replicates=99, looks=looks) for looks in (8, 1))
    assert (len(at_looks.called_m), len(at_end.called_m)) == (1, 0)
    assert at_looks.p_value <= 0.05 < at_end.p_value


def test_a_place_without_samples_is_not_called() -> None:
    """The samples on a called patch are left out of the next scan, and early ones are few: none say nothing.

    With declared sizes that are easily told from an intact surface, nearly all intact ones are below T of no samples.
    """
    samples = replace(drawn_samples(7, count=900, spread_m=0.0), law=LAW)
    patches = declared(samples.size_m, (0.14, 0.28))
    shares = shares_of(samples, patches)
    critical = critical_value(intact_statistics(samples, patches, shares, 199, 1), 0.05)
    assert critical < scan_statistic(patches, np.zeros((patches.form.size, 1)))[0]
    middle = np.full(1, 0.3)
    for damage, number in ((patch_of(middle, middle, 0.14), 1), (None, 0)):
        value = drawn_values(np.random.default_rng(2), samples, 1, damage)[:, 0]
        drawn = samples.with_columns(value=value, log_ratio=ratios_at(LAW, value))
        found = scan(drawn, patches, shares, replicates=199)
        assert len(found.called_m) == number
        assert (found.raster.max() > 0.9) == bool(number)  # what is called stays on the raster
        over_time, _ = rasters(drawn, patches, shares, critical, 0.5, np.array([20.0, 900.0]))
        assert over_time[1] == pytest.approx(found.raster)
    early = log_likelihoods(shares, drawn_until(drawn, 20.0)[:, None])[:, 0]
    assert over_time[0] == pytest.approx(raster(patches, early, 0.5, CELLS, samples.size_m))


def drawn_until(samples: Samples, time_s: float) -> Floats:
    """The log ratios of the samples until a time, and 0 for the others."""
    return np.where(samples.column("time_s") <= time_s, samples.column("log_ratio"), 0.0)


def test_values_are_exchanged_within_a_robots_block_of_two_minutes_only() -> None:
    samples = replace(drawn_samples(7, count=600, spread_m=0.0), law=LAW)
    time_s, patches = samples.column("time_s"), declared(samples.size_m, SIDES_M)
    place_m, ratio = (np.where(time_s < 120.0, early, later) for early, later in ((0.1, 0.5), (1.0, -1.0)))
    early = (time_s >= 120.0).astype(float)
    for slower, robot, p in ((1.0, 0.0, 1.0), (0.1, 0.0, 0.01), (0.1, early, 1.0)):  # 0.1: all is one block
        drawn = samples.with_columns(x_m=place_m, y_m=place_m, log_ratio=ratio, time_s=slower * time_s)
        drawn = drawn.with_columns(robot=np.zeros(600) + robot)
        found = scan(drawn, patches, shares_of(drawn, patches), replicates=99)
        assert found.permuted_p_value == pytest.approx(p)


def test_exchanged_values_are_looked_at_as_often_as_the_samples() -> None:
    """Within each block of time all values are the same; damage was most evident at the first look."""
    samples = drawn_samples(7, count=600, spread_m=0.0)
    ratio, place_m = np.where(samples.column("time_s") < 120.0, 1.0, -1.0), np.full(600, 0.1)
    samples = samples.with_columns(x_m=place_m, y_m=place_m, log_ratio=ratio, robot=np.zeros(600))
    patches = declared(samples.size_m, SIDES_M)
    assert scan(samples, patches, shares_of(samples, patches), replicates=19, looks=5).permuted_p_value == 1.0


def test_samples_near_a_patch_are_within_5_cm_and_three_standard_deviations() -> None:
    samples = drawn_samples(7, count=400, spread_m=0.0).with_columns(spread_x_m=np.linspace(0.0, 0.1, 400))
    x_m, y_m, spread_m = (samples.column(name) for name in ("x_m", "y_m", "spread_x_m"))
    wide = (x_m > 0.15 - 3.0 * spread_m) & (x_m < 0.35 + 3.0 * spread_m) & (y_m > 0.25) & (y_m < 0.38)
    assert (near(samples, Box(0.2, 0.3, 0.1, 0.03)) == wide).all()


def test_half_of_a_wide_surface_is_visited() -> None:
    wide = replace(drawn_samples(7, count=100, spread_m=0.0), size_m=(2.0, 1.0))
    at_m = np.arange(100) / 100 + 0.005
    assert _visited(wide.with_columns(x_m=at_m // 0.1 * 0.1 + 0.05, y_m=at_m * 10 % 1)) == 0.5


def test_looks_are_evenly_spaced_over_the_samples_whenever_the_clock_was_started() -> None:
    samples = drawn_samples(5, count=240, spread_m=0.0)
    times_s, look = looks_of(samples, 8)
    assert (np.bincount(look, minlength=8) > 0).all()
    assert times_s[0] == pytest.approx(times_s[-1] / 8)
    assert samples.with_columns(time_s=samples.column("time_s") + 30.0).began_s == 0.0
    later = samples.with_columns(time_s=samples.column("time_s") + 36_000.0)  # seconds of the day
    times_s, look = looks_of(later, 8)
    assert (np.bincount(look, minlength=8) > 0).all()
    assert later.column("time_s").min() < times_s[0] < times_s[-1] == later.column("time_s").max()


@pytest.mark.parametrize(("surfaces", "level"), [(999, 0.05), (199, 0.1), (19, 0.05), (150, 0.07)])
def test_what_reaches_the_critical_value_has_a_p_value_of_the_level_at_most(
    surfaces: int, level: float
) -> None:
    """Readings of few samples give few different statistics, so that many surfaces have the same."""
    random = np.random.default_rng(surfaces)
    for drawn in (random.standard_normal(surfaces), random.integers(0, 6, surfaces).astype(np.float64)):
        critical = critical_value(drawn, level)
        for statistic in np.concatenate([drawn, [critical, drawn.max() + 1.0]]):
            assert (statistic >= critical) == (p_value(statistic, drawn) <= level)


@pytest.mark.parametrize("size_m", [(1.0, 1.0), (1.5, 0.2), (0.12, 1.2), (0.04, 0.04), (2.0, 0.01)])
def test_damage_that_is_drawn_fits_a_surface_of_any_size(size_m: tuple[float, float]) -> None:
    random = np.random.default_rng(1)
    for shape in ("square", "disc", "crack"):
        lengths_m = lengths_within(size_m, shape)
        assert len(lengths_m) >= 3
        patch = drawn_patches(random, np.repeat(lengths_m, 50), size_m, 1.0, shape)
        for centre_m, side_m, whole_m in zip(patch[:2], patch[2:4], size_m, strict=True):
            assert (centre_m - 0.5 * side_m >= -1e-9).all()
            assert (centre_m + 0.5 * side_m <= whole_m + 1e-9).all()
    assert lengths_within((1.0, 1.0)) == list(DRAWN_M)
    assert lengths_within((1.5, 0.2), "crack")[-1] == 0.8  # along the beam; it was 0.2, the beam's height
