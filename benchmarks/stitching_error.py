"""Measure what two cameras whose views overlap give together, against the truth: 1080p, 15 frames/s, rendered.

    python benchmarks/stitching_error.py --seconds 20 --seed 3 --work DIR

The cameras hang crosswise, the other way round and tilted, with different lenses; the second begins later. Lines: each
camera alone and both together, with lenses from a chessboard and from the videos themselves. DIR keeps the videos.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vibroswarm import preset, simulate
from vibroswarm.tracking.camera import lens_from_chessboard
from vibroswarm.tracking.markers import read_markers, usual_markers
from vibroswarm.tracking.rehearsal import write_rehearsal
from vibroswarm.tracking.scene import Look
from vibroswarm.tracking.stitch import stitch
from vibroswarm.tracking.track import track

CAMERAS = 2


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--work", type=Path, required=True)
    given = parser.parse_args()
    given.work.mkdir(parents=True, exist_ok=True)
    video = given.work / "two.avi"
    videos = [video, given.work / "two.2.avi"]
    boards = [path.with_name(f"{path.stem}.chessboard.avi") for path in videos]
    if not boards[-1].exists():
        scenario = preset("paper").with_values({"run.t_end_s": given.seconds, "floor.source": "random:0.48"})
        result = simulate(scenario, given.seed, 1, segments=True)
        markers = usual_markers(scenario.swarm.robots, 1.0, 1.0, cameras=CAMERAS)
        write_rehearsal(result, video, markers, Look(), chessboard=True, cameras=CAMERAS, replace=True)
    markers = read_markers(given.work / "two.markers.toml")
    truth = pl.read_parquet(given.work / "two.truth.parquet")
    lenses = [lens_from_chessboard(board, (9, 6)) for board in boards]
    for words, chosen in (("chessboard", lenses), ("video itself", [(None, None)] * CAMERAS)):
        seen = [
            track(path, markers, lens=lens, lens_size_px=size)
            for path, (lens, size) in zip(videos, chosen, strict=True)
        ]
        together = stitch(seen)
        overlap = together.overlaps[1]
        assert overlap is not None
        print(
            f"{words}: clock {overlap.offset_s:.4f} s (standard error {1000 * overlap.error_s:.2f} ms), apart "
            f"{1000 * overlap.disagreement_m():.2f} mm (95 %: {1000 * overlap.disagreement_m(0.95):.2f} mm)"
        )
        for name, table, ahead_s in (
            ("camera 1", seen[0].positions, 0.0),
            ("camera 2", seen[1].positions, overlap.offset_s),
            ("both", together.positions, 0.0),
        ):
            errors = errors_mm(table.with_columns(pl.col("time_s") + ahead_s), truth)
            print(
                f"  {name:10s} {errors.size:6d} positions, median {np.median(errors):.2f} mm, 95 % "
                f"{np.quantile(errors, 0.95):.2f} mm, most {errors.max():.2f} mm",
                flush=True,
            )


def errors_mm(positions: pl.DataFrame, truth: pl.DataFrame) -> np.ndarray[Any, Any]:
    """Return distances from the truth, interpolated in time, mm."""
    parts = []
    for robot in truth["robot"].unique().to_list():
        own, true = (table.filter(pl.col("robot") == robot) for table in (positions, truth))
        x, y = (np.interp(own["time_s"], true["time_s"], true[name]) for name in ("x_m", "y_m"))
        parts.append(1000 * np.hypot(own["x_m"] - x, own["y_m"] - y))
    return np.concatenate(parts)


if __name__ == "__main__":
    main()
