"""Bounds that let a robot sleep are never later than what stepping through every control period finds.

A bound says: nothing happens before this tick. Each test has its negative control: with the bound made one tick later,
the same cases must contain one in which something happens before it. Other bounds are held by the equality of the two
engines. All of this runs as plain Python (what only kernels call is not compiled when Python calls it), on robots drawn
with fixed seeds.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vibroswarm.motion.event.event_queue import NEVER
from vibroswarm.motion.event.lookahead import (
    blocked_ticks,
    distance2_m2,
    encounter_reach_m,
    maybe_within,
    set_chord,
    set_standing,
    wall_tick,
)
from vibroswarm.motion.event.neighbours import (
    LIST_TICKS,
    PLACES,
    list_radius_m,
    measure_all,
    measure_meetings,
    store_plan,
)
from vibroswarm.motion.event.pair_lookahead import (
    chord_clear_ticks,
    encounter_tick,
    may_encounter,
    stops_before,
)
from vibroswarm.motion.event.trajectory import (
    PLANNER,
    begin_plan,
    block,
    due_ticks,
    plan_stop,
    ticks_to_sample,
    ticks_to_self_event,
)
from vibroswarm.motion.robot_params import setup_of
from vibroswarm.robot.walk import AVOID, DRIVE, STOP, TURN
from vibroswarm.scenario.scenario import Scenario

Row = Any
Ticks = NDArray[np.int64]
HORIZON = 120
ROUNDING_M = 1e-10
"""What is nearer to happening than this may or may not happen, by rounding."""

SETTINGS: dict[str, dict[str, Any]] = {
    "paper": {},
    "one ray straight on": {"rays.side_m": [0.0], "rays.angle_deg": [0.0], "rays.forward_m": 0.0},
    "rays beyond walls": {"rays.forward_m": 0.06, "rays.side_m": [0.0, 0.01], "rays.angle_deg": [150.0, -120.0]},
    "long rays, fast": {"walk.avoidance_threshold_mm": 140.0, "robot.full_speed_m_s": 0.3},
    "much bent": {"robot.misalignment_min": -0.9, "robot.misalignment_max": 0.9},
    "blind after turns": {"walk.blind_after_turn_ms": 730.0},
    "bodies only": {"walk.avoidance_threshold_mm": 0.0},
    "timer always on": {"sample.timer": "always", "run.control_period_ms": 50},
    "turns of over a revolution in a tick": {
        "robot.turn_track_m": 0.006, "robot.drive_track_m": 0.008, "robot.full_speed_m_s": 0.05,
        "robot.misalignment_min": -0.7, "robot.misalignment_max": 0.7, "robot.body_radius_m": 0.045,
        "run.control_period_ms": 300,
    },
}  # fmt: skip


@cache
def setup_named(name: str) -> Row:
    """The setup of one of ``SETTINGS``, as a namespace, whose attributes are quick to read."""
    setup = setup_of(Scenario().with_values(SETTINGS[name]))
    return SimpleNamespace(**{field: setup[field] for field in setup.dtype.names})


@pytest.fixture(autouse=True)
def divide_as_kernels_do() -> Iterator[None]:
    """Compiled code divides by 0 without a word."""
    with np.errstate(divide="ignore", invalid="ignore"):
        yield


def robot(setup: Row, rng: np.random.Generator, mode: int, straight: bool = False) -> Row:
    """A robot that has just planned at tick 0, anywhere in the arena; ``straight``: at full speed, without a bend."""
    row = SimpleNamespace(**dict.fromkeys(PLANNER.names or (), 0))
    radius = setup.radius_m
    row.x_m = rng.uniform(radius, setup.width_m - radius)
    row.y_m = rng.uniform(radius, setup.height_m - radius)
    place(row, row.x_m, row.y_m, rng.uniform(-math.pi, math.pi))
    row.misalignment = 0.0 if straight else rng.uniform(setup.misalignment_min, setup.misalignment_max)
    row.speed_factor = setup.speed_factor_max if straight else rng.uniform(0.8, setup.speed_factor_max)
    row.battery = 1.0
    row.ray_forward_m = setup.ray_forward_m
    row.mode, row.resume = mode, DRIVE
    row.driven_ms, row.leg_ms = setup.tick_ms, float(rng.uniform(0.0, HORIZON * setup.tick_ms))
    row.timer_ms = setup.tick_ms * int(rng.integers(0, setup.sample_interval_ms / setup.tick_ms))
    row.sees_from_ms = setup.blind_ms if rng.random() < 0.5 else 0.0
    row.next_leg_ms = math.nan
    row.error_deg = float(rng.uniform(10.0, 180.0) * rng.choice([-1, 1])) if mode in (TURN, AVOID) else 0.0
    row.integral_deg_s = row.error_deg * setup.tick_s
    full = setup.full_speed_m_s * row.speed_factor
    if mode == DRIVE:
        row.speed_m_s, row.rate_rad_s = full, 2.0 * full * row.misalignment / setup.drive_track_m
    row.lookahead_tick = NEVER
    plan(row, setup)
    return row


def place(row: Row, x_m: float, y_m: float, heading_rad: float) -> None:
    row.x_m, row.y_m, row.heading_rad = x_m, y_m, heading_rad
    row.sin_h, row.cos_h = math.sin(heading_rad), math.cos(heading_rad)


def plan(row: Row, setup: Row, is_blocked: bool = False) -> None:
    """Plan from tick 0, as the engine does."""
    begin_plan(row, setup, 0)
    if is_blocked:
        block(row)
    ahead = ticks_to_self_event(row, setup, HORIZON)
    row.self_event_tick = row.plan_end_tick = ahead
    if row.mode == DRIVE and ahead == due_ticks(DRIVE, row.timer_ms, setup):
        row.plan_end_tick += ticks_to_sample(setup, 0) + 1
    row.end_x_m, row.end_y_m = row.x_m, row.y_m
    set_chord(row, setup)


def stop_of(row: Row) -> Row:
    """The second piece of a robot's plan."""
    piece = SimpleNamespace(**dict.fromkeys(PLANNER.names or (), 0))
    piece.mode = STOP
    plan_stop(piece, row)
    return piece


