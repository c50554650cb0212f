"""The report of a tracking: how well it went, what is doubtful, and how the camera fits."""

from __future__ import annotations

from functools import partial

import polars as pl

from vibroswarm.core.numbers import count, number, percent
from vibroswarm.lab.tracking.pictures import draw_tracks
from vibroswarm.lab.tracking.track import TrackedLog, Tracking
from vibroswarm.report.report import Figure, Report, Table, report


@report.register
def of_tracking(tracking: Tracking, tracked: TrackedLog | None = None) -> Report:
    """Return what a tracking says."""
    camera, markers, gaps = tracking.camera, tracking.markers, tracking.gaps()
    robots, frames = list(markers.robots.values()), tracking.detections.time_s.size
    of_robots = [
        {
            "robot": robot,
            "found_share": tracking.positions.filter(robot=robot).height / frames,
            "gaps": gaps.filter(robot=robot).height,
            "stops": tracking.stops.filter(robot=robot).height,
            "marker_px": float(edge_px),
        }
        for robot, edge_px in zip(robots, tracking.detections.edge_px(), strict=True)
    ]
    answer = [
        f"{percent(tracking.positions.height / (frames * len(robots)))} of positions found: "
        f"{count(len(robots), 'robot')} in "
        f"{count(frames, 'frame')} ({number(float(tracking.detections.time_s[-1]), 0)} s).",
        f"{count(gaps.height, 'gap')} of more than a second, {count(tracking.dropped, 'position')} dropped.",
    ]
    if tracked is not None:
        offset, samples = tracked.offset, tracked.log.samples.height + tracked.unseen
        answer.append(
            f"The robots' clock is {number(offset.offset_s, 3, sign=True)} s ahead of the video's (standard error "
            f"{number(1000 * offset.error_s, 1)} ms); {offset.pairs} of {count(samples, 'sample')} of the log "
            f"match a stop, {tracked.unseen} have no position."
        )
    return Report(
        title=f"Tracking of {tracking.video.name}",
        answer=tuple(answer),
        parts={
            "tracks": Figure(
                partial(draw_tracks, tracking.positions, tracking.stops, markers.floor),
                "Where robots were seen",
            ),
            "robots": Table(pl.DataFrame(of_robots), "Robots"),
            "gaps": Table(gaps, "When robots were not seen"),
            "floor_markers": Table(tracking.floor_errors(), "Markers of the floor", folded=True),
        },
        setting=f"Camera {number(float(camera.position_m[2]), 2)} m above the floor, lens fitted to "
        f"{'a chessboard' if camera.calibrated else 'the markers in the video'}; corners of the floor's markers met to "
        f"{number(camera.floor_error_px, 2)} px.",
        warnings=tuple(tracking.warnings()),
    )
