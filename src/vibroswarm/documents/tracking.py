"""The document of a tracking: how well it went, what is doubtful and what to do about it, and how the camera fits.

What is doubtful comes from ``doubts``. With the robots' log, it also says how well the clocks match. What is doubtful
and the figures are for the page.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import polars as pl

from vibroswarm.core.numbers import count, number, percent, stated
from vibroswarm.show.document import Column, Document, Figure, Section, Table, Text, if_any
from vibroswarm.simulation import versions
from vibroswarm.tracking.doubts import (
    ADVICE,
    TITLES,
    Doubt,
    doubts_of,
    floor_errors_px,
    floor_residuals,
    marker_sizes_m,
    mm_per_px,
)
from vibroswarm.tracking.pictures import draw_time_line, draw_tracks
from vibroswarm.tracking.track import TrackedLog, Tracking


def tracking_document(tracking: Tracking, tracked: TrackedLog | None = None) -> Document:
    """Return what a tracking says.

    Args:
        tracked: the robots' log with positions (``track.with_positions``); None without a log.
    """
    doubts = doubts_of(tracking)
    size, time_s, markers = tracking.detections.size_px, tracking.detections.time_s, tracking.markers
    return Document(
        title=f"Tracking of {tracking.video.name}",
        answer=_answer(tracking, doubts),
        warnings=tuple(tracking.warnings()),
        parts=(
            Text(_camera_words(tracking)),
            Text("" if tracked is None else _clock_words(tracked, time_s[0])),
            _doubtful(doubts),
            *_seen(tracking, doubts),
            _camera(tracking),
        ),
        made_by={
            "video": str(tracking.video),
            "picture": f"{size[0]} x {size[1]} px, {time_s.size} frames, {number(time_s[-1], 1)} s",
            "markers": f"dictionary {markers.dictionary}, {stated(1000 * markers.size_m)} mm, "
            f"{stated(1000 * markers.height_m)} mm above the floor",
            **versions(),
        },
        data={"tracking": pl.DataFrame([_values(tracking, tracked)]), "doubts": _doubts(doubts)},
    )


def _answer(tracking: Tracking, doubts: Sequence[Doubt]) -> tuple[str, str]:
    """Return how much was found, and what is doubtful."""
    first_s, last_s = tracking.span_s
    # If the camera moves, robots seem to jump.
    but = " (but the camera moves)" if tracking.dropped.height and tracking.camera_moves() else ""
    found = (
        f"{percent(tracking.share_found())} of positions found: {count(len(tracking.markers.robots), 'robot')} in "
        f"{count(tracking.detections.time_s.size, 'frame')} ({number(last_s - first_s, 0)} s); "
        f"{count(tracking.gaps().height, 'gap')} of more than a second; {count(tracking.stops.height, 'stop')}; "
        f"{count(tracking.dropped.height, 'position')} dropped because a robot cannot move so fast{but}."
    )
    counts = {kind: sum(doubt.kind == kind for doubt in doubts) for kind in TITLES}
    # Titles begin with a small letter within the sentence.
    counted = [f"{TITLES[kind][0].lower() + TITLES[kind][1:]} ({n})" for kind, n in counts.items() if n]
    return found, f"Doubtful: {', '.join(counted)}." if counted else "Nothing is doubtful."


def _camera_words(tracking: Tracking) -> str:
    camera = tracking.camera
    lens = (
        f"fitted to a chessboard (to {number(camera.lens.error_px, 2)} px)"
        if camera.calibrated
        else "fitted to the markers of the video itself; a chessboard (`--lens`) is more exact"
    )
    # Seen from above, a wrong size is explained by another height as well.
    check = (
        ""
        if camera.calibrated
        else " If the camera is not that high, check the stated sizes and heights of the markers."
    )
    return (
        f"Camera {number(float(camera.position_m[2]), 2)} m above the floor; lens {lens}. Its model fits the corners "
        f"of the floor's markers to {number(camera.floor_error_px, 2)} px "
        f"({number(camera.floor_error_px * mm_per_px(tracking), 1)} mm).{check}"
    )


def _clock_words(tracked: TrackedLog, first_frame_s: float) -> str:
    offset = tracked.offset
    error_ms = number(max(1000 * offset.error_s, 0.1), 1)
    early_s = -(first_frame_s + offset.offset_s)
    early = (
        f", and the video's first {number(early_s, 1)} s, before time 0 of the robots' clock (with timestamps, the "
        "log's earliest row)"
        if early_s >= 0.05
        else ""
    )
    return (
        f"The robots' clock is {number(offset.offset_s, 3, sign=True)} s ahead of the video's (standard error "
        f"{error_ms} ms, to which the time from a sample to the robot's start adds some 20 ms); "
        f"{offset.pairs} of {count(offset.samples, 'sample')} match a stop. "
        f"Left out of the recording: {count(tracked.outside, 'sample')} before or after the video, {tracked.unseen} in "
        f"gaps of the tracking{early}."
    )


def _values(tracking: Tracking, tracked: TrackedLog | None) -> dict[str, Any]:
    """Return the figures of a tracking as one row."""
    camera = tracking.camera
    found: dict[str, Any] = {
        "frames": int(tracking.detections.time_s.size),
        "share_found": tracking.share_found(),
        "camera_height_m": float(camera.position_m[2]),
        "lens": "chessboard" if camera.calibrated else "the video itself",
        "floor_error_px": camera.floor_error_px,
        "positions": tracking.positions.height,
        "gaps": tracking.gaps().height,
        "jumps": tracking.dropped.height,
        "stops": tracking.stops.height,
    }
    if tracked is not None:
        found |= {
            "clock_offset_s": tracked.offset.offset_s,
            "clock_offset_error_s": tracked.offset.error_s,
            "matched_samples": tracked.offset.pairs,
            "samples_outside": tracked.outside,
            "samples_unseen": tracked.unseen,
        }
    return found


def _doubts(doubts: Sequence[Doubt]) -> pl.DataFrame:
    rows = [(doubt.kind, doubt.robot, doubt.time_s, doubt.words) for doubt in doubts]
    schema = {"kind": pl.String, "robot": pl.Int64, "time_s": pl.Float64, "what": pl.String}
    return pl.DataFrame(rows, schema=schema, orient="row")


def _doubtful(doubts: Sequence[Doubt]) -> Section:
    """Lay out what is doubtful, a section for each kind: what to do, and the doubts.

    Up to three doubts are written as sentences; if there are more, they are written as a table.
    """
    if not doubts:
        return Section("What is doubtful", (Text("Nothing."),), wide=True)
    sections = [_doubtful_kind(kind, doubts) for kind in dict.fromkeys(doubt.kind for doubt in doubts)]
    return Section("What is doubtful", (Text("Most important first."), *sections), wide=True)


def _doubtful_kind(kind: str, doubts: Sequence[Doubt]) -> Section:
    of_kind = [doubt for doubt in doubts if doubt.kind == kind]
    few, many = (of_kind, []) if len(of_kind) <= 3 else ([], of_kind)
    columns = {"time_s": Column("time", "s", decimals=1), "what": Column(prose=True)}
    parts = (
        Text(f"What to do: {ADVICE[kind]}"),
        *(Text(doubt.words) for doubt in few),
        *if_any(many, lambda many: [Table(_doubts(many).drop("kind"), columns, name=f"doubtful-{kind}")]),
    )
    return Section(f"{TITLES[kind]} ({len(of_kind)})", parts)


def _seen(tracking: Tracking, doubts: Sequence[Doubt]) -> list[Section]:
    """Lay out the sections on where and when robots were seen, with a table by robot."""
    gaps = tracking.gaps()
    names = list(tracking.markers.robots.values())
    frames = tracking.detections.time_s.size
    rows = []
    for name, edge in zip(names, np.nan_to_num(tracking.detections.edge_px()).tolist(), strict=True):
        own = gaps.filter(robot=name)
        seen = tracking.positions.filter(robot=name).height / frames
        stops = tracking.stops.filter(robot=name).height
        longest = float((own["end_s"] - own["start_s"]).max()) if own.height else 0.0  # type: ignore[arg-type]
        rows.append((name, seen, own.height, longest, stops, edge))
    table = pl.DataFrame(
        rows, schema=["robot", "seen", "gaps", "longest_gap_s", "stops", "edge_px"], orient="row"
    )
    columns = {
        "seen": Column("seen", share=True),
        "longest_gap_s": Column("longest gap", "s", decimals=1),
        "edge_px": Column("width of the marker", "px", decimals=0),
    }
    moments = [
        (doubt.robot, doubt.time_s)
        for doubt in doubts
        if doubt.kind != "gap" and doubt.robot is not None and doubt.time_s is not None
    ]
    tracks = Figure(
        "tracks",
        lambda style: draw_tracks(tracking.positions, tracking.stops, tracking.markers.floor, style=style),
    )
    line = Figure(
        "time-line",
        lambda style: draw_time_line(names, gaps, tracking.stops, tracking.span_s, moments, style=style),
    )
    return [
        Section("Where robots were seen", (tracks,)),
        Section("When robots were seen", (line, Table(table, columns, "By robot", "robots", folded=True))),
    ]


def _camera(tracking: Tracking) -> Section:
    """Lay out the section on how well the lens and pose of the camera fit."""
    camera, residuals = tracking.camera, floor_residuals(tracking)
    # Not empty: ``marker_detection.detect`` refuses a video that shows no robot's marker.
    sizes = [size for size in marker_sizes_m(tracking).values() if np.isfinite(size)]
    words = (
        f"The camera is above ({number(camera.position_m[0], 2)}, {number(camera.position_m[1], 2)}) m; a pixel in the "
        f"middle covers {number(mm_per_px(tracking), 2)} mm. Robots' markers measure "
        f"{number(1000 * float(np.median(sizes)), 1)} mm (median; stated: {stated(1000 * tracking.markers.size_m)} "
        f"mm). Edges are seen {number(camera.edge_px, 2, sign=True)} px outwards, by blur, print and exposure, which "
        "is taken off."
    )
    errors_px = floor_errors_px(residuals)
    # Number, x, y and error of each marker. The third value of a marker's place is its angle, which is not shown.
    rows = [
        (marker, x_m, y_m, errors_px.get(marker)) for marker, (x_m, y_m, _) in tracking.markers.floor.items()
    ]
    schema = {"marker": pl.Int64, **dict.fromkeys(("x_m", "y_m", "error_px"), pl.Float64)}
    table = pl.DataFrame(rows, schema=schema, orient="row")
    table = table.with_columns(error_mm=pl.col("error_px") * mm_per_px(tracking))
    columns = {
        "x_m": Column("x", "m", decimals=3),
        "y_m": Column("y", "m", decimals=3),
        "error_px": Column("corners met to", "px", decimals=2),
        "error_mm": Column("the same", "mm", decimals=2),
    }
    caption = "Markers of the floor, and how well the fitted camera meets their corners; a dash: never seen"
    by_marker = Table(table, columns, caption, "floor-markers")
    return Section("Lens and markers of the floor", (Text(words), by_marker), wide=True)
