"""Read the samples of an inspection: from a result, a recording, or a CSV of places and values."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl
from scipy.special import ndtr

from vibroswarm.calibrate.camera import corrected
from vibroswarm.core.numbers import count, listed, number, percent, some, stated, whole
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.inspection.laws import hash_of_run
from vibroswarm.inspection.samples import (
    FEWEST,
    SAMPLES,
    SELF_JUDGED,
    Floats,
    Law,
    PlaceErrors,
    Samples,
    ratios_of_values,
    session_hash,
)
from vibroswarm.observation.energy_model import energy_of
from vibroswarm.recordings.assemble_recording import inside, rows_apart_s
from vibroswarm.recordings.log import SAMPLES as LOGGED
from vibroswarm.recordings.read_tables import Read, Use, files_of, read_rows
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result
from vibroswarm.scenario.fault_fields import failing_sensors
from vibroswarm.sensors.confusion import confusion

KEY: Final = ("run", "robot", "sample")
ESTIMATED: Final = "estimated by the robots"
TRUE_PLACES: Final = "true places, which no real robot knows: an upper bound"


def samples_of_result(
    result: Result, run: int, law: Law, *, bits: bool = False, spread_m: float = 0.0
) -> Samples:
    """Return the samples of one run of a result.

    Places are those that the robots estimate, if the result has them; else the true ones, or in a recording those of
    the camera, corrected by ``law.camera``. An estimated place is the one smoothed by what the robot met until its
    next samples (``localisation.lag``), and the sample counts from then on; the last samples of a run, of which there
    is no such estimate, have the one that the robot had at once.

    Args:
        bits: use the readings, 0 or 1, in the place of the energies.
        spread_m: standard deviation in x and in y of the places of a recording that a camera or its log gives.
    Raises:
        InputError: there is no such run, it has no energies, or how sure its places are is known.
    """
    result = corrected(result, law.camera)
    of_run = pl.col("run") == run
    motion = result.motion.filter(of_run).select(*KEY, "time_s", "x_m", "y_m")
    if motion.is_empty():
        if run not in result.runs["run"]:
            raise InputError(f"there is no run {run}", field="--run")
        raise InputError(f"no robot took a sample in run {run}, so nothing can be inspected")
    places, are_true = _known_from(result, run)
    if spread_m and (result.places is not None or are_true):
        known = "true" if result.places is None else "estimated by the robots, which say how sure they are"
        raise InputError(f"is of the places of a camera or a CSV; these are {known}", field="--spread-mm")
    frame = _with_places(result, motion, of_run, spread_m)
    errors = _place_errors(frame, motion) if result.places is not None and are_true else None
    truth = motion.select(*KEY, true_x_m="x_m", true_y_m="y_m")
    if not are_true:
        truth = truth.with_columns(true_x_m=None, true_y_m=None)
    frame = frame.join(truth, on=KEY, maintain_order="left")
    many = law.sensor.kinds > 2
    if many != (result.scenario.sensor.kinds > 2):
        raise InputError(
            f"has {result.scenario.sensor.kinds} kinds of tile, and the law {law.sensor.kinds}",
            field="--laws",
        )
    read = _values(result, of_run, bits or many)
    frame = frame.join(read, on=KEY, how="inner", maintain_order="left").drop_nulls("value")
    frame = frame.filter(pl.col("x_m").is_not_nan() & pl.col("y_m").is_not_nan()).sort("time_s", "robot")
    floor = result.floor(run)
    source = f"simulation 'seed {result.seed}, run {run}'"
    if isinstance(result, Recording):
        source = f"session '{result.sessions[run]['log']}'"
    found = _samples(
        frame,
        result.scenario.arena.size_m,
        law,
        places,
        source,
        _vibrating(floor) if many else floor,
        bits,
        kinds=floor if many else None,
        truth_known=not result.scenario.floor.has_surface,  # of which tiles vibrate
        errors=errors,
        own=hash_of_run(result, run),
        changed_s=floor.changes.times_s.tolist(),
    )
    if not isinstance(result, Recording):
        faulty = failing_sensors(result.scenario.faults, result.scenario.swarm.robots)
        return found if bits or many or not faulty else replace(found, warning=_not_in_energies(faulty))
    return _with_doubts(found, *_doubt_of_times(result.sessions[run]["told"].get("rows_apart_s", 0.0)))


def _not_in_energies(faulty: Sequence[str]) -> str:
    """Return a warning that some kinds of faults are not in what is inspected."""
    return (
        f"Faults ({', '.join(faulty)}) change readings only; the energies that are inspected are those of working "
        "sensors. To inspect readings, add --bits."
    )


def _place_errors(frame: pl.DataFrame, motion: pl.DataFrame) -> PlaceErrors:
    """Compare estimated places with the true ones.

    Args:
        frame: samples with estimated places and spreads. motion: with the true places.
    """
    both = frame.sort("robot", "sample").join(motion, on=KEY, suffix="_true", maintain_order="left")
    errors = np.stack([both[f"{axis}_m"].to_numpy() - both[f"{axis}_m_true"].to_numpy() for axis in "xy"])
    spreads = np.stack([both[f"spread_{axis}_m"].to_numpy() for axis in "xy"])
    same = both["robot"].to_numpy()[1:] == both["robot"].to_numpy()[:-1]
    scaled = errors / np.maximum(spreads, 1e-9)
    pairs = [part[:, same].ravel() for part in (scaled[:, :-1], scaled[:, 1:])]
    one, two, four = (float(np.mean(np.abs(scaled) <= k)) for k in (1.0, 2.0, 4.0))
    lag_one = float(np.corrcoef(*pairs)[0, 1]) if same.any() else math.nan
    return PlaceErrors(lag_one, (one, two, four))


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
    """Return samples with places, spreads and the time from which they count."""
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


def _known_from(result: Result, run: int) -> tuple[str, bool]:
    """Return how places are known, in words, and whether those of motion are taken as the true ones."""
    if result.places is not None:
        return ESTIMATED, not isinstance(result, Recording) or result.is_tracked(run)
    if not isinstance(result, Recording):
        return TRUE_PLACES, True
    if result.is_tracked(run):
        return "seen by a camera", False
    if result.sessions[run]["reader"] == "webots":
        return "true places of the study's simulator, which no real robot knows: an upper bound", True
    return "as its log has them", False


def _samples(
    frame: pl.DataFrame, size_m: tuple[float, float], law: Law, places: str, source: str, floor: Floor | None,
    bits: bool, *, truth_known: bool, own: str, kinds: Floor | None = None, errors: PlaceErrors | None = None,
    changed_s: Sequence[float] = (), left_out: int = 0,
) -> Samples:  # fmt: skip
    """Return samples with their log ratios.

    Args:
        own: hash of their session, to which no law should be fitted. changed_s: times at which the floor changed.
        left_out: rows without a value.
    """
    known = law if law.bits == bits else replace(law, bits=bits)
    _check_classes(known, frame["value"].to_numpy())
    ratios = ratios_of_values(known, frame["value"].to_numpy())
    x_m, y_m = inside(frame["x_m"].to_numpy(), frame["y_m"].to_numpy(), size_m)
    columns = {"x_m": pl.Series(x_m), "y_m": pl.Series(y_m), "log_ratio": pl.Series(ratios)}
    table = frame.with_columns(**columns).select(list(SAMPLES)).cast(SAMPLES)
    warnings = [SELF_JUDGED] if own in law.sessions else []
    last_s = float(frame["time_s"].to_numpy().max(initial=0.0))
    until_s = [time_s for time_s in changed_s if time_s <= last_s]
    if until_s:
        warnings.append(
            f"The floor changed at {listed(f'{stated(time_s)} s' for time_s in until_s)}, but is presumed to stay as "
            "it is: samples from before count for what is there later, and each map is scored by the floor at its time."
        )
    return Samples(
        table, size_m, known, places, source, floor, truth_known, kinds, errors, left_out, " ".join(warnings)
    )


def _check_classes(law: Law, value: Floats) -> None:
    """Refuse values that are not classes under a law of classes.

    Raises:
        InputError: as said.
    """
    is_of_classes = law.sensor.kinds > 2 or law.sensor.model == confusion.name
    wrong = value[~np.isin(value, np.arange(law.sensor.readings))]
    if is_of_classes and wrong.size:
        raise InputError(
            f"is of sensor '{law.sensor.model}', which reads classes from 0 to {law.sensor.readings - 1}; "
            f"{wrong[0]:g} is none",
            field="--laws",
        )


def _vibrating(floor: Floor) -> Floor:
    """Return a floor whose tiles are of kind 1 where they vibrate, whatever their motor."""
    changes = floor.changes._replace(kind=np.minimum(floor.changes.kind, 1))
    return replace(floor, levels=np.minimum(floor.tiles, 1), changes=changes)


SPREADS: Final = re.compile(r"(place_)?spread(_[xy])?(_[a-z]{1,2})?")
"""Names of columns that may have been meant as standard deviations of places."""
_SCHEMA: Final = {
    **{name: LOGGED[name] for name in ("robot", "time_s", "x_m", "y_m")},
    "value": Use(pl.Float64, 0.0, 1e9, "a number from 0 to 1e9", also=("energy", "rms")),
    "spread_m": LOGGED["place_spread_m"],
}
MOST_ROBOT: Final = 2**16 - 1
"""Largest number of a robot in ``SAMPLES``."""
MOST_ROBOTS: Final = 1000
"""Most robots of a file: each takes about 0.1 s, and memory grows with their square."""
CORNER: Final = 0.01
"""Places within this share of width and height are in the corner, as are those in m where others are in mm."""
CORNERED: Final = 0.05
"""Largest share of places in the corner that is not odd."""
OUTSIDE: Final = 0.01
"""Largest share of places outside the surface, by ``CORNER`` and 3 standard deviations, that is not odd."""
WITHOUT: Final = 0.05
"""Largest share of rows without a value that is not odd."""
UNEQUAL: Final = 0.9
"""Share of different values from which on values of another file that are equal are copies."""
ENDS: Final = (-4.5, 4.5)
"""Ends of the values that a law knows, as standard normal quantiles."""
SURFACES: Final = ("floor", "plate", "surface", "run", "session")
"""Names of columns that say of which surface, or of which inspection, a row is."""


def samples_of_csv(
    path: Path,
    law: Law,
    size_m: tuple[float, float],
    spread_m: float = 0.0,
    floor: Floor | None = None,
    *,
    truth_known: bool = False,
) -> Samples:
    """Return the samples of a CSV of places and values.

    Its header names the columns robot, time_UNIT, x_UNIT, y_UNIT and value, such as ``robot,time_s,x_mm,y_mm,value``;
    without robot, one robot took all samples. A column spread_UNIT has the standard deviation of each place.

    Args:
        size_m: width and height of the surface. spread_m: standard deviation of the places in x and in y, if the file
            has none.
        floor: grid of tiles; None: none is known. truth_known: whether it says which tiles vibrate.
    Raises:
        InputError: the file cannot be read, a column is missing, spreads are given twice, or there are too many robots.
    """
    read = read_rows(files_of(path), _SCHEMA)
    if "value" not in read.columns:
        raise InputError("has no column 'value' (or energy, rms)", field=str(path))
    robots = read.rows["robot"].unique()
    if robots.len() > MOST_ROBOTS or (robots > MOST_ROBOT).any():
        raise InputError(
            f"has {whole(robots.len())} different robots, not {whole(MOST_ROBOTS)} or fewer with numbers up to "
            f"{MOST_ROBOT}; if it numbers samples, leave the column out",
            field=f"{path}, robot",
        )
    for name in filter(SPREADS.fullmatch, map(str.lower, read.unread.columns)):
        raise InputError(
            "give one standard deviation of places, in x and in y, with its unit, such as spread_m",
            field=f"{path}, {name}",
        )
    has_spreads = "spread_m" in read.columns
    spread = pl.col("spread_m").fill_null(spread_m) if has_spreads else pl.lit(spread_m)
    frame = (
        read.rows.drop_nulls("value")
        .select(
            "robot",
            "time_s",
            "x_m",
            "y_m",
            true_x_m=None,
            true_y_m=None,
            spread_x_m=spread,
            spread_y_m=spread,
            value="value",
        )
        .sort("time_s", "robot", "x_m", "y_m", "value")
    )  # so that the order of rows does not matter
    exact = (
        "taken as exact" if spread_m == 0.0 else f"with a standard deviation of {stated(1000 * spread_m)} mm"
    )
    if has_spreads:
        if spread_m:
            name = read.columns["spread_m"].name
            raise InputError(f"leave it out: column '{name}' has it", field="--spread-mm")
        exact = "with their own standard deviations" if (frame["spread_x_m"] > 0.0).any() else exact
    places, left_out = f"as the file has them, {exact}", read.missing + read.rows["value"].null_count()
    found = _samples(
        frame, size_m, law, places, f"'{path.name}'", floor, False,
        truth_known=truth_known, own=session_hash(frame["value"].to_numpy()), left_out=left_out,
    )  # fmt: skip
    return _with_doubts(found, *_doubt_of_times(rows_apart_s(read.rows)), *_doubts_of_table(read, left_out))


def _doubt_of_times(apart_s: float) -> Iterator[str]:
    """Yield that times may not be in s, if the rows of a robot are far apart."""
    if apart_s:
        yield f"The rows of a robot are usually {stated(apart_s)} s apart, as if times were in a smaller unit."


def _doubts_of_table(read: Read, left_out: int) -> Iterator[str]:
    """Yield that columns may say which robot took the samples, or of which surface; and that values are missing.

    Args:
        left_out: rows without a value.
    """
    if "robot" not in read.columns and read.unread.width:
        names = some([f"'{name}'" for name in read.unread.columns], 12)
        yield f"Without a column 'robot' all samples count as one robot's; not read: {names}."
    different = {name: read.unread[name].drop_nulls().n_unique() for name in read.unread.columns}
    several = [
        f"column '{name}' with {many} values"
        for name, many in different.items()
        if many > 1 and name.lower() in SURFACES
    ]
    if several:
        yield (
            f"Not read: {listed(several)}; all rows count as samples of one inspection of one surface: give a file of "
            "each."
        )
    rows = left_out + read.rows["value"].count()
    if left_out > WITHOUT * rows:
        yield (
            f"{left_out} of {rows} rows have no value: if a sensor gives none where it vibrates strongly, "
            "damage is missed; leave out rows between samples."
        )


def _with_doubts(samples: Samples, *doubts: str) -> Samples:
    """Return samples with what is odd about them as a warning, besides other doubts."""
    return replace(samples, warning=" ".join(filter(None, [samples.warning, *doubts, *_doubts(samples)])))


def _doubts(samples: Samples) -> Iterator[str]:
    """Yield what is odd about the samples of a file or of a recording, each a sentence."""
    frame = samples.frame
    if copies := frame.height - frame.n_unique():
        yield f"The file repeats {count(copies, 'row')}: if they are copies, their samples count twice."
    elif len(alike := _alike(frame)) > 1 and not samples.is_timeless:
        robots = listed(str(robot) for robot in alike)
        yield f"Robots {robots} have the same times, places and values: if they are copies, their samples count twice."
    if samples.is_timeless:
        yield "All samples of each robot have the same time, so that nothing can be said of drift."
    near_m = zip("xy", samples.size_m, strict=True)
    at_corner = np.all(
        [np.abs(samples.column(f"{axis}_m")) < CORNER * whole for axis, whole in near_m], axis=0
    )
    places = frame.filter(pl.Series(at_corner)).select("x_m", "y_m").n_unique()
    if at_corner.mean() > CORNERED and places > 1:  # one: a raster begins there
        yield (
            f"{at_corner.sum()} of {frame.height} places are in the lower left corner, within {percent(CORNER, 0)} of "
            "width and height, as if they were in a larger unit."
        )
    yield from _doubt_of_the_edges(samples)
    if not samples.law.bits:
        yield from _doubt_of_stuck(samples)
        yield from _doubts_of_values(samples.law, samples.column("value"), bool(samples.warning))


def _doubt_of_stuck(samples: Samples) -> Iterator[str]:
    """Yield which robots measure one value only, where by the law values of still places differ."""
    different = pl.col("value").n_unique()
    stuck = samples.frame.group_by("robot").agg(different, count=pl.len()).sort("robot")
    stuck = stuck.filter((pl.col("value") == 1) & (pl.col("count") >= FEWEST))
    quartiles = energy_of(samples.law.sensor, 0, np.array([0.25, 0.75]), samples.law.place)
    if stuck.height and quartiles[0] < quartiles[1]:
        robots = listed(f"robot {robot}" for robot in stuck["robot"])
        yield f"All values of {robots} are the same, as if a sensor were stuck."


def _doubt_of_the_edges(samples: Samples) -> Iterator[str]:
    """Yield that places are farther outside the surface than their spread explains, if more than a few are."""
    spread_m = np.stack([samples.column(f"spread_{axis}_m") for axis in "xy"])
    whole_m = np.array(samples.size_m)[:, None]
    beyond_m = samples.beyond * whole_m
    outside = (beyond_m > CORNER * whole_m + 3.0 * spread_m).any(axis=0)
    if outside.mean() > OUTSIDE:
        yield (
            f"{outside.sum()} of {outside.size} places are outside the surface, by up to "
            f"{number(100.0 * beyond_m.max(), 1)} cm, which their standard deviation does not explain, as if the size "
            "or the origin were another."
        )


def _alike(frame: pl.DataFrame) -> list[int]:
    """Return the robots most of whose rows are another robot's, too."""
    repeated = frame.select("robot", repeated=frame.drop("robot").is_duplicated())
    share = repeated.group_by("robot").agg(pl.col("repeated").mean())
    return share.filter(pl.col("repeated") > 0.5)["robot"].sort().to_list()


