"""The fields of a scenario, section by section; what each is, its default and its bounds.

Every default is what the paper's simulations really did (preset ``paper``). Units stand in the names.
Field to paper:

| field | symbol | unit |
|---|---|---|
| walk.walk_duration_location_ms, walk.walk_duration_scale_ms | gamma_0, gamma | ms |
| walk.avoidance_threshold_mm | theta_c | mm |
| sample.sample_interval_ms | tau | ms |
| sensor.rms_threshold | theta_E | - |
| decision.credible_threshold, decision.min_observations | p_c, O_c | - |
| decision.decision_boundary | 0.5 in the paper | - |
| decision.boundary_of, decision.assumed_false_positive, decision.assumed_false_negative | not in the paper | - |
| strategy.soft.eta, strategy.soft.kappa | eta, kappa | - |
| robot.misalignment_min, robot.misalignment_max | m_d ~ U(min, max) | - |
| robot.speed_factor_shape, _scale, _location | s_d ~ Gamma(shape, scale) + location | - |
| sensor.edge_reach_m, sensor.edge_blur_m, sensor.tile_spread, sensor.robot_spread | not in the paper | m, m, -, - |
| robot.battery_life_s | b_d = 1 - t / battery_life_s | s |
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from vibroswarm.core.frozen_model import FrozenModel
from vibroswarm.core.ticks import tick_at
from vibroswarm.errors import named
from vibroswarm.floors.floor import DIGITS, Floor, as_levels
from vibroswarm.floors.source import is_generated, named_tiles
from vibroswarm.floors.surfaces import is_patches, named_patches
from vibroswarm.scenario.choices import Choice, NetworkChoice, StrategyChoice, TaskChoice
from vibroswarm.scenario.disturbance_fields import Change, Faults, MotionFaults
from vibroswarm.scenario.localisation_fields import Localisation, Odometry, PlaceMethod
from vibroswarm.sensors import known as known_sensors
from vibroswarm.sensors.confusion import Rates

# ``strict=False`` lets a tuple be given as a list, as TOML gives it; the models themselves are strict.
Length = Annotated[float, Field(gt=0, le=1e4)]
Duration = Annotated[float, Field(ge=0, le=1e9)]
Lengths = Annotated[
    tuple[Annotated[float, Field(ge=0, le=10)], ...], Field(min_length=1, max_length=10_000, strict=False)
]
Factors = Annotated[
    tuple[Annotated[float, Field(gt=0, le=100)], ...], Field(min_length=1, max_length=10_000, strict=False)
]
Bends = Annotated[
    tuple[Annotated[float, Field(gt=-1, lt=1)], ...], Field(min_length=1, max_length=10_000, strict=False)
]
RayList = Annotated[tuple[float, ...], Field(min_length=1, max_length=64, strict=False)]
Energies = Annotated[tuple[Annotated[float, Field(ge=0, le=1e9)], ...], Field(min_length=1, strict=False)]


LawDraws = Annotated[
    tuple[Annotated[tuple[float, ...], Field(min_length=10, max_length=10, strict=False)], ...],
    Field(min_length=2, max_length=1000, strict=False),
]


class Arena(FrozenModel):
    """The walls, a rectangle with its lower left corner at the origin."""

    width_m: Length = 1.0
    """Inner width, m."""
    height_m: Length = 1.0
    """Inner height, m."""

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height."""
        return self.width_m, self.height_m


ValueRow = Annotated[
    tuple[Annotated[float, Field(ge=0, le=1)], ...], Field(min_length=1, max_length=2000, strict=False)
]
"""Values of a row of tiles."""
TileRow = Annotated[str, Field(pattern="^[0-9a-f]+$")]
"""Kinds of a row of tiles."""


def rows_as_text(rows: Any) -> Any:
    """Return rows of kinds, such as those of ``read_tiles``, as text; all else as it is."""
    rows = rows.tolist() if isinstance(rows, np.ndarray) else rows
    digit_of = dict(enumerate(DIGITS))
    try:
        return ["".join(digit_of[kind] for kind in row) for row in rows]
    except (TypeError, KeyError):
        return rows


