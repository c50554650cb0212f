"""Hashes over the values of whole runs: no change of the code that is not meant may change one bit of them.

The hashes are of values, in the order of the columns named here, so that columns may be renamed and files may change
their form. To renew them after a change of results that is meant (say in the commit what has changed, and why):

    python tests/golden/test_value_hashes.py
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from vibroswarm.optimize.outcomes import outcomes_of
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import simulate, versions

FILE = Path(__file__).with_name("value-hashes.json")
PRESETS = ("paper", "paper-empirical", "text", "calibrated")
SIZES = (1, 5, 10, 30)
STRATEGIES = ("none", "positive", "soft")
VARIANTS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "loss": {"network.name": "loss", "network.loss.share": 0.1},
    "early": {"run.stop": "all_decided", "decision.min_observations": 40},
}
SEED, RUNS = 11, (0, 5)

SAMPLES = {
    "motion": ("run", "robot", "sample", "stop_start_s", "time_s", "x_m", "y_m", "heading_rad", "drive_s", "turn_s",
               "avoid_s", "stop_s"),
    "observations": ("tile", "energy", "observation"),
    "inference": ("message", "alpha", "beta", "messages_received", "belief_below", "decision"),
}  # fmt: skip
OUTCOMES = {
    "robots": ("run", "robot", "decision", "decision_time_s", "belief_at_decision", "belief_below", "belief_in_truth",
               "alpha", "beta", "samples", "sent", "messages_received"),
    "runs": ("run", "consensus_time_s", "fill_ratio", "truth", "right", "wrong", "undecided", "end_s"),
    "ends": ("run", "robot", "end_s", "x_m", "y_m", "heading_rad", "stop_start_s"),
}  # fmt: skip


def scenario_of(name: str, robots: int, strategy: str, variant: str) -> Scenario:
    """A scenario of the table; 30 robots find room in a larger arena."""
    size = {"arena.width_m": 1.8, "arena.height_m": 1.8} if robots == 30 else {}
    values = {"swarm.robots": robots, "strategy.name": strategy, **size, **VARIANTS[variant]}
    return preset(name).with_values(values)


def cases() -> Iterator[tuple[str, int, str, str]]:
    """Preset, robots, strategy and variant of each."""
    for name in PRESETS:
        for robots in SIZES:
            for strategy in STRATEGIES:
                for variant in VARIANTS:
                    yield name, robots, strategy, variant


def column(values: pl.Series) -> bytes:
    """A column as doubles: null is not a number."""
    return np.ascontiguousarray(values.cast(pl.Float64).fill_null(float("nan")).to_numpy()).tobytes()


def hash_of(result: Result, tables: dict[str, Sequence[str]]) -> str:
    """16 hexadecimal digits of the values of these columns."""
    digest = hashlib.sha256()
    for table, names in tables.items():
        for name in names:
            digest.update(column(getattr(result, table)[name]))
    return digest.hexdigest()[:16]


def hash_of_search(scenario: Scenario) -> str:
    """The same of what a search is told of these runs."""
    (found,) = outcomes_of([scenario], SEED, RUNS)
    digest = hashlib.sha256()
    for name in ("run", "decision", "decision_time_s", "estimate", "end_s", "fill_ratio", "truth"):
        digest.update(np.ascontiguousarray(getattr(found, name), dtype=np.float64).tobytes())
    return digest.hexdigest()[:16]


def hashes(name: str, robots: int, strategy: str, variant: str) -> list[str]:
    """Of samples, of outcomes, and of what a search is told."""
    scenario = scenario_of(name, robots, strategy, variant)
    result = simulate(scenario, SEED, RUNS)
    return [hash_of(result, SAMPLES), hash_of(result, OUTCOMES), hash_of_search(scenario)]


MADE_BY = ("numpy", "numba", "scipy", "architecture")
"""Other versions of these may round otherwise."""


def made_by() -> dict[str, str]:
    """The versions that results are repeatable with, to the bit."""
    return {name: versions()[name] for name in MADE_BY}


@pytest.mark.parametrize("case", list(cases()), ids=lambda case: "-".join(map(str, case)))
def test_values_are_as_they_were(case: tuple[str, int, str, str]) -> None:
    kept = json.loads(FILE.read_text())
    if kept["made by"] != made_by():
        pytest.skip(f"the hashes are of {kept['made by']}, here is {made_by()}")
    assert hashes(*case) == kept[" ".join(map(str, case))]


def test_a_changed_value_is_seen() -> None:
    result = simulate(scenario_of("paper", 5, "none", "as it is"), SEED, RUNS)
    other = simulate(scenario_of("paper", 5, "none", "as it is"), SEED + 1, RUNS)
    for tables in (SAMPLES, OUTCOMES):
        assert hash_of(result, tables) != hash_of(other, tables)


if __name__ == "__main__":
    found = {" ".join(map(str, case)): hashes(*case) for case in cases()}
    FILE.write_text(json.dumps({"made by": made_by(), **found}, indent=1) + "\n")
    print(f"wrote {len(found)} cases to {FILE}")
