"""Fit how far from the centre a camera sees robots, from where their readings change.

A camera above sees a marker that stands above the floor too far out; corner markers on the floor do not show
this. The
model is

    x' = c + shift + magnification (x - c),   c the centre of the arena

and it is identified because vibrating and still tiles must lie where the energies say. The fit maximises the
likelihood of
``fit_sensor``'s model (without factors), alternately over magnification, shift, reach and blur with the Gammas
held, and
over the Gammas. If twice the gain in log likelihood is below ``LEAST_GAIN`` the camera is taken as exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from vibroswarm.calibrate.camera import RIGHT, Camera
from vibroswarm.calibrate.dataset import Dataset, signed_edge_distance
from vibroswarm.calibrate.fit_sensor import fit_plain, log_likelihoods
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.recordings.threshold import cluster_weights, robot_clusters

Floats = NDArray[np.float64]

LEAST_GAIN: Final = 16.3
"""0.1 % quantile of chi squared with three degrees of freedom."""
ROUNDS: Final = 2
DRAWS: Final = 12
_SEED: Final = 36
_BOUNDS: Final = [(-10.0, 10.0), (-3.0, 3.0), (-3.0, 3.0), (-3.0, 8.0), (-2.0, 2.0)]
"""Bounds of magnification - 1 (%), shifts (cm), reach (cm) and log blur (cm)."""


@dataclass(frozen=True)
class CameraFit(NotebookView):
    """The camera, its bootstrap draws by parameter, (draws,), and twice the gain in log likelihood."""

    camera: Camera
    draws: dict[str, Floats]
    gain: float


def fit_camera(found: Dataset, draws: int = DRAWS) -> CameraFit:
    """Fit the camera; it is ``RIGHT``, without draws, if the gain in log likelihood is too small.

    Args:
        found: sessions as they were seen. draws: bootstrap resamples of robots in sessions.
    """
    samples = found.samples
    x, y = samples["x_m"].to_numpy(), samples["y_m"].to_numpy()
    energy, run = samples["energy"].to_numpy(), samples["run"].to_numpy()

    def edges(at: Floats) -> Floats:
        true = _camera(at).true(x, y, found.arena_m)
        distance = np.empty(x.size)
        for floor in set(found.floors):
            on_floor = np.isin(run, [k for k, other_floor in enumerate(found.floors) if other_floor == floor])
            distance[on_floor] = signed_edge_distance(floor, true[0][on_floor], true[1][on_floor])[0]
        return distance

    def best(theta: Floats, start: Floats, weight: Floats) -> Floats:
        def loss(at: Floats) -> float:
            likely = log_likelihoods(np.r_[theta[:6], at[3:]], energy, edges(at))
            return -float(weight @ likely) / float(weight.sum())

        found = minimize(
            loss, start, method="L-BFGS-B", bounds=_BOUNDS, options={"maxiter": 40, "ftol": 1e-9, "eps": 1e-4}
        )
        return np.asarray(found.x)

    even = np.ones(x.size)
    at = np.zeros(5)
    theta = fit_plain(energy, edges(at), samples["vibrating"].to_numpy())
    before = float(log_likelihoods(theta, energy, edges(at)).sum())
    for _ in range(ROUNDS):
        at = best(theta, np.r_[at[:3], theta[6:]], even)
        theta = fit_plain(energy, edges(at), samples["vibrating"].to_numpy())
    gain = 2.0 * (float(log_likelihoods(theta, energy, edges(at)).sum()) - before)
    if gain < LEAST_GAIN:
        return CameraFit(RIGHT, {}, gain)
    cluster, start = robot_clusters(samples), np.r_[at[:3], theta[6:]]
    rows = [_camera(best(theta, start, cluster_weights(_SEED, draw, 0, cluster))) for draw in range(draws)]
    by_name = {
        name: np.array([getattr(camera, name) for camera in rows]) for name in Camera.__dataclass_fields__
    }
    return CameraFit(_camera(at), by_name, gain)


def _camera(at: Floats) -> Camera:
    return Camera(1.0 + float(at[0]) / 100.0, float(at[1]) / 100.0, float(at[2]) / 100.0)
