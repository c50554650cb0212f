"""Memory of a robot's localisation: a mixture of Gaussians over its pose (``localisation`` has the equations).

``f`` is always the mixture (``Mixture``), which the functions change in place.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner

X, Y, HEADING, SPEED, BIAS, SCALE = range(6)
"""Indices in the state: place, heading, speed factor, gyro bias, and gyro scale less 1."""
STATES: Final = 6
"""Number of state variables."""
RANDOM, SAMPLES = 0, 1
"""Indices in ``Mixture.numbers``: state of the random number generator, and number of samples so far."""
UNEXPECTED, OBSTACLES = 0, 1
"""Indices in ``Mixture.monitor``: sum of what was unexpected in drives and at obstacles, and number of past obstacles;
older ones count less."""
KEPT: Final = 0.95
"""Factor of the monitor's sums at each obstacle, so that they remember about the last 1 / (1 - KEPT) = 20 obstacles."""
USUAL: Final = 0.5
"""Upper limit of what is normally unexpected per obstacle: 0.25 to 0.45 in simulations whose robots know their
noise."""
AT_START: Final = 0.4
"""Initial value of the unexpected per obstacle: as if the obstacles before the start had been usual."""

ESTIMATE: Final = ("x_m", "y_m", "heading_rad", "spread_m", "lagged_sample", "lagged_x_m", "lagged_y_m",
                   "lagged_spread_x_m", "lagged_spread_y_m")  # fmt: skip
"""Columns that ``localisation.sampled`` writes: the estimated pose; the standard deviation of its place (root of the
mean of the variances in x and y); number (-1: none yet), place and standard deviations of the sample ``lag`` ago."""

WORD: Final = 0xFFFFFFFF
"""Mask of the lowest 32 bits."""


class LocalisationProgram(NamedTuple):
    """What the robot knows about itself and the arena; units are in the names."""

    width_m: float
    """Width of the arena."""
    height_m: float
    """Height of the arena."""
    radius_m: float
    """Radius of the robot's body."""
    ray_forward_m: float
    """How far ahead of the robot's centre its rays begin."""
    ray_side_m: NDArray[np.float64]
    """(rays,): how far to the left of the robot's axis each ray begins."""
    ray_cos: NDArray[np.float64]
    """(rays,): cosine of the angle between the robot's heading and the ray, anticlockwise positive."""
    ray_sin: NDArray[np.float64]
    """(rays,): sine of that angle."""
    avoidance_threshold_m: float
    """Length of a ray below which the robot avoids."""
    blind_s: float
    """For this time after a turn rays are ignored."""
    full_speed_m_s: float
    """Speed at full power with a full battery and a speed factor of 1."""
    battery_life_s: float
    """The speed falls linearly with time, to 0 at this time."""
    speed_factor: float
    """Mean of the distribution of speed factors."""
    speed_spread: float
    """Standard deviation of the distribution of speed factors."""
    speed_redrawn: bool
    """Whether a new speed factor is drawn after each sample."""
    speed_wander: float
    """Standard deviation of the speed factor from sample to sample, as a share of the factor; 0: it is constant."""
    gyro_scale_spread: float
    """Standard deviation of the gyro's scale."""
    gyro_bias_spread_rad_s: float
    """Standard deviation of the gyro's bias."""
    turn_noise_rad: float
    """Standard deviation of the noise of a measured turn in place."""
    gyro_walk_rad_sqrt_s: float
    """Random walk of a measured angle: its standard deviation after 1 s."""
    start_spread_m: float
    """Standard deviation of x and of y of the start."""
    start_heading_spread_rad: float
    """Standard deviation of the heading of the start."""
    robots_per_m: float
    """Density of meeting another robot, per m of the drive; after a turn in place it is twice that, per m of a ray."""
    ray_noise_m: float = 0.004
    """Standard deviation of the noise of a measured ray."""
    turn_shift_m: float = 0.002
    """Noise of the place in a turn, whose centre moves on a small circle."""
    seen_noise_m: float = 0.005
    """Standard deviation of the bounds "no ray saw a wall" and "inside the arena"."""
    blocked_share: float = 0.02
    """Share of drives in which the robot is blocked."""
    lost_share: float = 0.05
    """Share of seeming meetings with a robot in which the component is taken to be lost instead."""
    corrects: bool = True
    """Whether rays correct the pose; if not, this is dead reckoning."""
    monitors: bool = True
    """Whether the monitor acts: stated spreads and ``lost_share`` grow with its ``excess``."""


