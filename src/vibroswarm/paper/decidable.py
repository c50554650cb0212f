"""Whether the paper's question can be asked in a scenario.

The expected share of ones must lie on the same side of the boundary as the fill ratio; and an edge response fitted on
tiles of one size is not known on smaller ones.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from vibroswarm.core.numbers import number, percent
from vibroswarm.floors import is_random
from vibroswarm.floors.floor import Floor
from vibroswarm.observation.decision_boundary import expected_ones
from vibroswarm.paper.columns import real_floor
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.statistics.decidability import decidability, decidability_of_share

_reasons: dict[Any, str] = {}


def cannot_ask(scenario: Scenario) -> str:
    """Return why decisions in this scenario cannot answer the question; empty if they can."""
    key = scenario.arena, scenario.floor, scenario.change, scenario.sensor, scenario.task, scenario.decision
    if key not in _reasons:
        _reasons[key] = _edges(scenario) or _side(scenario)
    return _reasons[key]


def _side(scenario: Scenario) -> str:
    verdict = decidability(scenario)
    if is_random(scenario.floor.source) and scenario.sensor.edge_reach_m is not None:
        # Random floors of one fill ratio differ in the length of their edges: here the mean over floors counts.
        share = expected_ones(scenario, verdict.fill_ratio or 0.0)
        verdict = decidability_of_share(share, verdict.tested, verdict.truth)
    is_right = verdict.verdict == "decidable"
    return "" if is_right else f"{verdict.verdict}: {percent(verdict.share)} of the readings are ones"


def _edges(scenario: Scenario) -> str:
    reach_m = scenario.sensor.edge_reach_m
    if not reach_m:
        return ""
    side_m, fitted_m = _side_m(scenario.floor_for(seed=0, run=0)), _fitted_m()
    if side_m >= fitted_m * (1.0 - 1e-9):  # rounding errors
        return ""
    fitted, own = number(1000 * fitted_m, 0), number(1000 * side_m, 0)
    return f"edges of {number(1000 * reach_m, 0)} mm were fitted on tiles of {fitted} mm; these have {own} mm"


@cache
def _fitted_m() -> float:
    return _side_m(preset("calibrated").with_values(real_floor()).floor_for(0, 0))


def _side_m(floor: Floor) -> float:
    _, _, width_m, height_m, *_ = floor.geometry
    return float(min(width_m, height_m))
