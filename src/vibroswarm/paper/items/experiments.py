"""Item 8: the published means of the real experiments beside ours on the real floor.

Their theta_E and gate (what O_c counts) are unknown, so all six pairs are run, and our mean time is a band. The pair
``FITTED`` was chosen by the published times without feedback: a fit, not a test.
"""

from __future__ import annotations

import math
from functools import partial
from itertools import product
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.paper.claims import constant
from vibroswarm.paper.columns import STRATEGIES, published, sizes
from vibroswarm.paper.item import Drawn, Made, Work
from vibroswarm.plots import draw_error_bars
from vibroswarm.statistics.intervals import columns_of, mean_interval

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
