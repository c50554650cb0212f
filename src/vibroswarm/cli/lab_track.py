"""``vibroswarm lab track``: from the video of an overhead camera to positions, and with a log to a recording."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import add_json, add_scenario_options, between, real
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    import polars as pl

    from vibroswarm.scenario.scenario import Scenario
    from vibroswarm.tracking.markers import Markers
    from vibroswarm.tracking.stitch import Overlap, Stitched
    from vibroswarm.tracking.track import TrackedLog, Tracking

EPILOG = """\
examples:
  vibroswarm lab track day1.mp4 --markers markers.toml --out tracked
  vibroswarm lab track day1.mp4 --markers markers.toml --lens chessboard.mp4 --log day1.csv \\
      --floor world.txt --tiles 5x5 --out tracked
"""


def add_parser(tasks: Any) -> None:
    """Add the task."""
    parser = tasks.add_parser(
        "track",
        help="track robots with ArUco markers in the video of an overhead camera",
        description="Find where the robots were in a video; with their log, make a recording.",
        epilog=EPILOG,
    )
    parser.add_argument(
        "videos",
        metavar="VIDEO",
        nargs="+",
        type=Path,
        help="video of one session; several: of cameras whose views overlap",
    )
    parser.add_argument(
        "--markers",
        metavar="FILE|IDS",
        required=True,
        help="which markers are where (TOML, docs/camera.md); or ids on robots 0, 1, ..., such as 0,1,2,3,4, with "
        "floor markers as lab video has them",
    )
    parser.add_argument(
        "--marker-size", metavar="MM", type=between(real, 2, 1000), help="of the robots, with IDS: outer edge"
    )
    parser.add_argument(
        "--marker-height", metavar="MM", type=between(real, 0, 1000), help="above the floor, with IDS"
    )
    parser.add_argument(
        "--out", metavar="DIR", type=Path, required=True, help="save positions and recording here"
    )
    parser.add_argument("--force", action="store_true", help="replace DIR if it holds something else")
    parser.add_argument("--log", metavar="LOG", type=Path, help="robots' log (CSV: robot,time_s,energy,...)")
    parser.add_argument("--partial", action="store_true", help="use a video that ends too early")
    parser.add_argument("--any-floor", action="store_true", help="continue if the floor does not fit the log")
    camera = parser.add_argument_group("camera")
    camera.add_argument(
        "--lens",
        metavar="VIDEO",
        nargs="+",
        action="extend",
        type=Path,
        help="of a chessboard, by the same camera; several in the order of the videos, or one for all",
    )
    camera.add_argument(
        "--board", metavar="WxH", type=_board, default=(9, 6), help="its inner corners (default 9x6)"
    )
    camera.add_argument(
        "--camera-height",
        metavar="M",
        nargs="+",
        type=between(real, 0.1, 100),
        help="of the lens above the floor, if measured, m; several in the order of the videos",
    )
    add_json(parser)
    add_scenario_options(parser)
    parser.set_defaults(run=run)


def _board(text: str) -> tuple[int, int]:
    across, _, down = text.lower().partition("x")
    if not (across.isdigit() and down.isdigit() and 3 <= int(across) <= 50 and 3 <= int(down) <= 50):
        raise argparse.ArgumentTypeError(f"'{text}' is not a number of inner corners such as 9x6")
    return int(across), int(down)


def _for_each(given: list[Any] | None, videos: int, option: str) -> list[Any]:
    """Return the value of an option for each video: None if it is not given, one value for all, or one for each.

    Raises:
        InputError: the number of values is neither one nor that of the videos.
    """
    if given is None:
        return [None] * videos
    if len(given) not in (1, videos):
        raise InputError(
            f"{len(given)} given for {videos} video{'s' * (videos > 1)}; give one for all, or one each in their order",
            field=option,
        )
    return given * videos if len(given) == 1 else given


def _markers(arguments: argparse.Namespace, arena_m: tuple[float, float]) -> Markers:
    """Return the markers of a file, or the usual ones of some ids."""
    from vibroswarm.tracking.markers import read_markers, usual_markers

    measured = {"--marker-size": arguments.marker_size, "--marker-height": arguments.marker_height}
    if not all(part.isdecimal() for part in arguments.markers.split(",")):
        for name, value in measured.items():
            if value is not None:
                raise InputError("is for ids; the file of --markers states it", field=name)
        return read_markers(Path(arguments.markers))
    for name, value in measured.items():
        if value is None:
            raise InputError(f"is required with ids ({arguments.markers}): measure it, in mm", field=name)
    ids = [int(part) for part in arguments.markers.split(",")]
    return usual_markers(ids, *arena_m, size_mm=arguments.marker_size, height_mm=arguments.marker_height)


def _samples(arguments: argparse.Namespace, scenario: Scenario) -> pl.DataFrame | None:
    """Return the robots' log, if there is one, and refuse a floor that a recording cannot have."""
    from vibroswarm.tracking.track import read_robot_log

    if arguments.log is None:
        return None
    samples = read_robot_log(arguments.log)
    if arguments.floor is None and arguments.scenario is None:
        raise InputError("is required with --log: on which floor were the robots?", field="--floor")
    if scenario.floor.drawn_by_run:
        raise InputError("is random, but a recording has one floor; give its file", field="--floor")
    return samples


