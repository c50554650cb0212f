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

from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_serializer,
    model_validator,
)

from vibroswarm import code_files
from vibroswarm.errors import InputError, nearest, shown
from vibroswarm.floors.floor import Floor, as_tiles
from vibroswarm.floors.source import is_random, named_tiles
from vibroswarm.networks import known as known_networks
from vibroswarm.strategies import known as known_strategies
from vibroswarm.tasks import known as known_tasks

Length = Annotated[float, Field(gt=0, le=1e4)]
Share = Annotated[float, Field(ge=0, le=1)]
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


UNNAMED = "tiles"
"""The name of a floor whose tiles are given without one."""


class Section(BaseModel):
    """Frozen and strict: an unknown key, a wrong type, NaN and infinity are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @field_validator("*")
    @classmethod
    def _one_zero(cls, value: object) -> object:
        """-0.0 is 0.0: scenarios that are equal are written alike and have one hash."""
        return value + 0.0 if isinstance(value, float) else value


class Arena(Section):
    """The walls, a rectangle with its lower left corner at the origin."""

    width_m: Length = 1.0
    """Inner width, m."""
    height_m: Length = 1.0
    """Inner height, m."""


class FloorField(Section):
    """Which tiles lie in the arena, and where."""

    source: str = Field(default="random:0.48", min_length=1)
    """A pattern with its fill (``diagonal:0.46``), ``random:0.48``, or the name of the floor in ``tiles``."""
    rows: Annotated[int, Field(ge=1, le=2000)] = 5
    """Rows of a random floor; a pattern and `tiles` have their own."""
    columns: Annotated[int, Field(ge=1, le=2000)] = 5
    """Columns of a random floor."""
    tiles: Annotated[tuple[str, ...], Field(min_length=1, strict=False)] | None = None
    """The floor itself, one string of 0 and 1 a row, top row first; goes before ``source``."""
    redraw: Literal["run", "study"] = "run"
    """A random floor is drawn anew for each run, or once (that of run 0) for all."""
    tile_width_m: Length | None = None
    """Width of one tile; without it the tiles are stretched over the arena."""
    tile_height_m: Length | None = None
    """Height of one tile, likewise."""
    left_m: Annotated[float, Field(ge=-1e4, le=1e4)] = 0.0
    """The floor's left edge in the arena; what lies outside the arena is cut off."""
    bottom_m: Annotated[float, Field(ge=-1e4, le=1e4)] = 0.0
    """The floor's lower edge."""

    @model_validator(mode="before")
    @classmethod
    def _named(cls, values: Any) -> Any:
        """Tiles without a name are not called after the random floor that is the default."""
        if isinstance(values, dict) and values.get("tiles") is not None and "source" not in values:
            return values | {"source": UNNAMED}
        return values

    @property
    def drawn_by_run(self) -> bool:
        """Whether each run has a floor of its own."""
        return self.tiles is None and self.redraw == "run" and is_random(self.source)

    def laid(self, arena: Arena, seed: int, run: int) -> Floor:
        """The floor of ``run`` in an arena: always the same, or a random one of (seed, run)."""
        tiles, name = self.tiles_for(seed, run if self.redraw == "run" else 0)
        rows, columns = tiles.shape
        width_m, height_m = (
            self.tile_width_m or arena.width_m / columns,
            self.tile_height_m or arena.height_m / rows,
        )
        return Floor(tiles, width_m, height_m, self.left_m, self.bottom_m, name)

    def tiles_for(self, seed: int, run: int) -> tuple[NDArray[np.uint8], str]:
        """The tiles of ``run``, (rows, columns), and their name."""
        if self.tiles is not None:
            if len({len(row) for row in self.tiles}) > 1:
                raise InputError("the rows are not of one length", field="floor.tiles")
            if set("".join(self.tiles)) - {"0", "1"}:
                raise InputError("a row is a string of 0 and 1", field="floor.tiles")
            return as_tiles([[int(tile) for tile in row] for row in self.tiles]), self.source
        return named_tiles(self.source, self.rows, self.columns, seed, run), self.source


