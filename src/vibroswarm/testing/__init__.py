"""Checks of users' code, as functions that a test can call; ``vibroswarm check`` runs them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from vibroswarm.testing.inference import check_network, check_strategy
from vibroswarm.testing.motion import check_motion
from vibroswarm.testing.runs import Finding
from vibroswarm.testing.tiles import check_sensor, check_task

CHECKS: Final[Mapping[str, Callable[[str], list[Finding]]]] = {
    "strategy": check_strategy,
    "network": check_network,
    "task": check_task,
    "sensor": check_sensor,
    "motion": check_motion,
}
"""The check of each kind."""

__all__ = [
    "CHECKS",
    "Finding",
    "check_motion",
    "check_network",
    "check_sensor",
    "check_strategy",
    "check_task",
]
