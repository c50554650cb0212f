"""The fields of odometry and localisation: what robots measure of their moves, and where they believe they are.

| field | symbol | unit |
|---|---|---|
| odometry.gyro_scale_spread, odometry.gyro_bias_spread_deg_s | not in the paper | -, deg/s |
| odometry.turn_noise_deg, odometry.gyro_walk_deg_sqrt_s | not in the paper | deg, deg/sqrt(s) |
| localisation.assumed_speed_factor | mean of s_d | - |
"""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal, NamedTuple

from pydantic import Field, field_validator

from vibroswarm.core.frozen_model import FrozenModel


class GyroErrors(NamedTuple):
    """Standard deviations of a gyro's errors."""

    scale: float
    """Of its scale about 1, one a robot and run."""
    bias_deg_s: float
    """Of its bias, one a robot and run, deg/s."""
    turn_deg: float
    """Of each turn in place, deg."""
    walk_deg_sqrt_s: float
    """Of the angle, growing with the square root of the time that the robot moves, deg/sqrt(s)."""


GYRO_LEVELS: Final = {
    "good": GyroErrors(0.01, 0.05, 0.5, 0.1),
    "poor": GyroErrors(0.03, 0.2, 2.0, 0.3),
    "bought": GyroErrors(0.03, 20.0, 2.0, 0.3),
}
"""Errors of each level; ``Odometry.level`` describes the levels."""
Level = Literal["good", "poor", "bought"]

PlaceMethod = Literal["true", "mixture", "kalman", "dead_reckoning"]
"""How robots find their places; see ``Localisation.method``."""


class Odometry(FrozenModel):
    """What robots measure of their own moves: times exactly, turns by a gyro with errors. It changes no motion."""

    level: Level = "good"
    """The gyro's errors: "good" is 1 % of scale, 0.05 deg/s of bias, 0.5 deg a turn and 0.1 deg/sqrt(s) of random walk
    (standard deviations; presumes a calibration of each robot), "poor" 3 %, 0.2 deg/s, 2 deg and 0.3 deg/sqrt(s),
    "bought" as "poor" but for a bias of 20 deg/s, which only ``rezero_noise_deg_s`` makes of use."""
    gyro_scale_spread: Annotated[float, Field(ge=0, le=0.5)] | None = None
    """Standard deviation of the gyro's scale about 1, one a robot and run; if omitted, that of ``level``. This and
    the next three are for the data sheet of your own gyro."""
    gyro_bias_spread_deg_s: Annotated[float, Field(ge=0, le=100)] | None = None
    """Standard deviation of its bias, one a robot and run, deg/s; likewise."""
    turn_noise_deg: Annotated[float, Field(ge=0, le=90)] | None = None
    """Standard deviation of the error of each turn in place, deg; likewise."""
    gyro_walk_deg_sqrt_s: Annotated[float, Field(ge=0, le=100)] | None = None
    """Random walk of the angle while the robot moves, deg per square root of a second; likewise."""

    rezero_noise_deg_s: Annotated[float, Field(ge=0, le=100)] | None = None
    """Standard deviation of the bias as a robot measures it at its start and at each sample, deg/s; it subtracts the
    mean of these. If omitted, it measures none."""

    @property
    def errors(self) -> GyroErrors:
        """The gyro's errors: the fields that are given, and those of ``level`` for the others."""
        given = (  # in the order of GyroErrors
            self.gyro_scale_spread,
            self.gyro_bias_spread_deg_s,
            self.turn_noise_deg,
            self.gyro_walk_deg_sqrt_s,
        )
        own = zip(given, GYRO_LEVELS[self.level], strict=True)
        return GyroErrors(*(default if value is None else value for value, default in own))


class Localisation(FrozenModel):
    """Where robots believe they are, for strategies that read places."""

    method: Literal["auto", "mixture", "true", "kalman", "dead_reckoning"] = "auto"
    """"mixture": each robot estimates its place from its moves and rays. "true": robots know their true places, which
    no real robot does: an upper bound. "auto": "mixture" if the strategy reads places, else "true". For comparison,
    "kalman": one component; "dead_reckoning": from moves alone."""
    components: Annotated[int, Field(ge=1, le=1000)] = 16
    """Components of the mixture."""
    lag: Annotated[int, Field(ge=1, le=24)] = 4
    """A sample's place is smoothed by what the robot meets until its next ``lag`` samples."""
    start_spread_m: Annotated[float, Field(ge=0, le=10)] = 0.005
    """Standard deviation of the starting place that a robot presumes, in x and in y."""
    start_heading_spread_deg: Annotated[float, Field(ge=0, le=180)] = 2.0
    """Standard deviation of the heading that it presumes at the start, deg."""
    assumed_level: Level | None = None
    """The odometry's level that robots assume; if omitted, they know its true errors."""
    assumed_speed_factor: Annotated[float, Field(gt=0, le=100)] | None = None
    """Mean of the speed factor s_d that robots assume. If omitted, they know its law, also beside
    ``robot.speed_factors``: no robot knows its own."""
    assumed_speed_spread: Annotated[float, Field(ge=0, le=10)] | None = None
    """Standard deviation of s_d that they assume; likewise."""
    ray_noise_m: Annotated[float, Field(gt=0, le=1)] = 0.004
    """Standard deviation of the shortest ray at a wall that they assume."""
    monitor: bool = True
    """Whether a robot that meets more than it expects states wider spreads of its places, and looks for itself further
    away. With "dead_reckoning" it meets nothing."""

    @field_validator("method", mode="before")
    @classmethod
    def _true_as_text(cls, method: Any) -> Any:
        """Take the truth value, which is what ``--set localisation.method=true`` gives, for the text "true"."""
        return "true" if method is True else method
