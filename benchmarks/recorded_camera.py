"""Test what moved the robots in the study's recordings outwards: the height of their markers, or the camera's lens.

    VIBROSWARM_RUGBOT=folder python benchmarks/recorded_camera.py --draws 20

As ``calibrate.fit_camera``, from where readings change at tile edges, with one term more:

    x' = c + shift + (m + k (r^2 / R^2 - 1)) (x - c),   r the distance from the centre as seen, R that of a corner

Corner markers on the floor fix the image there. So markers that stand higher than these have m > 1 everywhere and
k = 0, about the point below the camera, c - shift / (m - 1). A barrel lens that is ignored has m = 1 at the corners and
k < 0: most in between. Both are fitted, alone and together. A control shows the same places through such a
lens: it must be distinguished from a height. Standard errors: robots of sessions are resampled.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.optimize import minimize

from vibroswarm.calibrate.dataset import Dataset, dataset_of, signed_edge_distance
from vibroswarm.calibrate.fit_sensor import fit_plain, log_likelihoods
from vibroswarm.paper.real_data import REAL, read_recordings
from vibroswarm.recordings.threshold import cluster_weights, robot_clusters

Floats = NDArray[np.float64]
BOUNDS = [(-10.0, 10.0), (-3.0, 3.0), (-3.0, 3.0), (-20.0, 20.0), (-3.0, 8.0), (-2.0, 2.0)]
"""Of m - 1 (%), shifts (cm), k (%), reach (cm) and log blur (cm)."""
HEIGHT, LENS_ALONE = (3,), (0,)
"""Parameters that are 0 in both models."""
LENS = -0.06
"""k of the control."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=20)
    given = parser.parse_args()
    folder = Path(os.environ["VIBROSWARM_RUGBOT"])
    found = dataset_of([read_recordings(folder, REAL)])
    report("recordings", found, given.draws)
    for name in REAL:
        report(f"  {name} alone", dataset_of([read_recordings(folder, (name,))]), 0)
    # Control: the same places and readings as a camera with an ignored lens would have seen them.
    magnified, *_ = fit(found, np.ones(found.samples.height), HEIGHT)
    x, y = true_of(magnified, found)
    report(f"control, a lens with k = {100 * LENS:.0f} %", with_places(found, *through_lens(x, y)), 4)


def with_places(found: Dataset, x: Floats, y: Floats) -> Dataset:
    """Return a dataset with other places."""
    return replace(found, samples=found.samples.with_columns(x_m=pl.Series(x), y_m=pl.Series(y)))


def through_lens(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return where a lens that is ignored, k = ``LENS``, shows points; fixed points are the corners."""
    dx, dy = x - 0.5, y - 0.5
    seen_x, seen_y = dx, dy
    for _ in range(30):  # r is that of the image
        scale = 1.0 + LENS * ((seen_x**2 + seen_y**2) / 0.5 - 1.0)
        seen_x, seen_y = scale * dx, scale * dy
    return 0.5 + seen_x, 0.5 + seen_y


def true_of(at: Floats, found: Dataset) -> tuple[Floats, Floats]:
    """Return true places by parameters in the order of ``BOUNDS``."""
    x0, y0 = found.arena_m[0] / 2, found.arena_m[1] / 2
    dx = found.samples["x_m"].to_numpy() - x0 - at[1] / 100
    dy = found.samples["y_m"].to_numpy() - y0 - at[2] / 100
    scale = 1.0 + at[0] / 100 + at[3] / 100 * ((dx**2 + dy**2) / (x0**2 + y0**2) - 1.0)
    return x0 + dx / scale, y0 + dy / scale


def fit(
    found: Dataset, weight: Floats, held: tuple[int, ...], start: Floats | None = None
) -> tuple[Floats, float]:
    """Return the parameters in the order of ``BOUNDS``, those of ``held`` being 0, and the log likelihood."""
    energy, run = found.samples["energy"].to_numpy(), found.samples["run"].to_numpy()
    vibrating = found.samples["vibrating"].to_numpy()

    def edges(at: Floats) -> Floats:
        x, y = true_of(at, found)
        distance = np.empty(x.size)
        for floor in set(found.floors):
            on_floor = np.isin(run, [k for k, other in enumerate(found.floors) if other == floor])
            distance[on_floor] = signed_edge_distance(floor, x[on_floor], y[on_floor])[0]
        return distance

    at = np.zeros(6) if start is None else start.copy()
    theta = fit_plain(energy, edges(at), vibrating)
    bounds = [(0.0, 0.0) if k in held else pair for k, pair in enumerate(BOUNDS)]
    for _ in range(2):
        gammas = theta[:6]

        def loss(now: Floats, gammas: Floats = gammas) -> float:
            likely = log_likelihoods(np.r_[gammas, now[4:]], energy, edges(now))
            return -float(weight @ likely) / float(weight.sum())

        options = {"maxiter": 60, "ftol": 1e-10, "eps": 1e-4}
        at = np.asarray(
            minimize(loss, np.r_[at[:4], theta[6:]], method="L-BFGS-B", bounds=bounds, options=options).x
        )
        theta = fit_plain(energy, edges(at), vibrating)
    return at, float(log_likelihoods(theta, energy, edges(at)).sum())


def report(name: str, found: Dataset, draws: int) -> None:
    """Print the fits, the centre of the magnification, and standard errors."""
    even = np.ones(found.samples.height)
    height, of_height = fit(found, even, HEIGHT)
    lens, of_lens = fit(found, even, LENS_ALONE)
    both, of_both = fit(found, even, (), height)
    middle = 100 * centre_of(height)
    print(
        f"{name}: {found.samples.height} samples\n"
        f"    height alone: m - 1 = {height[0]:.2f} %, about ({middle[0]:+.1f}, {middle[1]:+.1f}) cm from the arena's "
        f"centre\n    lens alone: k = {lens[3]:.2f} %; twice its log likelihood less that of the height: "
        f"{2 * (of_lens - of_height):+.1f}\n"
        f"    both: m - 1 = {both[0]:.2f} %, k = {both[3]:.2f} %; twice the gain over "
        f"the height {2 * (of_both - of_height):.1f}, over the lens {2 * (of_both - of_lens):.1f}",
        flush=True,
    )
    if draws < 2:
        return
    cluster = robot_clusters(found.samples)
    weights = [cluster_weights(36, k, 0, cluster) for k in range(draws)]
    heights = np.array([fit(found, weight, HEIGHT, height)[0] for weight in weights])
    boths = np.array([fit(found, weight, (), both)[0] for weight in weights])
    off = 100 * np.array([centre_of(row) for row in heights]).std(axis=0, ddof=1)
    spread = boths.std(axis=0, ddof=1)
    print(
        f"    standard errors ({draws} draws): centre {off[0]:.1f} and {off[1]:.1f} cm; both: "
        f"m {spread[0]:.2f} %, k {spread[3]:.2f} %",
        flush=True,
    )


def centre_of(at: Floats) -> Floats:
    """Return the point that does not move, from the arena's centre, m."""
    found: Floats = -at[1:3] / 100 / (at[0] / 100)
    return found


if __name__ == "__main__":
    main()
