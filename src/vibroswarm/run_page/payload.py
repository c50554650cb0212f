"""A run as the data of its web page: m, s, rad; numeric columns are packed (``packed_column``), poses thinned."""

from __future__ import annotations

import math
from base64 import b64encode
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import betainc

from vibroswarm.core.numbers import count, number
from vibroswarm.errors import InputError, check_kind
from vibroswarm.floors.floor import Floor, rows_of
from vibroswarm.localisation.locate import is_estimated
from vibroswarm.observation.decision_boundary import expected_ones_on, readings_boundary
from vibroswarm.result import Result
from vibroswarm.scenario.disturbance_fields import MOTION_FAULTS, change_words
from vibroswarm.scenario.fault_draws import fault_words
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.statistics.map_figures import maps_over_time
from vibroswarm.statistics.verdict import (
    Verdict,
    estimates_in_words,
    holds_opinions,
    strategy_name,
    verdict,
)
from vibroswarm.strategies import strategy as strategy_of
from vibroswarm.strategies.place_map import WITH_MAP
from vibroswarm.strategies.static_analysis import fields_read

POSE_S: Final = 0.25
"""Time between the poses that a page has."""
KINDS: Final = ("drive", "turn", "avoid", "stop")
"""Kinds of moves."""
HEADING_RAD: Final = 2 * np.pi / 32768
"""Unit of the headings of a page."""
UNKNOWN: Final = 255
"""Stands for a missing message."""
MAP_TIMES: Final = 41
"""Number of times of a run at which a page shows maps."""
MAX_MAPS: Final = 1_000_000
"""Largest number of values (times, maps, tiles) for which a page shows all maps, and not only the pooled map."""
SAMPLE_TYPES: Final = {
    "robot": pl.UInt16,
    "sample": pl.UInt32,
    "stop_start_s": pl.Float64,
    "time_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
    "tile": pl.Int32,
    "energy": pl.Float32,
    "observation": pl.UInt8,
    "message": pl.UInt8,
    "alpha": pl.UInt32,
    "beta": pl.UInt32,
    "messages_received": pl.UInt32,
    "belief_below": pl.Float64,
    "decision": pl.Int8,
}
"""Columns of the samples. One with missing values is packed as floats with nan, whatever its type here."""
ROBOT_COLUMNS: Final = (
    "robot", "decision", "decision_time_s", "belief_at_decision", "alpha", "beta", "samples", "sent",
    "messages_received",
)  # fmt: skip
PLACE_COLUMNS: Final = ("x_m", "y_m", "heading_rad", "spread_m")
"""Where a robot believes that it is, and the standard deviation of this place."""


def packed_column(values: NDArray[np.generic]) -> dict[str, str]:
    """Pack a column: its little-endian type in NumPy's notation without the byte order, and its bytes in base64."""
    column = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"))
    return {"type": column.dtype.str.lstrip("<|"), "bytes": b64encode(column.tobytes()).decode("ascii")}


