"""The league: forced error, floors, standings by another way, fronts, and strategies of which the error is known."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.commands import json_of, output_of, refusal_of
from helpers.forked import FORKED
from vibroswarm.cli import main
from vibroswarm.errors import InputError
from vibroswarm.inference.outcomes import forced_errors
from vibroswarm.league.entries import (
    FILLS,
    PATTERNS,
    SIZE,
    default_strategies,
    entries_of,
    floors_of,
    read_settings,
    varied_by,
)
from vibroswarm.league.fronts import NOT, OPEN, REACHES, front_table
from vibroswarm.league.standings import League, Standings
from vibroswarm.scenario.scenario import preset
from vibroswarm.statistics.figures import run_figures
from vibroswarm.statistics.fronts import front_of
from vibroswarm.study import run as study_run

pytestmark = pytest.mark.usefixtures("without_layout")

BASE = preset("paper").with_values({"decision.min_observations": 40, "run.t_end_s": 400.0})
GUESSES = '''"""Strategies that read nothing."""
from vibroswarm.strategies import strategy_in, u


class Params:
    answer: float = 0.5


class State:
    answer: int


def begin(s, a, d, p, w):
    s.answer = int(u(d, 0) < p.answer)


def on_message(s, a, m, sender, t_s, d, p, w):
    pass


def on_sample(s, a, x, out, d, p, w):
    return False


def decision(s, a, p, w):
    return s.answer


guess = strategy_in(__name__, "guess", decides="opinion", about="a guess at the start")
'''


@pytest.mark.parametrize(
    ("decision", "in_truth", "truth", "error"),
    [
        (1, 0.1, 1, 0.0),
        (0, 0.9, 1, 1.0),
        (0, math.nan, 0, 0.0),
        (-1, 0.51, 1, 0.0),
        (-1, 0.49, 0, 1.0),
        (-1, 0.5, 0, 0.5),
        (-1, math.nan, 1, 0.5),
        (1, 0.9, math.nan, math.nan),
    ],
)
def test_forced_error_of_a_robot(decision: int, in_truth: float, truth: float, error: float) -> None:
    found = forced_errors(np.array([decision]), np.array([in_truth]), np.array([truth]))
    assert found[0] == error or (math.isnan(error) and math.isnan(found[0]))


def test_floors_are_mirrored() -> None:
    """As many tiles above 1/2 as below: a strategy that leans to one side gains nothing."""
    floors = floors_of()
    assert len(floors) == 2 * len(FILLS) * len(PATTERNS)
    assert sum(floor.fill_ratio for floor in floors) / len(floors) == pytest.approx(0.5)
    for floor in floors:
        if floor.tiles is not None:
            ones = sum(row.count("1") for row in floor.tiles)
            assert ones / 100 == pytest.approx(floor.fill_ratio)
            assert floor.fill_ratio > 0.5
    with pytest.raises(InputError, match=r"0\.3"):
        floors_of(["stripe"], [0.3])


POINTS = st.lists(
    st.tuples(st.integers(0, 9).map(float), st.integers(0, 9).map(float)), min_size=1, max_size=12
)


@given(POINTS)
def test_a_front_is_what_no_other_point_beats(points: list[tuple[float, float]]) -> None:
    """By brute force."""
    x, y = front_of(*np.array(points).T)
    assert (np.diff(x) > 0).all()
    assert (np.diff(y) < 0).all()
    best = {(a, b) for a, b in points if not any((c, e) != (a, b) and c <= a and e <= b for c, e in points)}
    assert set(zip(x.tolist(), y.tolist(), strict=True)) == best


@pytest.fixture(scope="module")
def standings() -> Standings:
    entries = varied_by(entries_of(["none", "soft"], {}), "none:decision.credible_threshold=0.8,0.99")
    return League(BASE, entries, floors_of(["random", "stripe"], [0.48]), (4, 6), runs=12, seed=3).play()


def test_standings_are_as_computed_robot_by_robot(standings: Standings) -> None:
    """With plain loops over the tables, cell by cell."""
    league, study = standings.league, standings.study
    assert [entry.label for entry in league.entries] == [
        "none (credible_threshold 0.8)", "none (credible_threshold 0.99)", "soft",
    ]  # fmt: skip
    number = 0
    for k, entry in enumerate(league.entries):
        units = np.zeros((2, 12, 3))
        for _floor in league.floors:
            for size in range(2):
                cell = study.cells[number]
                assert cell.scenario.strategy.name == entry.strategy
                assert cell.scenario.swarm.robots == league.robots[size]
                robots, runs = study.tables(cell)
                truth = dict(zip(runs["run"], runs["truth"], strict=True))
                for row in robots.iter_rows(named=True):
                    right = truth[row["run"]]
                    p = row["belief_below"]
                    leans = 0.5 if p == 0.5 else 1.0 if p < 0.5 else 0.0
                    answer = leans if row["decision"] == -1 else row["decision"]
                    units[size, row["run"]] += (
                        abs(answer - right), row["decision_time_s"] or 400.0, row["sent"],
                    ) / np.array([league.robots[size] * len(league.floors)])  # fmt: skip
                assert run_figures(robots, runs, 400.0)["forced_error"].mean() == pytest.approx(
                    standings.values["forced_error"][k, number // 2 % 4, 12 * size : 12 * size + 12].mean()
                )
                number += 1
        for place, figure in enumerate(("forced_error", "decision_time_s", "sent")):
            np.testing.assert_allclose(standings.by_unit(k, figure), units[..., place].ravel())
    assert number == len(study.cells)


def test_tables(standings: Standings) -> None:
    table, differences = standings.table, standings.differences("soft")
    assert table["forced_error"].is_sorted()
    np.testing.assert_allclose((table["right"] + table["wrong"] + table["undecided"]).to_numpy(), 1.0)
    assert standings.floor_table.height == 3 * 4
    assert set(differences["reference"]) == {"soft"}
    means = dict(zip(table["name"], table["decision_time_s"], strict=True))
    for row in differences.filter(pl.col("figure") == "decision_time_s").iter_rows(named=True):
        assert row["difference"] == pytest.approx(means[row["name"]] - means["soft"])
    with pytest.raises(InputError, match="positive"):
        standings.differences("positive")
    assert table["told"].to_list() == ["boundary"] * 3


def test_the_worst_floor_is_measured_by_other_motions(standings: Standings) -> None:
    """With one entry's errors replaced: on each floor one share in the motions that choose, another in the rest."""
    errors = np.empty((4, 24))
    errors[:, ::2] = np.array([0.1, 0.3, 0.2, 0.2])[:, None]
    errors[:, 1::2] = np.array([0.9, 0.05, 0.8, 0.7])[:, None]
    values = {**standings.values, "forced_error": np.array([errors] * 3)}
    alike = Standings(standings.league, values, standings.study)
    floor, error = alike.worst_floor(0)
    assert floor == standings.league.floors[1]
    assert error.estimate == pytest.approx(0.05)
    assert alike.table["decision_time_s"].is_sorted(), "where errors are equal"


