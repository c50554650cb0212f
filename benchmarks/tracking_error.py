"""Measure the tracking of a rendered video against the truth: 1080p, 15 frames/s, another lens than is fitted.

    PYTHONPATH=tests python benchmarks/tracking_error.py --seconds 90 --seed 3

Lines: of a camera whose lens is fitted to a chessboard, of one fitted to the video itself, the same told its height,
and two controls: without the markers' height, and with a lens without distortion.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars as pl

from helpers.rehearsal import write_rehearsal
from helpers.scene import Look
from vibroswarm import preset, simulate
from vibroswarm.lab.tracking.camera import Lens, lens_from_chessboard
from vibroswarm.lab.tracking.markers import Markers, usual_markers
from vibroswarm.lab.tracking.track import Tracking, read_robot_log, track, with_positions

RATE, OFFSET_S = 15.0, 12.345


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=90.0)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--marker-mm", type=float, default=22.0)
    given = parser.parse_args()
    scenario = preset("paper").with_values({"run.t_end_s": given.seconds, "floor.source": "random:0.48"})
    result = simulate(scenario, given.seed, 1, poses=True)
    markers = usual_markers(scenario.swarm.robots, 1.0, 1.0, size_mm=given.marker_mm)
    with TemporaryDirectory() as folder:
        video = Path(folder) / "session.avi"
        made = write_rehearsal(
            result, video, markers, Look(frames_per_s=RATE), clock_offset_s=OFFSET_S, chessboard=True
        )
        assert made.chessboard is not None
        truth = pl.read_parquet(made.truth)
        log = read_robot_log(made.log)
        lens, size = lens_from_chessboard(made.chessboard, (9, 6))
        print(f"{made.frames} frames, markers {made.marker_px:.0f} px; lens fitted to {lens.error_px:.2f} px")
        flat = Lens(lens.matrix, np.zeros(5), 0.0)
        low = replace(markers, height_m=1e-6)
        for words, used, known, height_m in (
            ("chessboard", lens, markers, None),
            ("video itself", None, markers, None),
            ("video, height told", None, markers, 1.5),
            ("control: height 0", lens, low, None),
            ("control: no lens", flat, markers, None),
        ):
            begin = time.process_time()
            tracking = track(video, known, lens=used, lens_size_px=size, camera_height_m=height_m)
            took = time.process_time() - begin
            print(
                f"{words:20s} {errors(tracking, truth, known)}  {made.frames / took:.0f} frames/s", flush=True
            )
            if used is lens and known is markers:
                print(f"{'':20s} {stops(tracking, result.motion, truth)}")
                found = with_positions(tracking, log, "log.csv", scenario.run.control_period_ms / 1000).offset
                late_ms = 1000 * (found.offset_s - OFFSET_S)
                print(
                    f"{'':20s} clock off by {late_ms:+.0f} ms, standard error {1000 * found.error_s:.0f} ms"
                )


def errors(tracking: Tracking, truth: pl.DataFrame, markers: Markers) -> str:
    """Return errors of places and headings in words."""
    frame = (pl.col("time_s") * RATE).round().cast(pl.Int64)
    true = truth.with_columns(robot=pl.col("robot").cast(pl.Int64), frame=frame)
    both = tracking.positions.with_columns(frame=frame).join(true, on=["robot", "frame"], suffix="_true")
    away = 1000 * np.hypot(both["x_m"] - both["x_m_true"], both["y_m"] - both["y_m_true"])
    turned = np.angle(np.exp(1j * (both["heading_rad"] - both["heading_rad_true"]).to_numpy()))
    shown = true.filter(~pl.col("hidden")).height
    return (
        f"median {np.median(away):.2f} mm, 95 % {np.quantile(away, 0.95):.2f} mm; heading 95 % "
        f"{np.degrees(np.quantile(abs(turned), 0.95)):.2f} deg; seen {100 * both.height / shown:.1f} % of {shown}"
    )


def stops(tracking: Tracking, motion: pl.DataFrame, truth: pl.DataFrame) -> str:
    """Return how many stops are found, how many of the others a hand hides, and how many are none."""
    true = motion.select(pl.col("robot").cast(pl.Int64), "stop_start_s", true_s="time_s")
    ended = tracking.stops.filter(pl.col("end_seen"))
    near = ended.join(true, on="robot").filter((pl.col("end_s") - pl.col("true_s")).abs() < 0.5)
    hits = near.select("robot", "true_s").unique()
    missed = true.join(hits, on=["robot", "true_s"], how="anti")
    hand = truth.filter("hidden").select(pl.col("robot").cast(pl.Int64), hand_s="time_s")
    within = pl.col("hand_s").is_between(pl.col("stop_start_s"), pl.col("true_s") + 0.2)
    hidden = missed.join(hand, on="robot").filter(within).select("robot", "true_s").unique().height
    good = near.select("robot", "end_s").unique().height
    return (
        f"{hits.height} of {true.height} stops found, {hidden} of the others hidden by the hand; "
        f"{ended.height - good} of {ended.height} are none"
    )


if __name__ == "__main__":
    main()
