"""Robots and runs summed up, against the same spelled out as queries over the tables of samples."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from polars.testing import assert_frame_equal

from vibroswarm.inference.agents import FINALS
from vibroswarm.inference.deliveries import Timeline, timeline_of
from vibroswarm.inference.outcomes import ROBOTS, RUNS, run_table
from vibroswarm.inference.replay import infer
from vibroswarm.motion.source import Motion, source
from vibroswarm.observation.observe import observe
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import floors_of, replay, simulate

# The definitions


def truth_of(fill: float, boundary: float) -> int | None:
    """1 above the boundary, 0 below, None on it: worked out here, not by the package."""
    return None if abs(fill - boundary) < 1e-12 else int(fill > boundary)


def truths(fills: Mapping[int, float], boundary: float) -> pl.DataFrame:
    return pl.DataFrame(
        [(run, fill, truth_of(fill, boundary)) for run, fill in fills.items()],
        schema={"run": pl.UInt32, "fill_ratio": pl.Float64, "truth": pl.Int8},
        orient="row",
    )


def robots_by_query(
    motion: pl.DataFrame, inference: pl.DataFrame, finals: pl.DataFrame, truth: pl.DataFrame
) -> pl.DataFrame:
    """A robot's decision is its last, and its time that of the sample at which it came to stand."""
    who = ["run", "robot"]
    timed = inference.with_columns(time_s=motion["time_s"])
    before = pl.col("decision").shift(1, fill_value=-1).over(who)
    turned = timed.filter((pl.col("decision") != before) & (pl.col("decision") != -1))
    decided = turned.group_by(who).agg(
        pl.col("decision").last(),
        decision_time_s=pl.col("time_s").last(),
        belief_at_decision=pl.col("belief_below").last(),
    )
    last = timed.group_by(who).agg(
        last_belief=pl.col("belief_below").last(), samples=pl.len().cast(pl.UInt32)
    )
    belief = pl.coalesce("belief_at_decision", "last_belief")
    table = (
        finals.join(decided, on=who, how="left", maintain_order="left")
        .join(last, on=who, how="left", maintain_order="left")
        .join(truth, on="run", how="left", maintain_order="left")
        .with_columns(
            pl.col("decision").fill_null(-1),
            pl.col("samples").fill_null(0),
            belief_below=belief,
            belief_in_truth=pl.when(pl.col("truth") == 0)
            .then(belief)
            .when(pl.col("truth") == 1)
            .then(1.0 - belief),
        )
    )
    mean, total = pl.col("alpha") / (pl.col("alpha") + pl.col("beta")), pl.col("alpha") + pl.col("beta")
    spread = (mean * (1.0 - mean) / (total + 1.0)).sqrt()
    table = table.with_columns(estimate=mean, estimate_spread=spread)
    return table.with_columns(sent=pl.col("samples")).select(list(ROBOTS)).cast(ROBOTS)  # type: ignore[arg-type]


def runs_by_query(
    robots: pl.DataFrame, ends: pl.DataFrame, truth: pl.DataFrame, t_end_s: float
) -> pl.DataFrame:
    decision, true = pl.col("decision"), pl.col("truth")
    counted = (
        robots.join(truth, on="run", how="left", maintain_order="left")
        .group_by("run", maintain_order=True)
        .agg(
            pl.col("fill_ratio").first(),
            true.first(),
            right=(decision == true).fill_null(False).sum(),
            wrong=((decision != true) & (decision != -1)).fill_null(False).sum(),
            undecided=(decision == -1).sum(),
            alike=decision.n_unique() == 1,
            last_s=pl.col("decision_time_s").max(),
        )
        .join(ends.group_by("run").agg(pl.col("end_s").max()), on="run", how="left", maintain_order="left")
    )
    outcome = (
        pl.when(pl.col("undecided") > 0)
        .then(pl.lit("incomplete"))
        .when(~pl.col("alike"))
        .then(pl.lit("split"))
        .when(true.is_null())
        .then(pl.lit("truth_undefined"))
        .when(pl.col("right") > 0)
        .then(pl.lit("right"))
        .otherwise(pl.lit("wrong"))
    )
    together = (pl.col("undecided") == 0) & pl.col("alike")
    table = counted.with_columns(
        consensus=outcome,
        consensus_time_s=pl.when(together).then(pl.col("last_s")),
        stopped_early=pl.col("end_s") < t_end_s - 1e-9,
    )
    return table.select(list(RUNS)).cast(RUNS)  # type: ignore[arg-type]