def run(arguments: argparse.Namespace) -> int:
    """Track, save and print what was found."""
    from vibroswarm.cli.out_folder import claim, deliver, hash_of, refuse_other
    from vibroswarm.cli.output import print_saved
    from vibroswarm.cli.scenario_options import scenario_from
    from vibroswarm.core.atomic_io import whole_folder
    from vibroswarm.recordings.readers import CAMERA_LOG, camera_log_bytes
    from vibroswarm.recordings.recording import recording_of
    from vibroswarm.scenario.scenario import parse_setting
    from vibroswarm.tracking import opencv
    from vibroswarm.tracking.review import REVIEW, write_review
    from vibroswarm.tracking.track import with_positions

    opencv()
    scenario = scenario_from(arguments)
    markers = _markers(arguments, (scenario.arena.width_m, scenario.arena.height_m))
    samples = _samples(arguments, scenario)
    videos: list[Path] = arguments.videos
    if len({video.resolve() for video in videos}) < len(videos):
        raise InputError("the same video is given twice", field="VIDEO")
    boards = _for_each(arguments.lens, len(videos), "--lens")
    heights = _for_each(arguments.camera_height, len(videos), "--camera-height")
    stated = [parse_setting(text)[0] for text in arguments.settings]
    work = hash_of(
        scenario.hash, stated, markers.to_toml(), [str(video.resolve()) for video in videos],
        [str(board) for board in boards], heights, None if samples is None else samples.to_dicts(),
    )  # fmt: skip
    claim(arguments, lambda: refuse_other(arguments.out, "lab track", work), at_once=False)
    tracking = _tracking(arguments, markers, boards, heights)
    period_s = scenario.run.control_period_ms / 1000.0
    tracked = None if samples is None else with_positions(tracking, samples, str(arguments.log), period_s)
    with whole_folder(arguments.out, replace=True) as part:
        if tracked is not None:
            recording_of(
                [tracked.log], scenario.floor_for(0, 0), scenario, stated, any_floor=arguments.any_floor
            ).write_into(part)
            (part / CAMERA_LOG).write_bytes(camera_log_bytes(tracked.log))
        _write_tables(part, tracking)
        write_review(part / REVIEW, tracking, tracked, samples)
        deliver(
            arguments,
            part,
            "lab track",
            lambda: _print_tracking(tracking, tracked),
            lambda: document(tracking, tracked),
            work=work,
        )
    print_saved(
        arguments, "positions, stops, gaps, review page" + ("" if tracked is None else ", recording"), REVIEW
    )
    return 0


def _tracking(
    arguments: argparse.Namespace, markers: Markers, boards: list[Path | None], heights: list[float | None]
) -> Stitched:
    """Track each video, and join them."""
    from vibroswarm.cli.progress import progress_bar
    from vibroswarm.tracking.camera import lens_from_chessboard
    from vibroswarm.tracking.stitch import stitch
    from vibroswarm.tracking.track import track

    videos: list[Path] = arguments.videos
    by_board = {
        board: lens_from_chessboard(board, arguments.board) for board in dict.fromkeys(boards) if board
    }
    with progress_bar("tracking") as progress:
        cameras = []
        for number, (video, board, height) in enumerate(zip(videos, boards, heights, strict=True)):
            lens, size = by_board[board] if board is not None else (None, None)
            cameras.append(
                track(
                    video,
                    markers,
                    lens=lens,
                    lens_size_px=size,
                    camera_height_m=height,
                    partial=arguments.partial,
                    progress=lambda done, total, before=number: progress(
                        (before + done / total) / len(videos)
                    ),  # type: ignore[misc]
                )
            )
        return stitch(cameras)


