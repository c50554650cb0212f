"""Published strategies: rules by hand and by an account of their own, special cases that equal their parents, runs."""

from __future__ import annotations

import math
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.special import ndtr

from helpers.example_strategies import load_example, module_of
from vibroswarm import preset, simulate
from vibroswarm.inference.agents import world_of
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies import mcp, strategy, valentini
from vibroswarm.strategies.base import arrays_of
from vibroswarm.strategies.world import Draws, Reading, u

WORLD = world_of(preset("paper"), 6000)
DRAWS = Draws(1, 0, 0, 6, 0, 0, 0, -1.0)
OF_FILES = ("dbbs", "three_valued", "asdf", "bayes_cpf", "totals")
NAMES = ("mcp", "bayes_bots", "dc", "dmvd", "dmmd", *OF_FILES)
dbbs, three_valued, asdf, bayes_cpf, _ = map(module_of, OF_FILES)


@pytest.fixture(autouse=True, scope="module")
def those_of_files_are_known() -> None:
    for name in OF_FILES:
        load_example(name)


class One:
    """A robot, called hook by hook."""

    def __init__(self, name: str, world: Any = WORLD, draws: Draws = DRAWS, **params: Any) -> None:
        self.strategy, self.world, self.number = strategy(name), world, 0
        self.p = SimpleNamespace(**self.strategy.params(**params).model_dump())  # type: ignore[attr-defined]
        self.s: Any = np.zeros(1, self.strategy.state_type).view(np.recarray)[0]
        sizes = {"robots": world.robots}
        made = {
            name: np.zeros(one.size(sizes), one.kind) for name, one in arrays_of(self.strategy.arrays).items()
        }
        self.a = SimpleNamespace(**made)
        self.strategy.begin(self.s, self.a, draws, self.p, world)

    def _out(self) -> Any:
        return np.zeros(1, self.strategy.message_type).view(np.recarray)[0]

    def reads(self, value: int, t_s: float = 1.0, draws: Draws = DRAWS) -> Any:
        """An own reading; the message, or None."""
        out, x = (
            self._out(),
            Reading(value, t_s, self.number, 0.5, 0.5, 0.0, 0.0, self.number, 0.5, 0.5, 0.0, 0.0),
        )
        self.number += 1
        return out if self.strategy.on_sample(self.s, self.a, x, out, draws, self.p, self.world) else None

    def hears(self, sender: int, t_s: float = 1.0, **fields: Any) -> None:
        assert self.strategy.on_message is not None
        m = SimpleNamespace(**fields)
        self.strategy.on_message(self.s, self.a, m, sender, t_s, DRAWS, self.p, self.world)

    def wakes(self, t_s: float, draws: Draws = DRAWS) -> Any:
        """The timer is due; the message, or None."""
        assert self.strategy.on_timer is not None
        out = self._out()
        return out if self.strategy.on_timer(self.s, self.a, t_s, out, draws, self.p, self.world) else None

    @property
    def decision(self) -> int:
        return int(self.strategy.decision(self.s, self.a, self.p, self.world))


def scenario_of(name: str, **values: Any) -> Scenario:
    return preset("paper").with_values(
        {"strategy.name": name, **{key.replace("__", "."): value for key, value in values.items()}}
    )


class Heard(NamedTuple):
    """What a robot has at one of its samples, by the tables alone."""

    row: dict[str, Any]
    own: list[int]
    """Its readings, the current one included."""
    others: list[list[int]]
    """Of each robot, its readings up to the last that has been received; empty for itself."""


def account(result: Result, tick_ms: int = 20) -> Iterator[Heard]:
    """Yield the samples of one run, with what was heard before the stop began; every message is heard."""
    rows = (
        result.motion.join(result.observations, on=["run", "robot", "sample"])
        .join(result.inference, on=["run", "robot", "sample"])
        .sort("time_s", "robot")
        .to_dicts()
    )
    robots = 1 + max(row["robot"] for row in rows)

    def ticks(time_s: float) -> int:
        return round(time_s * 1000.0 / tick_ms)

    of = [[row for row in rows if row["robot"] == i] for i in range(robots)]
    for row in rows:
        heard = []
        for j in range(robots):
            last = ticks(row["stop_start_s"]) - 2 if j != row["robot"] else -1
            heard.append([one["observation"] for one in of[j] if ticks(one["time_s"]) <= last])
        own = [one["observation"] for one in of[row["robot"]] if one["sample"] <= row["sample"]]
        yield Heard(row, own, heard)


