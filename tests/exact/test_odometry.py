"""What robots measure of their moves: pieces joined, stops without turns, and the gyro's errors of their stated law."""

from __future__ import annotations

import math

import numpy as np
import polars as pl
import pytest

from vibroswarm.localisation.locate import program_of
from vibroswarm.localisation.odometry import measure, noticed, odometer_of
from vibroswarm.motion.motion_tables import ENDS, MOVES
from vibroswarm.robot.walk import KINDS
from vibroswarm.scenario.scenario import Scenario

EXACT = {
    "odometry.gyro_scale_spread": 0.0,
    "odometry.gyro_bias_spread_deg_s": 0.0,
    "odometry.turn_noise_deg": 0.0,
    "odometry.gyro_walk_deg_sqrt_s": 0.0,
}
DAY = [
    # start_s, kind, turned_rad, ray_m
    (0.0, "stop", 0.0, None),
    (0.02, "drive", 0.1, None),
    (2.0, "drive", 0.05, None),  # blocked: speed 0, another move of the table
    (2.5, "drive", 0.02, None),
    (4.0, "avoid", 1.0, 0.05),
    (4.5, "avoid", -0.5, 0.04),  # another obstacle
    (5.0, "stop", 0.0, None),
    (6.02, "avoid", 0.25, None),  # goes on
    (6.5, "drive", 0.3, None),
    (8.0, "turn", 2.0, None),
    (9.0, "turn", -1.0, None),
]


def moves_of(runs: int, robots: int, day: list[tuple[float, str, float, float | None]] = DAY) -> pl.DataFrame:
    """A table of moves in which every robot has the same ones."""
    rows = [
        {
            "run": run, "robot": robot, "start_s": start_s, "x_m": 0.5, "y_m": 0.5, "heading_rad": 0.0,
            "speed_m_s": 0.0, "turn_rate_rad_s": 0.0, "kind": kind, "turned_rad": turned_rad, "ray_m": ray_m,
        }
        for run in range(runs) for start_s, kind, turned_rad, ray_m in day for robot in range(robots)
    ]  # fmt: skip
    return pl.DataFrame(rows, schema=MOVES)


def ends_of(runs: int, robots: int, end_s: float = 10.0) -> pl.DataFrame:
    rows = [{"run": run, "robot": robot, "end_s": end_s} for run in range(runs) for robot in range(robots)]
    return pl.DataFrame(rows, schema=ENDS)


def measure_moves(scenario: Scenario, seed: int, moves: pl.DataFrame, ends: pl.DataFrame) -> pl.DataFrame:
    """What all robots measure of their moves, as a table."""
    tables = []
    for (run, robot), own in moves.group_by("run", "robot", maintain_order=True):
        columns = [own["start_s"], own["turned_rad"], own["ray_m"].fill_null(math.nan)]
        kind = own["kind"].to_physical().to_numpy().astype(np.int64)
        end_s = ends.filter(pl.col("run") == run, pl.col("robot") == robot)["end_s"][0]
        measured = noticed(kind, *(each.to_numpy() for each in columns), end_s)
        measure(odometer_of(scenario), measured, np.zeros(3), seed, run, robot)
        table = pl.DataFrame({"run": run, "robot": robot, **measured._asdict()}).fill_nan(None)
        tables.append(table.with_columns(kind=pl.Series(KINDS).gather(measured.kind)))
    return pl.concat(tables).sort("run", "robot", maintain_order=True).rename({"turned_rad": "gyro_rad"})


def test_without_errors_turns_are_those_of_the_moves() -> None:
    scenario = Scenario().with_values({**EXACT, "swarm.robots": 2})
    measured = measure_moves(scenario, 1, moves_of(2, 2), ends_of(2, 2))
    own = measured.filter((pl.col("run") == 1) & (pl.col("robot") == 1))
    assert own["kind"].to_list() == [
        "stop", "drive", "avoid", "avoid", "stop", "avoid", "drive", "turn",
    ]  # fmt: skip
    turned = [0.0, 0.17, 1.0, -0.5, 0.0, 0.25, 0.3, 1.0]
    assert own["gyro_rad"].to_list() == pytest.approx(turned, abs=1e-12)
    durations = [0.02, 3.98, 0.5, 0.5, 1.02, 0.48, 1.5, 2.0]
    assert own["duration_s"].to_list() == pytest.approx(durations, abs=1e-9)
    assert own["ray_m"].to_list() == [None, None, 0.05, 0.04, None, None, None, None]


def errors_of(scenario: Scenario, seed: int, day: list[tuple[float, str, float, float | None]]) -> np.ndarray:
    """Gyro less truth of each move, (runs, moves)."""
    runs = 3000
    scenario = scenario.with_values({"swarm.robots": 1})
    measured = measure_moves(scenario, seed, moves_of(runs, 1, day), ends_of(runs, 1))
    truth = np.array([turned for _, _, turned, _ in day])
    return measured["gyro_rad"].to_numpy().reshape(runs, -1) - truth


