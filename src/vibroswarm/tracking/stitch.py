"""One session as several cameras saw it: their clocks matched where their views overlap, their positions merged.

Each camera has a lens and a pose of its own, fitted to the markers of the floor that it sees. Where two see a robot,
its place is the mean of both, weighted by 1 / (mm/px)^2, which falls to almost 0 at a picture's edge, so that paths do
not jump where a robot leaves a picture.

| name | symbol | equation |
|---|---|---|
| coarse offset | o | lag at which most positions of common robots lie within `NEAR_M` of each other |
| fine offset | o + delta | least squares of p_b(t) - p_a(t + o) = v_a delta + b, over all robots that both see |
| its standard error | - | of delta, by blocks of a robot and `BLOCK_S`: errors of neighbouring frames are alike |
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.tracking.markers import Markers
from vibroswarm.tracking.stops import STOPS, stops_of
from vibroswarm.tracking.track import POSITIONS, Tracking, gaps_in

Floats = NDArray[np.float64]

STEP_S: Final = 0.25
"""Lags that are tried."""
EVERY: Final = 4
"""One in so many of the second camera's positions on that grid is compared."""
NEAR_M: Final = 0.02
"""Two cameras that see one robot agree within this at the right lag."""
COMMON: Final = 10
"""Positions, a second apart, that both must see."""
AGREE: Final = 0.7
"""Share of them that must agree."""
APART_S: Final = 3.0
RIVAL: Final = 0.8
"""No lag that differs by more than ``APART_S`` may agree on more than this share of what the best one agrees on."""
BRIDGE_S: Final = 0.3
"""A camera's positions are interpolated over no more than this to be compared with another's."""
BLOCK_S: Final = 2.0
WORST_ERROR_S: Final = 0.1
"""With a larger standard error the clocks are not matched: the robots hardly moved where both cameras see."""


@dataclass(frozen=True)
class Overlap:
    """How a camera fits with those before it."""

    offset_s: float
    """Time on the first camera's clock when that of this one is 0."""
    error_s: float
    """Standard error."""
    pairs: int
    """Positions of this camera that the others saw too."""
    robots: tuple[int, ...]
    places_m: Floats
    """(pairs, 2): where."""
    apart_m: Floats
    """(pairs, 2): this camera's less the others'."""

    def disagreement_m(self, share: float = 0.5) -> float:
        """Return the distance that this share of the pairs stays within."""
        return float(np.quantile(np.hypot(self.apart_m[:, 0], self.apart_m[:, 1]), share))


