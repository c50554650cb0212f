"""Write what a session with a camera would leave: video, robots' log and markers, beside them the truth, and for the
calibration of the lens a video of a chessboard.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import replace as replaced
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.atomic_io import whole_file
from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError
from vibroswarm.result import Result
from vibroswarm.tracking import opencv
from vibroswarm.tracking.markers import Markers
from vibroswarm.tracking.scene import OF_BOARD, SAMPLES, Look, Scene, poses_at, scene_of
from vibroswarm.tracking.video_file import VideoWriter, check_suffix

Floats = NDArray[np.float64]

TRUTH: Final = {
    "frame": pl.UInt32, "time_s": pl.Float64, "robot": pl.UInt16, "marker": pl.UInt16, "x_m": pl.Float64,
    "y_m": pl.Float64, "heading_rad": pl.Float64, "hidden": pl.Boolean,
}  # fmt: skip
"""Columns of the truth: each robot's centre in each frame (time in the video), and whether a hand covers it."""


OVERLAP: Final = 0.2
"""Share of the arena's width that two neighbouring cameras both see."""
LATER_S: Final = 1.37
"""Each further camera is switched on so much later."""


@dataclass(frozen=True)
class View:
    """What a further camera recorded."""

    video: Path
    chessboard: Path | None
    start_s: float
    """Time on the first camera's clock when this one begins."""


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
    others: tuple[View, ...] = ()
    """Of further cameras."""


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
    cameras: int = 1,
    replace: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Rehearsal:
    """Render a run of a result as a video, with the files that go with it.

    Args:
        out: the video; the others are named after it. start_s, duration_s: which part of the run.
        clock_offset_s: time on the robots' clock when that of the run is 0.
        chessboard: whether a video of a chessboard, seen by the same camera, is written too.
        cameras: how many hang side by side, each with its tilt, lens and clock, crosswise; neighbours both see
            ``OVERLAP`` of the arena.
        progress: called with the frames done and all frames.
    Raises:
        InputError: no paths, no such run, nothing in that time, or files that exist.
    """
    check_suffix(out)
    names = {
        kind: out.with_name(f"{out.stem}.{kind}") for kind in ("markers.toml", "log.csv", "truth.parquet")
    }
    times, until_s = _frame_times(result, run, look, start_s, duration_s)
    views: list[View] = []
    for number in range(cameras):
        own_look, own_times, part_m = look, times, None
        if cameras > 1:
            own_look = _look_of(look, number)
            own_times = _times_of(number, times, until_s, look.frames_per_s)
            part_m = _part_of(number, cameras, result.scenario.arena.width_m)
        scene = scene_of(result, run, markers, own_look, seed + number, part_m)
        video = out if number == 0 else out.with_name(f"{out.stem}.{number + 1}{out.suffix}")
        middle, hidden = _render(
            scene, result, run, own_times, video, replace,
            None if progress is None else partial(_tell, progress, number * times.size, cameras * times.size),
        )  # fmt: skip
        board = _write_board(scene, video, replace) if chessboard else None
        views.append(View(video, board, float(own_times[0] - times[0])))
        if number == 0:
            _write_truth(names["truth.parquet"], times - times[0], middle, hidden, markers, replace)
            marker_px = _px_per_m(scene) * markers.size_m
    with whole_file(names["markers.toml"], replace=replace) as part:
        part.write_text(markers.to_toml(), encoding="utf-8")
    with whole_file(names["log.csv"], replace=replace) as part:
        part.write_bytes(csv_bytes(robot_log(result, run, markers, clock_offset_s)))
    return Rehearsal(
        out, names["markers.toml"], names["log.csv"], names["truth.parquet"], views[0].chessboard, times.size,
        marker_px, tuple(views[1:]),
    )  # fmt: skip


def _frame_times(
    result: Result, run: int, look: Look, start_s: float, duration_s: float | None
) -> tuple[Floats, float]:
    """Return when the first camera takes its frames, and when no camera takes any more, s.

    Raises:
        InputError: no such run, or nothing in that time.
    """
    if result.runs.filter(pl.col("run") == run).is_empty():
        raise InputError(f"there is no run {run + 1} in this result", field="--session")
    end_s = float(result.ends.filter(pl.col("run") == run)["end_s"].max() or 0.0)  # type: ignore[arg-type]
    last_s = end_s if duration_s is None else min(start_s + duration_s, end_s)
    until_s = last_s - look.exposure_s
    times = np.arange(start_s, until_s, 1.0 / look.frames_per_s)
    if times.size < 2:
        raise InputError(f"the run lasts {end_s:g} s; there is nothing from {start_s:g} s", field="--start")
    return times, until_s


