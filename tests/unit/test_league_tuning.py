"""Tuning the strategies of a league: which settings are chosen, on which runs, and the file of settings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.commands import json_of, output_of, refusal_of
from vibroswarm.cli import league as league_commands
from vibroswarm.cli import main
from vibroswarm.errors import InputError
from vibroswarm.league.entries import AIM, FOR_CHANGES, entries_of, floors_of, read_settings
from vibroswarm.league.standings import League
from vibroswarm.league.tuning import (
    ROUNDS,
    _borrowed,
    _box,
    _candidates,
    _chosen_within,
    chosen_along,
    hull_of,
    ranked_for_aims,
    spaces,
    tune,
)
from vibroswarm.scenario.scenario import field_names, preset
from vibroswarm.strategies import known

BASE = preset("paper").with_values({"run.t_end_s": 60.0, "decision.min_observations": 5})
SPACE = {"decision.min_observations": {"from": 0, "to": 60, "whole": True}}


POINTS = st.lists(
    st.tuples(st.integers(0, 9).map(float), st.integers(0, 9).map(float)), min_size=1, max_size=12
)


@given(POINTS)
def test_a_hull_has_all_points_above_it(points: list[tuple[float, float]]) -> None:
    time_s, error = np.array(points).T
    hull = hull_of(time_s, error)
    x, y = time_s[hull], error[hull]
    assert (np.diff(x) > 0).all()
    assert (np.diff(y) < 0).all()
    assert (np.diff(np.diff(y) / np.diff(x)) > 0).all()
    assert x[0] == time_s.min()
    assert y[-1] == error.min()
    inside = time_s <= x[-1]
    assert (error[inside] >= np.interp(time_s[inside], x, y) - 1e-9).all()


def test_settings_are_ranked_by_time_at_the_price_of_error() -> None:
    """0, 1 and 3 are on the hull, where 1 % costs 10 s and then 30 s; 2 lies just above it, 4 far above."""
    error = np.array([0.10, 0.20, 0.15, 0.30, 0.21])
    time_s = np.array([500.0, 200.0, 355.0, 100.0, 400.0])
    found = ranked_for_aims(time_s, error, [0.05, 0.12, 0.19, 0.29, 0.35])
    assert found == {
        0.0: [0, 2, 1, 4, 3],
        0.12: [0, 1, 2, 3, 4],
        0.19: [1, 0, 2, 3, 4],
        0.29: [3, 1, 2, 0, 4],
        0.35: [3, 1, 2, 0, 4],
    }
    one = ranked_for_aims(np.array([5.0]), np.array([0.1]), [0.1])
    assert one == {0.0: [0], 0.1: [0]}
    assert chosen_along(time_s, error, [0.05, 0.12]) == [0, 1]
    assert chosen_along(time_s, error, [0.12, 0.35]) == [0, 1, 3]
    assert chosen_along(time_s, error, [0.05]) == [0]
    assert chosen_along(np.array([5.0, 6.0]), np.array([0.103, 0.1])) == [1], "too near each other"


def test_more_settings_are_tried_of_more_fields_and_every_round_is_fresh(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rounds: dict[str, list[tuple[int, int, int]]] = {}
    play = League.play

    def noted(league: League, *given: Any, **how: Any) -> Any:
        of = rounds.setdefault(league.entries[0].strategy, [])
        of.append((len(league.entries), league.runs, league.seed))
        return play(league, *given, **how)

    monkeypatch.setattr(League, "play", noted)
    space = {"none": SPACE, "soft": SPACE | {"strategy.soft.eta": {"from": 500.0, "to": 2000.0}}}
    floors = floors_of(["stripe"], [0.48])
    tuned = tune(BASE, ["soft", "none"], floors, [3], space_of=space, points=8, runs=2, seed=5)
    for name, fields in (("none", 1), ("soft", 2)):
        (first, second, third) = rounds[name]
        assert first == (8 * fields, 2, 5)
        assert second[1:] == (2 * ROUNDS[1], 6)
        assert third[1:] == (2 * ROUNDS[2], 7)
        assert third[0] <= second[0] + 1
        settings = tuned.settings[name]
        assert [one[AIM] for one in settings] == sorted({one[AIM] for one in settings})
    assert list(rounds) == ["none", "soft"], (
        "soft feedback begins with what was chosen for none, named first or not"
    )
    assert list(tuned.settings) == ["soft", "none"]
    assert tuned.table["is_chosen"].sum() == sum(len(found) for found in tuned.settings.values())
    assert "8 settings for each tuned field" in tuned.how
    with pytest.raises(InputError, match="positive"):
        tune(BASE, ["positive"], floors, [3], space_of=space, points=4, runs=2)


def test_what_was_found_by_hand_for_soft_feedback_is_in_its_space() -> None:
    found = {"strategy.soft.eta": 5000.0, "strategy.soft.kappa": 2.0,
             "decision.credible_threshold": 0.95, "decision.min_observations": 381}  # fmt: skip
    for field, value in found.items():
        bounds = spaces()["soft"][field]
        assert bounds["from"] < value < bounds["to"]


def test_a_box_lies_within_the_bounds() -> None:
    ranges = spaces()["soft"]
    for centre in ({field: bounds[end] for field, bounds in ranges.items()} for end in ("from", "to")):
        for field, near in _box(centre, ranges).items():
            assert ranges[field]["from"] <= near["from"] < near["to"] <= ranges[field]["to"]
            assert near["from"] <= centre[field] <= near["to"]
    decades = _box({"x": 100.0}, {"x": {"from": 1.0, "to": 1e4, "scale": "log"}})["x"]
    assert (decades["from"], decades["to"]) == pytest.approx((10**1.5, 10**2.5)), "a quarter of four"


def test_a_box_of_whole_numbers_has_whole_ends() -> None:
    """Also if the bounds alone say so: 29.9 observations were refused in the second round, after all the work."""
    near = _box({"decision.min_observations": 29}, {"decision.min_observations": {"from": 5, "to": 90}})
    assert near == {"decision.min_observations": {"from": 18, "to": 40}}


def test_spaces_are_of_strategies_and_fields_that_exist() -> None:
    fields = field_names()
    found = spaces()
    for_two_kinds = {name for name, one in known().items() if not one.answers_kinds}
    assert set(found) == for_two_kinds - set(FOR_CHANGES)
    for name, space in found.items():
        for field in space:
            assert field in fields, f"{name}: {field}"
            assert field.startswith(("decision.", f"strategy.{name}.", "localisation."))


def test_the_example_judges_settings_on_a_seed_of_no_round() -> None:
    tuning, playing = (league_commands.tune.__doc__ or "").strip().splitlines()[-2:]
    seeds = [int(line.split("--seed ")[1].split()[0]) for line in (tuning, playing)]
    assert seeds[1] not in range(seeds[0], seeds[0] + len(ROUNDS))


def test_by_default_too_a_league_plays_on_seeds_of_no_round() -> None:
    rounds, playing = (
        {seed, seed + 1, seed + 2} for seed in (league_commands.Tuned.seed, league_commands.Players.seed)
    )
    assert not rounds & playing  # a league's beliefs and faults have the two seeds that follow its own


SMALL = ["--runs", "2", "--patterns", "stripe", "--fills", "0.48", "--robots", "3", "--strategy", "none"]
QUICK = ["--set", "run.t_end_s=60", "--set", "decision.min_observations=5"]


def test_the_command_writes_settings_that_a_league_reads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "my settings.toml"
    line = ["league", "tune", *SMALL, *QUICK, "--points", "8", "--seed", "1", "--out", str(file)]
    said = output_of(capsys, *line)
    assert said.startswith("none: ")
    assert "decision.min_observations" in said
    assert set(read_settings(file)) == {"none"}
    text = file.read_text(encoding="utf-8")
    assert text.startswith("# 8 settings for each tuned field")
    assert "--force" in refusal_of(capsys, *line)
    assert main([*line, "--force"]) == 0
    assert file.read_text(encoding="utf-8") == text, "the same seed finds the same settings"
    assert main(["league", *SMALL, *QUICK, "--settings", str(file)]) == 0
    assert list(tmp_path.iterdir()) == [file]
    shown = output_of(capsys, "show", str(file))
    assert shown.startswith("Settings of 1 strategy: none.")
    for words in ("8 settings for each tuned", "decision.min_observations", "forced error, %"):
        assert words in shown
    rows = json_of(capsys, "show", str(file), "--json")["tables"]["none"]
    assert {AIM, "decision.min_observations", "decision.credible_threshold"} == set(rows[0])


@pytest.mark.parametrize(
    ("option", "text", "said"),
    [
        ("settings", '[none]\n"decision.credible_treshold" = 0.9\n', "did you mean 'decision.credible_threshold'?"),
        ("settings", '[none]\n"decision.credible_threshold" = 3\n', "decision.credible_threshold: 3.0 is wrong"),
        ("settings", "[[none]]\nforced_error = 3\n", "settings of none.forced_error: 3 is wrong"),
        ("settings", "none = 3\n", "must be the table of a strategy's fields"),
        ("settings", "[[none]\n", "is not TOML"),
        ("spaces", '[none]\n"decision.credible_treshold" = { from = 0.5, to = 0.9 }\n', "did you mean"),
        ("spaces", '[none]\n"decision.credible_threshold" = { from = 0.9, to = 0.5 }\n', "credible_threshold"),
        ("spaces", '[[none]]\n"decision.credible_threshold" = { from = 0.5, to = 0.9 }\n', "strategy's fields"),
    ],
)  # fmt: skip
def test_a_mistake_in_a_file_names_it(
    option: str, text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / f"{option}.toml"
    file.write_text(text, encoding="utf-8")
    command = ["league"] if option == "settings" else ["league", "tune"]
    err = refusal_of(capsys, *command, *SMALL, *QUICK, f"--{option}", str(file))
    assert said in err
    assert str(file) in err


def test_rounded_settings_stay_within_the_bounds() -> None:
    (entry,) = entries_of(["none"], {})
    space = {"decision.credible_threshold": {"from": 0.9995, "to": 0.9999}}
    candidates, _ = _candidates(entry, space, 16, 1)
    values = [one.settings["decision.credible_threshold"] for one in candidates]
    assert all(0.9995 <= value <= 0.9999 for value in values)


def test_a_space_with_only_fixed_values_has_one_setting() -> None:
    (entry,) = entries_of(["none"], {})
    fixed = {"decision.min_observations": 7}
    candidates, default = _candidates(entry, fixed, 16, 1)
    assert [one.settings for one in candidates] == [fixed]
    assert default.settings == fixed
    tuned = tune(
        BASE, ["none"], floors_of(["stripe"], [0.48]), [3], space_of={"none": fixed}, points=4, runs=2
    )
    ((found,),) = tuned.settings.values()
    assert {field: value for field, value in found.items() if field != AIM} == fixed


def test_a_strategy_is_tried_with_what_was_chosen_for_one_whose_fields_it_has() -> None:
    (entry,) = entries_of(["soft"], {})
    own = [
        replace(entry, settings={"decision.min_observations": k, "strategy.soft.eta": k}) for k in range(9)
    ]
    space = {"decision.min_observations": {"from": 0, "to": 9}, "strategy.soft.eta": {"from": 0, "to": 9}}
    of_none = {"decision.min_observations": {"from": 0, "to": 9}, "run.t_end_s": 60.0}
    all_spaces = {
        "none": of_none,
        "soft": space,
        "mcp": {"decision.credible_threshold": {"from": 0, "to": 1}},
    }
    settings = {
        "none": [{AIM: 0.1, "decision.min_observations": 77, "run.t_end_s": 60.0}],
        "mcp": [{AIM: 0.1, "decision.credible_threshold": 0.9}],
    }
    borrowed = _borrowed(own, _chosen_within(space, all_spaces, settings))
    assert [one.settings for one in borrowed] == [
        {"decision.min_observations": 77, "strategy.soft.eta": k} for k in (0, 2, 4, 6)
    ]
    assert _chosen_within(of_none, all_spaces, settings) == [], "its own fields are not more than those"