def _write_tables(folder: Path, tracking: Stitched) -> None:
    from polars.selectors import float as float_columns

    from vibroswarm.core.tables import csv_bytes

    tracking.positions.write_parquet(folder / "positions.parquet")
    tables = {"positions": tracking.positions, "stops": tracking.stops, "gaps": tracking.gaps()}
    for name, table in tables.items():
        (folder / f"{name}.csv").write_bytes(csv_bytes(table.with_columns(float_columns().round(6))))


def document(session: Stitched, tracked: TrackedLog | None) -> dict[str, Any]:
    """Return what is printed as plain values; of several cameras also the list of them."""
    first = session.cameras[0]
    found: dict[str, Any] = _about(first) | {
        "positions": session.positions.height,
        "gaps": session.gaps().height,
        "jumps": session.jumps,
        "stops": session.stops.height,
        "warnings": session.warnings(),
    }
    if len(session.cameras) > 1:
        found["cameras"] = [
            _about(camera) | (_about_overlap(overlap) if overlap is not None else {})
            for camera, overlap in zip(session.cameras, session.overlaps, strict=True)
        ]
    if tracked is not None:
        found |= {
            "clock_offset_s": tracked.offset.offset_s,
            "clock_offset_error_s": tracked.offset.error_s,
            "matched_samples": tracked.offset.pairs,
            "samples_outside": tracked.outside,
            "samples_unseen": tracked.unseen,
        }
    return found


def _about(tracking: Tracking) -> dict[str, Any]:
    camera = tracking.camera
    return {
        "video": str(tracking.video),
        "frames": int(tracking.detections.time_s.size),
        "camera_height_m": float(camera.position_m[2]),
        "lens": "chessboard" if camera.calibrated else "the video itself",
        "floor_error_px": camera.floor_error_px,
    }


def _about_overlap(overlap: Overlap) -> dict[str, Any]:
    return {
        "offset_s": overlap.offset_s,
        "offset_error_s": overlap.error_s,
        "seen_by_both": overlap.pairs,
        "apart_median_mm": 1000 * overlap.disagreement_m(),
        "apart_95_mm": 1000 * overlap.disagreement_m(0.95),
    }


def _print_tracking(session: Stitched, tracked: TrackedLog | None) -> None:
    """Print where robots were seen, the cameras, and what to do about it."""
    from vibroswarm.cli.output import print_paragraph

    several = len(session.cameras) > 1
    robots = len(session.markers.robots)
    first_s, last_s = session.span_s
    by = (
        f"by {len(session.cameras)} cameras"
        if several
        else f"in {session.cameras[0].detections.time_s.size} frames"
    )
    print_paragraph(
        f"{100 * session.share_found():.1f} % of positions found: {robots} robots {by} ({last_s - first_s:.0f} s); "
        f"{session.gaps().height} gaps of more than a second; {session.stops.height} stops; {session.jumps} positions "
        "dropped as too far from their neighbours."
    )
    for number, (tracking, overlap) in enumerate(
        zip(session.cameras, session.overlaps, strict=True), start=1
    ):
        camera = tracking.camera
        lens = (
            f"fitted to a chessboard (to {camera.lens.error_px:.2f} px)"
            if camera.calibrated
            else "fitted to the markers of the video itself; a chessboard (--lens) is more exact"
        )
        print_paragraph(
            f"Camera {f'{number} ' if several else ''}{camera.position_m[2]:.2f} m above the floor; lens {lens}; "
            f"its model fits the corners of the floor's markers to {camera.floor_error_px:.2f} px."
        )
        if overlap is not None:
            print_paragraph(
                f"{tracking.video.name} begins {overlap.offset_s:+.3f} s after {session.video.name} (standard error "
                f"{1000 * overlap.error_s:.1f} ms); {overlap.pairs} positions seen by both are "
                f"{1000 * overlap.disagreement_m():.1f} mm apart (median; 95 %: "
                f"{1000 * overlap.disagreement_m(0.95):.1f} mm)."
            )
    if tracked is not None:
        offset = tracked.offset
        print_paragraph(
            f"The robots' clock is {offset.offset_s:+.3f} s ahead of the video's (standard error "
            f"{1000 * offset.error_s:.0f} ms; {offset.pairs} of {offset.samples} matched with stops). Left out: "
            f"{tracked.outside} samples before or after the video, {tracked.unseen} in gaps of the tracking."
        )
    for words in session.warnings():
        print_paragraph(words)
