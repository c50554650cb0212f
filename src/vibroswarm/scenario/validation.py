"""Checks across the fields of a scenario: each takes its sections ``s``, and raises an ``InputError`` on the field to
fix."""

from __future__ import annotations

import math
from collections.abc import Callable

from vibroswarm.core.numbers import stated
from vibroswarm.core.user_code import errors_in
from vibroswarm.errors import InputError
from vibroswarm.scenario.disturbance_fields import check_faults
from vibroswarm.scenario.fields import Sections
from vibroswarm.sensors.confusion import check_rates
from vibroswarm.strategies.base import Plugin
from vibroswarm.tasks import Asked


def _refuse(is_wrong: bool, field: str, why: str) -> None:
    if is_wrong:
        raise InputError(why, field=field)


def _check_own(part: Plugin, check: Callable[..., object] | None, *arguments: object) -> None:
    """Call the check that a strategy, network, task or sensor has of its own, which refuses by an ``InputError``."""
    if check is not None:
        with errors_in(part.code):
            check(*arguments)


def _check_robots(s: Sections) -> None:
    robot = s.robot
    low, high = robot.speed_factor_min, robot.speed_factor_max
    for name, least, most in (
        ("robot.misalignment_min", robot.misalignment_min, robot.misalignment_max),
        ("robot.speed_factor_min", low, high),
        ("walk.leg_min_ms", s.walk.leg_min_ms, s.walk.leg_max_ms),
    ):
        _refuse(least > most, name, f"{least} is above the upper bound, which is {most}")
    # The speeds of the wheels are proportional to 1 - misalignment and 1 + misalignment.
    _refuse(
        _largest_misalignment(s) + widest_veer_shift(s) >= 1.0,
        "robot.misalignment_max",
        "with wander, drift and differences between runs, a wheel could stand or turn backwards",
    )
    factors = robot.speed_factors
    _refuse(
        factors is not None and (robot.speed_redraw == "sample" or min(factors) < low or max(factors) > high),
        "robot.speed_factors",
        f'requires robot.speed_redraw = "robot", and values from speed_factor_min to speed_factor_max, {low:g} to '
        f"{high:g}",
    )
    sides, angles = len(s.rays.side_m), len(s.rays.angle_deg)
    _refuse(sides != angles, "rays.side_m", f"{sides} values for {angles} of rays.angle_deg")


def start_region(s: Sections) -> tuple[float, float, float, float]:
    """Return the region of the robots' centres at the start: least x, greatest x, least y, greatest y, m."""
    margin = max(s.swarm.start_margin_m, s.robot.body_radius_m)
    return margin, s.arena.width_m - margin, margin, s.arena.height_m - margin


def lattice_sites(s: Sections) -> tuple[int, int]:
    """Return how many columns and rows of robots fit side by side into the start region."""
    left, right, low, high = start_region(s)
    # A little more than touching, so that rounding makes no overlap.
    pitch = 2 * s.robot.body_radius_m * (1 + 1e-9)
    # Plus 1, because the region is that of centres: one pitch lies between two of them.
    return int((right - left) / pitch) + 1, int((high - low) / pitch) + 1


def _check_places(s: Sections) -> None:
    left, right, low, high = start_region(s)
    columns, rows = lattice_sites(s)
    most = 0 if left > right or low > high else columns * rows
    _refuse(
        s.swarm.robots > most,
        "swarm.robots",
        f"{s.swarm.robots} of radius {stated(s.robot.body_radius_m)} m do not fit into an arena of "
        f"{stated(s.arena.width_m)} m x {stated(s.arena.height_m)} m with a start margin of "
        f"{s.swarm.start_margin_m:g} m; at most {most} can start side by side",
    )


def widest_veer_shift(s: Sections) -> float:
    """Return how far wander, drift and differences between runs may move a robot's misalignment at most."""
    robot = s.robot
    # Triangular numbers of standard deviation sd are within sqrt(6) sd. Those of the drift are interpolated, which
    # lowers their variance to 2/3, and are drawn larger to make up for that.
    each = (
        robot.misalignment_wander or 0.0,
        math.sqrt(1.5) * (robot.misalignment_drift or 0.0),
        robot.misalignment_run_spread or 0.0,
    )
    return math.sqrt(6.0) * sum(each)


