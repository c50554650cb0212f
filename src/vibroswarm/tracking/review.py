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
from vibroswarm.tracking.doubts import ADVICE, TITLES, Doubt, doubts_of, mm_per_px
from vibroswarm.tracking.pictures import draw_clock, draw_time_line, draw_tracks
from vibroswarm.tracking.review_cameras import camera_section, overlap_section
from vibroswarm.tracking.stitch import Stitched
from vibroswarm.tracking.track import TrackedLog

REVIEW: Final = "review.html"
LISTED: Final = 200
"""Doubts of one kind that are listed; the first of them with pictures."""


def write_review(
    path: Path, session: Stitched, tracked: TrackedLog | None = None, samples: pl.DataFrame | None = None
) -> list[Doubt]:
    """Write the page; return what is doubtful.

    Args:
        tracked, samples: the robots' log with positions, and as it was read.
    Raises:
        InputError: the folder cannot be written.
    """
    matched, lone = (None, None)
    if tracked is not None and samples is not None:
        matched, lone = match_samples(session.stops, samples, tracked.offset)
    doubts = doubts_of(session, matched, lone)
    write_report(path, review_of(session, doubts, shots_of(session, doubts), tracked, matched))
    return doubts


def review_of(
    session: Stitched,
    doubts: Sequence[Doubt],
    shots: Sequence[Shot],
    tracked: TrackedLog | None = None,
    matched: pl.DataFrame | None = None,
) -> Report:
    """Return the page as a report."""
    sections = [_doubtful(doubts, shots), *_seen(session, doubts)]
    if tracked is not None and matched is not None:
        sections.append(_clock(tracked, matched))
    if len(session.cameras) > 1:
        sections.append(overlap_section(session))
    details = {}
    for number, camera in enumerate(session.cameras, start=1):
        several = f" of camera {number}" if len(session.cameras) > 1 else ""
        sections.append(camera_section(camera, several))
        size, time_s = camera.detections.size_px, camera.detections.time_s
        details[f"video{several}"] = str(camera.video)
        details[f"picture{several}"] = f"{size[0]} x {size[1]} px, {time_s.size} frames, {time_s[-1]:.1f} s"
    markers = session.markers
    details["markers"] = (
        f"dictionary {markers.dictionary}, {1000 * markers.size_m:g} mm, {1000 * markers.height_m:g} mm above the floor"
    )
    return Report(
        title=f"Tracking of {' and '.join(camera.video.name for camera in session.cameras)}",
        lead=(answer(session, doubts, tracked),),
        warnings=tuple(session.warnings()),
        sections=tuple(sections),
        details=details | versions(),
    )


def answer(session: Stitched, doubts: Sequence[Doubt], tracked: TrackedLog | None = None) -> str:
    """Return how well the robots were tracked, and whether anything is doubtful, in sentences."""
    robots = len(session.markers.robots)
    text = (
        f"{100 * session.share_found():.1f} % of the positions of {robots} robots were found, and "
        f"{session.stops.height} stops. "
    )
    worst = max(session.cameras, key=lambda camera: camera.camera.floor_error_px * mm_per_px(camera))
    error_px = worst.camera.floor_error_px
    text += f"The floor's markers are met to {error_px * mm_per_px(worst):.1f} mm ({error_px:.2f} px). "
    for overlap in filter(None, session.overlaps):
        text += f"Where views overlap, cameras agree to {1000 * overlap.disagreement_m():.1f} mm (median). "
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


def _seen(session: Stitched, doubts: Sequence[Doubt]) -> list[Section]:
    """Return the pictures of paths and of time."""
    gaps = session.gaps()
    names = list(session.markers.robots.values())
    first_s, last_s = session.span_s
    frames = session.cameras[0].detections.time_s.size
    edges = np.stack([camera.detections.edge_px() for camera in session.cameras])
    rows = []
    for name, edge in zip(names, np.nanmax(np.nan_to_num(edges), axis=0).tolist(), strict=True):
        own = gaps.filter(pl.col("robot") == name)
        lengths = own["end_s"] - own["start_s"]
        seen = session.positions.filter(pl.col("robot") == name).height / frames
        if len(session.cameras) > 1:
            seen = 1.0 - float(lengths.sum()) / (last_s - first_s)
        stops = session.stops.filter(pl.col("robot") == name).height
        longest = float(lengths.max()) if own.height else 0.0  # type: ignore[arg-type]
        rows.append((name, seen, own.height, longest, stops, edge))
    table = pl.DataFrame(
        rows, schema=["robot", "seen", "gaps", "longest_gap_s", "stops", "edge_px"], orient="row"
    )
    columns = {
        "seen": Column("seen", percent=True),
        "longest_gap_s": Column("longest gap", "s", decimals=1),
        "edge_px": Column("width of the marker", "px", decimals=0),
    }
    moments = []
    for doubt in doubts:
        if doubt.kind != "gap" and doubt.robot is not None and doubt.time_s is not None:
            own_clock = doubt.kind in ("sample", "stop", "late")
            moments.append(
                (doubt.robot, doubt.time_s + (0.0 if own_clock else session.offset_s(doubt.camera)))
            )
    tracks = draw_tracks(session.positions, session.stops, session.markers.floor)
    line = draw_time_line(names, gaps, session.stops, (first_s, last_s), moments)
    by_robot = ReportTable(table, columns, "By robot", "robots")
    return [
        Section("Where robots were seen", (), (picture_of(tracks, "tracks"),)),
        Section("When robots were seen", (), (picture_of(line, "time-line"), by_robot)),
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
