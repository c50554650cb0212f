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
from numpy.typing import NDArray
from scipy import stats
from scipy.special import betainc, ndtr

from helpers.example_strategies import load_example, module_of
from vibroswarm import preset, simulate
from vibroswarm.inference.agents import world_of
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies import mcp, strategy, totals, valentini
from vibroswarm.strategies.base import arrays_of
from vibroswarm.strategies.world import Draws, Reading, u

WORLD = world_of(preset("paper"), 6000)
DRAWS = Draws(1, 0, 0, 6, 0, 0, 0, -1.0)
OF_FILES = ("dbbs", "three_valued", "asdf", "bayes_cpf")
NAMES = ("totals", "mcp", "bayes_bots", "dc", "dmvd", "dmmd", *OF_FILES)
dbbs, three_valued, asdf, bayes_cpf = map(module_of, OF_FILES)


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


def test_the_boundary_of_totals_is_the_share_of_ones_expected_there() -> None:
    told = scenario_of(
        "totals",
        decision__boundary_of="tiles",
        decision__assumed_false_positive=0.1,
        decision__assumed_false_negative=0.25,
    )
    assert world_of(told, 100).boundary == pytest.approx(0.1 + (1 - 0.1 - 0.25) / 2, abs=1e-15)
    assert WORLD.boundary == 0.5


def test_the_score_of_totals_by_hand() -> None:
    assert totals.score(9, 13, 0.5) == pytest.approx(2.5 / 2.0, abs=1e-15)
    assert totals.score(3, 13, 0.4) == pytest.approx(-2.2 / 2.0, abs=1e-15)


def test_totals_bear_lost_and_late_messages() -> None:
    one = One("totals")
    one.hears(1, ones=2, samples=5)
    one.hears(1, ones=4, samples=9)  # those between were lost
    one.hears(1, ones=3, samples=7)  # late
    one.hears(2, ones=1, samples=1)
    said = one.reads(0)
    assert (one.s.alpha, one.s.beta) == (1 + 4 + 1, 1 + 5 + 1)
    assert (said.ones, said.samples) == (0, 1), "its own alone"


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


def test_later_totals_make_lost_messages_good() -> None:
    """With half of the messages lost, the counts at the end lack only those of the last messages."""
    lossy = simulate(
        scenario_of("totals", run__t_end_s=300.0, network__name="loss", network__loss__share=0.5), 5, 2
    )
    whole = simulate(scenario_of("totals", run__t_end_s=300.0), 5, 2)
    n = [(one.robots["alpha"] + one.robots["beta"]).to_numpy().astype(int) for one in (lossy, whole)]
    assert (
        lossy.robots["messages_received"].to_numpy() < 0.7 * whole.robots["messages_received"].to_numpy()
    ).all()
    assert (n[1] - n[0] >= 0).all()
    assert (n[1] - n[0]).mean() < 8  # about one of each of four senders


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


def test_mcp_of_a_sensor_that_tells_next_to_nothing() -> None:
    """Rates of 0.9999995 and 0 sum to less than 1, but a perfect sensor's accuracy is made smaller by more."""
    b, w = min(1.0 - 0.9999995, mcp.PERFECT), mcp.PERFECT
    assert b + w < 1.0
    assert mcp.local_estimate(0, 10, b, w) == 0.0
    assert mcp.local_estimate(1, 10, b, w) == 1.0


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


def test_bayes_bots_test_received_values_too() -> None:
    for tested, expected in ((True, 0), (False, -1)):
        one = One("bayes_bots", prior=1, test_received=tested)
        for k in range(1, 5):  # Beta(1, 5): 1 - 2^-5 = 0.969
            assert one.decision == -1
            one.hears(2, bit=0, number=k)
        assert one.decision == expected
        one.reads(1)  # Beta(2, 5): 0.891, no decision by itself
        assert one.decision == expected
    assert betainc(2, 5, 0.5) < 0.95


def test_bayes_bots_count_a_number_once_and_a_sender_after_its_timeout() -> None:
    one = One("bayes_bots", prior=1)
    for number in (1, 1, 2, 2):
        one.hears(3, bit=1, number=number)
    one.hears(4, bit=1, number=1)
    assert (one.s.alpha, one.s.beta) == (4, 1)
    slow = One("bayes_bots", prior=1, sender_timeout_s=900.0)
    for number, t_s in ((1, 5.0), (2, 10.0), (3, 904.0), (4, 905.0), (5, 1000.0)):
        slow.hears(3, t_s, bit=0, number=number)
    assert (slow.s.alpha, slow.s.beta) == (1, 3)


def test_bayes_bots_repeat_what_they_said() -> None:
    one = One("bayes_bots", prior=1, repeat_s=2.0)
    assert math.isinf(one.s.next_s)
    first = one.reads(1, 10.0)
    assert (first.bit, first.number, one.s.next_s) == (1, 1, 12.0)
    again = one.wakes(12.0)
    assert (again.bit, again.number, one.s.next_s) == (1, 1, 14.0)
    one.s.decision = 0
    assert one.wakes(14.0).bit == 0, "with positive feedback, the decision"


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


