"""Compute statistics in which robots and simulators differ, session by session: what a calibration has to reproduce.

Each run is a session. Intervals are over sessions (Student's t). Error rates depend on the scenario's threshold, so
sources with different thresholds have to be compared at one common threshold (``rms_threshold``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.lab.calibrate.drive import LEAST_DRIVES, drive_table, line_of
from vibroswarm.lab.calibrate.samples import ROUNDING_S, lag_one, nearest_tile, sample_table
from vibroswarm.result import Result
from vibroswarm.statistics.intervals import Interval, mean_interval, mean_share_interval
from vibroswarm.statistics.sampling import packet_loss

FIGURES: Final[dict[str, tuple[str, float]]] = {
    "speed_m_s": ("speed, mm/s", 1e3),
    "start_speed_m_s": ("speed at the start, mm/s", 1e3),
    "drop": ("speed lost in 1200 s, %", 100.0),
    "between_m_s": ("speed, spread between robots, mm/s", 1e3),
    "within_m_s": ("speed, spread within a robot, mm/s", 1e3),
    "share_between": ("share of the variance between robots, %", 100.0),
    "lag_one": ("speed, correlation with the next drive's", 1.0),
    "veer_rad_s": ("veer, deg/s", 180.0 / math.pi),
    "veer_between_rad_s": ("veer, spread between robots, deg/s", 180.0 / math.pi),
    "veer_within_rad_s": ("veer, spread within a robot, deg/s", 180.0 / math.pi),
    "spacing_s": ("time between samples, s", 1.0),
    "distance_m": ("distance between samples, mm", 1e3),
    "avoid_s": ("avoidance per sample, ms", 1e3),
    "avoid_none": ("samples without avoidance, %", 100.0),
    "avoid_most_s": ("97.5 % quantile of the other ones', ms", 1e3),
    "density_corners": ("samples in corner tiles against even", 1.0),
    "density_inside": ("samples off the rim's tiles against even", 1.0),
    "near_walls": ("samples within 25 mm of a wall against even", 1.0),
    "off_walls": ("samples 50 to 75 mm from a wall against even", 1.0),
    "false_positive": ("still read as vibrating, %", 100.0),
    "false_negative": ("vibrating read as still, %", 100.0),
    "lag_one_bits": ("bits, correlation with the robot's next", 1.0),
    "packet_loss": ("messages lost, %", 100.0),
}
"""Label of each statistic, and the factor with which it is shown."""
SHARES: Final = ("share_between", "avoid_none", "false_positive", "false_negative", "packet_loss")
"""Statistics between 0 and 1."""


SPAN_S: Final = 1200.0
"""Time in which the drop of the speed is measured."""


@dataclass(frozen=True)
class Figure:
    """A statistic of a result, for each session and as a mean over sessions."""

    name: str
    """One of ``FIGURES``."""
    by_session: tuple[float | None, ...]
    """Value in each session, SI units; None where it is undefined."""
    interval: Interval | None
    """Mean over sessions with its interval; None if no session has a value."""


def figures_of(result: Result, rms_threshold: float | None = None) -> list[Figure]:
    """Return all statistics of a result, in the order of ``FIGURES``; each run is a session.

    Args:
        rms_threshold: threshold that turns energies into bits; None: the scenario's.
    Raises:
        InputError: the result has no energies.
    """
    threshold = result.scenario.sensor.rms_threshold if rms_threshold is None else rms_threshold
    samples, lost = sample_table(result), packet_loss(result)
    drives = drive_table(result, samples)
    sessions: list[dict[str, Any]] = []
    for run in result.runs["run"].to_list():
        values = _of_drives(drives.filter(run=run)) | _of_samples(result, samples.filter(run=run), threshold)
        sessions.append(values | {"packet_loss": next(iter(lost.filter(run=run)["packet_loss"]), None)})
    figures = []
    for name in FIGURES:
        column = [session.get(name) for session in sessions]
        values_of = [None if one is None or not math.isfinite(one) else float(one) for one in column]
        known = [one for one in values_of if one is not None]
        interval = mean_share_interval if name in SHARES else mean_interval
        figures.append(Figure(name, tuple(values_of), interval(known) if known else None))
    return figures


def _of_drives(drives: pl.DataFrame) -> dict[str, Any]:
    """Return the statistics of one session's drives by name; robots with few drives are left out."""
    lines = [line_of(own) for own in drives.partition_by("robot") if own.height >= LEAST_DRIVES]
    if not lines:
        return {}
    table = pl.DataFrame(lines, infer_schema_length=None)
    speed, veer = pl.col("speed_m_s"), pl.col("veer_rad_s").cast(pl.Float64)
    values = table.select(
        speed.mean(),
        pl.col("start_speed_m_s", "lag_one").mean(),
        drop=(SPAN_S * pl.col("lost_per_s")).mean(),
        between_m_s=speed.std(),
        within_m_s=pl.col("within_m_s").pow(2).mean().sqrt(),
        veer_rad_s=veer.mean(),
        veer_between_rad_s=veer.std(),
        veer_within_rad_s=pl.col("veer_within_rad_s").cast(pl.Float64).mean(),
    ).to_dicts()[0]
    if values["between_m_s"] is not None:
        between, within = values["between_m_s"] ** 2, values["within_m_s"] ** 2
        values["share_between"] = between / max(between + within, 1e-30)
    return values