def payload(result: Result, run: int = 0, *, title: str = "") -> dict[str, Any]:
    """Return one run as dicts, lists, texts, booleans, finite numbers and None, which the page's scripts read."""
    check_kind(result, Result, "result", "a Result, as simulate() returns")
    if result.poses is None:
        raise InputError("no page can be made: simulate with poses=True")
    floor, scenario = result.floor(run), result.scenario
    summary = result.runs.filter(run=run).to_dicts()[0]
    size_m = (scenario.arena.width_m, scenario.arena.height_m)
    at_end = floor.at(summary["end_s"])
    fill_ratio = at_end.fill_ratio_within(*size_m)
    rule = rule_of(scenario)
    found = None if scenario.task.name == "fill_ratio" else verdict(result, run)
    if found is not None:
        rule |= {"answers": list(found.answers), "asked_anew": found.asked_anew}
    moved = rule["tested"] != rule["boundary"]
    samples = _samples(result, run)
    return {
        "title": title or f"{count(scenario.swarm.robots, 'robot')} on {floor.name}",
        "strategy": strategy_name(scenario),
        "seed": result.seed,
        "run": run,
        "arena": dict(zip(("width_m", "height_m"), size_m, strict=True)),
        "floor": _floor(floor),
        "kinds": max(scenario.sensor.kinds, scenario.sensor.readings),
        "body": body_of(scenario),
        "time": {"tick_s": scenario.tick_s, "end_s": summary["end_s"]},
        "rule": rule,
        "truth": {
            "fill_ratio": fill_ratio,
            "ones": float(expected_ones_on(scenario.sensor, at_end, size_m)) if moved else fill_ratio,
            "decision": summary["truth"],
        },
        "notes": ["True places: an upper bound, as real robots must estimate theirs."]
        if scenario.reads_true_places
        else [],
        "outcome": {"consensus": summary["consensus"], "time_s": summary["consensus_time_s"]},
        "estimates": None if found is None else _estimates(found),
        "robots": result.robots.filter(run=run).select(ROBOT_COLUMNS).sort("robot").to_dicts(),
        "samples": {
            name: packed_column(samples[name].cast(kind).to_numpy()) for name, kind in SAMPLE_TYPES.items()
        },
        "places": None if result.places is None else _places(samples, result.places.filter(run=run)),
        "maps": _maps(result, run, summary["end_s"]),
        "poses": _poses(result.poses.filter(run=run), max(size_m)),
        "faults": [] if result.faults is None else _faults(result.faults.filter(run=run)),
        "details": _details(result),
    }


def rule_of(scenario: Scenario) -> dict[str, Any]:
    """Return how robots decide on the fill ratio, by the names that the page's scripts read."""
    decision, strategy = scenario.decision, strategy_of(scenario.strategy.name)
    prior, tested = (decision.prior_alpha, decision.prior_beta), readings_boundary(scenario)
    read = fields_read(strategy)
    return {
        "credible_threshold": decision.credible_threshold,
        "boundary": decision.decision_boundary,
        "tested": float(tested),
        "prior_alpha": prior[0],
        "prior_beta": prior[1],
        "prior_belief": float(betainc(*prior, tested)),
        "min_observations": decision.min_observations,
        "gate": decision.gate,
        "gate_counts_current": decision.gate_counts_current,
        "gated": "min_observations" in read,
        "by_belief": "credible_threshold" in read,
        "answers": None,
        "asked_anew": False,
        "decides": strategy.decides,
        "opinions": holds_opinions(scenario),
    }


def body_of(scenario: Scenario) -> dict[str, Any]:
    """Return the geometry of a robot's body and rays, by the names that the page's scripts read."""
    rays = scenario.rays
    return {
        "radius_m": scenario.robot.body_radius_m,
        "ray_forward_m": rays.forward_m,
        "ray_sides_m": list(rays.side_m),
        "ray_angles_rad": [math.radians(angle) for angle in rays.angle_deg],
        "ray_range_m": rays.range_m,
        "ray_disc_radius_m": rays.disc_radius_m,
        "avoidance_threshold_m": scenario.walk.avoidance_threshold_mm / 1000.0,
    }


def _floor(floor: Floor) -> dict[str, Any]:
    rows, columns = floor.tiles.shape
    return {
        "name": floor.name,
        "rows": rows,
        "columns": columns,
        "tile_width_m": float(floor.tile_width_m),
        "tile_height_m": float(floor.tile_height_m),
        "left_m": float(floor.left_m),
        "bottom_m": float(floor.bottom_m),
        "tiles": "".join(rows_of(floor.tiles)),
        "has_values": floor.has_contrasts,
        "patches": [(p.x_m, p.y_m, p.width_m, p.height_m, p.is_disc, p.contrast) for p in floor.patches],
        # time (s), tile and new kind of each change, in the order of time
        "changes": list(zip(*(column.tolist() for column in floor.changes), strict=True)),
    }


def _samples(result: Result, run: int) -> pl.DataFrame:
    table = result.motion.filter(run=run)
    for other in (result.observations, result.inference):
        new = [name for name in other.columns if name not in table.columns]
        table = table.join(other.filter(run=run).select("robot", "sample", *new), on=["robot", "sample"])
    table = table.cast({"energy": pl.Float32}).with_columns(
        pl.col("energy").fill_null(np.nan), pl.col("message").fill_null(UNKNOWN)
    )
    return table.sort("robot", "sample")


