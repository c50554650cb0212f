"""The page of a run in a real browser: it draws, shows the tables' numbers, keeps names text, asks for nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from helpers.browser import Tabs
from vibroswarm import preset, simulate
from vibroswarm.result import Result
from vibroswarm.run_page.write import write_run_page

BLANK = """(id) => {
  const canvas = document.getElementById(id);
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [canvas.width, canvas.height];
  const context = copy.getContext("2d", { willReadFrequently: true });
  context.drawImage(canvas, 0, 0);
  const seen = new Set(new Uint32Array(context.getImageData(0, 0, copy.width, copy.height).data.buffer));
  return seen.size < 3;
}"""
NAME = "</script><img src=x onerror=alert(1)><b>"


@pytest.fixture(scope="module")
def result() -> Result:
    return simulate(preset("paper").with_values({"run.t_end_s": 240.0}), seed=13, poses=True)


def check_mind(page: Any, result: Result, robot: int, time_s: float) -> None:
    samples = result.motion.join(result.inference, on=["run", "robot", "sample"])
    row = samples.filter(pl.col("time_s") <= time_s, robot=robot).sort("sample").to_dicts()[-1]
    mind = page.evaluate("([id, t]) => vibroswarm.mind(id, t)", [robot, time_s])
    columns = {"belief": "belief_below", "received": "messages_received"}
    assert all(mind[name] == row[columns.get(name, name)] for name in ("alpha", "beta", "decision", *columns))


def check_pose(page: Any, row: dict[str, Any]) -> None:
    pose = page.evaluate("([id, t]) => vibroswarm.pose(id, t)", [row["robot"], row["time_s"] - 0.5])
    assert np.hypot(pose["x"] - row["x_m"], pose["y"] - row["y_m"]) < 0.001
    assert abs(np.angle(np.exp(1j * (pose["heading"] - row["heading_rad"])))) < np.radians(1)
    assert pose["kind"] == "stop"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_run_in_the_browser(result: Result, tabs: Tabs, tmp_path: Path, scheme: str) -> None:
    path = tmp_path / "run.html"
    write_run_page(result, path, title=NAME)
    page = tabs.open(path.as_uri() + "#t=100", viewport={"width": 1280, "height": 800}, color_scheme=scheme)
    page.evaluate("document.fonts.ready.then(() => null)")
    assert page.evaluate("vibroswarm.state()")["theme"] == scheme
    for canvas in ("floor", "past", "actors", "belief"):
        assert not page.evaluate(BLANK, canvas), canvas
    assert page.title() == page.inner_text("#run-name") == NAME
    for robot in range(5):
        check_mind(page, result, robot, 101.37)
    for row in result.motion.filter(pl.col("time_s") < 240.0).sample(20, seed=1).to_dicts():
        check_pose(page, row)
    page.set_viewport_size({"width": 390, "height": 844})
    page.wait_for_function("document.documentElement.scrollWidth <= 390")  # once it has drawn anew
    assert tabs.emptied() == []
