"""Fit how far from the centre a camera sees robots, from the positions at which their energies change.

A camera above the arena sees a marker that stands above the floor too far from the centre; corner markers on the floor
do not show this. The model is

    x' = c + shift + magnification (x - c)

with x the true and x' the seen position, and c the centre of the arena. It can be fitted because the energies show
where vibrating and still tiles meet. The fit maximises the likelihood of ``fit_sensor``'s model, with all tiles and
robots alike. In that model, reach and blur (m) say where and how gradually the energies change at an edge. Two steps
alternate. The first maximises over magnification, shift, reach and blur, with the Gamma distributions of energies
fixed. The second maximises over the Gamma distributions, reach and blur, with the camera fixed. If twice the gain in
log likelihood over a camera without error is below ``LEAST_GAIN``, the camera is taken as exact (``RIGHT``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import minimize

from vibroswarm.core.arrays import Floats
from vibroswarm.core.child_python import with_one_blas_thread
from vibroswarm.lab.calibrate.camera import RIGHT, Camera
from vibroswarm.lab.calibrate.dataset import Dataset, signed_edge_distance
from vibroswarm.lab.calibrate.fit_sensor import fit_plain, log_likelihoods, unit_of
from vibroswarm.lab.recordings.threshold import cluster_weights, robot_clusters

LEAST_GAIN: Final = 16.3
"""Least gain: chi squared with three degrees of freedom (magnification, two shifts) exceeds it in 0.1 % of cases."""
ROUNDS: Final = 2
"""How often the fit alternates between the camera and the Gamma distributions."""
DRAWS: Final = 40
"""Bootstrap resamples: from 39 on, one more draw is beyond their limits in 5 % of cases (``few_groups.limits_of``)."""
_SEED: Final = 36
"""Seed of the bootstrap."""
_BOUNDS: Final = [(-10.0, 10.0), (-3.0, 3.0), (-3.0, 3.0), (-3.0, 8.0), (-2.0, 2.0)]
"""Bounds of the optimiser's five values: magnification - 1 (%), shift in x and in y (cm), reach (cm) and log blur (cm).
The units make the values similar in size, which the optimiser needs."""


@dataclass(frozen=True)
class CameraFit:
    """The camera, its bootstrap draws by parameter, (draws,), and twice the gain in log likelihood."""

    camera: Camera
    draws: dict[str, Floats]
    gain: float


@with_one_blas_thread
def fit_camera(found: Dataset, draws: int = DRAWS) -> CameraFit:
    """Fit the camera; if the gain in log likelihood is too small, return an exact camera (``RIGHT``) without draws.

    Args:
        found: sessions, with positions as the camera saw them.
        draws: number of bootstrap resamples of robots in sessions.
    Raises:
        InputError: all samples lie on one kind of tile.
    """
    samples = found.samples
    x, y = samples["x_m"].to_numpy(), samples["y_m"].to_numpy()
    energy, run = samples["energy"].to_numpy(), samples["run"].to_numpy()
    energy = energy / unit_of(energy)

    # Each step of the fit has a vector of its own. The last two values of both vectors are reach and log blur.
    # theta: the Gamma distributions of energies (6 values), reach and log blur, as ``fit_plain`` returns them.
    # at: magnification and shifts (3 values, units as in ``_BOUNDS``), reach and log blur.
    grounds = {
        floor: np.isin(run, [k for k, one in enumerate(found.floors) if one == floor])
        for floor in found.floors
    }

    def edges(at: Floats) -> Floats:
        """Return each sample's signed distance from the nearest edge, at its true position as of a camera."""
        true_x, true_y = _camera(at).true(x, y, found.arena_m)
        distance = np.empty(x.size)
        for floor, on_floor in grounds.items():
            distance[on_floor] = signed_edge_distance(floor, true_x[on_floor], true_y[on_floor])[0]
        return distance

    def best(theta: Floats, start: Floats, weight: Floats) -> Floats:
        """Return the ``at`` of largest likelihood, with the Gamma distributions of ``theta`` fixed.

        ``start`` is the ``at`` that the optimiser starts from; ``weight`` has a weight for each sample.
        """

        def loss(at: Floats) -> float:
            # The Gamma distributions of ``theta``, with the reach and log blur of ``at``.
            log_likelihood = log_likelihoods(np.r_[theta[:6], at[3:]], energy, edges(at))
            return -float(weight @ log_likelihood) / float(weight.sum())

        # eps: step of the numerical gradient, in the units of ``at``.
        optimum = minimize(
            loss, start, method="L-BFGS-B", bounds=_BOUNDS, options={"maxiter": 40, "ftol": 1e-9, "eps": 1e-4}
        )
        return np.asarray(optimum.x)

    equal_weights = np.ones(x.size)
    at = np.zeros(5)  # a camera without error
    # ``vibrating`` is for the tile below the seen position. ``fit_plain`` derives only its start values from it, so it
    # is not recomputed for the cameras below.
    theta = fit_plain(energy, edges(at), samples["vibrating"].to_numpy())
    before = float(log_likelihoods(theta, energy, edges(at)).sum())
    for _ in range(ROUNDS):
        # Start from the present camera, and from the reach and log blur that were fitted with it.
        at = best(theta, np.r_[at[:3], theta[6:]], equal_weights)
        theta = fit_plain(energy, edges(at), samples["vibrating"].to_numpy())
    gain = 2.0 * (float(log_likelihoods(theta, energy, edges(at)).sum()) - before)
    if gain < LEAST_GAIN:
        return CameraFit(RIGHT, draws={}, gain=gain)
    # The bootstrap repeats only the camera's step, with the Gamma distributions of the fit.
    cluster, start = robot_clusters(samples), np.r_[at[:3], theta[6:]]
    cameras = [
        _camera(best(theta, start, weight=cluster_weights(_SEED, draw, stream=0, cluster=cluster)))
        for draw in range(draws)
    ]
    by_name = {
        name: np.array([getattr(camera, name) for camera in cameras]) for name in Camera.__dataclass_fields__
    }
    return CameraFit(_camera(at), draws=by_name, gain=gain)


def _camera(at: Floats) -> Camera:
    """Return the camera with magnification 1 + at[0] / 100 and shifts at[1] and at[2] (cm); see ``_BOUNDS``."""
    return Camera(1.0 + float(at[0]) / 100.0, float(at[1]) / 100.0, float(at[2]) / 100.0)
