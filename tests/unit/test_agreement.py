"""On what swarms agree, and whether it lasts: by hand, between the two ways of finding it, and as printed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest

from vibroswarm.analysis.answers_over_time import Agreement, agreements_of, agreements_over_time


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
