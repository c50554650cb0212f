"""``vibroswarm lab track``: find robots in the video of an overhead camera; with the robots' log, make a recording."""

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
    from vibroswarm.tracking.track import Tracking

EPILOG = """\
examples:
  vibroswarm lab track day1.mp4 --markers markers.toml --out tracked
  vibroswarm lab track day1.mp4 --markers markers.toml --lens chessboard.mp4 --log day1.csv \\
      --floor world.txt --tiles 5x5 --out tracked
"""


REVIEW = "review.html"
"""File name of the page."""


def add_parser(tasks: Any) -> None:
    """Add the task ``track`` and its options to the tasks of ``vibroswarm lab``."""
    parser = tasks.add_parser(
        "track",
        help="track robots with ArUco markers in the video of an overhead camera",
        description="Find where the robots were in a video; with their log, make a recording.",
        epilog=EPILOG,
    )
    parser.add_argument("video", metavar="VIDEO", type=Path, help="video of one session")
    parser.add_argument(
        "--markers",
        metavar="FILE|IDS",
        required=True,
        help="which markers are where (TOML, docs/camera.md); or ids on robots 0, 1, ..., such as 0,1,2,3,4, with "
        "floor markers in the usual places",
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
    camera.add_argument("--lens", metavar="VIDEO", type=Path, help="of a chessboard, by the same camera")
    camera.add_argument(
        "--board", metavar="WxH", type=_board, default=(9, 6), help="its inner corners (default 9x6)"
    )
    camera.add_argument(
        "--camera-height",
        metavar="M",
        type=between(real, 0.1, 100),
        help="of the lens above the floor, if measured, m",
    )
    add_json(parser)
    add_scenario_options(parser)
    parser.set_defaults(run=run)


def _board(text: str) -> tuple[int, int]:
    """Return the numbers of inner corners of a chessboard, across and down, in a text such as ``9x6``.

    Both are at least 3, since OpenCV detects no smaller boards.

    Raises:
        argparse.ArgumentTypeError: the text has another form, or a number is not from 3 to 50.
    """
    across, _, down = text.lower().partition("x")
    if not (across.isdigit() and down.isdigit() and 3 <= int(across) <= 50 and 3 <= int(down) <= 50):
        raise argparse.ArgumentTypeError(
            f"'{text}' is not two numbers of inner corners from 3 to 50, such as 9x6"
        )
    return int(across), int(down)


def _markers(arguments: argparse.Namespace, arena_m: tuple[float, float]) -> Markers:
    """Return the markers that ``--markers`` describes: those of a file, or the default markers with the given ids.

    Whole numbers separated by commas are ids; any other text is the path of a file. Ids need the options for the size
    and height of the robots' markers; a file states both itself.

    Args:
        arena_m: width and height of the arena, at whose edges the default markers of the floor are.
    Raises:
        InputError: with ids, the size or the height is missing; with a file, one of them is given; or the file or the
            ids are wrong.
    """
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
    """Return the table of the robots' log; None without ``--log``.

    With a log, a recording is made, which needs the floor on which the robots were. So ``--floor`` or ``--scenario``
    must state it; the floor of a preset is that of a simulation.

    Raises:
        InputError: the log cannot be read; neither of these options is given; or the floor is random.
    """
    from vibroswarm.cli.scenario_options import check_one_floor
    from vibroswarm.tracking.track import read_robot_log

    if arguments.log is None:
        return None
    samples = read_robot_log(arguments.log)
    if arguments.floor is None and arguments.scenario is None:
        raise InputError("is required with --log: on which floor were the robots?", field="--floor")
    check_one_floor(scenario)
    return samples


def run(arguments: argparse.Namespace) -> int:
    """Track the robots in the video, save and print the results; with a log, also save a recording.

    Returns the exit code.
    """
    from vibroswarm.cli.deliver import print_result, save
    from vibroswarm.cli.out_folder import claim, hash_of, refuse_other
    from vibroswarm.cli.output import print_line, print_saved
    from vibroswarm.cli.scenario_options import scenario_from
    from vibroswarm.core.atomic_io import whole_folder
    from vibroswarm.documents.tracking import tracking_document
    from vibroswarm.recordings.assemble_recording import recording_of
    from vibroswarm.recordings.log_readers import CAMERA_LOG, camera_log_bytes
    from vibroswarm.scenario.scenario import parse_setting
    from vibroswarm.tracking import opencv
    from vibroswarm.tracking.track import with_positions

    opencv()  # raises an error before any work if the package is not installed
    scenario = scenario_from(arguments)
    markers = _markers(arguments, (scenario.arena.width_m, scenario.arena.height_m))
    samples = _samples(arguments, scenario)
    # The names of the fields that options set. ``recording_of`` stores them in the recording, and prefers their values
    # to those that the log states or implies. So they are also part of the hash that identifies this work.
    stated = [parse_setting(text)[0] for text in arguments.settings]
    stated += ["strategy.name"] if arguments.strategy is not None else []
    # The video is identified by its path, not by its content; the log by its samples.
    work = hash_of(
        scenario.hash, stated, markers.to_toml(), str(arguments.video.resolve()), str(arguments.lens),
        arguments.camera_height, None if samples is None else samples.to_dicts(),
        arguments.board, arguments.partial, arguments.any_floor,
    )  # fmt: skip
    # An existing folder is accepted only if it holds results of the same video and settings, or with --force.
    # at_once=False: older results stay until the new ones are complete and replace them.
    claim(arguments, lambda folder: refuse_other(folder, "lab track", work), at_once=False)
    tracking = _tracking(arguments, markers)
    # A robot samples at one control tick and drives on at the next. So its stop, as the camera sees it, ends one
    # control period after the sample; ``with_positions`` needs this to match samples with stops.
    period_s = scenario.run.control_period_ms / 1000.0
    tracked = None if samples is None else with_positions(tracking, samples, str(arguments.log), period_s)
    with whole_folder(arguments.out, replace=True) as part:
        if tracked is not None:
            # ``_samples`` has refused a random floor. The floor of a file or of a pattern does not depend on seed and
            # run (0 and 0).
            floor = scenario.floor_for(0, 0)
            recording = recording_of([tracked.log], floor, scenario, stated, any_floor=arguments.any_floor)
            recording.write_into(part)
            (part / CAMERA_LOG).write_bytes(camera_log_bytes(tracked.log))
        _write_tables(part, tracking)
        document = tracking_document(tracking, tracked, samples)
        save(document, part, "lab track", work, page=REVIEW)
    print_result(document, arguments)
    if not arguments.json:
        print_line()
    saved = "positions, stops, gaps, review page" + ("" if tracked is None else ", recording")
    print_saved(arguments, saved, REVIEW)
    return 0


def _tracking(arguments: argparse.Namespace, markers: Markers) -> Tracking:
    """Track the robots in the video, with the lens of a chessboard's video if one is given."""
    from vibroswarm.cli.progress import progress_bar
    from vibroswarm.tracking.camera import lens_from_chessboard
    from vibroswarm.tracking.track import track

    # Without a chessboard, `track` fits the lens to the markers in the video itself.
    lens, lens_size_px = None, None
    if arguments.lens is not None:
        lens, lens_size_px = lens_from_chessboard(arguments.lens, arguments.board)
    with progress_bar("tracking") as progress:
        return track(
            arguments.video,
            markers,
            lens=lens,
            lens_size_px=lens_size_px,
            camera_height_m=arguments.camera_height,
            partial=arguments.partial,
            progress=lambda done, total: progress(done / total),
        )


def _write_tables(folder: Path, tracking: Tracking) -> None:
    """Write positions, stops and gaps as CSV, rounded to 6 decimals (micrometres and microseconds).

    The positions are also written unrounded, as Parquet.
    """
    from polars.selectors import float as float_columns

    from vibroswarm.core.tables import csv_bytes, write_frame

    write_frame(tracking.positions, folder / "positions.parquet")
    tables = {"positions": tracking.positions, "stops": tracking.stops, "gaps": tracking.gaps()}
    for name, table in tables.items():
        (folder / f"{name}.csv").write_bytes(csv_bytes(table.with_columns(float_columns().round(6))))
