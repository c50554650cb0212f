"""Checks across the fields of a scenario: each takes its sections ``s``, and raises an ``InputError`` if they disagree.

The error names the field to fix. Each field has been checked by itself before.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from vibroswarm.core.numbers import stated
from vibroswarm.core.user_code import errors_in
from vibroswarm.errors import InputError, shown
from vibroswarm.scenario.fault_fields import OF_TWO_KINDS, check_faults
from vibroswarm.scenario.fields import Sections
from vibroswarm.sensors.confusion import check_rates
from vibroswarm.strategies.base import Plugin, Strategy
from vibroswarm.tasks import Asked, Task


def _check_ranges(s: Sections) -> None:
    """Refuse lower bounds above upper bounds, misalignments that could stop a wheel, and unequal lists of rays."""
    pairs = (
        ("robot.misalignment_min", s.robot.misalignment_min, s.robot.misalignment_max),
        ("robot.speed_factor_min", s.robot.speed_factor_min, s.robot.speed_factor_max),
        ("walk.leg_min_ms", s.walk.leg_min_ms, s.walk.leg_max_ms),
    )
    for name, low, high in pairs:
        if low > high:
            raise InputError(f"{low} is above the upper bound, which is {high}", field=name)
    # The speeds of the wheels are proportional to 1 - misalignment and 1 + misalignment.
    if _largest_misalignment(s) + widest_veer_shift(s) >= 1.0:
        raise InputError(
            "with wander, drift and differences between runs, a wheel could stand or turn backwards",
            field="robot.misalignment_max",
        )
    if len(s.rays.side_m) != len(s.rays.angle_deg):
        raise InputError(
            f"{len(s.rays.side_m)} values for {len(s.rays.angle_deg)} of rays.angle_deg", field="rays.side_m"
        )


def start_region(s: Sections) -> tuple[float, float, float, float]:
    """Return the region of the robots' centres at the start, m: least x, greatest x, least y, greatest y.

    The least is above the greatest if the arena is too small.
    """
    margin = max(s.swarm.start_margin_m, s.robot.body_radius_m)
    return margin, s.arena.width_m - margin, margin, s.arena.height_m - margin


def lattice_sites(s: Sections) -> tuple[int, int]:
    """Return how many columns and rows of robots fit side by side into the start region.

    Robots start on this lattice if random placement fails. More robots than lattice sites are refused, although tighter
    arrangements, such as offset rows, may hold a few more.
    """
    left, right, low, high = start_region(s)
    # A little more than touching, so that rounding makes no overlap.
    pitch = 2 * s.robot.body_radius_m * (1 + 1e-9)
    # Plus 1, because the region is that of centres: one pitch lies between two of them.
    return int((right - left) / pitch) + 1, int((high - low) / pitch) + 1


def _check_speed_factors(s: Sections) -> None:
    """Refuse ``robot.speed_factors`` with a value out of bounds, or if speeds are redrawn for each sample."""
    robot = s.robot
    factors, low, high = robot.speed_factors, robot.speed_factor_min, robot.speed_factor_max
    if factors is None:
        return
    if robot.speed_redraw == "sample" or min(factors) < low or max(factors) > high:
        raise InputError(
            f'requires robot.speed_redraw = "robot", and values from speed_factor_min to speed_factor_max, {low:g} to '
            f"{high:g}",
            field="robot.speed_factors",
        )


def _check_places(s: Sections) -> None:
    """Refuse more robots than can start side by side."""
    left, right, low, high = start_region(s)
    columns, rows = lattice_sites(s)
    most = 0 if left > right or low > high else columns * rows
    if s.swarm.robots > most:
        raise InputError(
            f"{s.swarm.robots} of radius {stated(s.robot.body_radius_m)} m do not fit into an arena of "
            f"{stated(s.arena.width_m)} m x {stated(s.arena.height_m)} m with a start margin of "
            f"{s.swarm.start_margin_m:g} m; at most {most} can start side by side",
            field="swarm.robots",
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


def _check_time(s: Sections) -> None:
    """Refuse times that do not fit together.

    The battery must last longer than the run, the number of ticks must be above 0 and fit into 32 bits, time between
    two samples must be at least one tick, and a robot must not drive farther than its radius in one tick.
    """
    period_ms, sample = s.run.control_period_ms, s.sample
    if s.run.t_end_s >= s.robot.battery_life_s:
        raise InputError(
            f"{s.robot.battery_life_s:g} s is not longer than the run ({s.run.t_end_s:g} s)",
            field="robot.battery_life_s",
        )
    # The tick of the end, and the one after it, must fit into 32 bits.
    if not 1 <= s.ticks <= 2**31 - 2:
        raise InputError(
            f"{s.run.t_end_s:g} s is not 1 to 2^31 control periods of {period_ms} ms", field="run.t_end_s"
        )
    if sample.sample_interval_ms + sample.stop_ms < period_ms:
        raise InputError(
            f"{sample.sample_interval_ms:g} with stop_ms {sample.stop_ms:g} is less than one control period "
            f"({period_ms} ms)",
            field="sample.sample_interval_ms",
        )
    if longest_step_m(s) > s.robot.body_radius_m:
        raise InputError(
            f"{period_ms} ms is too long: a robot could drive {longest_step_m(s) * 1000:.3g} mm, more than its radius",
            field="run.control_period_ms",
        )


def _check_signal(s: Sections) -> None:
    """Refuse a signal of the accelerometer that is longer than the stop in which it is read."""
    sensor, field, signal_ms = s.sensor.entry, "sample.signal_ms", s.sample.signal_ms
    if sensor is not None and sensor.accelerometer is not None:
        field, signal_ms = (
            f"sensor.{s.sensor.model}.signal_ms",
            sensor.accelerometer(s.sensor.params).signal_ms,
        )
    if signal_ms is not None and signal_ms > s.sample.stop_ms:
        raise InputError(
            f"{signal_ms:g} is longer than the stop, which is sample.stop_ms = {s.sample.stop_ms:g}",
            field=field,
        )


def _own_check(part: Plugin, check: Callable[..., object] | None, *arguments: object) -> None:
    """Call the check that a strategy, network, task or sensor has of its own, which refuses by an ``InputError``.

    Raises:
        InputError: it refuses. CodeError: it raised another error.
    """
    if check is not None:
        with errors_in(part.code):
            check(*arguments)


def _check_sensor(s: Sections) -> None:
    """Refuse what the sensor's own check refuses, claims of other rates than it has, and options it has no use for."""
    sensor = s.sensor
    if sensor.entry is None:  # its code is not loaded
        return
    _own_check(sensor.entry, sensor.entry.check, sensor.params)
    if sensor.claimed_rates is not None:
        field = "sensor.claimed_rates"
        if len(sensor.claimed_rates) != sensor.kinds:
            raise InputError(f"give {sensor.kinds} rows, one for each kind of tile", field=field)
        check_rates(sensor.claimed_rates, sensor.readings, field)
    for field in _options_without_law(s):
        raise InputError(
            f"has no meaning for the sensor '{sensor.model}' on this floor; leave it out", field=field
        )


