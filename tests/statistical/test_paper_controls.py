"""Negative controls: claims that are reproduced as the simulations ran are not with what the paper prints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from scipy.stats import gamma

from vibroswarm.observation.energy_model import error_rates
from vibroswarm.paper import item
from vibroswarm.paper.claim_values import frame
from vibroswarm.paper.claims import Decided, decide
from vibroswarm.paper.columns import COLUMNS, OPTIMISED
from vibroswarm.paper.item import Settings
from vibroswarm.paper.items import items_named
from vibroswarm.paper.items.calibration import error_rows
from vibroswarm.paper.reproduce import reproduce
from vibroswarm.scenario.scenario import Scenario

RUNS = 300
MOTION_RUNS = 150
"""For what hangs on motion and messages, which is told by fewer runs."""
FALSE = (0.24, 0.045)
"""False positive and false negative rate under the control "false-positives"; both are 14 % in the simulations."""
SLOWER = 0.05
"""Factor of the robots' speed under the control "standstill"."""


def standing(scenario: Scenario) -> dict[str, Any]:
    """Fields of robots that hardly move and never avoid; tracks shrink as the speed does, so they turn as fast."""
    slowed = ("full_speed_m_s", "drive_track_m", "turn_track_m")
    return {f"robot.{name}": getattr(scenario.robot, name) * SLOWER for name in slowed} | {
        "walk.avoidance_threshold_mm": 0.0
    }


def with_errors(scenario: Scenario) -> dict[str, Any]:
    """Fields that give the sensor the error rates ``FALSE``: energies are shifted, their shapes and scales stay."""
    sensor, changes = scenario.sensor, {}
    false_positive, false_negative = FALSE
    for kind, share_above in (("still", false_positive), ("vibrating", 1.0 - false_negative)):
        shape, scale = (float(getattr(sensor, f"{kind}_{name}")) for name in ("shape", "scale"))
        exceeded = float(gamma.isf(share_above, shape, scale=scale))
        changes[f"sensor.{kind}_location"] = sensor.rms_threshold - exceeded
    return changes


def swapped_labels(scenario: Scenario) -> dict[str, Any]:
    """Fields that swap the energy distributions of vibrating and still tiles, as the paper prints them."""
    return {
        f"sensor.{kind}_{name}": getattr(scenario.sensor, f"{other}_{name}")
        for kind, other in (("vibrating", "still"), ("still", "vibrating"))
        for name in ("shape", "scale", "location")
    }


CONTROLS: dict[str, Callable[[Scenario], dict[str, Any]]] = {
    "labels": swapped_labels,
    "threshold": lambda scenario: {"sensor.rms_threshold": 1.55},  # as in Algorithm 2
    "false-positives": with_errors,
    "standstill": standing,
    "no-messages": lambda scenario: {"network.name": "loss", "network.loss.share": 1.0},
    "losses": lambda scenario: {"network.name": "loss", "network.loss.share": 0.1},
}
"""Fields that a control changes in every scenario."""
MOTION = ("standstill", "no-messages")
SENSOR = ("labels", "threshold", "false-positives")
TURNED = {
    "labels": {
        # Swapped, the sensor of preset paper is its own mirror image, as its two errors are equal: what is true of the
        # fill ratio f comes out at 1 - f. Beliefs turn, times do not; where the errors are not equal, times turn too.
        ("fill-belief", "paper"),
        ("fill-belief", "calibrated"),
        ("fill-time", "calibrated"),
    },
    "threshold": {
        ("fill-time", "paper"),
        ("soft-gain-most-near-half", "paper"),
        ("grid-kappa-1-fast", "paper"),
    },
    "false-positives": {
        ("fill-time", "paper"),
        ("fill-belief", "paper"),
        ("grid-kappa-1-fast", "paper"),
    },
    "standstill": {("size-distance", "paper"), ("size-avoidance", "paper")},
    "no-messages": {("size-time", "paper"), ("size-soft", "paper")},
    "losses": {("soft-faster-than-positive", "paper")},
}
STAYING = {
    "labels": {("fill-time", "paper"), ("grid-kappa-1-fast", "paper")},
    "threshold": {("grid-approaches-none", "paper")},
    "standstill": {("size-time", "paper")},
    "no-messages": {("size-distance", "paper"), ("size-avoidance", "paper")},
    "losses": {("fill-time", "paper"), ("soft-faster-than-none", "paper")},
}
"""What a control must leave alone: it turns what the sensor decides, and does not fail everything."""

Found = dict[tuple[str, str], Decided]


@dataclass(frozen=True)
class Controlled(Settings):
    """A reproduction under a control; None: without."""

    control: str | None = None

    def scenario(
        self, column: str, values: dict[str, Any] | None = None, *, parameter_set: str = OPTIMISED
    ) -> Scenario:
        plain = super().scenario(column, values, parameter_set=parameter_set)
        return plain if self.control is None else plain.with_values(CONTROLS[self.control](plain))


