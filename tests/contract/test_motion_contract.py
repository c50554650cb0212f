"""Each source of Motion keeps the contract, and the suite rejects engines that do not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import helpers.walk_checks as suite
import vibroswarm.testing.motion as checks
from helpers.walk_checks import CASES, CHECKS, FOUR_RAYS, OF_THREE_RAYS, Check, check_in, motion_of
from vibroswarm.motion.event.event_run import EVENT
from vibroswarm.motion.fixed_step import FIXED_STEP
from vibroswarm.motion.motion_tables import Sink
from vibroswarm.motion.source import Source
from vibroswarm.robot.walk import TIMERS
from vibroswarm.scenario.scenario import Scenario

SOURCES = (FIXED_STEP, EVENT)
"""Every engine that is a source goes here."""
GOOD = FIXED_STEP


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("engine", SOURCES, ids=lambda engine: engine.name)
def test_source_keeps_the_contract(engine: Source, check: Check) -> None:
    check_in(OF_THREE_RAYS, check, engine)


@pytest.mark.slow
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("engine", SOURCES, ids=lambda engine: engine.name)
def test_source_keeps_the_contract_with_four_rays(engine: Source, check: Check) -> None:
    """Slow, as both engines are compiled for four rays."""
    check_in((CASES[0], FOUR_RAYS), check, engine)


@pytest.mark.slow
def test_the_cases_hold_what_they_should() -> None:
    """Every kind of segment, blocked moves, interrupted avoidances: else a check might look at nothing."""
    kinds, blocked = set(), 0
    for case in CASES:
        moves = motion_of(GOOD, case).moves
        assert moves is not None
        kinds |= set(moves["kind"].unique())
        blocked += moves.filter(kind="drive", speed_m_s=0.0).height
    assert kinds == {"drive", "turn", "avoid", "stop"}
    assert blocked > 20
    assert {case.scenario.sample.timer for case in CASES} == set(TIMERS)


# Broken engines: the real one, with one thing spoilt.

Rows = NDArray[np.void]
Spoil = Callable[[Rows], Rows]
Twist = Callable[[Scenario], Scenario]


def as_it_is(rows: Rows) -> Rows:
    return rows


@dataclass
class Spoilt:
    """A broken engine."""

    state: Any
    samples: Spoil
    moves: Spoil
    ends: Spoil

    def __getattr__(self, name: str) -> Any:
        return getattr(self.state, name)

    def through(self, sink: Sink) -> Sink:
        return Sink(
            lambda rows: sink.samples(self.samples(rows.copy())),
            lambda rows: sink.moves(self.moves(rows.copy())),
        )

    def advance(self, until: int, sink: Sink) -> None:
        self.state.advance(until, self.through(sink))

    def finish(self, sink: Sink) -> Rows:
        return self.ends(self.state.finish(self.through(sink)))


def broken(
    name: str,
    samples: Spoil = as_it_is,
    moves: Spoil = as_it_is,
    ends: Spoil = as_it_is,
    twist: Twist = lambda s: s,
) -> Source:
    """The real engine under another scenario, or with its rows spoilt."""
    return Source(
        name, lambda scenario, wanted: Spoilt(GOOD.start(twist(scenario), wanted), samples, moves, ends)
    )


def changed(**values: Any) -> Twist:
    return lambda scenario: scenario.with_values({k.replace("__", "."): v for k, v in values.items()})


def plus(field: str, shift: float) -> Spoil:
    """Rows with more in a field."""

    def spoil(rows: Rows) -> Rows:
        rows[field] += np.asarray(shift).astype(rows[field].dtype)
        return rows

    return spoil


def swayed_by_the_strategy(scenario: Scenario) -> Scenario:
    return scenario.with_values({"walk.leg_min_ms": 900.0}) if scenario.strategy.name == "soft" else scenario


def paced_by_the_end(scenario: Scenario) -> Scenario:
    """Drives the slower the longer the run is."""
    share = 50.0 / (50.0 + scenario.run.t_end_s)
    return scenario.with_values({"robot.speed_factor_location": share * scenario.robot.speed_factor_location})


def late_eyes(scenario: Scenario) -> Scenario:
    """Sees a thing about one period later than it should: half a millimetre nearer."""
    return scenario.with_values({"walk.avoidance_threshold_mm": scenario.walk.avoidance_threshold_mm - 0.5})


def keen_eyes(scenario: Scenario) -> Scenario:
    return scenario.with_values({"walk.avoidance_threshold_mm": scenario.walk.avoidance_threshold_mm + 0.5})


def slim(scenario: Scenario) -> Scenario:
    return scenario.with_values({"robot.body_radius_m": 0.0145})


def without_a_move(rows: Rows) -> Rows:
    return np.delete(rows, min(9, rows.size - 1))


def without_some_samples(rows: Rows) -> Rows:
    return rows[rows["sample"] != 3]


def restless(rows: Rows) -> Rows:
    """Ends that know of no stop."""
    rows["stop_tick"] = -1
    return rows


def turned_less(rows: Rows) -> Rows:
    rows["turned_rad"] *= 1 - 1e-4
    return rows


def crossed_eyes(scenario: Scenario) -> Scenario:
    return scenario.with_values({"rays.angle_deg": [-angle for angle in scenario.rays.angle_deg]})


def hasty_stops(scenario: Scenario) -> Scenario:
    return scenario.with_values({"sample.stop_ms": scenario.sample.stop_ms - scenario.run.control_period_ms})


RACING = changed(robot__speed_factor_max=1.6, robot__speed_factor_location=1.2)

BROKEN: list[tuple[Source, Check]] = [
    (broken("bodies overlap", twist=slim), checks.check_bodies),
    (broken("rays see late", twist=late_eyes), suite.check_rays),
    (broken("rays see early", twist=keen_eyes), suite.check_rays),
    (broken("eyes crossed", twist=crossed_eyes), suite.check_rays),
    (broken("swayed by the strategy", twist=swayed_by_the_strategy), checks.check_nothing_foreign_matters),
    (broken("paced by the end", twist=paced_by_the_end), checks.check_beginnings),
    (broken("hasty stops", twist=hasty_stops), suite.check_stops),
    (broken("races", twist=RACING), suite.check_speeds),
    (broken("lost time", samples=plus("drive", 1)), checks.check_accounts_add_up),
    (broken("a move lacks", moves=without_a_move), checks.check_moves_lead_to_the_next),
    (broken("a move lacks too", moves=without_a_move), checks.check_moves_account_for_time),
    (broken("turned less", moves=turned_less), checks.check_moves_lead_to_the_next),
    (broken("rays by the way", moves=plus("ray_m", 1e-5)), suite.check_rays_of_avoidances),
    (broken("misplaced samples", samples=plus("x_m", 1e-5)), checks.check_poses_at_samples),
    (broken("turned round", samples=plus("heading_rad", 7.0)), checks.check_places),
    (broken("lost samples", samples=without_some_samples), checks.check_sample_numbers),
    (broken("no stop at the end", ends=restless), checks.check_ends),
]


@pytest.mark.parametrize(("engine", "check"), BROKEN, ids=[engine.name for engine, _ in BROKEN])
def test_the_suite_rejects_a_broken_engine(engine: Source, check: Check) -> None:
    with pytest.raises(AssertionError):
        check_in(OF_THREE_RAYS, check, engine)
