"""Tuning the strategies of a league: the criterion, equal numbers of runs, and the file of settings."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from vibroswarm.cli import main
from vibroswarm.errors import InputError
from vibroswarm.league.entries import entries_of, floors_of, read_settings
from vibroswarm.league.standings import League
from vibroswarm.league.tuning import AGAIN, FINALISTS, _candidates, by_criterion, spaces, tune
from vibroswarm.scenario.scenario import field_names, preset
from vibroswarm.strategies import known

BASE = preset("paper").with_values({"run.t_end_s": 60.0, "decision.min_observations": 5})
SPACE = {"decision.min_observations": {"from": 0, "to": 60, "whole": True}}


def standings(*figures: tuple[float, float]) -> Any:
    """Entries with these errors and times."""

    def interval(k: int, name: str) -> Any:
        return SimpleNamespace(estimate=figures[k][0 if name == "forced_error" else 1])

    return SimpleNamespace(league=SimpleNamespace(entries=figures), interval=interval)


def test_the_criterion_is_time_up_to_the_target_then_error() -> None:
    found = standings((0.3, 10.0), (0.1, 90.0), (0.2, 50.0), (0.25, 5.0), (0.2, 40.0))
    assert by_criterion(found, 0.2) == [4, 2, 1, 3, 0]
    assert by_criterion(found, 0.05) == [1, 2, 4, 3, 0]
    assert by_criterion(found, 1.0) == [3, 0, 4, 2, 1]


def test_every_strategy_has_as_many_runs_and_the_second_round_is_fresh(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    runs, seeds = Counter[str](), dict[str, set[int]]()
    play = League.play

    def noted(league: League, *given: Any, **how: Any) -> Any:
        for entry in league.entries:
            runs[entry.strategy] += len(league.study.cells) // len(league.entries) * league.runs
            seeds.setdefault(entry.label, set()).add(league.seed)
        return play(league, *given, **how)

    monkeypatch.setattr(League, "play", noted)
    space = {"none": SPACE, "soft": SPACE | {"strategy.soft.eta": {"from": 500.0, "to": 2000.0}}}
    floors = floors_of(["stripe"], [0.48])
    tuned = tune(BASE, ["soft", "none"], floors, [3], space_of=space, points=8, runs=2, seed=5)
    of_target = len(floors) * AGAIN * 2
    each = len(floors) * (8 * 2 + (FINALISTS + 1) * AGAIN * 2)
    assert runs == {"soft": each, "none": each + of_target}
    assert seeds["base"] == {6}
    assert {tuple(sorted(found)) for found in seeds.values()} <= {(5,), (5, 6), (6,)}
    assert set(tuned.settings) == {"none", "soft"}
    assert tuned.table["is_chosen"].sum() == 2
    with pytest.raises(InputError, match="positive"):
        tune(BASE, ["positive"], floors, [3], space_of=space, points=4, runs=2)


def test_spaces_are_of_strategies_and_fields_that_exist() -> None:
    fields = field_names()
    found = spaces()
    assert set(found) == set(known())
    for name, space in found.items():
        for field in space:
            assert field in fields, f"{name}: {field}"
            assert field.startswith(("decision.", f"strategy.{name}.", "localisation."))


SMALL = ["--runs", "2", "--patterns", "stripe", "--fills", "0.48", "--robots", "3", "--strategy", "none"]
QUICK = ["--set", "run.t_end_s=60", "--set", "decision.min_observations=5"]


def test_the_command_writes_settings_that_a_league_reads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "my settings.toml"
    line = ["tune", *SMALL, *QUICK, "--points", "8", "--out", str(file)]
    assert main(line) == 0
    said = capsys.readouterr().out
    assert said.startswith("Settings by the smallest decision time")
    assert "decision.min_observations" in said
    assert set(read_settings(file)) == {"none"}
    text = file.read_text(encoding="utf-8")
    assert text.startswith("# 8 settings per strategy")
    assert main(line) == 2
    assert "--force" in capsys.readouterr().err
    assert main([*line, "--force"]) == 0
    assert file.read_text(encoding="utf-8") == text, "the same seed finds the same settings"
    assert main(["league", *SMALL, *QUICK, "--settings", str(file)]) == 0
    assert list(tmp_path.iterdir()) == [file]


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
    assert tuned.settings == {"none": fixed}
