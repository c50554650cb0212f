"""Fit the physics of vibration (sensor ``acceleration``) to labelled samples, and judge it on sessions that it has not seen.

The six fields of ``FIELDS`` are fitted: those that energies depend on and that no data sheet gives. Recordings hold
energies and no acceleration, so the frequencies of motors and tiles are those of the base scenario, and so are the time
for which motors hold their amplitude and the distance between a robot's feet.

| name | symbol | equation |
|---|---|---|
| features | F | quantiles of the energies on each kind of tile; means over distance to edges, and by neighbours that vibrate |
| misfit | - | sqrt(mean of (F_simulated / F_recorded - 1)^2): a relative RMS over ``features`` |
| spread of tiles | s_t | s_t^2 = (V(recorded) - V(simulated without)) / r; V: variance between tiles of mean log energies |
| response | r | (V(simulated with s_t = ``TRIAL``) - V(simulated without)) / ``TRIAL``^2 |
| spread of robots | s_r | as s_t, of robots |

Motors show less in energies (r about .7) than they differ, because noise and neighbours add to all; robots all (r near 1).

Features hardly tell scatter that lasts from scatter in time. So the spreads follow from the means of tiles and robots
(``vibration_facts``), and a search finds the other four fields, ``SEARCHED``, with these spreads; this is done twice
(``EVALUATIONS``). Simulated samples are taken where and when the recorded ones were, so that only the sensing differs.
The same random numbers are used for all parameters: the misfit is a smooth enough function for a simplex search.

Errors of fields are for other motors and robots: of ``SEARCHED``, a bootstrap of robots and tiles in sessions; of the
spreads, chi-square of so many of them (``few_groups``). Sessions on one floor have the same motors. Resampled samples
alone gave a quarter to two fifths of the errors of features, where motors and robots differ by 10 to 25 %. Errors of the
misfit are for the same motors and robots.
"""  # noqa: E501

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count, islice, pairwise
from typing import Any, Final

import numpy as np
from scipy.optimize import minimize

from vibroswarm.calibrate.dataset import Dataset
from vibroswarm.calibrate.few_groups import drawn_variances, evenly_drawn
from vibroswarm.calibrate.reading import Reading, readings_beside
from vibroswarm.calibrate.vibration_facts import (
    FAR_M,
    FactSamples,
    fact_samples,
    facts,
    robot_spread,
    tile_spread,
)
from vibroswarm.core.arrays import Floats, Ints
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.numbers import number, percent
from vibroswarm.errors import InputError
from vibroswarm.floors.place import place_of
from vibroswarm.observation.observe import values_at
from vibroswarm.recordings.threshold import resample, robot_and_tile_weights
from vibroswarm.scenario.scenario import Scenario

SEARCHED: Final = ("amplitude_m_s2", "coupling", "noise_m_s2", "motor_jitter")
SPREADS: Final = ("motor_spread", "gain_spread")
FIELDS: Final = (*SEARCHED, *SPREADS)
"""Fitted fields of ``sensor.acceleration``."""
QUANTILES: Final = (0.1, 0.25, 0.5, 0.75, 0.9)
EDGES_M: Final = tuple(0.01 * k for k in range(-5, 5))
"""Ends of the bins of the signed distance from an edge, m; negative on vibrating tiles."""
NEIGHBOURS: Final = ((0, 1), (0, 2), (0, 3), (1, 0), (1, 1), (1, 2))
"""Kind of the tile below, and number of vibrating tiles beside it."""
SEEDS: Final = (1, 2)
"""Seeds of the simulated samples during the search; features are means over them."""
EVALUATIONS: Final = (80, 240)
"""Most evaluations of each search."""
REPEATS: Final = tuple(range(1, 21))
"""Seeds of the simulated samples by which a fit is judged."""
DRAWS: Final = 40
"""Bootstrap resamples."""
TRIAL: Final = 0.2
"""Spreads of the simulations that show how far motors and robots that differ move the energies."""
LEAST_RESPONSE: Final = 0.1
"""Smaller responses count as this: energies then hardly depend on motors, and say nothing of how they differ."""
_SEED: Final = 37
_STEP: Final = 0.02
"""Relative step of the derivatives of features by parameters."""


@dataclass(frozen=True)
class Misfit(NotebookView):
    """Features of recorded sessions beside those of simulations of them, (features,) each."""

    recorded: Floats
    recorded_error: Floats
    """Standard errors, of a bootstrap of samples within sessions."""
    simulated: Floats
    """Means over ``REPEATS``."""
    error: float
    """Standard error of ``value``, of the same bootstrap: resamples stand for other sessions of the same length
    with the same motors and robots."""

    @property
    def value(self) -> float:
        """The relative RMS over the features."""
        return relative_misfit(self.simulated, self.recorded)


