"""Memory of a robot's localisation: a mixture of Gaussians over its pose, see ``localisation``."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner

X: Final = 0
Y: Final = 1
HEADING: Final = 2
SPEED: Final = 3
BIAS: Final = 4
SCALE: Final = 5
STATES: Final = 6

RANDOM: Final = 0
SAMPLES: Final = 1
"""Indices into ``Mixture.numbers``: the state of the random numbers, and the samples so far."""

UNEXPECTED: Final = 0
OBSTACLES: Final = 1
"""Indices into ``Mixture.monitor``."""
KEPT: Final = 0.95
"""What the monitor keeps of its sums at each obstacle: a memory of 20."""
USUAL: Final = 0.5
"""What is usually unexpected per obstacle, at most: 0.25 to 0.45 in simulations whose robots know their laws."""
AT_START: Final = 0.4
"""What is presumed for as many obstacles as are remembered."""

ESTIMATE: Final = ("x_m", "y_m", "heading_rad", "spread_m", "lagged_sample", "lagged_x_m", "lagged_y_m",
                   "lagged_spread_x_m", "lagged_spread_y_m")  # fmt: skip
"""What ``sampled`` gives: where the robot believes it is, the standard deviation of that (the root of the mean of those
in x and in y), and the number (-1: none yet) and place of the sample ``lag`` ago, with standard deviations."""

UNKNOWN: Final = 0.4
"""Standard deviation of a component at an unknown start, as a share of half the range: overlapping ones find more."""
WORD: Final = 0xFFFFFFFF


class LocalisationProgram(NamedTuple):
    """What the robot knows of itself and of the arena; units in the names."""

    width_m: float
    height_m: float
    radius_m: float
    ray_forward_m: float
    ray_side_m: NDArray[np.float64]
    ray_cos: NDArray[np.float64]
    ray_sin: NDArray[np.float64]
    """(rays,)."""
    avoidance_threshold_m: float
    blind_s: float
    """So long after a turn no ray is heeded."""
    full_speed_m_s: float
    battery_life_s: float
    speed_factor: float
    speed_spread: float
    """Mean and standard deviation of the law of speed factors."""
    speed_redrawn: bool
    """Whether the speed is another after each sample."""
    speed_wander: float
    gyro_scale_spread: float
    gyro_bias_spread_rad_s: float
    turn_noise_rad: float
    gyro_walk_rad_sqrt_s: float
    start_spread_m: float
    start_heading_spread_rad: float
    start_unknown: bool
    robots_per_m: float
    """Density of meeting another robot while driving, per m; after a turn in place twice as much per m of a ray."""
    ray_noise_m: float = 0.004
    turn_shift_m: float = 0.002
    """Noise of the place in a turn, whose centre moves on a small circle."""
    seen_noise_m: float = 0.005
    blocked_share: float = 0.02
    """Share of drives in which the robot is blocked."""
    lost_share: float = 0.05
    """Share of meetings with a robot that may be no such thing, as the component is lost."""
    corrects: bool = True
    """Whether rays are heeded; without, dead reckoning."""
    monitors: bool = True
    """Whether spreads and ``lost_share`` grow while more is unexpected than usual."""


class Mixture(NamedTuple):
    """The memory of one robot's filter, of ``components`` and ``lag``."""

    means: NDArray[np.float64]
    """(components, 6)."""
    covariances: NDArray[np.float64]
    """(components, 6, 6)."""
    weights: NDArray[np.float64]
    """(components,)."""
    past: NDArray[np.float64]
    """(components, lag, 2): places of the last samples, the latest at ``samples - 1`` modulo lag."""
    past_variances: NDArray[np.float64]
    """(components, lag, 2)."""
    past_covariances: NDArray[np.float64]
    """(components, lag, 2, 6): of these places with the state."""
    copies: NDArray[np.int64]
    """(components,): scratch of ``resample``. With draws of paths (2 components,): then from which component at the
    last sample each one descends."""
    rows: NDArray[np.float64]
    """(4, 6): scratch: P H' for walls in x and y, derivatives of a move."""
    numbers: NDArray[np.int64]
    """(2,): see ``RANDOM``."""
    monitor: NDArray[np.float64]
    """(2,): see ``UNEXPECTED``: what was unexpected, and obstacles, of which older ones count less."""


def empty_mixture(components: int, lag: int, with_paths: bool = False) -> Mixture:
    """Allocate a robot's memory.

    Args:
        with_paths: also keep from which component each one descends (``place_draws``).
    """
    return Mixture(
        np.zeros((components, STATES)),
        np.zeros((components, STATES, STATES)),
        np.zeros(components),
        np.zeros((components, lag, 2)),
        np.zeros((components, lag, 2)),
        np.zeros((components, lag, 2, STATES)),
        np.zeros(2 * components if with_paths else components, dtype=np.int64),
        np.zeros((4, STATES)),
        np.zeros(2, dtype=np.int64),
        np.zeros(2),
    )


