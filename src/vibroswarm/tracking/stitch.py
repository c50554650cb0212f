"""Merge what several cameras saw of one session: match their clocks where their views overlap, and join positions.

Each camera has a lens and a pose of its own, fitted to the markers of the floor that it sees. Where two cameras see a
robot, its place is the weighted mean of both places. The weight of a place is 1 / (m/px)^2, which falls to almost 0
towards the edge of the picture, so that paths do not jump where a robot leaves the picture.

The cameras are joined one after the other; the session's clock is that of the first camera. The offset of a camera is
the time on the session's clock when the camera's own clock is 0. To find the offset, the camera's positions are
compared with those by all cameras that are joined already. In the table and in the functions, "first" stands for the
cameras that are joined already, and "second" for the camera to be joined.

| name | symbol | equation |
|---|---|---|
| positions by the first and second camera | p_a, p_b | |
| velocity of a robot, by the first | v_a | |
| coarse offset | o | lag with the most pairs of positions within `NEAR_M`, less pairs farther apart |
| fine offset | o + delta | least squares of p_b(t) - p_a(t + o) = v_a delta + b, over all robots that both see |
| constant shift in space between the cameras | b | |
| standard error of the fine offset | - | of delta, clustered by robot and blocks of `BLOCK_S`: errors are correlated |
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
"""Step between the lags that are tried, and of the grid of times on which positions are compared."""
EVERY: Final = 4
"""Of the second camera, only one in this many positions on the grid is compared, which is enough."""
NEAR_M: Final = 0.02
"""Two cameras agree about a robot if their positions are within this distance."""
COMMON: Final = 10
"""Fewest positions, a second apart, on which cameras must agree at a lag."""
AGREE: Final = 0.7
"""Of the positions at which both cameras see a robot, the least share on which they must agree at a lag."""
APART_S: Final = 3.0
"""Lags that differ by more than this are rivals: they cannot both be right."""
RIVAL: Final = 0.8
"""If a rival of the best lag scores more than this share of the best score, the offset is not determined."""
BRIDGE_S: Final = 0.3
"""A camera's positions are interpolated over gaps up to this to be compared with another's."""
BLOCK_S: Final = 2.0
"""Length of the blocks by which the standard error is computed."""
WORST_ERROR_S: Final = 0.1
"""With a larger standard error the clocks are not matched: the robots hardly moved where both cameras see."""


@dataclass(frozen=True)
class Overlap:
    """How a camera fits with the cameras that were joined before it."""

    offset_s: float
    """Time on the first camera's clock when the clock of this camera is 0."""
    error_s: float
    """Standard error of the offset."""
    pairs: int
    """Number of positions by this camera at whose times the cameras joined before it saw the robot too."""
    robots: tuple[int, ...]
    """Names of the robots of these positions."""
    places_m: Floats
    """Positions by the cameras joined before it, (pairs, 2)."""
    apart_m: Floats
    """Positions by this camera minus positions by the cameras joined before it, (pairs, 2)."""

    def disagreement_m(self, share: float = 0.5) -> float:
        """Return the quantile ``share`` of the distance between the positions of a pair."""
        return float(np.quantile(np.hypot(self.apart_m[:, 0], self.apart_m[:, 1]), share))


