"""Checks across the fields of a scenario: each takes its sections ``s``, and raises an ``InputError`` if they disagree.

The error names the field to fix. Each field has been checked by itself before.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from vibroswarm.core.numbers import stated
from vibroswarm.core.user_code import errors_in
from vibroswarm.errors import InputError, shown
from vibroswarm.floors.surfaces import VALUES, kind_of_name
from vibroswarm.scenario.change_fields import MOST_CHANGES
from vibroswarm.scenario.fault_fields import OF_TWO_KINDS, check_faults
from vibroswarm.scenario.fields import Sections
from vibroswarm.sensors.confusion import check_rates
from vibroswarm.strategies.base import Plugin, Strategy
from vibroswarm.tasks import Asked, Task

VARIATIONS = ("misalignment_wander", "misalignment_drift", "misalignment_run_spread")
"""Fields of ``robot`` that add random numbers to a robot's misalignment."""


def _check_ranges(s: Sections) -> None:
    """Refuse lower bounds above upper bounds, misalignments that could stop a wheel, and unequal lists of rays."""
    pairs = (
        ("robot.misalignment", s.robot.misalignment_min, s.robot.misalignment_max),
        ("robot.speed_factor", s.robot.speed_factor_min, s.robot.speed_factor_max),
        ("walk.leg", s.walk.leg_min_ms, s.walk.leg_max_ms),
    )
    for name, low, high in pairs:
        if low > high:
            unit = "_ms" if name == "walk.leg" else ""  # the names of both fields of legs end in _ms
            raise InputError(f"{low} is above {name}_max{unit}, which is {high}", field=f"{name}_min{unit}")
    # The speeds of the wheels are proportional to 1 - misalignment and 1 + misalignment.
    if _largest_misalignment(s) + widest_veer_shift(s) >= 1.0:
        # Misalignments themselves are between -1 and 1, so a variation is set. The largest is the one to reduce.
        name = max(VARIATIONS, key=lambda name: getattr(s.robot, name) or 0.0)
        raise InputError(
            f"{getattr(s.robot, name):g} is too much: with the misalignments, a wheel could stand or turn backwards",
            field=f"robot.{name}",
        )
    if len(s.rays.side_m) != len(s.rays.angle_deg):
        raise InputError(
            f"{len(s.rays.side_m)} values for {len(s.rays.angle_deg)} of rays.angle_deg; give equal numbers",
            field="rays.side_m",
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


def _check_each(s: Sections) -> None:
    """Refuse ``robot.speed_factors`` with a value out of bounds, or if speeds are redrawn for each sample."""
    robot = s.robot
    if robot.speed_factors is not None and robot.speed_redraw == "sample":
        raise InputError(
            'these factors hold for the whole run; set robot.speed_redraw to "robot"',
            field="robot.speed_factors",
        )
    for value in robot.speed_factors or ():
        if not robot.speed_factor_min <= value <= robot.speed_factor_max:
            raise InputError(
                f"{value:g} is outside of robot.speed_factor_min to speed_factor_max, which are "
                f"{robot.speed_factor_min:g} and {robot.speed_factor_max:g}",
                field="robot.speed_factors",
            )


def _check_places(s: Sections) -> None:
    """Refuse a start region that is too small for the robots: for one robot, or for all side by side."""
    left, right, low, high = start_region(s)
    size = f"{stated(s.arena.width_m)} m x {stated(s.arena.height_m)} m"
    if left > right or low > high:
        most_m = min(s.arena.size_m) / 2  # greatest radius or margin
        if s.robot.body_radius_m > most_m:
            raise InputError(
                f"a robot of radius {stated(s.robot.body_radius_m)} m does not fit into an arena of {size}",
                field="arena.width_m" if s.arena.width_m <= s.arena.height_m else "arena.height_m",
            )
        raise InputError(
            f"{s.swarm.start_margin_m:g} leaves no place in an arena of {size}; at most {most_m:g}",
            field="swarm.start_margin_m",
        )
    columns, rows = lattice_sites(s)
    if s.swarm.robots > columns * rows:
        raise InputError(
            f"{s.swarm.robots} robots of radius {s.robot.body_radius_m:g} m do not fit into an arena of "
            f"{size} with a start margin of {s.swarm.start_margin_m:g} m: at most {columns * rows} can start side by "
            "side, in rows and columns (other arrangements, which are not tried, may hold more)",
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
    if s.run.t_end_s >= s.robot.battery_life_s:
        raise InputError(
            f"{s.robot.battery_life_s:g} s is not longer than the run ({s.run.t_end_s:g} s): "
            "the battery would be empty",
            field="robot.battery_life_s",
        )
    if s.ticks < 1:
        raise InputError(
            f"{s.run.t_end_s:g} s has no control period ({s.run.control_period_ms} ms); give a longer run",
            field="run.t_end_s",
        )
    # The tick of the end, and the one after it, must fit into 32 bits.
    if s.ticks > 2**31 - 2:
        raise InputError(
            f"{s.run.t_end_s:g} s is over 2^31 control periods; give a shorter run or a longer run.control_period_ms",
            field="run.t_end_s",
        )
    if s.sample.sample_interval_ms + s.sample.stop_ms < s.run.control_period_ms:
        raise InputError(
            f"{s.sample.sample_interval_ms:g} with stop_ms {s.sample.stop_ms:g} is less than one control "
            f"period ({s.run.control_period_ms} ms)",
            field="sample.sample_interval_ms",
        )
    step_m = longest_step_m(s)
    if step_m > s.robot.body_radius_m:
        raise InputError(
            f"{s.run.control_period_ms} ms is too long: a robot could drive {step_m * 1000:.3g} mm, more "
            "than its radius, between two control periods",
            field="run.control_period_ms",
        )


def _check_signal(s: Sections) -> None:
    """Refuse a signal of the accelerometer that is longer than the stop in which it is read."""
    if s.sample.signal_ms is not None and s.sample.signal_ms > s.sample.stop_ms:
        raise InputError(
            f"{s.sample.signal_ms:g} is longer than the stop, which is sample.stop_ms = {s.sample.stop_ms:g}",
            field="sample.signal_ms",
        )


def _check_time_of_reading(s: Sections, signal_ms: float) -> None:
    """Refuse a time of reading that the stop does not have, or that two fields state."""
    own = f"sensor.{s.sensor.model}.signal_ms"
    if s.sample.signal_ms is not None:
        raise InputError(
            f"has no effect beside the sensor '{s.sensor.model}'; set {own}",
            field="sample.signal_ms",
        )
    if signal_ms > s.sample.stop_ms:
        raise InputError(
            f"{signal_ms:g} is longer than the stop, which is sample.stop_ms = {s.sample.stop_ms:g}",
            field=own,
        )


def _own_check(part: Plugin, check: Callable[..., object] | None, *arguments: object) -> None:
    """Call the check that a strategy, network, task or sensor has of its own, which refuses by an ``InputError``.

    Raises:
        InputError: it refuses, or returns something. CodeError: it raised another error.
    """
    if check is None:
        return
    with errors_in(part.code):
        answer = check(*arguments)
    if answer is not None:
        raise InputError(
            f"returned {shown(answer)}; raise InputError to refuse, else return nothing",
            field=f"{part.name}.check",
        )


def _check_sensor(s: Sections) -> None:
    """Refuse what the sensor's own check refuses, and options that its readings do not have."""
    sensor = s.sensor
    known = sensor.entry
    if known is None:  # its code is not loaded
        return
    _own_check(known, known.check, sensor.params)
    for field in ("tile_spread", "robot_spread"):
        if getattr(sensor, field) is not None and not known.scales:
            raise InputError(
                f"multiplies strengths, and '{sensor.model}' measures none; leave it out (--set sensor.{field}=)",
                field=f"sensor.{field}",
            )
    if sensor.claimed_rates is not None:
        field = "sensor.claimed_rates"
        if len(sensor.claimed_rates) != sensor.kinds:
            raise InputError(
                f"has {len(sensor.claimed_rates)} rows; give {sensor.kinds}, one for each kind of tile",
                field=field,
            )
        check_rates(sensor.claimed_rates, sensor.readings, field)
    if known.sense is not None:
        _check_options_of_laws(s)
    if known.accelerometer is not None:
        _check_time_of_reading(s, known.accelerometer(sensor.params).signal_ms)


def _check_options_of_laws(s: Sections) -> None:
    """Refuse what changes the law of a kind of tile, for a sensor that measures at each place."""
    why = f"'{s.sensor.model}' measures at each place"
    if field := _edge_option(s):
        raise InputError(
            f"changes the law of a kind of tile, and {why}; leave it out (--set {field}=)", field=field
        )
    _check_bias(s, why)


def _edge_option(s: Sections) -> str:
    """Return the first field that is set of those on edges between kinds of tile; empty if none is."""
    names = [name for name in ("edge_reach_m", "edge_blur_m") if getattr(s.sensor, name) is not None]
    return f"sensor.{names[0]}" if names else ""


def _check_bias(s: Sections, why: str) -> None:
    """Refuse shifts of the rates of false positives and negatives of a sensor that has no law of two kinds of tile."""
    for name in OF_TWO_KINDS:
        if s.faults.biased and getattr(s.faults, name):
            raise InputError(
                f"shifts a law of two kinds of tile, and {why}; set faults.misread_shift, for any sensor",
                field=f"faults.{name}",
            )


def _check_kinds(s: Sections) -> None:
    """Refuse kinds of tile, classes of readings and answers that sensor, floor, strategy and task do not share."""
    if s.sensor.entry is None:  # its code is not loaded
        return
    kinds, readings = s.sensor.kinds, s.sensor.readings
    tiles, name = s.floor.tiles_for(0, 0)
    if tiles.max() >= kinds:
        row, column = (int(index) for index in np.argwhere(tiles >= kinds)[0])
        more = s.sensor.entry.for_more_kinds
        raise InputError(
            f"row {row + 1}, column {column + 1} of floor '{name}' is of kind {tiles[row, column]}, and the sensor "
            f"'{s.sensor.model}' knows {kinds} kinds, from 0; {more}",
            field="floor.source" if s.floor.tiles is None else "floor.tiles",
        )
    if max(kinds, readings) > 2:
        _check_options_of_two(s)
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
    is_known = isinstance(kind, int) and 0 <= kind < kinds
    if (strategy.shares or s.task.name == "share") and not is_known:
        raise InputError(
            f"{shown(kind)} is not a kind of tile that the sensor knows, which are 0 to {kinds - 1}",
            field=f"task.{s.task.name}.kind",
        )
    _check_task(s, task)
    if task.estimated:
        if not strategy.estimates:
            raise InputError(
                f"'{s.task.name}' asks for the {task.estimated_in_words(s.task.params)}, and '{s.strategy.name}' "
                "estimates no number; choose a strategy that counts readings, such as none or mcp",
                field="strategy.name",
            )
        if s.task.name == "share" and kind != 1 and not (strategy.shares or strategy.is_own):
            raise InputError(
                f"asks for the {task.estimated_in_words(s.task.params)}, and '{s.strategy.name}' estimates that of "
                "tiles that vibrate; choose a strategy that estimates shares of kinds, such as dirichlet or averaging",
                field="task.share.kind",
            )
        return
    answers, decisions = task.answers_of(kinds), kinds if strategy.answers_kinds else 2
    if len(answers) != decisions:
        other = "fill_ratio, or a strategy with answers_kinds, such as dirichlet"
        fitting = (
            f"majority, or a sensor of {len(answers)} kinds of tile" if strategy.answers_kinds else other
        )
        raise InputError(
            f"'{s.task.name}' has {len(answers)} answers, and '{s.strategy.name}' decides among {decisions}; "
            f"choose {fitting}",
            field="task.name",
        )


def _check_task(s: Sections, task: Task) -> None:
    """Refuse costs that do not fit the task's answers, and floors on which its question makes no sense."""
    answers, costs = len(task.answers_of(s.sensor.kinds)), s.task.costs
    if costs is not None:
        field = "task.costs"
        if task.estimated:
            raise InputError(
                f"are those of decisions, and '{task.name}' asks for a number; leave them out", field=field
            )
        if any(len(row) != answers for row in (costs, *costs)):
            raise InputError(
                f"'{task.name}' has {answers} answers; give {answers} rows of {answers} costs", field=field
            )
        if any(row[k] for k, row in enumerate(costs)) or not any(map(sum, costs)):
            raise InputError(
                "right answers cost 0, and at least one mistake costs more; row and column k stand for answer k",
                field=field,
            )
    if task.check is not None:
        floor = s.floor.placed_in(s.arena, 0, 0)
        boundary, fill = s.decision.decision_boundary, floor.fill_ratio_within(*s.arena.size_m)
        asked = Asked(*s.arena.size_m, fill_ratio=fill, decision_boundary=boundary, kinds=s.sensor.kinds)
        _own_check(task, task.check, floor, asked, s.task.params)


def _check_surface(s: Sections) -> None:
    """Refuse what values of tiles and patches do not go with, and what is wrong with those of run 0."""
    surface = s.floor.placed_in(s.arena, 0, 0).surface
    sensor, what = s.sensor, "values of tiles" if surface.values is not None else "patches"
    model = sensor.entry
    if model.sense is not None:
        raise InputError(
            f"{what} are contrasts between the laws of two kinds of tile, and '{sensor.model}' has no laws: it "
            "measures at each place, from kinds of tile; choose a floor of kinds",
            field="floor.source",
        )
    if max(sensor.kinds, sensor.readings) > 2 or not model.scales:
        own = (
            "; if it measures strengths, give its SensorModel scales=True"
            if model.is_own and not model.scales
            else ""
        )
        raise InputError(
            f"{what} need a sensor of strengths with two kinds of tile, such as gamma, and '{sensor.model}' is none"
            f"{own}",
            field="sensor.model",
        )
    if surface.values is not None and (field := _edge_option(s)):
        raise InputError("edges are those of kinds of tile, and this floor has values", field=field)


def _check_asks_for_change(s: Sections) -> None:
    """Refuse robots that tell whether the floor has changed where that is not asked, and the other way round."""
    known = s.strategy.entry
    if known is None or known.is_own:
        return
    tells = bool(getattr(s.strategy.params, "tells_change", False))
    if s.task.name == "changed" and not tells:
        raise InputError(
            f"'changed' asks whether the floor has changed, and '{s.strategy.name}' decides on its side; choose "
            "reset, with strategy.reset.tells_change = true",
            field="task.name",
        )
    asks = s.task.entry
    is_anew = asks is not None and asks.is_asked_anew(s.task.params)
    if is_anew and not getattr(s.strategy.params, "tells_anew", False):
        raise InputError(
            "asks anew after each answer, and robots keep theirs; choose reset, with strategy.reset.tells_anew = true",
            field="task.changed.since" if s.task.name == "changed" else "task.name",
        )
    if tells and s.task.name in ("fill_ratio", "majority", "agree"):
        raise InputError(
            f"tells if the floor has changed, and '{s.task.name}' asks another question; choose the task changed",
            field=f"strategy.{s.strategy.name}.tells_change",
        )


def _check_options_of_two(s: Sections) -> None:
    """Refuse what is defined for two kinds of tile and two classes of readings only."""
    field = _edge_option(s) or ("decision.boundary_of" if s.decision.boundary_of == "tiles" else "")
    why = f"the sensor '{s.sensor.model}' has {s.sensor.kinds}, and {s.sensor.readings} classes of readings"
    if field:
        raise InputError(
            f"is defined for two kinds of tile and two classes of readings, and {why}; leave it out",
            field=field,
        )
    _check_bias(s, why)


def is_neutral_at_half_only(s: Sections) -> bool:
    """Return whether a scenario's strategy works only if the boundary of readings is 1/2; False if it is not loaded."""
    known: Strategy | None = s.strategy.entry
    return known is not None and bool(known.boundary_half)


def _check_boundary(s: Sections) -> None:
    """Refuse a boundary that the strategy cannot test, and error rates at which readings carry no information.

    With ``boundary_of = "tiles"``, ``readings_boundary`` makes these checks for the boundary and the rates that result.
    """
    decision = s.decision
    positive, negative = decision.assumed_false_positive, decision.assumed_false_negative
    # At face value the share of ones itself is compared with decision_boundary, without allowing for error rates.
    at_face_value = decision.boundary_of == "readings"
    if is_neutral_at_half_only(s) and at_face_value and decision.decision_boundary != 0.5:
        raise InputError(
            f"'{s.strategy.name}' is neutral at a boundary of 0.5 only, and decision.decision_boundary is "
            f"{decision.decision_boundary:g}; choose another strategy",
            field="strategy.name",
        )
    if positive is not None and negative is not None and positive + negative >= 1.0:
        raise InputError(
            f"{positive:g} and assumed_false_negative {negative:g} sum to 1 or more: such readings tell nothing, or "
            "the opposite; give rates that sum to less than 1",
            field="decision.assumed_false_positive",
        )


FACTOR_LIMIT = 10_000_000
"""Greatest number of pairs of a robot and a tile whose energies have a factor of their own."""


def _check_factors(s: Sections) -> None:
    """Refuse more pairs of a robot and a tile with a factor of their own than ``FACTOR_LIMIT``."""
    # Without a spread all robots, or all tiles, have the same factor. The floor of run 0 stands for those of all runs,
    # as they have the same number of tiles.
    robots = s.swarm.robots if s.sensor.robot_spread else 1
    tiles = s.floor.tiles_for(0, 0)[0].size if s.sensor.tile_spread else 1
    if robots * tiles > FACTOR_LIMIT:
        raise InputError(
            f"{robots} robots and {tiles} tiles that all differ are too many; at most {FACTOR_LIMIT} pairs",
            field="sensor.tile_spread",
        )


def _check_floor(s: Sections) -> None:
    """Refuse a floor that lies outside of the arena."""
    tiles = s.floor.tiles_for(0, 0)[0]  # those of seed 0 and run 0: the size is that of all runs
    rows, columns = tiles.shape
    width = s.floor.tile_width_m or s.arena.width_m / columns
    height = s.floor.tile_height_m or s.arena.height_m / rows
    right, top = s.floor.left_m + columns * width, s.floor.bottom_m + rows * height
    # The arena reaches from 0 to its width and height.
    beside = right <= 0 or s.floor.left_m >= s.arena.width_m
    if beside or top <= 0 or s.floor.bottom_m >= s.arena.height_m:
        field, size_m = ("left_m", s.arena.width_m) if beside else ("bottom_m", s.arena.height_m)
        raise InputError(
            f"at {getattr(s.floor, field):g} m the floor lies outside the arena of {stated(size_m)} m; no robot could "
            "sample a tile",
            field=f"floor.{field}",
        )


def _check_change(s: Sections) -> None:
    """Refuse changes to what is no floor of this size or of the sensor's kinds, and more than memory holds."""
    change = s.change
    if not change.is_given:
        return
    if s.floor.has_surface or any(kind_of_name(to) in VALUES for _, to in change.steps()):
        raise InputError(
            "is defined for kinds of tile, and not for floors of patches and values; leave it out",
            field="change",
        )
    floor = s.floor.placed_in(s.arena, 0, 0)  # seed 0, run 0: sizes and kinds are those of all runs
    tiles = floor.tiles
    if change.rate_per_h is not None:
        expected = tiles.size * change.rate_per_h * s.run.t_end_s / 3600.0
        if expected > MOST_CHANGES:
            raise InputError(
                f"{change.rate_per_h:g} makes some {expected:,.0f} changes of tiles in a run; at most {MOST_CHANGES:,}",
                field="change.rate_per_h",
            )
        if change.shares is not None and len(change.shares) > s.sensor.kinds:
            raise InputError(
                f"has shares of {len(change.shares)} kinds, and the sensor '{s.sensor.model}' knows {s.sensor.kinds}",
                field="change.shares",
            )
    else:
        kinds = change.changes(floor, s.arena.size_m, math.inf, 0, 0).kind
        if kinds.size and kinds.max() >= s.sensor.kinds:
            raise InputError(
                f"makes tiles of kind {kinds.max()}, and the sensor '{s.sensor.model}' knows {s.sensor.kinds} kinds, "
                "from 0",
                field="change.to",
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
            f"the sensor '{s.sensor.model}' reads classes from 0 to {s.sensor.readings - 1}, and never "
            f"{s.faults.stuck_class}",
            field="faults.stuck_class",
        )
    known: Strategy | None = s.strategy.entry
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
    _check_each,
    _check_places,
    _check_time,
    _check_signal,
    _check_sensor,
    _check_kinds,
    _check_boundary,
    _check_factors,
    _check_floor,
    _check_change,
    _check_asks_for_change,
    _check_network,
    _check_faults,
    _check_strategy,
)
