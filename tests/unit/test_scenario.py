"""Scenarios: TOML there and back, the hash, presets, settings, and what is refused and how."""

from __future__ import annotations

import itertools
import json
import math
import pickle
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, get_args

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, example, given, settings
from hypothesis import strategies as st
from pydantic import Field

from helpers.scenario_fields import FLAGS, FLOATS, INTS, OTHERS, WORDS, annotation, changed, named
from vibroswarm import tasks
from vibroswarm.errors import InputError
from vibroswarm.floors.source import shadows
from vibroswarm.optimize.spec import Search
from vibroswarm.result import Result
from vibroswarm.scenario.fault_fields import FAULTS, SINCE
from vibroswarm.scenario.presets import describe, preset_names
from vibroswarm.scenario.scenario import (
    Scenario,
    field_names,
    fields,
    parse_setting,
    parse_settings,
    preset,
    value_of,
)
from vibroswarm.simulation import simulate
from vibroswarm.strategies.base import as_params
from vibroswarm.study.spec import Study

OF_MAPS = ("variance_factor", "min_samples", "falls_from", "trust_limit", "broken_prior", "prior_median")
"""Fields without a unit of strategies that keep a map; of these, the first may not be 0."""
PAPER_HASH = "b228ca891f32417f"
"""Of the preset ``paper``. It changes only when what the paper's simulations did is understood otherwise, or
with the schema; results that were written before then no longer match their scenario."""


@pytest.fixture(scope="module", autouse=True)
def another_task() -> Iterator[None]:
    """There is one task of ours; a second shows that the field matters."""
    tasks.register(tasks.Task("another_task", truth=lambda floor, asked, p: 1))
    yield
    tasks.base.forget("another_task")


def in_tables(name: str, value: Any) -> dict[str, Any]:
    """One field as TOML gives it."""
    section, _, field = name.partition(".")
    return {section: in_tables(field, value)} if field else {section: value}


def refused(values: dict[str, Any]) -> InputError:
    """The error of a scenario from these dotted values."""
    with pytest.raises(InputError) as caught:
        Scenario().with_values(values)
    return caught.value


# Fields


def test_every_field_is_of_a_known_kind() -> None:
    known = set(FLOATS + INTS + FLAGS + WORDS) | set(OTHERS)
    assert known == set(field_names())
    assert len(field_names()) == len(set(field_names()))


def test_units_stand_in_the_names() -> None:
    units = ("_m", "_mm", "_ms", "_s", "_deg", "_m_s", "_percent_per_deg", "_percent_per_deg_s", "_per_h")
    plain = {
        "swarm.robots", "floor.rows", "floor.columns", "robot.misalignment_min", "robot.misalignment_max",
        "robot.speed_factor_shape", "robot.speed_factor_scale", "robot.speed_factor_location",
        "robot.speed_factor_min", "robot.speed_factor_max", "strategy.soft.eta", "strategy.soft.kappa",
        "strategy.dirichlet_soft.eta", "strategy.dirichlet_soft.kappa",
        "decision.decision_boundary", "decision.credible_threshold", "decision.min_observations",
        "decision.prior_alpha", "decision.prior_beta", "network.loss.share", "strategy.totals.threshold",
        "strategy.bayes_bots.prior", "strategy.dc.patience", "strategy.dmvd.patience", "strategy.dmmd.patience",
        "strategy.dc.max_opinions", "strategy.dmvd.max_opinions", "strategy.dmmd.max_opinions",
        "strategy.three_valued.patience", "strategy.dbbs.hypotheses", "strategy.dbbs.decay_own",
        "strategy.dbbs.decay_other", "strategy.dbbs.memory", "strategy.asdf.accuracy",
        "strategy.asdf.flawed_robots", "strategy.asdf.flawed_accuracy", "strategy.asdf.period",
        "strategy.asdf.type_2_error", "strategy.bayes_cpf.accuracy", "strategy.bayes_cpf.variance",
        "strategy.bayes_cpf.drift", "strategy.bayes_cpf.drift_variance", "strategy.bayes_cpf.window",
        "strategy.distrust.threshold", "strategy.forget.memory", "strategy.reset.threshold", "strategy.reset.least",
        "task.changed.more_than", "strategy.averaging.least", "strategy.averaging.weight", "task.share.kind",
        "strategy.explore.sure_within",
        "faults.stuck_class", "faults.misread_shift",
        *(f"faults.{kind}" for kind in FAULTS), "faults.false_positive_shift", "faults.false_negative_shift",
        *(f"strategy.{name}.{field}" for name in ("places", "explore", "fading") for field in OF_MAPS),
        "strategy.field.variance_factor", "strategy.field.min_samples",
        "strategy.places.draws", "strategy.places.map_every",
        "localisation.components", "localisation.lag",
        "network.bursts.bad_share", "network.bursts.lost_in_bad", "network.bursts.lost_in_good",
        "network.tree.message_bytes", "network.tree.log_bytes",
    }  # fmt: skip
    without = {name for name in FLOATS + INTS if not name.endswith(units)}
    assert {name for name in without if not name.startswith("sensor.")} == plain


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
    if "floor.tiles" in values and "floor.source" in values:
        values = values | {"floor.source": f"our {values['floor.source']}"}  # no name of a pattern
    scenario = Scenario().with_values(values)
    again = Scenario.from_toml(scenario.to_toml())
    assert again == scenario
    assert again.hash == scenario.hash
    assert again.to_toml() == scenario.to_toml()
    for name, value in values.items():
        assert value_of(again, name) == value