def _options_without_law(s: Sections) -> list[str]:
    """Return the fields that are set and change a strength or a law of two kinds of tile, if the sensor has none."""
    sensor, model = s.sensor, s.sensor.entry
    is_of_two = max(sensor.kinds, sensor.readings) <= 2
    fields: list[str] = []
    if not model.scales:
        fields += [f"sensor.{name}" for name in ("tile_spread", "robot_spread") if getattr(sensor, name)]
    if model.sense is not None or not is_of_two or s.floor.values is not None:
        fields += [
            f"sensor.{name}" for name in ("edge_reach_m", "edge_blur_m") if getattr(sensor, name) is not None
        ]
    if model.sense is not None or not is_of_two:
        fields += [f"faults.{name}" for name in OF_TWO_KINDS if s.faults.biased and getattr(s.faults, name)]
    if not is_of_two and s.decision.boundary_of == "tiles":
        fields.append("decision.boundary_of")
    return fields


def _check_kinds(s: Sections) -> None:
    """Refuse kinds of tile, classes of readings and answers that sensor, floor, strategy and task do not share."""
    if s.sensor.entry is None:  # its code is not loaded
        return
    kinds, readings = s.sensor.kinds, s.sensor.readings
    levels = s.floor.levels_for(0, 0)
    if levels.max() >= kinds:
        raise InputError(
            f"'{s.floor.source}' has tiles of kind {levels.max():g}, and the sensor '{s.sensor.model}' "
            f"knows {kinds} kinds, from 0; {s.sensor.entry.for_more_kinds}",
            field="floor.source" if s.floor.tiles is None else "floor.tiles",
        )
    if s.floor.has_surface:
        _check_surface(s)
    strategy, task = s.strategy.entry, s.task.entry
    if strategy is None or task is None:  # its code is not loaded
        return
    if readings > 2 and not strategy.many_readings:
        raise InputError(
            f"'{s.strategy.name}' reads 0 or 1, and the sensor '{s.sensor.model}' has {readings} classes; choose a "
            "strategy for several kinds, such as dirichlet",
            field="strategy.name",
        )
    kind = getattr(s.task.params, "kind", 1)
    if (strategy.shares or s.task.name == "share") and kind not in range(kinds):
        raise InputError(f"{shown(kind)} is not a kind from 0 to {kinds - 1}", field=f"task.{task.name}.kind")
    _check_task(s, task)
    if task.estimated:
        others = s.task.name == "share" and kind != 1 and not (strategy.shares or strategy.is_own)
        if others or not strategy.estimates:
            raise InputError(
                f"'{s.strategy.name}' does not estimate the {task.estimated_in_words(s.task.params)}, which the task "
                f"'{s.task.name}' asks for; choose another strategy",
                field="strategy.name",
            )
        return
    answers, decisions = task.answers_of(kinds), kinds if strategy.answers_kinds else 2
    if len(answers) != decisions:
        raise InputError(
            f"'{s.task.name}' has {len(answers)} answers, and '{s.strategy.name}' decides among {decisions}",
            field="task.name",
        )


