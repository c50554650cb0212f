"""Say where the edges of preset `calibrated` are used on smaller tiles than those to which they were fitted."""

from __future__ import annotations

from functools import cache
from typing import Final

from vibroswarm.scenario.fields import FloorField, Sensor
from vibroswarm.scenario.scenario import Scenario, preset

FITTED_ON_M: Final = 0.2
"""Side of the tiles of the recordings."""


def edge_warnings(scenario: Scenario) -> list[str]:
    """Return a warning if the scenario has the fitted edges on tiles smaller than ``FITTED_ON_M``."""
    if not _has_fitted_edges(scenario.sensor):
        return []
    side_m = shorter_side_m(scenario.floor, scenario.arena.width_m, scenario.arena.height_m)
    if side_m >= FITTED_ON_M * (1.0 - 1e-9):
        return []
    reach_mm = 1000.0 * (scenario.sensor.edge_reach_m or 0.0)
    return [
        f"vibration reaches {reach_mm:.0f} mm beyond edges, as fitted on tiles of {1000 * FITTED_ON_M:.0f} mm; on "
        f"these of {1000 * side_m:.3g} mm that is an extrapolation"
    ]


def shorter_side_m(floor: FloorField, width_m: float, height_m: float) -> float:
    """Return the shorter side of a tile, m, in an arena of this size."""
    tiles, _ = floor.tiles_for(0, 0)
    rows, columns = tiles.shape
    return min(floor.tile_width_m or width_m / columns, floor.tile_height_m or height_m / rows)


@cache
def _has_fitted_edges(sensor: Sensor) -> bool:
    fitted = preset("calibrated").sensor
    return (sensor.edge_reach_m, sensor.edge_blur_m) == (fitted.edge_reach_m, fitted.edge_blur_m)
