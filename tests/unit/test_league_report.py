"""The report of a league: what its first sentences say, and what the page holds."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from vibroswarm.league.belief_calibration import belief_calibration
from vibroswarm.league.entries import entries_of, floors_of
from vibroswarm.league.fault_curves import fault_curves
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


def said(
    differences: pl.DataFrame, fronts: pl.DataFrame, floors: pl.DataFrame | None = None
) -> tuple[str, ...]:
    found = on_floors() if floors is None else floors
    return answers(STANDINGS, {"differences": differences, "fronts": fronts, "floor_differences": found})


def on_floors(*rows: tuple[str, float, float, float]) -> pl.DataFrame:
    """Name, fill ratio, difference of forced errors, and its p by Holm."""
    frame = pl.DataFrame(
        rows or [("sure", 0.48, 0.1, 0.06)],
        schema=["name", "fill_ratio", "difference", "p_holm"],
        orient="row",
    )
    return frame.with_columns(
        reference=pl.lit("base"), pattern=pl.lit("stripe"), figure=pl.lit("forced_error")
    )


def test_the_first_sentences_name_the_best_and_what_is_sure() -> None:
    found = said(
        differences(
            ("sure", "forced_error", -0.05, 0.001), ("sure", "decision_time_s", 100.0, 0.001),
            ("fast", "forced_error", 0.01, 0.2), ("fast", "decision_time_s", -300.0, 0.001),
            ("slow", "forced_error", 0.01, 0.04), ("slow", "decision_time_s", 20.0, 0.06),
            ("same", "forced_error", 0.2, 0.06), ("same", "decision_time_s", 90.0, None),
        ),
        FRONTS,
        on_floors(
            ("sure", 0.46, -0.1, 0.01), ("sure", 0.48, -0.1, 0.04), ("sure", 0.5, 0.2, 0.001),
            ("fast", 0.46, 0.1, 0.01), ("fast", 0.48, -0.1, 0.06),
        ),
    )  # fmt: skip
    assert found[0].startswith("Smallest forced error: sure, 10.0 % [9.0, 11.0]; it decides after 700 s.")
    assert "Fastest: fast, 300 s; its forced error is 30.0 %" in found[0]
    assert "not shown to be worse in the other: fast;" in found[1]
    assert "not shown to be better in the other: slow;" in found[1]
    assert "better in one and worse in the other: sure." in found[1]
    assert "same" not in found[1]
    assert found[2].endswith("Holm over strategies and 3 floors: sure fewer on 2, more on 1; fast more on 1.")
    assert found[3] == "At the forced error of base, the fastest front is that of sure: 550 s, against 600 s."


def test_who_is_told_the_grid_is_said() -> None:
    told = STANDINGS.with_columns(told=pl.Series(["boundary, grid", "boundary", "boundary"]))
    tables = {
        "differences": differences().clear(),
        "fronts": FRONTS.clear(),
        "floor_differences": on_floors(),
    }
    assert answers(told, tables)[1].endswith("(with a wrong grid, worse than counting): sure.")
    assert not any("grid" in sentence for sentence in answers(STANDINGS, tables))


def test_nothing_is_said_to_differ_where_nothing_is_shown() -> None:
    """Negative control."""
    rows = [("fast", name, -1.0, 0.05) for name in ("forced_error", "decision_time_s")]
    found = said(differences(*rows), FRONTS.clear())
    assert found[1].endswith("no difference shown.")
    assert found[2].endswith("no forced error differs.")


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
    tables = {
        "differences": standings.differences(),
        "floor_differences": standings.floor_differences(),
        "fronts": front_table(standings),
        "beliefs": belief_calibration(standings.league, runs=2),
        "faults": fault_curves(standings.league, kinds=["stuck_at_1"], most=1, runs=2),
    }
    write_league_report(tmp_path, standings, tables)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Smallest forced error" in text
    assert "strategy.soft.eta = 321.0" in text
    assert "http://" not in text.replace("http://www.w3.org", "")
    assert "Belief and truth" in text
    assert "Faulty robots" in text
    write_league_report(tmp_path, standings, tables)
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == text