def _check_task(s: Sections, task: Task) -> None:
    """Refuse costs that do not fit the task's answers, and floors on which its question makes no sense."""
    answers, costs = len(task.answers_of(s.sensor.kinds)), s.task.costs
    if costs is not None:
        is_square = all(len(row) == answers for row in (costs, *costs))
        if not is_square or any(costs[k][k] for k in range(answers)) or not any(map(sum, costs)):
            raise InputError(
                f"give {answers} rows of {answers} costs: 0 for right answers, and more for at least one mistake",
                field="task.costs",
            )
    if task.check is not None:
        floor = s.floor.placed_in(s.arena, 0, 0)
        boundary, fill = s.decision.decision_boundary, floor.fill_ratio_within(*s.arena.size_m)
        asked = Asked(*s.arena.size_m, fill_ratio=fill, decision_boundary=boundary, kinds=s.sensor.kinds)
        _own_check(task, task.check, floor, asked, s.task.params)


def _check_surface(s: Sections) -> None:
    """Refuse values of tiles and patches, if they are wrong or without a sensor of strengths of two kinds."""
    s.floor.placed_in(s.arena, 0, 0)
    sensor, model = s.sensor, s.sensor.entry
    if model.sense is not None or max(sensor.kinds, sensor.readings) > 2 or not model.scales:
        raise InputError(
            f"patches and values of tiles need a sensor of strengths (scales=True) with two kinds of tile, such as "
            f"gamma, and '{sensor.model}' is none",
            field="sensor.model",
        )


def _check_asks_for_change(s: Sections) -> None:
    """Refuse robots that tell whether the floor has changed where that is not asked, and the other way round."""
    known = s.strategy.entry
    if known is None or known.is_own:
        return
    tells = bool(getattr(s.strategy.params, "tells_change", False))
    other_question = s.task.name in ("fill_ratio", "majority", "agree")
    if (s.task.name == "changed" and not tells) or (tells and other_question):
        raise InputError(
            "the strategy must tell whether the floor has changed if, and only if, the task is changed: "
            "strategy.reset.tells_change",
            field="task.name",
        )
    asks = s.task.entry
    is_anew = asks is not None and asks.is_asked_anew(s.task.params)
    if is_anew and not getattr(s.strategy.params, "tells_anew", False):
        raise InputError(
            "asks anew after each answer, and robots keep theirs; set strategy.reset.tells_anew = true",
            field="task.changed.since" if s.task.name == "changed" else "task.name",
        )