def test_parameters_of_a_strategy_that_there_is_not_are_no_fields() -> None:
    for name in ("strategy.nonsense.eta", "network.nonsense.range_m", "strategy.soft.nonsense"):
        with pytest.raises(InputError, match="there is no such field") as error:
            value_of(Scenario(), name)
        assert error.value.field == name


def test_each_field_goes_through_toml() -> None:
    for name in field_names():
        scenario = changed(name)
        assert scenario != Scenario(), name
        assert Scenario.from_toml(scenario.to_toml()) == scenario, name


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(st.text(min_size=1, max_size=30))
@example("\x00\x7f\r\n\t\"'\\\u2028")
def test_names_of_floors_go_through_toml(name: str) -> None:
    assume(not shadows(name, np.array([[1, 0], [0, 1]], dtype=np.uint8)))  # such names are refused
    scenario = Scenario().with_values({"floor.source": name, "floor.tiles": ["10", "01"]})
    assert Scenario.from_toml(scenario.to_toml()) == scenario


def test_a_file_needs_to_say_only_what_differs(tmp_path: Path) -> None:
    path = tmp_path / "my scenario.toml"
    path.write_text("[walk]\nleg_min_ms = 500\n", encoding="utf-8")
    assert Scenario.read(path) == Scenario().with_values({"walk.leg_min_ms": 500.0})
    path.write_text("\ufeff[walk]\nleg_min_ms = 500\n", encoding="utf-8")  # as some editors save it
    assert Scenario.read(path) == Scenario().with_values({"walk.leg_min_ms": 500.0})


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
    hashes = {name: changed(name).hash for name in field_names()}
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