@pytest.mark.parametrize("level", ["good", "poor"])
def test_errors_have_the_stated_law(level: str) -> None:
    """Standard deviations within 6 % of the law's (4.6 standard errors), and those of the other level not."""
    day = [(0.0, "stop", 0.0, None), (1.0, "drive", 0.5, None), (5.0, "turn", 3.0, None)]
    found = errors_of(Scenario().with_values({"odometry.level": level}), 5, day)
    assert (found[:, 0] == 0.0).all()
    laws = {"good": (0.01, 0.05, 0.5, 0.1), "poor": (0.03, 0.2, 2.0, 0.3)}

    def spreads(scale: float, bias: float, turn: float, walk: float) -> list[float]:
        drive = math.hypot(0.5 * scale, math.radians(bias) * 4.0, math.radians(walk) * 2.0)
        full = math.hypot(
            3.0 * scale, math.radians(bias) * 5.0, math.radians(turn), math.radians(walk) * 5**0.5
        )
        return [drive, full]

    spread = found[:, 1:].std(axis=0)
    assert spread == pytest.approx(spreads(*laws[level]), rel=0.06)
    other = laws["poor" if level == "good" else "good"]
    assert not (abs(spread / spreads(*other) - 1.0) < 0.06).any()
    assert abs(found[:, 1:].mean(axis=0) / spread).max() < 4.0 / math.sqrt(3000)


def test_rays_have_the_stated_noise_and_nothing_else_changes() -> None:
    """Standard deviation within 6 % (4.6 standard errors), one number for each ray, and none where no ray is."""
    day = [
        (0.0, "drive", 0.5, None),
        (4.0, "avoid", 1.0, 0.05),
        (5.0, "drive", 0.1, None),
        (7.0, "avoid", 1.0, 0.05),
    ]
    scenario, runs = Scenario().with_values({"swarm.robots": 1}), 3000
    exact, noisy, other = (
        measure_moves(
            scenario.with_values({"rays.noise_m": m}), seed, moves_of(runs, 1, day), ends_of(runs, 1)
        )
        for m, seed in ((0.0, 5), (0.01, 5), (0.01, 6))
    )
    assert noisy.drop("ray_m").equals(exact.drop("ray_m"))
    assert exact["ray_m"].drop_nulls().unique().to_list() == [0.05]
    assert noisy["ray_m"].is_null().equals(exact["ray_m"].is_null())
    found = noisy["ray_m"].drop_nulls().to_numpy().reshape(runs, 2) - 0.05
    assert found.std(axis=0) == pytest.approx(0.01, rel=0.06)
    assert abs(found.mean(axis=0)).max() < 4.0 * 0.01 / math.sqrt(runs)
    assert abs(np.corrcoef(found.T)[0, 1]) < 4.0 / math.sqrt(runs)
    assert abs(
        np.corrcoef(found[:, 0], noisy["gyro_rad"].to_numpy().reshape(runs, -1)[:, 1])[0, 1]
    ) < 4.0 / math.sqrt(runs)
    assert not other["ray_m"].equals(noisy["ray_m"])
    wild = measure_moves(
        scenario.with_values({"rays.noise_m": 0.2}), 5, moves_of(runs, 1, day), ends_of(runs, 1)
    )
    assert (wild["ray_m"].min(), wild["ray_m"].max()) == (0.0, scenario.rays.range_m)


def test_noise_is_addressed() -> None:
    """A run's measurements, of rays too, do not depend on the other runs, and change with the seed."""
    scenario = Scenario().with_values({"swarm.robots": 2, "rays.noise_m": 0.01})
    both = measure_moves(scenario, 3, moves_of(2, 2), ends_of(2, 2))
    second = moves_of(2, 2).filter(pl.col("run") == 1)
    alone = measure_moves(scenario, 3, second, ends_of(2, 2).filter(pl.col("run") == 1))
    assert both.filter(pl.col("run") == 1).equals(alone)
    other = measure_moves(scenario, 4, second, ends_of(2, 2).filter(pl.col("run") == 1))
    assert not other["gyro_rad"].equals(alone["gyro_rad"])


def test_a_bias_measured_at_stops_is_subtracted_as_its_mean() -> None:
    """Before the stop at 5 s one measurement, of the start; then the mean of two: variances s^2 and s^2 / 2."""
    day = [(0.0, "drive", 0.0, None), (5.0, "stop", 0.0, None), (6.0, "drive", 0.0, None)]
    without = Scenario().with_values({**EXACT, "odometry.gyro_bias_spread_deg_s": 20.0})
    scenario = without.with_values({"odometry.rezero_noise_deg_s": 0.5})
    size = 400
    rates = []
    for of in (without, scenario):
        measured = measure_moves(of, 5, moves_of(size, 5, day), ends_of(size, 5)).filter(
            pl.col("kind") == "drive"
        )
        each = (measured["gyro_rad"] / measured["duration_s"]).to_numpy().reshape(-1, 2)
        rates.append(np.degrees(each))
    assert rates[0].std() == pytest.approx(20.0, rel=0.06)
    assert rates[0][:, 0] == pytest.approx(rates[0][:, 1])
    assert rates[1][:, 0].std() == pytest.approx(0.5, rel=0.08)
    assert [math.degrees(program_of(of).gyro_bias_spread_rad_s) for of in (without, scenario)] == [20.0, 0.5]
    assert rates[1][:, 1].std() == pytest.approx(0.5 / math.sqrt(2.0), rel=0.08)
    assert np.corrcoef(rates[1].T)[0, 1] == pytest.approx(math.sqrt(0.5), abs=0.07)