def by_query(result: Result) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Robots and runs from the tables of samples, and from the counts at the end."""
    scenario = result.scenario
    arena, boundary = scenario.arena, scenario.decision.decision_boundary
    fills = {
        run: result.floor(run).fill_ratio_within(arena.width_m, arena.height_m)
        for run in result.floors["run"]
    }
    truth = truths(fills, boundary)
    counts = result.robots.select("run", "robot", "alpha", "beta", "messages_received")
    robots = robots_by_query(result.motion, result.inference, counts, truth)
    return robots, runs_by_query(robots, result.ends, truth, scenario.run.t_end_s)


def same(one: pl.DataFrame, other: pl.DataFrame) -> None:
    """Columns, types, order and every bit."""
    assert_frame_equal(one, other, check_exact=True)


# Simulated runs

FLOORS: tuple[dict[str, Any], ...] = (
    {},
    {"floor.source": "random:0.52"},
    {"floor.tiles": ["10", "01"]},  # on the boundary
    {"floor.source": "random:0.5", "floor.rows": 4, "floor.columns": 4},  # on it, a floor a run
    {"floor.tiles": ["10", "01", "11"], "floor.tile_width_m": 0.4, "floor.tile_height_m": 0.45, "floor.left_m": -0.1},
    {"floor.tiles": ["1"], "decision.decision_boundary": 0.3},
    {"decision.decision_boundary": 0.48},
)  # fmt: skip


def scenario_on(floor: int, robots: int, **values: Any) -> Scenario:
    found = {name.replace("__", "."): value for name, value in values.items()} | FLOORS[floor]
    if found.get("decision.decision_boundary", 0.5) != 0.5 and found["strategy.name"] == "soft":
        found["strategy.name"] = "positive"  # soft feedback is refused there
    return Scenario().with_values({"swarm.robots": robots, **found})


scenarios = st.builds(
    scenario_on,
    floor=st.integers(0, len(FLOORS) - 1),
    robots=st.sampled_from([1, 2, 5]),
    run__t_end_s=st.sampled_from(
        [0.5, 4.8, 40.0, 120.0]
    ),  # at 4.8 s a few have sampled and the others have not
    run__stop=st.sampled_from(["t_end", "t_end", "all_decided"]),
    strategy__name=st.sampled_from(["none", "positive", "soft", "soft"]),
    strategy__soft__eta=st.sampled_from([0.0, 20.0, 1500.0]),
    strategy__soft__kappa=st.sampled_from([0.0, 0.5, 2.0]),
    decision__min_observations=st.sampled_from([0, 5, 30, 1000]),
    decision__credible_threshold=st.sampled_from([0.5, 0.75, 0.95]),
    decision__gate=st.sampled_from(["total", "received", "own"]),
    decision__gate_counts_current=st.booleans(),
    decision__revise=st.booleans(),
    decision__prior_alpha=st.sampled_from([1, 4]),
    network__loss__share=st.sampled_from([0.0, 0.3, 1.0]),
)


@settings(
    deadline=None, max_examples=60, derandomize=True, suppress_health_check=[HealthCheck.too_slow], database=None
)  # fmt: skip
@given(scenarios, st.integers(0, 2**63 - 1), st.sampled_from([[0], [3, 4, 2**32 - 1], list(range(7))]))
def test_robots_and_runs_are_what_the_queries_say(scenario: Scenario, seed: int, runs: list[int]) -> None:
    result = simulate(scenario, seed, runs, energies=False)
    robots, of_runs = by_query(result)
    same(result.robots, robots)
    same(result.runs, of_runs)
    decision = scenario.decision
    counted = result.robots["alpha"] + result.robots["beta"] - decision.prior_alpha - decision.prior_beta
    assert (counted == result.robots["samples"] + result.robots["messages_received"]).all()


def test_the_examples_hold_what_they_are_meant_to() -> None:
    """Robots that never sampled beside others, revised decisions, floors on the boundary, runs cut short."""
    short = simulate(Scenario().with_values({"run.t_end_s": 4.8, "sample.sample_interval_ms": 3700.0}), 2, 40)
    sampled = short.robots.group_by("run").agg(pl.col("samples").min(), most=pl.col("samples").max())
    assert sampled.filter((pl.col("samples") == 0) & (pl.col("most") > 0)).height > 0
    never = short.robots.filter(pl.col("samples") == 0)
    assert never["belief_below"].null_count() == never["belief_in_truth"].null_count() == never.height > 0
    values = {"run.t_end_s": 120.0, "strategy.name": "soft", "decision.revise": True, "decision.min_observations": 0,
              "decision.credible_threshold": 0.75}  # fmt: skip
    revised = simulate(Scenario().with_values(values), 1, 20)
    changes = revised.inference.group_by("run", "robot").agg(pl.col("decision").n_unique())
    assert (changes["decision"] == 3).any()
    even = simulate(Scenario().with_values(values | FLOORS[2]), 1, 20)
    assert even.runs["truth"].is_null().all()
    assert {"truth_undefined", "split"} <= set(even.runs["consensus"])
    early = simulate(Scenario().with_values(values | {"run.stop": "all_decided"}), 1, 3)
    assert early.runs["stopped_early"].all()


# Runs as they may be

outcome_of_a_robot = st.tuples(st.sampled_from([-1, 0, 1]), st.floats(0, 1200), st.floats(0, 1))


@settings(deadline=None, max_examples=100)
@given(
    st.integers(1, 4).flatmap(
        lambda robots: st.lists(
            st.tuples(
                st.lists(outcome_of_a_robot, min_size=robots, max_size=robots),
                st.sampled_from([0.0, 0.3, 0.5, 0.5 + 1e-13, 0.52, 1.0]),
                st.sampled_from([1200.0, 1200.0 - 5e-10, 1199.98, 3.0]),
            ),
            min_size=1,
            max_size=6,
        )
    )
)
def test_any_run_is_what_the_query_says(
    runs: list[tuple[list[tuple[int, float, float]], float, float]],
) -> None:
    rows = [
        (3 * k, i, decision, time_s if decision != -1 else None, belief if decision != -1 else None, belief)
        for k, (robots, _, _) in enumerate(runs)
        for i, (decision, time_s, belief) in enumerate(robots)
    ]
    finals = pl.DataFrame(rows, schema=dict(list(FINALS.items())[:6]), orient="row")
    ends = finals.select("run", end_s=pl.Series([end for robots, _, end in runs for _ in robots]))
    fills = {3 * k: fill for k, (_, fill, _) in enumerate(runs)}
    truth = np.array([truth_of(fill, 0.5) for fill in fills.values()], dtype=float)
    found = run_table(
        finals, np.array(list(fills.values())), truth, np.array([end for _, _, end in runs]), 1200.0
    )
    same(found, runs_by_query(finals, ends, truths(fills, 0.5), 1200.0))


# One motion, many strategies


@pytest.fixture(scope="module")
def seen() -> tuple[Scenario, Motion, pl.DataFrame]:
    scenario = Scenario().with_values({"run.t_end_s": 150.0, "decision.min_observations": 20})
    motion = source("event").batch(scenario, 5, [1, 2, 6], False)
    return scenario, motion, observe(scenario, 5, motion.samples, floors_of(scenario, 5, [1, 2, 6]))


VARIANTS: list[dict[str, Any]] = [
    {"strategy.name": "none"},
    {"strategy.name": "positive", "decision.credible_threshold": 0.7},
    {"strategy.name": "soft", "strategy.soft.kappa": 0.5, "strategy.soft.eta": 10.0},
    {"strategy.name": "soft", "network.name": "loss", "network.loss.share": 0.2},
    {"decision.decision_boundary": 0.03},
]


@pytest.mark.parametrize("values", VARIANTS)
@pytest.mark.parametrize("seed", [5, 6])
def test_a_timeline_serves_every_strategy_and_seed(
    seen: tuple[Scenario, Motion, pl.DataFrame], values: dict[str, Any], seed: int
) -> None:
    base, motion, observations = seen
    timeline = timeline_of(base, motion)
    for before in (
        base.with_values({"strategy.name": "soft"}),
        base,
    ):  # what was asked before does not matter
        infer(before, 5, timeline, observations)
    scenario = base.with_values(values)
    for mine, theirs in zip(
        infer(scenario, seed, timeline, observations),
        infer(scenario, seed, motion, observations),
        strict=True,
    ):
        same(mine, theirs)


def test_the_strategies_differ(seen: tuple[Scenario, Motion, pl.DataFrame]) -> None:
    """Negative control."""
    base, motion, observations = seen
    found = [infer(base.with_values(values), 5, motion, observations)[1] for values in VARIANTS]
    assert not any(one.equals(other) for k, one in enumerate(found) for other in found[:k])


def test_other_rows_are_refused(seen: tuple[Scenario, Motion, pl.DataFrame]) -> None:
    base, motion, observations = seen
    wrong = [
        observations[:-1],
        observations.reverse(),
        observations.with_columns(pl.col("run") + 1),
        observations.with_columns(pl.col("sample").gather((pl.int_range(pl.len()) + 1) % pl.len())),
    ]
    for table in wrong:
        with pytest.raises(ValueError, match="rows of the motion"):
            infer(base, 5, motion, table)
    again = infer(base, 5, motion, observations.clone().rechunk())
    assert again[1].equals(infer(base, 5, motion, observations)[1])
    with pytest.raises(ValueError, match="14 rows, not 5"):
        timeline_of(base, Motion(motion.samples, motion.ends[:-1]))
    fewer = base.with_values({"swarm.robots": 3})
    with pytest.raises(ValueError, match="robot 4; there are 3 robots"):
        timeline_of(fewer, motion)


def test_a_replay_of_a_result_read_again_is_the_same(
    seen: tuple[Scenario, Motion, pl.DataFrame],
) -> None:
    """Tables in other pieces of memory."""
    base = seen[0]
    result = simulate(base, 5, [1, 2, 6])
    again = {name: pl.concat([getattr(result, name)[:100], getattr(result, name)[100:]], rechunk=False)
             for name in ("motion", "observations")}  # fmt: skip
    pieces = Result(**{**vars(result), **again})
    scenario = base.with_values(VARIANTS[2])
    assert replay(pieces, scenario).same_tables(replay(result, scenario))
    assert isinstance(timeline_of(base, Motion(pieces.motion, pieces.ends)), Timeline)
