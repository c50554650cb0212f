"""The rule by which an inspection ends: told risks against direct computation, and what it clears all the same."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.special import logit, logsumexp
from scipy.stats import binom, gamma, norm

from helpers.inspections import drawn_samples
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.inspection.assessment import assess
from vibroswarm.inspection.damage import (
    contrast_ratios,
    drawn_values,
    patch_of,
    random_places,
    ratios_at,
    values_at,
)
from vibroswarm.inspection.laws import law_of_measured
from vibroswarm.inspection.patches import Form, declared, log_likelihoods, shares_of
from vibroswarm.inspection.samples import Law
from vibroswarm.inspection.scan import looks_of
from vibroswarm.inspection.stopping import LOOKS, Question, Rule, _heard, _in_worst_block, rule_of, stopping
from vibroswarm.scenario.scenario import preset

SIDES_M = (0.1, 0.2)
LAW = Law(preset("paper").sensor, "preset paper")
QUESTION = Question(0.2, (1.0,))


def test_the_told_risk_of_a_tiny_case_is_exact() -> None:
    """Where the whole surface is the only patch, Lambda is the product of the likelihood ratios."""
    samples = drawn_samples(5, count=25, spread_m=0.0)
    inside = samples.with_columns(x_m=np.full(25, 0.3), y_m=np.full(25, 0.3))
    patches = declared(samples.size_m, [0.6])
    value = values_at(inside.law, np.linspace(0.1, 0.9, 25), False)[:, None]
    question = Question(least_m=0.6, contrasts=(1.0,), prior=0.2)
    ratio = np.exp(ratios_at(inside.law, value).sum())
    told = rule_of(inside, patches, question).told(value)
    assert told[0, 0] == pytest.approx(0.2 * ratio / (0.8 + 0.2 * ratio), rel=1e-3)


@pytest.mark.parametrize("strict", [False, True])
def test_the_told_risk_of_several_places_sizes_and_contrasts_is_that_of_a_second_implementation(
    strict: bool,
) -> None:
    """By the distributions of scipy, place by place; damage is blurred as widely as within half a step of each."""
    random, size_m, sides_m, contrasts = np.random.default_rng(6), (0.3, 0.24), (0.1, 0.16), (1.0, 0.6)
    x_m, y_m = (side * random.random(60) for side in size_m)
    samples = drawn_samples(6, count=60, spread_m=0.0).with_columns(x_m=x_m, y_m=y_m)
    samples = replace(samples, law=LAW, size_m=size_m)
    sensor, u = LAW.sensor, norm.cdf(np.linspace(-6.0, 6.0, 20001))
    still = gamma(sensor.still_shape, sensor.still_location, sensor.still_scale)
    vibrating = gamma(sensor.vibrating_shape, sensor.vibrating_location, sensor.vibrating_scale)
    value, lambdas = still.rvs(60, random_state=random), []
    blur_m = 0.025 / np.sqrt(12.0)  # places are 25 mm apart along x and y
    for side_m in sides_m:
        lows = [
            np.linspace(0.0, whole - side_m, int(np.ceil((whole - side_m) / max(side_m / 4, 0.025))) + 1)
            for whole in size_m
        ]
        qx, qy = (
            norm.cdf((low[:, None] + side_m - at) / blur_m) - norm.cdf((low[:, None] - at) / blur_m)
            for low, at in zip(lows, (x_m, y_m), strict=True)
        )
        for contrast in contrasts:
            quantile = (1.0 - contrast) * still.ppf(u) + contrast * vibrating.ppf(u)
            density = np.interp(value, quantile, np.gradient(u, quantile))
            ratio = np.exp(np.clip(np.log(density) - still.logpdf(value), -8.0, 8.0))  # none decides alone
            of_place = np.prod(1.0 + (ratio - 1.0) * qx[:, None] * qy[None], axis=2)
            lambdas.append(of_place.max() if strict else of_place.mean())
    question = Question(min(sides_m), contrasts, prior=0.2, strict=strict)
    told = rule_of(samples, declared(size_m, sides_m), question).told(value[:, None])[0, 0]
    assert 0.01 < told < 0.9
    assert told == pytest.approx(0.2 * max(lambdas) / (0.8 + 0.2 * max(lambdas)), rel=0.01)


@pytest.mark.parametrize("differ", ["tile_spread", "robot_spread"])
@pytest.mark.parametrize("on_damage", [25, 9])
def test_samples_share_the_factor_of_their_tile_or_robot(on_damage: int, differ: str) -> None:
    """Against the integral over the factor: samples beside the damage, of the same tile or robot, show it."""
    samples = drawn_samples(5, count=25, spread_m=0.0)
    x_m = np.where(np.arange(25) < on_damage, 0.05, 0.35)
    inside = samples.with_columns(x_m=x_m, y_m=np.full(25, 0.3), robot=np.zeros(25, np.uint16))
    one_tile = Floor(np.zeros((1, 1), np.uint8), 0.6, 0.6)
    spread = replace(LAW, sensor=LAW.sensor.model_copy(update={differ: 0.4}))
    value = 1.5 * values_at(LAW, np.linspace(0.2, 0.8, 25), False)
    patches = replace(declared((0.6, 0.6), [0.6]), forms=(Form(0.2, 0.6),))
    shares = shares_of(inside, patches)
    rule = Rule(
        replace(inside, law=spread, floor=one_tile),
        patches,
        shares,
        QUESTION,
        np.zeros(25, int),
        1,
        np.zeros(25, int),
    )
    laws = [
        gamma(*(getattr(LAW.sensor, f"{kind}_{name}") for name in ("shape", "location", "scale")))
        for kind in ("still", "vibrating")
    ]
    log_factor = np.linspace(-2.5, 2.5, 3001)[:, None]
    still, vibrating = (law.logpdf(value * np.exp(-log_factor)) - log_factor for law in laws)
    vibrating = still + np.clip(vibrating - still, -8.0, 8.0)  # no value may decide alone
    prior = norm.logpdf(log_factor[:, 0], -0.08, 0.4)
    is_on = np.arange(25) < on_damage
    true = logsumexp(prior + np.where(is_on, vibrating, still).sum(axis=1)) - logsumexp(
        prior + still.sum(axis=1)
    )
    told = rule.told(value[:, None])[0, 0]
    assert logit(told) == pytest.approx(true, abs=0.05)
    # The control: samples as if independent, each by a law that has the spread.
    assert abs(ratios_at(spread, value)[is_on].sum() - true) > 1.0


def test_damage_that_does_not_fit_is_refused() -> None:
    """Before the scan, which may take minutes."""
    done: list[float] = []
    with pytest.raises(InputError, match=r"--least-cm: squares of 70 cm do not fit .* give 60 or less"):
        assess(
            drawn_samples(6, count=200, spread_m=0.0),
            Question(least_m=0.7),
            sides_m=SIDES_M,
            replicates=19,
            progress=done.append,
        )
    assert done == []


def test_damage_too_weak_to_be_called_is_suspected_where_it_is() -> None:
    """An engineer read that more samples are needed, at a risk of 100 %, and not where they fit damage."""
    samples = replace(drawn_samples(8, count=900, spread_m=0.0), law=LAW)
    patches, random = declared(samples.size_m, SIDES_M), np.random.default_rng(3)
    rule = rule_of(samples, patches, Question(contrasts=(1.0, 0.5)))
    centre_m = np.full(1, 0.4), np.full(1, 0.2)
    weak = drawn_values(random, samples, 1, patch_of(*centre_m, 0.2, 0.4))
    assert rule.told(weak)[0, 0] > 0.99
    suspected = rule.suspected(weak[:, 0])
    assert suspected is not None
    assert suspected[0].centre_m == pytest.approx((0.4, 0.2), abs=0.05)
    assert suspected[1] == 0.5
    assert rule.suspected(drawn_values(random, samples, 1)[:, 0]) is None  # an intact surface


@pytest.mark.parametrize("declared_m", [(0.3,), (0.07, 0.3), ((0.3, 0.05), (0.05, 0.3))])
def test_the_least_damage_is_part_of_the_told_risk_whatever_is_declared(declared_m: tuple[Any, ...]) -> None:
    """Of squares of 30 cm alone it was below 1 % where squares of 10 cm, which were asked for, were missed."""
    samples = replace(drawn_samples(6, count=120, spread_m=0.0), law=LAW)
    question = Question(least_m=0.1, contrasts=(1.0,))
    value = values_at(LAW, np.random.default_rng(1).random((120, 20)), False)
    least = rule_of(samples, declared(samples.size_m, [0.1]), question).told(value)
    told = rule_of(samples, declared(samples.size_m, declared_m), question).told(value)
    assert (told >= least).all()


@pytest.mark.parametrize("least_risk", [0.01, 0.06])
def test_the_worst_place_is_one_of_many_draws(least_risk: float) -> None:
    """Only one block of centres, 8 cm wide, has a high risk; a single extreme draw elsewhere must not win."""
    random = np.random.default_rng(1)
    x_m, y_m = random.uniform(0.1, 0.5, (2, 2000))
    risk = np.where((x_m < 0.18) & (y_m > 0.42), least_risk, 1.0)
    risk[y_m.argmin()] = 1e-9
    worst_m = _in_worst_block(random, x_m, y_m, risk, Question(0.2), (0.6, 0.6))
    assert [at_m.size for at_m in worst_m] == [1000, 1000]
    assert [at_m.min() for at_m in worst_m] == pytest.approx([0.1, 0.42], abs=1e-3)
    assert [at_m.max() for at_m in worst_m] == pytest.approx([0.18, 0.5], abs=1e-3)


@pytest.mark.parametrize("strict", [False, True])
def test_the_told_risk_at_a_look_is_that_of_the_samples_so_far(strict: bool) -> None:
    samples = replace(drawn_samples(8, count=120, spread_m=0.02), law=LAW)
    patches = declared(samples.size_m, SIDES_M)
    random = np.random.default_rng(2)
    values = drawn_values(random, samples, 40, patch_of(np.full(40, 0.3), np.full(40, 0.4), 0.1))
    question = Question(contrasts=(1.0, 0.5), prior=0.3, strict=strict)
    told = rule_of(samples, patches, question, 5).told(values)
    times_s, _ = looks_of(samples, 5)
    between_m = np.full(120, np.hypot(0.02, 0.025 / np.sqrt(12.0)))  # damage lies between places 25 mm apart
    for now, time_s in enumerate(times_s):
        so_far = samples.with_columns(spread_x_m=between_m, spread_y_m=between_m).by_time(time_s)
        shares, worst = shares_of(so_far, patches), np.zeros(40)
        for contrast in question.contrasts:
            logs = log_likelihoods(shares, contrast_ratios(LAW, values[: so_far.frame.height], contrast))
            for size in range(2):
                of_size = np.exp(logs[patches.form == size])
                worst = np.maximum(worst, of_size.max(axis=0) if strict else of_size.mean(axis=0))
        assert told[now] == pytest.approx(0.3 * worst / (0.7 + 0.3 * worst), rel=1e-4)


def test_the_told_risk_is_that_of_damage_between_the_declared_places() -> None:
    """By exact places, and damage at those that are declared only, 0.2 % was told where 0.5 % was true."""
    samples = replace(drawn_samples(8, count=100, spread_m=0.0), law=LAW)
    rule = rule_of(samples, declared(samples.size_m, [0.2]), Question(0.2, (1.0,)))
    random = np.random.default_rng(1)
    centre_m = random_places(random, np.full(3000, 0.2), samples.size_m)
    damage = drawn_values(random, samples, 3000, patch_of(*centre_m, 0.2))
    told = rule.told(np.hstack([damage, drawn_values(random, samples, 3000)]))[0]
    cleared = told <= 0.1
    assert binom.sf(cleared[:3000].sum() - 1, cleared.sum(), told[cleared].mean()) > 0.05


def test_the_told_risk_is_a_mean_over_laws() -> None:
    random = np.random.default_rng(2)
    samples = replace(drawn_samples(8, count=120, spread_m=0.0), law=LAW)
    value = drawn_values(random, samples, 1)
    vibrating, still = (values_at(LAW, random.random(100), kind) for kind in (True, False))
    law = law_of_measured(vibrating, still, "100 values of each kind")
    laws = [law, *(Law(one.judge, "resampled") for one in law.draws)]
    question, patches = Question(0.2, (1.0, 0.5)), declared(samples.size_m, [0.2])
    of_all, *of_each = (
        rule_of(replace(samples, law=one), patches, question, 3).told(value) for one in (law, *laws[1:])
    )
    alone = rule_of(replace(samples, law=replace(law, draws=())), patches, question, 3).told(value)
    assert np.ptp([alone, *of_each], axis=0).max() > 0.01
    assert of_all == pytest.approx(np.mean([alone, *of_each], axis=0), rel=1e-9)


def test_missed_damage_is_that_of_the_first_look_which_tolerates_the_risk() -> None:
    """At the end of an inspection that nobody ended, fewer are missed: what was promised before was half as much.

    Damage has the weakest of the contrasts that are asked for.
    """
    samples = replace(drawn_samples(9, count=100, spread_m=0.0), law=LAW)
    patches, question = declared(samples.size_m, [0.2]), Question(0.2, (1.0, 0.6), risk=0.1)
    found = stopping(samples, patches, question)
    random = np.random.default_rng(3)
    x_m, y_m = random.uniform(0.1, 0.5, (2, 2000))
    values = drawn_values(random, samples, 2000, patch_of(x_m, y_m, 0.2, 0.6))
    told = rule_of(samples, patches, question, LOOKS).told(values)
    for share, cleared in ((found.missed, (told <= 0.1).any(axis=0)), (found.missed_at_end, told[-1] <= 0.1)):
        assert share.low - 0.01 <= cleared.mean() <= share.high + 0.01
    assert found.missed.estimate > 2.0 * found.missed_at_end.estimate
    assert found.worst.estimate >= found.missed.estimate
    assert found.worst.n == 1000  # of its own
    assert found.missed_at_end.estimate > 0.0
    heard = stopping(samples, patches, replace(question, loss=1e-9), drawn=200)
    assert heard.missed_by_robots == heard.missed  # robots that hear all stop as the centre does


def test_robots_that_lose_messages_stop_later_than_a_centre() -> None:
    samples = replace(drawn_samples(7, count=400, spread_m=0.0), law=LAW)
    samples = samples.with_columns(value=np.full(400, 0.4), log_ratio=np.full(400, -1.0))  # intact
    patches = declared(samples.size_m, SIDES_M)
    all_heard, some, none = (
        stopping(samples, patches, Question(least_m=0.2, contrasts=(1.0,), loss=loss), drawn=20)
        for loss in (0.0, 0.5, 1.0)
    )
    assert all_heard.robots_s == all_heard.cleared_s == some.cleared_s
    assert some.robots_s is not None
    assert some.robots_s > some.cleared_s
    assert none.robots_s is None or none.robots_s > some.robots_s


def test_a_robot_that_knows_too_little_lets_no_swarm_clear() -> None:
    """Robot 0 has one sample; the centre, with those of all, clears and misses damage."""
    samples = replace(drawn_samples(7, count=120, spread_m=0.0), law=LAW)
    robot = np.maximum(np.arange(120) % 3, np.arange(120) > 0).astype(np.int64)
    question = Question(least_m=0.4, contrasts=(0.5,), risk=0.2, loss=1.0)
    samples, patches = samples.with_columns(robot=robot), declared(samples.size_m, [0.4])
    for one, heard in enumerate(_heard(rule_of(samples, patches, question), np.random.default_rng(1), 2)):
        assert (heard == (robot == one)[:, None]).all()  # its own are never lost
    found = stopping(samples, patches, question, drawn=200)
    assert found.robots_s is None
    assert found.missed_by_robots is not None
    assert found.missed_by_robots.estimate == 0.0 < found.missed.low


def test_robots_that_hear_nobody_may_stop_before_the_centre() -> None:
    """What is too little for each of them is enough for the centre to suspect damage."""
    samples = replace(drawn_samples(5, count=50, spread_m=0.0), law=LAW)
    middle = np.full(50, 0.3)
    at = np.linspace(0.05, 0.95, 2000)
    energy = values_at(LAW, at, True)
    doubt, calm = (energy[np.abs(ratios_at(LAW, energy) - wanted).argmin()] for wanted in (0.3, -0.3))
    value = np.where(np.arange(50) < 10, doubt, calm)
    time_s = np.where(np.arange(50) < 10, 1.0, np.arange(50.0))
    asked = samples.with_columns(x_m=middle, y_m=middle, value=value, time_s=time_s)
    question = Question(least_m=0.6, contrasts=(1.0,), risk=0.7, loss=1.0)
    told = stopping(asked, declared(asked.size_m, [0.6]), question, drawn=20)
    assert told.cleared_s is not None
    assert told.robots_s is not None
    assert told.robots_s < told.cleared_s
