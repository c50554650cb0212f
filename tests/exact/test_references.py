"""Pooled counting and what could be known: against plain loops and enumeration, and their errors as they should be."""

from __future__ import annotations

import itertools
import json
import math
import time
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from vibroswarm.analysis.centralised_baseline import evidence, first_passages, pooled_counting
from vibroswarm.analysis.oracle_posterior import could_be_known, on_both_sides, tiles_inside
from vibroswarm.analysis.tile_posterior import (
    log_prior,
    log_ratios,
    mirrored,
    posterior_of_counts,
    sides_of,
)
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate


@pytest.fixture(scope="module")
def paper() -> Result:
    return simulate(preset("paper"), 21, 200)


def test_limits_of_what_two_runs_claim_stay_within_what_they_may() -> None:
    """A decided run claims at most alpha."""
    two = simulate(preset("paper"), 21, 2)
    found = could_be_known(two, "mirror", alpha=0.05)
    assert found.known.estimate == 1.0
    assert 0.0 <= found.claimed.low <= found.claimed.estimate <= found.claimed.high <= 0.05


def test_first_passages_as_a_plain_loop_has_them(paper: Result) -> None:
    passages = first_passages(paper, [0, 7], "count", np.array([0.5, 3.0, 11.5, 5000.0]))
    for r, run in enumerate((0, 7)):
        of_run = paper.motion["run"] == run
        bits = paper.observations.filter(of_run)["observation"].to_list()
        times = paper.motion.filter(of_run)["time_s"].to_list()
        for k, h in enumerate(passages.thresholds):
            x, found = 0.0, (-1, math.inf)
            for bit, t in zip(bits, times, strict=True):
                x += bit - 0.5
                if abs(x) >= h:
                    found = (int(x > 0), t)
                    break
            assert (passages.decision[r, k], passages.time_s[r, k]) == found


def test_evidence_by_belief_is_that_of_the_robots(paper: Result) -> None:
    bits = paper.observations["observation"][:300].to_numpy()
    ones = np.cumsum(bits)
    n = np.arange(1, 301)
    for boundary, alpha, beta in ((0.5, 1, 1), (0.4, 2, 7)):
        decision = {"decision_boundary": boundary, "prior_alpha": alpha, "prior_beta": beta}
        scenario = paper.scenario.with_values({f"decision.{name}": value for name, value in decision.items()})
        asked = replace(paper, scenario=scenario)
        belief = stats.beta.cdf(boundary, alpha + ones, beta + n - ones)
        np.testing.assert_allclose(evidence(bits, asked, "belief"), np.log((1 - belief) / belief), atol=1e-9)
        np.testing.assert_allclose(evidence(bits, asked, "count"), ones - boundary * n, atol=1e-9)
    assert np.isfinite(evidence(np.ones(9000, np.uint8), paper, "belief")).all()


@pytest.mark.parametrize("rule", ["count", "belief"])
@pytest.mark.parametrize("u", [0.0, 1.0])
def test_pooled_counting_has_the_strategys_error_and_is_judged_on_other_runs(
    paper: Result, rule: str, u: float
) -> None:
    found = pooled_counting(paper, rule, u)  # type: ignore[arg-type]
    assert (found.runs_tuned, found.runs_judged) == (100, 100)
    assert found.tuned_error <= found.strategy_tuned_error + 0.01
    if u == 0.0:
        assert found.tuned_error > found.strategy_tuned_error - 0.03  # and not for nothing
    assert not found.error_difference.excludes(0.0)
    assert found.time_difference_s.estimate == pytest.approx(
        found.strategy_time_s.estimate - found.time_s.estimate
    )
    assert found.strategy_wrong.estimate + u * found.strategy_undecided.estimate == pytest.approx(
        found.strategy_error.estimate
    )
    assert found.error_difference.estimate == pytest.approx(
        found.strategy_error.estimate - found.error.estimate
    )
    json.dumps(found.as_dict(), allow_nan=False)


def test_who_counts_in_vain_takes_the_whole_time() -> None:
    """No robot decides within a minute, so none is wrong; of those who count, who err as seldom, few decide."""
    result = simulate(preset("paper").with_values({"run.t_end_s": 60.0}), 3, 40)
    found = pooled_counting(result, undecided_counts=0.1)
    assert found.strategy_undecided.estimate == 1.0
    assert found.undecided.estimate > 0.0
    assert found.error.estimate == pytest.approx(found.wrong.estimate + 0.1 * found.undecided.estimate)
    passages = first_passages(result, list(range(1, 40, 2)), "count", np.array([found.threshold]))
    assert found.time_s.estimate == pytest.approx(np.minimum(passages.time_s, 60.0).mean())


def test_pooled_counting_judges_nothing_that_it_was_tuned_on(paper: Result) -> None:
    """With the bits of the tuning half turned round, the judged half is judged at another threshold only."""
    even = paper.observations["run"] % 2 == 0
    turned = paper.observations.with_columns(
        observation=pl.when(even)
        .then(1 - pl.col("observation"))
        .otherwise(pl.col("observation"))
        .cast(pl.UInt8)
    )
    found = pooled_counting(replace(paper, observations=turned))
    as_it_was = pooled_counting(paper)
    assert found.threshold > as_it_was.threshold  # what was right is wrong there
    judged = list(range(1, 200, 2))
    passages = first_passages(paper, judged, "count", np.array([found.threshold]))
    assert found.undecided.estimate == (passages.decision == -1).mean() > as_it_was.undecided.estimate


