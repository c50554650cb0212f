"""The walk against the logs of the study's simulator: spacing and distance of samples, time spent avoiding.

The logs stay where they are; VIBROSWARM_RUGBOT names their folder.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import polars as pl
import pytest

from vibroswarm.paper.columns import AUTHORS, real_floor
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate

WITHIN = {"spacing_s": 0.005, "distance_m": 0.03, "avoid_ms": 0.10}
"""Largest relative difference of the means."""
RUNS = 100
SEED = 6

Means = dict[str, float]


def means_of(samples: pl.DataFrame) -> Means:
    """Means over consecutive samples of one robot.

    Args:
        samples: run, robot, time_s, x_m, y_m and avoid_ms (summed up since the start), in the order of time.
    """
    step = samples.select(
        spacing_s=pl.col("time_s").diff().over("run", "robot"),
        distance_m=(pl.col("x_m").diff() ** 2 + pl.col("y_m").diff() ** 2).sqrt().over("run", "robot"),
        avoid_ms=pl.col("avoid_ms").diff().over("run", "robot"),
    ).drop_nulls()
    return {name: float(step[name].mean()) for name in step.columns}  # type: ignore[arg-type]


def read_log(path: Path, run: int) -> pl.DataFrame:
    """The samples of one log; a line of data has at least ten commas."""
    rows = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        if line.count(",") < 10 or not line[:1].isdigit():
            continue
        parts = line.split(",")
        rows.append((run, int(parts[2]), *(float(parts[k]) for k in (1, 12, 13, 15))))
    columns = ["run", "robot", "time_s", "x_m", "y_m", "avoid_ms"]
    # Each robot's last line stands twice.
    return pl.DataFrame(rows, schema=columns, orient="row").unique(maintain_order=True).sort("run", "time_s")


@pytest.fixture(scope="module")
def logged(recordings: Path) -> Means:
    """Of the three logs together."""
    means = means_of(pl.concat([read_log(recordings / name, run) for run, name in enumerate(AUTHORS)]))
    # What is known of the logs; else they are not the ones meant, or misread.
    assert means["spacing_s"] == pytest.approx(3.355, abs=0.005)
    assert means["distance_m"] == pytest.approx(0.0962, abs=0.0005)
    assert means["avoid_ms"] == pytest.approx(357, abs=4)
    return means


def simulated(**changes: Any) -> Means:
    """At the settings of the logs."""
    settings = {
        **real_floor(),
        "walk.walk_duration_location_ms": 7500.0,
        "walk.walk_duration_scale_ms": 15_000.0,
        "walk.avoidance_threshold_mm": 50.0,
        "sample.sample_interval_ms": 2000.0,
        "sensor.rms_threshold": 1.55,
    }
    changes = {name.replace("__", "."): value for name, value in changes.items()}
    scenario = preset("paper").with_values(settings | changes)
    assert (scenario.swarm.robots, scenario.run.t_end_s) == (5, 1200.0)
    samples = simulate(scenario, SEED, RUNS, energies=False).motion
    # As in the logs: samples of the first five seconds are not printed.
    told = samples.with_columns(
        avoid_ms=1000 * pl.col("avoid_s").cast(pl.Float64).cum_sum().over("run", "robot")
    )
    return means_of(told.filter(pl.col("time_s") > 5))


def outside(found: Means, logged: Means) -> dict[str, str]:
    """What differs by more than it may, and how."""
    return {
        name: f"{found[name]:.5g} against {logged[name]:.5g} in the logs, {found[name] / logged[name] - 1:+.2%}"
        for name, limit in WITHIN.items()
        if abs(found[name] / logged[name] - 1) > limit
    }


def test_the_walk_is_that_of_the_logs(logged: Means) -> None:
    found = simulated()
    assert not outside(found, logged), f"{outside(found, logged)}; all: {found}"


@pytest.mark.parametrize(
    ("changes", "seen_in"),
    [
        ({"walk__avoidance_threshold_mm": 100.0}, {"distance_m"}),
        ({"walk__turn_max_deg": 120.0}, {"avoid_ms"}),
        ({"sample__timer": "always"}, {"spacing_s"}),
        ({"sample__timer": "hold_in_turn"}, {"spacing_s"}),
        ({"robot__full_speed_m_s": 0.050}, {"distance_m"}),
        ({"walk__leg_max_ms": 1e9}, {"spacing_s"}),
    ],
    ids=["theta_c 100", "turns of 120", "timer always", "timer hold", "speed 50", "legs not clipped"],
)
def test_other_settings_fall_outside(logged: Means, changes: dict[str, Any], seen_in: set[str]) -> None:
    """Negative controls."""
    found = simulated(**changes)
    assert seen_in <= set(outside(found, logged)), str(found)
