"""``vibroswarm lab video``: render a result as the video of an overhead camera."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import add_json, add_seed, between, read_result, real, whole
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.tracking.rehearsal import Rehearsal
    from vibroswarm.tracking.scene import Look

EPILOG = """\
examples:
  vibroswarm lab video first --out rehearsal.avi --for 60
  vibroswarm lab video first --out rehearsal.avi --chessboard --clock-offset 12.5
"""
LEAST_DISTANCE_M = 0.1
"""Smallest distance of the camera from the robots' markers."""


def add_parser(tasks: Any) -> None:
    """Add the task ``video`` and its options to the tasks of ``vibroswarm lab``."""
    parser = tasks.add_parser(
        "video",
        help="render a result as the video of an overhead camera, to rehearse tracking",
        description="Render a run as an overhead camera would see it, with the robots' log, markers, and truth.",
        epilog=EPILOG,
    )
    parser.add_argument("folder", metavar="RESULT", type=Path, help="folder of a result or recording")
    parser.add_argument(
        "--out",
        metavar="FILE",
        type=Path,
        required=True,
        help="video to write: .avi or .mp4; others beside it",
    )
    parser.add_argument("--force", action="store_true", help="replace files that exist")
    parser.add_argument(
        "--session", metavar="N", type=between(whole, 1), default=1, help="run to render, from 1 (default 1)"
    )
    parser.add_argument("--start", metavar="S", type=between(real, 0), default=0.0, help="from this time, s")
    parser.add_argument("--for", metavar="S", type=between(real, 0), dest="duration", help="for so long, s")
    parser.add_argument(
        "--chessboard", action="store_true", help="also write a video of a chessboard, to calibrate the lens"
    )
    parser.add_argument(
        "--clock-offset",
        metavar="S",
        type=real,
        default=0.0,
        help="time on the robots' clock at the start of the run, s (default 0)",
    )
    parser.add_argument(
        "--cameras",
        metavar="N",
        type=between(whole, 1, 4),
        default=1,
        help="side by side, each with its own tilt, lens and clock; their views overlap (default 1)",
    )
    add_seed(parser, "of noise, hand and chessboard")
    _add_camera(parser.add_argument_group("camera"))
    add_json(parser)
    parser.set_defaults(run=run)


def _add_camera(camera: argparse._ArgumentGroup) -> None:
    """Add the options for how the camera hangs and what it sees."""
    # --distortion is k1 of r = f (theta + k1 theta^3 + ...), see ``tracking.fisheye``. A lens that keeps lines straight
    # has r = f tan(theta), where k1 is 1/3.
    camera.add_argument(
        "--size", metavar="WxH", type=_size, default=(1920, 1080), help="px (default 1920x1080)"
    )
    camera.add_argument(
        "--frames-per-second", metavar="N", type=between(real, 1, 240), default=15.0, help="default 15"
    )
    camera.add_argument(
        "--camera-height", metavar="M", type=between(real, 0.2, 100), default=1.5, help="m (default 1.5)"
    )
    camera.add_argument("--tilt", metavar="DEG", type=between(real, -30, 30), default=5.0, help="default 5")
    camera.add_argument(
        "--distortion",
        metavar="K",
        type=between(real, -0.25, 0.25),
        default=-0.09,
        help="of the lens: barrel below 0.33 (default -0.09: 6 %% at 25 degrees)",
    )
    camera.add_argument(
        "--blur", metavar="PX", type=between(real, 0, 10), default=0.6, help="px (default 0.6)"
    )
    camera.add_argument(
        "--noise", metavar="N", type=between(real, 0, 40), default=2.0, help="of 255 (default 2)"
    )
    camera.add_argument(
        "--hands", metavar="N", type=between(real, 0, 20), default=1.0, help="hands that reach in per minute"
    )
    camera.add_argument("--plain", action="store_true", help="do not show which tiles vibrate")
    camera.add_argument(
        "--marker-size", metavar="MM", type=between(real, 2, 1000), help="of the robots (default 22)"
    )
    camera.add_argument("--marker-height", metavar="MM", type=between(real, 0, 1000), help="default 30")