def test_scenarios_are_frozen_and_can_be_keys() -> None:
    assert len({Scenario(), preset("paper"), preset("text")}) == 2
    with pytest.raises(ValueError, match="frozen"):
        Scenario().walk.leg_min_ms = 3.0
    assert Scenario().with_values({"walk.leg_min_ms": 3.0}) != Scenario()
    assert Scenario().walk.leg_min_ms == 1000.0


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
    optional |= {name for name in field_names() if name.startswith("faults.")}
    of_others = {
        name
        for name in field_names()
        if name.startswith(("strategy.", "network.", "sensor.", "task.")) and name.count(".") == 2
    }
    assert named == set(field_names()) - optional - (of_others - {"strategy.soft.eta", "strategy.soft.kappa"})


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


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("walk.leg_min_ms=500", ("walk.leg_min_ms", 500)),
        (" walk.leg_min_ms = 500.5 ", ("walk.leg_min_ms", 500.5)),
        ("sample.timer=always", ("sample.timer", "always")),
        ('sample.timer="always"', ("sample.timer", "always")),
        ("decision.revise=true", ("decision.revise", True)),
        ("rays.angle_deg=[0, 30, -30]", ("rays.angle_deg", [0, 30, -30])),
        ("floor.source=diagonal:0.46", ("floor.source", "diagonal:0.46")),
        ("floor.source=a=b", ("floor.source", "a=b")),
        ("floor.source=", ("floor.source", "")),
        ("decision.min_observations=1_000", ("decision.min_observations", 1000)),
        ("decision.credible_threshold=.8", ("decision.credible_threshold", 0.8)),
        ("network.loss.share=-5.e2", ("network.loss.share", -500.0)),
        ("floor.source=.", ("floor.source", ".")),
    ],
)
def test_settings_are_read_as_toml_or_as_words(text: str, expected: tuple[str, Any]) -> None:
    name, value = parse_setting(text)
    assert (name, value) == expected
    assert type(value) is type(expected[1])