def by_enumeration(ratios: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """P(k) by going through all 2^N floors."""
    tiles = ratios.size
    posterior = np.zeros(tiles + 1)
    for floor in itertools.product([0, 1], repeat=tiles):
        k = sum(floor)
        posterior[k] += weights[k] / math.comb(tiles, k) * math.exp(float(np.dot(floor, ratios)))
    return posterior / posterior.sum()


@settings(deadline=None, max_examples=40)
@given(
    arrays(float, 7, elements=st.floats(-8, 8)),
    st.sampled_from(["tiles", "counts", [0, 0, 1, 5, 0, 3, 0, 0]]),
)
def test_the_posterior_is_that_of_all_floors(ratios: np.ndarray, prior: object) -> None:
    of_prior = log_prior(prior, 7)  # type: ignore[arg-type]
    mine = posterior_of_counts(ratios[None, :], of_prior)[0]
    np.testing.assert_allclose(mine, by_enumeration(ratios, np.exp(of_prior)), atol=1e-12)


def test_many_well_known_tiles_do_not_underflow() -> None:
    ratios = np.where(np.arange(1600) < 850, 400.0, -400.0)[None, :]
    posterior = posterior_of_counts(ratios, log_prior("counts", 1600))[0]
    assert posterior[850] == pytest.approx(1.0)
    two = np.zeros(1601)
    two[[600, 1000]] = 1.0  # the prior rules out what the samples say
    unlikely = posterior_of_counts(np.full((1, 1600), 0.4), log_prior(two, 1600))[0]
    assert unlikely[[600, 1000]].sum() == pytest.approx(1.0)
    above, under = sides_of(ratios, log_prior("tiles", 1600), 0.5)
    assert (above[0], under[0]) == (pytest.approx(1.0), pytest.approx(0.0))


def test_without_samples_the_posterior_is_the_prior() -> None:
    for prior in ("tiles", "counts"):
        flat = posterior_of_counts(np.zeros((1, 9)), log_prior(prior, 9))[0]
        np.testing.assert_allclose(flat, np.exp(log_prior(prior, 9)))
    above, under = sides_of(np.zeros((1, 4)), log_prior("counts", 4), 0.5)
    assert (above[0], under[0]) == pytest.approx((0.4, 0.4))  # 2 of 4 lie on neither side


@given(st.integers(1, 60), st.floats(0.001, 0.999), st.data())
def test_a_mirror_lies_across_the_boundary(tiles: int, boundary: float, data: st.DataObject) -> None:
    """Rounded to whole tiles it could lie on the run's own side, and all would be known without a sample."""
    k = data.draw(st.integers(0, tiles))
    assume(abs(k - boundary * tiles) > 1e-6)
    both = np.flatnonzero(mirrored(k, tiles, boundary))
    assert both.size == 2
    assert both[0] < boundary * tiles < both[1]


def test_a_mirror_by_hand() -> None:
    assert np.flatnonzero(mirrored(12, 25, 0.5)).tolist() == [12, 13]
    assert np.flatnonzero(mirrored(48, 100, 0.5)).tolist() == [48, 52]
    assert np.flatnonzero(mirrored(10, 100, 0.03)).tolist() == [0, 10]  # there are none below 0
    assert np.flatnonzero(mirrored(1, 25, 0.036)).tolist() == [0, 1]  # round(2 x 0.9 - 1) is 1 again
    assert np.flatnonzero(mirrored(5, 10, 0.5)).tolist() == [5]  # on the boundary: no mirror


def test_every_second_run_on_the_other_side(paper: Result) -> None:
    found = on_both_sides(paper)
    even = pl.col("run") % 2 == 0
    for name in ("observations", "inference", "robots", "runs", "floors"):
        here, there = getattr(found, name), getattr(paper, name)
        assert here.filter(even).equals(there.filter(even)), name
        assert here.select("run").equals(there.select("run"))
    assert found.motion is paper.motion
    assert found.runs.filter(even)["truth"].unique().to_list() == [0]
    assert found.runs.filter(~even)["truth"].unique().to_list() == [1]
    other = simulate(preset("paper").with_values({"floor.source": "random:0.52"}), 21, [1, 7])
    for name in ("observations", "runs", "floors"):
        of_runs = getattr(found, name).filter(pl.col("run").is_in([1, 7]))
        assert of_runs.drop("energy", strict=False).equals(getattr(other, name).drop("energy", strict=False))
    broken = preset("paper").with_values({"faults.stuck_at_1": [2], "run.t_end_s": 100.0})
    kept = simulate(broken, 1, 2)
    assert kept.faults is not None
    assert on_both_sides(kept).faults is kept.faults
    fixed = simulate(preset("paper").with_values({"floor.source": "stripe:0.48", "run.t_end_s": 20.0}), 1, 2)
    with pytest.raises(InputError, match="drawn for each run"):
        on_both_sides(fixed)


def test_claimed_errors_are_those_that_happen(paper: Result) -> None:
    """Over both sides the share wrong is the mean of the claimed errors, at most alpha."""
    found = could_be_known(on_both_sides(paper), "mirror", alpha=0.2)
    assert found.claimed.high < 0.2
    n, wrong = found.wrong.n, round(found.wrong.estimate * found.wrong.n)
    assert stats.binomtest(wrong, n, found.claimed.estimate).pvalue > 0.01
    # Negative control: counts claims less than happens.
    boast = could_be_known(on_both_sides(paper), "counts", alpha=0.2)
    assert boast.wrong.low > boast.claimed.high


def test_places_energies_and_priors_tell_more(paper: Result) -> None:
    bits = could_be_known(paper)
    counts = could_be_known(paper, "counts")
    energies, mirror = could_be_known(paper, energies=True), could_be_known(paper, "mirror")
    assert energies.time_s.high < bits.time_s.low
    assert mirror.time_s.high < 887 / 2  # the swarm's own time
    # Priors that take floors so near the boundary for rare believe sooner than they should.
    assert mirror.time_s.low > bits.time_s.high
    assert mirror.wrong.low < 0.05 < counts.wrong.low
    assert bits.wrong.estimate > mirror.wrong.estimate
    for known in (bits, counts, energies, mirror):
        share = known.over_time["known"]
        assert (share.diff().drop_nulls() >= 0).all()
        assert share[-1] == known.known.estimate
        assert known.over_time["wrong"][-1] <= share[-1]
        json.dumps(known.as_dict(), allow_nan=False)
    assert bits.over_time["belief_in_truth"][0] == pytest.approx(0.5, abs=1e-9)
    assert bits.over_time["belief_in_truth"][-1] > 0.9


def test_a_known_run_by_hand(paper: Result) -> None:
    """Run 5 at 300 s: ratios summed up tile by tile, and floors counted by the polynomial."""
    of_run = (paper.motion["run"] == 5) & (paper.motion["time_s"] <= 300.0)
    ratios, tiles = log_ratios(paper)[of_run.to_numpy()], paper.observations.filter(of_run)["tile"].to_numpy()
    polynomial = np.ones(1)
    for t in range(25):
        p = 1 / (1 + math.exp(-ratios[tiles == t].sum()))
        polynomial = np.convolve(polynomial, [1 - p, p])
    truth = paper.runs["truth"][5]
    right = polynomial[13:].sum() if truth == 1 else polynomial[:13].sum()
    alone = could_be_known(
        replace(paper, runs=paper.runs.filter(pl.col("run") == 5)), times_s=[0.0, 299.0, 300.0]
    )
    assert alone.runs["belief_in_truth"][0] == pytest.approx(right)


def test_cut_tiles_and_places_without_a_tile() -> None:
    floor = Floor(np.ones((3, 3)), 0.5, 0.5, -0.5, -0.5)
    assert tiles_inside(floor, 1.0, 1.0).tolist() == [1, 2, 4, 5]
    # Of tiles that are cut unevenly the posterior counts whole ones, and what is true goes by area.
    with pytest.raises(InputError, match="cuts some of the tiles"):
        tiles_inside(Floor(np.ones((3, 3)), 0.4, 0.4), 1.0, 1.0)
    with pytest.raises(InputError, match="no tile"):
        tiles_inside(Floor(np.ones((1, 1)), 0.5, 0.5, 2.0, 0.0), 1.0, 1.0)
    values = {
        "floor.tile_width_m": 0.15,
        "floor.tile_height_m": 0.15,
        "floor.left_m": 0.4,
        "run.t_end_s": 200.0,
    }
    known = could_be_known(simulate(preset("paper").with_values(values), 1, 4))
    assert known.runs["truth"].len() == 4


def test_a_sensor_without_errors_settles_a_tile_at_once() -> None:
    values = {"sensor.still_location": -50.0, "sensor.vibrating_location": 50.0}
    perfect = simulate(preset("paper").with_values(values), 3, 20)
    known = could_be_known(perfect, alpha=0.01)
    assert (known.known.estimate, known.wrong.estimate) == (1.0, 0.0)
    assert known.time_s.estimate < could_be_known(simulate(preset("paper"), 3, 20), alpha=0.01).time_s.low
    with pytest.raises(InputError, match="energies"):
        could_be_known(simulate(preset("paper"), 1, 1, energies=False), energies=True)
    with pytest.raises(InputError, match="alpha"):
        could_be_known(perfect, alpha=0.6)
    for times in ([], [10.0, 5.0], [1.0, math.nan]):
        with pytest.raises(InputError, match="times_s"):
            could_be_known(perfect, times_s=times)


def test_it_is_fast_enough(paper: Result) -> None:
    began = time.process_time()
    could_be_known(paper)
    pooled_counting(paper)
    assert (time.process_time() - began) / 200 < 0.03  # measured: 0.002 s a run