class Swarm(Section):
    """How many robots, and where they start."""

    robots: Annotated[int, Field(ge=1, le=10_000)] = 5
    """Number of robots."""
    start_margin_m: Annotated[float, Field(ge=0, le=1e4)] = 0.05
    """Centres start uniform in the arena less this margin (never nearer to a wall than the body allows)."""


class Robot(Section):
    """The body and its imperfections, fitted to the simulator's logs."""

    body_radius_m: Annotated[float, Field(ge=1e-4, le=10)] = 0.015
    """Bodies are discs of this radius to each other and to walls."""
    full_speed_m_s: Annotated[float, Field(gt=0, le=10)] = 0.0549
    """Speed at full command (55 mm/s nominal)."""
    drive_track_m: Annotated[float, Field(ge=1e-4, le=10)] = 0.0394
    """Distance of the wheels that gives the veer when driving."""
    turn_track_m: Annotated[float, Field(ge=1e-4, le=10)] = 0.046
    """Distance of the wheels that gives the turn rate in place."""
    misalignment_min: Annotated[float, Field(gt=-1, lt=1)] = -0.1
    """m_d ~ U(min, max), one a robot: left wheel 1 - m_d, right wheel 1 + m_d."""
    misalignment_max: Annotated[float, Field(gt=-1, lt=1)] = 0.1
    """Its upper end."""
    misalignments: Bends | None = None
    """m_d robot by robot, in place of the draw; beyond the last it begins again. None in the paper."""
    speed_factor_shape: Annotated[float, Field(ge=1e-6, le=1e6)] = 3.1
    """s_d ~ Gamma(shape, scale) + location, clipped."""
    speed_factor_scale: Annotated[float, Field(gt=0, le=1e3)] = 0.095
    """Its scale."""
    speed_factor_location: Annotated[float, Field(ge=-100, le=100)] = 0.8
    """Its shift."""
    speed_factor_min: Annotated[float, Field(gt=0, le=100)] = 0.9
    """It is clipped to at least this."""
    speed_factor_max: Annotated[float, Field(gt=0, le=100)] = 1.5
    """It is clipped to at most this."""
    speed_redraw: Literal["sample", "robot"] = "sample"
    """Whether s_d is drawn anew at every sample (what ran) or once a robot (the text)."""
    speed_factors: Factors | None = None
    """s_d robot by robot, in place of the draw (``speed_redraw`` must be "robot"); beyond the last it begins again."""
    speed_wander: Annotated[float, Field(gt=0, le=0.4)] | None = None
    """A robot's speed wanders about its own: s_d is also multiplied by a factor drawn at every sample, triangular of
    mean 1 with this standard deviation; the product is clipped too. Without it (the paper) it does not."""
    battery_life_s: Annotated[float, Field(gt=0, le=1e12)] = 8400.0
    """Battery factor is 1 - t / this, updated at samples."""


class Rays(Section):
    """The three distance sensors. They start ahead of the centre and see walls and other robots' discs."""

    forward_m: Annotated[float, Field(ge=0, le=10)] = 0.008
    """Rays start so far ahead of the centre."""
    forward_each_m: Lengths | None = None
    """The same robot by robot, in its place; beyond the last it begins again. None in the paper."""
    side_m: RayList = (0.0, 0.0075, -0.0075)
    """And so far to the left, one entry a ray."""
    angle_deg: RayList = (0.0, 27.0, -27.0)
    """Their directions, anticlockwise from ahead, one entry a ray."""
    range_m: Annotated[float, Field(gt=0, le=100)] = 0.15
    """They see nothing beyond."""
    disc_radius_m: Annotated[float, Field(ge=0, le=10)] = 0.0055
    """Radius of other robots as the rays see them."""


