"""A figure for a paper: decision time and what came of it over the fill ratio, for three strategies.

vibroswarm sweep examples/fill_ratios.toml --out out/fill-ratios
python examples/fill_ratios.py out/fill-ratios out/figure
"""

from __future__ import annotations

import sys
from pathlib import Path

import polars as pl

from vibroswarm import StudyResult
from vibroswarm.analysis.swarm import summary
from vibroswarm.plots import draw_error_bars

NAMES = {"none": "no feedback", "positive": "positive feedback", "soft": "soft feedback"}


def figures(result: StudyResult) -> pl.DataFrame:
    """One row a cell: fill ratio, strategy, and two figures with their 95 % intervals."""
    rows = []
    for cell in result.cells.iter_rows(named=True):
        robots, runs = result.tables(cell["cell"])
        found = summary(robots, runs, t_end_s=1200.0)
        rows.append(
            {
                "x": float(runs["fill_ratio"][0]),
                "series": NAMES[cell["strategy.name"]],
                "time": found.decision_time_s,
                "right": found.swarm_right,
                "runs": found.runs,
            }
        )
    return pl.DataFrame(
        {
            "x": [row["x"] for row in rows],
            "series": [row["series"] for row in rows],
            "runs": [row["runs"] for row in rows],
            **{
                f"{name}_{limit}": [getattr(row[name], limit) for row in rows]
                for name in ("time", "right")
                for limit in ("estimate", "low", "high")
            },
        }
    )


def main(study: Path, folder: Path) -> None:
    """Two pictures, each as SVG, PDF and PNG with its numbers as CSV."""
    table = figures(StudyResult.open(study))
    folder.mkdir(parents=True, exist_ok=True)
    shown = {
        "time": ("decision time (s), undecided robots at 1200", "decision-time"),
        "right": ("runs with a right consensus", "right"),
    }
    for name, (label, file) in shown.items():
        limits = {f"{name}_{limit}": limit for limit in ("estimate", "low", "high")}
        picture = draw_error_bars(
            table.select("x", "series", "runs", *limits).rename(limits),
            x_label="fill ratio",
            label=label,
            percent=name == "right",
        )
        picture.write(folder / file)
        print(f"{folder / file}.pdf: {picture.caption}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
