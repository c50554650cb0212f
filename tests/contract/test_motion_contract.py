"""Each source of Motion keeps the contract."""

from __future__ import annotations

import pytest

from helpers.walk_checks import (
    CASES,
    CHECKS,
    FOUR_RAYS,
    OF_THREE_RAYS,
    Check,
    check_in,
    motion_of,
)
from vibroswarm.motion.event.event_run import EVENT
from vibroswarm.motion.fixed_step import FIXED_STEP
from vibroswarm.motion.source import Source
from vibroswarm.robot.walk import TIMERS

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
