"""Thinned poses stay near the exact arcs; what is packed comes out again."""

from __future__ import annotations

import tracemalloc
from base64 import b64decode, b64encode
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibroswarm import preset, simulate
from vibroswarm.run_page.payload import (
    HEADING_QUANTUM_RAD,
    POSITION_QUANTUM_M,
    TIME_QUANTUM_S,
    RunRecord,
    packed_track,
    varints,
)
from vibroswarm.run_page.trajectory_thinning import KINDS, MOST_PIECES, _points, along, tracks

MOST_OFF_M, MOST_OFF_RAD = 0.001, np.radians(3)

segment = st.tuples(
    st.sampled_from([0.02, 0.04, 0.3, 1.0, 3.778, 30.0]) | st.floats(0.02, 5.0),
    st.sampled_from([0.0, 0.055]) | st.floats(0.0, 0.1),
    st.sampled_from([0.0, 2.4, -2.4]) | st.floats(-3.0, 3.0),
    st.sampled_from(KINDS),
)


def unpacked(data: str) -> np.ndarray[Any, Any]:
    values, value, shift = [], 0, 0
    for byte in b64decode(data):
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            values.append(value >> 1 if value % 2 == 0 else -(value >> 1) - 1)
            value, shift = 0, 0
    return np.array(values)


def on_arc(row: dict[str, float], gone: float) -> tuple[float, float, float]:
    half = row["turn_rate_rad_s"] * gone / 2
    chord = row["speed_m_s"] * gone * np.sinc(half / np.pi)
    angle = row["heading_rad"] + half
    return (
        row["x_m"] + chord * np.cos(angle),
        row["y_m"] + chord * np.sin(angle),
        row["heading_rad"] + 2 * half,
    )


def chained(parts: list[tuple[float, float, float, str]], robot: int = 0) -> tuple[pl.DataFrame, float]:
    """Segments that follow on from one another, headings wrapped; and when the last one ends."""
    rows: list[dict[str, Any]] = []
    time, pose = 0.0, (0.5, 0.5, 1.0)
    for lasting, speed, rate, kind in parts:
        x, y, heading = pose
        heading = float(np.angle(np.exp(1j * heading)))
        row = {"robot": robot, "start_s": time, "x_m": x, "y_m": y, "heading_rad": heading}
        rows.append({**row, "speed_m_s": speed, "turn_rate_rad_s": rate, "kind": kind})
        pose, time = on_arc(rows[-1], lasting), time + lasting
    return pl.DataFrame(rows), time


