"""How the study's robots lost messages: in bursts, and the network `bursts` has what fits them best.

The recordings stay where they are; VIBROSWARM_RUGBOT names their folder.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vibroswarm.calibrate.message_loss import (
    Bursts,
    Windows,
    _Table,
    by_size,
    expected_by_size,
    fit_independent,
    lost_for_good,
    lost_in_long_windows,
    second_s,
    windows_of,
)
from vibroswarm.recordings.recording import Recording
from vibroswarm.scenario.scenario import preset


@pytest.fixture(scope="module")
def windows(real: Recording) -> list[Windows]:
    return windows_of(real)


def test_the_networks_defaults_are_the_best_fit(windows: list[Windows]) -> None:
    p = preset("paper").with_values({"network.name": "bursts"}).network.params
    default = Bursts(p.bad_share, p.bad_s, p.lost_in_bad, p.lost_in_good, 0.4935, 0.0, 5)
    table, spacing_s = _Table(windows), second_s(windows)
    best = table.log_likelihood(default, spacing_s)
    for name, worse in (("bad_share", 1.6), ("bad_s", 1.6), ("lost_in_good", 1.2), ("lost_in_bad", 0.9)):
        for times in (worse, 1.0 / worse):
            value = getattr(default, name) * times
            if value <= 1.0 or name == "bad_s":
                other = table.log_likelihood(replace(default, **{name: value}), spacing_s)
                assert other < best - 0.5, name
    plain = fit_independent(windows)
    assert plain.log_likelihood < best - 700.0
    assert default.lost == pytest.approx(plain.lost, abs=0.001)


def test_gaps_are_as_bursts_have_them(windows: list[Windows]) -> None:
    found = by_size(windows)
    bursts = expected_by_size(windows, Bursts(0.0129, 10.3, 1.0, 0.0095, 0.4935, 0.0, 5), 40)
    independent = expected_by_size(windows, fit_independent(windows), 10)
    # Of 2 messages there are more than expected, about 24 against 14: not all single losses are independent.
    others = np.arange(found.size) != 1
    assert (np.abs(found - bursts[0]) < 3.5 * np.maximum(bursts[1], 1.0))[others].all()
    assert found[3:].sum() >= 10 > 10 * independent[0, 3:].sum()


def test_receivers_lose_by_themselves(windows: list[Windows]) -> None:
    """What two robots lose in the same minute is not alike; a sender's failures would be lost by all."""
    correlations = []
    for run in (0, 1, 2):
        by_minute = []
        for one in (w for w in windows if w.run == run):
            minute = (np.cumsum(one.length_s) // 60.0).astype(int)
            by_minute.append(np.bincount(minute, lost_for_good(one), minlength=21)[:20])
        correlations += np.corrcoef(by_minute)[np.triu_indices(5, 1)].tolist()
    assert len(correlations) == 30
    assert -0.15 < np.mean(correlations) < 0.0


def test_a_robot_that_hears_nothing_does_not_sample_either(windows: list[Windows]) -> None:
    lost, sent = lost_in_long_windows(windows)
    assert lost > 0.45
    assert sent < 0.08
