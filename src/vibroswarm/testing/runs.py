"""Checks that apply to runs of any strategy and network, and the findings of checks.

A check yields what is wrong, in words, or raises an error; a finding says whether the check has passed, and if not, the
first thing that is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError, RunError
from vibroswarm.inference.reports import array_at_end
from vibroswarm.result import Result
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate
from vibroswarm.study.run import pool_for
from vibroswarm.testing.plain_reference import PlainRun, plain_run


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
    """Raise an error if a condition is false, as ``assert`` does, but also under ``python -O``.

    Args:
        words: the error message: what is wrong.
    Raises:
        AssertionError: the condition is false.
    """
    if not condition:
        raise AssertionError(words)


def run_checks(
    checks: Mapping[str, Callable[[str], Iterator[str] | None]], name: str, warnings: Container[str] = ()
) -> list[Finding]:
    """Run checks of the strategy, network or task ``name``, and return their findings in order.

    Args:
        checks: each is called with ``name``; the key says what the check requires. name: of the strategy, network or
            task. warnings: keys of the checks whose failure is only a warning.
    """
    return [
        run_check(description, partial(check, name), description in warnings)
        for description, check in checks.items()
    ]


def run_check(what: str, check: Callable[[], Iterator[str] | None], is_warning: bool = False) -> Finding:
    """Run a check, and return its finding; only the first problem is reported.

    Args:
        what: what the check requires. check: yields problems in words, or returns None; an error that it raises is a
            problem too. is_warning: a failure is only a warning.
    """
    problem = ""
    try:
        problems = check()
        problem = "" if problems is None else next(problems, "")
    except (InputError, RunError) as error:
        problem = str(error)
    except AssertionError as error:
        problem = str(error) or "the check failed without a message"
    except (Exception, SystemExit) as error:  # users' tables and code can be wrong in any way
        problem = f"it cannot be checked: {type(error).__name__}: {error}"
    return Finding(what, holds=not problem, why=problem, is_warning=is_warning)


Pieces = dict[str, Callable[[], Any]]
"""What a check compares, by its description: functions that compute it."""


def same_elsewhere(kind: str, pieces_of: Callable[[str], Pieces], name: str) -> Iterator[str]:
    """Check that another process, which has called nothing before, computes the same in the opposite order.

    This finds a memory of earlier calls, and what is made when a file is loaded: random numbers, the time, a hash.

    Args:
        kind: of ``plugins.KINDS``. pieces_of: called with ``name`` in both processes. name: of an object; one that is
            not of a user's file is not checked, since another process does not know it.
    """
    texts = plugins.texts_of([plugins.KINDS[kind].known()[name].code])
    if not texts:
        return
    here = {words: compute() for words, compute in pieces_of(name).items()}
    with pool_for("processes", 1) as workers:
        there = workers.executor.submit(_computed_backwards, pieces_of, name, texts).result()
    yield from (
        f"{words}: another process, which computes in the opposite order, has another result"
        for words, result in here.items()
        if result != there[words]
    )


def _computed_backwards(
    pieces_of: Callable[[str], Pieces], name: str, texts: tuple[tuple[str, str], ...]
) -> dict[str, Any]:
    plugins.install_all(texts)
    return {words: compute() for words, compute in reversed(pieces_of(name).items())}


Scenarios = Iterable[tuple[str, Scenario]]
"""Descriptions, for messages, and scenarios."""

SEED: Final = 7
"""Seed of all simulated runs of the checks."""
MOTION: Final = "event"
"""Source of their motion."""
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
    """Return two runs of each scenario as text, for ``same_elsewhere``."""
    return {words: partial(_text_of_runs, scenario) for words, scenario in scenarios}


def _text_of_runs(scenario: Scenario) -> bytes:
    result = simulate(scenario, SEED, 2)
    return csv_bytes(result.inference) + csv_bytes(result.robots)


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
    if not simulate(scenario, SEED, [0, 1]).same_tables(simulate(scenario, SEED, [0, 1])):
        yield "the same run differs when repeated"
    alone = simulate(scenario, SEED, [1])
    both = simulate(scenario, SEED, [0, 1])
    if not both.inference.filter(both.inference["run"] == 1).equals(alone.inference):
        yield "a run differs when simulated together with another"


def equals_plain(scenario: Scenario) -> Iterator[str]:
    """Check that a compiled run is equal to the run of the plain Python reference."""
    result = simulate(scenario, SEED, 1, moves=True)
    plain = plain_run(scenario, SEED, result.motion, result.ends, result.observations, result.moves)
    for problem in differences(result, plain):
        yield f"compiled and plain Python results differ: {problem}"


def differences(result: Result, plain: PlainRun) -> Iterator[str]:
    """Yield the columns in which a run differs from the plain Python reference.

    Args:
        result: of one compiled run. plain: of the same run by the reference; its rows are in the same order as those of
            ``result.inference``.
    """
    for words, (compiled, expected) in _compared(result, plain).items():
        if not _equal_numbers(compiled, expected):
            yield words
    yield from _reports_differ(result, plain)


def _compared(result: Result, plain: PlainRun) -> dict[str, tuple[pl.Series, Sequence[float]]]:
    """Return each column that both have, at the samples and of the robots at the end, by its name in messages."""
    found: dict[str, tuple[pl.Series, Sequence[float]]] = {}
    for name in ("robot", "sample", "messages_received", "decision", "belief_below"):
        words = f"column {name.removesuffix('_below')}"
        found[words] = result.inference[name], [row[name] for row in plain.rows]
    states = [row["state"] for row in plain.rows]
    found |= _counts(result.inference, states, "column {}")
    # Only messages that have a bit are in the table.
    sent = [
        int(row["message"].bit) if row["sends"] else math.nan
        for row in plain.rows
        if "bit" in row["message"].dtype.names
    ]
    if sent:
        found["column message"] = result.inference["message"], sent
    for name in ("decision", "sent", "samples", "messages_received", "decision_time_s", "belief_at_decision"):
        attribute = "decided_s" if name == "decision_time_s" else name
        found[f"{name} of the robots"] = (
            result.robots[name],
            [getattr(robot, attribute) for robot in plain.robots],
        )
    return found | _counts(
        result.robots, [robot.state for robot in plain.robots], "{} of the robots at the end"
    )


def _counts(
    frame: pl.DataFrame, states: Sequence[Any], words: str
) -> dict[str, tuple[pl.Series, Sequence[float]]]:
    """Return the counts of a strategy's state; null columns: the strategy has no such counts."""
    given = [name for name in ("alpha", "beta") if states and frame[name].null_count() == 0]
    return {words.format(name): (frame[name], [int(state[name]) for state in states]) for name in given}


def _equal_numbers(compiled: pl.Series, expected: Sequence[float]) -> bool:
    """Return whether numbers are equal; a null is a nan of the reference."""
    numbers = compiled.cast(pl.Float64).fill_null(math.nan)
    return numbers.equals(pl.Series(compiled.name, expected, dtype=pl.Float64))


def _reports_differ(result: Result, plain: PlainRun) -> Iterator[str]:
    """Yield the reports of the strategy that differ, see ``inference.reports``."""
    if result.reports is None:
        return
    rows = sorted(plain.rows, key=lambda row: (row["robot"], row["sample"]))
    states = [row["state"] for row in rows]
    each = [robot.arrays for robot in plain.robots]
    arrays = type(each[0])(*map(np.stack, zip(*each, strict=True)))
    sampled = [robot.samples > 0 for robot in plain.robots]
    for (name,), reported in result.reports.group_by("name", maintain_order=True):
        if states and name in states[0].dtype.names:
            expected = [float(value) for state in states for value in np.ravel(getattr(state, str(name)))]
        else:
            expected = (
                array_at_end(result.scenario, str(name), arrays)[sampled].ravel().astype(float).tolist()
            )
        if not _equal_numbers(reported["value"], expected):
            yield f"report {name}"
