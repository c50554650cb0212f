"""theta_E from labelled samples: where it is known, how sure, and what edges do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import optimize, stats

from vibroswarm.floors.floor import Floor
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.read import read_log
from vibroswarm.recordings.recording import Recording
from vibroswarm.recordings.threshold import (
    Labelled,
    at_threshold,
    edge_distance,
    equal_error,
    find_threshold,
    labelled,
    unseen_errors,
)
from vibroswarm.scenario.scenario import preset
from vibroswarm.statistics.intervals import wilson_limits


@pytest.fixture(scope="module")
def recording(logs: list[Path], ground: Floor) -> Recording:
    return recording_of([read_log(path) for path in logs], ground, preset("paper"))


STILL = stats.gamma(2.52194, scale=0.28754, loc=0.13731)
VIBRATING = stats.gamma(5.33497, scale=0.5132, loc=-0.2001)


def test_many_samples_of_the_papers_gammas_give_their_thresholds() -> None:
    rng = np.random.default_rng(3)
    kind = np.arange(200_000) % 100 < 48
    energy = np.where(
        kind, VIBRATING.rvs(kind.size, random_state=rng), STILL.rvs(kind.size, random_state=rng)
    )
    one = np.ones(kind.size)
    cross = optimize.brentq(lambda t: STILL.sf(t) - VIBRATING.cdf(t), 0.5, 3)
    assert equal_error(energy, kind, one) == pytest.approx(cross, abs=0.01)


def test_a_recording_gives_it_with_its_uncertainty(recording: Recording) -> None:
    equal = find_threshold(recording)
    cross = optimize.brentq(lambda t: STILL.sf(t) - VIBRATING.cdf(t), 0.5, 3)
    assert equal.low < cross < equal.high
    assert equal.low < equal.value < equal.high
    assert equal.all_samples.false_positive == pytest.approx(equal.all_samples.false_negative, abs=0.005)


def test_a_floor_that_reads_to_the_wrong_side_is_told(recording: Recording) -> None:
    told = at_threshold(recording, 0.6).decidable
    assert told.verdict == "wrong side", told.says
    assert at_threshold(recording, 2.2).decidable.verdict == "decidable"


def test_distance_to_the_other_kind() -> None:
    floor = Floor.filling([[0, 1], [0, 0]])
    x, y = np.array([0.4, 0.45, 0.6, 0.1]), np.array([0.6, 0.3, 0.9, 0.1])
    kinds = np.array([False, False, True, False])
    found = edge_distance(floor, x, y, kinds)[0]
    assert found == pytest.approx([0.1, np.hypot(0.05, 0.2), 0.1, np.hypot(0.4, 0.4)])
    alike = edge_distance(Floor.filling([[1, 1]]), x, y, np.ones(4, dtype=bool))[0]
    assert np.isinf(alike).all()


def test_errors_in_a_session_are_of_the_threshold_of_the_others(recording: Recording) -> None:
    data = labelled(recording)
    other, still = data.session == 1, ~data.vibrating
    value = equal_error(data.energy[other], data.vibrating[other], np.ones(other.sum()))
    first = unseen_errors(recording).row(0, named=True)
    assert (first["session"], first["threshold"]) == (1, value)
    assert first["false_positive"] == (data.energy[~other & still] > value).mean()


def test_the_share_of_ones_holds_for_other_robots(recording: Recording) -> None:
    """Five robots multiply energies by factors of their own; samples as units, the control, hold half of the truths."""
    random, found, alone = np.random.default_rng(9), [], []
    tile, robot = np.tile(np.arange(25), 30), np.repeat(np.arange(5), 150)
    vibrating, session = tile < 12, np.zeros(750, dtype=np.int64)
    kind = stats.gamma(3.0, 0.3, 0.22), stats.gamma(4.0, 0.8, 0.25)  # still, vibrating
    factors = np.exp(0.12 * stats.norm.ppf((np.arange(1000) + 0.5) / 1000))
    q = sum(w * law.sf(1.33 / factors).mean() for w, law in zip((13 / 25, 12 / 25), kind, strict=True))
    for _ in range(200):
        own = np.exp(0.12 * random.normal(size=5))[robot]
        energy = own * np.where(vibrating, *(law.rvs(750, random_state=random) for law in kind[::-1]))
        data = Labelled(energy, vibrating, tile, session, robot, 12 / 25)
        decidable = at_threshold(recording, 1.33, data).decidable
        low, high = wilson_limits((energy > 1.33).sum(), 750)
        found.append(decidable.share_low <= q <= decidable.share_high)
        alone.append(low <= q <= high)
    assert np.mean(found) > 0.91
    assert np.mean(alone) < 0.75
