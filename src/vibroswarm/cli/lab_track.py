"""``vibroswarm lab track``: find robots in a camera's video; with the robots' log, make a recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from vibroswarm.cli.command_line import Option, pair_of, refuse
from vibroswarm.cli.deliver import claim, deliver
from vibroswarm.cli.options import Required, ScenarioOptions
from vibroswarm.cli.scenario_options import keywords_of, scenario_from
from vibroswarm.cli.terminal import progress_bar
from vibroswarm.errors import named

if TYPE_CHECKING:
    import polars as pl

    from vibroswarm.lab.tracking.markers import Markers
    from vibroswarm.lab.tracking.track import Tracking
    from vibroswarm.scenario.scenario import Scenario

BOARD = (9, 6)
"""Default number of inner corners of a chessboard, across and down."""
board = pair_of("x", "WxH, such as 9x6 (inner corners)", int, low=3, high=50)
"""Reads numbers of inner corners of a chessboard; OpenCV detects none with fewer than 3."""


@dataclass(kw_only=True)
class MarkerOptions:
    """Which markers are where."""

    markers: Annotated[
        str,
        Option(
            "which markers are where (TOML, docs/lab.md); or ids on robots 0, 1, ..., such as 0,1,2,3,4, with "
            "floor markers in the usual places",
            "FILE|IDS",
        ),
    ]
    marker_size: Annotated[
        float | None, Option("with IDS: outer edge of the robots' markers, mm", "MM", low=2, high=1000)
    ] = None
    marker_height: Annotated[
        float | None, Option("with IDS: their height above the floor, mm", "MM", low=0, high=1000)
    ] = None

    def read(self, arena_m: tuple[float, float]) -> Markers:
        """Return the markers: those of a file, or the default markers with the given ids."""
        from vibroswarm.lab.tracking.markers import read_markers, usual_markers

        size_mm, height_mm = self.marker_size, self.marker_height
        measured = {"--marker-size": size_mm, "--marker-height": height_mm}
        if not all(part.isdecimal() for part in self.markers.split(",")):
            for name, value in measured.items():
                refuse(value is not None, name, "is for ids; the file of --markers states it")
            return read_markers(Path(self.markers))
        for name, value in measured.items():
            refuse(value is None, name, f"is required with ids ({self.markers}): measure it, in mm")
        ids = [int(part) for part in self.markers.split(",")]
        return usual_markers(ids, *arena_m, size_mm=size_mm or 0.0, height_mm=height_mm or 0.0)


@dataclass(kw_only=True)
class CameraOptions:
    """The camera and its lens."""

    lens: Annotated[Path | None, Option("video of a chessboard, by the same camera", "VIDEO")] = None
    board: Annotated[
        tuple[int, ...] | None, Option("inner corners of the chessboard (default 9x6)", "WxH", read=board)
    ] = None
    camera_height: Annotated[
        float | None, Option("height of the lens above the floor, if measured, m", "M", low=0.1, high=100)
    ] = None


def track(
    video: Annotated[Path, Option("video of one session", "VIDEO")],
    /,
    *,
    log: Annotated[Path | None, Option("robots' log (CSV: robot,time_s,energy,...)", "LOG")] = None,
    partial: Annotated[bool, Option("use a video that ends too early")] = False,
    any_floor: Annotated[bool, Option("continue if the floor does not fit the log")] = False,
    markers: MarkerOptions,
    camera: CameraOptions,
    scenario: ScenarioOptions,
    output: Required,
) -> None:
    """Find where robots with ArUco markers were in the video of an overhead camera; with their log, make a recording.

    examples:
      vibroswarm lab track day1.mp4 --markers markers.toml --out tracked
      vibroswarm lab track day1.mp4 --markers markers.toml --lens chessboard.mp4 --log day1.csv \\
          --floor world.txt --tiles 5x5 --out tracked
    """
    from vibroswarm.lab.tracking import opencv
    from vibroswarm.lab.tracking.track import with_positions
    from vibroswarm.recordings.assemble_recording import recording_of
    from vibroswarm.recordings.read import camera_frame
    from vibroswarm.study.options import stated_fields

    opencv()  # raises an error before any work if the package is not installed
    made = scenario_from(scenario)
    placed = markers.read((made.arena.width_m, made.arena.height_m))
    samples = _samples(log, scenario, made)
    stated = stated_fields(
        **keywords_of(scenario)
    )  # `recording_of` prefers their values to those that the log implies
    # The video is identified by its path, not by its content; the log by its samples.
    settings = (
        made.hash, stated, placed.to_toml(), str(video.resolve()), str(camera.lens), camera.camera_height,
        None if samples is None else samples.to_dicts(), camera.board or BOARD, partial, any_floor,
    )  # fmt: skip
    claim(output, "lab track", *settings)
    tracking = _tracking(video, placed, camera, partial=partial)
    # A robot samples at one control tick and drives on at the next. So its stop, as the camera sees it, ends one
    # control period after the sample; ``with_positions`` needs this to match samples with stops.
    period_s = made.run.control_period_ms / 1000.0
    tables = {"positions": tracking.positions, "stops": tracking.stops, "gaps": tracking.gaps()}
    tracked = None if samples is None else with_positions(tracking, samples, str(log), period_s)
    if tracked is not None:
        # ``_samples`` has refused a random floor. The floor of a file or of a pattern does not depend on seed and
        # run (0 and 0).
        floor = made.floor_for(0, 0)
        with named("--floor", of="floor"):
            recording = recording_of([tracked.log], floor, made, stated, any_floor=any_floor)
        recording.write_into(output.out)
        tables["log"] = camera_frame(tracked.log)
    deliver(tracking, output, tables, tracked=tracked, is_result=True)


def _samples(log: Path | None, options: ScenarioOptions, scenario: Scenario) -> pl.DataFrame | None:
    from vibroswarm.lab.tracking.track import read_robot_log
    from vibroswarm.study.options import check_one_floor

    if log is None:
        return None
    samples = read_robot_log(log)
    check_one_floor(scenario, **keywords_of(options))
    return samples


def _tracking(video: Path, markers: Markers, camera: CameraOptions, *, partial: bool) -> Tracking:
    from vibroswarm.lab.tracking.camera import lens_from_chessboard
    from vibroswarm.lab.tracking.track import track

    # Without a chessboard, `track` fits the lens to the markers in the video itself.
    lens, lens_size_px = None, None
    refuse(
        camera.lens is None and camera.board is not None,
        "--board",
        "is for the video of a chessboard; give it with --lens",
    )
    if camera.lens is not None:
        across, down = camera.board or BOARD
        lens, lens_size_px = lens_from_chessboard(camera.lens, (across, down))
    with progress_bar("tracking") as progress:
        return track(
            video,
            markers,
            lens=lens,
            lens_size_px=lens_size_px,
            camera_height_m=camera.camera_height,
            partial=partial,
            progress=lambda done, total: progress(done / total),
        )