@pytest.mark.parametrize("text", ["", "walk.leg_min_ms", "=3", "  = 3", "a=1\nb=2"])
def test_what_is_no_setting_is_refused(text: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_setting(text)
    assert caught.value.field == "--set"


def test_settings_are_applied_in_their_order() -> None:
    scenario = Scenario().with_values(parse_settings(["swarm.robots=7", "run.t_end_s=60"]))
    assert (scenario.swarm.robots, scenario.run.t_end_s) == (7, 60.0)


def test_a_setting_without_a_value_leaves_a_field_out() -> None:
    texts = [f"sensor.{name}=" for name in ("tile_spread", "robot_spread", "edge_reach_m", "edge_blur_m")]
    base, physics = preset("calibrated"), {"sensor.model": "acceleration"}
    with pytest.raises(InputError, match=r"leave it out \(--set sensor.tile_spread=\)"):
        base.with_values(physics)
    assert base.with_values(physics | parse_settings(texts)).sensor.model == "acceleration"


# What is refused


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("walk.leg_mim_ms", "walk.leg_min_ms"),
        ("walk.avoidance_threshold", "walk.avoidance_threshold_mm"),
        ("wlak.leg_min_ms", "walk.leg_min_ms"),
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


def test_an_unknown_section_is_refused() -> None:
    with pytest.raises(InputError, match="no such field"):
        Scenario.from_toml("[wheels]\nspeed = 3\n")
    assert "no such field" in str(refused({"wheels.speed": 3}))
    with pytest.raises(
        InputError, match=r"^run.t_end_s: is a key with a dot; in TOML, write it without quotes$"
    ):
        Scenario.from_toml('"run.t_end_s" = 60.0\n')


WRONG: list[tuple[list[str], list[Any]]] = [
    (FLOATS, [math.nan, -math.inf, -1e300, "5", "", True, None, [1.0], {}]),
    ([name for name in FLOATS if name != "network.range.range_m"], [math.inf, 1e300]),  # a range may be unlimited
    (INTS, [math.nan, 10**30, -(10**30), 5.5, 5.0, "5", True, None, [1]]),
    (FLAGS, [0, 1, "true", "no", None, 1.0]),
    (WORDS, [3]),
]  # fmt: skip


@pytest.mark.parametrize(
    ("names", "values"), WRONG, ids=["floats", "limited floats", "integers", "flags", "words"]
)
def test_what_is_no_value_of_a_field_is_refused(names: list[str], values: list[Any]) -> None:
    """Each by itself, with field and value named."""
    for name, value in itertools.product(names, values):
        with named(name, value), pytest.raises(InputError) as caught:
            Scenario.from_values(in_tables(name, value))
        assert caught.value.field == name
        assert repr(value) in str(caught.value)


MAY_BE_NEGATIVE = {
    "floor.left_m", "floor.bottom_m", "robot.misalignment_min", "robot.misalignment_max",
    "robot.speed_factor_location", "sensor.vibrating_location", "sensor.still_location",
    *(f"faults.false_{kind}_{what}" for kind in ("positive", "negative") for what in ("shift", "drift_per_h")),
    "faults.misread_drift_per_h",
}  # fmt: skip
MAY_BE_ZERO = MAY_BE_NEGATIVE | {
    "swarm.start_margin_m", "rays.forward_m", "rays.disc_radius_m", "rays.noise_m", "walk.walk_duration_location_ms",
    "walk.walk_duration_scale_ms", "walk.leg_min_ms", "walk.avoidance_threshold_mm",
    "walk.turn_integral_gain_percent_per_deg_s", "sample.sample_interval_ms", "sample.stop_ms",
    "sensor.rms_threshold", "strategy.soft.eta", "strategy.soft.kappa", "decision.min_observations",
    "strategy.dirichlet_soft.eta", "strategy.dirichlet_soft.kappa",
    "network.loss.share", "decision.hold_s", "strategy.totals.threshold", "strategy.bayes_bots.sender_timeout_s",
    "strategy.bayes_bots.repeat_s", "strategy.dc.patience", "strategy.dmvd.patience", "strategy.dmmd.patience",
    "strategy.dbbs.decay_own", "strategy.dbbs.decay_other", "strategy.dbbs.memory", "strategy.asdf.flawed_robots",
    "strategy.bayes_cpf.drift", "strategy.bayes_cpf.drift_variance", "strategy.distrust.threshold",
    *(f"faults.{field}" for kind in FAULTS for field in (kind, SINCE[kind])),
    *(f"strategy.{name}.{field}" for name in ("places", "explore", "fading")
      for field in ("edge_reach_m", *OF_MAPS[1:])),
    "strategy.forget.memory", "task.changed.more_than", "task.share.kind",
    "strategy.averaging.weight", "faults.stuck_class", "faults.misread_shift", "faults.misread_drift_per_h",
    *(f"sensor.acceleration.{field}" for field in ("motor_spread", "motor_jitter", "frequency_jitter",
      "coupling", "lateral", "feet_m", "gain_spread", "noise_m_s2")),
    "strategy.explore.recent_s",
    "strategy.field.min_samples", "strategy.places.draws",
    "localisation.start_spread_m", "localisation.start_heading_spread_deg",
    "network.bursts.bad_s",
    "network.bursts.bad_share", "network.bursts.lost_in_bad", "network.bursts.lost_in_good", "network.delay.fixed_s",
    "network.delay.random_s", "network.tree.frame_ms", "network.tree.log_bytes", "network.tree.message_bytes",
    "network.tree.retry_ms",
}  # fmt: skip


def test_negative_values_are_refused() -> None:
    for name in set(FLOATS + INTS) - MAY_BE_NEGATIVE:
        value = -1 if name in INTS else -0.001
        with named(name, value):
            error = refused({name: value})
        assert error.field == name
        assert str(value) in str(error)


def test_zero_is_refused_where_it_makes_no_sense() -> None:
    for name in MAY_BE_ZERO:
        assert Scenario().with_values({name: 0})
    for name in set(FLOATS + INTS) - MAY_BE_ZERO:
        with named(name, 0):
            error = refused({name: 0})
        # below leg_min_ms: says so
        assert error.field == ("walk.leg_min_ms" if name == "walk.leg_max_ms" else name)


def test_a_wrong_word_names_the_right_ones() -> None:
    for name in WORDS:
        words = get_args(annotation(name))
        error = refused({name: words[0] + "x"})
        assert error.field == name
        assert all(f"'{word}'" in str(error) for word in words)
        assert f"did you mean '{words[0]}'" in str(error)


@pytest.mark.parametrize(
    ("values", "field", "shown"),
    [
        ({"robot.misalignment_min": 0.2}, "robot.misalignment_min", "0.2"),
        ({"robot.speed_factor_min": 2.0}, "robot.speed_factor_min", "2.0"),
        ({"walk.leg_min_ms": 40_000.0}, "walk.leg_min_ms", "40000.0"),
        ({"rays.side_m": [0.0]}, "rays.side_m", "rays.angle_deg"),
        ({"rays.side_m": []}, "rays.side_m", "[]"),
        ({"rays.angle_deg": [0.0, math.nan, 1.0]}, "rays.angle_deg.1", "nan"),
        ({"rays.angle_deg": [0.0, "x", 1.0]}, "rays.angle_deg.1", "'x'"),
        ({"arena.width_m": 0.02}, "arena.width_m", "0.015"),
        ({"arena.height_m": 0.02}, "arena.height_m", "0.015"),
        ({"swarm.start_margin_m": 0.6}, "swarm.start_margin_m", "at most 0.5"),
        ({"swarm.robots": 5000}, "swarm.robots", "5000"),
        ({"run.t_end_s": 8400.0}, "robot.battery_life_s", "8400"),
        ({"sample.sample_interval_ms": 0.0, "sample.stop_ms": 0.0}, "sample.sample_interval_ms", "20 ms"),
        ({"run.control_period_ms": 500}, "run.control_period_ms", "500 ms"),
        ({"sensor.model": "energies"}, "sensor.vibrating_energies", "missing"),
        ({"sensor.vibrating_energies": []}, "sensor.vibrating_energies", "[]"),
        ({"floor.tiles": ["10", "1"]}, "floor.tiles", "equal length"),
        ({"floor.tiles": ["12"]}, "floor.tiles", "2 kinds, from 0"),
        ({"floor.tiles": ["1g"]}, "floor.tiles", "a to f"),
        ({"floor.tiles": []}, "floor.tiles", "[]"),
        ({"floor.left_m": 1.0}, "floor.left_m", "outside"),
        ({"floor.left_m": -1.0}, "floor.left_m", "outside"),
    ],
)
def test_fields_that_do_not_go_together(values: dict[str, Any], field: str, shown: str) -> None:
    error = refused(values)
    assert error.field == field
    assert shown in str(error)


@pytest.mark.parametrize(
    "source", ["diagnoal:0.46", "diagonal:0.47", "diagonal", "random:0.5", "random:x", "random:nan"]
)
def test_an_unknown_floor_is_refused(source: str) -> None:
    assert refused({"floor.source": source}).args


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"swarm.start_margin_m": 0.0, "arena.width_m": 0.1, "arena.height_m": 0.07},
        {"swarm.start_margin_m": 0.0, "arena.width_m": 0.03, "arena.height_m": 0.03},
        {"arena.width_m": 0.3, "arena.height_m": 2.0},
        {"robot.body_radius_m": 0.05},
    ],
)
def test_more_robots_than_fit_says_how_many_do(values: dict[str, Any]) -> None:
    error = refused(values | {"swarm.robots": 10_000})
    assert error.field == "swarm.robots"
    assert "10000" in str(error)
    found = re.search(r"at most (\d+) can start side by side, in rows and columns \(other", str(error))
    assert found is not None
    most = int(found[1])
    assert refused(values | {"swarm.robots": most + 1}).field == "swarm.robots"
    # As many as it says can be placed, side by side.
    scenario = Scenario().with_values(values | {"swarm.robots": most, "run.t_end_s": 0.02})
    ends = simulate(scenario, 1).ends
    assert ends.height == most
    place = ends.select("x_m", "y_m").to_numpy()
    gap = ((place[:, None] - place[None]) ** 2).sum(axis=2)
    gap[range(most), range(most)] = math.inf
    assert gap.min() >= (2 * scenario.robot.body_radius_m) ** 2
    margin = max(scenario.swarm.start_margin_m, scenario.robot.body_radius_m) - 1e-12
    assert place.min() >= margin
    assert (place[:, 0] <= scenario.arena.width_m - margin).all()
    assert (place[:, 1] <= scenario.arena.height_m - margin).all()


