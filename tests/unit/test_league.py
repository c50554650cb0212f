"""The league: floors, settings, standings and beliefs against plain loops, and the command."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from helpers.commands import json_of
from vibroswarm.league.entries import FILLS, PATTERNS, entries_of, floors_of, shipped_settings
from vibroswarm.league.fronts import GUESS, LEVELS, guess_level
from vibroswarm.league.play import League, Standings, league_of, play
from vibroswarm.league.standings import COMPARED, ENTRY
from vibroswarm.scenario.scenario import preset
from vibroswarm.search.costs import COSTS
from vibroswarm.search.outcomes import outcomes_of
from vibroswarm.strategies import known, strategy
from vibroswarm.strategies.static_analysis import told
from vibroswarm.study.spec import Study

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
QUICK = ("decision.min_observations=40", "run.t_end_s=400")


def test_floors_are_mirrored() -> None:
    """As many tiles above 1/2 as below: a strategy that leans to one side gains nothing."""
    floors = floors_of()
    assert len(floors) == 2 * len(FILLS) * len(PATTERNS)
    for below, above in zip(floors[::2], floors[1::2], strict=True):
        assert below.name == above.name
        if above.tiles is not None:
            ones = sum(row.count("1") for row in above.tiles)
            assert f"{1 - ones / 100:.2f}" == below.source.rpartition(":")[2]


@pytest.fixture(scope="module")
def standings() -> Standings:
    league = league_of(
        strategy=["none", "soft"], settings=QUICK, untuned=True, vary=["none:decision.credible_threshold=0.8,0.99"],
        patterns=["random"], fills=[0.3, 0.48], robots=[4, 6], runs=12, seed=3,
    )  # fmt: skip
    return play(league, by=("floor", "robots"), reference="soft")


def test_standings_are_as_computed_robot_by_robot(standings: Standings) -> None:
    """With plain loops over the tables, cell by cell; a floor and its mirror are one."""
    table = standings.tables["standings_by"]
    sums: dict[tuple[str, str, int], list[float]] = {}
    names = {floor.source: floor.name for floor in standings.league.floors}
    for cell in standings.runs.cells:
        robots, runs = standings.runs.tables(cell)
        truth = dict(zip(runs["run"], runs["truth"], strict=True))
        size = cell.scenario.swarm.robots
        found = sums.setdefault((cell.point["label"], names[cell.point["floor.source"]], size), [0.0, 0.0])
        for row in robots.iter_rows(named=True):
            p = row["belief_below"]
            leans = 0.5 if p == 0.5 else float(p < 0.5)
            answer = leans if row["decision"] == -1 else row["decision"]
            found[0] += abs(answer - truth[row["run"]]) / (2 * 12 * size)
            found[1] += (row["decision_time_s"] or 400.0) / (2 * 12 * size)
    assert table.height == len(sums) == 3 * 2 * 2
    by_key = {(row["name"], row["floor"], row["robots"]): row for row in table.iter_rows(named=True)}
    for key, figures in sums.items():
        np.testing.assert_allclose([by_key[key][name] for name in COMPARED], figures)
    # Over all, floors and swarm sizes count alike.
    means = {row["name"]: row for row in table.group_by("name").agg(pl.col(COMPARED).mean()).to_dicts()}
    for row in standings.tables["differences"].iter_rows(named=True):
        own, other = means[row["name"]], means["soft"]
        assert row["difference"] == pytest.approx(own[row["figure"]] - other[row["figure"]], abs=1e-12)


def test_time_at_an_error_is_the_least_of_settings_that_err_no_more(standings: Standings) -> None:
    table, points = standings.tables["fronts_by"], standings.tables["standings_by"]
    assert table.height == 4 * len(LEVELS) * 2
    reached = 0
    for row in table.iter_rows(named=True):
        own = points.filter(strategy=row["strategy"], floor=row["floor"], robots=row["robots"])
        times = own.filter(pl.col("forced_error") <= row["forced_error"] + 1e-9)["decision_time_s"]
        assert row["time_s"] == (None if times.is_empty() else pytest.approx(times.min()))
        reached += times.len() > 0
    assert reached
    for name in ("fronts", "standings", "differences", "beliefs"):
        assert set(ENTRY) < set(standings.tables[name].columns)


def test_confidence_is_that_of_plain_loops(standings: Standings) -> None:
    confidence, right = [], []
    for cell in standings.runs.cells:
        if cell.point["label"] == "soft":
            robots, runs = standings.runs.tables(cell)
            for row in robots.join(runs.select("run", "truth"), on="run").iter_rows(named=True):
                if row["decision"] >= 0:
                    below = row["belief_below"]
                    confidence.append(below if row["decision"] == 0 else 1.0 - below)
                    right.append(row["decision"] == row["truth"])
    found = standings.tables["beliefs"].row(by_predicate=pl.col("name") == "soft", named=True)
    assert found["confidence_share"] == pytest.approx(np.mean(confidence))
    assert found["right_share"] == pytest.approx(np.mean(right))


@pytest.mark.slow
def test_robots_that_think_their_sensors_too_good_are_too_confident() -> None:
    """At their own error rates robots are as right as they believe where the floors are those of their prior."""
    shared = ["decision.boundary_of=tiles", "decision.min_observations=0", "run.t_end_s=300"]
    fooled = ["decision.assumed_false_positive=0.02", "decision.assumed_false_negative=0.3"]
    fills = [k / 20 for k in range(1, 10)]
    tables = [
        play(league_of(strategy="none", settings=[*shared, *more], untuned=True, patterns=["random"],
                       fills=fills, robots=[4], runs=60)).tables["beliefs"]
        for more in ([], fooled)
    ]  # fmt: skip
    assert [table["too_confident"].item() for table in tables] == [False, True]


@pytest.mark.usefixtures("blank_pictures")
def test_the_command_plays_settings_of_a_file_and_own_strategies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, file, folder = tmp_path / "guesses.py", tmp_path / "settings.toml", tmp_path / "a league"
    code.write_text(GUESSES, encoding="utf-8")
    file.write_text('[none]\n"decision.min_observations" = 1000\n', encoding="utf-8")
    line = [
        *("league", "--strategy", f"none,soft,{code}:guess", "--settings", str(file), "--runs", "4"),
        *("--patterns", "stripe", "--fills", "0.48", "--robots", "4", "--set", "run.t_end_s=60"),
        *("--vary", "guess:strategy.guess.answer=0,1", "--by", "robots", "--out", str(folder), "--json"),
    ]
    said = json_of(capsys, *line)
    rows = {row["name"]: row for row in pl.read_csv(folder / "standings.csv").iter_rows(named=True)}
    assert set(rows) == {"none", "soft", "guess (answer 0)", "guess (answer 1)"}
    assert rows["none"]["undecided_share"] == 1.0
    # Of a guess that is the same on floors of both sides the error is known.
    assert {rows[f"guess (answer {k})"]["forced_error"] for k in (0, 1)} == {0.5}
    assert json_of(capsys, *line) == said


def test_a_league_of_three_kinds_gives_each_kind_each_share() -> None:
    league = league_of(shares=[0.4, 0.36, 0.24], settings=["run.t_end_s=100"], robots=[5], runs=8)
    assert [entry.name for entry in league.entries] == [
        "dirichlet", "dirichlet_positive", "dirichlet_soft", "averaging"
    ]  # fmt: skip
    assert [floor.source for floor in league.floors] == [
        "random:0.4,0.36,0.24", "random:0.24,0.4,0.36", "random:0.36,0.24,0.4"
    ]  # fmt: skip
    assert guess_level(league.base) == pytest.approx(GUESS * 4 / 3)
    table = play(league).tables["standings"]
    # robots that have not decided count as guesses among three answers
    np.testing.assert_allclose(table["forced_error"], table["wrong_share"] + table["undecided_share"] * 2 / 3)


def test_settings_that_ship_play() -> None:
    for own_motion in (False, True):
        settings = shipped_settings(own_motion)
        league = League(preset("paper"), entries_of([*settings], settings), floors_of(["random"], [0.48]))
        assert len(league.study.cells) == 4 * len(league.entries)


def test_what_a_robot_knows_is_as_documented() -> None:
    """Read from the sources here, written by hand in the documentation."""
    page = Path(__file__).parents[2] / "docs" / "strategies.md"
    lines = page.read_text(encoding="utf-8").splitlines()
    rows = [line.split("|")[1:-1] for line in lines if line.startswith("| `")]
    stated = {
        name.strip(" `"): cells[-1].strip()
        for cells in rows if len(cells) == 5 for name in cells[0].split(",")
    }  # fmt: skip
    assert set(stated) == set(known())
    for name, text in stated.items():
        facts = [fact for fact in told(strategy(name), "tiles") if fact != "boundary"]
        assert (", ".join(facts) or "-") == text, name


def test_searches_minimise_the_forced_error_that_tables_have() -> None:
    scenario = preset("paper").with_values({"strategy.name": "soft", "run.t_end_s": 300.0})
    (outcomes,) = outcomes_of([scenario], 3, range(12))
    found = COSTS["forced_error"](outcomes)[:, 0]
    assert found.any()
    np.testing.assert_allclose(found, Study(scenario, runs=12, seed=3).run().frame["forced_error"])