def _size(text: str) -> tuple[int, int]:
    """Return width and height in px in a text such as ``1920x1080``; both even, as video codecs need them.

    Raises:
        argparse.ArgumentTypeError: the text is no such size.
    """
    width, _, height = text.lower().partition("x")
    try:
        size = int(width), int(height)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a size such as 1920x1080") from None
    if not all(64 <= side <= 8192 and side % 2 == 0 for side in size):
        raise argparse.ArgumentTypeError(f"'{text}': width and height must be even numbers from 64 to 8192")
    return size


def run(arguments: argparse.Namespace) -> int:
    """Render a run as a video and print which files were written; return the exit code."""
    from vibroswarm.cli.progress import progress_bar
    from vibroswarm.tracking import opencv
    from vibroswarm.tracking.markers import usual_markers
    from vibroswarm.tracking.rehearsal import write_rehearsal

    opencv()  # raises an error before any work if the package is not installed
    result = read_result(arguments.folder)
    arena = result.scenario.arena
    markers = usual_markers(
        result.scenario.swarm.robots,
        arena.width_m,
        arena.height_m,
        size_mm=arguments.marker_size,
        height_mm=arguments.marker_height,
        cameras=arguments.cameras,
    )
    if arguments.camera_height <= markers.height_m + LEAST_DISTANCE_M:
        raise InputError(
            f"{arguments.camera_height:g} m must be more than {LEAST_DISTANCE_M:g} m above the robots' markers "
            f"({markers.height_m:g} m)",
            field="--camera-height",
        )
    look = _look(arguments)
    with progress_bar("video") as progress:
        written = write_rehearsal(
            result,
            arguments.out,
            markers,
            look,
            run=arguments.session - 1,  # sessions are numbered from 1, runs from 0
            seed=arguments.seed,
            start_s=arguments.start,
            duration_s=arguments.duration,
            clock_offset_s=arguments.clock_offset,
            chessboard=arguments.chessboard,
            cameras=arguments.cameras,
            replace=arguments.force,
            progress=lambda done, total: progress(done / total),
        )
    _print_files(written, as_json=arguments.json)
    return 0


def _look(arguments: argparse.Namespace) -> Look:
    """Return the settings of the rendered camera that the options describe."""
    from vibroswarm.tracking.scene import Look

    return Look(
        size_px=arguments.size,
        frames_per_s=arguments.frames_per_second,
        camera_height_m=arguments.camera_height,
        tilt_deg=arguments.tilt,
        # the two radial coefficients of the lens: only the first can be set, the second is the default of `Look`
        lens_k=(arguments.distortion, 0.02),
        blur_px=arguments.blur,
        noise=arguments.noise,
        hands_per_min=arguments.hands,
        tiles_visible=not arguments.plain,
    )


def _print_files(written: Rehearsal, *, as_json: bool) -> None:
    """Print what was rendered and where it is saved.

    Args:
        written: the files of the first camera and those common to all cameras; ``others`` has the files of the other
            cameras.
        as_json: print one JSON document instead of text.
    """
    from vibroswarm.cli.output import print_line

    files = [written.video, written.markers, written.log, written.truth]
    files += [written.chessboard] if written.chessboard is not None else []
    others = [path for view in written.others for path in (view.video, view.chessboard) if path is not None]
    if as_json:
        names = [str(path) for path in [*files, *others]]
        print(json.dumps({"files": names, "frames": written.frames, "marker_px": written.marker_px}))
        return
    print_line(f"{written.frames} frames; a robot's marker is about {written.marker_px:.0f} px wide")
    kinds = ("video", "markers", "log of the robots", "where the robots were", "chessboard")
    for path, what in zip(files, kinds, strict=False):  # the chessboard, the last one, may be missing
        print_line(f"Saved: {path} ({what})")
    for number, view in enumerate(written.others, start=2):
        print_line(f"Saved: {view.video} (camera {number}, which begins {view.start_s:.3f} s later)")
        if view.chessboard is not None:
            print_line(f"Saved: {view.chessboard} (chessboard of camera {number})")
