"""The content of a run's page: its tables, and the constants needed to draw them.

| name | symbol | unit |
|---|---|---|
| avoidance_threshold_m | theta_c | m |
| credible_threshold | p_c | - |
| min_observations | O_c | - |
| fill_ratio | f | - |
| belief | p = P(share of ones < readings_boundary) | - |
| decision | d_f | 1 vibrating, 0 still, -1 undecided |
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import radians

import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor

COLUMNS = {
    "motion": ("robot", "sample", "stop_start_s", "time_s", "x_m", "y_m", "heading_rad"),
    "segments": ("robot", "start_s", "x_m", "y_m", "heading_rad", "speed_m_s", "turn_rate_rad_s", "kind"),
    "observations": ("robot", "sample", "tile", "energy", "observation"),
    "inference": (
        "robot",
        "sample",
        "message",
        "alpha",
        "beta",
        "messages_received",
        "belief_below",
        "decision",
    ),
    "robots": (
        "robot",
        "decision",
        "decision_time_s",
        "belief_at_decision",
        "alpha",
        "beta",
        "samples",
        "sent",
        "messages_received",
    ),
}
"""The columns that the page reads from each table, which may have more."""

OUTCOMES = ("right", "wrong", "split", "incomplete", "truth_undefined")
"""Outcomes of the swarm; ``truth_undefined``: a consensus on a floor without a right answer."""


@dataclass(frozen=True, eq=False)
class RunRecord:
    """One run for a page. Lengths in m, times in s, angles in rad.

    Args:
        title: the page's heading; any text.
        arena_width_m, arena_height_m: the walls are at 0 and here; x right, y up.
        floor: the tiles, in arena coordinates.
        t_end_s: when the run ended.
        strategy: what robots sent ("none", "positive", "soft").
        seed, run: these reproduce the run; seed None: it was recorded.
        fill_ratio: the true share of tiles that vibrate.
        consensus: one of ``OUTCOMES``.
        consensus_time_s: when the last robot decided, or None.
        motion, segments, observations, inference, robots: the run's tables (``COLUMNS``).
        tick_s: the robots' control period.
        gate: what ``min_observations`` counts.
        ray_forward_m, ray_sides_m, ray_angles_rad: where rays start and point, seen from the robot.
        ray_disc_radius_m: radius of other robots as seen by rays.
        readings_boundary: the share of ones that robots compare their readings with; None: ``decision_boundary``.
        expected_ones: the expected share of ones on this floor, shown instead of the fill ratio if
            ``readings_boundary`` differs from ``decision_boundary``; None: the fill ratio.
        details: further texts in the footer, by name.

    Raises:
        InputError: a table lacks a column, or ``consensus`` is unknown.
    """

    title: str
    arena_width_m: float
    arena_height_m: float
    floor: Floor
    t_end_s: float
    strategy: str
    seed: int | None
    run: int
    fill_ratio: float
    consensus: str
    consensus_time_s: float | None
    motion: pl.DataFrame
    segments: pl.DataFrame
    observations: pl.DataFrame
    inference: pl.DataFrame
    robots: pl.DataFrame
    min_observations: int = 0
    gate: str = "total"
    credible_threshold: float = 0.95
    decision_boundary: float = 0.5
    readings_boundary: float | None = None
    expected_ones: float | None = None
    prior_alpha: int = 1
    prior_beta: int = 1
    tick_s: float = 0.02
    body_radius_m: float = 0.015
    ray_forward_m: float = 0.008
    ray_sides_m: tuple[float, ...] = (0.0, 0.0075, -0.0075)
    ray_angles_rad: tuple[float, ...] = (0.0, radians(27), -radians(27))
    ray_range_m: float = 0.15
    ray_disc_radius_m: float = 0.0055
    avoidance_threshold_m: float = 0.055
    truth: int | None = None
    """The right decision; None: neither, or given by the fill ratio (without ``answers``)."""
    answers: tuple[str, str] | None = None
    """Meaning of decisions 0 and 1, if the question is not about the fill ratio."""
    details: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for table, columns in COLUMNS.items():
            frame: pl.DataFrame = getattr(self, table)
            missing = [name for name in columns if name not in frame.columns]
            if missing:
                raise InputError(f"the table has no column {', '.join(missing)}", field=table)
        if self.consensus not in OUTCOMES:
            raise InputError(f"'{self.consensus}' is not one of {', '.join(OUTCOMES)}", field="consensus")

    @property
    def true_decision(self) -> int | None:
        """1 if most tiles vibrate, 0 if most are still, None where the fill ratio is the boundary."""
        if self.answers is not None:
            return self.truth
        if self.fill_ratio == self.decision_boundary:
            return None
        return int(self.fill_ratio > self.decision_boundary)