@dataclass(frozen=True)
class FoldMisfit(NotebookView):
    """The misfit of a fit to all sessions but one, in that one."""

    session: int
    """The session that was left out."""
    inside: float
    """Misfit in the sessions of the fit."""
    outside: Misfit
    """In the session that was left out."""
    forecast: float
    """Misfit of the recorded features of the other sessions as a forecast of this one: what no law can do better."""


@dataclass(frozen=True)
class VibrationFit(NotebookView):
    """Estimates by field (``FIELDS``), their bootstrap draws, and the misfit by feature and by fold."""

    values: dict[str, float]
    draws: dict[str, Floats]
    names: tuple[str, ...]
    """Names of the features."""
    misfit: Misfit
    """In all sessions."""
    facts: tuple[Reading, ...]
    """What no feature holds, recorded and simulated (``vibration_facts``)."""
    folds: tuple[FoldMisfit, ...]
    """Empty if they were not requested, and for fewer than three sessions."""


def feature_names() -> tuple[str, ...]:
    """Return the names of the features, in their order."""
    kinds = {1: "vibrating", 0: "still"}
    return (
        *(f"{kinds[kind]}, {percent(q, 0)} quantile" for kind in (1, 0) for q in QUANTILES),
        *(f"{number(1000 * a, 0)} to {number(1000 * b, 0)} mm from the edge" for a, b in pairwise(EDGES_M)),
        *(f"{kinds[kind]}, vibrating neighbours: {count}" for kind, count in NEIGHBOURS),
    )