@inlined
def next_word(f: Mixture) -> int:
    """Return the next random word of 32 bits (xorshift; Marsaglia 2003, J. Stat. Softw. 8(14))."""
    word: int = f.numbers[RANDOM]
    word ^= (word << 13) & WORD
    word ^= word >> 17
    word ^= (word << 5) & WORD
    f.numbers[RANDOM] = word
    return word


@inlined
def next_uniform(f: Mixture) -> float:
    """Return the next random number in (0, 1)."""
    return (next_word(f) + 0.5) / 4294967296.0


@inner
def begin(
    f: Mixture, program: LocalisationProgram, random: int, x_m: float, y_m: float, heading_rad: float
) -> None:
    """Start at a pose that the robot was told, or anywhere if ``program.start_unknown``.

    Args:
        random: state of its random numbers, from 1 to 2^32 - 1.
    """
    count = f.weights.size
    f.numbers[RANDOM], f.numbers[SAMPLES] = random, 0
    f.monitor[OBSTACLES] = 1.0 / (1.0 - KEPT)
    f.monitor[UNEXPECTED] = AT_START * f.monitor[OBSTACLES]
    for i in range(count):
        for j in range(STATES):
            f.means[i, j] = 0.0
            for k in range(STATES):
                f.covariances[i, j, k] = 0.0
        f.means[i, X], f.means[i, Y], f.means[i, HEADING] = x_m, y_m, heading_rad
        f.means[i, SPEED] = program.speed_factor
        spread_x_m = spread_y_m = program.start_spread_m
        spread_rad = program.start_heading_spread_rad
        if program.start_unknown:  # points of even density: powers of the root of r^4 = r + 1
            f.means[i, X] = program.width_m * ((0.5 + 0.8191725133961645 * i) % 1.0)
            f.means[i, Y] = program.height_m * ((0.5 + 0.6710436067037893 * i) % 1.0)
            f.means[i, HEADING] = 2.0 * math.pi * ((0.5 + 0.5497004779019703 * i) % 1.0)
            spread_x_m, spread_y_m = UNKNOWN * 0.5 * program.width_m, UNKNOWN * 0.5 * program.height_m
            spread_rad = UNKNOWN * math.pi
        f.covariances[i, X, X] = spread_x_m * spread_x_m
        f.covariances[i, Y, Y] = spread_y_m * spread_y_m
        f.covariances[i, HEADING, HEADING] = spread_rad * spread_rad
        f.covariances[i, SPEED, SPEED] = program.speed_spread * program.speed_spread
        f.covariances[i, BIAS, BIAS] = program.gyro_bias_spread_rad_s * program.gyro_bias_spread_rad_s
        f.covariances[i, SCALE, SCALE] = program.gyro_scale_spread * program.gyro_scale_spread
        f.weights[i] = 1.0 / count
        for n in range(f.past.shape[1]):
            for a in range(2):
                f.past[i, n, a], f.past_variances[i, n, a] = 0.0, 0.0
                for j in range(STATES):
                    f.past_covariances[i, n, a, j] = 0.0


@inlined
def excess(f: Mixture, program: LocalisationProgram) -> float:
    """Return by how much more is unexpected per obstacle than usual; 0 if it is not more, or without a monitor."""
    if not program.monitors:
        return 0.0
    return float(max(f.monitor[UNEXPECTED] / f.monitor[OBSTACLES] - USUAL, 0.0))


@inner
def resample(f: Mixture) -> None:
    """Scale the weights to a sum of 1 (all equal if they are all 0); redraw the components by weight if fewer than half
    are effective.

    The effective number is 1 / sum of squared weights.
    """
    weights, copies, count = f.weights, f.copies, f.weights.size
    total, squares = 0.0, 0.0
    for i in range(count):
        total += weights[i]
    for i in range(count):
        weights[i] = weights[i] / total if total > 0.0 else 1.0 / count
        squares += weights[i] * weights[i]
        copies[i] = 0
    if count == 1 or squares * count < 2.0:
        return
    at, chosen, reached = next_uniform(f) / count, 0, weights[0]
    for i in range(count):
        while at + i / count > reached and chosen < count - 1:
            chosen += 1
            reached += weights[chosen]
        copies[chosen] += 1
    free = 0
    for i in range(count):
        while copies[i] > 1:
            while copies[free] != 0:
                free += 1
            copy_component(f, i, free)
            copies[free] = 1
            copies[i] -= 1
    for i in range(count):
        weights[i] = 1.0 / count


@inlined
def copy_component(f: Mixture, i: int, to: int) -> None:
    """Overwrite component ``to`` by component ``i``."""
    if f.copies.size > f.weights.size:
        f.copies[f.weights.size + to] = f.copies[f.weights.size + i]
    for j in range(STATES):
        f.means[to, j] = f.means[i, j]
        for k in range(STATES):
            f.covariances[to, j, k] = f.covariances[i, j, k]
    for n in range(f.past.shape[1]):
        for a in range(2):
            f.past[to, n, a] = f.past[i, n, a]
            f.past_variances[to, n, a] = f.past_variances[i, n, a]
            for j in range(STATES):
                f.past_covariances[to, n, a, j] = f.past_covariances[i, n, a, j]
