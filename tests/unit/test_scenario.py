"""Scenarios: TOML there and back, the hash, presets, settings, and what is refused and how."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from helpers.scenario_fields import changed
from vibroswarm import tasks
from vibroswarm.errors import InputError
from vibroswarm.scenario.presets import describe, preset_names
from vibroswarm.scenario.scenario import (
    Scenario,
    field_types,
    preset,
    value_of,
)
from vibroswarm.study.options import warnings_of

PAPER_HASH = "b228ca891f32417f"
"""Of the preset ``paper``. It changes only when what the paper's simulations did is understood otherwise, or
with the schema; results that were written before then no longer match their scenario."""


@pytest.fixture(scope="module", autouse=True)
def another_task() -> Iterator[None]:
    """There is one task of ours; a second shows that the field matters."""
    tasks.register(tasks.Task("another_task", truth=lambda floor, asked, p: 1))
    yield
    tasks.base.forget("another_task")


def refused(values: dict[str, Any]) -> InputError:
    """The error of a scenario from these dotted values."""
    with pytest.raises(InputError) as caught:
        Scenario().with_values(values)
    return caught.value


# Fields


# TOML there and back


def finite(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False, allow_infinity=False)


odd_values = st.fixed_dictionaries(
    {},
    optional={
        "arena.width_m": finite(0.8, 1e4),
        "arena.height_m": finite(0.8, 3.0),
        "floor.tiles": st.sampled_from([("1",), ("01", "10"), ("0000000", "1111111")]),
        "floor.source": st.sampled_from(["random:0.4", "diagonal:0.46", "alternating:paper-0.46"]),
        "floor.redraw": st.sampled_from(["run", "study"]),
        "floor.left_m": finite(-0.1, 0.4),
        "swarm.robots": st.integers(1, 50),
        "robot.misalignment_min": finite(-0.99, 0.1),
        "robot.speed_factor_location": finite(-100, 100),
        "robot.speed_redraw": st.sampled_from(["sample", "robot"]),
        "rays.side_m": st.tuples(finite(-1, 1), finite(-1, 1), finite(-1, 1)),
        "rays.angle_deg": st.tuples(finite(-360, 360), finite(-360, 360), finite(-360, 360)),
        "walk.walk_duration_location_ms": finite(0, 1e9),
        "walk.turn_max_deg": finite(1e-300, 180),
        "sample.interrupts_avoidance": st.booleans(),
        "sensor.rms_threshold": finite(0, 1e9),
        "sensor.still_energies": st.lists(finite(0, 100), min_size=1, max_size=20).map(tuple),
        "strategy.name": st.sampled_from(["none", "positive", "soft"]),
        "strategy.soft.eta": st.one_of(finite(0, 1e12), st.integers(0, 10**12)),
        "decision.min_observations": st.integers(0, 10**9),
        "decision.revise": st.booleans(),
        "network.name": st.sampled_from(["ideal", "loss"]),
        "network.loss.share": finite(0, 1),
        "run.t_end_s": finite(1e-3, 8000),
    },
)


@settings(deadline=None, max_examples=80, derandomize=True)
@given(odd_values)
def test_toml_there_and_back_loses_nothing(values: dict[str, Any]) -> None:
    scenario = Scenario().with_values(values)
    again = Scenario.from_toml(scenario.to_toml())
    assert again == scenario
    assert again.hash == scenario.hash
    assert again.to_toml() == scenario.to_toml()
    for name, value in values.items():
        assert value_of(again, name) == value


def test_each_field_goes_through_toml() -> None:
    for name in field_types():
        scenario = changed(name)
        assert scenario != Scenario(), name
        assert Scenario.from_toml(scenario.to_toml()) == scenario, name


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(st.text(min_size=1, max_size=30))
@example("\x00\x7f\r\n\t\"'\\\u2028")
def test_names_of_floors_go_through_toml(name: str) -> None:
    scenario = Scenario().with_values({"floor.source": name, "floor.tiles": ["10", "01"]})
    assert Scenario.from_toml(scenario.to_toml()) == scenario


def test_a_preset_may_be_the_base() -> None:
    scenario = Scenario.from_toml('preset = "text"\n[run]\nt_end_s = 60.0\n')
    assert scenario == preset("text").with_values({"run.t_end_s": 60.0})
    with pytest.raises(InputError, match="did you mean 'text'"):
        Scenario.from_toml('preset = "txet"')
    with pytest.raises(InputError, match="preset"):
        Scenario.from_toml("preset = 3")


# The hash


def test_hash_of_the_paper() -> None:
    assert preset("paper").hash == PAPER_HASH


def test_hash_changes_with_each_field_and_with_nothing_else() -> None:
    hashes = {name: changed(name).hash for name in field_types()}
    hashes[""] = Scenario().hash
    assert len(set(hashes.values())) == len(hashes)
    assert all(len(h) == 16 and set(h) <= set("0123456789abcdef") for h in hashes.values())


def test_equal_scenarios_have_one_hash() -> None:
    """However their numbers were written."""
    one = Scenario.from_toml("[strategy.soft]\neta = 1500\n[rays]\nside_m = [0, 0.0075, -75e-4]")
    assert one == Scenario()
    assert one.hash == Scenario().hash
    minus = Scenario().with_values({"floor.left_m": -0.0})
    assert minus == Scenario()
    assert minus.hash == Scenario().hash


# Presets


def test_the_paper_is_the_default() -> None:
    assert preset("paper") == Scenario()


def test_the_preset_file_of_the_paper_names_every_field() -> None:
    import vibroswarm.scenario.presets

    text = (Path(vibroswarm.scenario.presets.__file__).parent / "paper.toml").read_text(encoding="utf-8")
    values = tomllib.loads(text)
    named = {f"{section}.{field}" for section, fields in values.items() for field in fields} - {
        "strategy.soft"
    }
    named |= {f"strategy.soft.{field}" for field in values["strategy"]["soft"]}
    optional = {
        "walk.walk_duration_law",
        "floor.tiles", "floor.values", "floor.image_threshold", "floor.tile_width_m", "floor.tile_height_m",
        "sensor.vibrating_energies", "sensor.claimed_rates",
        "sensor.still_energies", "sensor.edge_reach_m", "sensor.edge_blur_m", "sensor.tile_spread",
        "sensor.robot_spread", "robot.speed_wander", "robot.speed_factors", "robot.misalignments",
        "robot.misalignment_wander", "robot.misalignment_drift", "robot.misalignment_drift_samples",
        "robot.misalignment_run_spread", "robot.speed_run_spread",
        "rays.forward_each_m", "walk.blind_after_turn_ms", "sample.signal_ms",
        "camera.magnification", "camera.shift_x_m", "camera.shift_y_m",
        "decision.assumed_false_positive", "decision.assumed_false_negative",
        "odometry.gyro_scale_spread", "odometry.gyro_bias_spread_deg_s", "odometry.turn_noise_deg",
        "odometry.gyro_walk_deg_sqrt_s", "odometry.rezero_noise_deg_s",
        "localisation.assumed_level", "localisation.assumed_speed_factor", "localisation.assumed_speed_spread",
        "task.costs", "change.at_s", "change.to", "change.rate_per_h", "change.shares", "law.sessions", "law.draws",
    }  # fmt: skip
    optional |= {name for name in field_types() if name.startswith("faults.")}
    of_others = {
        name
        for name in field_types()
        if name.startswith(("strategy.", "network.", "sensor.", "task.")) and name.count(".") == 2
    }
    assert named == set(field_types()) - optional - (of_others - {"strategy.soft.eta", "strategy.soft.kappa"})


def test_presets() -> None:
    assert {"paper", "paper-empirical", "text"} <= set(preset_names())
    for name in preset_names():
        assert isinstance(preset(name), Scenario)
        assert describe(name)
        assert not describe(name).startswith("#")
    empirical = preset("paper-empirical")
    assert (empirical.walk.walk_duration_location_ms, empirical.walk.walk_duration_scale_ms) == (
        7500.0,
        15_000.0,
    )
    assert (empirical.sample.sample_interval_ms, empirical.walk.avoidance_threshold_mm) == (2000.0, 50.0)
    with pytest.raises(InputError, match="did you mean 'paper'"):
        preset("papper")


# --set


# What is refused


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("walk.leg_mim_ms", "walk.leg_min_ms"),
        ("walk.avoidance_threshold", "walk.avoidance_threshold_mm"),
        ("strategy.etta", "strategy.soft.eta"),
        ("run.loss", "network.loss.share"),
        ("loss", "network.loss.share"),
        ("swarm.robot", "swarm.robots"),
    ],
)
def test_an_unknown_key_suggests_the_nearest(wrong: str, right: str) -> None:
    error = refused({wrong: 1})
    assert error.field == wrong
    assert f"did you mean '{right}'" in str(error)
    section, _, field = wrong.rpartition(".")
    if section and section in Scenario.model_fields:
        with pytest.raises(InputError, match="did you mean") as caught:
            Scenario.from_toml(f"[{section}]\n{field} = 1\n")
        assert caught.value.field == wrong
        assert right in str(caught.value)


# Junk: whatever it is, it is an InputError or a scenario.

TOML_LINES = Scenario().to_toml().splitlines()
junk_lines = st.one_of(
    st.sampled_from(TOML_LINES),
    st.sampled_from(
        ['preset = "text"', "preset = []", "[walk]", "[[walk]]", "[walk.leg_min_ms]", "walk = 3"]
    ),
    st.tuples(
        st.sampled_from([line.partition(" = ")[0] for line in TOML_LINES if " = " in line]),
        st.sampled_from(
            ["nan", "inf", "-inf", "1e400", "-1", "0", "1e-310", "''", "[]", "{}", "true", "1979-05-27"]
        ),
    ).map(" = ".join),
    st.text(max_size=30),
)


@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(junk_lines, max_size=12).map("\n".join))
@example("[robot]\nbody_radius_m = 1e-310\n")
def test_any_text_is_a_scenario_or_an_input_error(text: str) -> None:
    try:
        scenario = Scenario.from_toml(text)
    except InputError:
        return
    assert Scenario.from_toml(scenario.to_toml()) == scenario


leaves = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=10), st.binary(max_size=5),
    st.sampled_from([5e-324, 1e-310, 1e-12, 1e4, 1e9, 2**31, -0.0, "random:0.48", ("1", "0")]),
)  # fmt: skip
nested = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
)
nested.validate()  # now: it reads the lambda's source from this file, which may be edited before the first draw
OF_SECTIONS = {
    section: st.one_of(
        st.dictionaries(st.sampled_from(sorted(fields)), nested, max_size=3),
        st.dictionaries(st.sampled_from(sorted(fields)), leaves, max_size=3),
        nested,
    )
    for section, fields in Scenario().model_dump().items()
}


@st.composite
def sections(draw: st.DrawFn) -> dict[str, Any]:
    """Values of up to three sections: of more, the first wrong one would hide the others."""
    names = draw(st.lists(st.sampled_from(sorted(OF_SECTIONS)), min_size=1, max_size=3, unique=True))
    return {name: draw(OF_SECTIONS[name]) for name in names}


@pytest.mark.slow
@settings(deadline=None, max_examples=400, suppress_health_check=[HealthCheck.too_slow])
@given(st.one_of(sections(), st.dictionaries(st.text(max_size=8), nested, max_size=4)))
def test_any_values_are_a_scenario_or_an_input_error(values: dict[str, Any]) -> None:
    try:
        scenario = Scenario.from_values(values)
    except InputError:
        return
    assert Scenario.from_toml(scenario.to_toml()) == scenario


def test_final_decisions_on_a_changing_floor_are_warned_of():
    changing = preset("paper").with_values({"change.at_s": 600, "change.to": "invert"})
    assert any("decisions are final" in one for one in warnings_of(changing))
    assert not warnings_of(preset("paper"))