def test_only_the_last_seconds_are_heard_and_a_sender_once() -> None:
    one = disseminating("dmmd", 0)
    one.hears(1, 96.9, bit=1)
    one.hears(2, 97.0, bit=1)
    one.hears(2, 98.0, bit=0)
    assert (one.a.order.tolist(), one.a.opinion[2], one.s.heard) == ([0, 0, 1, 0, 0], 1, 1)
    one.wakes(100.0)
    assert one.s.opinion == 0, "one of each: it stays"
    one.hears(1, 100.5, bit=1)
    assert one.s.heard == 0, "not while exploring"


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


def test_the_last_opinions_count() -> None:
    for most, expected in ((1, 1), (2, 1), (3, 1), (4, 0)):
        one = disseminating("dmmd", 1, max_opinions=most)
        for sender, opinion in ((4, 0), (1, 0), (3, 0), (2, 1)):
            one.hears(sender, 99.0, bit=opinion)
        one.wakes(100.0)
        assert one.s.opinion == expected


# Three-valued


def test_beliefs_combine_by_the_published_table() -> None:
    false, unsure, true = 0, 1, 2
    table = {
        (true, true): true, (true, unsure): true, (true, false): unsure, (unsure, true): true,
        (unsure, unsure): unsure, (unsure, false): false, (false, true): unsure, (false, unsure): false,
        (false, false): false,
    }  # fmt: skip
    for (own, heard), expected in table.items():
        assert three_valued.combined(own, heard) == expected
        # Two options at a time, as the program does it: beliefs of one are 2 minus those of the other.
        assert three_valued.combined(2 - own, 2 - heard) == 2 - expected


def test_a_signal_lasts_by_the_readings_of_its_option() -> None:
    p = SimpleNamespace(signal_s=40.0, interval_s=1.0)
    for truth, number, expected in ((2, 0.9, 10.0), (0, 0.1, 30.0), (1, 0.4, 10.0), (1, 0.6, 30.0)):
        s = SimpleNamespace(truth=truth, ones=2, readings=8)
        assert three_valued.signal_time(s, number, p) == expected
    assert three_valued.signal_time(SimpleNamespace(truth=2, ones=0, readings=8), 0.5, p) == 1.0
    assert three_valued.signal_time(SimpleNamespace(truth=2, ones=0, readings=0), 0.5, p) == 20.0


def test_a_belief_goes_through_signal_listening_and_update() -> None:
    one = One("three_valued", signal_s=40.0, listen_s=3.0, patience=2)
    one.s.truth, one.s.is_signalling, one.s.phase_end_s = 2, True, 50.0
    one.hears(1, 40.0, truth=0)
    assert one.s.heard == 0, "not while signalling"
    assert one.wakes(49.5).truth == 2
    assert one.wakes(50.0) is None
    assert one.s.next_s == 53.0
    one.hears(1, 52.0, truth=0)
    one.hears(1, 52.5, truth=2)
    said = one.wakes(53.0)
    assert (said.truth, one.s.truth, one.s.unchanged, one.decision) == (1, 1, 0, -1)
    # An uncertain belief that stays is not decided; a certain one is, after staying twice.
    for k, (heard, expected) in enumerate([(1, -1), (1, -1), (2, -1), (2, -1), (2, 1)]):
        one.s.is_signalling = False
        one.s.phase_end_s = 100.0 + 10.0 * k
        one.hears(2, 99.0 + 10.0 * k, truth=heard)
        one.wakes(100.0 + 10.0 * k)
        assert (one.s.truth, one.decision) == (heard, expected)


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


def test_dbbs_takes_no_robot_again_within_its_memory() -> None:
    one = One("dbbs", memory=2)
    taken = []
    for _ in range(8):
        one.hears(3, ones=1, zeros=0, social_ones=0.0, social_zeros=0.0)
        one.reads(1)
        taken.append(int(one.a.taken[3]))
    assert taken == [1, 1, 1, 4, 4, 4, 7, 7]


def test_dbbs_counts_a_sender_heard_twice_between_two_readings_once() -> None:
    one = One("dbbs")
    for sender, heard in ((1, 1), (1, 1), (2, 2), (1, 2)):
        one.hears(sender, ones=3, zeros=1, social_ones=0.0, social_zeros=0.0)
        assert one.s.heard == heard


def test_exponents_of_dbbs_stay_finite() -> None:
    one = One("dbbs", memory=0, decay_own=1.0, decay_other=1.0)
    for _ in range(2000):
        one.hears(3, ones=9, zeros=1, social_ones=one.s.social_ones, social_zeros=one.s.social_zeros)
        one.reads(1)
    assert one.s.social_ones + one.s.social_zeros <= 1.01e12
    assert one.s.social_ones / one.s.social_zeros == pytest.approx(9.0)
    assert one.s.below == 0.0


# ASDF and BayesCPF