def decided_by(found: list[tuple[Heard, int]]) -> dict[int, tuple[int, float]]:
    """First decision of each robot and its time, of what it would decide at each sample."""
    first: dict[int, tuple[int, float]] = {}
    for heard, new in found:
        if new != -1:
            first.setdefault(heard.row["robot"], (new, heard.row["time_s"]))
    return first


def decided_in(result: Result) -> dict[int, tuple[int, float]]:
    rows = result.robots.filter(pl.col("decision") != -1).to_dicts()
    return {row["robot"]: (row["decision"], row["decision_time_s"]) for row in rows}


# totals


def test_totals_decide_as_a_loop_over_the_tables_does() -> None:
    result = simulate(scenario_of("totals", run__t_end_s=600.0, floor__source="random:0.4"), 5, [3])
    found = []
    for heard in account(result):
        ones = sum(heard.own) + sum(map(sum, heard.others))
        n = len(heard.own) + sum(map(len, heard.others))
        z, limit = (ones - 0.5 * n) / math.sqrt((n + 3) / 4), 3 * (1 - heard.row["time_s"] / 600)
        found.append((heard, 1 if z > limit else 0 if z < -limit else -1))
    assert decided_in(result) == decided_by(found)
    assert len(decided_in(result)) == 5


# mcp


def information(ones: int, samples: int, fill: float, b: float, w: float) -> float:
    """Minus the second derivative of the log-likelihood of a fill ratio."""
    q = b * fill + (1 - w) * (1 - fill)
    return (b + w - 1) ** 2 * (ones / q**2 + (samples - ones) / (1 - q) ** 2)


accuracies = st.floats(0.55, 0.999)


@settings(deadline=None, max_examples=200)
@given(st.integers(1, 500), st.data(), accuracies | st.just(mcp.PERFECT), accuracies | st.just(mcp.PERFECT))
def test_mcp_estimates_by_likelihood(samples: int, data: st.DataObject, b: float, w: float) -> None:
    ones = data.draw(st.integers(0, samples))
    fill = mcp.local_estimate(ones, samples, b, w)
    assert fill == min(max((ones / samples + w - 1) / (b + w - 1), 0.0), 1.0)
    expected = information(ones, samples, fill, b, w)
    assert mcp.local_confidence(ones, samples, b, w) == pytest.approx(expected, rel=1e-9)


def test_mcp_decides_as_a_loop_over_the_tables_does() -> None:
    told = {
        "decision__boundary_of": "tiles",
        "decision__assumed_false_positive": 0.12,
        "decision__assumed_false_negative": 0.2,
    }
    scenario = scenario_of(
        "mcp", run__t_end_s=600.0, floor__source="random:0.2", decision__min_observations=60, **told
    )
    result = simulate(scenario, 5, [3])
    found, last = [], {}
    for heard in account(result):
        x, a = [], []
        for readings in (heard.own, *heard.others):
            if readings:
                h, t = sum(readings), len(readings)
                x.append(min(max((h / t - 0.12) / 0.68, 0.0), 1.0))
                a.append(information(h, t, x[-1], 0.8, 0.88))
        belief = ndtr((0.5 - np.dot(a, x) / sum(a)) * math.sqrt(sum(a)))
        assert heard.row["belief_below"] == pytest.approx(belief, abs=1e-9)
        last[heard.row["robot"]] = (np.dot(a, x) / sum(a), 1.0 / math.sqrt(sum(a)))
        counted = len(heard.own) - 1 + sum(map(len, heard.others))
        found.append((heard, -1 if counted <= 60 else 0 if belief > 0.95 else 1 if belief < 0.05 else -1))
    assert decided_in(result) == decided_by(found)
    assert len(decided_in(result)) == 5
    for robot, estimate, spread in result.robots.select("robot", "estimate", "estimate_spread").rows():
        assert (estimate, spread) == pytest.approx(last[robot], abs=1e-9)


# Bayes Bots