def _of_samples(result: Result, samples: pl.DataFrame, threshold: float) -> dict[str, Any]:
    """Return the statistics of one session's samples by name; None or NaN if undefined.

    Args:
        samples: rows of ``sample_table`` of one session.
        threshold: threshold that turns energies into bits.
    """
    size_m = result.scenario.arena.size_m
    x, y, wall, energy = (samples[name].to_numpy() for name in ("x_m", "y_m", "wall_m", "energy"))
    kind, bits = samples["vibrating"].to_numpy(), energy > threshold  # kind: whether the tile below vibrates
    avoid = samples["avoid_s"].drop_nulls().to_numpy()
    positive = avoid[avoid > ROUNDING_S]
    return {
        "spacing_s": samples["spacing_s"].mean(),
        "distance_m": samples["distance_m"].mean(),
        "avoid_s": avoid.mean() if avoid.size else None,
        "avoid_none": (avoid <= ROUNDING_S).mean() if avoid.size else None,
        "avoid_most_s": np.quantile(positive, 0.975) if positive.size else None,
        **_density(result, x, y),
        # Within 25 mm of the nearest wall, and 50 to 75 mm from it.
        "near_walls": _ring(wall, 0.0, 0.025, *size_m),
        "off_walls": _ring(wall, 0.05, 0.075, *size_m),
        "false_positive": bits[~kind].mean() if (~kind).any() else None,
        "false_negative": (~bits[kind]).mean() if kind.any() else None,
        "lag_one_bits": lag_one(bits, samples["robot"].to_numpy()),
    }


def _density(result: Result, x: Any, y: Any) -> dict[str, float | None]:
    """Return the density of samples on the four corner tiles, and on all tiles but the outermost rows and columns.

    Both densities are relative to a uniform density: the share of samples divided by the share of tiles. They are None
    on floors with fewer than three rows or columns of tiles.

    Args:
        x, y: positions of the samples, m, (samples,).
    """
    # All runs are taken to have tiles of the same number and size as the first run.
    floor = result.floor(int(result.runs["run"][0]))
    rows, columns = floor.tiles.shape
    if rows < 3 or columns < 3:
        return {"density_corners": None, "density_inside": None}
    row, column = nearest_tile(floor, x, y)
    rim_x, rim_y = (column == 0) | (column == columns - 1), (row == 0) | (row == rows - 1)
    tiles = rows * columns
    return {
        "density_corners": float((rim_x & rim_y).mean()) * tiles / 4,
        "density_inside": float((~rim_x & ~rim_y).mean()) * tiles / ((rows - 2) * (columns - 2)),
    }


def _ring(wall: Any, low_m: float, high_m: float, width_m: float, height_m: float) -> float | None:
    """Return the density of samples at ``low_m`` to ``high_m`` from the nearest wall, relative to a uniform density.

    The result is None in an arena so narrow that no place is so far from the walls.

    Args:
        wall: distance of each sample from the nearest wall, m, (samples,).
    """

    def area_beyond(distance_m: float) -> float:
        """Return the area of the places that are farther than this from all walls, m^2."""
        return max(width_m - 2 * distance_m, 0.0) * max(height_m - 2 * distance_m, 0.0)

    expected = (area_beyond(low_m) - area_beyond(high_m)) / (width_m * height_m)
    return float(((wall >= low_m) & (wall < high_m)).mean()) / expected if expected > 0 else None
