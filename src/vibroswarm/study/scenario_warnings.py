"""Probable mistakes in a scenario, as sentences: what is allowed, and hardly meant."""

from __future__ import annotations

from vibroswarm import strategies, tasks
from vibroswarm.analysis.robot_knowledge import claims_warnings
from vibroswarm.floors.floor import sides_inside
from vibroswarm.motion.robot_params import scenario_warnings
from vibroswarm.observation.edge_response import edge_warnings
from vibroswarm.observation.energy_model import sensor_warnings
from vibroswarm.scenario.change_fields import change_warnings
from vibroswarm.scenario.fault_fields import fault_warnings
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies.place_map import WITH_MAP


def warnings_of(scenario: Scenario) -> list[str]:
    """Return the warnings about a scenario, without a full stop."""
    return [
        *scenario_warnings(scenario),
        *fault_warnings(scenario.faults, scenario.swarm.robots, scenario.run.t_end_s),
        *_relay_warnings(scenario),
        *_map_warnings(scenario),
        *edge_warnings(scenario),
        *change_warnings(scenario.change, scenario.run.t_end_s, _is_final(scenario)),
        *_anew_warnings(scenario),
        *sensor_warnings(scenario.sensor),
        *claims_warnings(scenario),
    ]


def _anew_warnings(scenario: Scenario) -> list[str]:
    """Return a warning if robots withdraw their answers, and the task, whose code is loaded, does not ask again."""
    task = tasks.known().get(scenario.task.name)
    withdraws = getattr(scenario.strategy.params, "tells_anew", False)
    if not withdraws or task is None or task.is_asked_anew(scenario.task.params):
        return []
    return [
        "robots withdraw each answer but are asked only once; set task.changed.since = answer, or "
        "strategy.reset.tells_anew = false"
    ]


def _relay_warnings(scenario: Scenario) -> list[str]:
    """Return a warning if robots fail that relay messages, which the network does not know."""
    failing = [kind for kind in ("radio_dead", "battery_empty") if kind in scenario.faults.kinds]
    if scenario.network.name != "tree" or not failing:
        return []
    return [
        f"network tree: robots with faults.{' and faults.'.join(failing)} go on relaying others' messages"
    ]


def _map_warnings(scenario: Scenario) -> list[str]:
    """Return a warning if robots map a grid of which a part lies outside the arena, where no robot samples."""
    if scenario.strategy.name not in WITH_MAP:
        return []
    floor = scenario.floor_for(0, 0)  # whose size is that of all runs
    if sides_inside(floor.geometry, *scenario.arena.size_m) is None:
        return []
    return [
        f"the floor extends beyond the arena: '{scenario.strategy.name}' counts all tiles of the grid alike, but the "
        "right answer is that of the part inside"
    ]


def _is_final(scenario: Scenario) -> bool:
    """Return whether robots keep their decisions; False for a strategy whose code is not loaded."""
    known = strategies.known().get(scenario.strategy.name)
    if known is None or known.decides == "opinion" or scenario.task.name == "changed":
        return False
    return not (known.revises and scenario.decision.revise)
