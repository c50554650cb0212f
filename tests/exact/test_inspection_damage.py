"""Evidence for patches against direct products; PoD against an independent fit; p-values and what is drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import expit
from scipy.stats import norm

from helpers.inspections import drawn_samples
from vibroswarm import preset
from vibroswarm.floors.surfaces import Patch
from vibroswarm.inspection.damage import drawn_values, ratios_at, squares_at
from vibroswarm.inspection.laws import law_of_measured
from vibroswarm.inspection.patches import declared, log_likelihoods, raster, scan_statistic, shares_of
from vibroswarm.inspection.pod import fit_pod, plan
from vibroswarm.inspection.samples import Law, ratios_of_values
from vibroswarm.inspection.scan import critical_value, p_value
from vibroswarm.observation.energy_model import energy_of

LAW = Law(preset("paper").sensor, "the truth")


def test_evidence_is_the_product_over_samples() -> None:
    samples = drawn_samples(1, count=80, spread_m=0.04)
    patches = declared(samples.size_m, (0.2, (0.3, 0.1)))
    logs = log_likelihoods(shares_of(samples, patches), samples.column("log_ratio")[:, None])[:, 0]
    right = []
    for left, bottom, width, height in patches.boxes:
        qx, qy = (
            norm.cdf(low + side, samples.column(f"{axis}_m"), 0.04)
            - norm.cdf(low, samples.column(f"{axis}_m"), 0.04)
            for axis, low, side in (("x", left, width), ("y", bottom, height))
        )
        q = np.where(qx * qy > 1e-3, qx * qy, 0.0)
        right.append(np.log1p(q * np.expm1(samples.column("log_ratio"))).sum())
    assert logs == pytest.approx(np.array(right), abs=1e-4)
    statistic = max(log - np.log(patches.places[form]) for log, form in zip(right, patches.form, strict=True))
    assert scan_statistic(patches, logs[:, None])[0] == pytest.approx(statistic, abs=1e-4)


def test_the_raster_holds_the_probability_of_damage_and_its_place() -> None:
    patches = declared((1.0, 1.0), (0.2,))
    logs = np.full(patches.form.size, -50.0)
    at = int(np.argmin(np.abs(patches.boxes[:, :2] - [0.6, 0.2]).sum(axis=1)))
    logs[at] = np.log(patches.form.size) + np.log(3.0)  # Lambda is 3
    cells = raster(patches, logs, 0.5, 40, (1.0, 1.0))
    row, column = 39 - int(40 * 0.3), int(40 * 0.7)
    assert cells[row, column] == pytest.approx(0.75, abs=1e-6)
    assert cells[0].max() < 1e-6


@pytest.mark.parametrize("contrast", [1.0, 0.5])
def test_tables_of_ratios_are_the_law_at_values_within_and_beyond_it(contrast: float) -> None:
    from vibroswarm.observation.energy_model import likelihood_at

    random = np.random.default_rng(2)
    gamma = energy_of(LAW.sensor, 1, random.random(300)).astype(np.float64)
    measured = law_of_measured(gamma, 0.5 * gamma, "measured")
    for law in (LAW, measured):
        value = energy_of(law.sensor, 1, random.random(2000), law.place).astype(np.float64)
        on, off = (np.maximum(likelihood_at(law.sensor, c, value), 1e-12) for c in (contrast, 0.0))
        right = ratios_of_values(law, value) if contrast == 1.0 else np.clip(np.log(on / off), -8.0, 8.0)
        assert np.abs(ratios_at(law, value, contrast) - right).mean() < 0.01


def test_drawn_values_have_the_law_the_factors_and_the_damage_at_its_contrast() -> None:
    random, samples = np.random.default_rng(3), replace(drawn_samples(0, count=400, spread_m=0.0), law=LAW)
    x_m, y_m = samples.column("true_x_m"), samples.column("true_y_m")
    square = Patch(*np.full((2, 500), 0.3), *np.full((2, 500), 0.3), np.full(500, 0.5))
    inside = np.maximum(abs(x_m - 0.3), abs(y_m - 0.3)) < 0.15
    values = drawn_values(random, samples, 500, square)
    still, vibrating = (
        float(energy_of(LAW.sensor, k, (np.arange(4000) + 0.5) / 4000).mean()) for k in (0, 1)
    )
    assert values[~inside].mean() == pytest.approx(still, rel=0.01)
    assert values[inside].mean() == pytest.approx(0.5 * (still + vibrating), rel=0.01)
    spread = LAW.sensor.model_copy(update={"robot_spread": 0.3})
    robots = drawn_values(random, replace(samples, law=replace(LAW, sensor=spread)), 500)
    means = np.stack([robots[samples.frame["robot"].to_numpy() == one].mean(axis=0) for one in range(5)])
    assert np.log(means).std() == pytest.approx(0.3, abs=0.05)


def test_pod_is_that_of_an_independent_fit() -> None:
    random, false = np.random.default_rng(4), 0.05
    sizes = np.repeat((0.03, 0.05, 0.07, 0.09, 0.12, 0.15, 0.2, 0.25, 0.3), 400)

    def truth(size: np.ndarray) -> np.ndarray:
        return np.asarray(false + (1.0 - false) * expit(4.0 * np.log(size / 0.09)))

    found = (random.random(sizes.size) < truth(sizes)).astype(float)
    pod = fit_pod(sizes, found, 100, 2000)

    def loss(
        b: np.ndarray,
    ) -> float:  # in other parameters, without the penalty, which 3600 inspections drown
        p = false + (1.0 - false) * expit(b[1] * np.log(sizes / b[0]))
        return float(-np.log(np.where(found == 1.0, p, 1.0 - p)).sum())

    middle, slope = minimize(loss, [0.1, 3.0], method="Nelder-Mead").x
    odds = (0.9 - false) / 0.1
    assert pod.a90_m == pytest.approx(middle * odds ** (1.0 / slope), rel=0.01)
    assert pod.at(pod.a90_m) == pytest.approx(0.9)
    # The limit is about 1.645 standard errors above, which 40 resamples give.
    again = [random.integers(sizes.size, size=sizes.size) for _ in range(40)]
    error = np.std([np.log(fit_pod(sizes[one], found[one], 100, 2000).a90_m) for one in again])
    assert np.log(pod.a90_95_m / pod.a90_m) == pytest.approx(1.645 * error, rel=0.35)


def test_the_critical_value_is_the_least_with_such_a_p_value() -> None:
    drawn = np.random.default_rng(5).integers(0, 30, 199).astype(float)
    critical = critical_value(drawn, 0.05)
    assert p_value(critical, drawn) <= 0.05 < p_value(np.nextafter(critical, -np.inf), drawn)
    assert critical_value(drawn[:10], 0.05) == np.inf


def test_squares_lie_within_the_surface() -> None:
    square = squares_at(np.random.default_rng(6), np.full(1000, 0.3), (1.0, 0.5), 1.0)
    assert (square.x_m >= 0.15).all()
    assert (square.y_m <= 0.35).all()


@pytest.mark.slow
def test_more_time_finds_smaller_damage() -> None:
    table = plan(preset("optimised-places"), [5], [120.0, 600.0], runs=6, each=10)
    assert table["a90_m"][0] is None or table["a90_m"][0] > table["a90_m"][1]
    assert table["samples"][1] > 4 * table["samples"][0]
