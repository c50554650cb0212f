"""Probable mistakes in a scenario, as sentences: what is allowed, and hardly meant."""

from __future__ import annotations

from vibroswarm import strategies
from vibroswarm.analysis.claimed_rates import claims_warnings
from vibroswarm.motion.robot_params import scenario_warnings
from vibroswarm.observation.edge_response import edge_warnings
from vibroswarm.observation.energy_model import sensor_warnings
from vibroswarm.scenario.change_fields import change_warnings
from vibroswarm.scenario.fault_fields import fault_warnings
from vibroswarm.scenario.scenario import Scenario


def warnings_of(scenario: Scenario) -> list[str]:
    """Return the warnings about a scenario, without a full stop."""
    return [
        *scenario_warnings(scenario),
        *fault_warnings(scenario.faults, scenario.swarm.robots),
        *edge_warnings(scenario),
        *change_warnings(scenario.change, scenario.run.t_end_s, _is_final(scenario)),
        *sensor_warnings(scenario.sensor),
        *claims_warnings(scenario),
    ]


def _is_final(scenario: Scenario) -> bool:
    """Return whether robots keep their decisions; False for a strategy whose code is not loaded."""
    known = strategies.known().get(scenario.strategy.name)
    if known is None or known.decides == "opinion" or scenario.task.name == "changed":
        return False
    return not (known.revises and scenario.decision.revise)