def _times_of(number: int, times: Floats, until_s: float, frames_per_s: float) -> Floats:
    """Return when one of several cameras takes its frames, s: ``LATER_S`` after the one before, and between its frames.

    Raises:
        InputError: fewer than two frames are left.
    """
    own: Floats = times[times >= times[0] + number * LATER_S] + 0.4 * number / frames_per_s
    own = own[own < until_s]
    if own.size < 2:
        raise InputError("is too short for so many cameras", field="--for")
    return own


def _tell(progress: Callable[[int, int], None], before: int, of: int, frames: int) -> None:
    progress(before + frames, of)


def _look_of(look: Look, number: int) -> Look:
    """Return the look of one of several cameras: hung crosswise, every other one the other way round and tilted."""
    sign = 1 - 2 * (number % 2)
    bent = (look.lens_k[0] * 0.85**number, look.lens_k[1])
    return replaced(look, tilt_deg=sign * look.tilt_deg, turned_deg=sign * 90.0, lens_k=bent)


def _part_of(number: int, cameras: int, width_m: float) -> tuple[float, float]:
    """Return the range of x that one of several cameras sees, m."""
    half_m = 0.5 * OVERLAP * width_m
    low, high = width_m * number / cameras - half_m, width_m * (number + 1) / cameras + half_m
    return max(low, 0.0), min(high, width_m)


def _render(
    scene: Scene,
    result: Result,
    run: int,
    times: Floats,
    out: Path,
    replace: bool,
    progress: Callable[[int], None] | None,
) -> tuple[Floats, NDArray[np.bool_]]:
    """Write the video of one camera; return the poses in the middle of each exposure and which robots are hidden."""
    look, robots = scene.look, len(scene.markers.robots)
    half = look.exposure_s / 2
    before, middle, after = (
        poses_at(result, run, robots, np.maximum(times + d, 0.0)) for d in (-half, 0.0, half)
    )
    hidden = np.zeros((times.size, robots), dtype=np.bool_)
    with (
        whole_file(out, replace=replace) as part,
        VideoWriter(part, look.size_px, look.frames_per_s) as writer,
    ):
        for k, time_s in enumerate(times.tolist()):
            frame, hidden[k] = scene.frame(time_s, before[k], after[k])
            writer.write(frame)
            if progress is not None:
                progress(k + 1)
    return middle, hidden


def _write_board(scene: Scene, video: Path, replace: bool) -> Path:
    """Write the video of a chessboard beside that of the camera that sees it; return its name."""
    board = video.with_name(f"{video.stem}.chessboard{video.suffix}")
    with whole_file(board, replace=replace) as part:
        write_chessboard(scene, part)
    return board


def _px_per_m(scene: Scene) -> float:
    """Return how many px a metre at the markers' height has in the middle of what is filmed."""
    width_m, height_m = scene.arena_m
    low_m, high_m = (0.0, width_m) if scene.part_m is None else scene.part_m
    x_m = 0.5 * (low_m + high_m)
    points = np.array([[x_m + d, 0.5 * height_m, scene.markers.height_m] for d in (0.0, 0.001 * width_m)])
    return float(np.hypot(*np.diff(scene.camera.project(points), axis=0)[0])) / (0.001 * width_m)


