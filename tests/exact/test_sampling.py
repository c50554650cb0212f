"""How swarms sample: by hand, against plain loops, and effective samples against what runs really vary by."""

from __future__ import annotations

import math

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from vibroswarm.inference.outcomes import SHARES
from vibroswarm.motion.motion_tables import MOTION
from vibroswarm.observation.energy_model import error_rates
from vibroswarm.observation.observe import OBSERVATIONS
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate
from vibroswarm.statistics.intervals import generator
from vibroswarm.statistics.sampling import (
    WALK,
    effective_samples,
    effective_with_sensor,
    packet_loss,
    walk_figures,
)


@pytest.fixture(scope="module")
def paper() -> Result:
    return simulate(preset("paper"), 11, 250, energies=False)


def tables(
    rows: list[tuple[int, int, float, float, float, float | None, int, int]],
) -> tuple[pl.DataFrame, ...]:
    """From (run, robot, time, x, y, avoid, tile, bit), sorted by run and time."""
    seen: dict[tuple[int, int], int] = {}
    motion, observations = [], []
    for run, robot, t, x, y, avoid, tile, bit in rows:
        sample = seen.setdefault((run, robot), 0)
        seen[run, robot] += 1
        motion.append((run, robot, sample, t - 1, t, x, y, 0.0, 1.0, 0.0, avoid, 1.0, 0.0))
        observations.append((run, robot, sample, tile, None, bit))
    return (
        pl.DataFrame(motion, schema=MOTION, orient="row"),
        pl.DataFrame(observations, schema=OBSERVATIONS, orient="row"),
    )


def test_tiles_are_those_visited_if_none_are_stated() -> None:
    motion, observations = tables(
        [
            (0, 0, 5.0, 0.0, 0.0, 1.0, 0, 1),
            (0, 1, 6.0, 0.5, 0.5, 0.0, 3, 0),
            (2, 0, 5.0, 0.1, 0.1, None, -1, 1),
        ]
    )
    # By each run's own tiles, if none are stated.
    by_tiles_visited = walk_figures(motion, observations).to_dicts()
    assert by_tiles_visited[0] == walk_figures(motion, observations, tiles=4).to_dicts()[0]
    assert by_tiles_visited[1] == {"run": 2, "samples": 1, "ones": 1.0} | dict.fromkeys(
        ("avoid_per_sample_s", "distance_m", "spacing_s", "effective_samples", *SHARES)
    )


def test_no_samples_at_all() -> None:
    empty = walk_figures(pl.DataFrame(schema=MOTION), pl.DataFrame(schema=OBSERVATIONS))
    assert dict(empty.schema) == WALK
    assert empty.height == 0


def test_equal_visits_are_worth_infinitely_many_and_one_tile_nothing_known() -> None:
    assert effective_samples(1 / 25, 25) == math.inf
    assert effective_samples(1.0, 25) == 1.0  # always the same tile: one look
    assert math.isnan(effective_samples(1.0, 1))


rows = st.lists(
    st.tuples(
        st.integers(0, 3),
        st.integers(0, 4),
        st.integers(1, 50),
        st.floats(0, 1),
        st.floats(0, 1),
        st.floats(0, 5, width=32),
        st.integers(-1, 8),
        st.integers(0, 1),
    ),
    max_size=60,
)


@settings(deadline=None, max_examples=60)
@given(rows, st.sampled_from([9, 900, 10**6]))
def test_as_plain_group_bys_have_it(drawn: list[tuple], tiles: int) -> None:
    drawn = sorted(drawn, key=lambda row: (row[0], row[2], row[1]))
    motion, observations = tables(drawn)
    mine = walk_figures(motion, observations, tiles)
    both = motion.with_columns(observations["tile", "observation"])
    who = ["run", "robot"]
    step = both.with_columns(
        d=((pl.col("x_m") - pl.col("x_m").shift()) ** 2 + (pl.col("y_m") - pl.col("y_m").shift()) ** 2)
        .sqrt()
        .over(who),
        dt=(pl.col("time_s") - pl.col("time_s").shift()).over(who),
    )
    theirs = step.group_by("run", maintain_order=True).agg(
        samples=pl.len(),
        avoid_per_sample_s=pl.col("avoid_s").cast(pl.Float64).mean(),
        distance_m=pl.col("d").mean(),
        spacing_s=pl.col("dt").mean(),
        ones=pl.col("observation").cast(pl.Float64).mean(),
    )
    for name in theirs.columns:
        a, b = mine[name].cast(pl.Float64).fill_null(-1), theirs[name].cast(pl.Float64).fill_null(-1)
        np.testing.assert_allclose(a, b, atol=1e-9)
    on = both.filter(pl.col("tile") >= 0).group_by("run", "tile").len()
    squares = {
        r: float((v / v.sum()) @ (v / v.sum()))
        for (r,), g in on.group_by("run")
        for v in [g["len"].to_numpy()]
    }
    for run, effective in mine.select("run", "effective_samples").iter_rows():
        assert (effective is None) == (run not in squares)
        if effective is not None and math.isfinite(effective):
            assert effective == pytest.approx((tiles - 1) / (tiles * squares[run] - 1))


