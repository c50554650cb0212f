"""What sensors measure on each kind of tile: values, error rates, log likelihood ratios.

| name | symbol | unit | equation |
|---|---|---|---|
| share below | F(theta_E) | - | probability that a sample on one kind of tile reads as class j or below |
| false positive, false negative | - | - | 1 - F_still(theta_E), F_vibrating(theta_E) |
| factor | c | - | E = c G, with G of the kind's law; so E > theta_E if G > theta_E / c; log-normal of mean 1 |
| density | f(E) | - | likelihood of the kind's law; a mean over factors of tiles and robots if these differ |
| log ratio | L | - | ln f_vibrating(E) - ln f_still(E), limited to +- ``MOST`` |
| true and claimed rates | - | - | ``rates``, by which samples are read; ``claimed_rates``, by which robots weigh them |

The laws are those of the scenario's sensor (``sensors``). Those of a sensor that measures at each place depend on the
grid, ``place`` (None: not known, then that of the study). L of a bit is by the rates that robots claim. Near edges a
sample has a value of one kind or the other, never a mixture, so L is the same there. A faulty sensor changes only the
reading. If a fault has changed the bit, so that it contradicts the energy, L is the log ratio
of the bit, by the error rates.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm import sensors
from vibroswarm.core.elementary import exp, log, over_normal
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Place
from vibroswarm.scenario.fields import Sensor
from vibroswarm.sensors import SensorModel


def model_of(sensor: Sensor) -> SensorModel:
    """Return the sensor that a scenario's section selects."""
    return sensors.sensor(sensor.model)


def is_sensed(sensor: Sensor) -> bool:
    """Return whether values depend on the place, so that samples are measured one by one (``SensorModel.sense``)."""
    return model_of(sensor).sense is not None


NO_FACTORS: Final = np.ones(1)
"""One row with factor 1."""
CLAIMED_AS_TRUE: Final = 1e-3
"""Claimed rates that differ by at most this from the true ones count as these."""


def shares_below(
    sensor: Sensor,
    factors: NDArray[np.float64] = NO_FACTORS,
    levels: NDArray[np.float64] | None = None,
    place: Place | None = None,
) -> NDArray[np.float64]:
    """Return the shares at each level that read as each class or lower, (rows, levels, classes - 1), rising."""
    model, p = model_of(sensor), _params(sensor, place)
    every = np.arange(float(sensor.kinds)) if levels is None else levels
    kinds, contrasts = every[every % 1.0 == 0.0].astype(np.int64).tolist(), every[every % 1.0 > 0.0]
    if model.share_at_most is None:
        shares = [model.shares_up_to(kind, factors, p) for kind in kinds]
    else:  # c G <= theta_E is G <= theta_E / c
        shares = [model.share_at_most(kind, sensor.rms_threshold / factors, p)[:, None] for kind in kinds]
    of_kinds = np.stack(shares, axis=1)
    if not contrasts.size:
        return of_kinds
    return np.concatenate([of_kinds, model.shares_at(contrasts, factors, p)], axis=1)


def _params(sensor: Sensor, place: Place | None) -> Any:
    """Return the parameters of the selected sensor, with the grid if its laws depend on it."""
    return model_of(sensor).at_place(sensor.params, place)


