"""What is to be simulated: frozen, validated, hashable, TOML in and out.

Every default is what the paper's simulations really did (preset ``paper``), so a scenario file needs to
say only what differs. Units stand in the names. Field to paper:

| field | symbol | unit |
|---|---|---|
| walk.walk_duration_location_ms, walk.walk_duration_scale_ms | gamma_0, gamma | ms |
| walk.avoidance_threshold_mm | theta_c | mm |
| sample.sample_interval_ms | tau | ms |
| sensor.rms_threshold | theta_E | - |
| decision.credible_threshold, decision.min_observations | p_c, O_c | - |
| decision.decision_boundary | 0.5 in the paper | - |
| strategy.eta, strategy.kappa | eta, kappa | - |
| robot.misalignment_min, robot.misalignment_max | m_d ~ U(min, max) | - |
| robot.speed_factor_shape, _scale, _location | s_d ~ Gamma(shape, scale) + location | - |
| robot.battery_life_s | b_d = 1 - t / battery_life_s | s |
"""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from vibroswarm.errors import InputError, nearest
from vibroswarm.floors.floor import Floor, as_tiles
from vibroswarm.floors.patterns import family
from vibroswarm.floors.source import is_random, named_tiles, resolve

SCHEMA_VERSION = 1

Length = Annotated[float, Field(gt=0, le=1e4)]
Share = Annotated[float, Field(ge=0, le=1)]
Duration = Annotated[float, Field(ge=0, le=1e9)]
RayList = Annotated[tuple[float, ...], Field(min_length=1, max_length=64, strict=False)]
Energies = Annotated[tuple[Annotated[float, Field(ge=0, le=1e9)], ...], Field(min_length=1, strict=False)]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Arena(_Section):
    """The walls, a rectangle with its lower left corner at the origin."""

    width_m: Length = 1.0
    height_m: Length = 1.0


class FloorField(_Section):
    """Which tiles lie in the arena, and where."""

    source: str = Field(default="random:0.48", min_length=1)
    """A pattern with its fill (``diagonal:0.46``), ``random:0.48``, or the name of the floor in ``tiles``."""
    rows: Annotated[int, Field(ge=1, le=2000)] = 5
    columns: Annotated[int, Field(ge=1, le=2000)] = 5
    """Tiles of a random floor; a pattern and ``tiles`` have their own."""
    tiles: Annotated[tuple[str, ...], Field(min_length=1, strict=False)] | None = None
    """The floor itself, one string of 0 and 1 a row, top row first; goes before ``source``."""
    redraw: Literal["run", "study"] = "run"
    """A random floor is drawn anew for each run, or once (that of run 0) for all."""
    tile_width_m: Length | None = None
    tile_height_m: Length | None = None
    """Size of one tile; without it the tiles are stretched over the arena."""
    left_m: Annotated[float, Field(ge=-1e4, le=1e4)] = 0.0
    bottom_m: Annotated[float, Field(ge=-1e4, le=1e4)] = 0.0

    @property
    def drawn_by_run(self) -> bool:
        """Whether each run has a floor of its own."""
        return self.tiles is None and self.redraw == "run" and is_random(self.source)

    def tiles_for(self, seed: int, run: int) -> tuple[NDArray[np.uint8], str]:
        """The tiles of ``run``, (rows, columns), and their name."""
        if self.tiles is not None:
            if len({len(row) for row in self.tiles}) > 1:
                raise InputError("the rows are not of one length", field="floor.tiles")
            if set("".join(self.tiles)) - {"0", "1"}:
                raise InputError("a row is a string of 0 and 1", field="floor.tiles")
            return as_tiles([[int(tile) for tile in row] for row in self.tiles]), self.source
        return named_tiles(self.source, self.rows, self.columns, seed, run), self.source


class Swarm(_Section):
    """How many robots, and where they start."""

    robots: Annotated[int, Field(ge=1, le=10_000)] = 5
    start_margin_m: Annotated[float, Field(ge=0, le=1e4)] = 0.05
    """Centres start uniform in the arena less this margin (never nearer to a wall than the body allows)."""


