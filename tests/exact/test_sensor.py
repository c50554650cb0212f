"""The reading of a sample: error rates, bits and energies, against scipy and the known figures."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from scipy import stats

from vibroswarm.floors.floor import Floor
from vibroswarm.motion.motion_tables import MOTION
from vibroswarm.observation.energy_model import energies_of, error_rates, shares_below
from vibroswarm.observation.observe import OBSERVATIONS, observe
from vibroswarm.scenario.fields import Sensor
from vibroswarm.scenario.scenario import Scenario, preset

CHEQUERED = Floor.filling([[0, 1, 0], [1, 0, 1]])


def places(count: int, width_m: float = 1.0, robots: int = 1) -> pl.DataFrame:
    """A motion table of ``count`` samples a robot at random places, width_m x 1 m."""
    rng = np.random.default_rng(7)
    rows = count * robots
    frame = pl.DataFrame(
        {
            "run": np.zeros(rows, np.uint32),
            "robot": np.repeat(np.arange(robots, dtype=np.uint16), count),
            "sample": np.tile(np.arange(count, dtype=np.uint32), robots),
            "x_m": width_m * rng.random(rows),
            "y_m": rng.random(rows),
        }
    )
    return frame.with_columns(
        **{name: pl.lit(None, kind) for name, kind in MOTION.items() if name not in frame.columns}
    ).select(list(MOTION))


def observed(
    sensor: Sensor, floor: Floor = CHEQUERED, count: int = 20_000, width_m: float = 1.0
) -> pl.DataFrame:
    return observe(Scenario(sensor=sensor), 3, places(count, width_m), {0: floor})


@pytest.mark.parametrize(
    ("threshold", "false_positive", "false_negative"), [(1.33, 14.4, 14.1), (1.55, 8.2, 20.8)]
)
def test_error_rates_are_the_known_ones(
    threshold: float, false_positive: float, false_negative: float
) -> None:
    rates = [round(100 * rate, 1) for rate in error_rates(Sensor(rms_threshold=threshold))]
    assert rates == [false_positive, false_negative]
    # Negative control: a threshold that is off by 0.01 gives other digits.
    off = [round(100 * rate, 1) for rate in error_rates(Sensor(rms_threshold=threshold + 0.01))]
    assert off[0] != false_positive
    assert off[1] != false_negative


@pytest.mark.parametrize("threshold", [0.0, 0.1, 0.5, 1.33, 1.55, 4.0, 60.0])
@pytest.mark.parametrize("vibrating", [False, True])
def test_share_below_is_that_of_the_gamma_distribution(threshold: float, vibrating: bool) -> None:
    sensor = Sensor(rms_threshold=threshold)
    shape, loc, scale = (5.33497, -0.2001, 0.5132) if vibrating else (2.52194, 0.13731, 0.28754)
    expected = float(stats.gamma.cdf(threshold, shape, loc, scale))
    assert shares_below(sensor)[0, int(vibrating), 0] == pytest.approx(expected, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("vibrating", [False, True])
def test_energies_are_gamma_quantiles(vibrating: bool) -> None:
    u = np.r_[1e-6, np.linspace(0.001, 0.999, 999), 1 - 1e-9]
    shape, loc, scale = (5.33497, -0.2001, 0.5132) if vibrating else (2.52194, 0.13731, 0.28754)
    energy = energies_of(Sensor(), np.full(u.size, vibrating, dtype=np.uint8), u)
    assert energy.dtype == np.float32
    np.testing.assert_allclose(energy, stats.gamma.ppf(u, shape, loc, scale), rtol=2e-7, atol=2e-8)


@pytest.mark.parametrize(
    "sensor",
    [
        Sensor(),
        Sensor(rms_threshold=1.55),
        Sensor(rms_threshold=0.0),
        preset("text").sensor,
        Sensor(model="energies", vibrating_energies=(3.0, 1.0, 2.5, 1.33), still_energies=(0.5, 1.5, 0.25)),
    ],
)
def test_the_bit_says_whether_the_energy_is_above_the_threshold(sensor: Sensor) -> None:
    table = observed(sensor)
    assert dict(table.schema) == OBSERVATIONS
    expected = table["energy"].to_numpy() > np.float32(sensor.rms_threshold)
    assert (table["observation"].to_numpy() == expected).all()
    assert expected.any()


def test_the_preset_text_has_the_labels_as_they_are_printed() -> None:
    false_positive, false_negative = error_rates(preset("text").sensor)
    assert false_positive == pytest.approx(float(stats.gamma.sf(1.55, 5.33, -0.20, 0.51)), rel=1e-12)
    assert false_negative == pytest.approx(float(stats.gamma.cdf(1.55, 2.52, 0.14, 0.29)), rel=1e-12)
    assert min(false_positive, false_negative) > 0.75  # a robot that sees the floor inverted


def test_measured_energies_are_drawn_evenly() -> None:
    still, vibrating = (0.5, 1.5, 0.25, 0.75), (3.0, 1.0, 2.5)
    sensor = Sensor(model="energies", vibrating_energies=vibrating, still_energies=still)
    assert error_rates(sensor) == (pytest.approx(1 / 4), pytest.approx(1 / 3))
    table = observed(sensor)
    below = CHEQUERED.tiles.ravel()[table["tile"].to_numpy()] == 1
    for values, here in ((vibrating, below), (still, ~below)):
        energies, counts = np.unique(table["energy"].to_numpy()[here], return_counts=True)
        assert energies.tolist() == sorted(values)
        assert stats.chisquare(counts).pvalue > 1e-3 / 2
        # Negative control: one value drawn 10 % too often.
        assert stats.chisquare(counts + np.eye(len(values), dtype=int)[0] * (counts[0] // 10)).pvalue < 1e-2


def test_a_measured_energy_on_the_threshold_reads_as_still() -> None:
    sensor = Sensor(model="energies", rms_threshold=1.5, vibrating_energies=(1.5,), still_energies=(1.5, 1.0))
    assert error_rates(sensor) == (0.0, 1.0)
    assert observed(sensor)["observation"].sum() == 0


def test_another_floor_changes_no_noise() -> None:
    flipped = Floor.filling(1 - CHEQUERED.tiles)
    one, other = observed(Sensor()), observed(Sensor(), flipped)
    all_still = observed(Sensor(), Floor.filling([[0]]))
    still = CHEQUERED.tiles.ravel()[one["tile"].to_numpy()] == 0
    energy = np.where(still, one["energy"], other["energy"])
    assert (energy == all_still["energy"].to_numpy()).all()


def test_numbers_do_not_depend_on_the_other_rows() -> None:
    samples = places(300, robots=3)
    whole = observe(Scenario(), 3, samples, {0: CHEQUERED})
    some = samples.filter((pl.col("robot") == 2) & (pl.col("sample") % 7 == 3))
    part = observe(Scenario(), 3, some, {0: CHEQUERED})
    assert part.equals(whole.filter((pl.col("robot") == 2) & (pl.col("sample") % 7 == 3)))