@pytest.mark.parametrize(("parent", "feedback"), [("none", False), ("positive", True)])
def test_bayes_bots_tested_at_own_readings_equal_their_parents(parent: str, feedback: bool) -> None:
    """Bit by bit, with losses: the prior in place of the gate."""
    common = {"run__t_end_s": 300.0, "network__name": "loss", "network__loss__share": 0.3}
    mine = simulate(
        scenario_of(
            "bayes_bots",
            strategy__bayes_bots__prior=7,
            strategy__bayes_bots__positive_feedback=feedback,
            strategy__bayes_bots__test_received=False,
            **common,
        ),
        2,
        3,
    )
    prior = {"decision__prior_alpha": 7, "decision__prior_beta": 7, "decision__min_observations": 0}
    theirs = simulate(scenario_of(parent, **prior, **common), 2, 3)
    assert alike(mine, theirs)
    assert (mine.robots["decision"] != -1).any()


# DC, DMVD, DMMD


def test_phases_last_as_their_formulas_say() -> None:
    d = [DRAWS._replace(address=k) for k in range(6)]
    for name, modulated in (("dmvd", True), ("dmmd", True), ("dc", False)):
        one = One(name, draws=d[0], explore_s=50.0, disseminate_s=80.0)
        opinion = 1 if u(d[0], 0) < 0.5 else 0
        end = -50.0 * math.log(u(d[0], 1))
        assert one.s.next_s == end
        for value in (opinion, opinion, 1 - opinion, opinion):
            assert one.reads(value, 1.0) is None, "silent while exploring"
        said = one.wakes(end, d[1])
        mean = 80.0 * (0.75 if modulated else 1.0)
        last = end - mean * math.log(u(d[1], 0)) + 3.0
        assert said.bit == opinion
        assert one.s.phase_end_s == pytest.approx(last, rel=1e-14)
        assert one.s.next_s == min(end + 1.0, last)
        if name == "dc":
            assert said.quality == 0.75
        one.reads(1 - opinion, end + 0.5)
        assert one.s.readings == 4, "readings count while exploring only"
        assert one.wakes(last, d[2]) is None
        assert one.s.phase_end_s == pytest.approx(last - 50.0 * math.log(u(d[2], 0)), rel=1e-14)
        assert (one.s.readings, one.s.alike) == (0, 0)


def disseminating(name: str, opinion: int, **params: Any) -> One:
    """A robot in a dissemination that ends at 100 s."""
    one = One(name, **params)
    one.s.opinion, one.s.is_disseminating, one.s.phase_end_s, one.s.quality = opinion, True, 100.0, 0.6
    return one


@pytest.mark.parametrize(
    ("own", "heard", "expected"),
    [
        (0, [1, 1], 1),
        (0, [1], 0),
        (1, [0], 1),
        (1, [0, 0, 1], 1),
        (1, [0, 0, 0], 0),
        (0, [], 0),
        (0, [1, 1, 0], 0),
    ],
)
def test_dmmd_follows_the_majority_with_its_own_opinion(own: int, heard: list[int], expected: int) -> None:
    one = disseminating("dmmd", own)
    for sender, opinion in enumerate(heard, 1):
        one.hears(sender, 99.0, bit=opinion)
    one.wakes(100.0)
    assert one.s.opinion == expected


def test_dmvd_takes_each_of_those_heard_alike() -> None:
    drawn = []
    for k in range(600):
        one = disseminating("dmvd", 0, max_opinions=3)
        one.hears(1, 98.0, bit=0)
        one.hears(3, 98.0, bit=1)
        one.hears(4, 99.0, bit=0)
        one.wakes(100.0, DRAWS._replace(address=k))
        drawn.append(one.s.opinion)
    assert stats.binomtest(sum(drawn), 600, 1 / 3).pvalue > 1e-3
    silent = disseminating("dmvd", 1)
    silent.wakes(100.0)
    assert silent.s.opinion == 1


@pytest.mark.parametrize(("theirs", "expected"), [(0.59, 0), (0.6, 0), (0.61, 1)])
def test_dc_takes_over_a_better_opinion_only(theirs: float, expected: int) -> None:
    one = disseminating("dc", 0)
    one.hears(3, 98.0, bit=1, quality=theirs)
    one.wakes(100.0)
    assert one.s.opinion == expected


