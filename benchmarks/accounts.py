"""Whether all accounts of a run agree, in scenarios drawn over all that a scenario has beside motion.

    python benchmarks/accounts.py [--scenarios 300] [--seed 1]

Strategies, networks, sensors, tasks, floors, changes, faults, localisation and decisions are drawn; ``exactness.py
--random`` draws motion. Runs simulated together must equal those of: the run alone, the other engine, plain Python, a
search, a study, the stored result, a replay, and the scenario read back from TOML. Scenarios that are refused are
counted by their reason. Exit code 1 if two accounts differ, or one raises anything but an ``InputError``.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from polars.testing import assert_frame_equal

from vibroswarm import InputError, Result, Scenario, Study, networks, replay, simulate, strategies, tasks
from vibroswarm.localisation.locate import is_estimated
from vibroswarm.optimize.outcomes import from_tables, outcomes_of
from vibroswarm.scenario.scenario import differences
from vibroswarm.simulation import steers
from vibroswarm.study.run import run as run_study
from vibroswarm.testing import plain_run
from vibroswarm.testing.runs import differences as differing

SEED, RUNS = 9, [0, 1, 3]
PLAIN_SAMPLES = 900
"""Samples up to which a run is repeated in plain Python, which is slow."""
PLACES = ("x_m", "y_m", "heading_rad")
"""Columns in which the engines may differ by rounding."""
FLOORS = (
    ("random:0.48", 5, 5), ("random:0.4", 5, 5), ("random:0", 3, 4), ("random:1", 1, 7), ("diagonal:0.46", 5, 5),
    ("random:0.5", 2, 2), ("random:0.5", 4, 6), ("random:0.03", 10, 10),
)  # fmt: skip
THREE_KINDS = {
    "sensor.confusion.kinds": 3,
    "sensor.confusion.rates": [[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.05, 0.15, 0.8]],
    "floor.source": "ours",
    "floor.tiles": ["012", "120", "201"],
    "task.name": "majority",
}
CHOICES: dict[str, tuple[Any, ...]] = {
    "strategy.name": tuple(strategies.known()),
    "network.name": ("ideal", *networks.known()),
    "task.name": (*(["fill_ratio"] * 20), *tasks.known()),
    "swarm.robots": (1, 2, 3, 5, 5, 7, 12),
    "run.t_end_s": (0.02, 3.0, 20.0, 60.0, 110.0, 300.0),
    "run.stop": ("t_end", "t_end", "all_decided"),
    "run.control_period_ms": (20, 20, 20, 50, 13),
    "sample.sample_interval_ms": (500.0, 2000.0, 3778.0),
    "sample.stop_ms": (0.0, 100.0, 1000.0),
    "decision.min_observations": (0, 1, 12, 50),
    "decision.gate": ("total", "received", "own"),
    "decision.credible_threshold": (0.6, 0.8, 0.95, 0.999),
    "decision.revise": (False, False, False, True),
    "decision.gate_counts_current": (False, False, True),
    "decision.hold_s": (0.0, 1.0, 30.0),
    "decision.prior_alpha": (1, 1, 3),
    "decision.prior_beta": (1, 1, 7),
    "decision.decision_boundary": (*([0.5] * 8), 0.2, 0.03),
    "decision.boundary_of": ("readings", "readings", "readings", "tiles"),
    "localisation.method": ("auto", "true", "mixture"),
    "odometry.level": ("good", "poor"),
    "rays.noise_m": (0.0, 0.0, 0.005),
}
SOMETIMES: tuple[dict[str, Any], ...] = (
    {"change.at_s": [1.0, 30.0], "change.to": ["invert"]},
    {"change.at_s": [55.0], "change.to": ["redraw"]},
    {"change.rate_per_h": 200.0},
    {"sensor.edge_reach_m": -0.01, "sensor.edge_blur_m": 0.01, "sensor.tile_spread": 0.3, "sensor.robot_spread": 0.2},
    {"sensor.model": "energies", "sensor.vibrating_energies": [1.0, 2.0, 2.5], "sensor.still_energies": [0.5, 1.4]},
    {"sensor.model": "acceleration", "sample.stop_ms": 1000.0},
    {"sensor.model": "confusion"},
    {"sensor.model": "confusion", **THREE_KINDS},
    {"faults.stopped": 0.5, "faults.stopped_from_s": 30.0},
    {"faults.stopped": 1.0},
    {"faults.stuck_at_0": 0.2, "faults.opposite": 0.5},
    {"faults.biased": 0.4, "faults.misread_shift": 0.1},
    {"faults.radio_dead": 0.5, "faults.radio_dead_from_s": 5.0},
    {"faults.battery_empty": 0.5, "faults.battery_life_s": 60.0},
)  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenarios", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    refused, wrong = Counter[str](), 0
    for number in range(options.scenarios):
        try:
            wrong += sum(1 for _ in tell_differences(drawn(options.seed, number), number))
        except InputError as error:
            refused[str(error).partition(":")[0]] += 1
    compared = options.scenarios - refused.total()
    print(
        f"{compared} scenarios compared, in {wrong} accounts something else; {refused.total()} refused: {refused}"
    )
    return 1 if wrong or not compared else 0


def drawn(seed: int, number: int) -> Scenario:
    """Return scenario ``number`` of a seed.

    Raises:
        InputError: what was drawn does not fit together.
    """
    choose = random.Random(f"{seed}, {number}")
    values = {name: choose.choice(some) for name, some in CHOICES.items()}
    values["floor.source"], values["floor.rows"], values["floor.columns"] = choose.choice(FLOORS)
    for more in choose.sample(SOMETIMES, choose.choice((0, 1, 2, 3))):
        values |= more
    return Scenario().with_values(values)


def tell_differences(scenario: Scenario, number: int) -> Any:
    """Yield the name of each account that differs from the runs simulated together, and print how.

    Raises:
        InputError: the scenario cannot be simulated.
    """
    together = simulate(scenario, SEED, RUNS, segments=True, moves=True)
    for account in ACCOUNTS:
        try:
            account(scenario, together)
        except InputError as error:  # such as a search over a strategy that it refuses
            print(f"{number}, {account.__name__}: refused: {error}", flush=True)
        except Exception:  # whatever else an account raises is a difference: printed, counted, exit code 1
            values = differences(scenario, Scenario())
            print(f"{number}, {account.__name__}: {values}\n{traceback.format_exc(limit=-3)}", flush=True)
            yield account.__name__


def same(one: pl.DataFrame, other: pl.DataFrame) -> None:
    """Raise an AssertionError where two tables differ, in the columns that both have."""
    shared = [name for name in one.columns if name in other.columns]
    assert_frame_equal(one[shared], other[shared], check_exact=True, check_dtypes=False)


def of_run(result: Result, run: int) -> list[pl.DataFrame]:
    tables = (result.motion, result.observations, result.inference, result.robots, result.runs)
    return [table.filter(pl.col("run") == run) for table in tables]


def alone(scenario: Scenario, together: Result) -> None:
    """One run, without the others."""
    found = simulate(scenario, SEED, [RUNS[1]], segments=True, moves=True)
    for one, other in zip(of_run(together, RUNS[1]), of_run(found, RUNS[1]), strict=True):
        same(one, other)


def engine(scenario: Scenario, together: Result) -> None:
    """The engine of fixed steps."""
    found = simulate(scenario, SEED, RUNS, motion="fixed-step")
    same(together.inference.drop(PLACES, strict=False), found.inference.drop(PLACES, strict=False))
    same(together.robots, found.robots)


def plain(scenario: Scenario, together: Result) -> None:
    """Plain Python, where robots know their places."""
    found = simulate(scenario, SEED, RUNS[:1], moves=True)
    if not is_estimated(scenario) and found.motion.height <= PLAIN_SAMPLES:
        made = plain_run(scenario, SEED, found.motion, found.ends, found.observations, found.moves)
        assert list(differing(found, made)) == []


def search(scenario: Scenario, together: Result) -> None:
    """What a search judges: decisions, their times, and the truth."""
    (found,) = outcomes_of([scenario], SEED, RUNS)
    expected = from_tables(scenario, together.robots, together.runs, found.tiles)
    for name in ("run", "decision", "decision_time_s", "truth", "right", "wrong", "undecided"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)


def study(scenario: Scenario, together: Result) -> None:
    """The rows of a study, in its runs."""
    found = run_study(Study(scenario, runs=RUNS[-1] + 1, seed=SEED), workers=1)
    for one, other in ((together.robots, found.robots(0)), (together.runs, found.runs(0))):
        same(one, other.filter(pl.col("run").is_in(RUNS)))


def stored(scenario: Scenario, together: Result) -> None:
    """The result, written and read."""
    with tempfile.TemporaryDirectory() as folder:
        together.write(Path(folder) / "result")
        assert together.same_tables(Result.read(Path(folder) / "result"))


def replayed(scenario: Scenario, together: Result) -> None:
    """The motion of these runs under another sensor and gate."""
    if not steers(scenario) and scenario.run.stop == "t_end":
        other = scenario.with_values({"sensor.rms_threshold": 1.5, "decision.min_observations": 3})
        found = simulate(other, SEED, RUNS, segments=True, moves=True)
        assert replay(together, other).same_tables(found)


def toml(scenario: Scenario, together: Result) -> None:
    """The scenario as a text."""
    again = Scenario.from_toml(scenario.to_toml())
    assert (again, again.hash) == (scenario, scenario.hash)


ACCOUNTS: tuple[Callable[[Scenario, Result], None], ...] = (
    alone, engine, plain, search, study, stored, replayed, toml,
)  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