def test_the_variance_over_floors_is_as_the_equation_says() -> None:
    """Given the visits, over 40,000 floors of exactly f N tiles; without the finite number of tiles it is not."""
    random = generator(2, "floors")
    visits = random.multinomial(80, random.dirichlet(np.full(25, 2.0)))
    f, a, b = 12 / 25, 0.14, 0.2
    floors = random.permuted(np.tile(np.r_[np.ones(12), np.zeros(13)], (40_000, 1)), axis=1)
    ones = random.binomial(visits, np.where(floors == 1, 1 - b, a)).sum(axis=1) / 80
    squares = float(((visits / 80) ** 2).sum())
    q = f * (1 - b) + (1 - f) * a
    seen = q * (1 - q) / ones.var()
    worth = effective_samples(squares, 25)
    assert float(effective_with_sensor(80, worth, f, a, b)) == pytest.approx(seen, rel=0.03)
    assert abs(float(effective_with_sensor(80, 1 / squares, f, a, b)) / seen - 1) > 0.1


def test_visits_and_runs_agree_on_the_paper(paper: Result) -> None:
    """Two ways to the number of effective samples: one run's visits, and how the shares of runs vary."""
    walk = walk_figures(paper.motion, paper.observations, 25)
    rates = error_rates(paper.scenario.sensor)
    fill = float(paper.runs["fill_ratio"][0])
    of_visits = effective_with_sensor(
        walk["samples"].to_numpy(), walk["effective_samples"].to_numpy(), fill, *rates
    )
    low, high = worth_over_runs(walk["ones"].to_numpy(), level=0.99)
    expected = 1 / np.mean(1 / of_visits)
    assert low < expected < high
    assert expected < 0.78 * walk["samples"].mean()  # neighbouring samples are alike
    assert not low < walk["samples"].mean() < high
    assert walk_figures(paper.motion, paper.observations).equals(walk)  # 25 tiles, all visited


def worth_over_runs(ones: NDArray[np.float64], level: float = 0.95) -> tuple[float, float]:
    """Limits (chi-square) of n_eff = q (1 - q) / Var(O), from the share of ones of each run on floors redrawn."""
    q, n = ones.mean(), ones.size
    quantiles = stats.chi2.ppf([0.5 - level / 2, 0.5 + level / 2], n - 1) / (n - 1)
    low, high = q * (1 - q) / ones.var(ddof=1) * quantiles
    return float(low), float(high)


def test_no_figure_depends_on_the_runs_beside_it(paper: Result) -> None:
    whole = walk_figures(paper.motion, paper.observations)
    for some in ([3], [0, 7, 8, 200]):
        chosen = pl.col("run").is_in(some)
        part = walk_figures(paper.motion.filter(chosen), paper.observations.filter(chosen))
        assert part.equals(whole.filter(chosen))


@pytest.mark.parametrize("loss", [0.0, 0.09])
def test_packet_loss(loss: float) -> None:
    result = simulate(
        preset("paper").with_values({"network.name": "loss", "network.loss.share": loss}),
        4,
        20,
        energies=False,
    )
    table = packet_loss(result)
    addressed, heard = (float(table[name].sum()) for name in ("addressed", "heard"))
    assert addressed > 0.97 * 4 * result.motion.height  # little is unclear
    if loss == 0.0:
        assert (table["packet_loss"] == 0.0).all()
    else:
        assert 1 - heard / addressed == pytest.approx(loss, abs=4 * math.sqrt(loss * (1 - loss) / addressed))


@pytest.mark.parametrize("seed", [None, 4])
def test_messages_before_a_robot_was_switched_on_are_not_lost(seed: int | None) -> None:
    """They were: one of five robots, switched on after 400 of 900 s, made a loss of 10 % and bursts of 880 s.

    A robot of a simulation hears from the start, whenever it first samples.
    """
    result = simulate(preset("paper").with_values({"run.t_end_s": 400.0}), 4, 1, energies=False)
    is_off = (result.motion["robot"] == 4) & (result.motion["time_s"] < 200.0)
    motion, inference = result.motion.filter(~is_off), result.inference.filter(~is_off)
    missed = pl.when(pl.col("robot") == 4).then(result.inference.filter(is_off)["messages_received"][-1])
    inference = inference.with_columns(pl.col("messages_received") - missed.otherwise(0))
    late = Result(**{**vars(result), "seed": seed, "motion": motion, "inference": inference})
    (lost,) = packet_loss(late)["packet_loss"]
    assert (lost == 0.0) == (seed is None)


def test_packet_loss_of_a_robot_alone_is_not_known() -> None:
    alone = simulate(preset("paper").with_values({"swarm.robots": 1, "run.t_end_s": 60.0}), 4, 2)
    assert packet_loss(alone)["packet_loss"].null_count() == 2
