"""On what swarms agree, and whether it lasts: by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from vibroswarm.statistics.answers_over_time import agreements_of


def test_an_agreement_lasts_by_hand() -> None:
    """Three robots in five runs, of which the last decided differently; opinions of those with faults do not count."""
    decision = np.array([[1, 1, 1], [1, 1, 1], [1, 1, 1], [0, 0, 0], [0, 1, 1]])
    opinion = np.array([[1, 1, 1], [1, 0, 1], [1, 0, 1], [0, 0, 1], [0, 1, 1]])
    works = np.array([[1, 1, 1], [1, 1, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]])
    swarm = SimpleNamespace(agents={"decision": decision, "opinion": opinion}, failures={"works": works})
    found = agreements_of(swarm, range(3, 8))  # type: ignore[arg-type]
    assert found.rows() == [(3, True), (4, False), (5, True), (6, False)]
