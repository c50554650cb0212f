"""The addressed generator: published answers, ends of the interval, uniformity and independence."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations

import numba
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from vibroswarm.core import rng
from vibroswarm.core.rng import Purpose, philox4x32, shuffled, uniform, uniforms

ONES = 0xFFFFFFFF
# Known-answer vectors of Random123 for philox4x32-10: counter, key, answer.
KNOWN = [
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((ONES,) * 4, (ONES, ONES), (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]

Address = tuple[int, int, int, int, int, int]
PARTS = ("seed", "run", "robot", "purpose", "index", "peer")
BASES: tuple[Address, ...] = (
    (1, 0, 0, 2, 0, 0),
    (2**62 + 12345, 2**31, 7, 5, 2**20, 3),
    (0, 0, 0, 0, 0, 0),
)
COUNT = 2**14


def plain(function: Callable[..., object]) -> Callable[..., object]:
    """The uncompiled function (itself where nothing is compiled)."""
    return getattr(function, "py_func", function)


def along(part: str, base: Address, draw: Callable[..., float] = uniform) -> NDArray[np.float64]:
    """The numbers at addresses that differ in one part alone, shape (COUNT,)."""
    place = PARTS.index(part)
    address = list(base)
    out = np.empty(COUNT)
    for k in range(COUNT):
        address[place] = base[place] + k
        out[k] = draw(*address)
    return out


def uniformity_p(u: NDArray[np.float64]) -> float:
    """p-value of a Kolmogorov-Smirnov test and of a chi-square test over 64 cells, Bonferroni over the two."""
    counts = np.bincount((u * 64).astype(int), minlength=64)
    return float(min(1.0, 2 * min(stats.kstest(u, "uniform").pvalue, stats.chisquare(counts).pvalue)))


def independence_p(u: NDArray[np.float64]) -> float:
    """p-value of a chi-square test of neighbours (u_k, u_k+1), in disjoint pairs, over 16 x 16 cells.

    Two-sided: a generator may also be too even.
    """
    cells = (u * 16).astype(int)
    counts = np.bincount(cells[0::2] * 16 + cells[1::2], minlength=256)
    p = float(stats.chisquare(counts).pvalue)
    return min(1.0, 2 * min(p, 1 - p))


# Two tests for each part and base; a false alarm in 1 of 1000 choices of these addresses.
THRESHOLD = 1e-3 / (2 * len(PARTS) * len(BASES))


def test_philox_gives_the_published_answers() -> None:
    compiled = numba.njit(plain(philox4x32))
    for counter, key, answer in KNOWN:
        assert (
            tuple(int(word) for word in philox4x32(*counter, *key)) == answer
        )  # plain Python, as it is inlined
        assert tuple(int(word) for word in compiled(*counter, *key)) == answer


@pytest.mark.parametrize("words", [(0, 0), (ONES, ONES)])
def test_uniform_never_reaches_the_ends(monkeypatch: pytest.MonkeyPatch, words: tuple[int, int]) -> None:
    monkeypatch.setattr(rng, "philox4x32", lambda *_: (*words, 0, 0))
    u = plain(uniform)(1, 0, 0, 0, 0, 0)
    assert 0.0 < u < 1.0  # type: ignore[operator]
    assert u == (2.0**-53 if words[0] == 0 else 1 - 2.0**-53)


def test_each_part_of_the_address_goes_to_its_own_word() -> None:
    seed, run, robot, purpose, index, peer = 0x0123456789ABCDEF, 0xFEDCBA98, 0xBEEF, 7, 0x87654321, 0x13572468
    word, other, _, _ = (
        int(w) for w in philox4x32(index, robot | (purpose << 16), run, peer, seed & ONES, seed >> 32)
    )
    expected = (((word << 20) | (other >> 12)) + 0.5) / 2**52
    assert uniform(seed, run, robot, purpose, index, peer) == expected


@pytest.mark.parametrize(
    "address",
    [
        (0, 0, 0, 0, 0, 0),
        (2**63 - 1, 2**32 - 1, 2**16 - 1, 10, 2**32 - 1, 2**32 - 1),
        (2**32, 5, 4, 3, 2, 1),
    ],
)
def test_compiled_equals_plain_python(address: Address, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = uniform(*address)
    monkeypatch.setattr(rng, "philox4x32", plain(philox4x32))
    assert plain(uniform)(*address) == compiled
    assert 0.0 < compiled < 1.0


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("part", PARTS)
def test_neighbouring_addresses_are_uniform_and_independent(part: str, base: Address) -> None:
    u = along(part, base)
    assert 0.0 < u.min() < u.max() < 1.0
    p = uniformity_p(u), independence_p(u)
    assert min(p) > THRESHOLD, f"uniformity p = {p[0]:.3g}, independence p = {p[1]:.3g}"


def test_purposes_and_robots_are_independent_of_each_other() -> None:
    """The same index under two purposes, or two robots: 16 x 16 cells again."""
    for one, two in (
        ((1, 0, 0, 2), (1, 0, 0, 3)),
        ((1, 0, 0, 2), (1, 0, 1, 2)),
        ((1, 0, 0, 2), (1, 1, 0, 2)),
    ):
        u = np.empty(2 * COUNT)
        u[0::2] = [uniform(*one, k, 0) for k in range(COUNT)]
        u[1::2] = [uniform(*two, k, 0) for k in range(COUNT)]
        assert independence_p(u) > 1e-3 / 3


# Negative controls: the two checks see what is wrong with these.


def test_checks_see_a_generator_that_is_not_uniform() -> None:
    assert uniformity_p(along("index", BASES[0]) ** 1.1) < THRESHOLD


def test_checks_see_a_walk_in_even_steps() -> None:
    golden_ratio = (5**0.5 - 1) / 2
    even = (np.arange(1, COUNT + 1) * golden_ratio) % 1.0
    assert independence_p(even) < THRESHOLD


def test_checks_see_a_part_of_the_address_that_is_ignored() -> None:
    def without_index(seed: int, run: int, robot: int, purpose: int, index: int, peer: int) -> float:
        return uniform(seed, run, robot, purpose, index // 2, peer)

    u = along("index", BASES[0], without_index)
    assert uniformity_p(u[::2][: COUNT // 4]) > THRESHOLD  # each number alone is good
    assert independence_p(u) < THRESHOLD


@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 31, 257])
def test_numbers_drawn_in_vectors_are_those_drawn_one_by_one(count: int) -> None:
    """Whole vectors and what is left over, across the index at which the counter starts again."""
    for first in (0, 5, 2**32 - 9):
        expected = [uniform(2**62 + 3, 9, 4, Purpose.SPEED, first + k, 0) for k in range(count)]
        assert uniforms(2**62 + 3, 9, 4, Purpose.SPEED, count, first=first).tolist() == expected


def permutation_p(orders: list[tuple[int, ...]]) -> float:
    """p-value of a chi-square test that all orders of four are equally frequent."""
    places = {order: k for k, order in enumerate(permutations(range(4)))}
    counts = np.bincount([places[order] for order in orders], minlength=len(places))
    return float(stats.chisquare(counts).pvalue)


def test_shuffled_gives_every_permutation_equally_often() -> None:
    orders = [tuple(int(k) for k in shuffled(4, 11, run)) for run in range(4800)]
    assert permutation_p(orders) > 1e-3
    # Negative control: a shuffle that leaves the first in its place one time in 20 more often.
    lazy = [tuple(range(4)) if run % 20 == 0 else order for run, order in enumerate(orders)]
    assert permutation_p(lazy) < 1e-3
