"""The picture of one run: what it shows, and that a dark page shows it too."""

from __future__ import annotations

import re

import pytest
from matplotlib.patches import Rectangle

from vibroswarm.plots.picture import themed_svg
from vibroswarm.plots.run import run_figure
from vibroswarm.plots.style import settings
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate


@pytest.fixture(scope="module")
def result() -> Result:
    return simulate(preset("paper").with_values({"run.t_end_s": 120.0}), 3, 1, segments=True)


def test_tiles_samples_and_robots_are_there(result: Result) -> None:
    (axes,) = run_figure(result).axes
    tiles = [patch for patch in axes.patches if isinstance(patch, Rectangle) and patch.get_hatch()]
    assert len(tiles) == int(result.floor(0).tiles.sum()) == 12
    assert sum(len(marks.get_offsets()) for marks in axes.collections) == result.motion.height
    assert [text.get_text() for text in axes.texts] == ["0", "1", "2", "3", "4"]
    assert "no feedback, seed 3" in axes.get_title()


def test_all_but_the_paths_follow_light_and_dark(result: Result) -> None:
    """A colour that a page cannot replace would be dark on dark."""
    with settings():
        svg = themed_svg(run_figure(result))
    assert svg.count("var(--fig-paper") > 5  # open marks, and the robots' numbers
    styles = " ".join(re.findall(r' style="([^"]*)"', svg))
    fixed = set(re.findall(r"#[0-9a-f]{6}", re.sub(r"var\([^)]*\)", "", styles)))
    assert fixed <= {"#4c78a8"}, fixed