def _largest_misalignment(s: Sections) -> float:
    return max(map(abs, (s.robot.misalignment_min, s.robot.misalignment_max, *(s.robot.misalignments or ()))))


def longest_step_m(s: Sections) -> float:
    """Return an upper bound on the distance a robot drives between two ticks, m."""
    # Speed of the faster wheel relative to that of a robot without misalignment.
    wheel = 1 + _largest_misalignment(s) + widest_veer_shift(s)
    return s.robot.full_speed_m_s * s.robot.speed_factor_max * wheel * s.tick_s


def _check_times(s: Sections) -> None:
    period_ms, sample, battery_s, end_s = (
        s.run.control_period_ms,
        s.sample,
        s.robot.battery_life_s,
        s.run.t_end_s,
    )
    _refuse(
        end_s >= battery_s,
        "robot.battery_life_s",
        f"{battery_s:g} s is not longer than the run ({end_s:g} s)",
    )
    # The tick of the end, and the one after it, must fit into 32 bits.
    is_countable = 1 <= s.ticks <= 2**31 - 2
    _refuse(
        not is_countable, "run.t_end_s", f"{end_s:g} s is not 1 to 2^31 control periods of {period_ms} ms"
    )
    _refuse(
        sample.sample_interval_ms + sample.stop_ms < period_ms,
        "sample.sample_interval_ms",
        f"{sample.sample_interval_ms:g} with stop_ms {sample.stop_ms:g} is less than one control period "
        f"({period_ms} ms)",
    )
    _refuse(
        longest_step_m(s) > s.robot.body_radius_m,
        "run.control_period_ms",
        f"{period_ms} ms is too long: a robot could drive {longest_step_m(s) * 1000:.3g} mm, more than its radius",
    )
    accelerometer = s.sensor.entry.accelerometer
    signal_ms = s.sample.signal_ms if accelerometer is None else accelerometer(s.sensor.params).signal_ms
    _refuse(
        (signal_ms or 0.0) > sample.stop_ms,
        "sample.signal_ms" if accelerometer is None else f"sensor.{s.sensor.model}.signal_ms",
        f"{signal_ms} is longer than the stop, which is sample.stop_ms = {sample.stop_ms:g}",
    )


def _check_sensor(s: Sections) -> None:
    sensor = s.sensor
    _check_own(sensor.entry, sensor.entry.check, sensor.params)
    if sensor.claimed_rates is not None:
        field, rows = "sensor.claimed_rates", len(sensor.claimed_rates)
        _refuse(rows != sensor.kinds, field, f"give {sensor.kinds} rows, one for each kind of tile")
        check_rates(sensor.claimed_rates, sensor.readings, field)


def _check_floor(s: Sections) -> None:
    floor, sensor, model = s.floor.placed_in(s.arena, 0, 0), s.sensor, s.sensor.entry
    left, bottom, right, top = floor.box_within(*s.arena.size_m)
    _refuse(left >= right or bottom >= top, "floor.left_m", "the floor lies outside the arena")
    most = int(floor.levels.max())
    _refuse(
        most >= sensor.kinds,
        "floor.source" if s.floor.tiles is None else "floor.tiles",
        f"'{floor.name}' has tiles of kind {most}, and the sensor '{sensor.model}' knows {sensor.kinds} kinds, from 0; "
        f"{model.for_more_kinds}",
    )
    has_strengths = model.scales and model.sense is None and max(sensor.kinds, sensor.readings) <= 2
    _refuse(
        s.floor.has_surface and not has_strengths,
        "sensor.model",
        f"patches and values of tiles need a sensor of strengths (scales=True) with two kinds of tile, such as gamma, "
        f"and '{sensor.model}' is none",
    )