class FloorField(FrozenModel):
    """The tiles in the arena, and their position."""

    source: str = Field(default="random:0.48", min_length=1)
    """A pattern with its fill (``diagonal:0.46``), ``random:0.48``, ``random:0.4,0.36,0.24`` (shares of the kinds 0, 1
    and 2), ``patch:0.10``, or the name of the floor in ``tiles`` or ``values``."""
    rows: Annotated[int, Field(ge=1, le=2000)] = 5
    """Rows of a random floor."""
    columns: Annotated[int, Field(ge=1, le=2000)] = 5
    """Columns, likewise."""
    tiles: Annotated[tuple[TileRow, ...], Field(min_length=1, strict=False)] | None = None
    """The floor itself, one string of 0 and 1 per row, top row first (other kinds: 2 to 9 and a to f), or rows of
    numbers; it takes precedence over ``source``."""
    values: Annotated[tuple[ValueRow, ...], Field(min_length=1, strict=False)] | None = None
    """The floor as values from 0 (still) to 1 (vibrating), one row of numbers per row of tiles, in place of
    ``tiles``."""
    redraw: Literal["run", "study"] = "run"
    """Draw a random floor for each run, or once (that of run 0) for all."""
    image_threshold: Annotated[float, Field(gt=0, lt=1)] | None = None
    """Of a picture: share of full brightness from which a tile vibrates; if omitted, 0.5, or between two clear
    levels that are on one side of it."""
    tile_width_m: Length | None = None
    """Width of one tile; if omitted, the tiles are stretched over the arena."""
    tile_height_m: Length | None = None
    """Height of one tile; if omitted, likewise."""
    left_m: Annotated[float, Field(ge=-1e4, le=1e4)] = 0.0
    """The floor's left edge; parts outside the arena are cut off."""
    bottom_m: Annotated[float, Field(ge=-1e4, le=1e4)] = 0.0
    """The floor's lower edge."""

    @model_validator(mode="before")
    @classmethod
    def _with_name_and_text(cls, values: Any) -> Any:
        """Name tiles that have no name, in place of a random floor, and write rows of kinds as text."""
        if isinstance(values, dict) and (values.get("tiles") is not None or values.get("values") is not None):
            return {"source": "tiles"} | values | {"tiles": rows_as_text(values.get("tiles"))}
        return values

    @property
    def drawn_by_run(self) -> bool:
        """Whether a new floor is drawn for each run."""
        return self.is_named and self.redraw == "run" and is_generated(self.source)

    @property
    def is_named(self) -> bool:
        """Whether ``source`` says which floor it is, and neither tiles nor values are given."""
        return self.tiles is None and self.values is None

    @property
    def has_surface(self) -> bool:
        """Whether the floor has values of tiles, or patches."""
        return self.values is not None or (self.tiles is None and is_patches(self.source))

    def placed_in(self, arena: Arena, seed: int, run: int) -> Floor:
        """Return the floor of ``run`` in an arena: a fixed floor, or the random floor of (seed, run)."""
        # With redraw = "study" all runs share the floor of run 0.
        run = run if self.redraw == "run" else 0
        levels = self.levels_for(seed, run)
        rows, columns = levels.shape
        width_m, height_m = (
            self.tile_width_m or arena.width_m / columns,
            self.tile_height_m or arena.height_m / rows,
        )
        floor = Floor(levels, width_m, height_m, self.left_m, self.bottom_m, self.source)
        if not (self.is_named and is_patches(self.source)):
            return floor
        patches = named_patches(self.source, floor.box_within(*arena.size_m), seed, run)
        return replace(floor, patches=patches)

    def levels_for(self, seed: int, run: int) -> NDArray[Any]:
        """Return the levels of the tiles of (seed, run), (rows, columns), top row first."""
        given = self.values or [[int(tile, 16) for tile in row] for row in self.tiles or ()]
        if given:
            with named("floor.tiles" if self.values is None else "floor.values"):
                return as_levels(given)
        return named_tiles(self.source, self.rows, self.columns, seed, run)


class Swarm(FrozenModel):
    """Number of robots, and their start."""

    robots: Annotated[int, Field(ge=1, le=10_000)] = 5
    """Number of robots."""
    start_margin_m: Annotated[float, Field(ge=0, le=1e4)] = 0.05
    """Centres start uniformly at least this far from the walls, and never nearer than the body allows."""


