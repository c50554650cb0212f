"""Several kinds of tile: beliefs against exact sums, shares and rates against theory, the paper's case bit by bit."""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibroswarm import preset, simulate
from vibroswarm.floors.floor import Floor
from vibroswarm.floors.source import named_tiles
from vibroswarm.inference.agents import world_of
from vibroswarm.observation.decision_boundary import expected_classes_on
from vibroswarm.observation.energy_model import energies_of, rates, shares_below
from vibroswarm.robot.belief import belief_below
from vibroswarm.robot.most_common import most_common_belief
from vibroswarm.scenario.fields import Sensor
from vibroswarm.sensors import sensor as sensor_of
from vibroswarm.strategies.kinds import drawn_kind, least_belief, most_belief
from vibroswarm.tasks import Asked, task

PAPER = preset("paper")
COLOUR = ((0.7, 0.1, 0.1, 0.1), (0.05, 0.85, 0.05, 0.05), (0.0, 0.2, 0.8, 0.0), (0.1, 0.2, 0.3, 0.4))
THREE: dict[str, Any] = {
    "sensor.model": "confusion",
    "floor.source": "random:0.4,0.36,0.24",
    "task.name": "majority",
    "strategy.name": "dirichlet",
    "decision.min_observations": 50,
}


def confusion(**params: Any) -> Sensor:
    return Sensor.model_validate({"model": "confusion", "confusion": params})


# Beliefs


@cache
def last_to_finish(left: tuple[int, ...], kind: int) -> Fraction:
    """The probability that ``kind`` collects its number of events last, if each event is of any kind equally often.

    Gamma variables of whole shapes are the times of these events in independent Poisson processes of equal rates, so
    the largest share is that of the kind that finishes last. An exact sum, without densities or quadrature.
    """
    if left[kind] == 0:
        return Fraction(0)
    running = [j for j, number in enumerate(left) if number]
    if running == [kind]:
        return Fraction(1)
    one_less = (tuple(number - (j == event) for j, number in enumerate(left)) for event in running)
    return sum((last_to_finish(after, kind) for after in one_less), Fraction(0)) / len(running)


@pytest.mark.parametrize(
    "counts", [(1, 1, 1), (1, 2, 3), (5, 1, 1), (7, 7, 6), (12, 9, 10), (2, 3, 4, 5), (9, 1, 1, 1)]
)
def test_belief_in_the_most_common_kind_is_an_exact_sum(counts: tuple[int, ...]) -> None:
    found = [most_common_belief(np.array(counts), kind) for kind in range(len(counts))]
    exact = [float(last_to_finish(counts, kind)) for kind in range(len(counts))]
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-12)
    assert sum(found) == pytest.approx(1.0, abs=1e-12)


@settings(deadline=None, max_examples=60, derandomize=True)
@given(st.integers(1, 5000), st.integers(1, 5000))
def test_of_two_kinds_it_is_the_beta_belief_of_the_paper(ones: int, zeros: int) -> None:
    below = belief_below(ones, zeros, 0.5)
    assert most_common_belief(np.array([zeros, ones]), 0) == pytest.approx(below, abs=1e-12)


def test_of_large_counts_it_is_what_random_shares_give() -> None:
    counts = np.array([620, 600, 570])
    shares = np.random.default_rng(1).dirichlet(counts, size=400_000)
    frequency = np.bincount(shares.argmax(axis=1), minlength=3) / len(shares)
    found = [most_common_belief(counts, kind) for kind in range(3)]
    np.testing.assert_allclose(found, frequency, atol=4 * 0.5 / np.sqrt(len(shares)))
    # A control: the belief by the largest pair alone is not that.
    assert abs(1 - belief_below(620, 600, 0.5) - found[0]) > 0.02


@settings(deadline=None, max_examples=60, derandomize=True)
@given(st.lists(st.integers(1, 400), min_size=3, max_size=6), st.integers(0, 5), st.floats(0.0, 1.0))
def test_bounds_of_beliefs_hold_and_draw_what_the_exact_beliefs_draw(
    counts: list[int], reading: int, free: float
) -> None:
    """Numbers are tried at both sides of each border between kinds as well, where bounds do not tell."""
    a, kinds, w = np.array(counts), len(counts), world_of(PAPER, 0)
    exact = np.array([most_common_belief(a, kind) for kind in range(kinds)])
    first = int(np.argmax(counts))
    for kind in range(kinds):
        assert least_belief(a, kind, w) - 1e-12 <= exact[kind] <= most_belief(a, kind, w) + 1e-12
    # The rule as the module states it.
    eta, kappa, read = 5.0, 1.0, reading % kinds
    share = a[first] / a.sum()
    delta = np.exp(-eta * share * (1 - share) / (a.sum() + 1)) * max(exact[first] - 1 / kinds, 0.0) ** kappa
    sent = delta * exact + (1 - delta) * (np.arange(kinds) == read)
    borders = sent[::-1].cumsum()[:-1]
    for number in (free, *(borders - 1e-9), *(borders + 1e-9)):
        if np.abs(borders - number).min() > 1e-10 and 0.0 < number < 1.0:
            drawn = drawn_kind(read, a, eta, kappa, float(number), w)
            assert drawn == kinds - 1 - int((borders <= number).sum())


