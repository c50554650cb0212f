"""The document of a league: what its first sentences say, and what terminal, page and JSON have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest

from vibroswarm.core.numbers import p_value
from vibroswarm.documents.league import by_difficulty, league_document
from vibroswarm.documents.league_answer import answers
from vibroswarm.league.belief_calibration import AS_PLAYED, AT_95, COMMON, OWN, belief_calibration
from vibroswarm.league.entries import AIM, GUESSING, default_strategies, entries_of, floors_of
from vibroswarm.league.fault_curves import fault_curves
from vibroswarm.league.standings import League, Standings
from vibroswarm.league.words import league_tables
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.show.cells import written
from vibroswarm.show.data import document_data
from vibroswarm.show.document import Section
from vibroswarm.show.page import page_html

STANDINGS = pl.DataFrame(
    {
        "name": ["sure", "base", "fast"],
        "forced_error": [0.10, 0.15, 0.30],
        "forced_error_low": [0.09, 0.14, 0.28],
        "forced_error_high": [0.11, 0.16, 0.32],
        "decision_time_s": [700.0, 600.0, 300.0],
    }
)
BEST = pl.DataFrame(
    [
        ("forced_error", "sure", True), ("forced_error", "base", True), ("forced_error", "fast", False),
        ("decision_time_s", "fast", True), ("decision_time_s", "base", False),
    ],
    schema=["figure", "name", "in_group"],
    orient="row",
).with_columns(behind_low=-0.1, behind_high=0.1)  # fmt: skip
FRONTS = pl.DataFrame(
    [
        (0.1, "sure", "yes", 700.0, 0.0, True), (0.1, "base", "no", None, None, None),
        (0.1, "fast", "open", 900.0, None, None),
        (0.2, "sure", "yes", 510.0, 10.0, True), (0.2, "base", "yes", 500.0, 0.0, True),
        (0.2, "fast", "yes", 533.0, 33.0, False),
    ],
    schema=["level", "strategy", "reached", "time_s", "behind_s", "in_group"],
    orient="row",
).with_columns(behind_s_low=pl.col("behind_s") - 20.0, behind_s_high=pl.col("behind_s") + 20.0)  # fmt: skip


def differences(*rows: tuple[str, str, float, float]) -> pl.DataFrame:
    frame = pl.DataFrame(rows, schema=["name", "figure", "difference", "p_holm"], orient="row")
    return frame.with_columns(reference=pl.lit("base"))


def said(
    differences: pl.DataFrame,
    fronts: pl.DataFrame,
    floors: pl.DataFrame | None = None,
    error: float = 0.2,
    best: pl.DataFrame = BEST,
    strategies: Sequence[str] = tuple(STANDINGS["name"]),
    beliefs: pl.DataFrame | None = None,
) -> tuple[str, ...]:
    """The answer of a league of entries that all have this forced error."""
    tables = {} if beliefs is None else {"beliefs": beliefs}
    tables |= {
        "differences": differences,
        "fronts": fronts,
        "floor_differences": on_floors() if floors is None else floors,
        "best": best,
    }
    entries = [SimpleNamespace(strategy=name, label=name, aim=None) for name in strategies]
    league: Any = SimpleNamespace(
        table=STANDINGS,
        league=SimpleNamespace(entries=entries, base=Scenario()),
        interval=lambda place, figure: SimpleNamespace(estimate=error, high=error + 0.01),
    )
    return answers(league, tables)


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
    assert found[0] == (
        "At 20 % forced error base and sure do not differ significantly (500 to 510 s); slower: fast +33 s."
    )
    assert found[1] == (
        "Smallest forced error: sure, 10.0 % [9.0, 11.0] in 700 s; not significantly different from it: base."
    )
    assert found[2] == "Fastest: fast, 30.0 % [28.0, 32.0] in 300 s."
    assert "faster or more accurate, no loss found: fast;" in found[3]
    assert "slower or less accurate, no gain found: slow." in found[3]
    assert "faster but less accurate, or slower but more accurate: sure;" in found[3]
    assert "same" not in found[3]
    assert found[4].endswith("Holm over strategies and 3 floors: sure fewer on 2, more on 1; fast more on 1.")
    assert len(found) == 5


def test_those_that_differ_in_no_run_are_named() -> None:
    """Not only "do not differ significantly", with a difference of 0 [0, 0]."""
    found = said(
        differences().clear(),
        FRONTS.with_columns(behind_s_low=0.0, behind_s_high=0.0),
        best=BEST.with_columns(behind_low=0.0, behind_high=0.0),
    )
    assert found[0].startswith(
        "At 20 % forced error base and sure do not differ significantly (500 to 510 s) "
        "(the same in all runs: base and sure)"
    )
    assert found[1].endswith("different from it: base (the same in all runs: sure and base).")
    assert "the same" not in found[2]  # control: alone


def test_what_guesses_is_named() -> None:
    (words,) = [text for text in said(differences().clear(), FRONTS, error=0.395) if "guess" in text]
    assert words.endswith("never called fastest: sure, base and fast.")


def test_what_is_left_out_because_it_guesses_is_named() -> None:
    names = default_strategies()
    assert not set(names) & set(GUESSING)
    *_, words = said(differences().clear(), FRONTS, strategies=names)
    assert words.endswith(
        f"because they guess on these floors: {', '.join(GUESSING[:-1])} and {GUESSING[-1]}."
    )
    named = said(differences().clear(), FRONTS, strategies=[*names, GUESSING[0]])
    assert "Left out" not in " ".join(named)


def test_nothing_is_said_to_differ_where_nothing_is_shown() -> None:
    """Negative control."""
    rows = [("fast", name, -1.0, 0.05) for name in ("forced_error", "decision_time_s")]
    found = said(differences(*rows), FRONTS.clear())
    assert found[2].endswith("no significant difference.")
    assert found[3].endswith("no significant difference.")


def test_robots_are_called_too_sure_only_where_it_is_certain() -> None:
    beliefs = pl.DataFrame(
        [
            ("sure", AS_PLAYED, OWN, 0.9, 0.8), ("base", AS_PLAYED, OWN, 0.8, 0.9), ("fast", AT_95, OWN, 0.9, 0.8),
            ("fast", AS_PLAYED, COMMON, 0.8, 0.8),
        ],
        schema=["name", "settings", "prior", "confidence_low", "right_high"],
        orient="row",
    ).with_columns(confidence=pl.col("confidence_low") + 0.2, right=pl.col("right_high") - 0.2)  # fmt: skip
    *_, words = said(differences().clear(), FRONTS, beliefs=beliefs)
    assert words.endswith(
        "than their confidence says, on floors from their own prior: sure; on floors of independent tiles: none found."
    )


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
    assert by_difficulty(floors, 3)["x"].to_list() == ["stripe 0.46", "stripe 0.54"] * 2, "no mirrors"


@pytest.fixture(scope="module")
def standings() -> Standings:
    base = preset("paper").with_values(
        {"run.t_end_s": 60.0, "decision.min_observations": 5, "localisation.method": "true"}
    )
    entries = entries_of(["none", "soft", "places"], {"soft": {"strategy.soft.eta": 321.0}})
    return League(base, entries, floors_of(["stripe"], [0.48]), (3,), runs=3).play()


@pytest.mark.usefixtures("empty_pictures")
def test_every_table_and_figure_is_in_the_document(standings: Standings) -> None:
    tables = league_tables(standings) | {
        "beliefs": belief_calibration(standings.league, runs=2),
        "faults": fault_curves(standings.league, kinds=["stuck_at_1"], most=1, runs=2),
    }
    document = league_document(standings, tables)
    said = document_data(document)
    assert said["answer"][0].startswith("Smallest forced error: ")
    untuned = [entry.label for entry in standings.league.entries if not entry.tuned]
    assert said["warnings"] == [f"Not tuned for a league (`vibroswarm league tune`): {', '.join(untuned)}."]
    assert 0 < len(untuned) < len(standings.league.entries)
    for name, frame in tables.items():
        assert said["tables"][name] == frame.fill_nan(None).to_dicts()
    assert set(document.tables) == {*tables, "costs", "tolerated", "settings"} - {"fronts", "best"}
    assert set(document.figures) == {"front", "beliefs", "faults-stuck_at_1", "floors"}
    by_floor = document.figures["floors"].drawn.numbers
    assert by_floor.filter("best")["value"].unique().to_list() == [by_floor["value"].min()]
    assert "1 robot stuck at 1" in document.figures["faults-stuck_at_1"].drawn.numbers["series"].to_list()
    text = page_html(document)
    assert "Smallest forced error" in text
    assert "strategy.soft.eta = 321.0" in text
    assert page_html(league_document(standings, tables)) == text


def test_what_robots_were_told_is_said_where_they_were_not_told_the_same(standings: Standings) -> None:
    knew = " ".join(league_document(standings).knew)
    assert "places with true places: an upper bound" in knew
    assert "With a wrong grid of tiles places would do worse than by counting." in knew
    same = replace(standings.league, entries=standings.league.entries[:2]).play()
    assert league_document(same).knew == ()


def test_an_entry_of_undefined_error_comes_last_and_is_not_the_best(standings: Standings) -> None:
    first = [entry.label for entry in standings.league.entries].index(standings.table["name"][0])
    errors = standings.values["forced_error"].copy()
    errors[first] = np.nan  # as where no decision is right
    undefined = Standings(standings.league, {**standings.values, "forced_error": errors}, standings.study)
    assert undefined.table["name"][-1] == standings.table["name"][0]
    assert undefined.table["forced_error"].is_null().to_list() == [False, False, True]


def test_differences_of_an_entry_stand_in_one_row(standings: Standings) -> None:
    table = league_document(standings).tables["differences"]
    frame, cells = table.frame, written(table)
    assert frame["name"].to_list() == ["soft", "places"]
    of_p = [k for k, head in enumerate(cells.headings) if head.title == "p"]
    for row in standings.differences().iter_rows(named=True):
        (beside,) = frame.filter(pl.col("name") == row["name"]).to_dicts()
        assert beside[row["figure"]] == row["difference"]
        assert beside[f"{row['figure']}_low"] == row["difference_low"]
        assert beside[f"{row['figure']}_high"] == row["difference_high"]
        assert beside[f"{row['figure']}_p"] == row["p_holm"]
    for row, texts in zip(frame.to_dicts(), cells.rows, strict=True):
        values = [p_value(row[f"{figure}_p"]) for figure in ("forced_error", "decision_time_s")]
        assert [texts[k].text for k in of_p] == values


def test_fronts_come_first_and_every_setting_last() -> None:
    base = preset("paper").with_values({"run.t_end_s": 200.0})
    waits = [0, 5, 40, 80]
    tables = {
        name: [{AIM: 0.07 * k, "decision.min_observations": wait} for k, wait in enumerate(waits)]
        for name in ("none", "soft")
    }
    played = League(
        base, entries_of(list(tables), tables), floors_of(["random"], [0.3]), (4,), runs=12
    ).play()
    document = league_document(played)
    titles = [part.title for part in document.parts if isinstance(part, Section)]
    assert titles[:2] == ["Time at equal error", "One setting of each"]
    assert next(iter(document.figures)) == "fronts"
    numbers = document.figures["fronts"].drawn.numbers
    assert numbers["series"].n_unique() == 2
    assert document.tables["main"].frame["name"].to_list() == sorted(["none 14.0 %", "soft 14.0 %"])
    assert document.tables["standings"].frame.height == 8
    levels = league_document(played, league_tables(played) | {"fronts": FRONTS}).tables["levels"].frame
    assert levels.columns == ["name", "time at 10 %", "time at 20 %"]
    assert levels.rows() == [("base", "-", "500*"), ("sure", "700*", "510*"), ("fast", "open", "533")]
    assert page_html(document)