def _doubts_of_values(law: Law, value: Floats, judges_itself: bool) -> Iterator[str]:
    """Yield what is odd about the values of a file under a law.

    Args:
        judges_itself: whether it is known that the law was fitted to them.
    """
    reference = [*(law.sensor.still_energies or ()), *(law.sensor.vibrating_energies or ())]
    shared = int(np.isin(value.astype(np.float32), np.array(reference, dtype=np.float32)).sum())
    is_fine = np.unique(value).size > UNEQUAL * value.size  # so that others are seldom equal by chance
    if not judges_itself and is_fine and shared > 0.5 * min(value.size, len(reference)):
        yield f"{SELF_JUDGED[:-1]}: {shared} of its {value.size} values are in the reference."
    ends = np.stack([energy_of(law.sensor, kind, ndtr(np.array(ENDS)), law.place) for kind in (0, 1)])
    low, high = float(ends.min()), float(ends.max())
    beyond = int(((value < low) | (value > high)).sum())
    if beyond > 0.5 * value.size:
        yield (
            f"{beyond} of {value.size} values are outside of those of the law, {number(low, digits=3)} to "
            f"{number(high, digits=3)}, as if they were in another unit."
        )


def grid_of(rows: int, columns: int, size_m: tuple[float, float]) -> Floor:
    """Return a grid that fills the surface, of which it is not known what vibrates (all still)."""
    return Floor(np.zeros((rows, columns), dtype=np.uint8), size_m[0] / columns, size_m[1] / rows)
