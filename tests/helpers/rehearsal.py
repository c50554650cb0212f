"""Rehearse a session with a camera: write the files that it would leave, from a simulated run.

These are the video, the robots' log and the file of markers; also the true poses, which a real session does not give,
and a video of a chessboard for the calibration of the lens. Now and then a person's hand reaches into the picture and
hides robots, as in a real session (``scene``).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from helpers.scene import BLACK, OF_BOARD, PAPER, Look, Scene, poses_at, scene_of
from helpers.video_writer import VideoWriter
from vibroswarm.core.atomic_io import whole_file
from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError
from vibroswarm.lab.tracking import opencv
from vibroswarm.lab.tracking.markers import Markers
from vibroswarm.result import Result

Floats = NDArray[np.float64]

TRUTH: Final = {
    "frame": pl.UInt32, "time_s": pl.Float64, "robot": pl.UInt16, "marker": pl.UInt16, "x_m": pl.Float64,
    "y_m": pl.Float64, "heading_rad": pl.Float64, "hidden": pl.Boolean,
}  # fmt: skip
"""Columns of the truth: each robot's centre in each frame (time in the video), and whether a hand covers it."""

BOARD: Final = (9, 6)
"""Inner corners of the chessboard, across and down."""
SQUARE_MM: Final = 40.0
"""Edge of a square of the chessboard."""
BOARD_FRAMES: Final = 40
"""Frames of the video of the chessboard; the board has another place in each."""


@dataclass(frozen=True)
class Rehearsal:
    """Files of a rehearsal, and what was drawn."""

    video: Path
    markers: Path
    log: Path
    truth: Path
    chessboard: Path | None
    frames: int
    marker_px: float
    """Edge of a robot's marker in the middle of the image."""


def write_rehearsal(
    result: Result,
    out: Path,
    markers: Markers,
    look: Look,
    *,
    run: int = 0,
    seed: int = 1,
    start_s: float = 0.0,
    duration_s: float | None = None,
    clock_offset_s: float = 0.0,
    chessboard: bool = False,
    board_frames: int = BOARD_FRAMES,
    replace: bool = False,
) -> Rehearsal:
    """Render a run of a result as a video, and write the files that go with it.

    Args:
        result: with paths (``poses=True``). out: the video; the other files are named after it.
        markers: of the robots, one for each robot of the result in the order of their numbers, and of the floor.
        look: how the video is recorded. run, seed: number of the run, and seed of what is random in the video.
        start_s, duration_s: beginning and length of the part of the run that is filmed; None: to the run's end.
        clock_offset_s: time on the robots' clock when the time of the run is 0.
        chessboard, board_frames: whether a video of a chessboard, seen by the same camera, is written too, and how
            many frames it has.
        replace: whether files that exist are replaced.
    Raises:
        InputError: the result has no paths or no such run; there are fewer than two frames in that time; or a file
            exists. RunError: a file cannot be written.
    """
    names = {
        kind: out.with_name(f"{out.stem}.{kind}") for kind in ("markers.toml", "log.csv", "truth.parquet")
    }
    times = _frame_times(result, run, look, start_s, duration_s)
    scene = scene_of(result, run, markers, look, seed)
    middle, hidden = _render(scene, result, run, times, out, replace)
    _write_truth(names["truth.parquet"], times - times[0], middle, hidden, markers, replace)
    with whole_file(names["markers.toml"], replace=replace) as part:
        part.write_text(markers.to_toml(), encoding="utf-8")
    with whole_file(names["log.csv"], replace=replace) as part:
        part.write_bytes(csv_bytes(robot_log(result, run, markers, clock_offset_s)))
    return Rehearsal(
        video=out,
        markers=names["markers.toml"],
        log=names["log.csv"],
        truth=names["truth.parquet"],
        chessboard=_write_board(scene, out, board_frames, replace) if chessboard else None,
        frames=times.size,
        marker_px=_px_per_m(scene) * markers.size_m,
    )


def _frame_times(result: Result, run: int, look: Look, start_s: float, duration_s: float | None) -> Floats:
    """Return when the camera takes its frames, (frames,), s.

    Times are those of the run. The last exposure ends before the end of the run.

    Raises:
        InputError: there is no such run, or it has fewer than two frames in that time.
    """
    if result.runs.filter(pl.col("run") == run).is_empty():
        raise InputError(f"there is no run {run} in this result", field="run")
    end_s = float(result.ends.filter(pl.col("run") == run)["end_s"].max() or 0.0)  # type: ignore[arg-type]
    last_s = end_s if duration_s is None else min(start_s + duration_s, end_s)
    times: Floats = np.arange(start_s, last_s - look.exposure_s, 1.0 / look.frames_per_s)
    if times.size < 2:
        raise InputError(f"the run lasts {end_s:g} s; there is nothing from {start_s:g} s", field="start_s")
    return times


