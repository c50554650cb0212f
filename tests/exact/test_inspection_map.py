"""The map of tiles against the enumeration of all 2^9 floors of 3 x 3 tiles."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from scipy.special import expit

from helpers.inspections import drawn_samples, enumerated
from vibroswarm.documents.inspection import inspection_document
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.inspection.inspection import inspect
from vibroswarm.inspection.patches import declared, shares_of
from vibroswarm.inspection.samples import Law, Samples, ratios_of_values
from vibroswarm.inspection.sources import grid_of, samples_of_csv
from vibroswarm.inspection.tile_map import tile_map
from vibroswarm.scenario.scenario import preset
from vibroswarm.statistics.map_scores import calibration, map_scores
from vibroswarm.strategies.place_map import add_reading, share_place

FLOORS = range(30)
FALSE_POSITIVE, FALSE_NEGATIVE = 0.1, 0.2


def last_map(samples: Samples, **settings: int) -> np.ndarray:
    return tile_map(samples, [np.inf], **settings)[0]


def compared(tile_m: float, spread_m: float, count: int) -> dict[str, float]:
    """Largest error in a tile, and mean Brier scores, over ``FLOORS``: of the map, and of one sweep."""
    worst, worst_of_one, scores = 0.0, 0.0, []
    for seed in FLOORS:
        samples = drawn_samples(seed, count=count, spread_m=spread_m, tile_m=tile_m)
        exact, found, one = enumerated(samples), last_map(samples), last_map(samples, sweeps=1)
        worst, worst_of_one = max(worst, abs(found - exact).max()), max(worst_of_one, abs(one - exact).max())
        scores.append([map_scores(p, samples.floor)["brier"] for p in (exact, found, one)])
    exact_brier, brier, brier_of_one = np.mean(scores, axis=0)
    return {"worst": worst, "worst of one": worst_of_one, "ratio": brier / exact_brier,
            "ratio of one": brier_of_one / exact_brier}  # fmt: skip


def test_exact_places_give_the_exact_map() -> None:
    for seed in FLOORS:
        samples = drawn_samples(seed, count=60, spread_m=0.0)
        assert abs(last_map(samples) - enumerated(samples)).max() < 1e-12


def test_the_map_is_close_to_exact_with_spreads_of_3_cm_on_tiles_of_20_cm() -> None:
    few, many = compared(0.2, 0.03, 60), compared(0.2, 0.03, 200)
    assert few["worst"] < 0.08
    assert many["worst"] < 0.001
    assert max(few["ratio"], many["ratio"]) < 1.05
    # The control: a map that counts each sample once, in its order, is not as close.
    assert few["worst of one"] > 0.08
    assert many["worst of one"] > 0.02


def test_a_spread_of_3_cm_on_tiles_of_10_cm_costs_no_brier_score() -> None:
    found = compared(0.1, 0.03, 200)
    assert found["ratio"] < 1.05
    assert found["worst"] < 0.05
    assert found["ratio of one"] > 1.5
    assert found["worst of one"] > 0.5


def test_a_spread_of_half_a_tile_leaves_single_tiles_far_off() -> None:
    found = compared(0.1, 0.05, 100)
    assert found["ratio"] < 1.05
    assert 0.3 < found["worst"] < 0.7


def test_the_order_of_samples_does_not_matter() -> None:
    samples = drawn_samples(1, count=150, spread_m=0.03)
    turned = samples.with_frame(samples.frame.reverse().with_columns(time_s=samples.frame["time_s"]))
    assert abs(last_map(samples) - last_map(turned)).max() < 1e-5
    assert abs(last_map(samples, sweeps=1) - last_map(turned, sweeps=1)).max() > 0.001


def test_a_map_over_time_is_that_of_the_samples_so_far() -> None:
    samples = drawn_samples(2, count=150, spread_m=0.03)
    over_time = tile_map(samples, [40.0, 90.0, 149.0])
    for time_s, found in zip((40.0, 90.0, 149.0), over_time, strict=True):
        assert abs(found - last_map(samples.by_time(time_s))).max() < 1e-4


def robots_map(samples: Samples, reach_m: float) -> np.ndarray:
    """The map of a robot of ``places`` that hears all samples, each once, in their order."""
    assert samples.floor is not None
    rows, columns, width_m, height_m, left_m, bottom_m = samples.floor.geometry
    w = SimpleNamespace(
        robots=1, rows=rows, columns=columns, tile_width_m=width_m, tile_height_m=height_m, left_m=left_m,
        bottom_m=bottom_m, false_positive=FALSE_POSITIVE, false_negative=FALSE_NEGATIVE,
    )  # fmt: skip
    a = SimpleNamespace(**{name: np.zeros(9) for name in ("odds", "of_column", "of_row", "p", "p_without")})
    a.weight, a.of_all, a.prior_odds = np.ones(1), np.zeros(1), np.zeros(1)
    p, names = SimpleNamespace(edge_reach_m=reach_m), ("x_m", "y_m", "spread_x_m", "spread_y_m", "log_ratio")
    for *place, log_ratio in zip(*(samples.column(name).tolist() for name in names), strict=True):
        add_reading(a, 0, int(log_ratio > 0.0), *share_place(a, *place, p, w), w)
    return expit(a.odds)


@pytest.mark.parametrize("reach_m", [0.0, 0.02, 0.15])
def test_one_sweep_is_the_map_of_a_robot(reach_m: float) -> None:
    samples = drawn_samples(5, count=120, spread_m=0.03)
    of_bits = np.log([FALSE_NEGATIVE / (1.0 - FALSE_POSITIVE), (1.0 - FALSE_NEGATIVE) / FALSE_POSITIVE])
    samples = samples.with_columns(log_ratio=of_bits[(samples.column("log_ratio") > 0.0).astype(int)])
    sensor = samples.law.sensor.model_copy(update={"edge_reach_m": reach_m})
    felt = replace(samples, law=replace(samples.law, sensor=sensor))
    assert last_map(felt, sweeps=1) == pytest.approx(robots_map(samples, reach_m), abs=1e-12)
    # Negative control: vibration that is felt less or more far gives another map.
    assert np.abs(last_map(felt, sweeps=1) - robots_map(samples, 0.08)).max() > 0.001


@pytest.mark.parametrize("spread_m", [0.0, 0.001])
def test_more_evidence_than_numbers_can_hold_is_weighed_exactly(spread_m: float) -> None:
    """8,000 nats for and 8,008 against a tile: e^8000 is no number."""
    count = 2001
    samples = drawn_samples(6, count=count, spread_m=spread_m)
    for turn in (1.0, -1.0):
        ratio = turn * np.where(np.arange(count) < 1000, 8.0, -8.0)
        at = {name: np.full(count, 0.1) for name in ("x_m", "y_m")}
        p = last_map(samples.with_columns(**at, log_ratio=ratio))
        assert p[6] == pytest.approx(expit(-8.0 * turn), rel=1e-9)
        assert np.delete(p, 6) == pytest.approx(0.5, abs=1e-12)


def test_the_prior_is_the_map_of_tiles_that_were_not_visited() -> None:
    samples = drawn_samples(3, count=60, spread_m=0.0)
    away = samples.with_columns(x_m=np.full(60, 0.1), y_m=np.full(60, 0.1))
    assert np.allclose(tile_map(away, [np.inf], prior=0.2)[0, 0], 0.2)


def test_scores_of_known_maps() -> None:
    samples = drawn_samples(4, count=30, spread_m=0.0)
    x = samples.floor.tiles.ravel().astype(float)
    perfect, nothing = map_scores(x, samples.floor), map_scores(np.full(9, 0.5), samples.floor)
    assert (perfect["brier"], perfect["auc"], perfect["right"], perfect["location_error_m"]) == (0, 1, 1, 0)
    assert (nothing["brier"], nothing["auc"], nothing["right"]) == (0.25, 0.5, 0)
    assert nothing["log_score"] == pytest.approx(np.log(2))
    for most, wrong in ((0.94, 0), (0.96, 9), (1.0, 9)):
        assert map_scores(np.where(x == 1, 1.0 - most, most), samples.floor)["surely_wrong"] == wrong
    wide = Floor(np.array([[1, 0], [0, 0]], dtype=np.uint8), 0.2, 0.1)
    apart_m = [map_scores(p, wide)["location_error_m"] for p in np.eye(4)]
    assert apart_m == pytest.approx([0.0, 0.2, 0.1, np.hypot(0.2, 0.1)])


def test_maps_over_time_are_scored_by_the_floor_at_each_time() -> None:
    changing = {"run.t_end_s": 300.0, "change.at_s": 200, "change.to": "invert", "floor.source": "random:0.2"}
    found = inspect(preset("paper").with_values(changing))
    assert found.pooled is not None
    assert found.vibrates is not None
    assert found.scores["brier"].to_list() == pytest.approx(
        ((found.pooled - found.vibrates) ** 2).mean(axis=1)
    )
    assert found.vibrates[0].sum() + found.vibrates[-1].sum() == 25
    p = found.maps["vibrating"]
    assert found.maps["spread"].to_list() == pytest.approx((p * (1.0 - p)).sqrt().to_list())
    x = found.vibrates.astype(float)
    for wrong, right_from_s in (([], found.times_s[0]), ([0, 4], found.times_s[5]), ([0, len(x) - 1], None)):
        pooled = x.copy()
        pooled[wrong] = 0.5
        assert replace(found, pooled=pooled).right_from_s == right_from_s
    open_too = replace(found, pooled=np.repeat([0.99, 0.5, 0.01], [3, 4, 18])[None, :].repeat(len(x), axis=0))
    assert (
        inspection_document(open_too)
        .answer[0]
        .startswith(
            "3 of 25 tiles vibrate and 18 are still, each with more than 95 %; 4 are open, after 298 s."
        )
    )


def test_samples_of_a_file_are_the_same_in_all_units(tmp_path: Path) -> None:
    x_m, time_s = np.random.default_rng(1).random(30), np.arange(30.0)
    lengths = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
    times = {"s": 1.0, "ms": 0.001, "min": 60.0, "h": 3600.0}
    for (length, in_m), (time, in_s) in itertools.product(lengths.items(), times.items()):
        rows = [f"{t / in_s},{x / in_m},{0.5 / in_m},1" for t, x in zip(time_s, x_m, strict=True)]
        path = tmp_path / "plate.csv"
        path.write_text("\n".join([f"time_{time},x_{length},y_{length},value", *rows]))
        found = samples_of_csv(path, Law(preset("paper").sensor, ""), (1.0, 1.0))
        assert found.column("time_s") == pytest.approx(time_s)
        assert found.column("x_m") == pytest.approx(x_m)
        assert found.column("y_m") == pytest.approx(np.full(30, 0.5))


def test_a_file_may_say_how_wrong_each_place_is(tmp_path: Path) -> None:
    """Such a column was passed over, and all places taken as exact."""
    path, law = tmp_path / "plate.csv", Law(preset("paper").sensor, "")
    rows = [f"{k},0.5,0.5,{k / 10},1" for k in range(30)]
    path.write_text("\n".join(["time_s,x_m,y_m,spread_cm,value", *rows]))
    found = samples_of_csv(path, law, (1.0, 1.0))
    for axis in "xy":
        assert found.column(f"spread_{axis}_m") == pytest.approx(np.arange(30) / 1000)
    assert "their own standard deviations" in found.places
    with pytest.raises(InputError, match="--spread-mm: leave it out: column 'spread_cm' has it"):
        samples_of_csv(path, law, (1.0, 1.0), 0.01)
    text = path.read_text()
    for name in ("spread", "spread_x_mm", "place_spread_m"):
        path.write_text(text.replace("spread_cm", name))
        with pytest.raises(InputError, match=f"plate.csv, {name}: give one standard deviation of places"):
            samples_of_csv(path, law, (1.0, 1.0))
    path.write_text(text.replace("spread_cm", "spread_of_readings"))
    assert "taken as exact" in samples_of_csv(path, law, (1.0, 1.0)).places


def test_calibration_counts_tiles_by_bin() -> None:
    """A probability at an edge is in the bin above it, and 1 in the last."""
    table = calibration(np.array([0.01, 0.4, 0.5, 0.95, 1.0]), np.array([0, 1, 0, 1, 1]))
    assert table["tiles"].to_list() == [1, 2, 2]
    assert table["vibrating"].to_list() == [0.0, 0.5, 1.0]


def test_places_on_the_border_count_as_those_inside_it(tmp_path: Path) -> None:
    """The lower and the right edge of a raster were on no tile, and its border lay half outside of damage."""
    at_m = np.linspace(0.0, 0.9, 6)
    x_m, y_m = (axis.ravel() for axis in np.meshgrid(at_m, at_m))
    raster = pl.DataFrame({"time_s": np.arange(36), "x_m": x_m, "y_m": y_m, "value": np.full(36, 0.5)})
    raster.write_csv(tmp_path / "raster.csv")
    found = inspect(tmp_path / "raster.csv", laws="paper", size_m=(0.9, 0.9), floor=(3, 3))
    each = found.samples.column("log_ratio")[0]
    assert found.pooled is not None
    assert found.pooled[-1] == pytest.approx(
        expit(np.full(9, 4 * each)), rel=1e-9
    )  # two along each side of a tile
    whole = shares_of(found.samples, declared((0.9, 0.9), [0.9]))
    assert whole.share.tolist() == [1.0] * 36


def test_a_map_needs_a_grid() -> None:
    samples = drawn_samples(1, count=60, spread_m=0.0)
    object.__setattr__(samples, "floor", None)
    with pytest.raises(InputError, match="grid"):
        tile_map(samples, [1.0])
    assert grid_of(4, 5, (1.0, 2.0)).geometry == (4, 5, 0.2, 0.5, 0.0, 0.0)


def test_bits_count_by_their_error_rates() -> None:
    from vibroswarm.inspection.samples import Law
    from vibroswarm.observation.energy_model import error_rates

    sensor = preset("paper").sensor
    positive, negative = error_rates(sensor)
    found = ratios_of_values(Law(sensor, "the preset", bits=True), np.array([0.0, 1.0]))
    assert found == pytest.approx(np.log([negative / (1 - positive), (1 - negative) / positive]))
