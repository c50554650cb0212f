"""Fields of a scenario by their kind, and a good other value of each. A test registers the task ``another_task``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal, get_args, get_origin

from vibroswarm.scenario.plugins import field_of
from vibroswarm.scenario.scenario import Scenario, field_types, value_of

DEFAULT = Scenario()


@contextmanager
def named(name: str, value: Any) -> Iterator[None]:
    """Name field and value in whatever fails."""
    try:
        yield
    except BaseException as error:
        error.add_note(f"with {name} = {value!r}")
        raise


def default(name: str) -> Any:
    return value_of(DEFAULT, name)


def annotation(name: str) -> Any:
    return field_types()[name]


FLOATS = [name for name in field_types() if isinstance(default(name), float)]
INTS = [name for name in field_types() if type(default(name)) is int]
FLAGS = [name for name in field_types() if isinstance(default(name), bool)]
WORDS = [name for name in field_types() if get_origin(annotation(name)) is Literal]
OTHERS = {
    "task.name": "another_task",
    "floor.source": "stripe:0.46",
    "floor.tiles": ("101", "010"),
    "floor.values": ((0.0, 0.5), (1.0, 0.25)),
    "floor.image_threshold": 0.4,
    "floor.tile_width_m": 0.1,
    "floor.tile_height_m": 0.1,
    "sensor.model": "energies",
    "sensor.confusion.kinds": 2,
    "sensor.confusion.rates": ((0.9, 0.1), (0.3, 0.7)),
    "sensor.acceleration.motor_hz": (150.0,),
    "sensor.acceleration.amplitude_shares": (0.8,),
    "sensor.acceleration.cutoff_hz": 40.0,
    "sensor.acceleration.features": ("peak_hz",),
    "sensor.vibrating_energies": (1.0, 2.0),
    "sensor.still_energies": (0.5,),
    "robot.speed_wander": 0.06,
    "sensor.claimed_rates": ((0.9, 0.1), (0.2, 0.8)),
    "sensor.edge_reach_m": 0.01,
    "sensor.edge_blur_m": 0.02,
    "sensor.tile_spread": 0.2,
    "sensor.robot_spread": 0.1,
    "robot.misalignments": (0.01, -0.02),
    "robot.speed_factors": (1.0, 1.2),
    "task.share.kind": 0,
    "faults.stuck_class": 1,
    "task.costs": ((0.0, 1.0), (4.0, 0.0)),
    "robot.misalignment_wander": 0.02,
    "robot.misalignment_drift": 0.01,
    "robot.misalignment_drift_samples": 20,
    "robot.misalignment_run_spread": 0.01,
    "robot.speed_run_spread": 0.02,
    "rays.forward_each_m": (0.01, 0.02),
    "walk.walk_duration_law": "exponential",
    "walk.blind_after_turn_ms": 100.0,
    "sample.signal_ms": 400.0,
    "odometry.gyro_scale_spread": 0.02,
    "odometry.gyro_bias_spread_deg_s": 0.1,
    "odometry.turn_noise_deg": 1.0,
    "odometry.gyro_walk_deg_sqrt_s": 0.2,
    "odometry.rezero_noise_deg_s": 0.5,
    "localisation.assumed_level": "poor",
    "localisation.assumed_speed_factor": 1.0,
    "localisation.assumed_speed_spread": 0.1,
    "decision.assumed_false_positive": 0.1,
    "decision.assumed_false_negative": 0.2,
    "rays.side_m": (0.0, 0.007, -0.0075),
    "rays.angle_deg": (0.0, 27.0, -28.0),
    "change.at_s": (100.0,),
    "change.to": ("redraw",),
    "change.rate_per_h": 3.0,
    "change.shares": (0.4, 0.6),
    "camera.magnification": 1.03,
    "camera.shift_x_m": 0.003,
    "camera.shift_y_m": -0.006,
    "law.sessions": ("0123456789abcdef",),
    "law.draws": ((3.5, 0.7, 0.2, 3.8, 0.1, 0.2, 0.01, 0.01, 0.1, 0.1),) * 2,
    "strategy.name": "soft",
    "network.name": "loss",
    "network.range.range_m": 0.7,
    "network.tree.message_bytes": 100,
    "network.tree.log_bytes": 100,
}
MODEL: dict[str, Any] = {"sensor.vibrating_energies": [1.0, 2.0], "sensor.still_energies": [0.5]}


def another(name: str) -> Any:
    """A good value that is not the default."""
    if name in OTHERS:
        return OTHERS[name]
    if name in FLAGS:
        return not default(name)
    if name in WORDS:
        return next(word for word in get_args(annotation(name)) if word != default(name))
    if name in INTS:
        return default(name) + 20
    return default(name) * 0.999 if default(name) else 1e-3


def chosen(kind: str, entry: str) -> dict[str, Any]:
    """Values that select an entry; beside a sensor of several kinds, a strategy, a task and a floor that go with it."""
    of_kinds = {
        "strategy.name": "dirichlet",
        "task.name": "majority",
        "floor.source": "ours",
        "floor.tiles": ["01", "10"],
    }
    return {field_of(kind): entry} | (of_kinds if kind == "sensor" else {})


def before(name: str) -> Scenario:
    """A scenario in which a field matters, and has its default or another value than ``another``."""
    inverted = {"change.at_s": (50.0,), "change.to": ("invert",)}
    needed = {
        "sensor.model": MODEL,
        "robot.speed_factors": {"robot.speed_redraw": "robot"},
        "change.at_s": inverted,
        "change.to": inverted,
        "change.shares": {"change.rate_per_h": 2.0},
    }
    part = name.split(".")
    if len(part) == 3:  # a parameter matters where its table is the chosen one
        needed[name] = chosen(part[0], part[1])
    if name in ("strategy.reset.tells_change", "strategy.reset.tells_anew"):
        needed[name] = {"strategy.name": "reset", "task.name": "share"}
    if name.startswith("task.share."):
        needed[name] = {"task.name": "share", "strategy.name": "averaging"}
    if name.startswith("task.changed."):
        needed[name] = {
            "task.name": "changed",
            "strategy.name": "reset",
            "strategy.reset.tells_change": True,
            "strategy.reset.tells_anew": True,
        }
    return Scenario().with_values(needed.get(name, {}))


def changed(name: str) -> Scenario:
    return before(name).with_values({name: another(name)})