def _render(
    scene: Scene,
    result: Result,
    run: int,
    times: Floats,
    out: Path,
    replace: bool,
) -> tuple[Floats, NDArray[np.bool_]]:
    """Write the video of one camera.

    Args:
        times: middles of the exposures, on the clock of the run, (frames,), s. out: the video.
        replace: whether an existing video is replaced.
    Returns: the pose (x, y, heading) of each robot in the middle of each exposure, (frames, robots, 3); and whether the
        hand that now and then reaches into the picture covers the robot's marker in the frame, (frames, robots).
    """
    look, robots = scene.look, len(scene.markers.robots)
    half_s = look.exposure_s / 2
    # Poses when each exposure begins, in its middle, and when it ends: a robot that moves is blurred between the first
    # and the last. An exposure around time 0 would begin before the run, where there are no poses: it begins at 0.
    before, middle, after = (
        poses_at(result, run, robots, np.maximum(times + shift_s, 0.0)) for shift_s in (-half_s, 0.0, half_s)
    )
    hidden = np.zeros((times.size, robots), dtype=np.bool_)
    with (
        whole_file(out, replace=replace) as part,
        VideoWriter(part, look.size_px, look.frames_per_s) as writer,
    ):
        for k, time_s in enumerate(times.tolist()):
            # The picture, and whether the hand covers each robot's marker.
            frame, hidden[k] = scene.frame(time_s, poses=before[k], end_poses=after[k])
            writer.write(frame)
    return middle, hidden


def _write_board(scene: Scene, video: Path, frames: int, replace: bool) -> Path:
    """Write the video of a chessboard beside the ``video`` of the camera that sees it; return its path."""
    board = video.with_name(f"{video.stem}.chessboard{video.suffix}")
    with whole_file(board, replace=replace) as part:
        write_chessboard(scene, part, frames)
    return board


def _px_per_m(scene: Scene) -> float:
    """Return the length in px of a metre at the height of robots' markers, in the middle of what is filmed."""
    width_m, height_m = scene.arena_m
    x_m = 0.5 * width_m
    # Two points a short distance apart are projected; over this distance the lens is practically linear.
    short_m = 0.001 * width_m
    points = np.array([[x_m + shift_m, 0.5 * height_m, scene.markers.height_m] for shift_m in (0.0, short_m)])
    dx_px, dy_px = np.diff(scene.camera.project(points), axis=0)[0]
    return float(np.hypot(dx_px, dy_px)) / short_m


def _write_truth(
    path: Path, times: Floats, poses: Floats, hidden: NDArray[np.bool_], markers: Markers, replace: bool
) -> None:
    """Write the table ``TRUTH``, sorted by frame and robot.

    Args:
        times: of the frames, s, from the first frame, (frames,). poses, hidden: results of ``_render``.
    """
    frames, robots = hidden.shape
    columns = {
        "frame": np.repeat(np.arange(frames), robots),
        "time_s": np.repeat(times, robots),
        "robot": np.tile(list(markers.robots.values()), frames),
        "marker": np.tile(list(markers.robots), frames),
        "x_m": poses[..., 0].ravel(),
        "y_m": poses[..., 1].ravel(),
        "heading_rad": poses[..., 2].ravel(),
        "hidden": hidden.ravel(),
    }
    with whole_file(path, replace=replace) as part:
        pl.DataFrame(columns).cast(TRUTH).write_parquet(part)  # type: ignore[arg-type]


def robot_log(result: Result, run: int, markers: Markers, clock_offset_s: float) -> pl.DataFrame:
    """Return what the robots would have logged of a run: samples with times on the robots' clock, without positions.

    Args:
        clock_offset_s: time on the robots' clock when the time of the run is 0.
    Returns: a row per sample, sorted by time: robot (its name), time_s (rounded to ms), energy, observation, message,
        alpha, beta, belief_below (belief that the fill ratio is below the boundary), decision, messages_received,
        avoid_total_s and stop_total_s (time spent avoiding and standing so far, rounded to ms), and sent (messages sent
        before the sample). Columns that are null in all rows are left out.
    """
    key = ["run", "robot", "sample"]
    table = result.motion.filter(pl.col("run") == run).sort(*key)
    # ``avoid_s`` and ``stop_s`` are times since the previous sample; a robot logs their sums since the beginning.
    totals = (
        pl.col(f"{name}_s").fill_null(0.0).cum_sum().over("robot").round(3).alias(f"{name}_total_s")
        for name in ("avoid", "stop")
    )
    table = table.select(*key, "time_s", *totals)
    for other in (result.observations, result.inference):
        new = [name for name in other.columns if name not in table.columns or name in key]
        table = table.join(other.select(new), on=key, how="left", maintain_order="left")
    names = dict(enumerate(markers.robots.values()))  # a robot's name, by its number in the result
    wanted = (
        "energy", "observation", "message", "alpha", "beta", "belief_below", "decision", "messages_received",
        "avoid_total_s", "stop_total_s",
    )  # fmt: skip
    return (
        table.with_columns(
            robot=pl.col("robot").cast(pl.Int64).replace_strict(names),
            time_s=(pl.col("time_s") + clock_offset_s).round(3),
            # Robots send one message per sample, and samples are numbered from 0.
            sent=pl.col("sample"),
        )
        .sort("time_s", "robot")
        .select("robot", "time_s", *wanted, "sent")
        .select(pl.exclude([name for name in wanted if table[name].null_count() == table.height]))
    )