def coarse_offset(first: pl.DataFrame, second: pl.DataFrame) -> float | None:
    """Find the time on the first clock when the second clock is 0, to about ``STEP_S``, by trying all lags.

    Both cameras' positions are interpolated on a grid of times. A lag shifts the second grid against the first one. Its
    score is the number of positions that agree, less the number of positions that do not.

    Args:
        first, second: positions by the cameras joined so far and by another one, ``track.POSITIONS``.
    Returns: None if at no lag enough positions agree, or if a very different lag fits nearly as well.
    """
    robots = sorted({*first["robot"].unique().to_list()} & {*second["robot"].unique().to_list()})
    if not robots:
        return None
    grids = []
    for table, every in ((first, 1), (second, EVERY)):
        start_s = float(table["time_s"].min())  # type: ignore[arg-type]
        times = np.arange(start_s, float(table["time_s"].max()), STEP_S * every)  # type: ignore[arg-type]
        grids.append((start_s, np.stack([interpolated(table, robot, times)[:, :2] for robot in robots])))
    # Start of each grid, and the positions on it, (robots, times, 2); nan: not seen.
    (first_s, of_first), (second_s, of_second) = grids
    reach = (of_second.shape[1] - 1) * EVERY  # length of the second grid, in steps of the first grid
    scores: dict[int, int] = {}
    # A lag is the index on the first camera's grid at which the second camera's grid begins.
    for lag in range(-reach, of_first.shape[1]):
        # Index of the first point of the second grid that lies on the first grid: ``-lag / EVERY`` rounded up, or 0.
        low = max(0, -(lag // EVERY))
        # The points of the first grid at the same times.
        columns = lag + EVERY * np.arange(low, of_second.shape[1])
        columns = columns[columns < of_first.shape[1]]
        apart = of_first[:, columns] - of_second[:, low : low + columns.size]
        distance = np.hypot(apart[..., 0], apart[..., 1])
        both, near = int(np.isfinite(distance).sum()), int((distance < NEAR_M).sum())
        if near >= COMMON and near >= AGREE * both:
            scores[lag] = 2 * near - both  # near - (both - near)
    if not scores:
        return None
    best = max(scores, key=lambda lag: scores[lag])
    others = [score for lag, score in scores.items() if abs(lag - best) * STEP_S > APART_S]
    if max(others, default=0) > RIVAL * scores[best]:
        return None
    return first_s + best * STEP_S - second_s


def fine_offset(first: pl.DataFrame, second: pl.DataFrame, offset_s: float) -> Overlap | None:
    """Refine an offset by least squares, and find how well positions agree.

    Args:
        first, second: positions by the cameras joined so far and by another one, ``track.POSITIONS``.
        offset_s: result of ``coarse_offset``.
    Returns: None if positions do not determine the offset, for instance if robots hardly move where both cameras see
        them.
    """
    robots = sorted({*first["robot"].unique().to_list()} & {*second["robot"].unique().to_list()})
    error_s = np.inf
    rows = np.empty((0, 8))  # the pairs of positions, with the columns that ``_step`` takes
    # A step assumes that velocities are constant. They change along the paths, so steps are repeated until a step is
    # negligible (below 10 microseconds), 8 times at most.
    for _ in range(8):
        parts = []
        for robot in robots:
            own = second.filter(pl.col("robot") == robot)
            times = own["time_s"].to_numpy() + offset_s
            place = interpolated(first, robot, times)[:, :2]
            after, before = (interpolated(first, robot, times + shift_s)[:, :2] for shift_s in (0.1, -0.1))
            velocity = (after - before) / 0.2  # m/s: over 0.1 s before and after
            apart = own.select("x_m", "y_m").to_numpy() - place
            block = np.floor(times / BLOCK_S)
            parts.append(np.column_stack([np.full(times.size, robot), block, place, apart, velocity]))
        rows = np.concatenate(parts)
        # The pairs: nan where the first cameras did not see the robot.
        rows = rows[np.isfinite(rows).all(axis=1)]
        if len(rows) < EVERY * COMMON:  # too few pairs for a fit: fewer than 40
            return None
        step_s, error_s = _step(rows)  # inf as the error if the positions do not determine the offset
        offset_s += step_s
        if abs(step_s) < 1e-5:
            break
    if not error_s < WORST_ERROR_S:  # refuses NaN too
        return None
    return Overlap(
        offset_s=offset_s,
        error_s=error_s,
        pairs=len(rows),
        robots=tuple(int(robot) for robot in np.unique(rows[:, 0])),
        places_m=rows[:, 2:4],
        apart_m=rows[:, 4:6],
    )


def _step(rows: Floats) -> tuple[float, float]:
    """Return by how much an offset must grow (delta), s, and the standard error of delta, s.

    Args:
        rows: for each pair of positions: robot, number of its block of ``BLOCK_S``, place by the first camera (2),
            difference second - first (2), velocity (2), (pairs, 8).
    Returns: 0 and inf if positions do not determine delta.
    """
    apart, velocity = rows[:, 4:6], rows[:, 6:8]
    # Outliers, such as misread markers, are left out: their difference is more than 5 times as far from the median
    # difference as is usual, which is taken as at least 0.1 mm.
    size = np.hypot(*(apart - np.median(apart, axis=0)).T)
    kept = size <= 5.0 * max(float(np.median(size)), 1e-4)
    apart, velocity, blocks = apart[kept], velocity[kept], rows[kept, :2]  # robot and block
    # Least squares with the unknowns delta and b (2); the design matrix is (pairs, 2, 3).
    ones, zeros = np.ones(len(apart)), np.zeros(len(apart))
    design = np.stack(
        [np.column_stack([velocity[:, 0], ones, zeros]), np.column_stack([velocity[:, 1], zeros, ones])],
        axis=1,
    )
    normal = np.einsum("nij,nik->jk", design, design)
    if np.linalg.cond(normal) > 1e12:  # all velocities are about equal: delta cannot be distinguished from b
        return 0.0, np.inf
    solved = np.linalg.solve(normal, np.einsum("nij,ni->j", design, apart))
    # Standard errors clustered by block, since errors within a block are not independent (the "sandwich" estimator):
    # the scores, design times residual, are summed in each block.
    score = np.einsum("nij,ni->nj", design, apart - design @ solved)
    _, block_of_pair = np.unique(blocks, axis=0, return_inverse=True)
    summed = np.zeros((int(block_of_pair.max()) + 1, 3))
    np.add.at(summed, block_of_pair.ravel(), score)
    inverse = np.linalg.inv(normal)
    covariance = inverse @ (summed.T @ summed) @ inverse
    return float(solved[0]), float(np.sqrt(covariance[0, 0]))


def interpolated(table: pl.DataFrame, robot: int, times: Floats) -> Floats:
    """Interpolate x, y, heading and weight of a robot at given times.

    Args:
        table: ``track.POSITIONS``, with or without a column ``weight``. times: (times,).
    Returns: (times, 4). NaN at a time before the first or after the last position, between two positions that are more
        than ``BRIDGE_S`` apart, and at all times if the robot has fewer than two positions. The heading may exceed pi.
        The weight is 1 if the table has no weights.
    """
    own = table.filter(pl.col("robot") == robot)
    time_s = own["time_s"].to_numpy()
    found = np.full((times.size, 4), np.nan)
    if time_s.size < 2:
        return found
    # Index of the position after each time. The limits only keep the index valid at times that are not ``inside``.
    after = np.clip(np.searchsorted(time_s, times), 1, time_s.size - 1)
    inside = (times >= time_s[0]) & (times <= time_s[-1]) & (time_s[after] - time_s[after - 1] <= BRIDGE_S)
    heading = np.unwrap(own["heading_rad"].to_numpy())
    weight = own["weight"].to_numpy() if "weight" in own.columns else np.ones(time_s.size)
    for column, values in enumerate((own["x_m"].to_numpy(), own["y_m"].to_numpy(), heading, weight)):
        found[inside, column] = np.interp(times[inside], time_s, values)
    return found


EDGE: Final = 0.15
"""Width of the margin in which weights fall towards a picture's edge, as a share of the picture's shorter side."""


@dataclass(frozen=True)
class Stitched:
    """Where robots were in a session with one camera or several; the session's clock is that of the first video."""

    cameras: tuple[Tracking, ...]
    """What each camera saw, on its own clock."""
    overlaps: tuple[Overlap | None, ...]
    """How each camera fits with those joined before it, in the order of ``cameras``; None for the first. Cameras may be
    joined in another order than this."""
    positions: pl.DataFrame
    """``track.POSITIONS``, of all cameras together."""
    stops: pl.DataFrame
    """``stops.STOPS``."""

    @property
    def markers(self) -> Markers:
        """The markers, the same for all cameras."""
        return self.cameras[0].markers

    @property
    def jumps(self) -> int:
        """Number of positions dropped in all videos, since no robot is fast enough to reach or leave them."""
        return sum(camera.jumps for camera in self.cameras)

    @property
    def video(self) -> Path:
        """The first video."""
        return self.cameras[0].video

    def offset_s(self, camera: int) -> float:
        """Return the time on the session's clock when the clock of a camera (by its index) is 0."""
        overlap = self.overlaps[camera]
        return 0.0 if overlap is None else overlap.offset_s

    @property
    def span_s(self) -> tuple[float, float]:
        """When the first camera begins and the last one ends, on the session's clock."""
        spans = [
            (camera.span_s[0] + self.offset_s(k), camera.span_s[1] + self.offset_s(k))
            for k, camera in enumerate(self.cameras)
        ]
        return min(first for first, _ in spans), max(last for _, last in spans)

    def gaps(self) -> pl.DataFrame:
        """Return the gaps in which no camera saw a robot: robot, start_s, end_s."""
        return gaps_in(self.positions, list(self.markers.robots.values()), self.span_s)

    def share_found(self) -> float:
        """Return the share of frames in which robots were found, averaged over robots.

        With several cameras, whose frames are taken at different times, it is the share of time outside gaps instead.
        """
        if len(self.cameras) == 1:
            frames, robots = self.cameras[0].detections.corners_px.shape[:2]
            return float(self.positions.height / (frames * robots))
        gone = self.gaps()
        away_s = float((gone["end_s"] - gone["start_s"]).sum())
        first_s, last_s = self.span_s
        return 1.0 - away_s / (len(self.markers.robots) * (last_s - first_s))

    def warnings(self) -> list[str]:
        """Return sentences on what a user should know of these videos, such as robots that were never seen."""
        if len(self.cameras) == 1:
            return self.cameras[0].warnings()
        found = [
            f"{camera.video.name}: {words}"
            for camera in self.cameras
            for words in camera.warnings(alone=False)
        ]
        # With ``alone=False`` a camera does not report robots that it never saw: another may have seen them. Those that
        # no camera saw are reported here.
        seen = set(self.positions["robot"].unique().to_list())
        never = [name for name in self.markers.robots.values() if name not in seen]
        return found + ([f"Never seen: robots {', '.join(map(str, never))}."] if never else [])


def stitch(cameras: Sequence[Tracking]) -> Stitched:
    """Merge what several cameras saw of one session; for a single camera, return what it saw.

    Args:
        cameras: at least one. The session's clock is that of the first one.
    Raises:
        InputError: the clock of a camera cannot be matched with the others; the message names its video.
    """
    first, *others = cameras
    if not others:
        return Stitched((first,), (None,), positions=first.positions, stops=first.stops)
    merged = _weighted(first)
    overlaps: list[Overlap | None] = [None] * len(cameras)
    left = list(range(1, len(cameras)))
    while left:
        # Join any camera whose view overlaps with those joined so far. Others may overlap only with this camera, so
        # they are tried again after it. If no camera can be joined, the ``else`` below is reached.
        for number in left:
            table = _weighted(cameras[number])
            coarse = coarse_offset(merged, table)
            if coarse is None:
                continue
            overlap = fine_offset(merged, table, coarse)
            if overlap is None:
                continue
            overlaps[number] = overlap
            # ``merged`` is on the first camera's clock, so the camera's times are moved to this clock.
            merged = _merged(merged, table.with_columns(pl.col("time_s") + overlap.offset_s))
            left.remove(number)
            break
        else:
            raise InputError(
                "cannot be joined with the other videos: no robot moves where both see it, at whatever difference of "
                "their clocks. Views must overlap, robots must drive there, and both videos must be of one session",
                field=str(cameras[left[0]].video),
            )
    # Some robot has rows: cameras are joined by the robots that they share. Robots that no camera saw have none.
    tables, stops = [], []
    for robot in first.markers.robots.values():
        own = merged.filter(pl.col("robot") == robot).sort("time_s")
        if own.height:
            columns = [own[name].to_numpy() for name in ("time_s", "x_m", "y_m", "heading_rad")]
            tables.append(own.select(POSITIONS.keys()))
            stops.append(stops_of(robot, *columns))
    return Stitched(
        cameras=tuple(cameras),
        overlaps=tuple(overlaps),
        positions=pl.concat(tables),
        stops=pl.concat(stops) if stops else pl.DataFrame(schema=STOPS),
    )


def weights_of(tracking: Tracking, positions: pl.DataFrame) -> Floats:
    """Return the weights of a camera's positions, (positions,): 1 / (m/px)^2, smaller near the picture's edge.

    A weight falls to 1 % at the edge itself. It does not fall to 0, so that a sum of weights is never 0.
    """
    width, height = tracking.detections.size_px
    at = np.column_stack(
        [positions["x_m"], positions["y_m"], np.full(positions.height, tracking.markers.height_m)]
    )
    pixels = tracking.camera.project(at)
    # Distance of each position from the nearest edge of the picture, px.
    room = np.minimum(pixels, np.array([width, height]) - 1 - pixels).min(axis=1)
    per_px_m = (tracking.camera.position_m[2] - tracking.markers.height_m) / tracking.camera.lens.matrix[0, 0]
    # Full weight at least a margin (``EDGE``) away from the edge; within the margin, less and less towards the edge.
    weights: Floats = np.clip(room / (EDGE * min(width, height)), 0.01, 1.0) / per_px_m**2
    return weights


def _weighted(tracking: Tracking) -> pl.DataFrame:
    """Return the positions of a camera with a column ``weight``."""
    weights = pl.Series("weight", weights_of(tracking, tracking.positions))
    return tracking.positions.with_columns(weights)


def _merged(first: pl.DataFrame, second: pl.DataFrame) -> pl.DataFrame:
    """Join two tables of positions with weights, whose times are on the same clock.

    Where both tables have a robot, the rows are at the times of the first table; they have the weighted mean of the
    poses and the sum of the weights. Where only one table has a robot, its rows are taken as they are.
    """
    parts = []
    for robot in sorted({*first["robot"].unique().to_list(), *second["robot"].unique().to_list()}):
        own = first.filter(pl.col("robot") == robot)
        time_s = own["time_s"].to_numpy()
        other = interpolated(second, robot, time_s)
        both = np.asarray(np.isfinite(other).all(axis=1))  # times at which both tables have the robot
        # Share of the second table in the weight; 0 where only the first table has the robot.
        share = np.where(both, other[:, 3] / (other[:, 3] + own["weight"].to_numpy()), 0.0)
        # 0 instead of NaN, since NaN would remain NaN even with the share 0.
        other = np.where(both[:, None], other, 0.0)
        mean = {
            name: (1.0 - share) * own[name].to_numpy() + share * other[:, column]
            for column, name in enumerate(("x_m", "y_m"))
        }
        # The mean of headings as unit vectors, so that -pi and pi are the same.
        turned = (1.0 - share) * np.exp(1j * own["heading_rad"].to_numpy()) + share * np.exp(1j * other[:, 2])
        weight = own["weight"].to_numpy() + other[:, 3]
        parts.append(
            own.with_columns(
                x_m=pl.Series(mean["x_m"]), y_m=pl.Series(mean["y_m"]), heading_rad=pl.Series(np.angle(turned)),
                weight=pl.Series(weight),
            )
        )  # fmt: skip
        # Rows of the second table are added at times at which the first table cannot be interpolated. Of these, rows
        # within half a frame of a row of the first table are left out: they would give the same moment twice.
        of_second = second.filter(pl.col("robot") == robot)
        times = of_second["time_s"].to_numpy()
        alone = ~np.isfinite(interpolated(first, robot, times)[:, 0]) & (
            _to_nearest(times, time_s) > 0.5 * _usual_step(times)
        )
        parts.append(of_second.filter(pl.Series(alone, dtype=pl.Boolean)).select(own.columns))
    return pl.concat(parts).sort("robot", "time_s")


def _to_nearest(times: Floats, others: Floats) -> Floats:
    """Return the time from each of ``times`` to the nearest of ``others``, (times,); inf if ``others`` is empty.

    Args:
        others: ascending.
    """
    if not others.size:
        return np.full(times.size, np.inf)
    if others.size == 1:
        only: Floats = np.abs(times - others[0])
        return only
    # The two of ``others`` around each time; for a time before the first or after the last of them, the nearest two.
    after = np.clip(np.searchsorted(others, times), 1, others.size - 1)
    return np.minimum(np.abs(times - others[after]), np.abs(times - others[after - 1]))


def _usual_step(times: Floats) -> float:
    """Return the median step between times; 0 with fewer than two."""
    return float(np.median(np.diff(times))) if times.size > 1 else 0.0