def test_an_opinion_that_stays_becomes_a_decision() -> None:
    one = disseminating("dmmd", 1, patience=2)
    seen = []
    for k, heard in enumerate([[1], [0, 0], [], [0], [0]]):
        end = 100.0 * (k + 1)
        one.s.is_disseminating, one.s.phase_end_s = True, end
        for sender, opinion in enumerate(heard, 1):
            one.hears(sender, end - 1.0, bit=opinion)
        one.wakes(end)
        seen.append((int(one.s.opinion), int(one.s.unchanged), one.decision))
    assert seen == [(1, 1, -1), (0, 0, -1), (0, 0, -1), (0, 1, -1), (0, 2, 0)]
    assert disseminating("dmmd", 1, patience=0).decision == 1, "the opinion itself"


@settings(deadline=None, max_examples=60)
@given(st.permutations(range(6)), st.integers(0, 6), st.integers(1, 7), st.floats(1e-9, 1 - 1e-9))
def test_one_of_the_last_heard_is_drawn(robots: list[int], heard: int, most: int, number: float) -> None:
    order = np.zeros(6, np.int32)
    for k, j in enumerate(robots[:heard], 1):
        order[j] = k
    last = robots[:heard][-most:][::-1]
    found = valentini.heard_one(order, heard, most, number)
    assert found == (last[int(number * len(last))] if last else -1)


# Three-valued


# DBBS


def test_exponents_are_the_beliefs_of_the_published_rule() -> None:
    """Two robots with beliefs over ten hypotheses, multiplied and normalised as published, and their exponents."""
    rng, hypotheses = np.random.default_rng(5), (np.arange(10) + 0.5) / 10
    own, social = np.ones((2, 10)), np.ones((2, 10))
    robots = [One("dbbs", WORLD._replace(robots=2, min_observations=0), memory=0) for _ in range(2)]
    for step in range(60):
        i, reading = step % 2, int(rng.random() < 0.4)
        own[i] *= hypotheses if reading else 1 - hypotheses
        own[i] /= own[i].sum()
        if step > 0:  # the other's latest message
            social[i] = social[i] ** 0.8 * own[1 - i] * social[1 - i] ** 0.4
            social[i] /= social[i].sum()
        said = robots[i].reads(reading)
        fields = {name: said[name] for name in ("ones", "zeros", "social_ones", "social_zeros")}
        robots[1 - i].hears(i, **fields)
        product = own[i] * social[i]
        assert robots[i].s.below == pytest.approx(product[hypotheses < 0.5].sum() / product.sum(), rel=1e-9)
        s = robots[i].s
        of_social = s.social_ones * np.log(hypotheses) + s.social_zeros * np.log1p(-hypotheses)
        of_social = np.exp(of_social - of_social.max())
        expected = social[i] / social[i].sum()
        assert of_social / of_social.sum() == pytest.approx(expected, rel=1e-8, abs=1e-12)


def test_the_likelihood_of_dbbs_knows_the_error_rates() -> None:
    q = 0.1 + 0.7 * np.array([0.25, 0.75])
    mass = q**3 * (1 - q) ** 2
    assert dbbs.mass_below(3.0, 2.0, 2, 0.5, 0.1, 0.2) == pytest.approx(mass[0] / mass.sum())
    assert dbbs.mass_below(4.0, 4.0, 3, 0.5, 0.0, 0.0) == pytest.approx(0.5), (
        "half of what lies on the boundary"
    )


# ASDF and BayesCPF


@pytest.mark.parametrize("n", [1, 2, 5, 31])
def test_students_distribution(n: int) -> None:
    for t in (0.05, 0.7, 3.0):
        expected = 1 - 2 * stats.t.sf(t, n)
        assert asdf.student_central(t, n) == pytest.approx(expected, abs=1e-13)
        assert asdf.student_quantile(expected, n) == pytest.approx(t, rel=1e-9)


def alike(one: Result, other: Result) -> bool:
    """Whether two strategies gave the same beliefs and decisions, bit by bit."""
    return all(getattr(one, name).equals(getattr(other, name)) for name in ("inference", "robots", "runs"))


def test_asdf_that_never_corrects_equals_mcp() -> None:
    common = {
        "run__t_end_s": 300.0,
        "floor__source": "random:0.2",
        "decision__boundary_of": "tiles",
        "decision__min_observations": 60,
    }
    rates = {"decision__assumed_false_positive": 0.125, "decision__assumed_false_negative": 0.125}
    parent = simulate(scenario_of("mcp", **rates, **common), 4, 2)
    fixed = {
        "strategy__asdf__accuracy": 0.875,
        "strategy__asdf__flawed_robots": 0,
        "strategy__asdf__period": 10**6,
    }
    child = simulate(scenario_of("asdf", **fixed, **common), 4, 2)
    assert alike(parent, child)
    assert (parent.robots["decision"] != -1).any()