def reproduced(settings: Controlled, folder: Path, *items: str) -> list[Decided]:
    """Verdicts on the claims of some items. Under a control all can be asked: its effect is what is to show."""
    with pytest.MonkeyPatch.context() as patch:
        if settings.control is not None:
            patch.setattr(item, "cannot_ask", lambda scenario: None)
        return reproduce(settings, folder, items_named(list(items))).decided


@pytest.fixture(scope="module")
def decided(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Found]:
    """The claims of two items and of the sensor's errors, plainly (None) or under a control; by claim and column.

    With ``motion`` those of the swarm's sizes.
    """

    @cache
    def made(control: str | None, motion: bool = False) -> Found:
        if motion:
            alone = Controlled(runs=MOTION_RUNS, columns=("paper",), control=control)
            there = tmp_path_factory.mktemp(f"motion-{control}")
            whole = reproduced(alone, there, "swarm-sizes")
            return {(one.claim.id, one.column): one for one in whole}
        columns = ("paper", "calibrated") if control in (None, "labels") else ("paper",)
        settings = Controlled(runs=RUNS, columns=columns, control=control)
        folder: Path = tmp_path_factory.mktemp(f"control-{control}")
        found = reproduced(settings, folder, "feedback-grid", "fill-ratios")
        found += decide(frame(error_rows(settings, "paper")))
        return {(one.claim.id, one.column): one for one in found}

    return made


# One test for all controls of motion, and one for all others: what they are compared with, runs without a control, is
# then computed once, and not by each of the processes that pass tests.
@pytest.mark.long
@pytest.mark.parametrize(
    "controls",
    [MOTION, tuple(one for one in CONTROLS if one not in MOTION)],
    ids=["motion", "sensor and losses"],
)
def test_a_control_turns_what_hangs_on_it_and_nothing_else(
    controls: tuple[str, ...], decided: Callable[..., Found]
) -> None:
    for control in controls:
        turns_what_hangs_on_it_and_nothing_else(control, decided)


def turns_what_hangs_on_it_and_nothing_else(control: str, decided: Callable[..., Found]) -> None:
    plain, turned = decided(None, control in MOTION), decided(control, control in MOTION)
    for key in TURNED[control]:
        assert plain[key].verdict == "reproduced", key
        # Where differences are 0 or near to the limit some values are open; none holds any longer.
        assert turned[key].verdict in ("not reproduced", "inconclusive"), key
        assert "holds" not in turned[key].cells["holds"].to_list(), key
        assert control not in SENSOR[:2] or turned[key].verdict == "not reproduced", key
    for key in STAYING.get(control, set()):
        assert plain[key].verdict == turned[key].verdict == "reproduced", key
    # Under false positives whoever decides is wrong, so that nearly every claim turns; this one is open, and fails not.
    if control == "false-positives":
        assert turned["grid-approaches-none", "paper"].verdict != "not reproduced"
    if control in SENSOR:
        error_rates_are_inconclusive_and_fail(plain, turned)
    if control == "labels":
        belief_in_the_truth_rises_where_it_should_fall(turned)
    for one in (*plain.values(), *turned.values()):  # no question that cannot be asked
        assert one.cells["why"].null_count() == one.cells.height, one.claim.id


def error_rates_are_inconclusive_and_fail(plain: Found, turned: Found) -> None:
    """The printed 13 % come of three sessions: too few for a margin of 2 points, and enough to see another sensor."""
    assert plain["calibration-errors", "paper"].verdict == "inconclusive"
    assert turned["calibration-errors", "paper"].verdict == "not reproduced"


def belief_in_the_truth_rises_where_it_should_fall(swapped: Found) -> None:
    """Not that values are unsure: they lie on the other side, and wholly where the sensor is its own mirror image."""
    cells = swapped["fill-belief", "paper"].cells
    assert cells["holds"].to_list() == ["fails"] * 6
    assert (cells["low"] > 0).all()
    assert (swapped["fill-belief", "calibrated"].cells["estimate"] > 0).all()
    labels = swapped["calibration-errors", "paper"].cells
    assert (labels["estimate"] > 0.37).all()  # more than half of the readings are wrong


def test_what_the_controls_change() -> None:
    for column in COLUMNS[:2]:
        false = Controlled(control="false-positives").scenario(column)
        assert error_rates(false.sensor) == pytest.approx(FALSE, abs=1e-9)
    free = Controlled().scenario("paper")
    false, still = (Controlled(control=name).scenario("paper") for name in ("false-positives", "standstill"))
    assert sum(error_rates(false.sensor)) == pytest.approx(sum(error_rates(free.sensor)), abs=1e-3)
    turning = [one.robot.full_speed_m_s / one.robot.turn_track_m for one in (free, still)]
    assert turning[0] == pytest.approx(turning[1])
    assert still.robot.full_speed_m_s == pytest.approx(SLOWER * free.robot.full_speed_m_s)
    lossy = {"network.name": "loss", "network.loss.share": 0.1}
    assert Controlled(control="no-messages").scenario("paper", lossy).network.params.share == 1.0
