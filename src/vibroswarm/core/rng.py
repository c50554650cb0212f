"""Random numbers by address: the uniform number of (seed, run, robot, purpose, index, peer).

No number depends on numbers drawn before. So no result depends on threads, batches, order or interruption; changing
the strategy changes no motion, and changing the floor changes no noise.

An address names what the number is for: its ``Purpose``; the index of the event (the leg, the sample, the message);
and the peer, which is the other robot of a message, or else a small number (``OF_...``) that separates several numbers
drawn for one event. A number with a normal or a triangular distribution is made of a pair of uniform numbers, at two
consecutive peers.

| name | symbol | where | equation |
|---|---|---|---|
| generator | Philox4x32-10 | Salmon et al., "Parallel random numbers", SC 2011 | 10 rounds |
| counter | c0..c3 | index, robot + 2^16 purpose, run, peer | 4 words of 32 bits |
| key | k0, k1 | low and high half of the seed | 2 words of 32 bits |
| uniform | u | (52 bits + 1/2) / 2^52: inside (0, 1), never on its ends, symmetric about 1/2 | |
"""

from __future__ import annotations

import math
from enum import IntEnum
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner, kernel

SEED_LIMIT: Final = 2**63
"""Seeds are whole numbers in [0, 2^63)."""


Purpose = IntEnum(
    "Purpose",
    {
        "PLACEMENT": 0,  # a robot's place at the start: position, lattice site and heading
        "HARDWARE": 1,  # how robots, or tiles, differ from each other for a whole run
        "WALK": 2,  # a walk's legs and turns
        "AVOIDANCE": 3,
        "SPEED": 4,  # robots' speed factors
        "SENSING": 5,  # samples: what the sensor reads
        "MESSAGE": 6,  # for a strategy, after a robot's own sample, when it may send a message
        "LOSS": 7,  # which messages are lost
        "FLOOR": 8,
        "OPTIMIZER": 9,
        "BOOTSTRAP": 10,
        "HEARING": 12,  # for a strategy, of a message that a robot receives
        "TIMER": 13,  # for a strategy, when a robot's timer is due
        "BEGINNING": 14,  # for a strategy, at the start of a run
        "STEERING": 15,  # for a strategy, when it steers a robot
        "NETWORK": 16,
        "FAULT": 18,
        "ODOMETRY": 20,  # errors of odometry
        "LOCALISATION": 21,
        "VEER": 22,  # how a robot's misalignment varies (``robot_params``)
        "CHANGE": 23,  # how a floor changes during a run (``floors.changes``)
        "VIBRATION": 24,  # one sample's acceleration: feet, contact, noise, phases (``sensors.acceleration``)
        "MOTOR": 25,  # how motors below tiles vary in time, which all robots feel
        "VIDEO": 30,
        "PATCH": 31,  # a floor's patches and values
        "MISREAD": 32,  # by which biased sensors read another class
    },
)
"""What a number is used for; each purpose has its own numbers. A value that was once used is never used again."""


def _numbers(*values: int) -> tuple[int, ...]:
    """Return NumPy integers: for a global Python integer Numba compiles a kernel again for each value."""
    return tuple(map(np.int64, values))  # type: ignore[arg-type]


(
    PLACEMENT, HARDWARE, WALK, AVOIDANCE, SPEED, SENSING, MESSAGE, LOSS, FLOOR, OPTIMIZER, BOOTSTRAP, HEARING, TIMER,
    BEGINNING, STEERING, NETWORK, FAULT, ODOMETRY, LOCALISATION, VEER, CHANGE, VIBRATION, MOTOR, VIDEO, PATCH, MISREAD,
) = _numbers(*Purpose)  # fmt: skip
"""The purposes for kernels."""

FIRST, ALONE = _numbers(0, 0)
"""Index of a number of which there is only one; peer of a number that concerns no other robot."""
OF_HEADING, OF_SITE = _numbers(1, 2)
"""Peers that separate the numbers of heading and lattice site at the start from those of the place."""
OF_WANDER, OF_DRIFT, OF_DAY = _numbers(1, 2, 4)
"""First peers of the pairs of numbers by which a robot's speed wanders at a sample, of a veer's slow variation (those
of its wander are ``ALONE`` and the next), and of a veer's, and a speed's, variation from run to run."""
OF_EDGE, OF_TILE, OF_SENSOR = _numbers(1, 1, 2)
"""Peer of a sample's second number: the side of a tile's edge on which it is sensed; peers that separate the numbers of
tile and sensor factors from those of the wheels."""
OF_SCALE, OF_BIAS, OF_REZERO, OF_RAY = _numbers(2, 4, 6, 8)
"""First peers of the pairs of numbers of a gyro's scale and bias, of the bias measured at a stop (those of its noise in
a move are ``ALONE`` and the next), and of a ray's error, as it is measured when an avoidance begins."""
OF_TOLD_X, OF_TOLD_Y, OF_TOLD_HEADING = _numbers(2, 4, 6)
"""First peers of the pairs of numbers of the errors in the start (x, y, heading) that a robot assumes."""