class Robot(_Section):
    """The body and its imperfections, fitted to the simulator's logs."""

    body_radius_m: Annotated[float, Field(gt=0, le=10)] = 0.015
    full_speed_m_s: Annotated[float, Field(gt=0, le=10)] = 0.0549
    drive_track_m: Annotated[float, Field(gt=0, le=10)] = 0.0394
    turn_track_m: Annotated[float, Field(gt=0, le=10)] = 0.046
    misalignment_min: Annotated[float, Field(gt=-1, lt=1)] = -0.1
    misalignment_max: Annotated[float, Field(gt=-1, lt=1)] = 0.1
    speed_factor_shape: Annotated[float, Field(gt=0, le=1e6)] = 3.1
    speed_factor_scale: Annotated[float, Field(gt=0, le=1e3)] = 0.095
    speed_factor_location: Annotated[float, Field(ge=-100, le=100)] = 0.8
    speed_factor_min: Annotated[float, Field(gt=0, le=100)] = 0.9
    speed_factor_max: Annotated[float, Field(gt=0, le=100)] = 1.5
    speed_redraw: Literal["sample", "robot"] = "sample"
    battery_life_s: Annotated[float, Field(gt=0, le=1e12)] = 8400.0
    """Battery factor is 1 - t / this, updated at samples."""


class Rays(_Section):
    """The three distance sensors. They start ahead of the centre and see walls and other robots' discs."""

    forward_m: Annotated[float, Field(ge=0, le=10)] = 0.008
    side_m: RayList = (0.0, 0.0075, -0.0075)
    angle_deg: RayList = (0.0, 27.0, -27.0)
    range_m: Annotated[float, Field(gt=0, le=100)] = 0.15
    disc_radius_m: Annotated[float, Field(ge=0, le=10)] = 0.0055
    """Radius of other robots as the rays see them."""


class Walk(_Section):
    """The random walk and the turns."""

    walk_duration_location_ms: Annotated[float, Field(ge=0, le=1e9)] = 7860.0
    walk_duration_scale_ms: Annotated[float, Field(ge=0, le=1e9)] = 10725.0
    leg_min_ms: Duration = 1000.0
    leg_max_ms: Duration = 30_000.0
    turn_max_deg: Annotated[float, Field(gt=0, le=180)] = 180.0
    avoidance_threshold_mm: Annotated[float, Field(ge=0, le=1e5)] = 55.0
    turn_gain_percent_per_deg: Annotated[float, Field(gt=0, le=1e4)] = 2.5
    turn_integral_gain_percent_per_deg_s: Annotated[float, Field(ge=0, le=1e4)] = 0.15
    turn_tolerance_deg: Annotated[float, Field(gt=0, le=90)] = 2.5


class Sample(_Section):
    """When a robot stops to sample, and for how long."""

    sample_interval_ms: Annotated[float, Field(ge=0, le=1e9)] = 3778.0
    stop_ms: Annotated[float, Field(ge=0, le=1e9)] = 1000.0
    timer: Literal["reset_after_turn", "hold_in_turn", "always", "frozen_in_avoidance"] = "reset_after_turn"
    """The timer counts driving and avoiding. In a leg-end turn it stands still and then starts again from 0
    (``reset_after_turn``), stands still (``hold_in_turn``) or counts (``always``, the text);
    ``frozen_in_avoidance`` is the first, with avoidance not counted either."""
    interrupts_avoidance: bool = True
    """A sample that falls due may interrupt an avoidance turn, which goes on after it."""


class Sensor(_Section):
    """What a sample reads: an energy E (RMS of the filtered acceleration) and the bit O = (E > theta_E)."""

    model: Literal["gamma", "energies"] = "gamma"
    rms_threshold: Annotated[float, Field(ge=0, le=1e9)] = 1.33
    vibrating_shape: Annotated[float, Field(gt=0, le=1e6)] = 5.33497
    vibrating_scale: Annotated[float, Field(gt=0, le=1e6)] = 0.5132
    vibrating_location: Annotated[float, Field(ge=-1e6, le=1e6)] = -0.2001
    still_shape: Annotated[float, Field(gt=0, le=1e6)] = 2.52194
    still_scale: Annotated[float, Field(gt=0, le=1e6)] = 0.28754
    still_location: Annotated[float, Field(ge=-1e6, le=1e6)] = 0.13731
    vibrating_energies: Energies | None = None
    still_energies: Energies | None = None
    """Measured energies to draw from, with ``model = "energies"``."""


class Strategy(_Section):
    """What a robot says: u- ``none``, u+ ``positive``, u^s ``soft``."""

    name: Literal["none", "positive", "soft"] = "none"
    eta: Annotated[float, Field(ge=0, le=1e12)] = 1500.0
    kappa: Annotated[float, Field(ge=0, le=1e6)] = 2.0


