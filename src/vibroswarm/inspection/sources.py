"""Read the samples of an inspection: from a result, a recording, or a CSV of places and values."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
import polars as pl
from scipy.special import ndtr

from vibroswarm.calibrate.camera import corrected
from vibroswarm.core.read_tables import Use, read_rows
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.inspection.laws import hash_of_run
from vibroswarm.inspection.samples import (
    FEWEST,
    SAMPLES,
    Doubt,
    Law,
    Places,
    Samples,
    ratios_of_values,
    session_hash,
)
from vibroswarm.observation.energy_model import energy_of
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result
from vibroswarm.scenario.disturbance_fields import failing_sensors

KEY: Final = ("run", "robot", "sample")
LARGEST: Final = 1e9
COLUMNS: Final = {
    "robot": Use(pl.Int64, 0, 2**16 - 1, "the number of a robot"),
    "time_s": Use(pl.Float64, -LARGEST, LARGEST, "a time"),
    "x_m": Use(pl.Float64, -LARGEST, LARGEST, "a place", required=True),
    "y_m": Use(pl.Float64, -LARGEST, LARGEST, "a place", required=True),
    "spread_m": Use(pl.Float64, 0.0, LARGEST, "a standard deviation"),
    "value": Use(pl.Float64, -LARGEST, LARGEST, "a number", also=("energy", "rms", "observation")),
}
"""Columns of a CSV of places and values."""
WIDEST: Final = 4.5
"""Ends of the values that a law knows, as standard normal quantiles."""

Origin = Literal["bottom-left", "top-left", "centre"]
"""Where a CSV counts places from: y upwards from the lower left corner, downwards from the upper left, or centred."""


def samples_of_result(
    result: Result, run: int, law: Law, *, bits: bool = False, spread_m: float = 0.0
) -> Samples:
    """Return the samples of one run of a result.

    Places are those that the robots estimate, if the result has them; else the true ones, or in a recording those of
    the camera, corrected by ``law.camera``. An estimated place is the one smoothed by what the robot met until its
    next samples (``localisation.lag``), and the sample counts from then on; the last samples of a run, of which there
    is no such estimate, have the one that the robot had at once.
    """
    result, of_run = corrected(result, law.camera), pl.col("run") == run
    motion = result.motion.filter(of_run).select(*KEY, "time_s", "x_m", "y_m")
    if motion.is_empty():
        raise InputError(f"no robot took a sample in run {run}", field="--run")
    places, are_true = _known_from(result, run)
    if spread_m and places not in (Places.CAMERA, Places.FILE):
        raise InputError(
            f"is of the places of a camera or a CSV; these are {places.value}", field="--spread-mm"
        )
    many = law.sensor.kinds > 2
    read = _values(result, of_run, bits or many)
    frame = _with_places(result, motion, of_run, spread_m)
    truth = motion.select(*KEY, true_x_m="x_m", true_y_m="y_m")
    frame = frame.join(truth, on=KEY).join(read, on=KEY).drop_nulls("value").drop_nans(["x_m", "y_m"])
    if not are_true:
        frame = frame.with_columns(true_x_m=None, true_y_m=None)
    floor = result.floor(run)
    doubts = (Doubt.OWN_LAW,) * (
        hash_of_run(result, run, "observation" if bits else "energy") in law.sessions
    )
    doubts += (Doubt.CHANGED,) * bool(
        (floor.changes.time_s <= frame["time_s"].to_numpy().max(initial=0.0)).any()
    )
    source = f"simulation 'seed {result.seed}, run {run}'"
    if isinstance(result, Recording):
        source = f"session '{result.sessions[run]['log']}'"
    elif not bits and not many:
        doubts += (Doubt.FAULTS,) * bool(
            failing_sensors(result.scenario.faults, result.scenario.swarm.robots)
        )
    return _samples(
        frame, result.scenario.arena.size_m, law, places, source,
        floor=_vibrating(floor) if many else floor, kinds=floor if many else None, bits=bits, doubts=doubts,
        truth_known=not result.scenario.floor.has_surface,  # of which tiles vibrate
    )  # fmt: skip


def _values(result: Result, of_run: pl.Expr, bits: bool) -> pl.DataFrame:
    """Return the value of each sample, with the columns of ``KEY``: energy, in full precision if recorded, or bit."""
    if bits:
        return result.observations.filter(of_run).select(*KEY, value=pl.col("observation").cast(pl.Float64))
    table = result.rows if isinstance(result, Recording) else result.observations
    read = table.filter(of_run).select(*KEY, value=pl.col("energy").cast(pl.Float64))
    if read["value"].null_count() == read.height:
        raise InputError("holds no energies; use its bits (--bits)", field="the result")
    return read


def _with_places(result: Result, motion: pl.DataFrame, of_run: pl.Expr, spread_m: float) -> pl.DataFrame:
    if result.places is None:
        return motion.with_columns(spread_x_m=pl.lit(spread_m), spread_y_m=pl.lit(spread_m))
    own = result.places.filter(of_run)
    at_once = own.select(*KEY, "x_m", "y_m", spread_x_m="spread_m", spread_y_m="spread_m")
    names = [*KEY, "time_s", "x_m", "y_m", "spread_x_m", "spread_y_m"]
    later = (
        own.filter(pl.col("lagged_sample").is_not_null())
        .join(motion.select(*KEY, "time_s"), on=KEY, maintain_order="left")
        .select("run", "robot", "time_s", pl.col("^lagged_.*$").name.replace("^lagged_", ""))
    )
    last = motion.select(*KEY, "time_s").join(later, on=KEY, how="anti").join(at_once, on=KEY)
    return pl.concat([later.select(names), last.select(names)])


def _known_from(result: Result, run: int) -> tuple[Places, bool]:
    """Return how places are known, and whether those of motion are taken as the true ones."""
    if result.places is not None:
        return Places.ESTIMATED, not isinstance(result, Recording) or result.is_tracked(run)
    if not isinstance(result, Recording) or result.sessions[run]["reader"] == "webots":
        return Places.TRUE, True
    return (Places.CAMERA if result.is_tracked(run) else Places.FILE), False


def _samples(
    frame: pl.DataFrame, size_m: tuple[float, float], law: Law, places: Places, source: str, *, floor: Floor | None,
    bits: bool, doubts: tuple[Doubt, ...], truth_known: bool, kinds: Floor | None = None,
) -> Samples:  # fmt: skip
    known = law if law.bits == bits else replace(law, bits=bits)
    value = frame["value"].to_numpy()
    if frame.height < FEWEST:
        raise InputError(f"has {frame.height} samples; {FEWEST} are needed", field=source)
    at = np.stack([frame[f"{axis}_m"].to_numpy() / whole for axis, whole in zip("xy", size_m, strict=True)])
    if (outside := (np.abs(at - 0.5) > 0.55).any(axis=0)).mean() > 0.05:
        raise InputError(
            f"{outside.sum()} of {outside.size} places are outside the surface of {size_m[0]:g} m x {size_m[1]:g} m; "
            "are its size, the units and the origin right (--size, --origin)?",
            field=source,
        )
    if not bits and known.sensor.kinds == 2:
        ends = np.stack(
            [energy_of(law.sensor, k, ndtr(np.array([-WIDEST, WIDEST])), law.place) for k in (0, 1)]
        )
        low, high = float(ends.min()), float(ends.max())
        if (beyond := (value < low) | (value > high)).mean() > 0.5:
            raise InputError(
                f"{beyond.sum()} of {value.size} values are outside those of the law, {low:.3g} to {high:.3g}: they "
                "are in another unit, or of another sensor",
                field=source,
            )
    inside = {
        f"{axis}_m": pl.col(f"{axis}_m").clip(1e-9, whole - 1e-9)
        for axis, whole in zip("xy", size_m, strict=True)
    }
    columns = frame.with_columns(log_ratio=pl.Series(ratios_of_values(known, value)), **inside)
    table = columns.select(list(SAMPLES)).cast(SAMPLES).sort("time_s", "robot", "x_m", "y_m", "value")
    return Samples(table, size_m, known, places, source, floor, truth_known, kinds, doubts)


def _vibrating(floor: Floor) -> Floor:
    """Return a floor whose tiles are of kind 1 where they vibrate, whatever their motor."""
    changes = floor.changes._replace(kind=np.minimum(floor.changes.kind, 1))
    return replace(floor, levels=np.minimum(floor.tiles, 1), changes=changes)


def samples_of_csv(
    path: Path, law: Law, size_m: tuple[float, float], spread_m: float = 0.0, floor: Floor | None = None, *,
    truth_known: bool = False, origin: Origin = "bottom-left",
) -> Samples:  # fmt: skip
    """Return the samples of a CSV of places and values.

    Its header names the columns x_UNIT, y_UNIT and value, and perhaps robot, time_UNIT and spread_UNIT, the standard
    deviation of each place, such as ``robot,time_s,x_mm,y_mm,value``. Without robot, one robot took all samples; robots
    that have names are numbered in order. Rows without a value are left out.
    """
    read = read_rows([path], COLUMNS)
    if "value" not in read.columns:
        raise InputError(f"has no column 'value' (or {', '.join(COLUMNS['value'].also)})", field=str(path))
    rows, (width_m, height_m) = read.rows, size_m
    if origin == "centre":
        rows = rows.with_columns(pl.col("x_m") + 0.5 * width_m, pl.col("y_m") + 0.5 * height_m)
    elif origin == "top-left":
        rows = rows.with_columns(y_m=height_m - pl.col("y_m"))
    spread = pl.col("spread_m").fill_null(spread_m) if "spread_m" in rows.columns else pl.lit(spread_m)
    time_s = pl.col("time_s") if "time_s" in rows.columns else pl.lit(0.0)
    frame = rows.drop_nulls("value").select(
        pl.col("robot").cast(pl.UInt16), "x_m", "y_m", "value", time_s=time_s.fill_null(0.0), true_x_m=None,
        true_y_m=None, spread_x_m=spread, spread_y_m=spread,
    )  # fmt: skip
    doubts = (Doubt.COPIES,) * bool(frame.is_duplicated().any())
    doubts += (Doubt.OWN_LAW,) * (session_hash(frame["value"].to_numpy()) in law.sessions)
    left_out = read.missing + rows.height - frame.height
    source = f"'{path.name}'" + (f" ({left_out} rows without a value left out)" if left_out else "")
    return _samples(
        frame,
        size_m,
        law,
        Places.FILE,
        source,
        floor=floor,
        bits=law.bits,
        doubts=doubts,
        truth_known=truth_known,
    )