def _check_question(s: Sections) -> None:
    kinds, readings, strategy, task = s.sensor.kinds, s.sensor.readings, s.strategy.entry, s.task.entry
    _refuse(
        readings > 2 and not strategy.many_readings,
        "strategy.name",
        f"'{strategy.name}' reads 0 or 1, and the sensor '{s.sensor.model}' has {readings} classes; choose a strategy "
        "for several kinds, such as dirichlet",
    )
    kind = getattr(s.task.params, "kind", 1)
    is_asked = strategy.shares or task.name == "share"
    _refuse(
        is_asked and kind not in range(kinds),
        f"task.{task.name}.kind",
        f"is not a kind from 0 to {kinds - 1}",
    )
    is_other = task.name == "share" and kind != 1 and not (strategy.shares or strategy.is_own)
    _refuse(
        bool(task.estimated) and (is_other or not strategy.estimates),
        "strategy.name",
        f"'{strategy.name}' does not estimate the number that the task '{task.name}' asks for; choose another strategy",
    )
    answers, decisions = len(task.answers_of(kinds)), kinds if strategy.answers_kinds else 2
    _refuse(
        not task.estimated and answers != decisions,
        "task.name",
        f"'{task.name}' has {answers} answers, and '{strategy.name}' decides among {decisions}",
    )
    costs = s.task.costs or ()
    is_square = all(len(row) == answers for row in (costs, *costs))
    _refuse(
        costs != ()
        and (not is_square or any(costs[k][k] for k in range(answers)) or not any(map(sum, costs))),
        "task.costs",
        f"give {answers} rows of {answers} costs: 0 for right answers, and more for at least one mistake",
    )
    if task.check is not None:
        floor = s.floor.placed_in(s.arena, 0, 0)
        boundary, fill = s.decision.decision_boundary, floor.fill_ratio_within(*s.arena.size_m)
        asked = Asked(*s.arena.size_m, fill_ratio=fill, decision_boundary=boundary, kinds=kinds)
        _check_own(task, task.check, floor, asked, s.task.params)


def _check_change(s: Sections) -> None:
    """Refuse changes to what is no floor of this size or of the sensor's kinds, and robots not asked about them."""
    change, params, asks = s.change, s.strategy.params, s.task.entry
    if change.is_given:
        _refuse(s.floor.has_surface, "change", "is defined for kinds of tile, not for patches and values")
        floor = s.floor.placed_in(s.arena, 0, 0)  # seed 0, run 0: sizes and kinds are those of all runs
        kind = change.changes(floor, s.arena.size_m, math.inf, 0, 0).kind if change.at_s else ()
        kinds = max(len(change.shares or ()), 1 + max(kind, default=0))
        _refuse(
            kinds > s.sensor.kinds,
            "change",
            f"makes tiles of {kinds} kinds, and the sensor '{s.sensor.model}' knows {s.sensor.kinds}",
        )
    tells = bool(getattr(params, "tells_change", False))
    is_wrong = (asks.name == "changed" and not tells) or (
        tells and asks.name in ("fill_ratio", "majority", "agree")
    )
    _refuse(
        is_wrong and not s.strategy.entry.is_own,
        "task.name",
        "the strategy must tell whether the floor has changed if, and only if, the task is changed: "
        "strategy.reset.tells_change",
    )
    _refuse(
        asks.is_asked_anew(s.task.params)
        and not (getattr(params, "tells_anew", False) or s.strategy.entry.is_own),
        "task.changed.since" if asks.name == "changed" else "task.name",
        "asks anew after each answer, and robots keep theirs; set strategy.reset.tells_anew = true",
    )


def _check_decision(s: Sections) -> None:
    decision, strategy, network = s.decision, s.strategy.entry, s.network.entry
    _refuse(
        strategy.boundary_half and decision.boundary_of == "readings" and decision.decision_boundary != 0.5,
        "strategy.name",
        f"'{strategy.name}' is neutral at a boundary of 0.5 only, and decision.decision_boundary is "
        f"{decision.decision_boundary:g}; choose another strategy",
    )
    _check_own(strategy, strategy.check, s.strategy.params, decision.decision_boundary)
    _check_own(network, network.check, s.network.params, s.swarm.robots)


def _check_faults(s: Sections) -> None:
    check_faults(s.faults, s.swarm.robots)
    _refuse(
        bool(s.faults.stuck) and s.faults.stuck_class >= s.sensor.readings,
        "faults.stuck_class",
        f"the sensor '{s.sensor.model}' reads classes from 0 to {s.sensor.readings - 1}",
    )
    _refuse(
        bool(s.faults.opposite) and not s.strategy.entry.has_opposite,
        "faults.opposite",
        f"messages of '{s.strategy.name}' have no opposite: no field bit or kind, and no function opposite",
    )


ALL = (
    _check_robots,
    _check_places,
    _check_times,
    _check_sensor,
    _check_floor,
    _check_question,
    _check_change,
    _check_decision,
    _check_faults,
)
