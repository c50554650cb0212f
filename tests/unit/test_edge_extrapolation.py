"""Edges that were fitted on tiles of 20 cm are said to be an extrapolation on smaller ones, and only there."""

from __future__ import annotations

import pytest

from helpers.commands import remarks_of
from vibroswarm.observation.edge_response import FITTED_ON_M, edge_warnings, shorter_side_m
from vibroswarm.paper.columns import real_floor
from vibroswarm.scenario.scenario import preset

SMALL = {"floor.rows": 10, "floor.columns": 10}


def test_it_is_said_on_smaller_tiles_only() -> None:
    calibrated = preset("calibrated")
    (words,) = edge_warnings(calibrated.with_values(SMALL))
    assert "10 mm beyond edges" in words
    assert "of 100 mm that is an extrapolation" in words
    assert edge_warnings(calibrated) == []
    assert edge_warnings(preset("paper").with_values(SMALL)) == []
    assert edge_warnings(calibrated.with_values(SMALL | {"sensor.edge_reach_m": 0.02})) == [], (
        "the user's own"
    )
    assert edge_warnings(calibrated.with_values({"floor.tile_height_m": 0.1})) != []


def test_the_tiles_of_the_recordings_are_those_that_it_is_held_against() -> None:
    scenario = preset("calibrated").with_values(real_floor())
    side_m = shorter_side_m(scenario.floor, scenario.arena.width_m, scenario.arena.height_m)
    assert side_m == pytest.approx(FITTED_ON_M)


def test_a_command_says_it(capsys: pytest.CaptureFixture[str]) -> None:
    options = ["run", "--preset", "calibrated", "--tiles", "10x10", "--set", "run.t_end_s=5", "--seed", "3"]
    assert "an extrapolation" in remarks_of(capsys, *options)
