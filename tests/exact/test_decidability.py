"""Whether it can be decided at all: by hand, and by simulation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from vibroswarm.floors.floor import Floor
from vibroswarm.observation.decision_boundary import tiled_share
from vibroswarm.observation.energy_model import error_rates
from vibroswarm.scenario.scenario import preset
from vibroswarm.statistics.decidability import (
    decidability,
    samples_needed,
)

PAPER = preset("paper")


def at(**values: object) -> object:
    return decidability(PAPER.with_values({name.replace("__", "."): v for name, v in values.items()}))


def test_the_paper_can_be_decided_and_with_how_many_samples() -> None:
    d = decidability(PAPER)
    a, b = error_rates(PAPER.sensor)
    assert d.verdict == "decidable"
    assert d.share == pytest.approx(0.48 * (1 - b) + 0.52 * a)
    assert d.margin == pytest.approx(0.5 - d.share)
    assert d.samples_needed > 3000  # three runs of five robots: it is a hard floor


def test_the_printed_threshold_decides_more_than_half_wrongly() -> None:
    d = at(sensor__rms_threshold=1.55, floor__source="random:0.52")
    assert d.verdict == "wrong side"
    assert d.share < 0.5
    assert "more samples make the wrong answer more certain" in d.says
    became = {"floor__source": "random:0.48", "change__at_s": 900.0, "change__to": "random:0.52"}
    assert at(sensor__rms_threshold=1.55, **became).says == f"Floor at the end: {d.says}"


def test_robots_that_weigh_readings_by_error_rates_are_not_misled_by_the_share_of_ones() -> None:
    """False alarms alone exceed a boundary of 3 %."""
    asked = {"floor__source": "random:0.0", "decision__decision_boundary": 0.03}
    assert at(**asked, strategy__name="none").verdict == "wrong side"
    knowing = at(**asked, strategy__name="places")
    assert (knowing.verdict, knowing.is_warning) == ("not assessed", False)
    wrong = {"decision__assumed_false_positive": 0.05, "decision__assumed_false_negative": 0.6}
    assumed = at(strategy__name="places", floor__source="random:0.4", decision__boundary_of="tiles", **wrong)
    assert assumed.is_warning, "they weigh by rates that the sensor does not have"


def test_on_the_boundary_neither_is_right() -> None:
    d = at(floor__source="random:0.48", decision__decision_boundary=0.48)
    assert (d.verdict, d.truth, d.margin, d.samples_needed) == ("on the boundary", None, None, None)


def test_off_the_tiles_robots_read_as_on_still_ones() -> None:
    assert tiled_share(Floor(np.ones((2, 2)), 0.2, 0.25, 0.8, 0.0).geometry, (1.0, 1.0)) == pytest.approx(
        0.2 * 0.5
    )
    d = at(floor__source="stripe:0.48", floor__tile_width_m=0.05, floor__tile_height_m=0.05)
    assert d.share == pytest.approx(0.25 * at().share + 0.75 * error_rates(PAPER.sensor)[0])
    assert d.share < 0.3


def test_samples_needed_by_brute_force() -> None:
    assert samples_needed(0.5, 0.5) is None
    for share, boundary in ((0.7, 0.5), (0.3, 0.5), (0.02, 0.03), (0.9, 0.5)):
        needed = samples_needed(share, boundary, 0.05)
        n = np.arange(1, 3 * needed + 20)
        ones = np.arange(0, n[-1] + 1)
        wrong = np.array(
            [
                stats.binom.pmf(ones[: k + 1], k, share)[
                    (ones[: k + 1] / k - boundary) * (1 if share > boundary else -1) <= 1e-12
                ].sum()
                for k in n
            ]
        )
        assert (wrong[needed - 1 :] <= 0.05).all()
        assert needed == 1 or wrong[needed - 2] > 0.05
    near, nearer = samples_needed(0.501, 0.5), samples_needed(0.5001, 0.5)
    assert near == pytest.approx((stats.norm.isf(0.05) * 0.5 / 0.001) ** 2, rel=0.01)
    assert nearer > 90 * near
