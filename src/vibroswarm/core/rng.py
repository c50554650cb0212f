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


class Purpose(IntEnum):
    """What a number is used for; each purpose has its own numbers. A value that was once used is never used again."""

    PLACEMENT = 0
    HARDWARE = 1
    WALK = 2
    AVOIDANCE = 3
    SPEED = 4
    SENSING = 5
    MESSAGE = 6
    LOSS = 7
    FLOOR = 8
    OPTIMIZER = 9
    BOOTSTRAP = 10
    HEARING = 12
    TIMER = 13
    BEGINNING = 14
    STEERING = 15
    NETWORK = 16
    FAULT = 18
    ODOMETRY = 20
    LOCALISATION = 21
    VEER = 22
    CHANGE = 23
    VIBRATION = 24
    MOTOR = 25
    VIDEO = 30
    PATCH = 31
    MISREAD = 32


def _number(value: int) -> int:
    """Return a NumPy integer: for a global Python integer Numba compiles a kernel again for each value."""
    return np.int64(value)  # type: ignore[return-value]


PLACEMENT: Final = _number(Purpose.PLACEMENT)
"""Purpose of numbers that place a robot at the start: position, lattice site and heading."""
HARDWARE: Final = _number(Purpose.HARDWARE)
"""Purpose of numbers that make robots, or tiles, differ from each other for a whole run."""
WALK: Final = _number(Purpose.WALK)
"""Purpose of the numbers of a walk's legs and turns."""
AVOIDANCE: Final = _number(Purpose.AVOIDANCE)
"""Purpose of the numbers of avoidances."""
SPEED: Final = _number(Purpose.SPEED)
"""Purpose of the numbers of robots' speed factors."""
SENSING: Final = _number(Purpose.SENSING)
"""Purpose of the numbers of samples: what the sensor reads."""
MESSAGE: Final = _number(Purpose.MESSAGE)
"""Purpose of the numbers that a strategy uses after a robot's own sample, when it may send a message."""
LOSS: Final = _number(Purpose.LOSS)
"""Purpose of the numbers that decide which messages are lost."""
FLOOR: Final = _number(Purpose.FLOOR)
HEARING: Final = _number(Purpose.HEARING)
"""Purpose of the numbers that a strategy uses for a message that a robot receives."""
TIMER: Final = _number(Purpose.TIMER)
"""Purpose of the numbers that a strategy uses when a robot's timer is due."""
BEGINNING: Final = _number(Purpose.BEGINNING)
"""Purpose of the numbers that a strategy uses at the start of a run."""
STEERING: Final = _number(Purpose.STEERING)
"""Purpose of the numbers that a strategy uses when it steers a robot."""
NETWORK: Final = _number(Purpose.NETWORK)
"""Purpose of the numbers of a network."""
FAULT: Final = _number(Purpose.FAULT)
ODOMETRY: Final = _number(Purpose.ODOMETRY)
"""Purpose of the numbers of the errors of odometry."""
LOCALISATION: Final = _number(Purpose.LOCALISATION)
VEER: Final = _number(Purpose.VEER)
"""Purpose of the numbers by which a robot's misalignment varies (``robot_params``)."""
VIBRATION: Final = _number(Purpose.VIBRATION)
"""Purpose of the numbers of one sample's acceleration: feet, contact, noise, phases (``sensors.acceleration``)."""
MOTOR: Final = _number(Purpose.MOTOR)
"""Purpose of the numbers by which motors below tiles vary in time, which all robots feel."""

CHANGE: Final = _number(Purpose.CHANGE)
"""Purpose of the numbers by which a floor changes during a run (``floors.changes``)."""
PATCH: Final = _number(Purpose.PATCH)
"""Purpose of the numbers of a floor's patches and values."""
MISREAD: Final = _number(Purpose.MISREAD)
"""Purpose of the numbers by which biased sensors read another class."""

