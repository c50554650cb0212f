"""Which cells of a study are compared, and with what."""

from __future__ import annotations

import polars as pl
import pytest

from vibroswarm.scenario.scenario import preset
from vibroswarm.study.comparison import (
    comparison_table,
    comparisons,
    pairs_of,
)
from vibroswarm.study.runs import Runs
from vibroswarm.study.spec import Study

SHORT = preset("paper").with_values({"run.t_end_s": 200.0, "decision.min_observations": 60})


def names(study: Study) -> list[str]:
    return [f"{cell.name} | {reference.name} | {field}" for cell, reference, field in pairs_of(study.cells)]


def test_numbers_are_compared_only_where_nothing_else_varies() -> None:
    assert names(Study.of(SHORT, 1, swarm__robots=[5, 6])) == ["robots 6 | robots 5 | swarm.robots"]
    soft = SHORT.with_values({"strategy.name": "soft"})
    assert names(Study.of(soft, 1, swarm__robots=[5, 6], strategy__soft__eta=[0.0, 1.0])) == []
    assert names(Study.of(SHORT, 1, swarm__robots=list(range(1, 11)))) == []


def test_floors_are_never_compared_and_one_cell_has_nothing_to_be_compared_with() -> None:
    assert names(Study.of(SHORT, 1, floor__source=["random:0.44", "random:0.48"])) == []
    assert names(Study.of(SHORT, 1)) == []


@pytest.fixture(scope="module")
def result() -> Runs:
    return Study.of(SHORT, 60, strategy__name=["none", "soft"], decision__gate=["total", "own"]).run()


def test_differences_are_those_of_the_paired_runs(result: Runs) -> None:
    found = comparisons(result)
    assert len(found) == 4 * 6  # four pairs, six figures
    one = next(
        c for c in found if c.pair.name == "soft - none (gate total)" and c.paired.figure == "decision_time_s"
    )
    capped = pl.col("decision_time_s").fill_null(200.0).mean()
    by_run = [
        result.tables(cell)[0].group_by("run", maintain_order=True).agg(capped)["decision_time_s"]
        for cell in one.pair[:2]
    ]
    assert one.paired.difference.estimate == pytest.approx((by_run[0] - by_run[1]).mean())
    assert one.paired.pairs == 60
    assert one.paired.wins + one.paired.ties + one.paired.losses == 60


def test_p_values_are_corrected_over_all_comparisons(result: Runs) -> None:
    found = comparisons(result)
    known = [c.paired for c in found if c.paired.p_value == c.paired.p_value]
    smallest = min(known, key=lambda paired: paired.p_value)
    assert smallest.p_holm == pytest.approx(min(1.0, len(known) * smallest.p_value))
    assert all(paired.p_holm >= paired.p_value for paired in known)


def test_the_table_has_a_row_a_comparison_and_plain_columns(
    result: Runs,
) -> None:
    table = comparison_table(comparisons(result))
    assert table.height == 24
    assert {
        "name",
        "figure",
        "difference",
        "difference_low",
        "p_holm",
    } <= set(table.columns)
    assert not any(dtype.is_nested() for dtype in table.dtypes)


def test_the_forced_error_of_a_run_is_that_of_its_robots(result: Runs) -> None:
    """By a loop over robots, from the definition: wrong, or undecided and leaning to the wrong side."""
    one = next(c for c in comparisons(result) if c.paired.figure == "forced_error")
    means = []
    for cell in one.pair[:2]:
        robots, runs = result.tables(cell)
        truth = dict(runs.select("run", "truth").iter_rows())
        errors: dict[int, list[float]] = {}
        for row in robots.iter_rows(named=True):
            belief, decision = row["belief_in_truth"], row["decision"]
            leans = 0.5 if belief is None or belief == 0.5 else float(belief < 0.5)
            error = leans if decision == -1 else float(decision != truth[row["run"]])
            errors.setdefault(row["run"], []).append(error)
        means.append(sum(sum(e) / len(e) for e in errors.values()) / len(errors))
    assert one.paired.difference.estimate == pytest.approx(means[0] - means[1])