def coarse_offset(first: pl.DataFrame, second: pl.DataFrame) -> float | None:
    """Return the time on the first clock when the second is 0, to about ``STEP_S``; None: no lag fits.

    Args:
        first, second: positions, ``track.POSITIONS``.
    """
    robots = sorted({*first["robot"].unique().to_list()} & {*second["robot"].unique().to_list()})
    if not robots:
        return None
    grids = []
    for table, every in ((first, 1), (second, EVERY)):
        start_s = float(table["time_s"].min())  # type: ignore[arg-type]
        times = np.arange(start_s, float(table["time_s"].max()), STEP_S * every)  # type: ignore[arg-type]
        grids.append((start_s, np.stack([interpolated(table, robot, times)[:, :2] for robot in robots])))
    (first_s, a), (second_s, b) = grids
    reach = (b.shape[1] - 1) * EVERY
    scores: dict[int, int] = {}
    for lag in range(-reach, a.shape[1]):
        low = max(
            0, -(lag // EVERY)
        )  # the first of the second camera's points that the first one's grid holds
        rows = lag + EVERY * np.arange(low, b.shape[1])
        rows = rows[rows < a.shape[1]]
        apart = a[:, rows] - b[:, low : low + rows.size]
        distance = np.hypot(apart[..., 0], apart[..., 1])
        both, near = int(np.isfinite(distance).sum()), int((distance < NEAR_M).sum())
        if near >= COMMON and near >= AGREE * both:
            scores[lag] = 2 * near - both
    if not scores:
        return None
    best = max(scores, key=lambda lag: scores[lag])
    others = [score for lag, score in scores.items() if abs(lag - best) * STEP_S > APART_S]
    if max(others, default=0) > RIVAL * scores[best]:
        return None
    return first_s + best * STEP_S - second_s


def fine_offset(first: pl.DataFrame, second: pl.DataFrame, offset_s: float) -> Overlap | None:
    """Return the offset by least squares, and how well positions agree; None: robots hardly move in the overlap."""
    robots = sorted({*first["robot"].unique().to_list()} & {*second["robot"].unique().to_list()})
    error_s = np.inf
    rows = np.empty((0, 8))
    for _ in range(8):
        parts = []
        for robot in robots:
            own = second.filter(pl.col("robot") == robot)
            times = own["time_s"].to_numpy() + offset_s
            here = interpolated(first, robot, times)[:, :2]
            speed = (interpolated(first, robot, times + 0.1) - interpolated(first, robot, times - 0.1))[
                :, :2
            ] / 0.2
            apart = own.select("x_m", "y_m").to_numpy() - here
            block = np.floor(times / BLOCK_S)
            parts.append(np.column_stack([np.full(times.size, robot), block, here, apart, speed]))
        rows = np.concatenate(parts)
        rows = rows[np.isfinite(rows).all(axis=1)]
        if len(rows) < EVERY * COMMON:
            return None
        step_s, error_s = _step(rows)
        offset_s += step_s
        if abs(step_s) < 1e-5:
            break
    if not error_s < WORST_ERROR_S:
        return None
    seen = tuple(int(robot) for robot in np.unique(rows[:, 0]))
    return Overlap(offset_s, error_s, len(rows), seen, rows[:, 2:4], rows[:, 4:6])


def _step(rows: Floats) -> tuple[float, float]:
    """Return by how much an offset is to grow, s, and its standard error; 0 and inf if positions do not determine it.

    Args:
        rows: (pairs, 8): robot, block, place, difference, velocity.
    """
    apart, speed = rows[:, 4:6], rows[:, 6:8]
    size = np.hypot(*(apart - np.median(apart, axis=0)).T)
    kept = size <= 5.0 * max(float(np.median(size)), 1e-4)
    apart, speed, blocks = apart[kept], speed[kept], rows[kept, :2]
    # Unknowns: delta, and the shift b of one camera against the other.
    ones, zeros = np.ones(len(apart)), np.zeros(len(apart))
    design = np.stack(
        [np.column_stack([speed[:, 0], ones, zeros]), np.column_stack([speed[:, 1], zeros, ones])], axis=1
    )
    normal = np.einsum("nij,nik->jk", design, design)
    if np.linalg.cond(normal) > 1e12:
        return 0.0, np.inf
    solved = np.linalg.solve(normal, np.einsum("nij,ni->j", design, apart))
    score = np.einsum("nij,ni->nj", design, apart - design @ solved)
    _, group = np.unique(blocks, axis=0, return_inverse=True)
    summed = np.zeros((int(group.max()) + 1, 3))
    np.add.at(summed, group.ravel(), score)
    inverse = np.linalg.inv(normal)
    covariance = inverse @ (summed.T @ summed) @ inverse
    return float(solved[0]), float(np.sqrt(covariance[0, 0]))


def interpolated(table: pl.DataFrame, robot: int, times: Floats) -> Floats:
    """Return x, y, heading and weight of a robot at times, (times, 4), between the positions before and after.

    NaN where one of these is missing, or they are more than ``BRIDGE_S`` apart.

    Args:
        table: ``track.POSITIONS``, and ``weight`` if it has weights.
    """
    own = table.filter(pl.col("robot") == robot)
    time_s = own["time_s"].to_numpy()
    found = np.full((times.size, 4), np.nan)
    if time_s.size < 2:
        return found
    after = np.clip(np.searchsorted(time_s, times), 1, time_s.size - 1)
    inside = (times >= time_s[0]) & (times <= time_s[-1]) & (time_s[after] - time_s[after - 1] <= BRIDGE_S)
    heading = np.unwrap(own["heading_rad"].to_numpy())
    weight = own["weight"].to_numpy() if "weight" in own.columns else np.ones(time_s.size)
    for column, values in enumerate((own["x_m"].to_numpy(), own["y_m"].to_numpy(), heading, weight)):
        found[inside, column] = np.interp(times[inside], time_s, values)
    return found


EDGE: Final = 0.15
"""Share of a picture's shorter side over which weights fall to 0 towards its edge."""


@dataclass(frozen=True)
class Stitched:
    """Where robots were in a session, by one camera or several; times are those of the first video."""

    cameras: tuple[Tracking, ...]
    overlaps: tuple[Overlap | None, ...]
    """Of each camera; None: the first."""
    positions: pl.DataFrame
    """``track.POSITIONS``."""
    stops: pl.DataFrame

    @property
    def markers(self) -> Markers:
        """The markers, the same for all cameras."""
        return self.cameras[0].markers

    @property
    def jumps(self) -> int:
        """Positions that were dropped as too fast."""
        return sum(camera.jumps for camera in self.cameras)

    @property
    def video(self) -> Path:
        """The first video."""
        return self.cameras[0].video

    def offset_s(self, camera: int) -> float:
        """Return the time on the first camera's clock when that of a camera is 0."""
        overlap = self.overlaps[camera]
        return 0.0 if overlap is None else overlap.offset_s

    @property
    def span_s(self) -> tuple[float, float]:
        """When the first camera begins and the last one ends."""
        spans = [
            (camera.span_s[0] + self.offset_s(k), camera.span_s[1] + self.offset_s(k))
            for k, camera in enumerate(self.cameras)
        ]
        return min(first for first, _ in spans), max(last for _, last in spans)

    def gaps(self) -> pl.DataFrame:
        """Return the gaps in which no camera saw a robot: robot, start_s, end_s."""
        return gaps_in(self.positions, list(self.markers.robots.values()), self.span_s)

    def share_found(self) -> float:
        """Return the share of positions found, of those that would be with every robot in every frame."""
        if len(self.cameras) == 1:
            frames, robots = self.cameras[0].detections.corners_px.shape[:2]
            return float(self.positions.height / (frames * robots))
        gone = self.gaps()
        away_s = float((gone["end_s"] - gone["start_s"]).sum())
        first_s, last_s = self.span_s
        return 1.0 - away_s / (len(self.markers.robots) * (last_s - first_s))

    def warnings(self) -> list[str]:
        """Return what a user should know of these videos, in sentences."""
        if len(self.cameras) == 1:
            return self.cameras[0].warnings()
        found = [
            f"{camera.video.name}: {words}"
            for camera in self.cameras
            for words in camera.warnings(alone=False)
        ]
        seen = set(self.positions["robot"].unique().to_list())
        never = [name for name in self.markers.robots.values() if name not in seen]
        return found + ([f"Never seen: robots {', '.join(map(str, never))}."] if never else [])


def stitch(cameras: Sequence[Tracking]) -> Stitched:
    """Merge what several cameras saw of one session.

    Raises:
        InputError: a camera has no robot in common with the others, or the clocks cannot be matched; names its video.
    """
    first, *others = cameras
    if not others:
        return Stitched((first,), (None,), first.positions, first.stops)
    merged = _weighted(first)
    overlaps: list[Overlap | None] = [None] * len(cameras)
    left = list(range(1, len(cameras)))
    while left:
        # A camera in the middle of a row may be needed before one at its end fits.
        for number in left:
            table = _weighted(cameras[number])
            coarse = coarse_offset(merged, table)
            if coarse is None:
                continue
            overlap = fine_offset(merged, table, coarse)
            if overlap is None:
                continue
            overlaps[number] = overlap
            merged = _merged(merged, table.with_columns(pl.col("time_s") + overlap.offset_s))
            left.remove(number)
            break
        else:
            raise InputError(
                "cannot be joined with the other videos: no robot moves where both see it, at whatever difference of "
                "their clocks. Views must overlap, robots must drive there, and both videos must be of one session",
                field=str(cameras[left[0]].video),
            )
    tables, stops = [], []
    for robot in first.markers.robots.values():
        own = merged.filter(pl.col("robot") == robot).sort("time_s")
        if own.height:
            columns = [own[name].to_numpy() for name in ("time_s", "x_m", "y_m", "heading_rad")]
            tables.append(own.select(POSITIONS.keys()))
            stops.append(stops_of(robot, *columns))
    return Stitched(
        tuple(cameras),
        tuple(overlaps),
        pl.concat(tables),
        pl.concat(stops) if stops else pl.DataFrame(schema=STOPS),
    )


def weights_of(tracking: Tracking, positions: pl.DataFrame) -> Floats:
    """Return the weights of a camera's positions, (positions,): resolution squared, less towards the picture's edge."""
    width, height = tracking.detections.size_px
    at = np.column_stack(
        [positions["x_m"], positions["y_m"], np.full(positions.height, tracking.markers.height_m)]
    )
    pixels = tracking.camera.project(at)
    room = np.minimum(pixels, np.array([width, height]) - 1 - pixels).min(axis=1)
    per_px_m = (tracking.camera.position_m[2] - tracking.markers.height_m) / tracking.camera.lens.matrix[0, 0]
    weights: Floats = np.clip(room / (EDGE * min(width, height)), 0.01, 1.0) / per_px_m**2
    return weights


def _weighted(tracking: Tracking) -> pl.DataFrame:
    weights = pl.Series("weight", weights_of(tracking, tracking.positions))
    return tracking.positions.with_columns(weights)


def _merged(first: pl.DataFrame, second: pl.DataFrame) -> pl.DataFrame:
    """Return the positions of two tables on the same clock as one, with summed weights.

    Where both see a robot, the times are the first's and the place is the weighted mean; elsewhere rows are kept.
    """
    parts = []
    for robot in sorted({*first["robot"].unique().to_list(), *second["robot"].unique().to_list()}):
        own = first.filter(pl.col("robot") == robot)
        time_s = own["time_s"].to_numpy()
        other = interpolated(second, robot, time_s)
        both = np.asarray(np.isfinite(other).all(axis=1))
        share = np.where(both, other[:, 3] / (other[:, 3] + own["weight"].to_numpy()), 0.0)
        other = np.where(both[:, None], other, 0.0)
        mean = {
            name: (1.0 - share) * own[name].to_numpy() + share * other[:, column]
            for column, name in enumerate(("x_m", "y_m"))
        }
        turned = (1.0 - share) * np.exp(1j * own["heading_rad"].to_numpy()) + share * np.exp(1j * other[:, 2])
        weight = own["weight"].to_numpy() + other[:, 3]
        parts.append(
            own.with_columns(
                x_m=pl.Series(mean["x_m"]), y_m=pl.Series(mean["y_m"]), heading_rad=pl.Series(np.angle(turned)),
                weight=pl.Series(weight),
            )
        )  # fmt: skip
        new = second.filter(pl.col("robot") == robot)
        times = new["time_s"].to_numpy()
        alone = ~np.isfinite(interpolated(first, robot, times)[:, 0]) & (
            _to_nearest(times, time_s) > 0.5 * _usual(times)
        )
        parts.append(new.filter(pl.Series(alone, dtype=pl.Boolean)).select(own.columns))
    return pl.concat(parts).sort("robot", "time_s")


def _to_nearest(times: Floats, others: Floats) -> Floats:
    """Return the time from each of ``times`` to the nearest of ``others``, (times,); inf if there are none."""
    if not others.size:
        return np.full(times.size, np.inf)
    after = np.clip(np.searchsorted(others, times), 1, max(others.size - 1, 1))
    after = np.minimum(after, others.size - 1)
    return np.minimum(np.abs(times - others[after]), np.abs(times - others[after - 1]))


def _usual(times: Floats) -> float:
    return float(np.median(np.diff(times))) if times.size > 1 else 0.0