FIRST: Final = _number(0)
"""Index of a number of which there is only one."""
ALONE: Final = _number(0)
"""Peer of a number that concerns no other robot."""
OF_HEADING: Final = _number(1)
"""Peer that separates the number of the heading at the start from those of the place."""
OF_SITE: Final = _number(2)
"""Peer that separates the number of the lattice site at the start from those of the place."""
OF_WANDER: Final = _number(1)
"""First peer of the pair of numbers by which a robot's speed wanders at a sample."""
OF_DRIFT: Final = _number(2)
"""First peer of the pair of numbers of a veer's slow variation; those of its wander are ``ALONE`` and the next."""
OF_DAY: Final = _number(4)
"""First peer of the pair of numbers of a veer's variation from run to run, and of a speed's."""
OF_EDGE: Final = _number(1)
"""Peer of a sample's second number: the side of a tile's edge on which it is sensed."""
OF_TILE: Final = _number(1)
OF_SENSOR: Final = _number(2)
"""Peers that separate the numbers of tile and sensor factors from those of the wheels."""
OF_SCALE: Final = _number(2)
OF_BIAS: Final = _number(4)
OF_REZERO: Final = _number(6)
"""Peers of the pairs of numbers of a gyro's scale and bias, and of the bias measured at a stop; those of its noise in a
move are ``ALONE`` and the next."""
OF_RAY: Final = _number(8)
"""First peer of the pair of numbers of a ray's error, as it is measured when an avoidance begins."""
OF_TOLD_X: Final = _number(2)
OF_TOLD_Y: Final = _number(4)
OF_TOLD_HEADING: Final = _number(6)
"""First peers of the pairs of numbers of the errors in the start (x, y, heading) that a robot assumes."""

_M0: Final = 0xD2511F53
"""First of the two multipliers of Philox4x32."""
_M1: Final = 0xCD9E8D57
"""Second of the two multipliers of Philox4x32."""
_W0: Final = 0x9E3779B9
"""Philox4x32 adds this number to the first word of the key after each round."""
_W1: Final = 0xBB67AE85
"""Philox4x32 adds this number to the second word of the key after each round."""
_LOW: Final = 0xFFFFFFFF
"""Mask of the lower 32 bits."""
_SCALE: Final = 2.0**-52
"""Distance between neighbouring uniform numbers: they have 52 random bits."""


@inlined
def philox4x32(c0: int, c1: int, c2: int, c3: int, k0: int, k1: int) -> tuple[int, int, int, int]:
    """Return the four pseudo-random 32-bit words of Philox4x32-10 for a counter and a key.

    Args:
        c0, c1, c2, c3: counter, 32 bits each. k0, k1: key, 32 bits each. All arithmetic is unsigned with 64 bits.
    """
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
    """Return the uniform number in (0, 1) at this address; see the module's text for what each part means.

    Args:
        seed: in [0, 2^63). run, index, peer: in [0, 2^32). robot: in [0, 2^16). purpose: a ``Purpose``.
    """
    return inlined_uniform(seed, run, robot, purpose, index, peer)


@inner
def normal(seed: int, run: int, robot: int, purpose: int, index: int, peer: int) -> float:
    """Return the standard normal number at an address of random numbers.

    It is computed by Box and Muller's formula from the uniform numbers at ``peer`` and ``peer + 1``.
    """
    radius = math.sqrt(-2.0 * math.log(uniform(seed, run, robot, purpose, index, peer)))
    return radius * math.cos(2.0 * math.pi * uniform(seed, run, robot, purpose, index, peer + 1))


@kernel
def fill_uniform(
    out: NDArray[np.float64], seed: int, run: int, robot: int, purpose: int, first: int, peer: int
) -> None:
    """Write the uniform numbers at the indices first, first + 1, ... into ``out``, made several at a time, in vectors.

    It is not inlined: with a length that is known, LLVM would write out the loop instead.
    """
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
    """Return a random permutation of 0..count-1 for the floor of ``run``, shape (count,), read-only.

    Each of 0..count-1 gets a uniform number, by which they are sorted. Floors have no robot; their numbers use robot 0.
    The permutations used last are kept: all candidates of a search see the same floors.
    """
    return _kept(count, seed, run) if count <= KEPT else _shuffled(count, seed, run)


def _shuffled(count: int, seed: int, run: int) -> NDArray[np.int64]:
    # A stable sort gives the same order everywhere, even if two numbers are equal.
    order = np.argsort(uniforms(seed, run, 0, Purpose.FLOOR, count), kind="stable")
    order.flags.writeable = False
    return order


_kept = lru_cache(maxsize=256)(_shuffled)