class Mixture(NamedTuple):
    """The memory of one robot's filter: ``components`` Gaussians, and the places of the last ``lag`` samples."""

    means: NDArray[np.float64]
    """(components, 6): mean states, in the order X, Y, HEADING, SPEED, BIAS, SCALE."""
    covariances: NDArray[np.float64]
    """(components, 6, 6): covariance matrices of the state of each component."""
    weights: NDArray[np.float64]
    """(components,): probability of each component; they sum to 1 except while an event is being evaluated."""
    past: NDArray[np.float64]
    """(components, lag, 2): places of the last samples; sample n (from 0) is in slot n modulo lag."""
    past_variances: NDArray[np.float64]
    """(components, lag, 2): variances of x and y of these places."""
    past_covariances: NDArray[np.float64]
    """(components, lag, 2, 6): covariances of these places with the state."""
    copies: NDArray[np.int64]
    """(components,): scratch of ``resample``."""
    rows: NDArray[np.float64]
    """(4, 6): scratch: P H' for walls in x (row 0) and y (row 1); in a move, derivatives of the new state."""
    numbers: NDArray[np.int64]
    """(2,): the random state (index RANDOM) and the number of samples so far (index SAMPLES)."""
    monitor: NDArray[np.float64]
    """(2,): sums that fade by KEPT at each obstacle: what was unexpected (UNEXPECTED), obstacles (OBSTACLES)."""


def empty_mixture(components: int, lag: int) -> Mixture:
    """Allocate a robot's memory; all numbers are 0 until ``begin`` is called."""
    return Mixture(
        np.zeros((components, STATES)),  # means
        np.zeros((components, STATES, STATES)),  # covariances
        np.zeros(components),  # weights
        np.zeros((components, lag, 2)),  # past
        np.zeros((components, lag, 2)),  # past_variances
        np.zeros((components, lag, 2, STATES)),  # past_covariances
        np.zeros(components, dtype=np.int64),  # copies
        np.zeros((4, STATES)),  # rows
        np.zeros(2, dtype=np.int64),  # numbers
        np.zeros(2),  # monitor
    )


@inlined
def next_word(f: Mixture) -> int:
    """Advance the random state, and return it: 32 bits (xorshift; Marsaglia 2003, J. Stat. Softw. 8(14))."""
    word: int = f.numbers[RANDOM]
    word ^= (word << 13) & WORD
    word ^= word >> 17
    word ^= (word << 5) & WORD
    f.numbers[RANDOM] = word
    return word


@inlined
def next_uniform(f: Mixture) -> float:
    """Return the next random number in (0, 1)."""
    return (next_word(f) + 0.5) / 4294967296.0  # 2^32


@inner
def begin(
    f: Mixture, program: LocalisationProgram, random: int, x_m: float, y_m: float, heading_rad: float
) -> None:
    """Set all components to time 0, at a given pose."""
    count = f.weights.size
    f.numbers[RANDOM], f.numbers[SAMPLES] = random, 0
    f.monitor[OBSTACLES] = 1.0 / (1.0 - KEPT)  # the value that the sum has after many obstacles
    f.monitor[UNEXPECTED] = AT_START * f.monitor[OBSTACLES]
    f.means[:] = 0.0
    f.covariances[:] = 0.0
    f.past[:] = 0.0
    f.past_variances[:] = 0.0
    f.past_covariances[:] = 0.0
    for i in range(count):
        f.means[i, X], f.means[i, Y], f.means[i, HEADING] = x_m, y_m, heading_rad
        f.means[i, SPEED] = program.speed_factor
        f.covariances[i, X, X] = program.start_spread_m * program.start_spread_m
        f.covariances[i, Y, Y] = program.start_spread_m * program.start_spread_m
        spread_rad = program.start_heading_spread_rad
        f.covariances[i, HEADING, HEADING] = spread_rad * spread_rad
        f.covariances[i, SPEED, SPEED] = program.speed_spread * program.speed_spread
        f.covariances[i, BIAS, BIAS] = program.gyro_bias_spread_rad_s * program.gyro_bias_spread_rad_s
        f.covariances[i, SCALE, SCALE] = program.gyro_scale_spread * program.gyro_scale_spread
        f.weights[i] = 1.0 / count


@inlined
def excess(f: Mixture, program: LocalisationProgram) -> float:
    """Return by how much the unexpected per recent obstacle exceeds what is usual (``USUAL``); 0 if it does not."""
    if not program.monitors:
        return 0.0
    return float(max(f.monitor[UNEXPECTED] / f.monitor[OBSTACLES] - USUAL, 0.0))


@inner
def resample(f: Mixture) -> None:
    """Scale the weights to a sum of 1; if fewer than half of the components are effective, redraw them by weight."""
    weights, copies, count = f.weights, f.copies, f.weights.size
    total, squares = 0.0, 0.0
    for i in range(count):
        total += weights[i]
    for i in range(count):
        weights[i] = weights[i] / total if total > 0.0 else 1.0 / count
        squares += weights[i] * weights[i]
        copies[i] = 0
    # squares * count < 2: more than half of the components are effective
    if count == 1 or squares * count < 2.0:
        return
    # copies[i] counts how often component i is drawn. The draws are ``count`` evenly spaced points with a common random
    # offset ``at``; a point draws the component in whose part of the cumulative weights it falls.
    at, chosen, reached = next_uniform(f) / count, 0, weights[0]
    for i in range(count):
        while at + i / count > reached and chosen < count - 1:
            chosen += 1
            reached += weights[chosen]
        copies[chosen] += 1
    # Overwrite each component that was not drawn (``free``) by a copy of one that was drawn more than once.
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
    """Overwrite component ``to`` by component ``i``, except for its weight."""
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