def test_differences_floor_by_floor(standings: Standings) -> None:
    table = standings.floor_differences("soft")
    assert table.height == 2 * 4 * 2
    smallest = table.filter(pl.col("figure") == "decision_time_s")["p_value"].min()
    held = table.filter(pl.col("figure") == "decision_time_s")["p_holm"].min()
    assert held == pytest.approx(min(8 * smallest, 1.0))  # two entries, four floors
    for row in table.iter_rows(named=True):
        of = {
            floor["name"]: floor[row["figure"]]
            for floor in standings.floor_table.iter_rows(named=True)
            if (floor["pattern"], floor["fill_ratio"]) == (row["pattern"], row["fill_ratio"])
        }
        assert row["difference"] == pytest.approx(of[row["name"]] - of["soft"])
    with pytest.raises(InputError, match="positive"):
        standings.floor_differences("positive")


def test_fronts(standings: Standings) -> None:
    """Read between two settings, as a mixture of runs would have it."""
    table = front_table(standings)
    assert table.height == 6 * 2
    names = [(row["strategy"], row["level"]) for row in table.iter_rows(named=True)]
    assert names == [
        (name, level) for level in (0.01, 0.02, 0.05, 0.1, 0.15, 0.2) for name in ("none", "soft")
    ]
    assert set(table["reached"]) <= {REACHES, OPEN, NOT}
    times, errors = (
        [standings.interval(k, name).estimate for k in (0, 1)] for name in ("decision_time_s", "forced_error")
    )
    for row in table.filter(strategy="none").iter_rows(named=True):
        if errors[1] <= row["level"] <= errors[0]:
            share = (errors[0] - row["level"]) / (errors[0] - errors[1])
            assert row["time_s"] == pytest.approx(times[0] + share * (times[1] - times[0]))
        else:
            assert row["time_s"] is None
        assert (row["time_s_low"] is not None) == (row["reached"] == REACHES) == (row["in_group"] is not None)
    assert front_table(standings).equals(table)


SMALL = [
    *("--runs", "4", "--patterns", "stripe", "--fills", "0.48", "--robots", "4"),
    *("--strategy", "none,soft"),
]
FEW = ["--belief-runs", "2"]
NONE = ["--belief-runs", "0"]
QUICK = ["--set", "run.t_end_s=60", "--set", "decision.min_observations=5", "--untuned"]