def poses(row: Row, setup: Row, last: int) -> NDArray[np.float64]:
    """x, y, heading at the ticks 0 to ``last`` of a plan, step by step; after its end the robot stands."""
    x, y, heading = row.x_m, row.y_m, row.heading_rad
    error, integral = row.error_deg, row.integral_deg_s
    found = [(x, y, heading)]
    for tick in range(last):
        if row.mode != STOP and tick < row.self_event_tick:
            speed, rate = row.speed_m_s, row.rate_rad_s
            if row.mode != DRIVE:
                command = min(max(setup.gain * error + setup.integral_gain * integral, -100.0), 100.0)
                turned = row.turn_gain * command
                error -= turned
                integral += error * setup.tick_s
                rate = math.radians(turned) / setup.tick_s
                speed = 0.0 if row.blocked else 0.5 * row.misalignment * setup.turn_track_m * rate
            half = 0.5 * rate * setup.tick_s
            chord = speed * setup.tick_s * (math.sin(half) / half if half else 1.0)
            x, y = x + chord * math.cos(heading + half), y + chord * math.sin(heading + half)
            heading += 2.0 * half
        found.append((x, y, heading))
    return np.array(found)


def rays(row: Row, setup: Row, poses: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Where each ray starts, and its direction, at each pose: x, y, dx, dy of shape (poses, rays)."""
    x, y, heading = poses[:, :1], poses[:, 1:2], poses[:, 2:]
    cos_h, sin_h = np.cos(heading), np.sin(heading)
    side, cos_a, sin_a = setup.ray_side_m, setup.ray_cos, setup.ray_sin
    return (
        x + row.ray_forward_m * cos_h - side * sin_h,
        y + row.ray_forward_m * sin_h + side * cos_h,
        cos_h * cos_a - sin_h * sin_a,
        sin_h * cos_a + cos_h * sin_a,
    )


def heeds(row: Row, setup: Row, ticks: Ticks) -> NDArray[np.bool_]:
    """Whether a robot heeds its rays at these ticks of its plan, by the clock of its leg."""
    driven_ms = row.driven_ms + (ticks - 1) * setup.tick_ms
    return np.full(ticks.shape, row.mode == DRIVE) & (driven_ms >= row.sees_from_ms)


def sees_wall(row: Row, setup: Row, way: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether a ray is shorter than ``look_m`` at each pose because of a wall."""
    x, y, dx, dy = rays(row, setup, way)
    end_x, end_y = x + setup.look_m * dx, y + setup.look_m * dy
    beyond = np.zeros(len(way), dtype=bool)
    for px, py in ((x, y), (end_x, end_y)):
        out = np.minimum(np.minimum(px, setup.width_m - px), np.minimum(py, setup.height_m - py))
        beyond |= (out < -ROUNDING_M).any(axis=1)
    return beyond


def sees_disc(
    row: Row, setup: Row, way: NDArray[np.float64], other: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether a ray of length ``look_m`` meets another robot's disc at each pose."""
    x, y, dx, dy = rays(row, setup, way)
    to_x, to_y = other[:, :1] - x, other[:, 1:2] - y
    along = np.clip(to_x * dx + to_y * dy, 0.0, setup.look_m)
    off = np.hypot(to_x - along * dx, to_y - along * dy)
    seen: NDArray[np.bool_] = (off < setup.disc_radius_m - ROUNDING_M).any(axis=1)
    return seen


def in_wall(setup: Row, way: NDArray[np.float64]) -> NDArray[np.bool_]:
    x, y = way[:, 0], way[:, 1]
    gap = np.minimum(np.minimum(x, setup.width_m - x), np.minimum(y, setup.height_m - y)) - setup.radius_m
    return gap < -ROUNDING_M


def first(happens: NDArray[np.bool_], ticks: Ticks) -> int:
    """The first of these ticks at which something happens, or NEVER."""
    return int(ticks[np.argmax(happens)]) if happens.any() else NEVER


Cases = Iterator[tuple[int, int]]
"""A bound, and what stepping finds in its place, of case after case."""


def too_late(cases: list[tuple[int, int]], late: int) -> int:
    """In how many cases something happens before the bound, made so many ticks later."""
    return sum(found < NEVER and found < bound + late for bound, found in cases)


def assert_bound(cases: Cases) -> None:
    """The bound holds in each case; made one tick late, it fails in some."""
    found = list(cases)
    assert len(found) >= 50, "too few cases to say anything"
    assert too_late(found, 0) == 0
    assert too_late(found, 1) > 0, "the test does not see a bound that is one tick late"


ALL = tuple(SETTINGS)


def near_wall(row: Row, setup: Row, rng: np.random.Generator) -> None:
    """Put a robot a little before a wall, facing about towards it, and plan again."""
    heading = float(rng.uniform(-0.6, 0.6))
    gap = setup.radius_m + float(rng.uniform(0.0, HORIZON / 2 * max(row.max_step_m, 1e-4)))
    place(row, max(setup.width_m - gap - setup.ray_reach_m, gap), rng.uniform(0.1, 0.9), heading)
    plan(row, setup)


def walls(mode: int, settings: tuple[str, ...], straight: bool = False) -> Cases:
    """``wall_tick`` of robots in a mode, and the first tick at which a wall is seen or stops a move."""
    rng = np.random.default_rng(1)
    for number in range(120):
        setup = setup_named(settings[number % len(settings)])
        row = robot(setup, rng, mode, straight)
        if mode == DRIVE:
            near_wall(row, setup, rng)
        else:  # its pivot is so near a wall that it may swing its body into it
            gap = setup.radius_m + float(rng.uniform(0.0, 0.5)) * abs(row.misalignment) * setup.turn_track_m
            place(row, gap, rng.uniform(0.1, 0.9), row.heading_rad)
            plan(row, setup)
        last = row.self_event_tick
        way, ticks = poses(row, setup, last + 1), np.arange(1, last + 1)
        # The move from its last tick belongs to the next plan.
        moves = in_wall(setup, way)[2:] & (ticks < last)
        sees = heeds(row, setup, ticks) & sees_wall(row, setup, way[1:-1])
        if in_wall(setup, way[:2]).any():
            continue  # it would have been blocked
        yield wall_tick(row, setup), first(sees | moves, ticks)


@pytest.mark.parametrize(
    ("mode", "settings", "straight"),
    [(DRIVE, ALL, False), (DRIVE, ("bodies only",), True), (TURN, ("much bent",), False)],
    ids=["seen by a ray", "stops a driver", "stops a turning body"],
)
def test_wall(mode, settings, straight):
    assert_bound(walls(mode, settings, straight))


def pair(
    setup: Row, rng: np.random.Generator, modes: tuple[int, int], straight: bool = False
) -> tuple[Row, Row]:
    """Two robots that have just planned, apart by no more than they may come near, and not in contact."""
    while True:
        a, b = (robot(setup, rng, mode, straight) for mode in modes)
        reach = (
            setup.zone_m + setup.sight_m * rng.random() + rng.random() * 40 * (a.max_step_m + b.max_step_m)
        )
        angle = float(rng.uniform(-math.pi, math.pi))
        place(a, 0.5 * setup.width_m, 0.5 * setup.height_m, a.heading_rad)
        towards = float(rng.normal(0.0, 0.4))
        if rng.random() < 0.7:
            place(a, a.x_m, a.y_m, angle + towards * float(rng.random() < 0.8))
            heading = angle + math.pi + towards
        else:
            heading = b.heading_rad
        place(b, a.x_m + reach * math.cos(angle), a.y_m + reach * math.sin(angle), heading)
        for row in (a, b):
            plan(row, setup)
        if reach > setup.zone_m:
            return a, b


def matters(a: Row, b: Row, setup: Row, last: int, a_first: bool) -> tuple[NDArray[np.bool_], ...]:
    """Step by step from tick 1 to ``last``: whether ``a`` sees ``b``, ``b`` sees ``a``, a move ends in the other."""
    way_a, way_b = poses(a, setup, last + 1), poses(b, setup, last + 1)
    ticks = np.arange(1, last + 1)
    a_sees = heeds(a, setup, ticks) & sees_disc(a, setup, way_a[1:-1], way_b[1:-1])
    b_sees = heeds(b, setup, ticks) & sees_disc(b, setup, way_b[1:-1], way_a[1:-1])
    before, after = (way_a, way_b) if a_first else (way_b, way_a)
    touch = 2.0 * setup.radius_m - ROUNDING_M
    contact = np.hypot(*(after[1:-1] - before[2:])[:, :2].T) < touch  # the first moves, the other has not
    contact |= np.hypot(*(after[2:] - before[2:])[:, :2].T) < touch
    return a_sees, b_sees, contact & (ticks < last)


MODES = ((DRIVE, DRIVE), (DRIVE, TURN), (DRIVE, STOP), (TURN, TURN), (TURN, STOP), (AVOID, DRIVE))


def pairs(
    seed: int, settings: tuple[str, ...], modes: tuple[tuple[int, int], ...] = MODES, straight: bool = False,
    count: int = 120,
) -> Iterator[tuple[Row, Row, Row, bool]]:  # fmt: skip
    rng = np.random.default_rng(seed)
    for number in range(count):
        setup = setup_named(settings[number % len(settings)])
        a, b = pair(setup, rng, modes[number // len(settings) % len(modes)], straight)
        yield a, b, setup, bool(rng.random() < 0.5)


@pytest.mark.parametrize("modes", MODES, ids=str)
def test_encounter_of_two_plans(modes):
    """The bound on pairs, and both that it is made of: what rays see, and what blocks a move."""

    def cases() -> Cases:
        settings = ("much bent",) if DRIVE not in modes else ALL
        for a, b, setup, a_first in pairs(4, settings, (modes,)):
            last = min(a.self_event_tick, b.self_event_tick)
            found = first(np.any(matters(a, b, setup, last, a_first), axis=0), np.arange(1, last + 1))
            bound = encounter_tick(a, b, setup, 0, a_first)[0] if may_encounter(a, b, setup, 0) else NEVER
            yield bound, found

    assert_bound(cases())


def test_encounter_with_a_robot_that_has_stopped():
    """The second piece of a plan: one robot stands at the end of its way, the other still moves."""

    def cases() -> Cases:
        for a, b, setup, _ in pairs(
            5, ("paper", "one ray straight on", "much bent"), ((DRIVE, DRIVE), (DRIVE, TURN))
        ):
            a.self_event_tick = max(1, b.self_event_tick // 3)
            a.plan_end_tick = a.self_event_tick + 50
            set_chord(a, setup)
            assert stops_before(a, b) or a.self_event_tick >= b.self_event_tick
            if a.self_event_tick >= b.self_event_tick:
                continue
            stop, last = stop_of(a), min(a.plan_end_tick, b.self_event_tick)
            _, sees, contact = matters(a, b, setup, last, True)
            ticks = np.arange(1, last + 1)
            found = first((sees | contact) & (ticks >= a.self_event_tick), ticks)
            bound = NEVER
            if may_encounter(stop, b, setup, stop.tick):
                bound, to_a, to_b = encounter_tick(stop, b, setup, stop.tick, True)
                assert not to_a
                assert to_b == (bound < NEVER)
            yield bound, found

    assert_bound(cases())


def delayed(row: Row, late: int) -> Row:
    """A plan whose chord is taken ``late`` ticks late."""
    row = copy.copy(row)
    row.tick += late
    return row


def chord_misses(late: int) -> int:
    """Ticks at which a robot is further from its chord than ``position_error_m``."""
    rng, misses = np.random.default_rng(7), 0
    for number in range(120):
        setup = setup_named(ALL[number % len(SETTINGS)])
        row = robot(setup, rng, (DRIVE, TURN, AVOID, STOP)[number // len(SETTINGS) % 4])
        for tick, (x, y, _) in enumerate(poses(row, setup, row.self_event_tick)[: row.self_event_tick]):
            off = math.sqrt(distance2_m2(delayed(row, late), x, y, tick))
            misses += off > row.position_error_m + ROUNDING_M
            near = maybe_within(delayed(row, late), x, y, 1e-9, tick)
            assert late or near
    return misses


def test_chord_of_a_plan():
    assert chord_misses(0) == 0
    assert chord_misses(1) > 0


def head_on(count: int) -> Iterator[tuple[Row, Row, Row, bool]]:
    """Robots that drive straight at each other, and see each other at the last tick of a plan or just not."""
    rng, setup = np.random.default_rng(17), setup_named("one ray straight on")
    for _ in range(count):
        a, b = robot(setup, rng, DRIVE, straight=True), robot(setup, rng, DRIVE, straight=True)
        span, closing = min(a.self_event_tick, b.self_event_tick), a.max_step_m + b.max_step_m
        place(a, 0.2, 0.5, 0.0)
        place(b, 0.2 + setup.sight_m + (span + float(rng.uniform(-1.0, 1.0))) * closing, 0.5, math.pi)
        for row in (a, b):
            plan(row, setup)
        yield a, b, setup, True


def rejected_wrongly(cases: Iterator[tuple[Row, Row, Row, bool]], late: int) -> tuple[int, int, int]:
    """Pairs that ``may_encounter`` rejects; those of them, and of ``measure_meetings``, in which something happens.

    Args:
        late: both robots' chords are taken so many ticks late.
    """
    rejected = by_pair = by_places = 0
    for a, b, setup, a_first in cases:
        last = min(a.self_event_tick, b.self_event_tick)
        if not may_encounter(delayed(a, late), delayed(b, late), setup, 0):
            rejected += 1
            by_pair += bool(np.any(matters(a, b, setup, last, a_first)))
        # One has stopped, the other's plan is over.
        end = max(min(a.plan_end_tick, b.self_event_tick), min(b.plan_end_tick, a.self_event_tick))
        places, apart = np.zeros(1, PLACES).view(np.recarray)[0], np.zeros((2, 17))
        places["mid_x_m"][:] = math.inf
        store_plan(places, 1, delayed(b, 2 * late), setup)
        measure_meetings(places, apart, 2, 0, a, setup, 0)
        by_places += bool(apart[0, 2] > 0.0) and bool(np.any(matters(a, b, setup, end, a_first)))
    return rejected, by_pair, by_places


def test_cheap_rejects_of_a_pair():
    """``may_encounter`` and ``measure_meetings`` say that nothing happens as long as both plans last."""
    rejected, by_pair, by_places = rejected_wrongly(pairs(8, ALL, count=200), 0)
    assert rejected > 20
    assert by_pair == by_places == 0
    assert rejected_wrongly(head_on(30), 0)[1:] == (0, 0)
    _, by_pair, by_places = rejected_wrongly(head_on(30), 1)
    assert by_pair > 0
    assert by_places > 0


def test_approach_of_two_chords():
    """Of ways without a bend, which are their own chords: the bound, rounded up, is the first tick within reach."""

    def cases() -> Cases:
        for a, b, setup, _ in pairs(9, ("paper", "one ray straight on"), ((DRIVE, DRIVE),), straight=True):
            last = min(a.self_event_tick, b.self_event_tick)
            way_a, way_b = poses(a, setup, last), poses(b, setup, last)
            within = np.hypot(*(way_a - way_b)[1:, :2].T) < setup.sight_m - ROUNDING_M
            clear = chord_clear_ticks(a, b, setup.sight_m, 1)
            yield 1 + math.ceil(clear), first(within, np.arange(1, last + 1))

    assert_bound(cases())


def test_distances_to_a_small_swarm():
    """No robot is nearer than its distance in ``places`` less the error; with positions one tick old some are."""

    def nearer(late: int) -> int:
        found = 0
        for a, b, setup, _ in pairs(10, ("paper", "one ray straight on")):
            tick = min(a.self_event_tick, b.self_event_tick) // 2 + 1
            places = np.zeros(1, PLACES).view(np.recarray)[0]
            places["mid_x_m"][:] = math.inf
            store_plan(places, 1, b, setup)
            (ax, ay, _), (bx, by, _) = poses(a, setup, tick)[-1], poses(b, setup, tick)[-1]
            nearest2, error = measure_all(places, np.zeros((2, 17)), 2, 0, ax, ay, tick - late)
            found += math.hypot(ax - bx, ay - by) < math.sqrt(nearest2) - error - ROUNDING_M
        return found

    assert nearer(0) == 0
    assert nearer(1) > 0


def test_longest_step_and_zone():
    """No robot moves further in a tick than its ``max_step_m``, nor than ``longest_step_m``; in two ticks it does.

    From ``zone_m`` apart two robots cannot touch within one tick; within two they can.
    """
    rng = np.random.default_rng(11)
    exceeded = 0
    for number in range(120):
        setup = setup_named(ALL[number % len(SETTINGS)])
        row = robot(setup, rng, (DRIVE, TURN, AVOID)[number // len(SETTINGS) % 3])
        way = poses(row, setup, row.self_event_tick)
        steps = np.hypot(*np.diff(way, axis=0)[:, :2].T)
        assert steps.max() <= row.max_step_m + ROUNDING_M
        assert row.max_step_m <= setup.longest_step_m + ROUNDING_M
        exceeded += bool((np.hypot(*(way[2:] - way[:-2])[:, :2].T) > row.max_step_m + ROUNDING_M).any())
        left_m = setup.zone_m - 2.0 * setup.longest_step_m
        assert left_m >= 2.0 * setup.radius_m - ROUNDING_M
        assert left_m - 2.0 * setup.longest_step_m < 2.0 * setup.radius_m
    assert exceeded > 0


def test_reach_within_which_a_plan_looks_at_others():
    """Who is beyond it now cannot be in sight until the plan and its stop are over, at whatever speed it comes."""

    def cases() -> Cases:
        rng = np.random.default_rng(12)
        setup = setup_named("one ray straight on")
        for _ in range(60):
            row = robot(setup, rng, DRIVE, straight=True)
            ticks = np.arange(1, 2 * HORIZON)
            ahead_m = encounter_reach_m(row, setup, 0)
            own_m = np.minimum(ticks, row.self_event_tick) * row.max_step_m
            left_m = ahead_m - own_m - ticks * setup.longest_step_m
            yield row.plan_end_tick + 1, first(left_m < max(setup.sight_m, setup.zone_m) - ROUNDING_M, ticks)

    assert_bound(cases())


def test_lists_of_neighbours_hold_until_they_are_updated():
    """Two robots that are not on each other's lists meet at full speed: not before the next update is over.

    The radius has two ticks in hand: lists would serve for so much longer, and not for three.
    """
    for name in SETTINGS:
        setup = setup_named(name)
        ticks = np.arange(1, 2 * LIST_TICKS)
        left_m = list_radius_m(vars(setup)) - 2.0 * setup.longest_step_m * ticks
        nearby = first(left_m < max(setup.zone_m, setup.sight_m) - ROUNDING_M, ticks)
        assert nearby >= LIST_TICKS
        assert nearby < LIST_TICKS + 3


def test_move_that_stays_blocked():
    """A blocked robot sleeps no longer than its move would end in a wall or in a body, by all plans."""
    most = 80

    def cases() -> Cases:
        for number, (row, other, setup, _) in enumerate(
            pairs(
                13,
                ("paper", "much bent", "turns of over a revolution in a tick"),
                ((DRIVE, STOP), (TURN, STOP), (DRIVE, DRIVE), (AVOID, TURN)),
                count=240,
            )
        ):
            i, j = (0, 1) if number % 2 else (1, 0)
            rng = np.random.default_rng(number)
            angle = row.heading_rad + float(rng.uniform(-1.2, 1.2))
            apart = 2.0 * setup.radius_m + float(rng.uniform(0.0, 1.0)) * row.max_step_m
            place(
                other, row.x_m + apart * math.cos(angle), row.y_m + apart * math.sin(angle), other.heading_rad
            )
            if number % 5 == 0:  # a wall in place of the other
                place(row, setup.width_m - setup.radius_m, row.y_m, float(rng.uniform(-1.5, 1.5)))
                place(other, 0.1, 0.1, 0.0)
            plan(other, setup, is_blocked=number % 3 == 0 and other.mode != STOP)
            moving = copy.copy(row)
            plan(moving, setup)
            plan(row, setup, is_blocked=True)
            set_standing(row)
            others = poses(other, setup, most)
            planners: list[Row] = [row, other] if i == 0 else [other, row]
            near = np.array([[1, 1], [1, 0]], dtype=np.uint32)
            ends = blocked_ends(moving, setup, most)
            there = others[1:, :2] if j < i else others[:-1, :2]
            gone = np.arange(most) >= (other.self_event_tick if other.mode != STOP else NEVER)
            hits = (np.hypot(*(ends - there).T) < 2.0 * setup.radius_m + ROUNDING_M) & ~gone
            hits |= in_wall(setup, np.column_stack([ends, ends[:, 0]])) | wall_touch(setup, ends)
            if not hits[0]:
                continue
            yield blocked_ticks(planners, near, i, setup, most), first(~hits[1:], np.arange(1, most))

    assert_bound(cases())


def wall_touch(setup: Row, ends: NDArray[np.float64]) -> NDArray[np.bool_]:
    x, y = ends.T
    return (
        np.minimum(np.minimum(x, setup.width_m - x), np.minimum(y, setup.height_m - y))
        < setup.radius_m + ROUNDING_M
    )


def blocked_ends(row: Row, setup: Row, ticks: int) -> NDArray[np.float64]:
    """Where each move of a robot that stands and turns on would end, at the ticks from 0 on: (ticks, 2)."""
    found = []
    for heading, (dx, dy) in zip(*moves_of(row, setup, ticks), strict=True):
        cos_h, sin_h = math.cos(heading), math.sin(heading)
        found.append((row.x_m + dx * cos_h - dy * sin_h, row.y_m + dx * sin_h + dy * cos_h))
    return np.array(found)


def moves_of(row: Row, setup: Row, ticks: int) -> tuple[list[float], list[tuple[float, float]]]:
    """A robot's heading at each tick, and its move from there, ahead and to the left."""
    row = copy.copy(row)
    row.self_event_tick = ticks
    way = poses(row, setup, ticks)
    steps = np.diff(way, axis=0)
    cos_h, sin_h = np.cos(way[:-1, 2]), np.sin(way[:-1, 2])
    ahead = steps[:, 0] * cos_h + steps[:, 1] * sin_h
    left = steps[:, 1] * cos_h - steps[:, 0] * sin_h
    return way[:-1, 2].tolist(), list(zip(ahead.tolist(), left.tolist(), strict=True))
