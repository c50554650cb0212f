"""What a scenario says of the sensing in a stop, as ``robot.sense`` runs it."""

from __future__ import annotations

from vibroswarm.robot.sense import SenseProgram
from vibroswarm.scenario import Scenario

USUAL_MS = 500.0


def sense_program(scenario: Scenario) -> SenseProgram:
    """The robot stands for the stop less the signal, then reads for the signal; filter and rate are the robots'."""
    stop_ms = scenario.sample.stop_ms
    signal_ms = scenario.sample.signal_ms or min(USUAL_MS, 0.5 * stop_ms)
    return SenseProgram(settle_ms=stop_ms - signal_ms, signal_ms=signal_ms)
