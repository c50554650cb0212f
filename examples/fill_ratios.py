"""A figure for a paper: decision time, and what it came to, over the fill ratio, for three strategies.

vibroswarm evaluate examples/fill_ratios.toml --out out/fill-ratios
python examples/fill_ratios.py out/fill-ratios out/figure
"""

from __future__ import annotations

import argparse
from pathlib import Path

import polars as pl

from vibroswarm.plots import draw_error_bars

NAMES = {"none": "no feedback", "positive": "positive feedback", "soft": "soft feedback"}
FIGURES = {
    "decision_time_s": "decision time (s)",
    "swarm_right": "runs with a right consensus",
    "swarm_wrong": "runs with a wrong consensus",
}


def main(study: Path, folder: Path) -> None:
    """Three pictures, each as SVG, PDF and PNG with its numbers as CSV."""
    cells = pl.read_csv(study / "summary.csv")
    folder.mkdir(parents=True, exist_ok=True)
    for name, label in FIGURES.items():
        table = cells.select(
            x=pl.col("floor.source").str.strip_prefix("random:").cast(pl.Float64),
            series=pl.col("strategy.name").replace(NAMES),
            estimate=name,
            low=f"{name}_low",
            high=f"{name}_high",
            runs="runs",
        )
        percent = name.startswith("swarm")
        picture = draw_error_bars(table, x_label="fill ratio", label=label, percent=percent)
        picture.write(folder / name)
        print(f"{folder / name}.pdf: {picture.caption}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("study", type=Path, help="folder of a study of fill ratios")
    parser.add_argument("figures", type=Path, help="folder to write")
    given = parser.parse_args()
    main(given.study, given.figures)