def features(samples: FactSamples, energy: Floats, rows: Ints) -> Floats:
    """Return the features of some rows, (features,); nan for features without a sample.

    Samples more than ``FAR_M`` from an edge count in the features by neighbours.

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


class _Simulator:
    """Simulates the energies of all samples of a dataset, for any parameters."""

    def __init__(self, found: Dataset, base: Scenario) -> None:
        self.found, self.base = found, base
        self.samples, self.energy = fact_samples(found), found.samples["energy"].to_numpy()
        self.rows = np.arange(self.energy.size)

    def energies(
        self,
        values: Mapping[str, float],
        rows: Ints,
        seeds: Sequence[int],
        is_lasting: bool = True,
    ) -> Floats:
        """Return energies simulated with fields (``FIELDS``), (seeds, samples); nan beside ``rows``.

        Args:
            is_lasting: whether motors and robots differ for a whole session. If not, each sample has its own motor and
                robot: features are the same on average, without the luck of a few draws.
        """
        fields = {f"sensor.acceleration.{name}": value for name, value in values.items()}
        if not is_lasting:
            jitter = math.hypot(values["motor_jitter"], values["motor_spread"])
            fields |= {"sensor.acceleration.motor_jitter": jitter, "sensor.acceleration.motor_spread": 0.0}
        sensor = self.base.with_values(fields).sensor
        out = np.full((len(seeds), self.energy.size), np.nan)
        for session in np.unique(self.samples.session[rows]):
            own = np.flatnonzero(self.samples.session == session)
            part, floor = self.found.samples[own], self.found.floors[session]
            columns = [part[name].to_numpy() for name in ("robot", "sample", "x_m", "y_m", "time_s")]
            for n, seed in enumerate(seeds):
                if not is_lasting:
                    columns[0] = np.arange(own.size)
                found = values_at(sensor, floor.tiles.ravel(), place_of(floor), seed, int(session), *columns)
                out[n, own] = found[:, 0]
        return out

    def simulated(
        self,
        values: Mapping[str, float],
        rows: Ints,
        seeds: Sequence[int] = REPEATS,
        is_lasting: bool = True,
    ) -> Floats:
        """Return the mean features at ``rows``, simulated with fields (``FIELDS``)."""
        energies = self.energies(values, rows, seeds, is_lasting)
        return np.asarray(np.mean([features(self.samples, energy, rows) for energy in energies], axis=0))

    def searched(self, theta: Floats, spreads: Floats, rows: Ints) -> Floats:
        """Return the features at ``rows`` of parameters (``_fields``), as the search sees them."""
        return self.simulated(_fields(theta, spreads), rows, SEEDS, is_lasting=False)

    def recorded(self, rows: Ints) -> Floats:
        """Return the features of the recorded energies at ``rows``."""
        return features(self.samples, self.energy, rows)

    def fit(self, rows: Ints, start: Floats) -> tuple[Floats, Floats]:
        """Return the parameters (``_fields``) with the smallest misfit at ``rows``."""
        theta, spreads = start, np.zeros(len(SPREADS))
        for evaluations in EVALUATIONS:
            spreads = self.spreads(theta, rows)
            theta = self.search(rows, theta, spreads, evaluations)
        return theta, spreads

    def search(self, rows: Ints, start: Floats, spreads: Floats, evaluations: int) -> Floats:
        """Return the logarithms of the fields of ``SEARCHED`` with the smallest misfit at ``rows``, given spreads."""
        recorded = self.recorded(rows)
        low, high = np.log(LIMITS).T

        def loss(theta: Floats) -> float:
            inside = np.clip(theta, low, high)
            return relative_misfit(self.searched(inside, spreads, rows), recorded) + float(
                np.abs(theta - inside).sum()
            )

        options: Any = {
            "maxfev": evaluations,
            "xatol": 0.01,
            "fatol": 2e-4,
            "initial_simplex": np.vstack([start, start + 0.25 * np.eye(start.size)]),  # steps of 25 %
        }
        best = minimize(loss, start, method="Nelder-Mead", options=options)
        return np.asarray(np.clip(best.x, low, high))

    def variances(self, energy: Floats, rows: Ints) -> Floats:
        """Return the variances between vibrating tiles, and between robots, of mean log energies at ``rows``."""
        own = (self.samples, energy, rows)
        return np.array([tile_spread(*own) ** 2, robot_spread(*own) ** 2])

    def spreads(self, theta: Floats, rows: Ints) -> Floats:
        """Return the fields of ``SPREADS``; 0 with one robot in a session, or one tile, which cannot differ."""
        without, response = self.without_spreads(theta, rows)
        missing = self.variances(self.energy, rows) - without
        return np.sqrt(np.maximum(np.nan_to_num(missing / response), 0.0))

    def simulated_variances(self, theta: Floats, spread: float, rows: Ints) -> Floats:
        """Return the mean ``variances`` at ``rows``, simulated with parameters and one spread of motors and robots."""
        fields = _fields(theta, np.full(len(SPREADS), spread))
        energies = self.energies(fields, rows, REPEATS)
        return np.asarray(np.mean([self.variances(energy, rows) for energy in energies], axis=0))

    def without_spreads(self, theta: Floats, rows: Ints) -> tuple[Floats, Floats]:
        """Return the ``variances`` simulated without spreads, and the response r to spreads."""
        without = self.simulated_variances(theta, 0.0, rows)
        response = (self.simulated_variances(theta, TRIAL, rows) - without) / TRIAL**2
        return without, np.maximum(response, LEAST_RESPONSE)


LIMITS: Final = ((0.05, 500.0), (1e-3, 5.0), (1e-3, 50.0), (0.01, 1.5))
"""Lower and upper limit of each field of ``SEARCHED``."""


def _fields(theta: Floats, spreads: Floats) -> dict[str, float]:
    """Return fields (``FIELDS``), of which ``theta`` are the logarithms of those of ``SEARCHED``."""
    return dict(zip(FIELDS, (*np.exp(theta).tolist(), *spreads.tolist()), strict=True))


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
    params = base.sensor.params
    start = np.log(np.clip([getattr(params, name) for name in SEARCHED], *np.array(LIMITS).T))
    best, spreads = simulator.fit(simulator.rows, start)
    values = _fields(best, spreads)
    resamples = [_resampled(samples, simulator.rows, draw) for draw in range(draws)]
    return VibrationFit(
        values=values,
        draws=_draws(simulator, best, spreads, draws),
        names=feature_names(),
        misfit=_misfit(simulator, values, simulator.rows, resamples),
        facts=facts_of(simulator, values),
        folds=tuple(_folds(simulator, best, draws)) if folds else (),
    )


def _misfit(
    simulator: _Simulator,
    values: Mapping[str, float],
    rows: Ints,
    resamples: Sequence[Ints],
) -> Misfit:
    """Return the features at ``rows`` beside those simulated with fields; resamples stand for other sessions."""
    simulated = simulator.simulated(values, rows)
    again = [simulator.recorded(own) for own in resamples]
    return Misfit(
        recorded=simulator.recorded(rows),
        recorded_error=np.std(again, axis=0, ddof=1),
        simulated=simulated,
        error=float(np.std([relative_misfit(simulated, recorded) for recorded in again], ddof=1)),
    )


def facts_of(simulator: _Simulator, values: Mapping[str, float]) -> tuple[Reading, ...]:
    """Return the facts of all sessions (``vibration_facts``) beside those simulated with fields (``FIELDS``).

    Facts of a share count energies above ``sensor.rms_threshold``.
    """
    threshold = simulator.base.sensor.rms_threshold
    energies = simulator.energies(values, simulator.rows, REPEATS)
    recorded, *simulated = (
        facts(simulator.samples, energy, threshold) for energy in (simulator.energy, *energies)
    )
    return readings_beside(recorded, simulated)


def _folds(simulator: _Simulator, start: Floats, draws: int) -> Iterator[FoldMisfit]:
    """Return the misfits of fits to all sessions but one; none for fewer than three sessions."""
    session = simulator.samples.session
    sessions: Sequence[int] = np.unique(session).tolist()
    for left_out in sessions if len(sessions) > 2 else ():
        inside, outside = np.flatnonzero(session != left_out), np.flatnonzero(session == left_out)
        values = _fields(*simulator.fit(inside, start))
        resamples = [_resampled(simulator.samples, outside, draw) for draw in range(draws)]
        recorded = simulator.recorded(inside)
        judged = _misfit(simulator, values, outside, resamples)
        yield FoldMisfit(
            session=left_out,
            inside=relative_misfit(simulator.simulated(values, inside), recorded),
            outside=judged,
            forecast=relative_misfit(recorded, judged.recorded),
        )


def _resampled(samples: FactSamples, rows: Ints, draw: int) -> Ints:
    """Return ``rows`` drawn again with replacement, each session by itself."""
    sessions = np.unique(samples.session[rows]).tolist()
    by_session = {session: rows[samples.session[rows] == session] for session in sessions}
    return np.concatenate(
        [own[resample(_SEED, draw, session, own.size)] for session, own in by_session.items()]
    )


def _draws(simulator: _Simulator, best: Floats, spreads: Floats, draws: int) -> dict[str, Floats]:
    """Return what fits to sessions of other motors and robots would find, by field, (draws,)."""
    samples, rows = simulator.samples, simulator.rows
    recorded = simulator.recorded(rows)
    on, ground = samples.vibrating, simulator.found.ground_numbers[samples.session]
    places = np.column_stack((ground, simulator.found.samples["tile"].to_numpy()))
    tile = np.unique(places, axis=0, return_inverse=True)[1].ravel()  # the same in sessions on the same floor
    drawn = (robot_and_tile_weights(_SEED, draw, samples.robot, tile) for draw in count())
    # Without one kind of tile its features are missing.
    with_both = (times for times in drawn if times[on].any() and times[~on].any())
    resamples = [np.repeat(rows, times.astype(np.int64)) for times in islice(with_both, draws)]
    scattered = np.array([simulator.recorded(own) for own in resamples])
    middle = simulator.searched(best, spreads, rows)
    slopes = np.stack(
        [
            (simulator.searched(best + _STEP * unit, spreads, rows) / middle - 1.0) / _STEP
            for unit in np.eye(best.size)
        ],
        axis=1,
    )
    thetas = best + _shifts(slopes, (scattered - recorded) / recorded)
    found = dict(zip(SEARCHED, np.exp(thetas).T, strict=True))
    total = simulator.variances(simulator.energy, rows)
    without, response = simulator.without_spreads(best, rows)
    motors = (tile[samples.far & on], ground)  # and the sets of groups within which they differ
    robots = (samples.robot[samples.far], samples.session)
    for k, (groups, sets) in enumerate((motors, robots)):
        u = evenly_drawn(draws, _SEED, SPREADS[k])
        freedom = max(np.unique(groups).size - np.unique(sets).size, 1)
        between = drawn_variances(total[k], freedom, u) - without[k]
        found[SPREADS[k]] = np.sqrt(np.maximum(between / response[k], 0.0))
    return found


def _shifts(slopes: Floats, relative: Floats) -> Floats:
    """Return by how much searches in resamples would differ, (draws, parameters), to first order in their features.

    Args:
        slopes: (features, parameters), relative change of the features. relative: (draws, features), relative
            differences of their features.
    """
    known = np.isfinite(slopes).all(axis=1) & np.isfinite(relative)  # (draws, features)
    pairs = zip(known, relative, strict=True)
    return np.array([np.linalg.lstsq(slopes[own], of_draw[own], rcond=None)[0] for own, of_draw in pairs])
