"""On what swarms agree, and whether it lasts: by hand, between the two ways of finding it, and as printed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest

from helpers.commands import words_of
from vibroswarm.analysis.answers_over_time import Agreement, agreements_of, agreements_over_time
from vibroswarm.analysis.intervals import wilson
from vibroswarm.analysis.verdict import agreement_words, headline, verdict
from vibroswarm.cli import main
from vibroswarm.result import Result
from vibroswarm.scenario.plugins import trust_code
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import simulate
from vibroswarm.study.spec import Study
from vibroswarm.study.summary import outcome_of

VOTER = Path(__file__).parents[2] / "examples/strategies/voter.py"
EVEN = {"floor.source": "random:0.5", "floor.rows": 10, "floor.columns": 10}


@pytest.fixture(scope="module")
def voters() -> Scenario:
    """Robots on an even floor whose opinions change also after they have decided."""
    with trust_code():
        return preset("paper").with_values(
            EVEN | {"strategy.name": f"{VOTER}:voter", "decision.hold_s": 10.0}
        )


@pytest.fixture(scope="module")
def voted(voters: Scenario) -> Result:
    return simulate(voters, 3, range(20))


def by_hand(rows: list[tuple[int, int, float, int | None]], faulty: list[int]) -> Any:
    """A result from robot, sample, time and opinion in run 0; robot 9 of run 1 works."""
    columns = [pl.Series("run", [0] * len(rows) + [1], pl.UInt32)]
    every = [*rows, (9, 0, 1.0, 1)]
    samples = pl.DataFrame(
        every, schema=["robot", "sample", "time_s", "decision"], orient="row"
    ).with_columns(columns)
    robots = samples.select("run", "robot").unique().with_columns(decision=pl.lit(-1))
    faults = samples.select("run", "robot").unique().filter(pl.col("robot").is_in(faulty)) if faulty else None
    return SimpleNamespace(inference=samples, motion=samples, robots=robots, faults=faults)


ROWS: list[tuple[int, int, float, int | None]] = [
    (0, 0, 5.0, 1), (1, 0, 6.0, -1), (2, 0, 7.0, 0), (1, 1, 10.0, 1), (2, 1, 12.0, 1), (0, 1, 15.0, 1),
    (1, 2, 20.0, 0), (0, 2, 21.0, 0), (2, 2, 25.0, 0), (0, 3, 40.0, 0),
]  # fmt: skip


@pytest.mark.parametrize(
    ("faulty", "spans"),
    [
        ([], [Agreement(1, 12.0, 20.0), Agreement(0, 25.0, None)]),
        ([2], [Agreement(1, 10.0, 20.0), Agreement(0, 21.0, None)]),
        ([0, 1, 2], [Agreement(1, 12.0, 20.0), Agreement(0, 25.0, None)]),  # all count where all have faults
        ([0, 2], [Agreement(1, 10.0, 20.0), Agreement(0, 20.0, None)]),
    ],
)
def test_agreements_over_time_by_hand(faulty: list[int], spans: list[Agreement]) -> None:
    assert agreements_over_time(by_hand(ROWS, faulty), 0) == spans


def test_an_agreement_lasts_by_hand() -> None:
    """Three robots in five runs, of which the last decided differently; opinions of those with faults do not count."""
    decision = np.array([[1, 1, 1], [1, 1, 1], [1, 1, 1], [0, 0, 0], [0, 1, 1]])
    opinion = np.array([[1, 1, 1], [1, 0, 1], [1, 0, 1], [0, 0, 1], [0, 1, 1]])
    works = np.array([[1, 1, 1], [1, 1, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]])
    swarm = SimpleNamespace(agents={"decision": decision, "opinion": opinion}, failures={"works": works})
    found = agreements_of(swarm, range(3, 8))  # type: ignore[arg-type]
    assert found.rows() == [(3, True), (4, False), (5, True), (6, False)]


def test_opinions_that_are_not_logged_agree_on_nothing() -> None:
    unknown = [(robot, sample, time_s, None) for robot, sample, time_s, _ in ROWS]
    assert agreements_over_time(by_hand(unknown, []), 0) == []


def lasts(result: Result, run: int) -> bool | None:
    """Whether the agreement on the decision lasts to the end of the run; None if the robots did not agree on one."""
    decisions = result.robots.filter(pl.col("run") == run)["decision"].unique().to_list()
    if len(decisions) > 1 or decisions == [-1]:
        return None
    spans = agreements_over_time(result, run)
    return bool(spans) and spans[-1].until_s is None and spans[-1].answer == decisions[0]


def test_a_study_counts_the_agreements_that_single_runs_show(voters: Scenario, voted: Result) -> None:
    with trust_code():
        study = Study.of(voters, runs=20, seed=3)
    result = study.run()
    table = result.agreements(0)
    assert table is not None
    # The study reads opinions after the last event, the result after the last sample: a timer may lie between.
    differ = [
        run for run, holds in table.select("run", "holds").iter_rows() if lasts(voted, run) is not holds
    ]
    assert len(differ) <= 1
    assert 0 < table["holds"].sum() < table.height  # both happen
    figures = outcome_of(result, compare=False).cells[0].summary
    assert figures.agreement_lasted == wilson(int(table["holds"].sum()), table.height)
    decisions = voted.robots.group_by("run").agg(pl.col("decision").unique())["decision"].to_list()
    for answer, share in ((0, figures.agreed_on_0), (1, figures.agreed_on_1)):
        assert share == wilson(sum(one == [answer] for one in decisions), 20)
    assert figures.swarm_truth_undefined.estimate == pytest.approx(
        figures.agreed_on_0.estimate + figures.agreed_on_1.estimate
    )


def test_a_lost_agreement_is_said(voted: Result) -> None:
    found = verdict(voted, next(run for run in range(20) if lasts(voted, run) is False))
    assert "Agreement did not last: all agreed on '" in agreement_words(found)
    assert agreement_words(found).endswith("opinions differ at the end.")
    # The control: agreements that last, or that ended before the swarm had decided.
    kept = replace(
        found, agreements=(Agreement(1, 5.0, 9.0), Agreement(1, 300.0, None)), consensus_time_s=300.0
    )
    assert agreement_words(kept) == ""
    assert found.as_dict()["agreements"][0].keys() == {"answer", "since_s", "until_s"}


def test_a_split_where_nothing_is_right_says_its_sides() -> None:
    result = simulate(preset("paper").with_values(EVEN | {"strategy.name": "dmmd"}), 3, range(6))
    split = verdict(result, result.runs["consensus"].to_list().index("split"))
    low = sum(robot.decision == 0 for robot in split.robots)
    assert headline(split) == (
        f"SPLIT: all 5 robots decided, but differently: {low} 'less than 50 % vibrates', {5 - low} 'more than 50 % "
        "vibrates'."
    )
    nobody = simulate(preset("paper").with_values(EVEN | {"run.t_end_s": 60.0}), 3, 1)
    assert headline(verdict(nobody)).endswith("(none decided).")
    two = replace(split, robots=split.robots[:2])
    assert headline(two).startswith("SPLIT: both robots decided, but")


def test_evaluate_says_on_what_swarms_agreed(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    command = [
        "evaluate",
        "--runs",
        "20",
        "--tiles",
        "10x10",
        "--strategy",
        "dmvd",
        "--no-confirm",
        "--no-pictures",
    ]
    printed = words_of(capsys, *command, "--floor", "random:0.5", "--out", str(tmp_path / "even"))
    assert "Swarms agreed on 'less than 50 % vibrates' in " in printed
    assert "agreed on answer 0, %" in printed
    assert "cell robots undecided, % decision time, s" in printed  # no swarm is right or wrong
    assert "asted" not in printed  # decisions of dmvd are final: nothing that could last or not
    command[command.index("dmvd")] = f"{VOTER}:voter"
    printed = words_of(capsys, *command, "--floor", "random:0.5")  # whose opinions may change
    assert "Lasted: share of the agreements that held at the end" in printed
    assert "lasted, %" in printed
    assert main([*command, "--floor", "random:0.44", "--out", str(tmp_path / "less")]) == 0
    assert "agreed on" not in capsys.readouterr().out  # the control: there an answer is right
