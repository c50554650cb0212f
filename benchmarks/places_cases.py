"""The cases that ``places_outcomes.py`` measures, and the tables that show them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

HARD: Final = ("random:0.48", "random:0.52")
ALL: Final = ("random:0.48", "random:0.52", "random:0.44", "random:0.56")
POOR: Final = {"odometry.level": "poor"}
REACH: Final = {"strategy.places.edge_reach_m": 0.01}
SOUND: Final = {"strategy.places.broken_prior": 0.0}

ROWS: Final[dict[str, dict[str, Any]]] = {
    "true places, v = 1": {"localisation.method": "true"},
    "v = 1": {},
    "v = 2": {"strategy.places.variance_factor": 2.0},
    "v = 2, no monitor": {"localisation.monitor": False, "strategy.places.variance_factor": 2.0},
    "falling": {"strategy.places.falls_from": 0.5},
    "falling, true places": {"strategy.places.falls_from": 0.5, "localisation.method": "true"},
}
"""Settings of the strategy places, by the name of their column; what is not set is the case's."""
USUAL: Final = ("true places, v = 1", "v = 1", "v = 2")
BOTH: Final = ("v = 1", "v = 2")
MONITORED: Final = ("v = 1", "v = 2, no monitor", "v = 2")


@dataclass(frozen=True)
class Case:
    """Robots, floors and settings that are measured together, on one motion.

    Args:
        preset: of the robots. values: by field of the scenario, for all rows. rows: names in ``ROWS``; ``soft`` is
            always measured. floors: as ``floor.source``. felt: fields that readings are made with and robots are not
            told.
    """

    preset: str = "paper"
    values: dict[str, Any] = field(default_factory=dict)
    rows: tuple[str, ...] = USUAL
    floors: tuple[str, ...] = HARD
    felt: dict[str, Any] = field(default_factory=dict)


def told(**values: Any) -> dict[str, Any]:
    """Return fields of localisation."""
    return {f"localisation.{name}": value for name, value in values.items()}


def pattern(name: str) -> Case:
    """Return the case of one of the paper's patterns."""
    grid = {"floor.rows": 10, "floor.columns": 10}
    return Case("paper", grid, ("falling", "v = 1", "falling, true places"), (f"{name}:0.48",))


def another_grid(side: int) -> Case:
    """Return the case of robots that presume so many tiles a side, on floors of 5 x 5 tiles."""
    presumed = {
        "floor.rows": side,
        "floor.columns": side,
        "floor.source": f"random:{side**2 // 2 / side**2!r}",  # of their grid; the case's floors do not fit on it
    }
    return Case(values=presumed, rows=("v = 1",), felt={"floor.rows": 5, "floor.columns": 5})


REACHED: Final[dict[str, Case]] = {
    "`paper`": Case(floors=ALL),
    "poor gyro": Case(values=POOR),
    "10 % loss": Case(values={"network.name": "loss", "network.loss.share": 0.1}),
    "one robot stuck at 1": Case(values={"faults.stuck_at_1": 0.2}, rows=BOTH),
    "the same, `broken_prior` 0": Case(values=SOUND | {"faults.stuck_at_1": 0.2}, rows=BOTH),
    "`calibrated`": Case("calibrated"),
    "`calibrated`, reach told": Case("calibrated", REACH, BOTH),
    "motion that suits": Case("optimised-places", floors=ALL),
}
PATTERNS: Final[dict[str, Case]] = {
    name: pattern(name) for name in ("diagonal", "stripe", "block-diagonal", "alternating", "random-fixed")
}
WRONG: Final[dict[str, Case]] = {
    "poor gyro told good": Case(values=POOR | told(assumed_level="good"), rows=MONITORED),
    "mean speed told 0.9": Case(values=told(assumed_speed_factor=0.9), rows=MONITORED),
    "mean speed told 1.3": Case(values=told(assumed_speed_factor=1.3), rows=MONITORED),
    "wheels slip 10 %": Case(values=told(assumed_speed_factor=1.2), rows=MONITORED),
    "rays of 10 mm noise told 4": Case(values={"rays.noise_m": 0.01}, rows=MONITORED),
    "rays of 20 mm noise told 4": Case(values={"rays.noise_m": 0.02}, rows=MONITORED),
    "rays of 20 mm noise told 20": Case(
        values={"rays.noise_m": 0.02} | told(ray_noise_m=0.02), rows=MONITORED
    ),
}
RATES: Final[dict[str, Case]] = {
    "theta_E 1.55": Case(rows=BOTH, felt={"sensor.rms_threshold": 1.55}),
}
GRIDS: Final[dict[str, Case]] = {
    "5 x 5": Case(rows=("v = 1",)),
    **{f"{side} x {side}": another_grid(side) for side in (10, 7, 6)},
}
OTHERS: Final[dict[str, Case]] = {
    "Kalman filter": Case(values=told(method="kalman"), rows=BOTH),
    "dead reckoning": Case(values=told(method="dead_reckoning"), rows=BOTH),
}
TABLES: Final[dict[str, dict[str, Case]]] = {
    "reached": REACHED,
    "patterns": PATTERNS,
    "wrong": WRONG,
    "rates": RATES,
    "grids": GRIDS,
    "others": OTHERS,
}
"""Cases by table, and within it by the words of the row."""

COLUMNS: Final[dict[str, tuple[str, ...]]] = {
    "reached": ("soft", *USUAL),
    "patterns": ("soft", "falling, true places", "v = 1", "falling"),
    "wrong": ("soft", *MONITORED),
    "rates": ("soft", *BOTH),
    "grids": ("soft", "v = 1"),
    "others": ("soft", *BOTH),
}
"""What each table shows in columns; the last is compared with soft feedback."""
ALIKE: Final = ("wrong", "grids")
"""Tables that show the first floor of each case: on the others figures are alike."""
RUNS: Final = {
    "reached": (1000, 9001),
    "patterns": (1000, 9001),
    "wrong": (400, 9002),
    "rates": (400, 9002),
    "grids": (300, 9003),
    "others": (400, 9001),
}
"""Runs of each cell, and seed."""
