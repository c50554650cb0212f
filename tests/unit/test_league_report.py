"""The report of a league: what its first sentences say, and what the page holds."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from vibroswarm.league.entries import entries_of, floors_of
from vibroswarm.league.fronts import front_table
from vibroswarm.league.report import answers, by_difficulty, write_league_report
from vibroswarm.league.standings import League
from vibroswarm.scenario.scenario import preset

STANDINGS = pl.DataFrame(
    {
        "name": ["sure", "base", "fast"],
        "forced_error": [0.10, 0.15, 0.30],
        "forced_error_low": [0.09, 0.14, 0.28],
        "forced_error_high": [0.11, 0.16, 0.32],
        "decision_time_s": [700.0, 600.0, 300.0],
    }
)
FRONTS = pl.DataFrame(
    {
        "strategy": ["sure", "fast"],
        "points": [3, 1],
        "reference": ["base", "base"],
        "time_at_equal_error_s": [550.0, None],
        "reference_time_s": [600.0, 600.0],
    }
)


def differences(*rows: tuple[str, str, float, float]) -> pl.DataFrame:
    frame = pl.DataFrame(rows, schema=["name", "figure", "difference", "p_holm"], orient="row")
    return frame.with_columns(reference=pl.lit("base"))


def test_the_first_sentences_name_the_best_and_what_is_sure() -> None:
    found = answers(
        STANDINGS,
        differences(
            ("sure", "forced_error", -0.05, 0.001), ("sure", "decision_time_s", 100.0, 0.001),
            ("fast", "forced_error", 0.01, 0.2), ("fast", "decision_time_s", -300.0, 0.001),
            ("slow", "forced_error", 0.01, 0.04), ("slow", "decision_time_s", 20.0, 0.06),
            ("same", "forced_error", 0.2, 0.06), ("same", "decision_time_s", 90.0, None),
        ),
        FRONTS,
    )  # fmt: skip
    assert found[0].startswith("Smallest forced error: sure, 10.0 % [9.0, 11.0]; it decides after 700 s.")
    assert "Fastest: fast, 300 s; its forced error is 30.0 %" in found[0]
    assert "not shown to be worse in the other: fast;" in found[1]
    assert "not shown to be better in the other: slow;" in found[1]
    assert "better in one and worse in the other: sure." in found[1]
    assert "same" not in found[1]
    assert found[2] == "At the forced error of base, the fastest front is that of sure: 550 s, against 600 s."


def test_nothing_is_said_to_differ_where_nothing_is_shown() -> None:
    """Negative control."""
    rows = [("fast", name, -1.0, 0.05) for name in ("forced_error", "decision_time_s")]
    assert answers(STANDINGS, differences(*rows), FRONTS.clear())[1].endswith("no difference shown.")


def test_a_floor_and_its_mirror_are_averaged() -> None:
    floors = pl.DataFrame(
        {
            "name": ["a", "a", "b", "b"],
            "pattern": ["stripe"] * 4,
            "fill_ratio": [0.46, 0.54, 0.46, 0.54],
            "forced_error": [0.1, 0.2, 0.5, 0.7],
        }
    )
    assert by_difficulty(floors).rows() == [
        ("stripe 0.46", "a", pytest.approx(15.0)), ("stripe 0.46", "b", pytest.approx(60.0)),
    ]  # fmt: skip


def test_the_page_says_who_wins_and_with_which_settings(tmp_path: Path) -> None:
    base = preset("paper").with_values({"run.t_end_s": 60.0, "decision.min_observations": 5})
    entries = entries_of(["none", "soft"], {"soft": {"strategy.soft.eta": 321.0}})
    standings = League(base, entries, floors_of(["stripe"], [0.48]), (3,), runs=3).play()
    tables = standings.differences(), front_table(standings)
    write_league_report(tmp_path, standings, *tables)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Smallest forced error" in text
    assert "strategy.soft.eta = 321.0" in text
    assert "http://" not in text.replace("http://www.w3.org", "")
    write_league_report(tmp_path, standings, *tables)
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == text
