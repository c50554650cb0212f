"""Fit a camera that sees robots farther from the centre than they are: x' = c + shift + magnification (x - c).

| name | symbol | unit | equation |
|---|---|---|---|
| seen position | x' | m | position of a robot as the camera reports it |
| true position | x | m | position of the robot on the floor |
| centre | c | m | centre of the arena |
| magnification | - | - | 1 + h / (H - h), h the height of the marker on a robot, H the height of the camera |
| shift | - | m | x' - c of a robot at the centre |

Corner markers on the floor do not show this. It can be fitted because the energies show where vibrating and still tiles
meet: the fit maximises the likelihood of ``fit_sensor``'s model, with all tiles and robots alike, in turn over camera
and edges and over Gamma distributions and edges. Positions seen beyond a wall are clipped to it, as in the logs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import polars as pl
from scipy.optimize import minimize

from vibroswarm.calibrate.dataset import Dataset, dataset_of, signed_edge_distance
from vibroswarm.calibrate.fit_sensor import fit_plain, log_likelihoods, unit_of
from vibroswarm.core.arrays import Floats
from vibroswarm.core.child_python import with_one_blas_thread
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario

LEAST_GAIN: Final = 16.3
"""Least gain: chi squared with three degrees of freedom (magnification, two shifts) exceeds it in 0.1 % of cases."""
_BOUNDS: Final = [(-10.0, 10.0), (-3.0, 3.0), (-3.0, 3.0), (-3.0, 8.0), (-2.0, 2.0)]
"""Bounds of the optimiser's five values: magnification - 1 (%), shift in x and in y (cm), reach (cm) and log blur (cm).
The units make the values similar in size, which the optimiser needs."""


@dataclass(frozen=True)
class Camera:
    """A camera that magnifies and shifts the positions of robots; the default is a camera without error."""

    magnification: float = 1.0
    """Seen distance from the arena's centre, divided by the true distance."""
    shift_x_m: float = 0.0
    shift_y_m: float = 0.0

    @classmethod
    def of(cls, scenario: Scenario) -> Camera:
        """Return the camera of the recordings that a scenario was fitted to; a field that is not set has no effect."""
        fields = scenario.camera
        return cls(fields.magnification or 1.0, fields.shift_x_m or 0.0, fields.shift_y_m or 0.0)

    def fields(self) -> dict[str, float]:
        """Return this camera as scenario fields, value by dotted field name; empty for a camera without error."""
        if self == RIGHT:
            return {}
        # A scenario holds fitted values with five digits after the point: lengths to 0.01 mm.
        return {f"camera.{name}": round(value, 5) for name, value in vars(self).items()}

    def true(self, x_m: Floats, y_m: Floats, size_m: tuple[float, float]) -> tuple[Floats, Floats]:
        """Return the true x and y (m) of objects seen at ``x_m``, ``y_m`` in an arena of ``size_m``."""
        x0, y0 = size_m[0] / 2, size_m[1] / 2  # the centre c
        return (
            x0 + (x_m - x0 - self.shift_x_m) / self.magnification,
            y0 + (y_m - y0 - self.shift_y_m) / self.magnification,
        )

    def seen(self, x_m: Floats, y_m: Floats, size_m: tuple[float, float]) -> tuple[Floats, Floats]:
        """Return the x and y (m) at which the camera sees objects; those beyond a wall it sees on the wall."""
        x0, y0 = size_m[0] / 2, size_m[1] / 2  # the centre c
        x = x0 + self.shift_x_m + self.magnification * (x_m - x0)
        y = y0 + self.shift_y_m + self.magnification * (y_m - y0)
        return np.clip(x, 0.0, size_m[0]), np.clip(y, 0.0, size_m[1])


RIGHT: Final = Camera()
"""A camera without error: it sees robots at their true ("right") positions."""


def corrected(result: Result, camera: Camera) -> Result:
    """Return a recording with the true positions of its samples and tracks; a simulation is returned unchanged.

    Positions in ``ends`` and ``poses``, and the tiles in ``observations``, stay those that the camera saw.
    """
    if camera == RIGHT or not isinstance(result, Recording):
        return result
    size_m = result.scenario.arena.size_m
    motion, tracks = (
        _placed(table, *camera.true(*_places(table), size_m)) for table in (result.motion, result.tracks)
    )
    return replace(result, motion=motion, tracks=tracks)