class Robot(FrozenModel):
    """The body and its imperfections, fitted to the simulator's logs."""

    body_radius_m: Annotated[float, Field(ge=1e-4, le=10)] = 0.015
    """Bodies are discs of this radius to each other and to walls."""
    full_speed_m_s: Annotated[float, Field(gt=0, le=10)] = 0.0549
    """Speed at full command (55 mm/s nominal)."""
    drive_track_m: Annotated[float, Field(ge=1e-4, le=10)] = 0.0394
    """Wheel distance that determines the veer when driving."""
    turn_track_m: Annotated[float, Field(ge=1e-4, le=10)] = 0.046
    """Wheel distance that determines the turn rate in place."""
    misalignment_min: Annotated[float, Field(gt=-1, lt=1)] = -0.1
    """m_d ~ U(min, max), one per robot: left wheel 1 - m_d, right wheel 1 + m_d."""
    misalignment_max: Annotated[float, Field(gt=-1, lt=1)] = 0.1
    """Upper end of that range."""
    misalignments: Bends | None = None
    """m_d per robot, instead of drawing it; the list repeats. None in the paper."""
    misalignment_wander: Annotated[float, Field(gt=0, le=0.2)] | None = None
    """Variation from sample to sample: standard deviation of a triangular number of mean 0 that is added to m_d at
    every sample. If omitted (the paper), none; likewise the next two."""
    misalignment_drift: Annotated[float, Field(gt=0, le=0.2)] | None = None
    """Slow variation: standard deviation over a run of a number added to m_d, which changes linearly between values
    drawn every ``misalignment_drift_samples`` samples."""
    misalignment_drift_samples: Annotated[int, Field(ge=1, le=100_000)] | None = None
    """Samples between these values; if omitted, 30."""
    misalignment_run_spread: Annotated[float, Field(gt=0, le=0.2)] | None = None
    """Variation from run to run, as between days: standard deviation of a number added to each m_d once per run."""
    speed_factor_shape: Annotated[float, Field(ge=1e-6, le=1e6)] = 3.1
    """s_d ~ Gamma(shape, scale) + location, clipped."""
    speed_factor_scale: Annotated[float, Field(gt=0, le=1e3)] = 0.095
    """Its scale."""
    speed_factor_location: Annotated[float, Field(ge=-100, le=100)] = 0.8
    """Its shift."""
    speed_factor_min: Annotated[float, Field(gt=0, le=100)] = 0.9
    """Lower clip of s_d."""
    speed_factor_max: Annotated[float, Field(gt=0, le=100)] = 1.5
    """Upper clip of s_d."""
    speed_redraw: Literal["sample", "robot"] = "sample"
    """Draw s_d at every sample (as in the simulations) or once per robot (as in the text)."""
    speed_factors: Factors | None = None
    """s_d per robot, instead of drawing it (``speed_redraw`` must be "robot"); the list repeats."""
    speed_wander: Annotated[float, Field(gt=0, le=0.4)] | None = None
    """Variation from sample to sample: s_d is also multiplied by a triangular factor of mean 1 and this standard
    deviation, drawn at every sample; the product is clipped too. If omitted (the paper), it is not."""
    speed_run_spread: Annotated[float, Field(gt=0, le=0.4)] | None = None
    """Variation from run to run: likewise, by a factor drawn once per robot and run."""
    battery_life_s: Annotated[float, Field(gt=0, le=1e12)] = 8400.0
    """Battery factor is 1 - t / battery_life_s, updated at samples."""


