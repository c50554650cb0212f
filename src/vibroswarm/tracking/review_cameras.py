"""Sections of the review page about the cameras: lens and pose of each, and how several agree."""

from __future__ import annotations

import numpy as np
import polars as pl

from vibroswarm.report.html import Column, ReportTable, Section, picture_of
from vibroswarm.tracking.doubts import floor_residuals, marker_sizes_m, mm_per_px, square_residuals
from vibroswarm.tracking.pictures import draw_lens, draw_overlap
from vibroswarm.tracking.stitch import Stitched
from vibroswarm.tracking.track import Tracking


def overlap_section(session: Stitched) -> Section:
    """Return how well the clocks and places of several cameras agree."""
    rows, places, apart = [], [], []
    for number, (camera, overlap) in enumerate(zip(session.cameras, session.overlaps, strict=True), start=1):
        if overlap is None:
            continue
        shift = 1000 * np.median(overlap.apart_m, axis=0)
        rows.append(
            (
                number, camera.video.name, overlap.offset_s, 1000 * overlap.error_s, overlap.pairs,
                1000 * overlap.disagreement_m(), 1000 * overlap.disagreement_m(0.95), float(shift[0]), float(shift[1]),
            )
        )  # fmt: skip
        places.append(overlap.places_m)
        apart.append(overlap.apart_m)
    names = ("camera", "video", "offset_s", "error_ms", "pairs", "median_mm", "most_mm", "x_mm", "y_mm")
    columns = {
        "offset_s": Column("begins later than the first", "s", decimals=3),
        "error_ms": Column("standard error", "ms", decimals=1),
        "pairs": Column("positions seen by both"),
        "median_mm": Column("apart (median)", "mm", decimals=2),
        "most_mm": Column("apart (95 %)", "mm", decimals=2),
        "x_mm": Column("shift in x", "mm", decimals=2),
        "y_mm": Column("shift in y", "mm", decimals=2),
    }
    table = pl.DataFrame(rows, schema=list(names), orient="row")
    text = (
        "Offsets are from robots that two cameras saw at once. Where both see a robot its place is their mean, "
        "weighted by resolution and by the distance to the picture's edge.",
        "A shift that is the same everywhere is a marker of the floor that was measured wrongly; one that turns or "
        "grows is a lens: calibrate it with a chessboard (`--lens`).",
    )
    picture = picture_of(draw_overlap(np.concatenate(places), np.concatenate(apart)), "overlap")
    caption = "Each camera against those before it"
    return Section("Where views overlap", text, (picture, ReportTable(table, columns, caption, "cameras")))


def camera_section(tracking: Tracking, name: str = "") -> Section:
    """Return how lens and pose of a camera fit.

    Args:
        name: what to add to headings, such as " of camera 2".
    """
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
        f"{1000 * tracking.markers.size_m:g} mm). Edges are seen "
        f"{camera.edge_px:+.2f} px outwards, by blur, print and exposure, which is taken off.",
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
        f"Lens and markers of the floor{name}",
        text,
        (
            picture_of(drawing, f"lens{name}"),
            ReportTable(table, columns, caption, f"floor-markers{name}"),
        ),
    )


def _rms(
    tracking: Tracking, residuals: dict[int, np.ndarray[tuple[int, ...], np.dtype[np.float64]]], marker: int
) -> tuple[float | None, float | None]:
    if marker not in residuals:
        return None, None
    error = float(np.sqrt((residuals[marker] ** 2).sum(axis=1).mean()))
    return error, error * mm_per_px(tracking)