def test_bayes_cpf_of_a_perfect_sensor_equals_mcp() -> None:
    common = {"run__t_end_s": 300.0, "decision__min_observations": 60}
    parent = simulate(scenario_of("mcp", **common), 4, 2)
    fixed = {"accuracy": bayes_cpf.PERFECT, "drift": 0.0, "drift_variance": 0.0, "window": 1000}
    child = simulate(
        scenario_of(
            "bayes_cpf", **{f"strategy__bayes_cpf__{name}": v for name, v in fixed.items()}, **common
        ),
        4,
        2,
    )
    assert alike(parent, child)


def test_bayes_cpf_corrects_as_a_kalman_filter() -> None:
    s = SimpleNamespace(expected_accuracy=0.9, variance=0.004, ones=55)
    bayes_cpf.correct(s, 80, 0.75)
    # The posterior of Normal(0.9, 0.004) and 55 ~ Normal(c b + e, q), in information form.
    q1 = 0.9 * 0.75 + 0.1 * 0.25
    c, e, q = 80 * 0.5, 80 * 0.25, 80 * q1 * (1 - q1)
    precision = 1 / 0.004 + c * c / q
    assert s.variance == pytest.approx(1 / precision)
    assert s.expected_accuracy == pytest.approx((0.9 / 0.004 + c * (55 - e) / q) / precision)
    blind = SimpleNamespace(expected_accuracy=0.9, variance=0.004, ones=55)
    bayes_cpf.correct(blind, 80, 0.5)
    assert (blind.expected_accuracy, blind.variance) == (0.9, 0.004)


# All of them


OPPOSITES: dict[str, tuple[dict[str, float], dict[str, float]]] = {
    "totals": ({"ones": 3, "samples": 10}, {"ones": 7, "samples": 10}),
    "mcp": ({"estimate": 0.3}, {"estimate": 0.7}),
    "dbbs": (
        {"ones": 1.0, "zeros": 2.0, "social_ones": 3.0, "social_zeros": 5.0},
        {"ones": 2.0, "zeros": 1.0, "social_ones": 5.0, "social_zeros": 3.0},
    ),
    "three_valued": ({"truth": 2}, {"truth": 0}),
    "asdf": ({"estimate": 0.3, "confidence": 9.0}, {"estimate": 0.7, "confidence": 9.0}),
    "bayes_cpf": ({"estimate": 0.3, "confidence": 9.0}, {"estimate": 0.7, "confidence": 9.0}),
}


@pytest.mark.parametrize("name", NAMES)
def test_what_a_faulty_robot_sends_is_the_opposite(name: str) -> None:
    """Of messages that are no bit; a bit is turned round by the simulator."""
    opposite = strategy(name).opposite
    assert (opposite is not None) == (name in OPPOSITES)
    if opposite is not None:
        sent, expected = OPPOSITES[name]
        message = SimpleNamespace(**sent)
        opposite(message)
        assert vars(message) == pytest.approx(expected)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_most_robots_are_right_on_easy_floors_and_a_blind_sensor_is_not(name: str) -> None:
    """The control: a sensor that reads on all tiles what it reads on still ones sees no vibrating tile."""
    opinions = name in ("dc", "dmvd", "dmmd", "three_valued")
    common: dict[str, Any] = {"swarm__robots": 20 if opinions else 5, "decision__min_observations": 60}
    still = preset("paper").sensor
    blind = {
        "sensor__vibrating_shape": still.still_shape,
        "sensor__vibrating_scale": still.still_scale,
        "sensor__vibrating_location": still.still_location,
    }

    def right(**values: Any) -> float:
        result = simulate(scenario_of(name, **values, **common), 8, 6)
        truth = result.runs["truth"].to_numpy().repeat(common["swarm__robots"])
        return float((result.robots["decision"].to_numpy() == truth).mean())

    least = 0.6 if opinions else 0.99
    assert right(floor__source="random:0.12") >= least
    assert right(floor__source="random:0.88") >= (least if name != "dmmd" else 0.4)
    assert right(floor__source="random:0.88", **blind) <= 1 - least
