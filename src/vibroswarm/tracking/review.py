"""The review page of a tracking: how well it went, what is doubtful and what to do about it, with frames."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.report.frames import ReportFrame, ReportFrames
from vibroswarm.report.html import Column, Report, ReportTable, Section, picture_of, write_report
from vibroswarm.simulation import versions
from vibroswarm.tracking.clock_residuals import match_samples
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
from vibroswarm.tracking.track import TrackedLog, Tracking

REVIEW: Final = "review.html"
LISTED: Final = 200
"""Doubts of one kind that are listed; the first of them with pictures."""


def write_review(
    path: Path, tracking: Tracking, tracked: TrackedLog | None = None, samples: pl.DataFrame | None = None
) -> list[Doubt]:
    """Write the page; return what is doubtful.

    Args:
        tracked, samples: the robots' log with positions, and as it was read.
    Raises:
        InputError: the folder cannot be written.
    """
    matched, lone = (None, None)
    if tracked is not None and samples is not None:
        matched, lone = match_samples(tracking.stops, samples, tracked.offset)
    doubts = doubts_of(tracking, matched, lone)
    write_report(path, review_of(tracking, doubts, shots_of(tracking, doubts), tracked, matched))
    return doubts


def review_of(
    tracking: Tracking,
    doubts: Sequence[Doubt],
    shots: Sequence[Shot],
    tracked: TrackedLog | None = None,
    matched: pl.DataFrame | None = None,
) -> Report:
    """Return the page as a report."""
    sections = [_doubtful(doubts, shots), *_seen(tracking, doubts)]
    if tracked is not None and matched is not None:
        sections.append(_clock(tracked, matched))
    sections.append(_camera(tracking))
    seen = tracking.detections
    details = {
        "video": str(tracking.video),
        "picture": f"{seen.size_px[0]} x {seen.size_px[1]} px, {seen.time_s.size} frames, {seen.time_s[-1]:.1f} s",
        "markers": f"dictionary {tracking.markers.dictionary}, {1000 * tracking.markers.size_m:g} mm, "
        f"{1000 * tracking.markers.height_m:g} mm above the floor",
    }
    return Report(
        title=f"Tracking of {tracking.video.name}",
        lead=(answer(tracking, doubts, tracked),),
        warnings=tuple(tracking.warnings()),
        sections=tuple(sections),
        details=details | versions(),
    )


def answer(tracking: Tracking, doubts: Sequence[Doubt], tracked: TrackedLog | None = None) -> str:
    """Return how well the robots were tracked, and whether anything is doubtful, in sentences."""
    frames, robots = tracking.detections.corners_px.shape[:2]
    share = tracking.positions.height / (frames * robots)
    text = f"{100 * share:.1f} % of the positions of {robots} robots were found, and {tracking.stops.height} stops. "
    error_px = tracking.camera.floor_error_px
    text += f"The floor's markers are met to {error_px * mm_per_px(tracking):.1f} mm ({error_px:.2f} px). "
    if tracked is not None:
        offset = tracked.offset
        text += f"The robots' clock is {offset.offset_s:+.3f} s ahead (standard error {1000 * offset.error_s:.0f} ms). "
    if not doubts:
        return text + "Nothing is doubtful."
    kinds = [kind for kind in TITLES if any(doubt.kind == kind for doubt in doubts)]
    counted = ", ".join(
        f"{TITLES[kind][0].lower()}{TITLES[kind][1:]} ({sum(doubt.kind == kind for doubt in doubts)})"
        for kind in kinds
    )
    return f"{text}Doubtful: {counted}."


def _doubtful(doubts: Sequence[Doubt], shots: Sequence[Shot]) -> Section:
    """Return what is doubtful, by kind: what to do, frames, and the rest as a list."""
    if not doubts:
        return Section("What is doubtful", ("Nothing.",))
    below = []
    for kind in dict.fromkeys(doubt.kind for doubt in doubts):
        own = [number for number, doubt in enumerate(doubts) if doubt.kind == kind]
        shown = {shot.doubt for shot in shots} & set(own)
        parts: list[ReportFrames | ReportTable] = [*_rows_of_frames(doubts, shots, sorted(shown))]
        rest = [doubts[number] for number in own if number not in shown]
        text = [f"What to do: {ADVICE[kind]}"]
        if 0 < len(rest) <= 3:
            text += [doubt.words for doubt in rest]
        elif rest:
            rows = pl.DataFrame(
                [(doubt.robot, doubt.time_s, doubt.words) for doubt in rest],
                schema={"robot": pl.Int64, "time_s": pl.Float64, "what": pl.String},
                orient="row",
            )
            columns = {"time_s": Column("time", "s", decimals=1), "what": Column(prose=True)}
            caption = "More, without a picture" if shown else ""
            parts.append(ReportTable(rows, columns, caption, f"doubtful-{kind}", LISTED))
        below.append(Section(f"{TITLES[kind]} ({len(own)})", tuple(text), tuple(parts)))
    lead = "Most important first. A ring marks the place: where the robot or marker is, or was seen last."
    bounded = f" At most {FRAMES_UP_TO} frames are shown." if len(shots) > FRAMES_UP_TO - 4 else ""
    return Section("What is doubtful", (lead + bounded,), (), tuple(below))


def _rows_of_frames(
    doubts: Sequence[Doubt], shots: Sequence[Shot], shown: Sequence[int]
) -> list[ReportFrames]:
    """Return a row of frames for each doubt; those that have one frame each share a row."""
    if not shown:
        return []
    if all(len(doubts[number].shots) == 1 for number in shown):
        frames = [
            ReportFrame(shot.address, f"{doubts[shot.doubt].words} Shown: {shot.words}.")
            for shot in shots
            if shot.doubt in shown
        ]
        return [ReportFrames("", tuple(frames))]
    return [
        ReportFrames(
            doubts[number].words,
            tuple(ReportFrame(shot.address, shot.words) for shot in shots if shot.doubt == number),
        )
        for number in shown
    ]


def _seen(tracking: Tracking, doubts: Sequence[Doubt]) -> list[Section]:
    """Return the pictures of paths and of time."""
    gaps = tracking.gaps()
    names = list(tracking.markers.robots.values())
    frames = tracking.detections.time_s.size
    end_s = float(tracking.detections.time_s[-1])
    rows = []
    for name, edge in zip(names, tracking.detections.edge_px(), strict=True):
        own = gaps.filter(pl.col("robot") == name)
        lengths = own["end_s"] - own["start_s"]
        seen = tracking.positions.filter(pl.col("robot") == name).height
        stops = tracking.stops.filter(pl.col("robot") == name).height
        longest = float(lengths.max()) if own.height else 0.0  # type: ignore[arg-type]
        rows.append((name, seen / frames, own.height, longest, stops, float(edge)))
    table = pl.DataFrame(
        rows, schema=["robot", "seen", "gaps", "longest_gap_s", "stops", "edge_px"], orient="row"
    )
    columns = {
        "seen": Column("frames in which it was seen", percent=True),
        "longest_gap_s": Column("longest gap", "s", decimals=1),
        "edge_px": Column("width of the marker", "px", decimals=0),
    }
    moments = [
        (doubt.robot, doubt.time_s)
        for doubt in doubts
        if doubt.kind != "gap" and doubt.robot is not None and doubt.time_s is not None
    ]
    tracks = draw_tracks(tracking.positions, tracking.stops, tracking.markers.floor)
    line = draw_time_line(names, gaps, tracking.stops, end_s, moments)
    return [
        Section("Where robots were seen", (), (picture_of(tracks, "tracks"),)),
        Section(
            "When robots were seen",
            (),
            (picture_of(line, "time-line"), ReportTable(table, columns, "By robot", "robots")),
        ),
    ]


def _clock(tracked: TrackedLog, matched: pl.DataFrame) -> Section:
    """Return how the clocks fit."""
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
    return Section(
        "Clocks of the robots and of the video",
        (text,),
        (
            picture_of(draw_clock(matched), "clock"),
            ReportTable(by_robot, columns, "By robot", "clock-robots"),
        ),
    )


def _camera(tracking: Tracking) -> Section:
    """Return how lens and pose fit."""
    camera, residuals = tracking.camera, floor_residuals(tracking)
    lens = (
        f"fitted to a chessboard (to {camera.lens.error_px:.2f} px)"
        if camera.calibrated
        else "fitted to the markers of the video itself; a chessboard (`--lens`) is more exact"
    )
    sizes = [size for size in marker_sizes_m(tracking).values() if np.isfinite(size)]
    text = (
        f"Camera {camera.position_m[2]:.2f} m above the floor, above ({camera.position_m[0]:.2f}, "
        f"{camera.position_m[1]:.2f}) m; lens {lens}. Corners of the floor's markers are met to "
        f"{camera.floor_error_px:.2f} px; a pixel in the middle covers {mm_per_px(tracking):.2f} mm.",
        f"Robots' markers measure {1000 * float(np.median(sizes)):.1f} mm (median; stated: "
        f"{1000 * tracking.markers.size_m:g} mm). Black edges spread or shrink in print and exposure; 3 % are usual.",
    )
    robots_px, robots_mm = square_residuals(tracking)
    drawing = draw_lens(
        tracking.detections.size_px, tracking.detections.floor_px, residuals, robots_px, robots_mm
    )
    rows = [
        (marker, *tracking.markers.floor[marker][:2], *_rms(tracking, residuals, marker))
        for marker in tracking.markers.floor
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
    return Section(
        "Lens and markers of the floor",
        text,
        (picture_of(drawing, "lens"), ReportTable(table, columns, caption, "floor-markers")),
    )


def _rms(
    tracking: Tracking, residuals: dict[int, np.ndarray[tuple[int, ...], np.dtype[np.float64]]], marker: int
) -> tuple[float | None, float | None]:
    if marker not in residuals:
        return None, None
    error = float(np.sqrt((residuals[marker] ** 2).sum(axis=1).mean()))
    return error, error * mm_per_px(tracking)