class Rays(FrozenModel):
    """The three distance sensors. They start ahead of the centre and detect walls and other robots' discs."""

    forward_m: Annotated[float, Field(ge=0, le=10)] = 0.008
    """Distance of the rays' starts ahead of the centre."""
    forward_each_m: Lengths | None = None
    """The same per robot, instead; the list repeats. None in the paper."""
    side_m: RayList = (0.0, 0.0075, -0.0075)
    """Distance of their starts to the left, one entry per ray."""
    angle_deg: RayList = (0.0, 27.0, -27.0)
    """Their directions, anticlockwise from ahead, one entry per ray."""
    range_m: Annotated[float, Field(gt=0, le=100)] = 0.15
    """Range of the rays."""
    disc_radius_m: Annotated[float, Field(ge=0, le=10)] = 0.0055
    """Radius of other robots as the rays detect them."""
    noise_m: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Standard deviation of the shortest ray as a robot measures it when an avoidance begins, to find its place;
    ``localisation.ray_noise_m`` is what it assumes. It changes no motion."""


class Walk(FrozenModel):
    """The random walk and the turns."""

    walk_duration_law: Literal["exponential"] | None = None
    """Distribution of leg times; if omitted (the paper), Cauchy."""
    walk_duration_location_ms: Annotated[float, Field(ge=0, le=1e9)] = 7860.0
    """gamma_0: location of this distribution; of an exponential one the shortest."""
    walk_duration_scale_ms: Annotated[float, Field(ge=0, le=1e9)] = 10725.0
    """gamma: its scale; of an exponential one the mean above the shortest."""
    leg_min_ms: Duration = 1000.0
    """Lower clip of leg times."""
    leg_max_ms: Duration = 30_000.0
    """Upper clip of leg times."""
    turn_max_deg: Annotated[float, Field(gt=0, le=180)] = 180.0
    """Turns are uniform between minus and plus this."""
    avoidance_threshold_mm: Annotated[float, Field(ge=0, le=1e5)] = 55.0
    """theta_c: a ray shorter than this starts an avoidance turn."""
    turn_gain_percent_per_deg: Annotated[float, Field(gt=0, le=1e4)] = 2.5
    """Command of a turn: this times the angle still to turn,"""
    turn_integral_gain_percent_per_deg_s: Annotated[float, Field(ge=0, le=1e4)] = 0.15
    """plus this times its integral over time."""
    turn_tolerance_deg: Annotated[float, Field(gt=0, le=90)] = 2.5
    """A turn is done when at most this angle is left."""
    blind_after_turn_ms: Annotated[float, Field(gt=0, le=60_000)] | None = None
    """How long the robot ignores its rays after a turn; if omitted (the paper), it never does."""


class Sample(FrozenModel):
    """When a robot stops to sample, and for how long."""

    sample_interval_ms: Annotated[float, Field(ge=0, le=1e9)] = 3778.0
    """tau: a sample is due when the timer exceeds it."""
    stop_ms: Annotated[float, Field(ge=0, le=1e9)] = 1000.0
    """How long the robot stands before the sample is taken."""
    signal_ms: Annotated[float, Field(gt=0, le=1e9)] | None = None
    """How long the accelerometer is read, at the end of the stop; if omitted, 500 ms, or half the stop if that is
    shorter. It counts in exported robots and recorded acceleration; simulated energies are drawn."""
    timer: Literal[
        "reset_after_turn", "hold_in_turn", "always", "frozen_in_avoidance", "reset_at_avoidance", "held_at_avoidance"
    ] = "reset_after_turn"  # fmt: skip
    """The timer counts driving and avoiding. In a turn at the end of a leg it pauses and then restarts from 0
    (``reset_after_turn``), pauses (``hold_in_turn``) or counts (``always``, as in the text). Or, like the first, but in
    avoidance it pauses (``frozen_in_avoidance``), restarts from 0 (``reset_at_avoidance``) or stays at 0
    (``held_at_avoidance``, as in older experiments)."""
    interrupts_avoidance: bool = True
    """Whether a due sample may interrupt an avoidance turn, which then resumes."""


class Sensor(Choice):
    """The reading of a sample: an energy E (RMS of the filtered acceleration) and the bit O = (E > theta_E)."""

    kind = "sensor"
    selector = "model"
    known = staticmethod(known_sensors)
    model: str = "gamma"
    """Energies are drawn from Gamma distributions (gamma) or measured values (energies), or computed from the
    acceleration that a robot feels (acceleration); or kinds of tile are read by a table (confusion)."""
    rms_threshold: Annotated[float, Field(ge=0, le=1e9)] = 1.33
    """theta_E: a sample reads as vibrating when E exceeds it."""
    vibrating_shape: Annotated[float, Field(ge=1e-6, le=1e6)] = 5.33497
    """E on a vibrating tile ~ Gamma(shape, scale) + location."""
    vibrating_scale: Annotated[float, Field(gt=0, le=1e6)] = 0.5132
    """Its scale."""
    vibrating_location: Annotated[float, Field(ge=-1e6, le=1e6)] = -0.2001
    """Its shift."""
    still_shape: Annotated[float, Field(ge=1e-6, le=1e6)] = 2.52194
    """E on a still tile ~ Gamma(shape, scale) + location."""
    still_scale: Annotated[float, Field(gt=0, le=1e6)] = 0.28754
    """Its scale."""
    still_location: Annotated[float, Field(ge=-1e6, le=1e6)] = 0.13731
    """Its shift."""
    vibrating_energies: Energies | None = None
    """Measured energies of vibrating tiles, for model = "energies"."""
    still_energies: Energies | None = None
    """Measured energies of still tiles."""
    # If only one of these two is omitted, it is 0 (``observation.edge_response``).
    edge_reach_m: Annotated[float, Field(ge=-1, le=1)] | None = None
    """How far vibrating tiles reach beyond their edges: at that distance every second sample reads as on the tile. If
    this and ``edge_blur_m`` are omitted (the paper), a sample reads the tile under the centre."""
    edge_blur_m: Annotated[float, Field(ge=0, le=1)] | None = None
    """How gradual that is: standard deviation of that distance, m."""
    tile_spread: Annotated[float, Field(gt=0, le=2)] | None = None
    """Differences between tiles: energies are multiplied by a log-normal factor of mean 1, with this standard deviation
    of its logarithm, drawn per tile and run (per study with ``floor.redraw = "study"``)."""
    robot_spread: Annotated[float, Field(gt=0, le=2)] | None = None
    """Differences between the robots' sensors, likewise per robot and run."""
    claimed_rates: Rates | None = None
    """What robots believe of their sensor: a row for each kind of tile, with the share of samples that read as each
    class. If omitted, they know the true ones. It changes no reading."""

    @property
    def params(self) -> Any:
        """Parameters of the selected sensor: its table, or this section, of which they are fields."""
        table = self if self.entry.in_section else self.table(self.model)
        return (
            table.model_copy(update={"rms_threshold": self.rms_threshold})
            if self.entry.has_threshold and table is not self
            else table
        )

    @property
    def kinds(self) -> int:
        """Number of kinds of tile that the sensor has a law for."""
        return int(self.entry.number_of("kinds", self.params))

    @property
    def readings(self) -> int:
        """Number of classes of the readings."""
        return int(self.entry.number_of("readings", self.params))


