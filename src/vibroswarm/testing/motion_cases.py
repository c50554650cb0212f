"""Cases (scenarios with some runs) in which motion sources are checked, and functions that the checks share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.motion.motion_tables import Motion
from vibroswarm.motion.source import Source, moved
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.testing.runs import require

Check = Callable[[Source], None]


@dataclass(frozen=True)
class Case:
    """A scenario, and the runs and the seed with which it is simulated."""

    name: str
    values: dict[str, Any] = field(hash=False)  # a dict has no hash, and ``motion_of`` needs one of the case
    runs: tuple[int, ...] = (0, 1)
    seed: int = 11

    @property
    def scenario(self) -> Scenario:
        """The whole scenario."""
        return Scenario().with_values(self.values)


CASES: Final = (
    Case("paper", {"run.t_end_s": 150.0}, (0, 3)),
    Case("one robot", {"swarm.robots": 1, "run.t_end_s": 200.0}, (5,)),
    Case(
        "crowd",
        {
            "arena.width_m": 0.4,
            "arena.height_m": 0.4,
            "swarm.robots": 20,
            "swarm.start_margin_m": 0.0,
            "run.t_end_s": 60.0,
        },
    ),
    Case(
        "corridor",
        {
            "arena.width_m": 0.3,
            "arena.height_m": 2.0,
            "swarm.robots": 8,
            "sample.timer": "always",
            "run.t_end_s": 100.0,
        },
    ),
    Case("hundred robots", {"swarm.robots": 100, "run.t_end_s": 15.0}, (0,)),
    Case(
        "cell",
        {
            "arena.width_m": 0.032,
            "arena.height_m": 0.04,
            "swarm.robots": 1,
            "swarm.start_margin_m": 0.0,
            "walk.avoidance_threshold_mm": 10.0,
            "run.t_end_s": 40.0,
        },
    ),
    Case(
        "two in a cell",
        {
            "arena.width_m": 0.065,
            "arena.height_m": 0.05,
            "swarm.robots": 2,
            "swarm.start_margin_m": 0.0,
            "walk.avoidance_threshold_mm": 8.0,
            "sample.timer": "held_at_avoidance",
            "run.t_end_s": 40.0,
        },
    ),
    Case(
        "odd periods",
        {
            "run.control_period_ms": 13,
            "run.t_end_s": 60.005,
            "sample.stop_ms": 70.0,
            "sample.sample_interval_ms": 777.0,
            "sample.timer": "hold_in_turn",
            "sample.interrupts_avoidance": False,
            "robot.speed_redraw": "robot",
            "robot.misalignment_min": -0.4,
            "robot.misalignment_max": 0.4,
            "walk.leg_min_ms": 0.0,
        },
    ),
    Case(
        "wide eyes",
        {
            "run.t_end_s": 80.0,
            "sample.timer": "frozen_in_avoidance",
            "walk.avoidance_threshold_mm": 120.0,
            "rays.side_m": [0.01, 0.0, -0.005, 0.0],
            "rays.angle_deg": [60.0, 0.0, -10.0, -90.0],
            "rays.forward_m": 0.0,
            "rays.disc_radius_m": 0.015,
        },
    ),
    Case(
        "veers that wander",
        {
            "run.t_end_s": 80.0,
            "arena.width_m": 0.5,
            "arena.height_m": 0.5,
            "sample.timer": "reset_at_avoidance",
            "robot.misalignment_wander": 0.05,
            "robot.misalignment_drift": 0.04,
            "robot.misalignment_drift_samples": 7,
            "robot.misalignment_run_spread": 0.03,
            "robot.speed_run_spread": 0.05,
        },
    ),
)
"""Few and short cases. Together they cover every mode of the walk, crowds, corridors, and arenas little larger than a
robot."""
SHORT_CASE: Final = CASES[2]
"""The crowd, in which much happens: for checks that need only one case."""


@lru_cache(maxsize=64)
def motion_of(source: Source, case: Case) -> Motion:
    """Return the motion of a case's runs, with moves if the source gives them; cached for all checks."""
    return moved(source, case.scenario, case.seed, case.runs, moves=True)


def same(one: Motion, other: Motion, words: str = "") -> None:
    """Require that the three tables of two motions are equal, bit by bit; a table may be None in both."""
    for name in ("samples", "ends", "moves"):
        tables = [table for table in (getattr(one, name), getattr(other, name)) if table is not None]
        is_equal = not tables or (len(tables) == 2 and tables[0].equals(tables[1]))
        require(is_equal, f"{words}: the {name} of the two differ".removeprefix(": "))


def ticks_of(values: pl.Series, scenario: Scenario) -> NDArray[np.int64]:
    """Return times in s as whole numbers of ticks (control periods), in the same order."""
    ticks = values.to_numpy().astype(float) / scenario.tick_s
    rounded = np.rint(ticks)
    # Times may be 32-bit floats, of 24 significant bits: their rounding error in these short cases is below 1e-3 ticks.
    require(np.abs(ticks - rounded).max(initial=0.0) < 1e-3, f"{values.name} is not on the control period")
    return rounded.astype(np.int64)