REVISED = {
    "decision.revise": True,
    "floor.source": "random:0.4",
    "change.at_s": 200.0,
    "change.to": "random:0.72",
}


@pytest.mark.parametrize("ours", ["none", "positive", "soft"])
@pytest.mark.parametrize("more", [{}, {"faults.radio_dead": 0.4}, REVISED])
def test_with_two_kinds_strategies_are_those_of_the_paper_bit_by_bit(ours: str, more: dict[str, Any]) -> None:
    base = PAPER.with_values({"run.t_end_s": 500.0, "decision.min_observations": 40, **more})
    name = "dirichlet" if ours == "none" else f"dirichlet_{ours}"
    paper = simulate(base.with_values({"strategy.name": ours}), seed=3, runs=6)
    kinds = simulate(base.with_values({"strategy.name": name, "task.name": "majority"}), seed=3, runs=6)
    columns = ["decision", "decision_time_s", "belief_below", "belief_at_decision", "messages_received",
               "estimate", "estimate_spread"]  # fmt: skip
    assert kinds.robots.select(columns).equals(paper.robots.select(columns))
    assert kinds.runs["consensus"].equals(paper.runs["consensus"])
    assert paper.robots["decision"].n_unique() > 1


# Sensors


def test_shares_by_bisection_are_the_given_ones() -> None:
    shares = shares_below(confusion(rates=COLOUR))[0]
    np.testing.assert_allclose(shares, np.cumsum(COLOUR, axis=1)[:, :3], atol=1e-15)
    # The bisection agrees with the formula of the paper's sensor, which it does not know.
    gamma, p = sensor_of("gamma"), Sensor()
    for kind in (0, 1):
        found = gamma.shares_up_to(kind, np.array([0.8, 1.0, 1.3]), p)[:, 0]
        formula = shares_below(p, np.array([0.8, 1.0, 1.3]))[:, kind, 0]
        np.testing.assert_allclose(found, formula, atol=1e-12)


def test_readings_and_values_of_a_run_are_of_one_draw() -> None:
    four = {**THREE, "floor.source": "random:0.28,0.24,0.24,0.24", "sensor.confusion.rates": COLOUR}
    result = simulate(PAPER.with_values({**four, "run.t_end_s": 300.0}), seed=2, runs=3)
    read = result.observations["observation"].to_numpy()
    assert (result.observations["energy"].to_numpy() == read).all()
    tiles = np.concatenate(
        [
            result.floor(run).tiles.ravel()[frame["tile"].to_numpy()]
            for (run,), frame in result.observations.group_by("run", maintain_order=True)
        ]
    )
    for kind in range(4):
        share = np.bincount(read[tiles == kind], minlength=4) / (tiles == kind).sum()
        np.testing.assert_allclose(share, COLOUR[kind], atol=5 * 0.5 / np.sqrt((tiles == kind).sum()))


def test_energies_of_kinds_are_their_own_quantiles() -> None:
    u = np.linspace(0.01, 0.99, 50)
    kinds = np.arange(50, dtype=np.uint8) % 3
    found = energies_of(confusion(kinds=3, accuracy=1.0), kinds, u)
    assert (found == kinds).all()


# Floors and tasks


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.lists(st.integers(0, 9), min_size=2, max_size=6).filter(lambda n: sum(n) > 0), st.integers(0, 50))
def test_random_floors_have_exact_numbers_of_each_kind(numbers: list[int], run: int) -> None:
    rows, columns = 1, sum(numbers)
    if len(numbers) == 2:
        numbers = [*numbers, 0]
    shares = ",".join(repr(number / columns) for number in numbers)
    tiles = named_tiles(f"random:{shares}", rows, columns, seed=4, run=run)
    assert np.bincount(tiles.ravel(), minlength=len(numbers)).tolist() == numbers


def test_share_of_a_kind_counts_the_part_in_the_arena() -> None:
    generator = np.random.default_rng(5)
    floor = Floor(generator.integers(4, size=(4, 6)), 0.3, 0.2, left_m=-0.2, bottom_m=0.35)
    x, y = generator.random((2, 400_000)) * [[1.0], [0.6]]
    tile = floor.tile_at(x, y)
    seen = np.bincount(floor.tiles.ravel()[tile[tile >= 0]], minlength=4) / (tile >= 0).sum()
    shares = [floor.share_within(kind, 1.0, 0.6) for kind in range(4)]
    np.testing.assert_allclose(shares, seen, atol=0.005)
    asked, share = Asked(1.0, 0.6, 0.0, 0.5, 4), task("share")
    assert task("majority").answer(floor, asked, None) == int(np.argmax(shares))  # type: ignore[arg-type]
    assert share.number(floor, asked, share.params(kind=3)) == shares[3]
    four = {"sensor.model": "confusion", "sensor.confusion.kinds": 4, "strategy.name": "dirichlet"}
    sensor = preset("paper").with_values({**four, "task.name": "majority"}).sensor
    below = np.append(floor.tiles.ravel(), 0)[tile]  # 0 beside the floor
    expected = rates(sensor)[below].mean(axis=0)
    np.testing.assert_allclose(expected_classes_on(sensor, floor, (1.0, 0.6)), expected, atol=0.005)