class Decision(_Section):
    """When a robot decides."""

    decision_boundary: Annotated[float, Field(gt=0, lt=1)] = 0.5
    credible_threshold: Annotated[float, Field(ge=0.5, lt=1)] = 0.95
    min_observations: Annotated[int, Field(ge=0, le=10**9)] = 381
    gate: Literal["total", "received", "own"] = "total"
    """Which observations are counted against ``min_observations`` (strictly more are needed)."""
    gate_counts_current: bool = False
    """Whether the sample just taken is counted."""
    revise: bool = False
    """Whether a robot under ``soft`` that has decided may decide anew, as Algorithm 1 allows u^s."""
    prior_alpha: Annotated[int, Field(ge=1, le=10**6)] = 1
    prior_beta: Annotated[int, Field(ge=1, le=10**6)] = 1


class Network(_Section):
    """Who hears what: all hear all; each message and receiver is lost with probability ``loss``."""

    loss: Share = 0.0


class Run(_Section):
    """How long, and in which steps."""

    t_end_s: Annotated[float, Field(gt=0, le=1e7)] = 1200.0
    stop: Literal["t_end", "all_decided"] = "t_end"
    control_period_ms: Annotated[int, Field(ge=1, le=10_000)] = 20


class Scenario(_Section):
    """One inspection: arena, floor, swarm, robot, sensing, strategy, decision, network, duration.

    Raises (through ``read``, ``from_toml`` and ``with_values``):
        InputError: naming the field, its value and what would be right.
    """

    arena: Arena = Arena()
    floor: FloorField = FloorField()
    swarm: Swarm = Swarm()
    robot: Robot = Robot()
    rays: Rays = Rays()
    walk: Walk = Walk()
    sample: Sample = Sample()
    sensor: Sensor = Sensor()
    strategy: Strategy = Strategy()
    decision: Decision = Decision()
    network: Network = Network()
    run: Run = Run()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        from vibroswarm import checks

        for check in checks.ALL:
            check(self)
        return self

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> Scenario:
        """A scenario from nested mappings (as TOML gives them); what is missing is as in preset ``paper``."""
        try:
            return cls.model_validate(dict(values))
        except ValidationError as error:
            raise _explain(error) from None

    @classmethod
    def from_toml(cls, text: str, *, name: str = "scenario", folder: Path | None = None) -> Scenario:
        """A scenario from TOML text; ``preset = "text"`` at its head makes that preset the base.

        With a ``folder``, ``floor.source`` may also name a floor file beside the scenario; its tiles are
        taken into the scenario (``floor.rows`` and ``floor.columns`` are those of a coordinate list).
        """
        try:
            values = tomllib.loads(text)
        except (tomllib.TOMLDecodeError, RecursionError) as error:
            raise InputError(f"is not TOML: {error}", field=name) from None
        if folder is not None:
            _take_in_floor(values, folder)
        return _with_base(values)

    @classmethod
    def read(cls, path: str | Path) -> Scenario:
        """A scenario from a TOML file."""
        path = Path(path)
        try:
            if path.stat().st_size > 64 * 2**20:
                raise InputError("is larger than 64 MiB; that is no scenario", field=str(path))
            text = path.read_text(encoding="utf-8")
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}", field=str(path)) from None
        except UnicodeDecodeError:
            raise InputError("is not text in UTF-8; a scenario is a TOML file", field=str(path)) from None
        except ValueError as error:  # a name with a null byte
            raise InputError(f"cannot be read: {error}", field=repr(str(path))) from None
        return cls.from_toml(text, name=str(path), folder=path.parent)

    def to_toml(self) -> str:
        """The whole scenario as TOML; ``from_toml`` gives back an equal one."""
        import tomli_w

        return tomli_w.dumps(self.model_dump(mode="python", exclude_none=True))

    def with_values(self, values: Mapping[str, Any]) -> Scenario:
        """A copy with some fields replaced, addressed by dotted name: ``{"walk.leg_min_ms": 500}``."""
        data = self.model_dump(exclude_none=True)
        for name, value in values.items():
            section, _, field = name.partition(".")
            if not field and section in data:
                raise InputError(
                    f"is a section; name one of its fields, such as {next(iter(data[section]))}", field=name
                )
            if not field or not isinstance(data.get(section), dict):
                raise InputError(f"there is no such field{_nearest_field(name)}", field=name)
            if value is None:
                data[section].pop(field, None)
            else:
                data[section][field] = value
        return Scenario.from_values(data)

    def floor_for(self, seed: int, run: int) -> Floor:
        """The floor of ``run``: the scenario's own, or a random one of (seed, run)."""
        tiles, name = self.floor.tiles_for(seed, run if self.floor.redraw == "run" else 0)
        rows, columns = tiles.shape
        return Floor(
            tiles,
            self.floor.tile_width_m or self.arena.width_m / columns,
            self.floor.tile_height_m or self.arena.height_m / rows,
            self.floor.left_m,
            self.floor.bottom_m,
            name,
        )

    @property
    def hash(self) -> str:
        """16 hexadecimal digits that change with any field, and with nothing else."""
        data = {"schema": SCHEMA_VERSION, **self.model_dump(mode="json", exclude_none=True)}
        text = json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    @property
    def tick_s(self) -> float:
        """The control period, s."""
        return self.run.control_period_ms / 1000.0

    @property
    def ticks(self) -> int:
        """Control periods that begin before the end."""
        return math.ceil(self.run.t_end_s * 1000.0 / self.run.control_period_ms - 1e-9)


