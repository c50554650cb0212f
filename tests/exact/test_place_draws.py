"""Draws of places along paths: as frequent as the weights, along one line as long as these allow, and as spread."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

from vibroswarm import preset, simulate
from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.localisation import locate
from vibroswarm.motion.source import Motion, source
from vibroswarm.robot.place_draws import begin_paths, empty_paths, follow_components, remember_components
from vibroswarm.robot.pose_mixture import Mixture, empty_mixture, resample

COUNT, DRAWS = 8, 20_000
SCENARIO = preset("paper").with_values(
    {
        "strategy.name": "places",
        "localisation.method": "mixture",
        "run.t_end_s": 600.0,
        "odometry.level": "poor",
    }
)


def begun() -> tuple[Mixture, object]:
    f, paths = empty_mixture(COUNT, 4, with_paths=True), empty_paths(DRAWS, COUNT)
    f.weights[:] = 1.0 / COUNT
    f.numbers[0] = 12345
    begin_paths(f, paths, 77)
    return f, paths


def shares(paths: object) -> np.ndarray:
    return np.bincount(paths.component, minlength=COUNT) / DRAWS  # type: ignore[attr-defined]


def test_draws_have_the_weights_and_change_lines_as_seldom_as_these_allow() -> None:
    """After any change of weights; lines are left with half the sum of absolute changes, not more."""
    rng, (f, paths) = np.random.default_rng(1), begun()
    assert shares(paths) == pytest.approx(f.weights, abs=0.012)
    for _ in range(6):
        before, old = paths.component.copy(), f.weights.copy()  # type: ignore[attr-defined]
        f.weights[:] = rng.dirichlet(np.ones(COUNT))
        follow_components(f, paths)
        remember_components(f, paths)
        assert shares(paths) == pytest.approx(f.weights, abs=0.015)
        left = (paths.component != before).mean()  # type: ignore[attr-defined]
        assert left == pytest.approx(0.5 * np.abs(f.weights - old).sum(), abs=0.015)


def test_draws_follow_their_descendants_through_resampling() -> None:
    """Components that are redrawn by weight alone: hardly a draw whose component has copies leaves its line."""
    f, paths = begun()
    f.means[:, 0] = np.arange(COUNT)
    f.weights[:] = [0.5, 0.3, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0]
    follow_components(f, paths)
    remember_components(f, paths)
    line = f.means[paths.component, 0].copy()  # type: ignore[attr-defined]
    assert set(line) == {0.0, 1.0, 2.0}
    resample(f)
    assert f.weights == pytest.approx(1.0 / COUNT)
    follow_components(f, paths)
    after = f.means[paths.component, 0]  # type: ignore[attr-defined]
    copies = np.bincount(f.means[:, 0].astype(int), minlength=COUNT) / COUNT
    moved = 0.5 * np.abs(copies - [0.5, 0.3, 0.2, 0, 0, 0, 0, 0]).sum()
    assert (after != line).mean() == pytest.approx(moved, abs=0.01)
    assert shares(paths) == pytest.approx(np.full(COUNT, 1.0 / COUNT), abs=0.012)


@pytest.fixture(scope="module")
def estimates() -> tuple[pl.DataFrame, np.ndarray, np.ndarray]:
    """Samples, estimates with 60 draws of each place, and without draws."""
    motion = source("event").batch(SCENARIO, 3, range(4), False, True)
    timeline = timeline_of(SCENARIO, motion)
    columns = (timeline.samples, timeline.stop_start_s, timeline.rows.time_s, motion.moves, motion.ends)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(locate, "draws_read", lambda _: 60)
        many = locate.estimate(SCENARIO, 3, *columns)
    return timeline.samples, many, locate.estimate(SCENARIO, 3, *columns)


def test_draws_change_no_estimate(estimates: tuple[pl.DataFrame, np.ndarray, np.ndarray]) -> None:
    _, many, plain = estimates
    assert many[:, :9].tobytes() == plain.tobytes()
    assert plain.shape[1] == 9


def test_draws_and_what_is_left_have_the_spread_of_the_place(
    estimates: tuple[pl.DataFrame, np.ndarray, np.ndarray],
) -> None:
    """Mean over draws is the mean; variance between draws and what is left add up to that of the place."""
    _, many, _ = estimates
    known = many[:, 4] >= 0
    assert np.isnan(many[~known, 9:]).all()
    x_m, left_m = many[known, 9:129:2], many[known, 129]
    mean_m, spread_m = many[known, 5], many[known, 7]
    off = (x_m.mean(axis=1) - mean_m) / spread_m
    assert abs(off.mean()) < 0.05
    assert np.sqrt((off**2).mean()) < 2.0 / np.sqrt(60)
    between = x_m.var(axis=1, ddof=1)
    assert (between + left_m**2).sum() == pytest.approx((spread_m**2).sum(), rel=0.1)
    assert between.sum() > 0.2 * (spread_m**2).sum(), "components differ"


def test_neighbouring_samples_of_a_draw_share_their_errors(
    estimates: tuple[pl.DataFrame, np.ndarray, np.ndarray],
) -> None:
    """Deviations from the mean are correlated from sample to sample; with draws exchanged they are not."""
    samples, many, _ = estimates
    own = (samples["run"] == 0).to_numpy() & (samples["robot"] == 0).to_numpy()
    rows = many[own & (many[:, 4] >= 0)]
    deviation = rows[:, 9:129:2] - rows[:, 5:6]
    exchanged = np.random.default_rng(1).permuted(deviation, axis=1)

    def correlation(of: np.ndarray) -> float:
        return float((of[1:] * of[:-1]).sum() / (of[1:] ** 2).sum())

    assert correlation(deviation) > 0.5
    assert abs(correlation(exchanged)) < 0.2


def test_draws_are_the_same_again_and_others_with_another_seed() -> None:
    # On a network that other tests compile a kernel with draws for.
    network = {"network.name": "loss", "network.loss.share": 0.0}
    given = SCENARIO.with_values({"strategy.places.draws": 3, "run.t_end_s": 200.0} | network)
    one, other = (simulate(given, seed, 1) for seed in (1, 2))
    assert simulate(given, 1, 1).robots.equals(one.robots)
    tables = [
        timeline_of(given, Motion(r.motion, r.ends, None, simulate(given, s, 1, moves=True).moves)).estimates(
            given, s
        )
        for r, s in ((one, 1), (other, 2))
    ]
    assert tables[0].shape[1] == 9 + 2 * 3 + 2
    assert tables[0][-1, 9] != tables[1][-1, 9]