def test_what_cannot_be_read_is_refused(tmp_path: Path) -> None:
    device = Path("/dev/null")  # some such never end
    for path in (tmp_path, tmp_path / "not there.toml", Path("a\0b"), *([device] if device.exists() else [])):
        with pytest.raises(InputError):
            Scenario.read(path)
    large = tmp_path / "large.toml"
    with large.open("wb") as file:
        file.truncate(2**26 + 1)
    for path, said in ((tmp_path, "is a folder"), (large, "is larger than 64 MiB")):
        with pytest.raises(InputError) as caught:
            Scenario.read(path)
        assert str(caught.value).startswith(f"{path}: {said}")
    binary = tmp_path / "picture.toml"
    binary.write_bytes(b"\x89PNG\r\n\xff\xfe")
    with pytest.raises(InputError, match="UTF-8") as caught:
        Scenario.read(binary)
    assert caught.value.field == str(binary)
    for text, said in (
        ("[walk\n", "is not TOML"),
        ("preset = paper\n", "if the value is text, write it in quotes$"),
    ):
        binary.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=said):
            Scenario.read(binary)


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
@example("a = " + "[" * 3000)
@example("[walk]\nleg_min_ms = " + "9" * 5000)
@example("[robot]\nbody_radius_m = 1e-310\n")
def test_any_text_is_a_scenario_or_an_input_error(text: str) -> None:
    try:
        scenario = Scenario.from_toml(text)
    except InputError:
        return
    assert Scenario.from_toml(scenario.to_toml()) == scenario


