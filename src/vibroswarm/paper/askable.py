"""Whether a column can ask what a claim asks: by the side that its floors lean to, and by its edges.

Decisions, and times until them, speak of the question only where the readings lean to the side of the truth
(``analysis.decidability``). Edges that were fitted on tiles of one size say little of smaller ones, of which they take
a larger part: nothing recorded shows that vibration reaches as far there. Judged without a negative control: what a
control makes of a column is its effect, not a reason not to ask.
"""

from __future__ import annotations

from functools import cache
from typing import Final

from vibroswarm.analysis.decidability import decidability, decidability_of_share
from vibroswarm.floors.floor import Floor
from vibroswarm.floors.source import is_random
from vibroswarm.observation.boundary import expected_ones
from vibroswarm.paper.real_floor import real_floor
from vibroswarm.presets import preset
from vibroswarm.scenario import Scenario

FITTED_ON: Final = "calibrated"
"""The preset whose edges were fitted, on the real floor."""


@cache
def cannot_ask(scenario: Scenario) -> str | None:
    """Why a swarm's decisions cannot answer in this scenario; None where they can."""
    return _edges(scenario) or _side(scenario)


def _side(scenario: Scenario) -> str | None:
    found = decidability(scenario)
    if is_random(scenario.floor.source) and scenario.sensor.edge_reach_m is not None:
        # Random floors of one fill ratio differ in how far vibration reaches across their edges.
        share = expected_ones(scenario, found.fill_ratio or 0.0)
        found = decidability_of_share(share, found.tested, found.truth)
    return (
        None
        if found.verdict == "decidable"
        else f"{found.verdict}: {found.share:.1%} of the readings are ones"
    )


def _edges(scenario: Scenario) -> str | None:
    reach_m = scenario.sensor.edge_reach_m
    if not reach_m:
        return None
    here, there = _side_m(scenario.floor_for(0, 0)), _fitted_m()
    if here >= there * (1.0 - 1e-9):
        return None
    return (
        f"edges reach {1000 * reach_m:.0f} mm and were fitted on tiles of {1000 * there:.0f} mm; these have "
        f"{1000 * here:.0f} mm"
    )


@cache
def _fitted_m() -> float:
    return _side_m(preset(FITTED_ON).with_values(real_floor()).floor_for(0, 0))


def _side_m(floor: Floor) -> float:
    """The shorter side of a tile, m."""
    _, _, width_m, height_m, *_ = floor.geometry
    return float(min(width_m, height_m))
