"""What a simulation was made with comes out of its figures again, from whole paths and from a log of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy.special import ndtri

from helpers.recordings import write_log
from vibroswarm.calibrate.drive import course_of, drive_of, drive_table, line_of, quartile_spread
from vibroswarm.calibrate.few_groups import drawn_means, drawn_variances
from vibroswarm.calibrate.fit_avoidance import fields_of
from vibroswarm.calibrate.fit_rays import fit_rays
from vibroswarm.calibrate.fit_sensor import SensorFit
from vibroswarm.calibrate.session_statistics import FIGURES, Figure, _of_samples, figures_of
from vibroswarm.calibrate.wall_approach import _to_wall
from vibroswarm.documents.calibration import figures_document
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.read import read_log
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate
from vibroswarm.statistics.intervals import mean_interval


def made(runs: int = 2, **changes: Any) -> Result:
    values = {name.replace("__", "."): value for name, value in changes.items()}
    base = preset("paper-empirical").with_values({"floor.redraw": "study", **values})
    return simulate(base, 21, runs, poses=True)


def test_the_papers_robots() -> None:
    """Speed factor of mean 1.094 and standard deviation 0.14 redrawn at samples; 14.3 % lost in 1200 s."""
    result = made(4)
    found = {one.name: one.interval for one in figures_of(result)}
    assert found["start_speed_m_s"].estimate == pytest.approx(0.0549 * 1.094, rel=0.02)
    assert found["drop"].estimate == pytest.approx(1200 / 8400, abs=0.02)
    assert found["share_between"].estimate < 0.05
    assert abs(found["lag_one"].estimate) < 0.08
    assert found["within_m_s"].estimate / found["speed_m_s"].estimate == pytest.approx(0.14, abs=0.015)
    assert found["packet_loss"].estimate == 0.0
    assert set(found) == set(FIGURES)


def test_speeds_that_robots_keep() -> None:
    result = made(robot__speed_redraw="robot")
    found = {one.name: one.interval for one in figures_of(result)}
    assert found["share_between"].estimate > 0.9
    assert found["within_m_s"].estimate < 0.002
    untracked = drive_table(replace(result, poses=None))["speed_m_s"].mean()
    assert untracked == pytest.approx(found["speed_m_s"].estimate, rel=0.05)


@pytest.mark.parametrize("misalignment", [-0.03, 0.02])
def test_a_veer(misalignment: float) -> None:
    """w = 2 v m_d / track, anticlockwise where the right wheel is the faster."""
    result = made(1, robot__misalignment_min=misalignment, robot__misalignment_max=misalignment)
    found = drive_of(drive_table(result))
    wanted = 2 * found["speed_m_s"] * misalignment / 0.0394
    assert found["veer_rad_s"] == pytest.approx(wanted, rel=0.06)
    assert found["veer_between_rad_s"] < 0.01


def test_figures_of_two_robots_drives_by_hand() -> None:
    """Speeds alternate by 1 cm/s, + - - +, about those that the robots keep, and veers are theirs alone.

    Of twelve deviations from a line ten are free.
    """
    kept = pl.DataFrame({"robot": [0, 1], "speed_m_s": [0.05, 0.07], "veer_rad_s": [0.1, 0.3]})
    steps = pl.DataFrame({"time_s": np.arange(12.0), "step": 0.01 * np.array([1, -1, -1, 1] * 3)})
    drives = kept.join(steps, how="cross").with_columns(speed_m_s=pl.col("speed_m_s") + pl.col("step"))
    speeds = {"speed_m_s": 0.06, "start_speed_m_s": 0.06, "drop": 0.0, "lag_one": -1 / 11}
    spreads = {"between_m_s": 0.02 / 2**0.5, "within_m_s": 0.01 * 1.2**0.5, "share_between": 2 / 3.2}
    veers = {"veer_rad_s": 0.2, "veer_between_rad_s": 0.2 / 2**0.5, "veer_within_rad_s": 0.0}
    assert drive_of(drives) == pytest.approx(speeds | spreads | veers)
    time_s = 100.0 * np.arange(12)
    falling = {"time_s": time_s, "speed_m_s": 0.06 * (1.0 - time_s / 6000.0), "veer_rad_s": [None] * 12}
    line = line_of(pl.DataFrame(falling))
    assert (line.start_speed_m_s, line.lost_per_s, line.drop) == pytest.approx((0.06, 1 / 6000, 0.2))


def test_a_course_by_hand() -> None:
    """Turns of 0.3 rad between chords of 10 cm, whose lengths have a triangular law of +- 1 cm."""
    u = (np.arange(2000) + 0.5) / 2000
    law = np.where(u < 0.5, np.sqrt(2 * u) - 1, 1 - np.sqrt(2 * (1 - u)))
    number, chords_m = np.arange(2000), 0.1 + 0.01 * np.random.default_rng(1).permutation(law)
    course = course_of(
        pl.DataFrame({"index": number, "time_s": number, "turn_rad": 0.3, "distance_m": chords_m})
    )
    assert course is not None
    assert course.bend_per_m == pytest.approx(2 * np.sin(0.15) / 0.1, rel=1e-3)
    assert course.distance_spread == pytest.approx(0.1 / 6**0.5, rel=0.01)


def test_quartiles_of_normal_values_tell_their_standard_deviation() -> None:
    assert quartile_spread(3.0 * ndtri((np.arange(1000) + 0.5) / 1000)) == pytest.approx(3.0, rel=0.01)


def test_rays_of_one_side_are_found_from_where_robots_turn_at_a_wall() -> None:
    """Wall at x = 0: a robot turns half a period, on average, after an end of a ray has reached it; 3 of 10 later."""
    rays = {"rays.angle_deg": [0.0, 40.0], "rays.side_m": [0.0, 0.01]}
    base = preset("paper-empirical").with_values(rays)
    robot, forward_m = np.arange(400) % 2, np.array([0.02, 0.03])
    heading = np.random.default_rng(6).uniform(-1.2, 1.2, robot.size)
    reach_m = base.walk.avoidance_threshold_mm / 1000.0
    ends_m = [
        forward_m[robot] * np.cos(heading) - side_m * np.sin(heading) + reach_m * np.cos(heading + angle)
        for side_m, angle in zip(base.rays.side_m, np.radians(base.rays.angle_deg), strict=True)
    ]
    distance_m = np.max(ends_m, axis=0) - 0.5 * 0.06 * base.tick_s * np.cos(heading)
    distance_m[np.arange(robot.size) % 10 < 3] -= 0.02
    approaches = {"robot": robot, "distance_m": distance_m, "incidence_rad": heading, "nearest_robot_m": 1.0}
    found: Any = SimpleNamespace(
        approaches=pl.DataFrame(approaches),
        samples=pl.DataFrame({"robot": [0, 1]}),
        drives=pl.DataFrame({"speed_m_s": [0.06]}),
        turns=pl.DataFrame({"turned_rad": []}),
    )
    fit = fit_rays(found, base, draws=0)
    assert fit.values["ray_deg"] == pytest.approx(40.0, abs=0.11)
    assert fit.forward_m == pytest.approx(forward_m, abs=2e-4)


@pytest.mark.parametrize(
    ("x_m", "y_m", "course"),
    [(0.1, 0.5, np.pi), (0.9, 0.5, 0.0), (0.5, 0.1, -np.pi / 2), (0.5, 0.9, np.pi / 2)],
)
def test_the_wall_ahead_and_the_incidence_on_it(x_m: float, y_m: float, course: float) -> None:
    """Anticlockwise of straight at it; also beside a nearer wall that lies behind."""
    assert _to_wall(x_m, y_m, course + 0.2, (1.0, 1.0)) == pytest.approx((0.1, 0.2))
    assert _to_wall(x_m, y_m, course + 1.8, (1.0, 1.0)) == pytest.approx((0.1, 1.8))
    for turned in (1.95, np.pi):
        assert _to_wall(x_m, y_m, course + turned, (1.0, 1.0))[0] > 0.4


def test_fitted_energies_are_rounded_by_their_unit() -> None:
    values = {"still_scale": 0.00012345678, "still_shape": 2.345678}
    assert SensorFit(values, {}, unit=1e-3).rounded(values) == {
        "still_scale": 0.00012346,
        "still_shape": 2.34568,
    }


def test_wheels_turn_at_half_the_track_from_the_middle() -> None:
    values = {
        "turn_deg_s": 180.0,
        "gain": 4.0,
        "blind_ms": 100.0,
        "leg_max_s": 60.0,
        "radius_m": 0.016,
        "seen_m": 0.01,
    }
    fields = fields_of(values, preset("paper-empirical"), speed_m_s=0.055)
    assert fields["robot.turn_track_m"] * np.pi / 2 == pytest.approx(0.055, rel=1e-3)


def test_laws_of_few_robots_by_hand() -> None:
    """The mean follows Student's t (2 degrees of freedom), the variance an inverse chi-square (4)."""
    means = drawn_means(np.array([1.0, 2.0, 3.0]), np.array([0.025, 0.975]))
    assert means == pytest.approx(2.0 + np.array([-1.0, 1.0]) * 4.302653 / 3**0.5)
    assert drawn_variances(3.0, 4, np.array([0.5])) == pytest.approx(12.0 / 3.356694)