@pytest.fixture(scope="module")
def any_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("any") / "any.toml"


@settings(deadline=None, max_examples=80)
@given(data=st.one_of(st.binary(max_size=200), st.text(max_size=100).map(str.encode)))
def test_any_bytes_are_a_scenario_or_an_input_error(any_file: Path, data: bytes) -> None:
    any_file.write_bytes(data)
    try:
        Scenario.read(any_file)
    except InputError:
        return


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


EXTREME = [5e-324, 1e-310, 1e-30, 1e-12, 1e-6, 1e-3, 1e4, 1e6, 1e9, 1e12]


def simulated(values: dict[str, Any]) -> Result | None:
    """A short run with these values, or None where they are refused by name."""
    short = {"run.t_end_s": 5.0, "sample.stop_ms": 100.0, "sample.sample_interval_ms": 300.0}
    try:
        scenario = Scenario().with_values(short | values)
    except InputError as error:
        if error.field is None:
            raise
        return None
    return simulate(scenario, 1)


@pytest.mark.parametrize("name", FLOATS)
def test_extreme_values_are_refused_or_can_be_simulated(name: str) -> None:
    """No bound is so loose that an engine fails where the scenario did not."""
    for value in EXTREME:
        with named(name, value):
            result = simulated({name: value})
            if result is None:
                continue
            assert result.ends.height == 5
            place = result.ends.select("x_m", "y_m", "heading_rad").to_numpy()
            assert np.isfinite(place).all()
            assert np.isfinite(result.observations["energy"].to_numpy()).all()
            assert result.inference["belief_below"].is_between(0, 1).all()


@pytest.mark.parametrize("name", INTS)
def test_extreme_whole_numbers_are_refused_or_can_be_simulated(name: str) -> None:
    for value in (0, 1, 3, 2**15, 2**31 - 1, 2**31, 10**9):
        with named(name, value):
            result = simulated({name: value})
            assert result is None or result.inference["belief_below"].is_between(0, 1).all()


