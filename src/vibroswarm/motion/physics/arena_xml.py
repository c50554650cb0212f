"""Parts of MuJoCo's models (in MJCF, its XML format) besides the robots: walls, and targets of rays."""

from __future__ import annotations

from typing import Final

from vibroswarm.scenario.scenario import Scenario

BODIES, WALLS, TARGETS = 0, 1, 2
"""Groups of MuJoCo's geoms (shapes). Rays see only walls and targets; a target is the disc that rays see of a robot."""
TARGET_HALF_HEIGHT_M: Final = 0.02
"""Half of the height of the discs that rays see."""


def walls_xml(scenario: Scenario) -> str:
    """Return the geoms of the four walls: planes that face inwards, named wall0 to wall3."""
    arena = scenario.arena
    # In ``size`` below, the two zeros make a plane infinite; 1 is the spacing of its grid in pictures.
    walls = (  # a point of each wall, and its normal, which points into the arena
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
    """Return the geom that rays see of a robot: a disc without mass that touches nothing.

    Empty if the disc's radius is 0: rays then do not see robots.
    """
    disc_m = scenario.rays.disc_radius_m
    if disc_m <= 0.0:
        return ""
    size = f"{disc_m!r} {TARGET_HALF_HEIGHT_M!r}"
    return f'<geom type="cylinder" size="{size}" group="{TARGETS}" contype="0" conaffinity="0" mass="0"/>'
