"""How much further from the middle a camera sees robots than they are, from where their readings change.

A camera above sees a marker that stands higher than the floor further out than it is; corner markers on the floor do
not tell. Seen are

    x' = c + shift + magnification (x - c),   c the middle of the arena

and what tells is that vibrating and still tiles must lie where the energies say. Found by maximum likelihood under
``fit_sensor``'s model (without factors), of magnification, shift, reach and blur with the Gammas held, and of the
Gammas, in turn. Where twice the gain in log likelihood is below ``LEAST_GAIN`` the camera is taken to be right.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from vibroswarm.calibrate.camera import RIGHT, Camera
from vibroswarm.calibrate.fit_sensor import fit_plain, log_likelihoods
from vibroswarm.calibrate.measured import Measured, edge_distance
from vibroswarm.draws import Purpose, uniforms

Floats = NDArray[np.float64]

LEAST_GAIN: Final = 16.3
"""0.1 % of chi squared with three degrees of freedom."""
ROUNDS: Final = 2
DRAWS: Final = 12
_SEED: Final = 36
_BOUNDS: Final = [(-10.0, 10.0), (-3.0, 3.0), (-3.0, 3.0), (-3.0, 8.0), (-2.0, 2.0)]
"""Of magnification - 1 (%), shifts (cm), reach (cm) and the blur's logarithm (cm)."""


@dataclass(frozen=True)
class CameraFit:
    """The camera; by figure its draws, (draws,); twice the gain in log likelihood."""

    camera: Camera
    draws: dict[str, Floats]
    gain: float


def fit_camera(found: Measured, draws: int = DRAWS) -> CameraFit:
    """Fit.

    Args:
        found: sessions as they were seen. draws: robots in sessions are drawn anew so often.
    """
    samples = found.samples
    x, y = samples["x_m"].to_numpy(), samples["y_m"].to_numpy()
    energy, run = samples["energy"].to_numpy(), samples["run"].to_numpy()

    def edges(at: Floats) -> Floats:
        true = _camera(at).true(x, y, found.arena_m)
        distance = np.empty(x.size)
        for floor in set(found.floors):
            there = np.isin(run, [k for k, one in enumerate(found.floors) if one == floor])
            distance[there] = edge_distance(floor, true[0][there], true[1][there])[0]
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
    pairs = np.column_stack([run.astype(np.int64), samples["robot"].to_numpy().astype(np.int64)])
    cluster = np.unique(pairs, axis=0, return_inverse=True)[1].ravel()
    clusters = int(cluster.max()) + 1
    rows = []
    for draw in range(draws):
        picked = (uniforms(_SEED, draw, 0, Purpose.BOOTSTRAP, clusters) * clusters).astype(int)
        weight = np.bincount(picked, minlength=clusters)[cluster].astype(float)
        rows.append(_camera(best(theta, np.r_[at[:3], theta[6:]], weight)))
    by_name = {name: np.array([getattr(one, name) for one in rows]) for name in Camera.__dataclass_fields__}
    return CameraFit(_camera(at), by_name, gain)


def _camera(at: Floats) -> Camera:
    return Camera(1.0 + float(at[0]) / 100.0, float(at[1]) / 100.0, float(at[2]) / 100.0)