def field_names() -> list[str]:
    """All fields by their dotted names."""
    return [
        f"{section}.{name}"
        for section, info in Scenario.model_fields.items()
        for name in info.annotation.model_fields  # type: ignore[union-attr]
    ]


def parse_setting(text: str) -> tuple[str, Any]:
    """``"walk.leg_min_ms=500"`` as name and value; the value is read as TOML, or as a bare word."""
    name, separator, value = text.partition("=")
    if not separator or not name.strip():
        raise InputError(f"'{text}' is not of the form section.field=value", field="--set")
    try:
        parsed = tomllib.loads(f"value = {value.strip()}")
        if set(parsed) != {"value"}:
            raise InputError(f"'{text}' sets more than one value", field="--set")
        return name.strip(), parsed["value"]
    except (tomllib.TOMLDecodeError, RecursionError):
        return name.strip(), value.strip()


def _take_in_floor(values: dict[str, Any], folder: Path) -> None:
    """Put the tiles of a floor file that ``floor.source`` names in its place."""
    floor = values.get("floor")
    if not isinstance(floor, dict) or "tiles" in floor or not isinstance(floor.get("source"), str):
        return
    source = floor["source"]
    if is_random(source) or family(source) is not None:
        return
    size = (floor.get("rows"), floor.get("columns"))
    given = size if isinstance(size[0], int) and isinstance(size[1], int) else None
    path = folder / source
    grid, name = resolve(str(path) if path.is_file() else source, given)  # type: ignore[arg-type]
    floor["source"] = name
    floor["tiles"] = tuple("".join("1" if tile else "0" for tile in row) for row in grid)


def _with_base(values: dict[str, Any]) -> Scenario:
    base = values.pop("preset", None)
    if base is None:
        return Scenario.from_values(values)
    from vibroswarm.presets import preset

    if not isinstance(base, str):
        raise InputError(f"{base!r} is not the name of a preset", field="preset")
    merged = preset(base).model_dump(exclude_none=True)
    for section, fields in values.items():
        if isinstance(fields, dict) and isinstance(merged.get(section), dict):
            merged[section] |= fields
        else:
            merged[section] = fields
    return Scenario.from_values(merged)


def _nearest_field(name: str) -> str:
    known = field_names()
    last = name.rpartition(".")[2]
    same = [k for k in known if k.rpartition(".")[2] == last]
    return f", did you mean '{same[0]}'?" if same else nearest(name, known + list(Scenario.model_fields))


def _explain(error: ValidationError) -> InputError:
    """The first thing that is wrong, in a user's words."""
    first = error.errors(include_url=False)[0]
    name = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        return InputError(f"there is no such field{_nearest_field(name)}", field=name)
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, InputError):  # a check across fields; it names the field itself
        return cause
    value = first.get("input")
    shown = repr(value) if len(repr(value)) <= 60 else repr(value)[:57] + "..."
    hint = ""
    if first["type"] == "literal_error" and isinstance(value, str):
        hint = nearest(
            value, [w.strip("'") for w in first["ctx"]["expected"].replace(" or ", ", ").split(", ")]
        )
    message = first["msg"][0].lower() + first["msg"][1:]
    return InputError(f"{shown} is wrong: {message}{hint}", field=name or "scenario")