def shown(packed: dict[str, Any], times: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """What the page draws at these times."""
    rows = unpacked(packed["bytes"]).reshape(packed["knots"], 5)
    quanta = [TIME_QUANTUM_S, POSITION_QUANTUM_M, POSITION_QUANTUM_M, HEADING_QUANTUM_RAD]
    knots = np.cumsum(rows[:, :4], axis=0) * quanta
    at = np.clip(np.searchsorted(knots[:, 0], times, side="right") - 1, 0, len(knots) - 2)
    return along(knots[at], knots[at + 1], np.clip(times, knots[at, 0], knots[at + 1, 0]))


def check(
    segments: pl.DataFrame, t_end_s: float, packed: dict[str, Any], times: np.ndarray[Any, Any]
) -> None:
    rows = segments.to_dicts()
    starts = np.array([row["start_s"] for row in rows])
    drawn = shown(packed, times)
    at = np.searchsorted(starts, times, side="right") - 1
    exact = np.array([on_arc(rows[i], t - rows[i]["start_s"]) for i, t in zip(at, times, strict=True)])
    assert np.hypot(drawn[:, 1] - exact[:, 0], drawn[:, 2] - exact[:, 1]).max() < MOST_OFF_M
    assert np.abs(np.angle(np.exp(1j * (drawn[:, 3] - exact[:, 2])))).max() < MOST_OFF_RAD


@settings(deadline=None, max_examples=120)
@given(st.lists(segment, min_size=1, max_size=30))
def test_poses_are_near_the_arcs(parts: list[tuple[float, float, float, str]]) -> None:
    segments, end = chained(parts)
    robots, _ = tracks(segments, end)
    times = np.concatenate([np.linspace(0, end, 400), segments["start_s"].to_numpy()])
    check(segments, end, packed_track(robots[0]), np.clip(times, 0, end))


@pytest.mark.parametrize("rate", [1.34375, np.pi / 3, 6.0])
def test_circles_stay_round_when_their_knots_are_rounded(rate: float) -> None:
    segments, end = chained([(0.02, 0.0, 0.0, "drive")] * 3 + [(30.0, 0.055, rate, "drive")])
    robots, _ = tracks(segments, end)
    assert np.abs(np.diff(robots[0].knots[:, 3])).max() <= 0.9 * np.pi
    check(segments, end, packed_track(robots[0]), np.linspace(0, end, 3000))


def test_every_robot_of_a_run_is_near_its_arcs(record: RunRecord) -> None:
    robots, names = tracks(record.segments, record.t_end_s)
    assert [track.robot for track in robots] == record.robots["robot"].to_list()
    assert names[: len(KINDS)] == list(KINDS)
    for track in robots:
        own = record.segments.filter(robot=track.robot).sort("start_s")
        check(own, record.t_end_s, packed_track(track), np.linspace(0, record.t_end_s, 5000))
        assert len(track.kind) < 4 * record.t_end_s


def test_turn_tails_are_thinned_and_kinds_kept(long_record: RunRecord) -> None:
    robots, _ = tracks(long_record.segments, long_record.t_end_s)
    assert sum(len(track.kind) for track in robots) < len(long_record.segments) / 3
    stops = long_record.segments.filter((pl.col("robot") == 0) & (pl.col("kind") == "stop"))
    begins = robots[0].knots[np.diff(robots[0].kind == KINDS.index("stop"), prepend=False), 0]
    assert np.isin(stops["start_s"].to_numpy(), begins).all()


@pytest.mark.parametrize(("to_m", "turned_rad"), [(0.9, 2.0), (0.101, 0.0)])
def test_a_jump_stays_a_jump(to_m: float, turned_rad: float) -> None:
    rows = {"robot": [0, 0], "start_s": [0.0, 1.0], "x_m": [0.1, to_m], "y_m": [0.1, to_m]}
    rest = {
        "heading_rad": [0.0, turned_rad],
        "speed_m_s": [0.0, 0.0],
        "turn_rate_rad_s": [0.0, 0.0],
        "kind": ["drive"] * 2,
    }
    robots, _ = tracks(pl.DataFrame({**rows, **rest}), 2.0)
    drawn = shown(packed_track(robots[0]), np.array([0.99, 1.0]))
    np.testing.assert_allclose(drawn[:, 1], [0.1, to_m], atol=1e-9)


def test_a_log_in_millimetres_does_not_fill_the_memory() -> None:
    """Of segments of kilometres there were millions of points, 2.6 GB for 181 samples."""
    segments, end = chained([(100.0, 1000.0, 0.0, "drive")])
    assert len(_points(segments, end, list(KINDS))[0]) <= MOST_PIECES + 1


def peak_bytes(work: Callable[[], Any]) -> int:
    tracemalloc.start()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def test_more_robots_hardly_take_more_memory_to_thin(record: RunRecord) -> None:
    """All robots' points at once took most of the memory of a long run: 1.4 GB for 10^5 s."""
    one = record.segments.filter(robot=0)
    eight = pl.concat([one.with_columns(robot=pl.lit(robot, pl.UInt16)) for robot in range(8)])
    peaks = [peak_bytes(partial(tracks, table, record.t_end_s)) for table in (one, eight)]
    assert peaks[1] < 2 * peaks[0]


def test_segments_of_many_runs_are_not_held_several_times() -> None:
    scenario = preset("paper").with_values({"run.t_end_s": 300.0})
    segments = simulate(scenario, runs=10, segments=True).segments
    assert segments is not None
    peak = peak_bytes(lambda: simulate(scenario, runs=10, segments=True))
    assert peak < 2.5 * segments.estimated_size()


def test_no_segments_give_no_tracks(record: RunRecord) -> None:
    assert tracks(record.segments.clear(), 10.0)[0] == []


def test_a_kind_that_is_not_known_is_named(record: RunRecord) -> None:
    odd = record.segments.with_columns(kind=pl.lit("carried"))
    robots, names = tracks(odd, record.t_end_s)
    assert names[robots[0].kind[0]] == "carried"


@given(st.lists(st.integers(-(2**40), 2**40), min_size=1))
def test_integers_come_out_as_they_went_in(values: list[int]) -> None:
    data = b64encode(varints(np.array(values, dtype=np.int64))).decode()
    assert unpacked(data).tolist() == values
