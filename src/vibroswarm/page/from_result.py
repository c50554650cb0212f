"""A run of a result as the page's record."""

from __future__ import annotations

import math
from pathlib import Path

import polars as pl

from vibroswarm.analysis.verdict import answers_of
from vibroswarm.errors import InputError
from vibroswarm.observation.boundary import expected_ones_on, readings_boundary
from vibroswarm.page.record import RunRecord
from vibroswarm.page.write import write_page
from vibroswarm.result import Result


def record_of(result: Result, run: int = 0, *, title: str = "") -> RunRecord:
    """All that the page shows of one run.

    Raises:
        InputError: the result has no such run, or was made without segments.
    """
    if result.segments is None:
        raise InputError("the page needs where robots were at all times; simulate with segments=True")
    floor = result.floor(run)
    scenario = result.scenario
    rays, decision = scenario.rays, scenario.decision
    size = (scenario.arena.width_m, scenario.arena.height_m)
    boundary, tested = decision.decision_boundary, readings_boundary(scenario)
    of_run = pl.col("run") == run
    summary = result.runs.filter(of_run).to_dicts()[0]
    names = ("vibroswarm", "python", "numpy", "numba", "architecture", "code")
    return RunRecord(
        title=title or f"{scenario.swarm.robots} robots on {floor.name}",
        arena_width_m=scenario.arena.width_m,
        arena_height_m=scenario.arena.height_m,
        floor=floor,
        t_end_s=summary["end_s"],
        strategy=scenario.strategy.name,
        seed=result.seed,
        run=run,
        fill_ratio=summary["fill_ratio"],
        consensus=summary["consensus"],
        consensus_time_s=summary["consensus_time_s"],
        motion=result.motion.filter(of_run),
        segments=result.segments.filter(of_run),
        observations=result.observations.filter(of_run),
        inference=result.inference.filter(of_run),
        robots=result.robots.filter(of_run),
        min_observations=decision.min_observations,
        gate=decision.gate,
        credible_threshold=decision.credible_threshold,
        decision_boundary=boundary,
        readings_boundary=tested,
        expected_ones=expected_ones_on(scenario.sensor, floor, size) if tested != boundary else None,
        prior_alpha=decision.prior_alpha,
        prior_beta=decision.prior_beta,
        tick_s=scenario.tick_s,
        body_radius_m=scenario.robot.body_radius_m,
        ray_forward_m=rays.forward_m,
        ray_sides_m=tuple(rays.side_m),
        ray_angles_rad=tuple(math.radians(angle) for angle in rays.angle_deg),
        ray_range_m=rays.range_m,
        ray_disc_radius_m=rays.disc_radius_m,
        avoidance_threshold_m=scenario.walk.avoidance_threshold_mm / 1000.0,
        truth=summary["truth"],
        answers=None if scenario.task.name == "fill_ratio" else answers_of(scenario),
        details={
            "scenario": scenario.hash,
            "motion": result.source,
            **{name: result.versions[name] for name in names if name in result.versions},
        },
    )


def write_run_page(result: Result, path: str | Path, run: int = 0) -> None:
    """Write the page that shows one run: one file, opened from disk.

    Raises:
        InputError: the result has no such run, was made without segments, or ``path`` cannot be written.
    """
    write_page(record_of(result, run), Path(path))
