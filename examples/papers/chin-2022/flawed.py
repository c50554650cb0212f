"""Print the error of the robots that presume a wrong accuracy, and of the others, in a folder of unknown.toml.

python examples/papers/chin-2022/flawed.py out/chin-2022-unknown
"""

import argparse
from pathlib import Path

import polars as pl

from vibroswarm import load_code
from vibroswarm.statistics.intervals import mean_interval
from vibroswarm.study.spec import Study

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("folder", help="folder of the study")
load_code("chin-2024/asdf.py:asdf", Path(__file__).parents[1])
_, result = Study.open(Path(parser.parse_args().folder))
for cell in result.cells:
    scenario = cell.scenario
    if scenario.strategy.name != "asdf":
        continue
    true, flawed = float(scenario.floor.source.split(":")[1]), scenario.strategy.params.flawed_robots
    robots = result.tables(cell)[0].with_columns(
        error=(pl.col("estimate") - true).abs(), is_flawed=pl.col("robot") < flawed
    )
    for (is_flawed,), own in sorted(robots.group_by("is_flawed")):
        mean = mean_interval(own.group_by("run").agg(pl.col("error").mean())["error"])
        who = "do" if is_flawed else "know .75"
        corrects = "corrected" if scenario.strategy.params.type_2_error < 0.5 else "never corrected"
        cell_words = f"{true:g}, {flawed} of 100 presume .95, {corrects}"
        print(f"{cell_words}: those that {who}: {mean.estimate:.3f} [{mean.low:.3f}, {mean.high:.3f}]")