def _write_truth(
    path: Path, times: Floats, poses: Floats, hidden: NDArray[np.bool_], markers: Markers, replace: bool
) -> None:
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
    """Return what the robots would have logged of a run: samples by their own clock, and no positions.

    Args:
        clock_offset_s: time on the robots' clock when that of the run is 0.
    Returns: robot (its name), time_s (rounded to ms), energy, observation, the times spent avoiding and standing so
        far (s, rounded to ms), and what the run has of message, alpha, beta, belief_below, decision, sent,
        messages_received.
    """
    key = ["run", "robot", "sample"]
    table = result.motion.filter(pl.col("run") == run).sort(*key)
    table = table.select(
        *key,
        "time_s",
        *(
            pl.col(f"{name}_s").fill_null(0.0).cum_sum().over("robot").round(3).alias(f"{name}_total_s")
            for name in ("avoid", "stop")
        ),
    )
    for other in (result.observations, result.inference):
        new = [name for name in other.columns if name not in table.columns or name in key]
        table = table.join(other.select(new), on=key, how="left", maintain_order="left")
    names = dict(enumerate(markers.robots.values()))
    wanted = (
        "energy", "observation", "message", "alpha", "beta", "belief_below", "decision", "messages_received",
        "avoid_total_s", "stop_total_s",
    )  # fmt: skip
    return (
        table.with_columns(
            robot=pl.col("robot").cast(pl.Int64).replace_strict(names),
            time_s=(pl.col("time_s") + clock_offset_s).round(3),
            sent=pl.col("sample"),
        )
        .sort("time_s", "robot")
        .select("robot", "time_s", *wanted, "sent")
        .select(pl.exclude([name for name in wanted if table[name].null_count() == table.height]))
    )


BOARD: Final = (9, 6)
"""Inner corners of the chessboard, across and down."""
SQUARE_MM: Final = 40.0
BOARD_FRAMES: Final = 40


def write_chessboard(scene: Scene, path: Path, frames: int = BOARD_FRAMES) -> None:
    """Write a video of a chessboard that is held in front of the scene's camera and tilted in all directions."""
    look = scene.look
    with VideoWriter(path, look.size_px, look.frames_per_s) as writer:
        for k in range(frames):
            writer.write(_board_frame(scene, k))


def _board_frame(scene: Scene, k: int) -> NDArray[np.uint8]:
    """Draw a chessboard somewhere over the floor, with a white rim."""
    cv2 = opencv()
    draws = uniforms(scene.seed, 0, OF_BOARD, Purpose.VIDEO, 6, first=6 * k)
    width, height = scene.arena_m
    middle, turned_by = np.array([width, height]) / 2, 0.0
    if scene.part_m is not None:  # a camera that hangs crosswise over a part of the arena
        low, high = scene.part_m
        middle, turned_by = np.array([(low + high) / 2, height / 2]), np.radians(scene.look.turned_deg)
        width = height = high - low
    camera_m = float(scene.camera.position_m[2])
    # Held so that it fills about a third of the image's height, wherever the camera hangs.
    square = SQUARE_MM / 1000
    half = np.array([BOARD[0] + 1, BOARD[1] + 1]) * square / 2
    above = max(camera_m - 1.35, 0.25 * camera_m) + 0.15 * draws[0] * camera_m
    room = np.array([width, height]) * (camera_m - above) / camera_m
    aside = (draws[1:3] - 0.5) * np.array([1.75, 1.0]) * room * 0.62
    cos, sin = np.cos(turned_by), np.sin(turned_by)
    at = middle + np.array([[cos, -sin], [sin, cos]]) @ aside
    a, b, c = (draws[3:6] - 0.5) * np.array([1.0, 1.0, 0.8])
    turned, _ = cv2.Rodrigues(np.array([a, b, 0.0]))
    spun, _ = cv2.Rodrigues(np.array([0.0, 0.0, c + turned_by]))
    axes = (turned @ spun).astype(np.float32)
    centre = np.array([*at, above], dtype=np.float32)
    rim = half + square * 0.6
    box = scene.box_around(
        np.array([centre + axes @ [x, y, 0.0] for x in (-rim[0], rim[0]) for y in (-rim[1], rim[1])])
    )
    image = scene.background.copy()
    if box is None:
        return scene.noisy(image, float(k))
    rays = scene.rays_of(box)
    position = scene.camera.position_m.astype(np.float32)
    along = (axes[:, 2] @ (centre - position)) / (rays @ axes[:, 2])
    local = (position + rays * along[..., None] - centre) @ axes
    x, y = local[..., 0], local[..., 1]
    part = np.repeat(np.repeat(image[box].astype(np.float32), SAMPLES, 0), SAMPLES, 1)
    on_rim = (np.abs(x) < rim[0]) & (np.abs(y) < rim[1])
    on_board = (np.abs(x) < half[0]) & (np.abs(y) < half[1])
    dark = (np.floor((x + half[0]) / square) + np.floor((y + half[1]) / square)) % 2 == 0
    part[on_rim] = 236.0
    part[on_board & dark] = 18.0
    image[box] = scene.developed(part)
    return scene.noisy(image, float(k))