_M0, _M1, _W0, _W1 = 0xD2511F53, 0xCD9E8D57, 0x9E3779B9, 0xBB67AE85
"""The two multipliers of Philox4x32, and what it adds to the two words of the key after each round."""
_LOW: Final = 0xFFFFFFFF
"""Mask of the lower 32 bits."""
_SCALE: Final = 2.0**-52
"""Distance between neighbouring uniform numbers: they have 52 random bits."""


@inlined
def philox4x32(c0: int, c1: int, c2: int, c3: int, k0: int, k1: int) -> tuple[int, int, int, int]:
    """Return the four pseudo-random 32-bit words of Philox4x32-10 for a counter and a key."""
    low = np.uint64(_LOW)
    shift = np.uint64(32)
    a, b, c, d = np.uint64(c0), np.uint64(c1), np.uint64(c2), np.uint64(c3)
    key0, key1 = np.uint64(k0), np.uint64(k1)
    for _ in range(10):
        left = np.uint64(_M0) * a
        right = np.uint64(_M1) * c
        a, b, c, d = (right >> shift) ^ b ^ key0, right & low, (left >> shift) ^ d ^ key1, left & low
        key0 = (key0 + np.uint64(_W0)) & low
        key1 = (key1 + np.uint64(_W1)) & low
    return a, b, c, d  # type: ignore[return-value]


@inlined
def inlined_uniform(seed: int, run: int, robot: int, purpose: int, index: int, peer: int) -> float:
    """Return the number that ``uniform`` returns; inlined, so that a loop over numbers becomes vectors."""
    high, low, _, _ = philox4x32(
        index & _LOW, robot | (purpose << 16), run & _LOW, peer & _LOW, seed & _LOW, (seed >> 32) & _LOW
    )
    # 52 bits: all 32 of the first word, and the upper 20 of the second. The 0.5 keeps the number off 0.
    return (float((np.uint64(high) << np.uint64(20)) | (np.uint64(low) >> np.uint64(12))) + 0.5) * _SCALE


@kernel
def uniform(seed: int, run: int, robot: int, purpose: int, index: int, peer: int) -> float:
    """Return the uniform number in (0, 1) at this address; see the module's text for what each part means."""
    return inlined_uniform(seed, run, robot, purpose, index, peer)


@inner
def normal(seed: int, run: int, robot: int, purpose: int, index: int, peer: int) -> float:
    """Return the standard normal number (Box and Muller) of the uniform numbers at ``peer`` and ``peer + 1``."""
    radius = math.sqrt(-2.0 * math.log(uniform(seed, run, robot, purpose, index, peer)))
    return radius * math.cos(2.0 * math.pi * uniform(seed, run, robot, purpose, index, peer + 1))


@kernel
def fill_uniform(
    out: NDArray[np.float64], seed: int, run: int, robot: int, purpose: int, first: int, peer: int
) -> None:
    """Write the uniform numbers at first, first + 1, ...; not inlined: LLVM would unroll a known length."""
    for i in range(out.size):
        out[i] = inlined_uniform(seed, run, robot, purpose, first + i, peer)


def uniforms(
    seed: int, run: int, robot: int, purpose: Purpose, count: int, first: int = 0
) -> NDArray[np.float64]:
    """Return the uniform numbers at the indices first, ..., first + count - 1 (and peer 0), shape (count,)."""
    out = np.empty(count, dtype=np.float64)
    fill_uniform(out, seed, run, robot, int(purpose), first, ALONE)
    return out


KEPT: Final = 1000
"""Largest permutations that are kept, numbers: of larger ones many would take much memory."""


def shuffled(count: int, seed: int, run: int) -> NDArray[np.int64]:
    """Return a random permutation of 0..count-1 for the floor of ``run``, read-only; the last ones are cached."""
    return _kept(count, seed, run) if count <= KEPT else _shuffled(count, seed, run)


def _shuffled(count: int, seed: int, run: int) -> NDArray[np.int64]:
    # A stable sort gives the same order everywhere, even if two numbers are equal.
    order = np.argsort(uniforms(seed, run, 0, Purpose.FLOOR, count), kind="stable")
    order.flags.writeable = False
    return order


_kept = lru_cache(maxsize=256)(_shuffled)