@pytest.mark.usefixtures("blank_pictures")
def test_the_command_saves_its_tables_and_goes_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "a league"
    line = ["league", *FEW, *SMALL, *QUICK, "--out", str(folder)]
    said = output_of(capsys, *line)
    assert said.startswith("Smallest forced error: ")
    kept = {file.name: file.read_bytes() for file in folder.glob("*.csv")}
    tables = (
        "standings",
        "differences",
        "floor_differences",
        "fronts",
        "best",
        "floors",
        "beliefs",
        "summary",
    )
    assert set(kept) == {f"{name}.csv" for name in tables}
    document = json_of(capsys, *line, "--json", "--workers", "1")
    assert {row["name"] for row in document["tables"]["standings"]} == {"none", "soft"}
    assert {file.name: file.read_bytes() for file in folder.glob("*.csv")} == kept


def test_settings_come_from_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "settings.toml"
    file.write_text('[none]\n"decision.min_observations" = 1000\n', encoding="utf-8")
    document = json_of(capsys, "league", *NONE, *SMALL, *QUICK[:-1], "--settings", str(file), "--json")
    rows = {row["name"]: row for row in document["tables"]["standings"]}
    assert rows["none"]["undecided"] == 1.0
    assert rows["soft"]["undecided"] < 1.0


@pytest.mark.slow
def test_a_strategy_of_the_users_own_plays_and_is_tuned(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study_run.multiprocessing, "get_context", lambda method: FORKED)
    code = tmp_path / "guesses.py"
    code.write_text(GUESSES, encoding="utf-8")
    line = [*SMALL[:-1], f"none,{code}:guess"]
    vary = ["--vary", "guess:strategy.guess.answer=0,1"]
    more = ("--json", "--executor", "processes", "--workers", "1")
    document = json_of(capsys, "league", *FEW, *line, *QUICK, *vary, *more)
    rows = {row["name"]: row for row in document["tables"]["standings"]}
    assert set(rows) == {"none", "guess (answer 0)", "guess (answer 1)"}
    # Of a guess that is the same on floors of both sides the error is known.
    assert {rows[f"guess (answer {k})"]["forced_error"] for k in (0, 1)} == {0.5}
    spaces, found = tmp_path / "spaces.toml", tmp_path / "found.toml"
    own = [*SMALL[:-1], f"{code}:guess", *QUICK[:-1], "--points", "4"]
    assert "no space to search for 'guess'; give one in a file (--spaces" in refusal_of(
        capsys, "league", "tune", *own, "--out", str(found)
    )
    assert not list(tmp_path.glob("found*"))
    spaces.write_text('[guess]\n"strategy.guess.answer" = { from = 0.0, to = 1.0 }\n', encoding="utf-8")
    assert main(["league", "tune", *own, "--spaces", str(spaces), "--out", str(found)]) == 0
    assert set(read_settings(found)) == {"guess"}
    assert main(["league", *NONE, *line, *QUICK[:-1], "--settings", str(found), "--json"]) == 0


def test_a_league_of_three_kinds_gives_each_kind_each_share() -> None:
    from vibroswarm.league.entries import floors_of_kinds
    from vibroswarm.league.fronts import GUESS, guess_level

    floors = floors_of_kinds((0.4, 0.36, 0.24))
    assert [floor.source for floor in floors] == [
        "random:0.4,0.36,0.24", "random:0.24,0.4,0.36", "random:0.36,0.24,0.4"
    ]  # fmt: skip
    for shares in ((0.4, 0.6), (0.4, 0.4, 0.2)):
        with pytest.raises(InputError, match="three shares or more that differ"):
            floors_of_kinds(shares)
    assert default_strategies(3) == ["dirichlet", "dirichlet_positive", "dirichlet_soft", "averaging"]
    base = preset("paper").with_values(
        {
            "sensor.model": "confusion",
            "floor.source": floors[0].source,
            "task.name": "majority",
            "strategy.name": "dirichlet",
            "run.t_end_s": 100.0,
            **SIZE,
        }
    )
    entries = entries_of(["dirichlet", "dirichlet_soft"], {})
    standings = League(base, entries, floors, (5,), runs=8).play()
    assert standings.values["forced_error"].shape == (2, 3, 8)
    # robots that have not decided count as guesses among three answers
    undecided, wrong = (standings.values[name] for name in ("undecided", "wrong"))
    np.testing.assert_allclose(standings.values["forced_error"], wrong + undecided * 2 / 3)
    assert guess_level(standings.league.base) == pytest.approx(GUESS * 4 / 3)


def test_who_always_gives_the_cheap_answer_guesses() -> None:
    from vibroswarm.inference.outcomes import costs_of, forced_errors
    from vibroswarm.league.fronts import GUESS, guess_level

    truth, nothing = np.array([0.0, 1.0]), np.full(2, np.nan)
    for costs in ([[0.0, 1.0], [0.1, 0.0]], [[0.0, 1.0], [1.0, 0.0]], [[0.0, 1.0], [4.0, 0.0]]):
        base = preset("paper").with_values({"task.costs": costs})
        always = [forced_errors(np.full(2, k), nothing, truth, costs_of(base)).mean() for k in (0, 1)]
        assert guess_level(base) == pytest.approx(GUESS / 0.5 * min(always))