class Walk(Section):
    """The random walk and the turns."""

    walk_duration_location_ms: Annotated[float, Field(ge=0, le=1e9)] = 7860.0
    """gamma_0: location of the Cauchy distribution of leg times."""
    walk_duration_scale_ms: Annotated[float, Field(ge=0, le=1e9)] = 10725.0
    """gamma: its scale."""
    leg_min_ms: Duration = 1000.0
    """Leg times are clipped to at least this."""
    leg_max_ms: Duration = 30_000.0
    """And to at most this."""
    turn_max_deg: Annotated[float, Field(gt=0, le=180)] = 180.0
    """Turns are uniform between minus and plus this."""
    avoidance_threshold_mm: Annotated[float, Field(ge=0, le=1e5)] = 55.0
    """theta_c: a ray shorter than this starts an avoidance turn."""
    turn_gain_percent_per_deg: Annotated[float, Field(gt=0, le=1e4)] = 2.5
    """Command of a turn: this times the angle still to turn,"""
    turn_integral_gain_percent_per_deg_s: Annotated[float, Field(ge=0, le=1e4)] = 0.15
    """plus this times its integral over time."""
    turn_tolerance_deg: Annotated[float, Field(gt=0, le=90)] = 2.5
    """A turn is done when no more is left to turn."""
    blind_after_turn_ms: Annotated[float, Field(gt=0, le=60_000)] | None = None
    """After a turn the robot drives so long before it heeds its rays again. Without it (the paper) it heeds them at
    once."""


class Sample(Section):
    """When a robot stops to sample, and for how long."""

    sample_interval_ms: Annotated[float, Field(ge=0, le=1e9)] = 3778.0
    """tau: a sample falls due when the timer exceeds it."""
    stop_ms: Annotated[float, Field(ge=0, le=1e9)] = 1000.0
    """How long the robot stands before the sample is taken."""
    signal_ms: Annotated[float, Field(gt=0, le=1e9)] | None = None
    """For how long the accelerometer is read, at the end of the stop (``observation.signal.sense_program``); without it
    500 ms, or half of the stop if that is shorter. Simulated energies are drawn, so that it changes none of them."""
    timer: Literal["reset_after_turn", "hold_in_turn", "always", "frozen_in_avoidance"] = "reset_after_turn"
    """The timer counts driving and avoiding. In a leg-end turn it stands still and then starts again from 0
    (``reset_after_turn``), stands still (``hold_in_turn``) or counts (``always``, the text);
    ``frozen_in_avoidance`` is the first, with avoidance not counted either."""
    interrupts_avoidance: bool = True
    """A sample that falls due may interrupt an avoidance turn, which goes on after it."""


class Sensor(Section):
    """What a sample reads: an energy E (RMS of the filtered acceleration) and the bit O = (E > theta_E)."""

    model: Literal["gamma", "energies"] = "gamma"
    """Energies from Gamma distributions, or drawn from measured ones."""
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
    edge_reach_m: Annotated[float, Field(ge=-1, le=1)] | None = None
    """Vibrating tiles reach so far beyond their edges: at this distance every second sample is read as on one.
    Without it (and ``edge_blur_m``) a sample reads the tile under the centre, as the paper's did."""
    edge_blur_m: Annotated[float, Field(ge=0, le=1)] | None = None
    """How gradual that is: standard deviation of the distance at which it happens, m."""
    tile_spread: Annotated[float, Field(gt=0, le=2)] | None = None
    """Tiles differ: energies on each are multiplied by a factor of mean 1, log-normal with this standard
    deviation of its logarithm, drawn for each tile and run (each study with ``floor.redraw = "study"``)."""
    robot_spread: Annotated[float, Field(gt=0, le=2)] | None = None
    """Robots' sensors differ likewise; drawn for each robot and run."""