def is_neutral_at_half_only(s: Sections) -> bool:
    """Return whether a scenario's strategy works only if the boundary of readings is 1/2; False if it is not loaded."""
    known: Strategy | None = s.strategy.entry
    return known is not None and bool(known.boundary_half)


def _check_boundary(s: Sections) -> None:
    """Refuse a boundary that the strategy cannot test.

    With ``boundary_of = "tiles"``, ``readings_boundary`` makes this check for the boundary that results.
    """
    decision = s.decision
    # At face value the share of ones itself is compared with decision_boundary, without allowing for error rates.
    at_face_value = decision.boundary_of == "readings"
    if is_neutral_at_half_only(s) and at_face_value and decision.decision_boundary != 0.5:
        raise InputError(
            f"'{s.strategy.name}' is neutral at a boundary of 0.5 only, and decision.decision_boundary is "
            f"{decision.decision_boundary:g}; choose another strategy",
            field="strategy.name",
        )


def _check_floor(s: Sections) -> None:
    """Refuse a floor that lies outside of the arena."""
    rows, columns = s.floor.levels_for(0, 0).shape  # the size is that of all runs
    width = s.floor.tile_width_m or s.arena.width_m / columns
    height = s.floor.tile_height_m or s.arena.height_m / rows
    right, top = s.floor.left_m + columns * width, s.floor.bottom_m + rows * height
    beside = right <= 0 or s.floor.left_m >= s.arena.width_m
    if beside or top <= 0 or s.floor.bottom_m >= s.arena.height_m:
        raise InputError(
            "the floor lies outside the arena", field="floor.left_m" if beside else "floor.bottom_m"
        )


def _check_change(s: Sections) -> None:
    """Refuse changes to what is no floor of this size or of the sensor's kinds."""
    change = s.change
    if not change.is_given:
        return
    if s.floor.has_surface:
        raise InputError("is defined for kinds of tile, not for patches and values", field="change")
    if change.rate_per_h is not None:
        kinds, field = len(change.shares or ()), "change.shares"
    else:
        floor = s.floor.placed_in(s.arena, 0, 0)  # seed 0, run 0: sizes and kinds are those of all runs
        kind = change.changes(floor, s.arena.size_m, math.inf, 0, 0).kind
        kinds, field = 1 + int(kind.max(initial=0)), "change.to"
    if kinds > s.sensor.kinds:
        raise InputError(
            f"makes tiles of {kinds} kinds, and the sensor '{s.sensor.model}' knows {s.sensor.kinds}",
            field=field,
        )


def _check_network(s: Sections) -> None:
    """Refuse what the network's own check refuses, such as more robots than it was fitted to."""
    chosen = s.network.entry
    if chosen is not None:
        _own_check(chosen, chosen.check, s.network.params, s.swarm.robots)


def _check_faults(s: Sections) -> None:
    """Refuse faults of robots that do not exist, and ``faults.opposite`` where messages have no opposite."""
    check_faults(s.faults, s.swarm.robots)
    if s.faults.stuck and s.faults.stuck_class >= s.sensor.readings and s.sensor.entry is not None:
        raise InputError(
            f"the sensor '{s.sensor.model}' reads classes from 0 to {s.sensor.readings - 1}",
            field="faults.stuck_class",
        )
    known = s.strategy.entry
    if s.faults.opposite and known is not None and not known.has_opposite:
        raise InputError(
            f"messages of '{s.strategy.name}' have no opposite: no field bit or kind, and no function opposite",
            field="faults.opposite",
        )


def _check_strategy(s: Sections) -> None:
    """Refuse parameters of the strategy that do not go together, or not with the boundary."""
    known: Strategy | None = s.strategy.entry
    if known is not None:
        _own_check(known, known.check, s.strategy.params, s.decision.decision_boundary)


ALL = (
    _check_ranges,
    _check_speed_factors,
    _check_places,
    _check_time,
    _check_sensor,
    _check_signal,
    _check_kinds,
    _check_boundary,
    _check_floor,
    _check_change,
    _check_asks_for_change,
    _check_network,
    _check_faults,
    _check_strategy,
)
