"""Fit the physics of vibration (sensor ``acceleration``) to labelled samples, and judge it on sessions that it has not seen.

The six fields of ``FIELDS`` are fitted: those that energies depend on and that no data sheet gives. Recordings hold
energies and no acceleration, so the frequencies of motors and tiles are those of the base scenario.

| name | symbol | equation |
|---|---|---|
| features | F | quantiles of the energies on each kind of tile; means over distance to edges, and by neighbours that vibrate |
| misfit | - | sqrt(mean of (F_simulated / F_recorded - 1)^2): a relative RMS over ``features`` |

Simulated samples are taken where and when the recorded ones were, so that only the sensing differs. The same random
numbers are used for all parameters: the misfit is a smooth enough function for a simplex search.
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from vibroswarm.calibrate.dataset import Dataset
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.floors.place import place_of
from vibroswarm.observation.observe import values_at
from vibroswarm.recordings.threshold import resample
from vibroswarm.scenario.scenario import Scenario

Floats = NDArray[np.float64]
FIELDS: Final = (
    "amplitude_m_s2", "coupling", "noise_m_s2", "motor_jitter", "feet_m", "contact_jitter",
)  # fmt: skip
"""Fitted fields of ``sensor.acceleration``."""
QUANTILES: Final = (0.1, 0.25, 0.5, 0.75, 0.9)
EDGES_M: Final = tuple(0.01 * k for k in range(-5, 5))
"""Ends of the bins of the signed distance from an edge, m; negative on vibrating tiles."""
NEIGHBOURS: Final = ((0, 1), (0, 2), (0, 3), (1, 0), (1, 1), (1, 2))
"""Kind of the tile below, and number of vibrating tiles beside it."""
FAR_M: Final = 0.03
"""Samples at least this far from an edge count in the features by neighbours."""
SEEDS: Final = (1, 2)
"""Seeds of the simulated samples; features are means over them."""
DRAWS: Final = 40
"""Bootstrap resamples of samples within sessions."""
_SEED: Final = 37
_STEP: Final = 0.02
"""Relative step of the derivatives of features by parameters."""


@dataclass(frozen=True)
class FoldMisfit(NotebookView):
    """The misfit of a fit to all sessions but one, with errors from a bootstrap of samples within sessions."""

    session: int
    """The session that was left out."""
    inside: float
    """Misfit in the sessions of the fit."""
    outside: float
    """Misfit in the session that was left out."""
    outside_error: float
    forecast: float
    """Misfit of the recorded features of the other sessions as a forecast of this one: what no law can do better."""


@dataclass(frozen=True)
class VibrationFit(NotebookView):
    """Estimates by field (``FIELDS``), their bootstrap draws, and the misfit by feature and by fold."""

    values: dict[str, float]
    draws: dict[str, Floats]
    names: tuple[str, ...]
    """Names of the features."""
    recorded: Floats
    recorded_error: Floats
    simulated: Floats
    """(features,): over all sessions."""
    misfit: float
    folds: tuple[FoldMisfit, ...]
    """Empty if they were not requested, and for fewer than three sessions."""


@dataclass(frozen=True)
class _Samples:
    """Recorded samples of all sessions, with what features depend on, (samples,) each."""

    session: NDArray[np.int64]
    energy: Floats
    edge_m: Floats
    vibrating: NDArray[np.bool_]
    neighbours: NDArray[np.int64]
    """Number of vibrating tiles beside the tile below."""


def feature_names() -> tuple[str, ...]:
    """Return the names of the features, in their order."""
    kinds = {1: "vibrating", 0: "still"}
    return (
        *(f"{kinds[kind]}, {100 * q:.0f} % quantile" for kind in (1, 0) for q in QUANTILES),
        *(f"{1000 * a:.0f} to {1000 * b:.0f} mm from the edge" for a, b in pairwise(EDGES_M)),
        *(f"{kinds[kind]}, {count} vibrating neighbours" for kind, count in NEIGHBOURS),
    )


def features(samples: _Samples, energy: Floats, rows: NDArray[np.int64]) -> Floats:
    """Return the features of some rows, (features,), with other energies; nan for features without a sample.

    Args:
        energy: (samples,). rows: indices, which may repeat.
    """
    own, edge_m = energy[rows], samples.edge_m[rows]
    vibrating, neighbours = samples.vibrating[rows], samples.neighbours[rows]
    found: list[float] = []
    for kind in (True, False):
        of_kind = own[vibrating == kind]
        found += np.quantile(of_kind, QUANTILES).tolist() if of_kind.size else [np.nan] * len(QUANTILES)
    groups = [(edge_m >= a) & (edge_m < b) for a, b in pairwise(EDGES_M)]
    far = np.abs(edge_m) > FAR_M
    groups += [far & (vibrating == kind) & (neighbours == count) for kind, count in NEIGHBOURS]
    found += [float(own[group].mean()) if group.any() else np.nan for group in groups]
    return np.array(found)


def relative_misfit(simulated: Floats, recorded: Floats) -> float:
    """Return the relative RMS over the features that both have."""
    return float(np.sqrt(np.nanmean((simulated / recorded - 1.0) ** 2)))


def vibrating_neighbours(floor: Floor) -> NDArray[np.int64]:
    """Return the number of vibrating tiles beside each tile, (tiles,)."""
    around = np.pad((floor.tiles > 0).astype(np.int64), 1)
    beside = around[:-2, 1:-1] + around[2:, 1:-1] + around[1:-1, :-2] + around[1:-1, 2:]
    return np.asarray(beside.ravel())


class _Simulator:
    """Simulates the energies of all samples of a dataset, for any parameters."""

    def __init__(self, found: Dataset, base: Scenario) -> None:
        self.found, self.base = found, base
        frame = found.samples
        columns = {name: frame[name].to_numpy() for name in ("run", "energy", "edge_m", "vibrating", "tile")}
        run = columns["run"].astype(np.int64)
        beside = [vibrating_neighbours(floor) for floor in found.floors]
        neighbours = np.array([beside[r][t] for r, t in zip(run, columns["tile"], strict=True)])
        self.samples = _Samples(
            run,
            columns["energy"].astype(np.float64),
            columns["edge_m"].astype(np.float64),
            columns["vibrating"].astype(np.bool_),
            neighbours,
        )

    def scenario(self, theta: Floats) -> Scenario:
        """Return the base with parameters, whose logarithms are ``theta``."""
        values = dict(zip(FIELDS, np.exp(theta).tolist(), strict=True))
        return self.base.with_values({f"sensor.acceleration.{name}": value for name, value in values.items()})

    def energies(self, theta: Floats, rows: NDArray[np.int64]) -> Floats:
        """Return simulated energies, (seeds, samples); nan beside ``rows``."""
        sensor = self.scenario(theta).sensor
        out = np.full((len(SEEDS), self.samples.energy.size), np.nan)
        for session in np.unique(self.samples.session[rows]):
            own = np.flatnonzero(self.samples.session == session)
            part, floor = self.found.samples[own], self.found.floors[session]
            columns = [part[name].to_numpy() for name in ("robot", "sample", "x_m", "y_m", "time_s")]
            for n, seed in enumerate(SEEDS):
                found = values_at(sensor, floor.tiles.ravel(), place_of(floor), seed, int(session), *columns)
                out[n, own] = found[:, 0]
        return out

    def simulated(self, theta: Floats, rows: NDArray[np.int64]) -> Floats:
        """Return the mean features of simulated energies at ``rows``."""
        energies = self.energies(theta, rows)
        return np.asarray(np.mean([features(self.samples, energy, rows) for energy in energies], axis=0))

    def recorded(self, rows: NDArray[np.int64]) -> Floats:
        """Return the features of the recorded energies at ``rows``."""
        return features(self.samples, self.samples.energy, rows)

    def fit(self, rows: NDArray[np.int64], start: Floats) -> Floats:
        """Return the logarithms of the parameters with the smallest misfit at ``rows``."""
        recorded = self.recorded(rows)
        low, high = np.log(LIMITS).T

        def loss(theta: Floats) -> float:
            inside = np.clip(theta, low, high)
            return relative_misfit(self.simulated(inside, rows), recorded) + float(
                np.abs(theta - inside).sum()
            )

        options: Any = {"maxfev": 240, "xatol": 0.01, "fatol": 2e-4, "initial_simplex": _simplex(start)}
        best = minimize(loss, start, method="Nelder-Mead", options=options)
        return np.asarray(np.clip(best.x, low, high))


LIMITS: Final = ((0.05, 500.0), (1e-3, 5.0), (1e-3, 50.0), (0.01, 1.5), (1e-3, 0.15), (0.01, 1.5))
"""Lower and upper limit of each field in a fit."""


def _simplex(start: Floats) -> Floats:
    """Return the corners at which the search begins: ``start``, and a step of 25 % along each parameter."""
    return np.vstack([start, start + 0.25 * np.eye(start.size)])


def fit_vibration(found: Dataset, base: Scenario, draws: int = DRAWS, folds: bool = True) -> VibrationFit:
    """Fit the physics to all sessions.

    Args:
        found: sessions, with positions corrected for the camera. base: its sensor is ``acceleration``.
        draws: number of bootstrap resamples. folds: whether to fit also to all sessions but one in turn, if there are
            three or more.
    Raises:
        InputError: all samples lie on one kind of tile.
    """
    simulator = _Simulator(found, base)
    samples = simulator.samples
    if samples.vibrating.all() or not samples.vibrating.any():
        raise InputError(
            "all samples lie on one kind of tile; give recordings with both kinds of tile", field="REAL"
        )
    rows = np.arange(samples.energy.size)
    params = base.sensor.params
    start = np.log(np.clip([getattr(params, name) for name in FIELDS], *np.array(LIMITS).T))
    best = simulator.fit(rows, start)
    recorded = simulator.recorded(rows)
    resamples = [_resampled(samples, rows, draw) for draw in range(draws)]
    scattered = np.array([simulator.recorded(again) for again in resamples]).reshape(draws, recorded.size)
    simulated = simulator.simulated(best, rows)
    shifts = _shifts(simulator, best, rows, (scattered - recorded) / recorded)
    return VibrationFit(
        values={name: float(value) for name, value in zip(FIELDS, np.exp(best), strict=True)},
        draws={name: np.exp(best[k] + shifts[:, k]) for k, name in enumerate(FIELDS)},
        names=feature_names(),
        recorded=recorded,
        recorded_error=scattered.std(axis=0, ddof=1),
        simulated=simulated,
        misfit=relative_misfit(simulated, recorded),
        folds=_folds(simulator, best, draws) if folds else (),
    )


def _folds(simulator: _Simulator, start: Floats, draws: int) -> tuple[FoldMisfit, ...]:
    """Return the misfits of fits to all sessions but one; none for fewer than three sessions."""
    session = simulator.samples.session
    sessions: Sequence[int] = np.unique(session).tolist()
    folds = []
    for left_out in sessions if len(sessions) > 2 else ():
        inside, outside = np.flatnonzero(session != left_out), np.flatnonzero(session == left_out)
        theta = simulator.fit(inside, start)
        predicted = simulator.simulated(theta, outside)
        # Samples drawn again stand for another session of the same length.
        again = [
            relative_misfit(predicted, simulator.recorded(_resampled(simulator.samples, outside, draw)))
            for draw in range(draws)
        ]
        folds.append(
            FoldMisfit(
                session=left_out,
                inside=relative_misfit(simulator.simulated(theta, inside), simulator.recorded(inside)),
                outside=relative_misfit(predicted, simulator.recorded(outside)),
                outside_error=float(np.std(again, ddof=1)),
                forecast=relative_misfit(simulator.recorded(inside), simulator.recorded(outside)),
            )
        )
    return tuple(folds)


def _resampled(samples: _Samples, rows: NDArray[np.int64], draw: int) -> NDArray[np.int64]:
    """Return ``rows`` drawn again with replacement, each session by itself."""
    parts = []
    for session in np.unique(samples.session[rows]):
        own = rows[samples.session[rows] == session]
        parts.append(own[resample(_SEED, draw, int(session), own.size)])
    return np.concatenate(parts)


def _shifts(simulator: _Simulator, best: Floats, rows: NDArray[np.int64], relative: Floats) -> Floats:
    """Return by how much fits to resamples would differ, (draws, fields), to first order in their features.

    Args:
        relative: (draws, features), relative differences of their features.
    """
    middle = simulator.simulated(best, rows)
    slopes = np.stack(
        [
            (simulator.simulated(best + _STEP * unit, rows) / middle - 1.0) / _STEP
            for unit in np.eye(best.size)
        ],
        axis=1,
    )
    known = np.isfinite(slopes).all(axis=1) & np.isfinite(relative).all(axis=0)
    shifts: Any = np.linalg.lstsq(slopes[known], relative[:, known].T, rcond=None)[0].T
    return np.asarray(shifts)
