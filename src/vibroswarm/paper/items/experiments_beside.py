"""Item 16: accuracy, loss and distances of the real experiments beside ours, and their pool of 16 robots.

With up to 8 robots all 16 took part in turn, with 9 and 10 only some, which may be why these sampled farther apart.

| name | symbol | equation |
|---|---|---|
| variance over runs of the distance, robots keep their speed | V | - |
| the same, speeds drawn at every sample | V' | - |
| sd of the distance over subsets of n of 16 robots | S | sqrt((V - V') (16 - n) / 16) |
| rise | r | distance with n robots - distance with 8 robots |
| unexplained rise | z | (r published - r ours) / S |
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import stdtrit

from vibroswarm.paper.claims import constant, estimated
from vibroswarm.paper.columns import STRATEGIES, published, sizes
from vibroswarm.paper.item import Drawn, Made, Work
from vibroswarm.paper.items.experiments import EXPERIMENTS, beside_published
from vibroswarm.plots import draw_error_bars
from vibroswarm.statistics.intervals import Interval

POOL: Final[int] = published("experiments.pool_of_robots")
WHOLE: Final[int] = published("experiments.whole_pool_takes_part_up_to")
GROUPS: Final = 20
"""Groups of runs for the jackknife."""


def compute(work: Work, made: Made) -> None:
    """Add accuracies beside the published ones, the line of losses, and the unexplained rise."""
    accuracy = beside_published(work, "belief_in_truth", "experiments.belief_in_truth")
    made.tables["accuracy"] = accuracy
    for strategy in STRATEGIES:
        part = accuracy.filter(strategy=strategy)
        if part.height:
            draw = partial(draw_error_bars, _points(part), x_label="robots", label="belief in the truth")
            made.pictures[f"experiments-accuracy-{strategy}"] = Drawn(f"Accuracy, {strategy}", draw)
    if ("pool", "paper") not in work.cells:
        return
    loss = loss_line()
    made.tables["loss"] = loss
    for robots, off in loss.select("robots", "line_difference").iter_rows():
        made.values.append(constant("robots-loss-linear", "paper", f"{robots} robots", off))
    for robots in (robots for robots in sizes() if robots > WHOLE):
        label = f"{robots} of {POOL} robots"
        made.values.append(estimated("robots-subset", "paper", label, _unexplained(work, robots)))


def _points(part: pl.DataFrame) -> pl.DataFrame:
    ours = part.select(
        x="robots", series=pl.format("{}, θ_E {}, gate {}", "column", "theta_E", "gate"), estimate="ours",
        low="ours_low", high="ours_high",
    )  # fmt: skip
    printed = part.unique("robots", maintain_order=True).select(
        x="robots", series=pl.lit("published"), estimate="published", low="published", high="published"
    )
    return pl.concat([printed, ours])


def loss_line() -> pl.DataFrame:
    """Return the plotted shares of lost packets by swarm size, and their least-squares line."""
    robots = np.array(sizes(), dtype=np.float64)
    plotted = np.array(published("experiments.packet_loss_percent")) / 100
    line = np.polyval(np.polyfit(robots, plotted, 1), robots)
    columns = {"robots": sizes(), "plotted_share": plotted, "line_share": line}
    return pl.DataFrame(columns | {"line_difference": plotted - line})


def _unexplained(work: Work, robots: int) -> Interval:
    """Return z, with a jackknife error of our runs, and that of the published means, each over 15 experiments."""
    cells, pool = work.cells["experiments", "paper"], work.cells["pool", "paper"]
    setting: dict[str, Any] = {
        "label": "with loss", "strategy.name": "none", "sensor.rms_threshold": 1.55, "decision.gate": "own",
    }  # fmt: skip
    (of_size,), (of_whole,) = (cells.where({**setting, "swarm.robots": n}) for n in (robots, WHOLE))
    printed = dict(zip(sizes(), published("experiments.distance_between_samples_m_none"), strict=True))
    rise = printed[robots] - printed[WHOLE]
    once = pool.by_run(pool.value(swarm__robots=robots), "distance_m")
    redrawn, whole = cells.by_run(of_size, "distance_m"), cells.by_run(of_whole, "distance_m")
    z = (rise - redrawn.mean() + whole.mean()) / subset_sd(once, redrawn, robots)
    left_out = []
    for group in range(min(GROUPS, once.size)):
        own, other, eight = (np.delete(values, np.s_[group::GROUPS]) for values in (once, redrawn, whole))
        left_out.append((rise - other.mean() + eight.mean()) / subset_sd(own, other, robots))
    jackknife = math.sqrt((len(left_out) - 1) * np.var(left_out))
    of_published = math.sqrt(2 * redrawn.var(ddof=1) / EXPERIMENTS) / subset_sd(once, redrawn, robots)
    half = float(stdtrit(EXPERIMENTS - 1, 0.975)) * math.hypot(jackknife, of_published)
    return Interval(float(z), float(z - half), float(z + half), 0.95, EXPERIMENTS, "t")


def subset_sd(once: NDArray[np.float64], redrawn: NDArray[np.float64], robots: int) -> float:
    """Return S, m; nan if the distance does not vary more with speeds that robots keep."""
    variance = float(once.var(ddof=1) - redrawn.var(ddof=1)) * (POOL - robots) / POOL
    return math.sqrt(variance) if variance > 0 else math.nan