def _places(samples: pl.DataFrame, places: pl.DataFrame) -> dict[str, Any]:
    known = places.select("robot", "sample", *PLACE_COLUMNS)
    found = samples.select("robot", "sample").join(
        known, on=["robot", "sample"], how="left", maintain_order="left"
    )
    return {
        name: packed_column(found[name].cast(pl.Float32).fill_null(np.nan).to_numpy())
        for name in PLACE_COLUMNS
    }


def _maps(result: Result, run: int, end_s: float) -> dict[str, Any] | None:
    """Return the robots' maps and the pooled map over time, or the latter alone if all would be too large."""
    is_lost = result.seed is None or (is_estimated(result.scenario) and result.moves is None)
    if is_lost or result.scenario.strategy.name not in WITH_MAP:
        return None
    time_s = np.linspace(0.0, end_s, MAP_TIMES)
    beliefs = maps_over_time(result, run, time_s)
    beliefs = (
        beliefs if beliefs.size <= MAX_MAPS else beliefs[:, -1:]
    )  # the last map at each time is the pooled one
    packed = packed_column(np.rint(255.0 * beliefs).astype(np.uint8).ravel())
    return {"step_s": float(time_s[1]), "count": beliefs.shape[1], "beliefs": packed}


def _poses(poses: pl.DataFrame, side_m: float) -> dict[str, Any]:
    """Return the robots' thinned poses as packed columns; a place has 16 bits, from 0 to about ``side_m``."""
    unit_m = side_m / 30_000
    poses = poses.sort("robot", "time_s").with_columns(kind=pl.col("kind").cast(pl.Enum(KINDS)).to_physical())
    step = (pl.col("time_s") / POSE_S + 1e-6).floor()
    keep = pl.any_horizontal(
        *(column.diff().fill_null(1.0) != 0 for column in (step, pl.col("kind").cast(pl.Int8))),
        pl.col("kind").cast(pl.Int8).diff().shift(-1).fill_null(1)
        != 0,  # the last pose before a change, or of all
    )
    robots = []
    for (robot,), own in poses.filter(keep.over("robot")).group_by("robot", maintain_order=True):
        place = own.select("x_m", "y_m").to_numpy() / unit_m
        heading = np.remainder(own["heading_rad"].to_numpy() + np.pi, 2 * np.pi) - np.pi
        columns = {
            "time": own["time_s"].cast(pl.Float32).to_numpy(),
            "x": np.rint(place[:, 0]).astype(np.int16),
            "y": np.rint(place[:, 1]).astype(np.int16),
            "heading": np.rint(heading / HEADING_RAD).astype(np.int16),
            "kind": own["kind"].cast(pl.UInt8).to_numpy(),
        }
        robots.append({"robot": robot, **{name: packed_column(column) for name, column in columns.items()}})
    return {"position_m": unit_m, "heading_rad": HEADING_RAD, "kinds": list(KINDS), "robots": robots}


def _estimates(found: Verdict) -> dict[str, Any] | None:
    if not found.estimated:
        return None
    told, sure = estimates_in_words(found)
    each = [number(robot.estimate, 3) if robot.estimate is not None else "\u2013" for robot in found.robots]
    true = number(found.fill_ratio, digits=4)
    return {"asked": found.estimated, "true": true, "told": told, "sure": sure, "of_robots": each}


def _faults(faults: pl.DataFrame) -> list[dict[str, Any]]:
    return [
        {
            "robot": row["robot"],
            "fault": fault_words(row["fault"]),
            "from_s": row["from_s"],
            "stops": row["fault"] in MOTION_FAULTS,
        }
        for row in faults.to_dicts()
    ]


def _details(result: Result) -> list[tuple[str, str]]:
    changes = change_words(result.scenario.change)
    names = ("vibroswarm", "python", "numpy", "numba", "architecture", "code")
    return [
        ("scenario", result.scenario.hash),
        ("motion", str(result.source)),
        *([("change", changes)] if changes else []),
        *((name, str(result.versions[name])) for name in names if name in result.versions),
    ]
