"""The preset ``paper`` gives the figures of the paper's simulations; other sample timers do not.

No feedback, f = 0.48, P*: a restricted mean decision time of about 887 s and a belief in the truth of about
0.72 at the decision. Between runs the mean decision time has a standard deviation of about 330 s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import polars as pl
import pytest

from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate

SEED, RUNS = 20, 2000
TIME_S = (860.0, 910.0)
BELIEF = (0.70, 0.74)


@dataclass(frozen=True)
class Mean:
    """A mean over runs and its standard error."""

    value: float
    se: float

    def __str__(self) -> str:
        return f"{self.value:.4g} +- {self.se:.2g}"


def over_runs(robots: pl.DataFrame, value: pl.Expr) -> Mean:
    """The run is the unit: robots of one run are nearly alike."""
    of_run = robots.group_by("run").agg(value.mean().alias("value"))["value"]
    return Mean(float(of_run.mean()), float(of_run.std()) / math.sqrt(of_run.len()))  # type: ignore[arg-type]


def decided(runs: int, **values: object) -> tuple[Mean, Mean]:
    """Restricted mean decision time, s, undecided robots counting as the end, and the belief in the truth."""
    scenario = preset("paper").with_values({name.replace("__", "."): v for name, v in values.items()})
    robots = simulate(scenario, SEED, runs, energies=False).robots
    time_s = pl.col("decision_time_s").fill_null(scenario.run.t_end_s)
    return over_runs(robots, time_s), over_runs(robots, pl.col("belief_in_truth"))


def within(mean: Mean, limits: tuple[float, float]) -> bool:
    return limits[0] <= mean.value <= limits[1]


def test_the_paper_decides_when_and_as_surely_as_it_did() -> None:
    time_s, belief = decided(RUNS)
    said = f"decision time {time_s} s, belief in the truth {belief}"
    assert within(time_s, TIME_S), said
    assert within(belief, BELIEF), said
    # The limits say something: they are wider than the noise, and the noise is as it should be.
    assert time_s.se == pytest.approx(330 / math.sqrt(RUNS), rel=0.1), said
    assert belief.se < 0.01, said


@pytest.mark.parametrize(
    ("timer", "about_s", "runs"), [("always", 816.0, RUNS // 2), ("hold_in_turn", 832.0, RUNS)]
)
def test_other_timers_decide_at_other_times(timer: str, about_s: float, runs: int) -> None:
    """Negative control: more samples a minute, earlier decisions; one of them lies near to the limits."""
    time_s, _ = decided(runs, sample__timer=timer)
    assert not within(time_s, TIME_S), f"{timer}: {time_s} s"
    assert abs(time_s.value - about_s) < 4 * math.hypot(time_s.se, 10.0), f"{timer}: {time_s} s"


def test_labels_as_printed_decide_wrongly() -> None:
    """Negative control of the belief: a sensor with the labels of the printed text (0.24 there)."""
    text = preset("text").sensor
    names = [f"{kind}_{part}" for kind in ("vibrating", "still") for part in ("shape", "scale", "location")]
    _, belief = decided(300, **{f"sensor__{name}": getattr(text, name) for name in names})
    assert belief.value < 0.35, str(belief)