def test_the_folder_of_a_floor_file_may_be_a_text(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("110\n000\n")
    scenario = Scenario.from_toml('[floor]\nsource = "mine.txt"\n', folder=str(tmp_path))
    assert scenario.floor.tiles == ("110", "000")


def test_values_and_palettes_beside_a_scenario_are_found_and_its_copy_needs_no_file(tmp_path: Path) -> None:
    """A saved scenario whose values came from a file once looked for that file again."""
    from PIL import Image

    beside, elsewhere = tmp_path / "beside", tmp_path / "elsewhere"
    beside.mkdir(), elsewhere.mkdir()
    (beside / "v.csv").write_text("3,12\n7.5,3\n")
    Image.fromarray(np.array([[[255, 0, 0], [0, 0, 0]]], dtype=np.uint8)).save(beside / "mine.png")
    for source, field, rows in (
        ("values:3..12:v.csv", "values", ((0.0, 1.0), (0.5, 0.0))),
        ("palette:000000,ff0000:mine.png", "tiles", ("10",)),
    ):
        (beside / "one.toml").write_text(f'[floor]\nsource = "{source}"\n')
        scenario = Scenario.read(beside / "one.toml")
        assert getattr(scenario.floor, field) == rows
        (elsewhere / "copy.toml").write_text(scenario.to_toml())
        assert Scenario.read(elsewhere / "copy.toml") == scenario


@pytest.mark.parametrize("name", ["random:0.48", "RANDOM:0.1", "diagonal:0.46", "stripe:0.1", "alternating"])
def test_tiles_are_not_called_like_a_pattern(name: str) -> None:
    with pytest.raises(InputError, match=r"^floor\.source: .*name of their own"):
        Scenario().with_values({"floor.source": name, "floor.tiles": ["10", "01"]})


def test_tiles_that_are_the_pattern_may_have_its_name() -> None:
    floor = Scenario().with_values({"floor.source": "diagonal:0.46"}).floor_for(0, 0)
    Scenario().with_values({"floor.source": "diagonal:0.46", "floor.tiles": floor.tiles})


def test_tiles_may_be_an_array_of_kinds() -> None:
    for tiles in (np.array([[1, 0], [0, 1]]), [[True, False], [0, 1]]):
        assert Scenario().with_values({"floor.tiles": tiles}).floor.tiles == ("10", "01")
    for wrong in ([[1.0, 0.0]], [[16, 0]], [[-1, 0]]):
        with pytest.raises(InputError, match=r"^floor\.tiles\.0: .* valid string"):
            Scenario().with_values({"floor.tiles": wrong})


def test_tiles_without_a_name_are_not_called_after_the_floor_they_replace() -> None:
    for scenario in (
        Scenario().with_values({"floor.tiles": ["10", "01"]}),
        Scenario.from_values({"floor": {"tiles": ["10", "01"]}}),
        Scenario.from_toml("[floor]\ntiles = ['10', '01']"),
        Scenario.from_base({"preset": "paper", "floor": {"tiles": ["10", "01"]}}),
    ):
        assert scenario.floor.source == "tiles"
        assert scenario.floor_for(1, 2).name == "tiles"


def test_a_name_that_is_no_field_is_refused_with_none_too() -> None:
    for name in ("walk.nonsense", "strategy.nonsense.eta", "strategy.soft.nonsense", "camera.nonsense"):
        with pytest.raises(InputError, match="there is no such field"):
            Scenario().with_values({name: None})
    assert Scenario().with_values({"strategy.soft.eta": None, "sensor.edge_reach_m": None}) == Scenario()
    with pytest.raises(InputError, match=r"camera: is a section; name one of its fields, such as camera\."):
        Scenario().with_values({"camera": 1})
    with pytest.raises(
        InputError, match=r"^swarm: is a section; name one of its fields, such as swarm\.robots$"
    ):
        Scenario()["swarm"]


@pytest.mark.parametrize(
    ("field", "value", "end"),
    [
        ("decision.credible_threshold", "95%", "; write 0.95"),
        ("decision.credible_threshold", "0,95", "; write 0.95"),
        ("run.t_end_s", "20 min", "; write the number alone, in the unit of the field's name"),
        ("run.t_end_s", "1,200", "should be a valid number"),  # 1200 or 1.2
        ("run.t_end_s", "9" * 5000, "should be a valid number"),
        ("run.t_end_s", "1199.99999", "; write 1199.99999"),
        ("swarm.robots", "5.0", "; write 5"),
        ("swarm.robots", "5,5", "should be a valid integer"),
        ("swarm.robots", "5%", "should be a valid integer"),
        ("swarm.robots", "five", "should be a valid integer"),
        ("network.loss.p", "0.1", "there is no such field (known: share)"),
    ],
)
def test_what_people_write_for_a_number_is_told_as_the_field_takes_it(
    field: str, value: str, end: str
) -> None:
    with pytest.raises(InputError, match=rf"{re.escape(end)}$") as error:
        Scenario().with_values({field: value})
    assert error.value.field == field


@pytest.mark.parametrize("strategy", ["none", "soft"])
def test_scenarios_and_names_of_fields_can_be_pickled(strategy: str) -> None:
    scenario = preset("paper").with_values({"strategy.name": strategy, "network.name": "tree"})
    assert pickle.loads(pickle.dumps(scenario)) == scenario  # noqa: S301
    assert pickle.loads(pickle.dumps(fields.swarm)).robots == "swarm.robots"  # noqa: S301


@pytest.mark.parametrize("name", ["walk.model_dump", "floor.drawn_by_run", "strategy.table"])
def test_methods_and_properties_are_no_fields(name: str) -> None:
    with pytest.raises(InputError, match="there is no such field"):
        Scenario()[name]


@pytest.mark.parametrize("kind", [Scenario, Study, Search])
def test_wrong_values_of_a_file_are_told_with_the_file(kind: Any, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    section = "swarm" if kind is Scenario else "scenario.swarm"
    file.write_text(f'[{section}]\nrobots = "many"\n')
    with pytest.raises(
        InputError, match=rf"^swarm\.robots: 'many' is wrong: .* \(in {re.escape(str(file))}\)$"
    ):
        kind.read(file)


@pytest.mark.parametrize("kind", [Scenario, Study, Search])
def test_a_file_without_text_is_refused(kind: Any, tmp_path: Path) -> None:
    """One that was cut off when it was written: it would count as all default values."""
    file = tmp_path / "mine.toml"
    for text in ("", "\ufeff", " \n\n"):
        file.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=r"is empty; a .* has at least one field or comment") as caught:
            kind.read(file)
        assert str(file) in str(caught.value)
    file.write_text("# as in the paper\n", encoding="utf-8")
    kind.read(file)


def test_defaults_of_parameters_are_what_the_same_values_become() -> None:
    """An equal scenario once had another hash after it was read back, if a default was 30 in place of 30.0."""

    class Params:
        wait_s: float = 30
        zero: float = -0.0

    model = as_params(Params, "mine")
    assert model().model_dump_json() == model(wait_s=30.0, zero=0.0).model_dump_json()
    assert str(model()) == "wait_s=30.0 zero=0.0"


@pytest.mark.parametrize(
    ("default", "words"),
    [
        ({}, "Params.lead: has no default; give one"),
        ({"lead": 0}, "Params.lead: the default 0 is wrong: input should be greater than or equal to 1"),
        ({"lead": 2**63}, "at most 64 bits"),
    ],
)
def test_a_default_that_is_missing_or_wrong_is_refused(default: dict[str, int], words: str) -> None:
    declared = type("Params", (), {"__annotations__": {"lead": Annotated[int, Field(ge=1)]}, **default})
    with pytest.raises(InputError, match=words):
        as_params(declared, "mine")


@pytest.mark.parametrize(
    "made",
    [
        Scenario.model_validate,
        Scenario.from_values,
        Scenario.from_base,
        lambda values: Scenario(**values),
        lambda values: Scenario.model_validate_json(json.dumps(values)),
    ],
)
def test_each_way_from_mappings_names_field_value_and_what_would_be_right(made):
    with pytest.raises(
        InputError, match=r"swarm.robots: 0 is wrong: input should be greater than or equal to 1"
    ):
        made({"swarm": {"robots": 0}})