class Choice(Section):
    """A part that is chosen by its name, with a table of parameters of its own: ``[strategy.soft]``.

    Tables of others than the chosen one may be given, and are kept; they mean nothing, and are in no hash.
    """

    model_config = ConfigDict(frozen=True, extra="allow", strict=True, allow_inf_nan=False)
    kind: ClassVar[str]
    known: ClassVar[Callable[[], Mapping[str, Any]]]

    name: str
    code: str | None = None
    """The file that it comes from, and its SHA-256: it is none of vibroswarm's own."""

    @model_validator(mode="before")
    @classmethod
    def _take_in(cls, values: Any) -> Any:
        if not isinstance(values, Mapping):
            return values
        given = dict(values)
        name = given.get("name", cls.model_fields["name"].default)
        spec = name if code_files.is_code(name) else given.get("code")
        if isinstance(spec, str) and code_files.is_code(spec):
            if name in (spec, code_files.name_in(spec)):
                given["code"] = spec = code_files.resolved(cls.kind, spec)
                given["name"] = name = code_files.name_in(spec)
            else:  # another has been chosen since
                spec = None
        there = cls.known()
        if isinstance(name, str) and name in there:
            mine = there[name].code or None
            if isinstance(spec, str) and code_files.HASH in spec and spec != mine:
                raise InputError(
                    f"{spec.partition(code_files.HASH)[0]} was another file then: its SHA-256 began with "
                    f"{spec.partition(code_files.HASH)[2][:12]}, that of the one now loaded with "
                    f"{(mine or '').partition(code_files.HASH)[2][:12] or 'nothing'}",
                    field=f"{cls.kind}.code",
                )
            given["code"] = mine
        elif spec is None or not isinstance(name, str) or not code_files.is_told(name):
            given.pop("code", None)
        if isinstance(name, str) and name not in there and given.get("code") is None:
            raise InputError(
                f"there is no {cls.kind} {shown(name)}{nearest(name, there)} (there are {', '.join(there)})",
                field=f"{cls.kind}.name",
            )
        for key in sorted(set(given) - {"name", "code"}):
            table = cls._table(key, given[key], is_chosen=key == name)
            empty = not (type(table).model_fields if isinstance(table, BaseModel) else table)
            usual = key != name and key in there and not there[key].code and table == there[key].params()
            if empty or usual:
                del given[key]  # as it would be without: what is equal is written alike
            else:
                given[key] = table
        if isinstance(name, str) and name in there and name not in given and there[name].params.model_fields:
            given[name] = there[name].params()
        return given

    @classmethod
    def _table(cls, name: str, table: Any, is_chosen: bool) -> Any:
        """The parameters of one; as they stand where its code is not loaded."""
        there, where = cls.known(), f"{cls.kind}.{name}"
        if name not in there:
            if isinstance(table, Mapping) and (is_chosen or code_files.is_told(name)):
                return dict(table)
            fields = [f"{one}.{field}" for one, known in there.items() for field in known.params.model_fields]
            whole = {"name": f"{cls.kind}.name"} | {
                field.rpartition(".")[2]: f"{cls.kind}.{field}" for field in fields
            }
            close = nearest(name, [*there, *whole])
            for last, right in whole.items():
                close = close.replace(f"'{last}'", f"'{right}'")
            raise InputError(f"there is no such field{close}", field=where)
        params = there[name].params
        if isinstance(table, params):
            return table
        if not isinstance(table, Mapping):
            raise InputError(
                f"{shown(table)} is wrong; give a table of {', '.join(params.model_fields)}", field=where
            )
        try:
            return params.model_validate(dict(table))
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            field = ".".join(str(part) for part in first["loc"])
            if first["type"] == "extra_forbidden":
                message = f"there is no such field{nearest(field, params.model_fields)}"
            else:
                said = first["msg"][0].lower() + first["msg"][1:]
                message = f"{shown(first.get('input'))} is wrong: {said}"
            raise InputError(message, field=f"{where}.{field}") from None

    @property
    def params(self) -> Any:
        """The parameters of the chosen one."""
        return self.table(self.name)

    def table(self, name: str) -> Any:
        """The parameters of any of them: those given, or its own defaults."""
        given = (self.__pydantic_extra__ or {}).get(name)
        if given is not None:
            return given
        there = type(self).known()
        return there[name].params() if name in there else {}

    @property
    def defaults(self) -> dict[str, Any]:
        """The chosen one's parameters, were none of them given; as they are, where its code is not loaded."""
        known = type(self).known().get(self.name)
        found: dict[str, Any] = known.params().model_dump() if known is not None else dict(self.params)
        return found

    @model_serializer(mode="plain")
    def _as_tables(self) -> dict[str, Any]:
        """Name, code, and the tables in the order of their names."""
        found: dict[str, Any] = {"name": self.name, "code": self.code}
        for name, table in sorted((self.__pydantic_extra__ or {}).items()):
            found[name] = table.model_dump() if isinstance(table, BaseModel) else dict(table)
        return {key: value for key, value in found.items() if value is not None}

    @property
    def in_force(self) -> dict[str, Any]:
        """What has an effect: the name, the code and the chosen one's parameters."""
        whole: dict[str, Any] = self._as_tables()
        return {key: value for key, value in whole.items() if key in ("name", "code", self.name)}

    @classmethod
    def field_names(cls) -> list[str]:
        """All fields by their dotted names, without that of the section."""
        tables = [f"{name}.{field}" for name, one in cls.known().items() for field in one.params.model_fields]
        return ["name", *tables]

    @classmethod
    def kind_of(cls, name: str) -> Any:
        """The type of a field, by its dotted name without that of the section."""
        table, separator, field = name.partition(".")
        if not separator:
            return str
        return cls.known()[table].params.model_fields[field].annotation


