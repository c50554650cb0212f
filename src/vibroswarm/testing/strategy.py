"""What every strategy must hold to."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from vibroswarm.inference import replayers
from vibroswarm.inference.closed_loop import ClosedLoop, sample_rows
from vibroswarm.observation.ground import grounds_of
from vibroswarm.presets import preset
from vibroswarm.result import Result
from vibroswarm.scenario import Scenario
from vibroswarm.simulation import simulate
from vibroswarm.strategies import strategy as strategy_of
from vibroswarm.testing.findings import Finding, tried
from vibroswarm.testing.plain import PlainRun, plain_run

SEED: Final = 7
SHORT: Final[dict[str, Any]] = {
    "run.t_end_s": 60.0,
    "decision.min_observations": 10,
    "decision.credible_threshold": 0.8,
    "decision.hold_s": 5.0,
    "walk.walk_duration_location_ms": 3000.0,
    "sample.sample_interval_ms": 1500.0,
}
"""A minute in which much happens."""
SETTINGS: Final[dict[str, dict[str, Any]]] = {
    "one robot": {"swarm.robots": 1},
    "five robots": {"swarm.robots": 5},
    "five, messages lost": {"swarm.robots": 5, "network.name": "loss", "network.loss.share": 0.3},
    "twelve": {"swarm.robots": 12},
}
LONG: Final[dict[str, Any]] = {"run.t_end_s": 1200.0, "floor.source": "random:0.2", "swarm.robots": 5}


def check_strategy(name: str) -> list[Finding]:
    """All checks of a strategy that is known.

    Args:
        name: as scenarios call it.
    """
    return [
        tried(what, lambda check=check: check(name), what in TOLD)  # type: ignore[misc]
        for what, check in CHECKS.items()
    ]


def _scenarios(name: str) -> Iterator[tuple[str, Scenario]]:
    base = preset("paper").with_values({**SHORT, "strategy.name": name})
    for words, values in SETTINGS.items():
        yield words, base.with_values(values)


def _runs(name: str) -> Iterator[str]:
    for words, scenario in _scenarios(name):
        result = simulate(scenario, SEED, 2)
        if (result.inference["decision"].is_in([-1, 0, 1])).all() and _beliefs_are_shares(result):
            continue
        yield f"{words}: a belief is outside of 0 to 1"


def _beliefs_are_shares(result: Result) -> bool:
    belief = result.inference["belief"].drop_nulls().drop_nans()
    return bool(((belief >= 0.0) & (belief <= 1.0)).all())


def _same_again(name: str) -> Iterator[str]:
    for words, scenario in _scenarios(name):
        if not simulate(scenario, SEED, [0, 1]).same_tables(simulate(scenario, SEED, [0, 1])):
            yield f"{words}: the same run came out otherwise when it was done again"
        alone = simulate(scenario, SEED, [1])
        both = simulate(scenario, SEED, [0, 1])
        if not both.inference.filter(both.inference["run"] == 1).equals(alone.inference):
            yield f"{words}: a run comes out otherwise beside another"


def _equals_plain(name: str) -> Iterator[str]:
    for words, scenario in _scenarios(name):
        result = simulate(scenario, SEED, 1)
        plain = plain_run(scenario, SEED, result.motion, result.ends, result.observations)
        for why in differences(result, plain):
            yield f"{words}: compiled and as plain Python it does not do the same: {why}"


def differences(result: Result, plain: PlainRun) -> Iterator[str]:
    """Where the tables of a run and its plain form differ."""
    inference = result.inference
    for name in ("robot", "sample", "received", "decision"):
        mine, theirs = inference[name].to_numpy(), np.array([row[name] for row in plain.rows])
        if mine.size != theirs.size or (mine != theirs).any():
            yield f"column {name}"
    belief = inference["belief"].fill_null(float("nan")).to_numpy()
    if not np.array_equal(
        belief, np.array([row["belief"] for row in plain.rows], dtype=float), equal_nan=True
    ):
        yield "column belief"
    for name in ("alpha", "beta"):
        kept = inference[name].null_count() == 0 and bool(plain.rows)
        if kept and inference[name].to_list() != [int(row["state"][name]) for row in plain.rows]:
            yield f"column {name}"
    said = [
        int(row["message"].bit) if row["sends"] else None
        for row in plain.rows
        if "bit" in row["message"].dtype.names
    ]
    if said and inference["message"].to_list() != said:
        yield "column message"
    yield from _robots_differ(result, plain)


def _robots_differ(result: Result, plain: PlainRun) -> Iterator[str]:
    robots = result.robots
    for name in ("decision", "sent", "samples", "received"):
        if robots[name].to_list() != [getattr(robot, name) for robot in plain.robots]:
            yield f"{name} of the robots"
    for name in ("alpha", "beta"):
        if robots[name].null_count() == 0 and robots[name].to_list() != [
            int(r.state[name]) for r in plain.robots
        ]:
            yield f"{name} of the robots at the end"
    for name, theirs in (("decision_time_s", "decided_s"), ("belief_at_decision", "belief_at_decision")):
        mine = robots[name].fill_null(float("nan")).to_numpy()
        if not np.array_equal(mine, np.array([getattr(r, theirs) for r in plain.robots]), equal_nan=True):
            yield f"{name} of the robots"


def _piece_by_piece(name: str) -> Iterator[str]:
    for words, scenario in _scenarios(name):
        result = simulate(scenario, SEED, 1)
        floors = {0: result.floor(0)}
        (ground,) = grounds_of(scenario, SEED, [0], floors)
        rows = sample_rows(result.motion, scenario.run.control_period_ms)
        found = []
        for piece_s in (scenario.run.t_end_s, 7.0):
            loop = ClosedLoop(scenario, SEED)
            loop.begin(0, ground)
            feed(loop, rows, result, piece_s)
            found.append((loop.replayer.swarm.agents.copy(), loop.replayer.swarm.states.copy()))
        if any(
            (one != other).any() for one, other in zip(*found, strict=True) if one.dtype.names
        ) and not all(_alike(one, other) for one, other in zip(*found, strict=True)):
            yield f"{words}: in pieces it comes out otherwise than in one"
        if found[0][0]["decision"].tolist() != result.robots["decision"].to_list():
            yield f"{words}: followed as it moves, a run decides otherwise than by its tables"


def _alike(one: Any, other: Any) -> bool:
    return all(np.array_equal(one[n], other[n], equal_nan=one[n].dtype.kind == "f") for n in one.dtype.names)


def feed(loop: ClosedLoop, rows: Any, result: Result, piece_s: float) -> None:
    """Let a loop live through the samples of a run's tables, a piece of this length at a time."""
    tick_ms = loop.tick_ms
    end = round(result.ends["end_s"].to_numpy().max() * 1000.0 / tick_ms)
    last = result.ends["stop_start_s"].fill_null(-1.0).to_numpy()
    step = max(round(piece_s * 1000.0 / tick_ms), 1)
    for until in [*range(step, end, step), end]:
        low = int(loop.bounds[1])
        high = int(np.searchsorted(rows["tick"], until))
        loop.take(rows[low:high])
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


def _counts_equal_messages(name: str) -> Iterator[str]:
    if strategy_of(name).on_counts is None:
        return
    faster = replayers.counts_only
    for words, scenario in _scenarios(name):
        one = simulate(scenario, SEED, 2)
        try:
            replayers.counts_only = lambda strategy, network: False
            other = simulate(scenario, SEED, 2)
        finally:
            replayers.counts_only = faster
        if not one.same_tables(other):
            yield f"{words}: on_counts of so many is not as many on_message"


def _decides(name: str) -> Iterator[str]:
    result = simulate(preset("paper").with_values({**LONG, "strategy.name": name}), SEED, 3)
    if (result.robots["decision"] == -1).all():
        yield "no robot has decided in 3 runs of 1200 s on an easy floor (20 % vibrate)"


CHECKS: Final = {
    "it compiles, and gives decisions and beliefs": _runs,
    "the same again, alone or beside others": _same_again,
    "compiled as in plain Python": _equals_plain,
    "in pieces as in one": _piece_by_piece,
    "counts as messages one by one": _counts_equal_messages,
    "it decides": _decides,
}
TOLD: Final = ("it decides",)
"""Checks whose failure is no error."""