def write_chessboard(scene: Scene, path: Path, frames: int = BOARD_FRAMES) -> None:
    """Write a video of a chessboard that is held in front of the scene's camera and tilted in all directions."""
    look = scene.look
    with VideoWriter(path, look.size_px, look.frames_per_s) as writer:
        for k in range(frames):
            writer.write(_board_frame(scene, k))


def _board_frame(scene: Scene, k: int) -> NDArray[np.uint8]:
    """Draw frame ``k`` of the video: a chessboard with a white rim, at a random place above the floor and tilted."""
    cv2 = opencv()
    draws = uniforms(scene.seed, 0, OF_BOARD, Purpose.VIDEO, 6, first=6 * k)
    width, height = scene.arena_m
    camera_m = float(scene.camera.position_m[2])
    square = SQUARE_MM / 1000  # m
    half = np.array([BOARD[0] + 1, BOARD[1] + 1]) * square / 2  # half the board's width and height
    # The board is at most 1.35 m below the camera, so that it fills about a third of the image's height, and at least a
    # quarter of the camera's height above the floor. ``above`` is the height of the board's middle above the floor, m.
    above = max(camera_m - 1.35, 0.25 * camera_m) + 0.15 * draws[0] * camera_m
    # The view narrows towards the camera: this is the size, at the board's height, of the view of the arena.
    room = np.array([width, height]) * (camera_m - above) / camera_m
    # Places are spread over 62 % of this, and 1.75 times as far along the image's width, as it is wider than high.
    aside = (draws[1:3] - 0.5) * np.array([1.75, 1.0]) * room * 0.62
    at = np.array([width, height]) / 2 + aside
    # Tilts about the horizontal axes, up to half a radian, and a turn in the plane of the board.
    tilt_x, tilt_y, turn = (draws[3:6] - 0.5) * np.array([1.0, 1.0, 0.8])
    tilted, _ = cv2.Rodrigues(np.array([tilt_x, tilt_y, 0.0]))
    turned, _ = cv2.Rodrigues(np.array([0.0, 0.0, turn]))
    axes = (tilted @ turned).astype(np.float32)  # columns: the board's axes in the world
    centre = np.array([*at, above], dtype=np.float32)
    rim = half + square * 0.6  # half the size with the white rim, which is 0.6 squares wide
    box = scene.box_around(
        np.array([centre + axes @ [x, y, 0.0] for x in (-rim[0], rim[0]) for y in (-rim[1], rim[1])])
    )
    # A copy, since the board is drawn into it, and the background is needed for other frames.
    image = scene.background.copy()
    if box is None:  # the board is outside the picture
        return scene.noisy(image, time_s=float(k))
    # Where the ray of each fine sample of the box meets the plane of the board, in the board's axes. The image is drawn
    # with ``look.samples`` finer samples per pixel along each axis, and then averaged.
    rays = scene.rays_of(box)
    position = scene.camera.position_m.astype(np.float32)
    along = (axes[:, 2] @ (centre - position)) / (rays @ axes[:, 2])
    local = (position + rays * along[..., None] - centre) @ axes
    x, y = local[..., 0], local[..., 1]
    part = np.repeat(np.repeat(image[box].astype(np.float32), scene.look.samples, 0), scene.look.samples, 1)
    on_rim = (np.abs(x) < rim[0]) & (np.abs(y) < rim[1])
    on_board = (np.abs(x) < half[0]) & (np.abs(y) < half[1])
    dark = (np.floor((x + half[0]) / square) + np.floor((y + half[1]) / square)) % 2 == 0
    part[on_rim] = PAPER
    part[on_board & dark] = BLACK
    image[box] = scene.developed(part)
    return scene.noisy(image, time_s=float(k))  # any time will do, as long as each frame has noise of its own
