"""The experiments of others run from their files, and show the directions that their pages state, with fewer cells."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from vibroswarm import preset, simulate
from vibroswarm.cli import main
from vibroswarm.scenario import plugins

EXAMPLES = Path(__file__).parents[2] / "examples"
ERROR = "estimate_error"


def summary(tmp_path: Path, study: str, runs: int, **values: Any) -> pl.DataFrame:
    """Run a study, whose rows that begin with these words have other values, and return its figures by cell."""
    folder = shutil.copytree(EXAMPLES, tmp_path / "examples")
    file, out = folder / "papers" / study, tmp_path / "out"
    text = file.read_text(encoding="utf-8")
    for name, value in values.items():
        text, found = re.subn(rf'(?m)^(".*\b{name}" = ).*$', rf"\g<1>{value}", text)
        assert found, name
    file.write_text(text, encoding="utf-8")
    quick = ["--trust", "--no-pictures", "--runs", str(runs), "--out", str(out)]
    assert main(["evaluate", str(file), *quick]) == 0
    return pl.read_csv(out / "summary.csv")


@pytest.mark.slow
def test_cross_inhibition_breaks_deadlocks(tmp_path: Path) -> None:
    found = summary(
        tmp_path, "zakir-2022/study.toml", 16, source='["random:0.5"]', robots="[20]", asocial="[0.1]"
    )
    undecided = dict(found.select("strategy.opinions.inhibits", "robots_undecided").iter_rows())
    assert undecided[True] < undecided[False] - 0.15


@pytest.mark.slow
def test_neighbours_lower_the_error_and_more_of_them_do_not(tmp_path: Path) -> None:
    values = {"explore_s": "[60.0]", "degree": "[0, 2, 19]"}
    alone, two, everybody = summary(tmp_path, "raoufi-2021/study.toml", 10, **values)[ERROR].to_list()
    assert two < everybody < alone
    assert two < 0.4 * alone


@pytest.mark.slow
def test_robots_that_take_another_feature_decide_all(tmp_path: Path) -> None:
    found = summary(tmp_path, "ebert-2018/study.toml", 4, all_on_first="[true]")
    stays, switches = found["swarm_right"].to_list()
    assert stays == 0.0
    assert switches > 0.5


@pytest.mark.parametrize(
    ("layout", "degree", "heard"), [(0, 2, 2), (0, 9, 9), (0, 0, 0), (1, 2, None), (2, 2, None)]
)
def test_robots_hear_their_neighbours_in_the_graph(layout: int, degree: int, heard: int | None) -> None:
    """Each robot sends as many messages as it takes samples, so that those of its neighbours are counted."""
    plugins.load_file("network", f"{EXAMPLES / 'networks' / 'graph.py'}:graph")
    values = {"network.name": "graph", "network.graph.layout": layout, "network.graph.degree": degree}
    result = simulate(preset("paper").with_values({**values, "swarm.robots": 10, "run.t_end_s": 60.0}), 1, 1)
    sent = result.robots["samples"].to_numpy()
    received = result.robots["messages_received"].to_numpy()
    if heard is None:  # a line and a tree have 9 links, both of whose robots hear each other
        assert received.sum() == pytest.approx(2 * 9 * sent.mean(), rel=0.2)
        assert received.min() > 0
    else:
        steps = [step for k in range(1, heard // 2 + 1) for step in (k, -k)]
        expected = sum((np.roll(sent, step) for step in steps), np.zeros(10, dtype=int))
        expected = sent.sum() - sent if heard == 9 else expected
        assert (
            np.abs(received.astype(int) - expected.astype(int)).max() <= heard
        )  # those still to be read at the end


@pytest.mark.slow
def test_kilobots_with_a_stronger_prior_are_later_and_wrong_less_often(tmp_path: Path) -> None:
    values = {"sample_interval_ms": "[60000.0]", "positive_feedback": "[true]", "prior": "[1, 50]"}
    found = summary(tmp_path, "ebert-2020/study.toml", 1, **values)
    weak, strong = found["robots_wrong"].to_list()
    assert strong < weak - 0.05
    soon, late = found["decision_time_s"].to_list()
    assert late > 2.0 * soon