class Decision(FrozenModel):
    """When a robot decides."""

    decision_boundary: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """The question: does more than this share vibrate?"""
    boundary_of: Literal["tiles", "readings"] = "readings"
    """"readings": robots test the share of ones against the boundary itself, as the study did, which is right only if
    the sensor's errors balance there. "tiles": they test it against the share of ones expected of a floor at the
    boundary, given the error rates that they assume."""
    assumed_false_positive: Annotated[float, Field(ge=0, lt=1)] | None = None
    """For "tiles": share of samples at still places that robots expect to read as vibrating. If omitted, the true rate,
    averaged over uniformly random places, edges included."""
    assumed_false_negative: Annotated[float, Field(ge=0, lt=1)] | None = None
    """For "tiles": share of samples on vibrating tiles that they expect to read as still; likewise."""
    credible_threshold: Annotated[float, Field(ge=0.5, lt=1)] = 0.95
    """p_c: a robot decides when its belief p, or 1 - p, exceeds this."""
    min_observations: Annotated[int, Field(ge=0, le=10**9)] = 381
    """O_c: strictly more observations are needed to decide."""
    # "total": own readings and those received; ``strategies.bayes.enough`` counts them.
    gate: Literal["total", "received", "own"] = "total"
    """Which observations count towards ``min_observations``."""
    gate_counts_current: bool = False
    """Whether the current sample counts."""
    revise: bool = False
    """Whether a robot may change its decision, under ``soft``, ``dirichlet_soft``, ``forget``, ``reset`` and
    ``fading``."""
    prior_alpha: Annotated[int, Field(ge=1, le=10**6)] = 1
    """The prior is Beta(prior_alpha, prior_beta)."""
    prior_beta: Annotated[int, Field(ge=1, le=10**6)] = 1
    """Its second parameter."""
    hold_s: Annotated[float, Field(ge=0, le=1e7)] = 30.0
    """For strategies of yours that decide by opinions (``decides="opinion"``): the swarm has decided when all have
    agreed for this long, s."""


