"""Tuning the strategies of a league: which settings are chosen, on which runs, and the file of settings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.commands import json_of, output_of, refusal_of
from vibroswarm.cli import main
from vibroswarm.errors import InputError
from vibroswarm.league.entries import AIM, floors_of, read_settings
from vibroswarm.league.standings import League
from vibroswarm.league.tuning import (
    ROUNDS,
    chosen_along,
    hull_of,
    ranked_for_aims,
    tune,
)
from vibroswarm.scenario.scenario import preset

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
    assert "exists already" in refusal_of(capsys, *line)
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
