"""On what swarms agree, and whether it lasts: by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from vibroswarm.statistics.over_time import agreement_held


def test_an_agreement_lasts_by_hand() -> None:
    """Three robots in five runs, of which the last decided differently; opinions of those with faults do not count."""
    decision = np.array([[1, 1, 1], [1, 1, 1], [1, 1, 1], [0, 0, 0], [0, 1, 1]])
    opinion = np.array([[1, 1, 1], [1, 0, 1], [1, 0, 1], [0, 0, 1], [0, 1, 1]])
    works = np.array([[1, 1, 1], [1, 1, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]])
    swarm = SimpleNamespace(agents={"decision": decision, "opinion": opinion}, failures={"works": works})
    found = agreement_held(swarm, 5)  # type: ignore[arg-type]
    np.testing.assert_array_equal(found, [1.0, 0.0, 1.0, 0.0, np.nan])