def test_a_log_tells_the_same_as_the_paths(tmp_path: Path) -> None:
    result = made(1, floor__tiles=("01", "10"), robot__speed_redraw="robot")
    write_log(result, tmp_path / "log.csv")
    logged = recording_of([read_log(tmp_path / "log.csv")], result.floor(), preset("paper"))
    ours = {one.name: one.interval.estimate for one in figures_of(result) if one.interval is not None}
    theirs = {one.name: one.interval.estimate for one in figures_of(logged, 1.33) if one.interval is not None}
    for name in ("speed_m_s", "drop", "between_m_s", "avoid_s", "false_positive", "lag_one_bits"):
        assert theirs[name] == pytest.approx(ours[name], rel=0.05, abs=0.01 if name == "drop" else 1e-3), name
    assert theirs["veer_between_rad_s"] == pytest.approx(ours["veer_between_rad_s"], rel=0.1)
    # Places in the log are where the camera saw the robot last: up to a loop before it stopped.
    assert theirs["distance_m"] == pytest.approx(ours["distance_m"], rel=0.02)


def test_figures_of_four_samples_by_hand() -> None:
    """At 1 cm and at 6 cm from the left wall, in the middle, and in a corner tile, on 5 x 5 tiles."""
    samples = pl.DataFrame({
        "robot": [0, 0, 1, 1], "x_m": [0.01, 0.06, 0.5, 0.1], "y_m": [0.5, 0.5, 0.5, 0.1],
        "wall_m": [0.01, 0.06, 0.5, 0.1],
        "avoid_s": [0.0, 1.0, 2.0, 3.0], "spacing_s": [4.0, 5.0, 6.0, 7.0], "distance_m": [0.1, 0.1, 0.1, 0.3],
        "energy": [1.0, 2.0, 2.0, 1.0], "vibrating": [False, False, False, True],
    })  # fmt: skip
    found = _of_samples(made(1, run__t_end_s=10.0), samples, 1.33)
    rings = {"near_walls": 0.25 / (1 - 0.95**2), "off_walls": 0.25 / (0.9**2 - 0.85**2)}
    tiles = {"density_corners": 0.25 * 25 / 4, "density_inside": 0.25 * 25 / 9}
    avoided = {"avoid_s": 1.5, "avoid_none": 0.25, "avoid_most_s": 2.95}
    readings = {"false_positive": 2 / 3, "false_negative": 1.0, "lag_one_bits": -1.0}
    assert found == pytest.approx({"spacing_s": 5.5, "distance_m": 0.15} | rings | tiles | avoided | readings)


def test_in_a_narrow_arena_no_place_is_far_from_the_walls() -> None:
    narrow = {"arena__height_m": 0.1, "swarm__robots": 1, "swarm__start_margin_m": 0.02, "run__t_end_s": 60.0}
    found = {one.name: one for one in figures_of(made(1, **narrow))}
    assert found["off_walls"].interval is None
    assert found["near_walls"].interval is not None


def test_figures_are_printed_in_the_units_that_their_names_state() -> None:
    """All figures are 0.25 in SI units."""
    printed = {"mm/s": "250", "ms": "250", "mm": "250", "deg/s": "14.3", "%": "25"}
    figures = [Figure(name, (0.25,), mean_interval([0.25, 0.25])) for name in FIGURES]
    table = figures_document({"lab": figures}, 1.33).parts[0].frame
    for words, value in table.rows():
        expected = float(printed.get(words.rpartition(", ")[2], "0.25"))
        assert float(value.split()[0]) == pytest.approx(expected, rel=0.01), words