def rates(
    sensor: Sensor, place: Place | None = None, levels: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return the probability that a sample at each level reads as each class, (levels, classes), away from edges."""
    factors, weights = typical_factors(sensor) if factors_differ(sensor) else (NO_FACTORS, NO_FACTORS)
    shares = shares_below(sensor, factors, levels, place)
    return np.diff((weights[:, None, None] * shares).sum(axis=0), axis=1, prepend=0.0, append=1.0)


def error_rates(sensor: Sensor, place: Place | None = None) -> tuple[float, float]:
    """Return the probabilities of a false positive and a false negative (``rates``)."""
    return _of_two(sensor, rates(sensor, place))


def _of_two(sensor: Sensor, known: NDArray[np.float64]) -> tuple[float, float]:
    if known.shape != (2, 2):
        raise InputError(f"'{sensor.model}' has no false positives and negatives", field="sensor.model")
    return float(known[0, 1]), float(known[1, 0])


def claimed_rates(sensor: Sensor, place: Place | None = None) -> NDArray[np.float64]:
    """Return ``rates`` as robots believe them: ``sensor.claimed_rates``, else the true ones."""
    return rates(sensor, place) if sensor.claimed_rates is None else np.array(sensor.claimed_rates)


def claimed_error_rates(sensor: Sensor, place: Place | None = None) -> tuple[float, float]:
    """Return ``error_rates`` as robots claim them (``claimed_rates``); raises the same error."""
    return _of_two(sensor, claimed_rates(sensor, place))


def claims_differ(sensor: Sensor, place: Place | None = None) -> bool:
    """Return whether robots claim other rates than the true ones."""
    return sensor.claimed_rates is not None and bool(
        (np.abs(claimed_rates(sensor, place) - rates(sensor, place)) > CLAIMED_AS_TRUE).any()
    )


def factors_differ(sensor: Sensor) -> bool:
    """Return whether tiles or robots have factors of their own; if not, all factors are 1."""
    return sensor.tile_spread is not None or sensor.robot_spread is not None


def energy_of(
    sensor: Sensor, level: float, u: NDArray[np.float64], place: Place | None = None
) -> NDArray[np.float32]:
    """Return what samples measure at a level, at the quantiles ``u`` (in (0, 1)), in the shape of ``u``."""
    return model_of(sensor).values(level, u, _params(sensor, place)).astype(np.float32)


def energies_of(
    sensor: Sensor,
    kind: NDArray[np.uint8],
    u: NDArray[np.float64],
    factors: NDArray[np.float64] | None = None,
    levels: NDArray[np.float64] | None = None,
) -> NDArray[np.float32]:
    """Return what each sample measures, (samples,): the quantile, at its uniform number, of its level's law."""
    energy = np.empty(u.size, dtype=np.float32)
    for k, level in enumerate(range(sensor.kinds) if levels is None else levels.tolist()):
        energy[kind == k] = energy_of(sensor, level, u[kind == k])
    return energy if factors is None else (energy * factors).astype(np.float32)


NODES = 33
"""Number of nodes of the Gauss-Hermite quadrature over factors."""


def typical_factors(sensor: Sensor) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return factors of tile times robot, and weights, (NODES,), for means over both (Gauss-Hermite quadrature)."""
    # The logarithms of a tile's and a robot's factor are normal, so their variances add up.
    spread = math.hypot(sensor.tile_spread or 0.0, sensor.robot_spread or 0.0)
    nodes, weights = over_normal(NODES)
    # The term -spread^2 / 2 gives the log-normal distribution mean 1.
    return exp(spread * nodes - 0.5 * spread**2), weights


MOST: Final = 8.0
"""Limit on the absolute value of L, so that no single energy can decide alone: the law may be wrong."""


def log_ratios(
    sensor: Sensor, observation: NDArray[np.uint8], energy: NDArray[np.float32], place: Place | None = None
) -> NDArray[np.float64]:
    """Return L of each sample, (samples,): of its energy or, if a fault changed the bit, of its bit."""
    without_fault = readings_of(sensor, energy)  # in the precision of the table
    return np.where(
        without_fault == observation,
        log_ratios_of_energies(sensor, energy, place=place),
        log_ratios_of_bits(sensor, observation, place=place),
    )


def readings_of(sensor: Sensor, energy: NDArray[Any]) -> NDArray[np.uint8]:
    """Return what the sensor reads, without a fault, where it measures each energy (or row of numbers)."""
    return model_of(sensor).classes(_values(sensor, energy), sensor.params).astype(np.uint8)


def _values(sensor: Sensor, energy: NDArray[Any]) -> NDArray[Any]:
    """Return values as the functions of the sensor take them: energies or, of ``sense``, rows of all numbers."""
    model = model_of(sensor)
    if model.sense is None or energy.ndim == 2:
        return energy
    unknown = len(model.names_of_numbers(sensor.params)) - 1
    return np.pad(energy[:, None], ((0, 0), (0, unknown)), constant_values=np.nan)


def weighed(
    sensor: Sensor, observation: NDArray[Any], energy: NDArray[np.float32], place: Place | None = None
) -> NDArray[np.float64]:
    """Return the value of each sample, the first of several numbers, and its L, (samples, 2); see ``log_ratios``."""
    value = energy if energy.ndim == 1 else energy[:, 0]
    return np.stack([value, log_ratios(sensor, observation, energy, place)], axis=1)


def log_ratios_of_bits(
    sensor: Sensor, observation: NDArray[Any], place: Place | None = None
) -> NDArray[np.float64]:
    """Return L of each bit, by the error rates that robots claim, limited to +-``MOST``."""
    # Error rates of exactly 0 or 1 would give infinite ratios.
    a, b = np.clip(claimed_error_rates(sensor, place), 1e-6, 1.0 - 1e-6).tolist()
    of_zero, of_one = math.log(b / (1.0 - a)), math.log((1.0 - b) / a)
    return np.clip(np.where(observation == 1, of_one, of_zero), -MOST, MOST)


def log_ratios_of_classes(
    sensor: Sensor, reading: NDArray[Any], kind: int | None = None, place: Place | None = None
) -> NDArray[np.float64]:
    """Return ln P(reading, kind) / P(reading, kind 0) as robots claim, within +-``MOST``; None: any kind but 0."""
    shares = np.maximum(claimed_rates(sensor, place), 1e-6)  # shares of exactly 0 would give infinite ratios
    of_kind = shares[1:].mean(axis=0) if kind is None else shares[kind]
    return np.asarray(np.clip(log(of_kind / shares[0])[reading.astype(np.int64)], -MOST, MOST))


def log_ratios_of_energies(
    sensor: Sensor, energy: NDArray[np.float32], place: Place | None = None
) -> NDArray[np.float64]:
    """Return L of each energy (or row of numbers), limited to +-``MOST``; 0 where the density is 0 on both kinds."""
    exact = energy.astype(np.float64)
    still, vibrating = (log_likelihood(sensor, kind, exact, place) for kind in (0, 1))
    with np.errstate(invalid="ignore"):  # where both densities are 0, -inf - -inf is nan
        return np.clip(np.nan_to_num(vibrating - still, posinf=MOST, neginf=-MOST), -MOST, MOST)


def log_likelihood(
    sensor: Sensor, kind: int, energy: NDArray[np.float64], place: Place | None = None
) -> NDArray[np.float64]:
    """Return ln of the likelihood of energies (or rows of numbers) on a kind, (samples,); a mean over factors."""
    model, p = model_of(sensor), _params(sensor, place)
    found = mean_density(sensor, _values(sensor, energy), lambda value: model.densities(kind, value, p))
    return log(found)


def likelihood_at(
    sensor: Sensor, contrast: float, energy: NDArray[np.float64], place: Place | None = None
) -> NDArray[np.float64]:
    """Return the likelihood of energies at a contrast, (samples,), a mean as in ``log_likelihood``."""
    model, p = model_of(sensor), _params(sensor, place)
    return mean_density(sensor, energy, lambda value: model.densities_at(contrast, value, p))


def mean_density(
    sensor: Sensor, value: NDArray[np.float64], density: Callable[[NDArray[np.float64]], NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Return the mean density of values over the distribution of the factors of tiles and robots, (samples,)."""
    if not factors_differ(sensor):
        return density(value)
    total = np.zeros(len(value))
    for factor, weight in zip(*(each.tolist() for each in typical_factors(sensor)), strict=True):
        # The energy is factor * G, so its density is that of the law at energy / factor, over factor.
        total += weight * (density(value / factor) / factor)
    return total
