"""Parts of the models that all kinds of robot share: walls, and what rays see of a robot."""

from __future__ import annotations

from typing import Final

from vibroswarm.scenario.scenario import Scenario

BODIES, WALLS, TARGETS = 0, 1, 2
"""Groups of geoms. Rays see walls and targets, the discs that rays see of other robots, and nothing else."""
TARGET_HALF_HEIGHT_M: Final = 0.02


def walls_xml(scenario: Scenario) -> str:
    """Return the four walls, as planes that face inwards."""
    arena = scenario.arena
    walls = (
        ("0 0 0", "1 0 0"),
        (f"{arena.width_m!r} 0 0", "-1 0 0"),
        ("0 0 0", "0 1 0"),
        (f"0 {arena.height_m!r} 0", "0 -1 0"),
    )
    return "".join(
        f'<geom name="wall{k}" type="plane" size="0 0 1" pos="{place}" zaxis="{inwards}" group="{WALLS}"/>'
        for k, (place, inwards) in enumerate(walls)
    )


def target_xml(scenario: Scenario) -> str:
    """Return the disc that rays see of a robot; it touches nothing."""
    disc_m = scenario.rays.disc_radius_m
    if disc_m <= 0.0:
        return ""
    size = f"{disc_m!r} {TARGET_HALF_HEIGHT_M!r}"
    return f'<geom type="cylinder" size="{size}" group="{TARGETS}" contype="0" conaffinity="0" mass="0"/>'
