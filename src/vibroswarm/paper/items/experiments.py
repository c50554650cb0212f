"""Items 8 and 16: the published means of the real experiments beside ours on the real floor, and their pool of robots.

Their theta_E and gate (what O_c counts) are unknown, so all six pairs are run, and our mean time is a band. The pair
``FITTED`` was chosen by the published times without feedback: a fit, not a test. With up to 8 robots all 16 took part
in turn, with 9 and 10 only some, which may be why these sampled farther apart.

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
from itertools import product
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import stdtrit

from vibroswarm.paper.claims import constant, estimated
from vibroswarm.paper.columns import STRATEGIES, published, sizes
from vibroswarm.paper.item import Drawn, Made, Work
from vibroswarm.plots import draw_error_bars
from vibroswarm.statistics.intervals import Interval, columns_of, mean_interval

EXPERIMENTS: Final[int] = published("experiments.per_swarm_size")
TEXT: Final = (1.55, "own")
"""Threshold and gate as the text describes the real robots."""
FITTED: Final = (1.40, "total")
WALKED: Final = {
    "avoid_per_sample_s": ("avoidance_s_per_sample_none", "avoidance per sample (s)"),
    "distance_m": ("distance_between_samples_m_none", "distance between samples (m)"),
}
TIME: Final = "decision_time_s"


def compute(work: Work, made: Made) -> None:
    """Add bands, the fit, the effect of loss, and how robots walked, beside the published means."""
    times = beside_published(
        work, TIME, f"experiments.{TIME}", [*product((1.33, 1.40, 1.55), ("total", "own"))]
    )
    made.tables["fit"] = times.filter(theta_E=FITTED[0], gate=FITTED[1])
    made.tables["bands"] = bands = _bands(times)
    made.tables["loss"] = loss = _loss(work)
    for strategy in STRATEGIES:
        part = bands.filter(strategy=strategy)
        ours = part.select(x="robots", series="column", estimate="as_the_text", low="least", high="most")
        _draw(
            made,
            f"time-{strategy}",
            f"Decision time, {strategy}",
            _printed(part),
            ours,
            "decision time (s)",
            spans=True,
        )
    fit = made.tables["fit"].select(
        x="robots", series=pl.format("{}, {}", "column", "strategy"), estimate="difference",
        low="difference_low", high="difference_high",
    )  # fmt: skip
    _draw(
        made, "fit", f"Ours at {FITTED[0]}, gate {FITTED[1]} - published: a fit", None, fit, "difference (s)"
    )
    for column in loss["column"].unique(maintain_order=True):
        part = loss.filter(column=column)
        points = part.select(
            x="robots", series=pl.format("{}, θ_E {}, gate {}", "label", "theta_E", "gate"), estimate="gap_s",
            low="gap_s_low", high="gap_s_high",
        )  # fmt: skip
        _draw(
            made,
            f"loss-{column}",
            f"{column}: positive - none",
            _printed(part),
            points,
            "difference in time (s)",
        )
    for figure, (path, label) in WALKED.items():
        part = beside_published(work, figure, f"experiments.{path}")
        ours = part.select(x="robots", series="column", estimate="ours", low="ours_low", high="ours_high")
        name = figure.rpartition("_")[0].replace("_", "-")
        _draw(made, name, label.rpartition(" (")[0].capitalize(), _printed(part), ours, label)
    if "paper" in work.settings.columns:
        plotted = published("experiments.packet_loss_percent")
        in_text = published("experiments.packet_loss_percent_in_text")
        for place, percent in zip((0, -1), in_text, strict=True):
            label = f"{sizes()[place]} robots"
            made.values.append(
                constant("robots-loss-sizes", "paper", label, (plotted[place] - percent) / 100)
            )


def beside_published(
    work: Work, figure: str, path: str, settings: list[tuple[float, str]] | None = None
) -> pl.DataFrame:
    """Return our means beside the published ones by column, setting, strategy and swarm size, with 95 % limits."""
    means = published(path)
    rows = []
    for column in (column for column in work.settings.columns if ("experiments", column) in work.cells):
        cells = work.cells["experiments", column]
        for (theta, gate), strategy in product(settings or [TEXT, FITTED], STRATEGIES):
            wanted = {
                "label": "with loss",
                "sensor.rms_threshold": theta,
                "decision.gate": gate,
                "strategy.name": strategy,
            }
            of_strategy = means[strategy] if isinstance(means, dict) else means if strategy == "none" else []
            for place, printed in zip(cells.where(wanted), of_strategy, strict=False):
                values = cells.by_run(place, figure)
                less = float(values.mean()) - printed
                half = 1.96 * float(values.std(ddof=1)) * math.sqrt(1 / values.size + 1 / EXPERIMENTS)
                rows.append(
                    {
                        "column": column, "theta_E": theta, "gate": gate, "strategy": strategy,
                        "robots": cells.cells[place].point["swarm.robots"], "published": float(printed),
                        **columns_of("ours", mean_interval(values)), "difference": less,
                        "difference_low": less - half, "difference_high": less + half,
                    }
                )  # fmt: skip
    return pl.DataFrame(rows, infer_schema_length=None)


def _bands(times: pl.DataFrame) -> pl.DataFrame:
    is_text = (pl.col("theta_E") == TEXT[0]) & (pl.col("gate") == TEXT[1])
    ours = pl.col("ours")
    return times.group_by("column", "strategy", "robots", maintain_order=True).agg(
        pl.col("published").first(),
        least=ours.min(),
        most=ours.max(),
        as_the_text=ours.filter(is_text).first(),
    )


def _loss(work: Work) -> pl.DataFrame:
    printed = np.subtract(published(f"experiments.{TIME}.positive"), published(f"experiments.{TIME}.none"))
    gaps = dict(zip(sizes(), printed, strict=True))
    rows: list[dict[str, Any]] = []
    for (study, column), cells in work.cells.items():
        for place in cells.where({"strategy.name": "positive"}) if study == "experiments" else ():
            point = cells.cells[place].point
            (none,) = cells.where({**point, "strategy.name": "none"})
            gap = mean_interval(cells.by_run(place, TIME) - cells.by_run(none, TIME))
            rows.append(
                {
                    "column": column, "label": point["label"], "theta_E": point["sensor.rms_threshold"],
                    "gate": point["decision.gate"], "robots": point["swarm.robots"],
                    "published": float(gaps[point["swarm.robots"]]), **columns_of("gap_s", gap),
                }
            )  # fmt: skip
    return pl.DataFrame(rows, infer_schema_length=None)


def _printed(part: pl.DataFrame) -> pl.DataFrame:
    value = pl.col("published")
    return part.unique("robots", maintain_order=True).select(
        x="robots", series=pl.lit("published"), estimate=value, low=value, high=value
    )


def _draw(
    made: Made,
    name: str,
    title: str,
    printed: pl.DataFrame | None,
    ours: pl.DataFrame,
    label: str,
    **how: Any,
) -> None:
    frame = ours if printed is None else pl.concat([printed, ours])
    draw = partial(draw_error_bars, frame, x_label="robots", label=label, **how)
    made.pictures[f"experiments-{name}"] = Drawn(title, draw)


POOL: Final[int] = published("experiments.pool_of_robots")
WHOLE: Final[int] = published("experiments.whole_pool_takes_part_up_to")
GROUPS: Final = 20
"""Groups of runs for the jackknife."""


def beside(work: Work, made: Made) -> None:
    """Add accuracies beside the published ones, the line of losses, and the unexplained rise."""
    accuracy = beside_published(work, "belief_in_truth", "experiments.belief_in_truth")
    made.tables["accuracy"] = accuracy
    for strategy in STRATEGIES:
        part = accuracy.filter(strategy=strategy)
        if part.height:
            draw = partial(
                draw_error_bars, _beside_points(part), x_label="robots", label="belief in the truth"
            )
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


def _beside_points(part: pl.DataFrame) -> pl.DataFrame:
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