class StrategyChoice(Choice):
    """What a robot says and when it decides; by name: ``none``, ``positive``, ``soft``."""

    kind = "strategy"
    known = staticmethod(known_strategies)
    name: str = "none"
    """A robot says its reading (none), its decision once it has one (positive), or a bit drawn between
    its reading and its belief (soft)."""


class Decision(Section):
    """When a robot decides."""

    decision_boundary: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """The question: does more than this share vibrate?"""
    boundary_of: Literal["tiles", "readings"] = "readings"
    """What the boundary is a share of. "readings": robots test the share of ones against ``decision_boundary`` itself,
    as the study did, which is right only where the sensor's errors balance at it. "tiles": against the share of ones
    that a floor at the boundary is expected to give, by the error rates that robots assume."""
    assumed_false_positive: Annotated[float, Field(ge=0, lt=1)] | None = None
    """For "tiles": the share of samples at still places that robots expect to read as vibrating. Without it they know
    their sensor: its own rate, averaged over uniformly random places, edges included."""
    assumed_false_negative: Annotated[float, Field(ge=0, lt=1)] | None = None
    """For "tiles": the share of samples on vibrating tiles that they expect to read as still; likewise."""
    credible_threshold: Annotated[float, Field(ge=0.5, lt=1)] = 0.95
    """p_c: a robot decides when its belief exceeds this."""
    min_observations: Annotated[int, Field(ge=0, le=10**9)] = 381
    """O_c: strictly more counted observations are needed to decide."""
    gate: Literal["total", "received", "own"] = "total"
    """Which observations are counted against ``min_observations`` (strictly more are needed)."""
    gate_counts_current: bool = False
    """Whether the sample just taken is counted."""
    revise: bool = False
    """Whether a robot under ``soft`` that has decided may decide anew, as Algorithm 1 allows u^s."""
    prior_alpha: Annotated[int, Field(ge=1, le=10**6)] = 1
    """The prior is Beta(prior_alpha, prior_beta)."""
    prior_beta: Annotated[int, Field(ge=1, le=10**6)] = 1
    """Its second parameter."""
    hold_s: Annotated[float, Field(ge=0, le=1e7)] = 30.0
    """For strategies whose opinion may change: the swarm has decided when all have agreed for so long, s."""


class NetworkChoice(Choice):
    """Who hears what; by name: ``ideal``: all hear all, ``loss``: each message and receiver may be lost."""

    kind = "network"
    known = staticmethod(known_networks)
    name: str = "ideal"
    """All hear all (ideal), or each message and receiver is lost with a probability (loss)."""


class TaskChoice(Choice):
    """What is asked of the floor; by name: ``fill_ratio``: does more than ``decision_boundary`` vibrate?"""

    kind = "task"
    known = staticmethod(known_tasks)
    name: str = "fill_ratio"
    """Which decision is right: by the share of tiles that vibrate (fill_ratio)."""


class Run(Section):
    """How long, and in which steps."""

    t_end_s: Annotated[float, Field(gt=0, le=1e7)] = 1200.0
    """End of the run."""
    stop: Literal["t_end", "all_decided"] = "t_end"
    """Run to the end, or until all robots have decided (motion statistics are then biased)."""
    control_period_ms: Annotated[int, Field(ge=1, le=10_000)] = 20
    """The robot reads clocks, gyro and rays at these ticks."""
