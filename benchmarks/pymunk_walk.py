"""The walk in pymunk, a rigid-body engine in C with a Python interface: a peer for ``stage_timing``.

The same robot program (``robot.walk``), in plain Python, drives discs between four walls in steps of the control
period; each look is three segment queries. Where the work differs it is less than the engines': rays see bodies (one
shape per robot, not two), speed factor and battery are 1, nothing is recorded.
"""

from __future__ import annotations

import math
import random
from typing import Any

from vibroswarm.motion.robot_params import walk_program
from vibroswarm.robot.walk import Dice, WalkState, begin_walk, looks, walk_step, wheel_commands_percent
from vibroswarm.scenario.scenario import Scenario

INSTALL = "pip install pymunk"


def pymunk_version() -> str | None:
    """The version of pymunk, or None where it is not installed."""
    try:
        import pymunk
    except ImportError:
        return None
    return str(pymunk.version)


def plain(function: Any) -> Any:
    """A kernel's Python function, which Python calls faster than the compiled one."""
    return getattr(function, "py_func", function)


class PymunkRobot:
    """A disc and its program."""

    def __init__(self, scenario: Scenario, body: Any, shape_filter: Any, chance: random.Random) -> None:
        robot, rays, walk = scenario.robot, scenario.rays, scenario.walk
        self.body, self.filter, self.chance = body, shape_filter, chance
        self.program, self.tick_s = walk_program(scenario), scenario.tick_s
        self.full_m_s, self.forward_m = robot.full_speed_m_s, rays.forward_m
        self.drive_track_m, self.turn_track_m = robot.drive_track_m, robot.turn_track_m
        self.bend = chance.uniform(robot.misalignment_min, robot.misalignment_max)
        self.look_m = min(rays.range_m, walk.avoidance_threshold_mm / 1000.0)
        self.rays = [
            (side, math.radians(angle)) for side, angle in zip(rays.side_m, rays.angle_deg, strict=True)
        ]
        self.gyro_deg, self.samples, self.dice = 0.0, 0, self.roll()
        self.state: WalkState = plain(begin_walk)(self.program, self.dice)

    def roll(self) -> Dice:
        """Three uniform numbers."""
        return Dice(self.chance.random(), self.chance.random(), self.chance.random())

    def nearest_mm(self, space: Any) -> float:
        """Length of the shortest ray, mm; infinite if none is shorter than theta_c."""
        (x_m, y_m), heading = self.body.position, self.body.angle
        ahead_x, ahead_y = math.cos(heading), math.sin(heading)
        nearest = math.inf
        for side_m, angle_rad in self.rays:
            from_x = x_m + self.forward_m * ahead_x - side_m * ahead_y
            from_y = y_m + self.forward_m * ahead_y + side_m * ahead_x
            to_x = from_x + self.look_m * math.cos(heading + angle_rad)
            to_y = from_y + self.look_m * math.sin(heading + angle_rad)
            hit = space.segment_query_first((from_x, from_y), (to_x, to_y), 0.0, self.filter)
            if hit is not None:
                nearest = min(nearest, 1000.0 * self.look_m * hit.alpha)
        return nearest

    def step(self, space: Any) -> None:
        """Sense and control: set the velocities until the next tick."""
        before, nearest_mm = self.state, math.inf
        if plain(looks)(before, self.program, self.gyro_deg):
            nearest_mm = self.nearest_mm(space)
        state = self.state = plain(walk_step)(before, self.program, self.gyro_deg, nearest_mm, self.dice)
        if state.legs != before.legs or state.avoidances != before.avoidances:
            self.dice = self.roll()
        left, right = plain(wheel_commands_percent)(state, self.program)
        left_m_s = 0.01 * left * self.full_m_s * (1.0 - self.bend)
        right_m_s = 0.01 * right * self.full_m_s * (1.0 + self.bend)
        speed_m_s = 0.5 * (left_m_s + right_m_s)
        rate_rad_s = (right_m_s - left_m_s) / (self.drive_track_m if state.mode == 0 else self.turn_track_m)
        self.gyro_deg = math.degrees(rate_rad_s * self.tick_s)
        heading = self.body.angle
        self.body.velocity = (speed_m_s * math.cos(heading), speed_m_s * math.sin(heading))
        self.body.angular_velocity = rate_rad_s
        self.samples += state.sampled


def pymunk_walk(scenario: Scenario, seed: int, simulated_s: float) -> int:
    """Simulate a walk; returns the number of samples.

    Args:
        seed: of Python's generator, whose numbers differ from those of the engines.
    """
    import pymunk

    chance = random.Random(seed)
    space = pymunk.Space()
    add_walls(space, scenario.arena.width_m, scenario.arena.height_m)
    robots = [
        add_robot(space, scenario, i, place, chance) for i, place in enumerate(places(scenario, chance))
    ]
    for _ in range(round(simulated_s / scenario.tick_s)):
        for robot in robots:
            robot.step(space)
        space.step(scenario.tick_s)
    return sum(robot.samples for robot in robots)


def add_walls(space: Any, width_m: float, height_m: float) -> None:
    """Add four walls."""
    import pymunk

    corners = [(0.0, 0.0), (width_m, 0.0), (width_m, height_m), (0.0, height_m)]
    for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
        space.add(pymunk.Segment(space.static_body, start, end, 0.0))


def places(scenario: Scenario, chance: random.Random) -> list[tuple[float, float]]:
    """Start positions, m: random cells of a grid, so that no robots overlap."""
    columns = math.ceil(math.sqrt(scenario.swarm.robots))
    cells = chance.sample(range(columns * columns), scenario.swarm.robots)
    pitch_x, pitch_y = scenario.arena.width_m / columns, scenario.arena.height_m / columns
    return [((cell % columns + 0.5) * pitch_x, (cell // columns + 0.5) * pitch_y) for cell in cells]


def add_robot(
    space: Any, scenario: Scenario, i: int, place: tuple[float, float], chance: random.Random
) -> PymunkRobot:
    """Add a disc that collides with others and is invisible to its own rays."""
    import pymunk

    radius_m = scenario.robot.body_radius_m
    body = pymunk.Body(1.0, pymunk.moment_for_circle(1.0, 0.0, radius_m))
    body.position, body.angle = place, chance.uniform(-math.pi, math.pi)
    shape = pymunk.Circle(body, radius_m)
    shape.filter = pymunk.ShapeFilter(group=i + 1)
    space.add(body, shape)
    return PymunkRobot(scenario, body, shape.filter, chance)
