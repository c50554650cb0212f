"""Checks of every run, whatever its strategy and network, and their findings in words."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError, RunError
from vibroswarm.inference.closed_loop import ClosedLoop, sample_rows
from vibroswarm.inference.sender_positions import move_rows
from vibroswarm.observation.observe import sensed_floors
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate
from vibroswarm.testing.plain_reference import PlainRun, plain_run


@dataclass(frozen=True)
class Finding(NotebookView):
    """The finding of one check: whether it holds, and if not, why."""

    what: str
    holds: bool
    why: str = ""
    is_warning: bool = False
    """Failure is worth knowing, but not an error."""


def require(condition: object, words: str) -> None:
    """Stop a check if a condition is false; as ``assert``, but under ``python -O`` too.

    Raises:
        AssertionError: it is not so; ``words`` say what is wrong.
    """
    if not condition:
        raise AssertionError(words)


def run_checks(
    checks: Mapping[str, Callable[[str], Iterator[str]]], name: str, warnings: Container[str] = ()
) -> list[Finding]:
    """Run checks of the object called ``name``; failures of ``warnings`` are no errors."""
    return [
        run_check(description, partial(check, name), description in warnings)
        for description, check in checks.items()
    ]


def run_check(what: str, check: Callable[[], Iterator[str] | None], is_warning: bool = False) -> Finding:
    """Run a check that yields what is wrong in words, or raises it.

    Args:
        what: what is checked. is_warning: a failure is no error.
    """
    problem = ""
    try:
        problems = check()
        problem = "" if problems is None else next(problems, "")
    except (InputError, RunError) as error:
        problem = str(error)
    except AssertionError as error:
        problem = str(error) or "the check failed without a message"
    except Exception as error:  # users' tables and code can be wrong in any way
        problem = f"it cannot be checked: {type(error).__name__}: {error}"
    return Finding(what, not problem, problem, is_warning)


Scenarios = Iterable[tuple[str, Scenario]]
"""Scenarios with their descriptions."""

SEED: Final = 7
SHORT: Final[dict[str, Any]] = {
    "run.t_end_s": 60.0,
    "decision.min_observations": 10,
    "decision.credible_threshold": 0.8,
    "decision.hold_s": 5.0,
    "walk.walk_duration_location_ms": 3000.0,
    "sample.sample_interval_ms": 1500.0,
}
"""An eventful minute."""


def same_again(scenarios: Scenarios) -> Iterator[str]:
    """Yield runs that differ when they are repeated, or simulated together with others."""
    for words, scenario in scenarios:
        if not simulate(scenario, SEED, [0, 1]).same_tables(simulate(scenario, SEED, [0, 1])):
            yield f"{words}: the same run differs when repeated"
        alone = simulate(scenario, SEED, [1])
        both = simulate(scenario, SEED, [0, 1])
        if not both.inference.filter(both.inference["run"] == 1).equals(alone.inference):
            yield f"{words}: a run differs when simulated together with another"


def equals_plain(scenarios: Scenarios) -> Iterator[str]:
    """Yield differences between a run and the plain Python reference."""
    for words, scenario in scenarios:
        result = simulate(scenario, SEED, 1, moves=True)
        plain = plain_run(scenario, SEED, result.motion, result.ends, result.observations, result.moves)
        for problem in differences(result, plain):
            yield f"{words}: compiled and plain Python results differ: {problem}"


def differences(result: Result, plain: PlainRun) -> Iterator[str]:
    """Yield the tables in which a run differs from the plain Python reference."""
    inference = result.inference
    for name in ("robot", "sample", "messages_received", "decision"):
        compiled, expected = inference[name].to_numpy(), np.array([row[name] for row in plain.rows])
        if compiled.size != expected.size or (compiled != expected).any():
            yield f"column {name}"
    belief = inference["belief_below"].fill_null(float("nan")).to_numpy()
    if not np.array_equal(
        belief, np.array([row["belief_below"] for row in plain.rows], dtype=float), equal_nan=True
    ):
        yield "column belief"
    for name in ("alpha", "beta"):
        kept = inference[name].null_count() == 0 and bool(plain.rows)
        if kept and inference[name].to_list() != [int(row["state"][name]) for row in plain.rows]:
            yield f"column {name}"
    sent = [
        int(row["message"].bit) if row["sends"] else None
        for row in plain.rows
        if "bit" in row["message"].dtype.names
    ]
    if sent and inference["message"].to_list() != sent:
        yield "column message"
    yield from _robots_differ(result, plain)


def _robots_differ(result: Result, plain: PlainRun) -> Iterator[str]:
    """Yield the columns in which the final states of robots differ."""
    robots = result.robots
    for name in ("decision", "sent", "samples", "messages_received"):
        if robots[name].to_list() != [getattr(robot, name) for robot in plain.robots]:
            yield f"{name} of the robots"
    for name in ("alpha", "beta"):
        if robots[name].null_count() == 0 and robots[name].to_list() != [
            int(r.state[name]) for r in plain.robots
        ]:
            yield f"{name} of the robots at the end"
    for name, attribute in (("decision_time_s", "decided_s"), ("belief_at_decision", "belief_at_decision")):
        compiled = robots[name].fill_null(float("nan")).to_numpy()
        if not np.array_equal(
            compiled, np.array([getattr(r, attribute) for r in plain.robots]), equal_nan=True
        ):
            yield f"{name} of the robots"


def in_pieces(scenarios: Scenarios) -> Iterator[str]:
    """Yield differences between a closed-loop run and one replayed at once."""
    for words, scenario in scenarios:
        result = simulate(scenario, SEED, 1, moves=True)
        floors = {0: result.floor(0)}
        (ground,) = sensed_floors(scenario, SEED, [0], floors)
        rows = sample_rows(result.motion, scenario.run.control_period_ms)
        snapshots = []
        for piece_s in (scenario.run.t_end_s, 7.0):
            loop = ClosedLoop(scenario, SEED)
            loop.begin(0, ground)
            feed(loop, rows, result, piece_s)
            snapshots.append((loop.replayer.swarm.agents.copy(), loop.replayer.swarm.states.copy()))
        if any(
            (first != second).any() for first, second in zip(*snapshots, strict=True) if first.dtype.names
        ) and not all(_alike(first, second) for first, second in zip(*snapshots, strict=True)):
            yield f"{words}: results differ between pieces and a whole run"
        if snapshots[0][0]["decision"].tolist() != result.robots["decision"].to_list():
            yield f"{words}: decisions differ between closed loop and tables"


def _alike(one: Any, other: Any) -> bool:
    return all(np.array_equal(one[n], other[n], equal_nan=one[n].dtype.kind == "f") for n in one.dtype.names)


def feed(loop: ClosedLoop, rows: Any, result: Result, piece_s: float) -> None:
    """Feed the samples of a run's tables to a loop, in pieces of this length."""
    tick_ms = loop.tick_ms
    if loop.needs_moves:
        loop.add_moves(move_rows(result.moves, tick_ms))
    end = round(result.ends["end_s"].to_numpy().max() * 1000.0 / tick_ms)
    last = result.ends["stop_start_s"].fill_null(-1.0).to_numpy()
    step = max(round(piece_s * 1000.0 / tick_ms), 1)
    for until in [*range(step, end, step), end]:
        low = int(loop.bounds[1])
        high = int(np.searchsorted(rows["tick"], until))
        loop.add_samples(rows[low:high])
        standing = np.full(last.size, -1)
        for i in range(last.size):
            later = rows[(rows["robot"] == i) & (rows["tick"] >= until)]
            start = (
                later["stop_tick"][0]
                if later.size
                else (round(last[i] * 1000.0 / tick_ms) if last[i] >= 0 else end)
            )
            standing[i] = start if start < until else -1
        loop.catch_up(until, standing)