class CameraField(FrozenModel):
    """How a camera saw the robots of the recordings that a scenario was fitted to, if it saw them displaced.

    No simulation depends on it; ``calibrate compare`` applies it to simulated positions.
    """

    magnification: Annotated[float, Field(gt=0.5, lt=2)] | None = None
    """Distance from the arena's centre as seen, relative to the true one; if omitted, 1."""
    shift_x_m: Annotated[float, Field(ge=-1, le=1)] | None = None
    """How far to the right robots are seen, in addition; if omitted, 0."""
    shift_y_m: Annotated[float, Field(ge=-1, le=1)] | None = None
    """How far up; if omitted, 0."""


class LawField(FrozenModel):
    """How sure the sensor's law is, if it was fitted to recordings (``lab threshold --law``), and to which.

    No simulation depends on it; ``inspect`` draws damage from these laws, and warns of a session that judges itself.
    """

    sessions: Annotated[tuple[str, ...], Field(min_length=1, max_length=10_000, strict=False)] | None = None
    """A hash of the values of each session."""
    draws: LawDraws | None = None
    """Laws of resampled sessions, a row each: the sensor's vibrating_shape, vibrating_scale, vibrating_location,
    still_shape, still_scale, still_location, edge_reach_m, edge_blur_m, tile_spread and robot_spread."""


class Run(FrozenModel):
    """Duration and time step."""

    t_end_s: Annotated[float, Field(gt=0, le=1e7)] = 1200.0
    """End of the run."""
    stop: Literal["t_end", "all_decided"] = "t_end"
    """Run to the end, or until all robots have decided (which biases motion statistics)."""
    control_period_ms: Annotated[int, Field(ge=1, le=10_000)] = 20
    """Period at which the robot reads clock, gyro and rays."""


class Sections(FrozenModel):
    """All sections of a scenario."""

    arena: Arena = Arena()
    floor: FloorField = FloorField()
    swarm: Swarm = Swarm()
    robot: Robot = Robot()
    rays: Rays = Rays()
    walk: Walk = Walk()
    sample: Sample = Sample()
    odometry: Odometry = Odometry()
    localisation: Localisation = Localisation()
    sensor: Sensor = Sensor()
    strategy: StrategyChoice = StrategyChoice()
    decision: Decision = Decision()
    network: NetworkChoice = NetworkChoice()
    faults: Faults = Faults()
    change: Change = Change()
    task: TaskChoice = TaskChoice()
    camera: CameraField = CameraField()
    law: LawField = LawField()
    run: Run = Run()

    @property
    def tick_s(self) -> float:
        """The control period, s."""
        return self.run.control_period_ms / 1000.0

    @property
    def place_method(self) -> PlaceMethod:
        """How robots find their places: ``localisation.method``, or what its default "auto" means here."""
        method = self.localisation.method
        return method if method != "auto" else "mixture" if self.strategy.reads_places else "true"

    @property
    def reads_true_places(self) -> bool:
        """Whether the strategy reads places, and they are the true ones, which no real robot knows."""
        return self.strategy.reads_places and self.place_method == "true"

    @property
    def motion_rays(self) -> Rays:
        """The section ``rays`` without the noise, which changes no motion."""
        return self.rays.model_copy(update={"noise_m": 0.0})

    @property
    def motion_faults(self) -> MotionFaults:
        """The part of the section ``faults`` that changes motion."""
        return self.faults.of_motion

    @property
    def ticks(self) -> int:
        """Number of control periods that begin before the end."""
        return tick_at(self.run.t_end_s, self.run.control_period_ms)
