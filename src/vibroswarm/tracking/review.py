"""The review page of a tracking: how well it went, what is doubtful and what to do about it, and how the camera fits.

What is doubtful comes from ``doubts``, and its pictures (shots) from ``doubt_frames``. With the robots' log, the page
also shows how well the clocks match.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.report.html import Column, Report, ReportTable, Section, picture_of, write_report
from vibroswarm.report.parts import ReportFrame, ReportFrames
from vibroswarm.simulation import versions
from vibroswarm.tracking.doubt_frames import FRAMES_UP_TO, Shot, shots_of
from vibroswarm.tracking.doubts import (
    ADVICE,
    TITLES,
    Doubt,
    doubts_of,
    floor_residuals,
    marker_sizes_m,
    mm_per_px,
    square_residuals,
)
from vibroswarm.tracking.pictures import draw_clock, draw_lens, draw_time_line, draw_tracks
from vibroswarm.tracking.stops import match_samples
from vibroswarm.tracking.track import TrackedLog, Tracking

REVIEW: Final = "review.html"
"""File name of the page."""
LISTED: Final = 200
"""Most doubts of one kind in a table of those without pictures."""


def write_review(
    path: Path, tracking: Tracking, tracked: TrackedLog | None = None, samples: pl.DataFrame | None = None
) -> list[Doubt]:
    """Write the page, and return the doubts that it shows.

    Args:
        tracked: the robots' log with positions (``track.with_positions``); None without a log.
        samples: the robots' log as it was read (``track.read_robot_log``); None without a log.
    Raises:
        InputError: the folder cannot be written.
    """
    matched, lone_stops = None, None
    if tracked is not None and samples is not None:
        matched, lone_stops = match_samples(tracking.stops, samples, tracked.offset)
    doubts = doubts_of(tracking, matched, lone_stops)
    write_report(path, review_of(tracking, doubts, shots_of(tracking, doubts), tracked, matched))
    return doubts


def review_of(
    tracking: Tracking,
    doubts: Sequence[Doubt],
    shots: Sequence[Shot],
    tracked: TrackedLog | None = None,
    matched: pl.DataFrame | None = None,
) -> Report:
    """Lay out the page.

    Args:
        shots: pictures of some of the doubts. tracked: the robots' log with positions; None without a log.
        matched: the log's samples with their stops, ``stops.SAMPLES_MATCHED``; None without a log.
    """
    sections = [_doubtful(doubts, shots), *_seen(tracking, doubts)]
    if tracked is not None and matched is not None:
        sections.append(_clock(tracked, matched))
    sections.append(camera_section(tracking))
    size, time_s, markers = tracking.detections.size_px, tracking.detections.time_s, tracking.markers
    details = {
        "video": str(tracking.video),
        "picture": f"{size[0]} x {size[1]} px, {time_s.size} frames, {time_s[-1]:.1f} s",
        "markers": f"dictionary {markers.dictionary}, {1000 * markers.size_m:g} mm, "
        f"{1000 * markers.height_m:g} mm above the floor",
    }
    return Report(
        title=f"Tracking of {tracking.video.name}",
        lead=(answer(tracking, doubts, tracked),),
        warnings=tuple(tracking.warnings()),
        sections=tuple(sections),
        details=details | versions(),
    )


def answer(tracking: Tracking, doubts: Sequence[Doubt], tracked: TrackedLog | None = None) -> str:
    """Return a summary in sentences: how much was found, how exact it is, and what is doubtful.

    Args:
        tracked: the robots' log with positions; the sentence on the robots' clock is left out if it is None.
    """
    robots, error_px = len(tracking.markers.robots), tracking.camera.floor_error_px
    text = (
        f"{100 * tracking.share_found():.1f} % of the positions of {robots} robots were found, and "
        f"{tracking.stops.height} stops. The camera's model fits the floor's markers to "
        f"{error_px * mm_per_px(tracking):.1f} mm ({error_px:.2f} px). "
    )
    if tracked is not None:
        offset = tracked.offset
        text += f"The robots' clock is {offset.offset_s:+.3f} s ahead (standard error {1000 * offset.error_s:.0f} ms). "
    if not doubts:
        return text + "Nothing is doubtful."
    kinds = [kind for kind in TITLES if any(doubt.kind == kind for doubt in doubts)]
    counts = {kind: sum(doubt.kind == kind for doubt in doubts) for kind in kinds}
    # Titles begin with a small letter within the sentence.
    counted = ", ".join(f"{TITLES[kind][0].lower() + TITLES[kind][1:]} ({counts[kind]})" for kind in kinds)
    return f"{text}Doubtful: {counted}."


def _doubtful(doubts: Sequence[Doubt], shots: Sequence[Shot]) -> Section:
    """Lay out what is doubtful, a section for each kind: what to do, pictures, and the doubts without pictures.

    Up to three doubts without pictures are written as sentences; if there are more, they are written as a table.
    """
    if not doubts:
        return Section("What is doubtful", ("Nothing.",))
    sections = []
    for kind in dict.fromkeys(doubt.kind for doubt in doubts):
        of_kind = [number for number, doubt in enumerate(doubts) if doubt.kind == kind]
        shown = {shot.doubt for shot in shots} & set(of_kind)
        parts: list[ReportFrames | ReportTable] = [*_rows_of_frames(doubts, shots, sorted(shown))]
        without_pictures = [doubts[number] for number in of_kind if number not in shown]
        text = [f"What to do: {ADVICE[kind]}"]
        if 0 < len(without_pictures) <= 3:
            text += [doubt.words for doubt in without_pictures]
        elif without_pictures:
            rows = pl.DataFrame(
                [(doubt.robot, doubt.time_s, doubt.words) for doubt in without_pictures],
                schema={"robot": pl.Int64, "time_s": pl.Float64, "what": pl.String},
                orient="row",
            )
            columns = {"time_s": Column("time", "s", decimals=1), "what": Column(prose=True)}
            caption = "More, without a picture" if shown else ""
            name = f"doubtful-{kind}"
            parts.append(ReportTable(rows, columns, caption=caption, name=name, rows_up_to=LISTED))
        sections.append(Section(f"{TITLES[kind]} ({len(of_kind)})", text=tuple(text), parts=tuple(parts)))
    lead = "Most important first. A ring marks the place: where the robot or marker is, or was seen last."
    # A doubt has up to three pictures, of which all or none are shown. So doubts may have been left out although the
    # number of pictures is a little below the limit. The sentence is true even if none was left out.
    bounded = f" At most {FRAMES_UP_TO} frames are shown." if len(shots) > FRAMES_UP_TO - 4 else ""
    return Section("What is doubtful", text=(lead + bounded,), sections=tuple(sections))


def _rows_of_frames(
    doubts: Sequence[Doubt], shots: Sequence[Shot], shown: Sequence[int]
) -> list[ReportFrames]:
    """Lay out the pictures of doubts of one kind: a row for each doubt, or one row if each doubt has one picture.

    Args:
        shown: indices of the doubts that have pictures.
    """
    if not shown:
        return []
    if all(len(doubts[number].shots) == 1 for number in shown):
        frames = [
            ReportFrame(shot.address, f"{doubts[shot.doubt].words} Shown: {shot.words}.")
            for shot in shots
            if shot.doubt in shown
        ]
        return [ReportFrames(words="", frames=tuple(frames))]
    return [
        ReportFrames(
            words=doubts[number].words,
            frames=tuple(ReportFrame(shot.address, shot.words) for shot in shots if shot.doubt == number),
        )
        for number in shown
    ]


def _seen(tracking: Tracking, doubts: Sequence[Doubt]) -> list[Section]:
    """Lay out the sections on where and when robots were seen, with a table by robot."""
    gaps = tracking.gaps()
    names = list(tracking.markers.robots.values())
    frames = tracking.detections.time_s.size
    rows = []
    for name, edge in zip(names, np.nan_to_num(tracking.detections.edge_px()).tolist(), strict=True):
        own = gaps.filter(pl.col("robot") == name)
        seen = tracking.positions.filter(pl.col("robot") == name).height / frames
        stops = tracking.stops.filter(pl.col("robot") == name).height
        longest = float((own["end_s"] - own["start_s"]).max()) if own.height else 0.0  # type: ignore[arg-type]
        rows.append((name, seen, own.height, longest, stops, edge))
    table = pl.DataFrame(
        rows, schema=["robot", "seen", "gaps", "longest_gap_s", "stops", "edge_px"], orient="row"
    )
    columns = {
        "seen": Column("seen", percent=True),
        "longest_gap_s": Column("longest gap", "s", decimals=1),
        "edge_px": Column("width of the marker", "px", decimals=0),
    }
    moments = [
        (doubt.robot, doubt.time_s)
        for doubt in doubts
        if doubt.kind != "gap" and doubt.robot is not None and doubt.time_s is not None
    ]
    tracks = draw_tracks(tracking.positions, tracking.stops, tracking.markers.floor)
    line = draw_time_line(names, gaps, tracking.stops, tracking.span_s, moments)
    by_robot = ReportTable(table, columns, caption="By robot", name="robots")
    return [
        Section("Where robots were seen", parts=(picture_of(tracks, "tracks"),)),
        Section("When robots were seen", parts=(picture_of(line, "time-line"), by_robot)),
    ]


def _clock(tracked: TrackedLog, matched: pl.DataFrame) -> Section:
    """Lay out the section on how well the samples of the log match the stops in the video.

    Args:
        matched: the log's samples with their stops, ``stops.SAMPLES_MATCHED``.
    """
    offset = tracked.offset
    text = (
        f"The robots' clock is {offset.offset_s:+.3f} s ahead of the video's (standard error "
        f"{1000 * offset.error_s:.0f} ms); {offset.pairs} of {offset.samples} samples match a stop. Left out of the "
        f"recording: {tracked.outside} samples before or after the video, {tracked.unseen} in gaps of the tracking."
    )
    by_robot = (
        matched.group_by("robot")
        .agg(
            samples=pl.len(),
            matched=pl.col("residual_s").count(),
            median_ms=1000 * pl.col("residual_s").median(),
            spread_ms=1000 * (pl.col("residual_s").quantile(0.75) - pl.col("residual_s").quantile(0.25)),
        )
        .sort("robot")
    )
    columns = {
        "median_ms": Column("median residual", "ms", decimals=0),
        "spread_ms": Column("interquartile range", "ms", decimals=0),
        "matched": Column("with a stop"),
    }
    table = ReportTable(by_robot, columns, caption="By robot", name="clock-robots")
    return Section(
        "Clocks of the robots and of the video",
        text=(text,),
        parts=(picture_of(draw_clock(matched), "clock"), table),
    )


def camera_section(tracking: Tracking) -> Section:
    """Lay out the section on how well the lens and pose of the camera fit."""
    camera, residuals = tracking.camera, floor_residuals(tracking)
    lens = (
        f"fitted to a chessboard (to {camera.lens.error_px:.2f} px)"
        if camera.calibrated
        else "fitted to the markers of the video itself; a chessboard (`--lens`) is more exact"
    )
    # Not empty: ``marker_detection.detect`` refuses a video that shows no robot's marker.
    sizes = [size for size in marker_sizes_m(tracking).values() if np.isfinite(size)]
    text = (
        f"Camera {camera.position_m[2]:.2f} m above the floor, above ({camera.position_m[0]:.2f}, "
        f"{camera.position_m[1]:.2f}) m; lens {lens}. The camera's model fits the corners of the floor's markers to "
        f"{camera.floor_error_px:.2f} px; a pixel in the middle covers {mm_per_px(tracking):.2f} mm.",
        f"Robots' markers measure {1000 * float(np.median(sizes)):.1f} mm (median; stated: "
        f"{1000 * tracking.markers.size_m:g} mm). Edges are seen "
        f"{camera.edge_px:+.2f} px outwards, by blur, print and exposure, which is taken off.",
    )
    robots_px, robots_mm = square_residuals(tracking)
    drawing = draw_lens(
        tracking.detections.size_px, tracking.detections.floor_px, residuals, robots_px, robots_mm
    )
    # Number, x, y, error in px and error in mm of each marker. The third value of a marker's place is its angle, which
    # is not shown.
    rows = [
        (marker, x_m, y_m, *_rms(tracking, residuals, marker))
        for marker, (x_m, y_m, _) in tracking.markers.floor.items()
    ]
    table = pl.DataFrame(
        rows,
        schema={"marker": pl.Int64, **dict.fromkeys(("x_m", "y_m", "error_px", "error_mm"), pl.Float64)},
        orient="row",
    )
    columns = {
        "x_m": Column("x", "m", decimals=3),
        "y_m": Column("y", "m", decimals=3),
        "error_px": Column("corners met to", "px", decimals=2),
        "error_mm": Column("the same", "mm", decimals=2),
    }
    caption = "Markers of the floor, and how well the fitted camera meets their corners; a dash: never seen"
    by_marker = ReportTable(table, columns, caption=caption, name="floor-markers")
    return Section(
        "Lens and markers of the floor",
        text=text,
        parts=(picture_of(drawing, "lens"), by_marker),
    )


def _rms(
    tracking: Tracking, residuals: dict[int, np.ndarray[tuple[int, ...], np.dtype[np.float64]]], marker: int
) -> tuple[float | None, float | None]:
    """Return the root mean square error of a floor marker's corners in px and in mm; None if it was never seen.

    Args:
        residuals: result of ``doubts.floor_residuals``: errors of the corners of each marker, by its number.
    """
    if marker not in residuals:
        return None, None
    error = float(np.sqrt((residuals[marker] ** 2).sum(axis=1).mean()))
    return error, error * mm_per_px(tracking)