def seen_through(result: Result, camera: Camera) -> Result:
    """Return a simulation with samples where the camera would have seen them; a recording is returned unchanged.

    Bits and energies stay those read at the true positions.
    """
    if camera == RIGHT or isinstance(result, Recording):
        return result
    places = camera.seen(*_places(result.motion), result.scenario.arena.size_m)
    return replace(result, motion=_placed(result.motion, *places))


def _places(table: pl.DataFrame) -> tuple[Floats, Floats]:
    return table["x_m"].to_numpy(), table["y_m"].to_numpy()


def _placed(table: pl.DataFrame, x: Floats, y: Floats) -> pl.DataFrame:
    return table.with_columns(x_m=pl.Series(x), y_m=pl.Series(y))


def corrected_sessions(found: Dataset, camera: Camera) -> Dataset:
    """Return the same sessions with true positions, and all that depends on them; simulations do not change."""
    if camera == RIGHT:
        return found
    return dataset_of([corrected(result, camera) for result in found.results]).only(found.sessions)


@with_one_blas_thread
def fit_camera(found: Dataset) -> Camera:
    """Fit the camera to sessions with positions as it saw them; an exact one (``RIGHT``) if the gain is too small.

    Raises:
        InputError: all samples lie on one kind of tile.
    """
    samples = found.samples
    energy, run = samples["energy"].to_numpy(), samples["run"].to_numpy()
    weight = np.ones(energy.size)
    energy, vibrating = energy / unit_of(energy), samples["vibrating"].to_numpy()

    # Each step of the fit has a vector of its own. The last two values of both vectors are reach and log blur.
    # theta: the Gamma distributions of energies (6 values), reach and log blur, as ``fit_plain`` returns them.
    # at: magnification and shifts (3 values, units as in ``_BOUNDS``), reach and log blur.
    grounds = {
        floor: np.isin(run, [k for k, one in enumerate(found.floors) if one == floor])
        for floor in found.floors
    }

    def edges(at: Floats) -> Floats:
        """Return each sample's signed distance from the nearest edge, at its true position as of a camera."""
        x, y = _camera(at).true(*_places(samples), found.arena_m)
        distance = np.empty(x.size)
        for floor, on_floor in grounds.items():
            distance[on_floor] = signed_edge_distance(floor, x[on_floor], y[on_floor])[0]
        return distance

    def best(theta: Floats, start: Floats) -> Floats:
        """Return the ``at`` of largest likelihood, with the Gamma distributions of ``theta`` fixed."""

        def loss(at: Floats) -> float:
            # The Gamma distributions of ``theta``, with the reach and log blur of ``at``.
            log_likelihood = log_likelihoods(np.r_[theta[:6], at[3:]], energy, edges(at))
            return -float(weight @ log_likelihood) / float(weight.sum())

        # eps: step of the numerical gradient, in the units of ``at``.
        optimum = minimize(
            loss, start, method="L-BFGS-B", bounds=_BOUNDS, options={"maxiter": 40, "ftol": 1e-9, "eps": 1e-4}
        )
        return np.asarray(optimum.x)

    at = np.zeros(5)  # a camera without error
    # ``vibrating`` is for the tile below the seen position. ``fit_plain`` derives only its start values from it, so it
    # is not recomputed for the cameras below.
    theta = fit_plain(energy, edges(at), vibrating)
    before = float(log_likelihoods(theta, energy, edges(at)).sum())
    for _ in range(2):
        # Start from the present camera, and from the reach and log blur that were fitted with it.
        at = best(theta, np.r_[at[:3], theta[6:]])
        theta = fit_plain(energy, edges(at), vibrating)
    gain = 2.0 * (float(log_likelihoods(theta, energy, edges(at)).sum()) - before)
    return _camera(at) if gain >= LEAST_GAIN else RIGHT


def _camera(at: Floats) -> Camera:
    """Return the camera with magnification 1 + at[0] / 100 and shifts at[1] and at[2] (cm); see ``_BOUNDS``."""
    return Camera(1.0 + float(at[0]) / 100.0, float(at[1]) / 100.0, float(at[2]) / 100.0)
