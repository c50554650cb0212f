"""Checks that apply to runs of any strategy and network (they yield what is wrong), and the findings of checks."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from typing import Any, Final

import polars as pl
from polars.testing import assert_frame_equal

from vibroswarm.errors import InputError, RunError
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate


@dataclass(frozen=True)
class Finding:
    """The finding of one check."""

    what: str
    """What the check requires."""
    holds: bool
    why: str = ""
    """What is wrong; empty if the check has passed."""
    is_warning: bool = False
    """Whether a failure is only a warning, not an error."""


def require(condition: object, words: str) -> None:
    """Raise an error if a condition is false, as ``assert`` does, but also under ``python -O``."""
    if not condition:
        raise AssertionError(words)


Check = Callable[[Any], Iterator[str] | None]
"""Yields what is wrong with its subject, such as the name of a strategy, or raises an error."""


def run_checks(checks: Mapping[str, Check], subject: Any) -> list[Finding]:
    """Run checks of a strategy, network, task or other subject, and return their findings in order."""
    return [run_check(what, partial(check, subject)) for what, check in checks.items()]


def run_check(what: str, check: Callable[[], Iterator[str] | None], *, is_warning: bool = False) -> Finding:
    """Run a check, and return its finding; only the first problem is reported."""
    try:
        problem = next(check() or iter(()), "")
    except (AssertionError, InputError, RunError) as error:
        problem = str(error) or "the check failed without a message"
    except (Exception, SystemExit) as error:  # users' tables and code can be wrong in any way
        problem = f"{type(error).__name__}: {error}"
    return Finding(what, holds=not problem, why=problem, is_warning=is_warning)


Pieces = dict[str, Callable[[], Any]]
"""What a check compares, by its description: functions that compute it."""


def same_in_plain_python(kind: str, pieces_of: Callable[[str], Pieces], name: str) -> Iterator[str]:
    """Check that another process, in plain Python and the opposite order, computes the same."""
    checked = plugins.KINDS[kind].known()[name]
    texts = plugins.texts_of([checked.code])
    if checked.is_own and not texts:  # registered by this program: another process does not know it
        return
    before = os.environ.get("VIBROSWARM_PLAIN", "")
    os.environ["VIBROSWARM_PLAIN"] = "1"  # the process that is started reads it
    try:
        with ProcessPoolExecutor(1, get_context("spawn")) as process:
            there = process.submit(_computed_backwards, pieces_of, name, texts).result()
    finally:
        os.environ["VIBROSWARM_PLAIN"] = before
    for words, compute in pieces_of(name).items():
        here, elsewhere = compute(), there[words]
        if isinstance(here, pl.DataFrame):
            # Logarithms of the gamma function differ in the last bits.
            assert_frame_equal(here, elsewhere, rel_tol=1e-9, abs_tol=1e-12)
        elif here != elsewhere:
            yield f"{words}: another process, in plain Python and the opposite order, has another result"


def _computed_backwards(
    pieces_of: Callable[[str], Pieces], name: str, texts: tuple[tuple[str, str], ...]
) -> dict[str, Any]:
    plugins.install_all(texts)
    return {words: compute() for words, compute in reversed(pieces_of(name).items())}


Scenarios = Iterable[tuple[str, Scenario]]
"""Descriptions, for messages, and scenarios."""

SEED: Final = 7
"""Seed of all simulated runs of the checks."""
SHORT: Final[dict[str, Any]] = {
    "run.t_end_s": 60.0,
    "decision.min_observations": 10,
    "decision.credible_threshold": 0.8,
    "decision.hold_s": 5.0,
    "walk.walk_duration_location_ms": 3000.0,
    "sample.sample_interval_ms": 1500.0,
}
"""Fields of a scenario in which much happens in one minute: many short legs, samples, messages and decisions."""


def tables_of(scenarios: Scenarios) -> Pieces:
    """Return what is believed, said and decided in a run of each scenario, for ``same_in_plain_python``."""
    return {words: partial(_inference, scenario) for words, scenario in scenarios}


def _inference(scenario: Scenario) -> pl.DataFrame:
    return simulate(scenario, SEED, 1).inference


def in_each(
    scenarios_of: Callable[[str], Scenarios], check: Callable[[Scenario], Iterator[str]]
) -> Callable[[str], Iterator[str]]:
    """Return the check of an object, by its name, that makes a check of a scenario in each of its scenarios."""

    def check_all(name: str) -> Iterator[str]:
        for words, scenario in scenarios_of(name):
            yield from (f"{words}: {problem}" for problem in check(scenario))

    return check_all


def same_again(scenario: Scenario) -> Iterator[str]:
    """Check that a run is the same when it is repeated, and when it is simulated alone or together with another."""
    both = simulate(scenario, SEED, [0, 1])
    if not both.same_tables(simulate(scenario, SEED, [0, 1])):
        yield "the same run differs when repeated"
    alone = simulate(scenario, SEED, [1])
    if not both.inference.filter(both.inference["run"] == 1).equals(alone.inference):
        yield "a run differs when simulated together with another"