@pytest.mark.parametrize("n", [1, 2, 5, 31])
def test_students_distribution(n: int) -> None:
    for t in (0.05, 0.7, 3.0):
        expected = 1 - 2 * stats.t.sf(t, n)
        assert asdf.student_central(t, n) == pytest.approx(expected, abs=1e-13)
        assert asdf.student_quantile(expected, n) == pytest.approx(t, rel=1e-9)


def test_asdf_corrects_its_accuracy_by_hand() -> None:
    assert asdf.calibrated(0.62, 0.7, 0.95) == pytest.approx(0.8)  # 0.8 0.7 + 0.2 0.3 = 0.62
    assert asdf.calibrated(0.38, 0.3, 0.95) == pytest.approx(0.8)
    assert asdf.calibrated(0.9, 0.7, 0.95) == asdf.PERFECT
    assert asdf.calibrated(0.4, 0.7, 0.95) == asdf.LOWEST
    assert asdf.calibrated(0.62, 0.5, 0.95) == 0.95, "blind at 1/2"
    estimates, confidences = np.array([0.0, 0.7, 0.72, 0.74, 0.76]), np.array([0.0, 1.0, 5.0, 5.0, 9.0])
    limit = np.std(estimates[1:], ddof=1) * (stats.t.ppf(0.55, 4) / 2.0 + 1.0)
    for own in (0.73 - 1.001 * limit, 0.73 - 0.999 * limit):
        assert asdf.differs(own, estimates, confidences, 0.1) == (own < 0.73 - limit)
    assert not asdf.differs(0.1, estimates, np.array([0.0, 1.0, 0.0, 0.0, 0.0]), 0.1), (
        "one other robot is too few"
    )


def swarm_of(
    name: str, fill: float, accuracies: list[float], readings: int, seed: int, **params: Any
) -> list[float]:
    """Accuracies that robots assume after some readings each, of sensors with these accuracies."""
    rng = np.random.default_rng(seed)
    robots = [One(name, WORLD._replace(robot=i), **params) for i in range(len(accuracies))]
    for _ in range(readings):
        for i, robot in enumerate(robots):
            said = robot.reads(int(rng.random() < accuracies[i] * fill + (1 - accuracies[i]) * (1 - fill)))
            for j, other in enumerate(robots):
                if j != i:
                    other.hears(i, estimate=said.estimate, confidence=said.confidence)
    return [float(robot.s.accuracy) for robot in robots]


@pytest.mark.parametrize(("fill", "works"), [(0.9, True), (0.25, True), (0.5, False)])
def test_a_robot_of_asdf_finds_its_accuracy_but_at_half(fill: float, works: bool) -> None:
    """All sensors are right in 85 % of readings; one robot of five assumes 60 %."""
    flawed = {"accuracy": 0.85, "flawed_accuracy": 0.6, "flawed_robots": 1}
    error = abs(swarm_of("asdf", fill, 5 * [0.85], 400, 1, **flawed)[0] - 0.85)
    assert (error < 0.1) == works


@pytest.mark.parametrize(("fill", "works"), [(0.95, True), (0.1, True), (0.5, False)])
def test_a_robot_of_bayes_cpf_finds_its_accuracy_but_at_half(fill: float, works: bool) -> None:
    """One sensor of five is right in 70 % of readings, the others in 95 %; all robots assume 95 %."""
    assumed = {"accuracy": 0.95, "variance": 1e-3, "drift": 0.0, "drift_variance": 1e-5, "window": 400}
    true = [0.7, 0.95, 0.95, 0.95, 0.95]
    error = abs(swarm_of("bayes_cpf", fill, true, 800, 1, **assumed)[0] - 0.7)
    assert (error < 0.05) == works


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


def test_the_accuracy_of_bayes_cpf_keeps_its_bounds() -> None:
    for mean, variance in ((1.02, 0.01), (0.45, 0.02), (1.3, 0.01), (0.3, 0.003)):
        spread = math.sqrt(variance)
        low, high = (bayes_cpf.LOWEST - mean) / spread, (bayes_cpf.PERFECT - mean) / spread
        expected = stats.truncnorm.mean(low, high, mean, spread)
        assert bayes_cpf.constrained(mean, variance) == pytest.approx(expected, abs=1e-6)
    assert bayes_cpf.constrained(0.7, 0.01) == 0.7
    assert bayes_cpf.constrained(9.0, 0.01) == bayes_cpf.PERFECT
    assert bayes_cpf.constrained(-9.0, 0.01) == bayes_cpf.LOWEST


def test_the_window_of_bayes_cpf_forgets() -> None:
    one = One("bayes_cpf", window=4)
    for k, value in enumerate((1, 1, 0, 1, 0, 0, 1)):
        one.reads(value)
        assert one.s.ones == sum((1, 1, 0, 1, 0, 0, 1)[max(k - 3, 0) : k + 1])
    estimates: NDArray[np.float64] = np.array([50.0, 60.0, 30.0, 40.0])  # the latest is 60, the oldest 30
    assert bayes_cpf.reference(estimates, 1, 4) == pytest.approx((4 * 30 + 3 * 40 + 2 * 50 + 60) / 10)
    assert bayes_cpf.reference(estimates, 1, 2) == pytest.approx((2 * 50 + 60) / 3)


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
