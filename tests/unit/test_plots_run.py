"""The picture of one run: what it shows, and that a dark page shows it too."""

from __future__ import annotations

import re
from importlib.resources import files

import numpy as np
import polars as pl
import pytest
from matplotlib.colors import to_rgb
from matplotlib.patches import Rectangle

from vibroswarm.plots.picture import themed_svg
from vibroswarm.plots.run import floor_figure, maps_figure, run_figure
from vibroswarm.plots.style import RUN, settings
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
    corners = np.array([patch.get_xy() for patch in tiles])
    at = result.floor(0).tile_at(corners[:, 0] + 0.1, corners[:, 1] + 0.1)
    assert result.floor(0).tiles.ravel()[at].all()
    paths = [line.get_xydata()[-1] for line in axes.lines if len(line.get_xdata()) > 100]
    ends = result.ends.sort("robot").select("x_m", "y_m").to_numpy()
    assert np.abs(np.array(paths) - ends).max() < 0.1  # what a robot drives in half a second
    assert sum(len(marks.get_offsets()) for marks in axes.collections) == result.motion.height
    assert [text.get_text() for text in axes.texts] == ["0", "1", "2", "3", "4"]
    assert "no feedback, seed 3" in axes.get_title()


def test_a_floor_that_changes_is_drawn_as_it_is_at_the_end_and_small_before() -> None:
    changing = preset("paper").with_values({
        "floor.source": "random:0.2", "run.t_end_s": 120.0, "change.at_s": [40, 80], "change.to": ["grow", "invert"],
    })  # fmt: skip
    result = simulate(changing, 3, 1)
    at_end, *small = run_figure(result).axes
    hatched = [
        sum(isinstance(patch, Rectangle) and bool(patch.get_hatch()) for patch in axes.patches)
        for axes in (at_end, *small)
    ]
    tiles = [int(stage.tiles.sum()) for _, stage in result.floor(0).stages()]
    assert hatched == [tiles[-1], *tiles]
    assert tiles[0] == 5 < tiles[1] == 25 - tiles[2]
    assert [axes.get_title() for axes in small] == ["from 0 s", "from 40 s", "from 80 s"]
    assert f"fill ratio {tiles[-1] / 25} at the end" in at_end.get_title()


def test_kinds_are_told_apart_without_colour() -> None:
    three = {"sensor.model": "confusion", "strategy.name": "dirichlet", "task.name": "majority"}
    made = preset("paper").with_values(three | {"floor.source": "random:0.4,0.36,0.24", "run.t_end_s": 60.0})
    result = simulate(made, 3, 1)
    (axes,) = run_figure(result).axes
    tiles = {patch.get_label(): patch.get_hatch() or "" for patch in axes.patches}
    assert len({tiles[f"tile of kind {kind}"] for kind in range(3)}) == 3
    assert "share of kind 1: 0.36" in axes.get_title()
    floor = floor_figure(result.floor(0).tiles)
    (hatched,) = [mesh for mesh in floor.axes[0].collections if mesh.get_hatch()]
    assert hatched.get_array().count() == 6  # of kind 2; vibrating tiles are dark, still ones light
    assert [bool(mark.get_hatch()) for mark in floor.legends[0].get_patches()] == [False, False, True]


def test_all_kinds_have_marks_of_their_own() -> None:
    """Kind 8 was drawn as still, kind 9 as vibrating."""
    kinds = 16
    floor = floor_figure(np.arange(kinds, dtype=np.uint8).reshape(4, 4))
    looks = [(patch.get_facecolor(), patch.get_hatch()) for patch in floor.legends[0].get_patches()]
    assert len(set(looks)) == kinds
    made = preset("paper").with_values({
        "sensor.model": "confusion", "sensor.confusion.kinds": kinds, "strategy.name": "dirichlet",
        "task.name": "majority", "floor.source": "random:0.4" + ",0.04" * 15,
        "run.t_end_s": 300.0,
    })  # fmt: skip
    (axes,) = run_figure(simulate(made, 3, 1)).axes
    read = [marks for marks in axes.collections if str(marks.get_label()).startswith("read kind")]
    assert len({marks.get_paths()[0].vertices.tobytes() for marks in read}) == len(read) == kinds


def test_the_title_tells_estimates_apart_from_the_fill_ratio() -> None:
    """The task asks for the share of still tiles."""
    values = {"strategy.name": "dirichlet", "task.name": "share", "task.share.kind": 0, "run.t_end_s": 60.0}
    result = simulate(preset("paper").with_values(values), seed=1)
    title = run_figure(result).axes[0].get_title()
    assert "fill ratio 0.48" in title
    assert title.endswith(f"estimates {result.robots['estimate'][0]:.3f}")


@pytest.mark.parametrize(("truth", "crosses", "words"), [([1, 0], 2, "x: believed"), ([None, None], 0, "")])
def test_a_map_speaks_of_wrong_tiles_only_where_the_truth_is_known(
    truth: list[int | None], crosses: int, words: str
) -> None:
    """Without it, a map without crosses would pass for one that is right everywhere."""
    tiles = {"run": [0, 0], "robot": [None, None], "row": [0, 0], "column": [0, 1], "vibrating": [0.1, 0.9]}
    figure = maps_figure(pl.DataFrame({**tiles, "vibrates": pl.Series(truth, dtype=pl.Int8)}))
    (marks,) = figure.axes[0].lines
    assert marks.get_xydata().tolist() == [[0.5, 0.5], [1.5, 0.5]][:crosses]
    assert figure.get_supxlabel().startswith(words)
    assert bool(figure.get_supxlabel()) == bool(words)


def test_a_map_of_many_robots_says_how_many_it_leaves_out() -> None:
    """Of 20 robots it showed 11, below the words "each by itself"."""
    tiles = {"run": 0, "row": 0, "column": 0, "vibrating": 0.1, "vibrates": None}
    maps = pl.DataFrame([{"robot": robot, **tiles} for robot in (None, *range(20))])
    assert maps_figure(maps).get_supxlabel() == "the first 11 of 20 robots"
    assert maps_figure(maps.head(6)).get_supxlabel() == ""


def test_a_map_is_to_scale() -> None:
    """2 x 40 tiles of 1 m x 1 m were a thin strip below crosses larger than its tiles."""
    tiles = [
        {"run": 0, "robot": None, "row": row, "column": column, "vibrating": 0.1, "vibrates": 1}
        for row in range(2)
        for column in range(40)
    ]
    axes = maps_figure(pl.DataFrame(tiles, schema_overrides={"robot": pl.Int64}), tile_m=(0.025, 0.5)).axes[0]
    assert axes.get_aspect() == 20.0
    assert axes.lines[0].get_markersize() < 72 * 2.0 / 40


def test_a_dark_page_changes_all_colours_of_a_map_or_none() -> None:
    """Its ends alone became dark, so that 0 was black beside a white 0.05; and crosses stand out on both ends."""
    tiles = {
        "run": [0] * 3,
        "robot": [None] * 3,
        "row": [0] * 3,
        "column": [0, 1, 2],
        "vibrating": [0.0, 0.5, 1.0],
    }
    figure = maps_figure(pl.DataFrame({**tiles, "vibrates": pl.Series([1, 1, 0], dtype=pl.Int8)}))
    svg = themed_svg(figure)
    assert not re.search(r"var\(--fig-(tile-)?(still|vibrating)", svg)
    assert not re.search(r' d="[^"]*\.\d{3}', svg)  # digits that nobody sees
    assert sum(to_rgb(figure.axes[0].lines[0].get_color())) < 0.3  # darker than both ends


def test_marks_are_those_of_the_replay_page(result: Result) -> None:
    """Its colours, by their names in the page's style sheet; a diamond says vibrating; misread samples are struck."""
    sheet = files("vibroswarm.run_page").joinpath("assets", "page.css").read_text(encoding="utf-8")
    light = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6});", sheet.partition("@media")[0]))
    assert {name: light[{"trail": "ink-3"}.get(name, name)] for name in RUN} == RUN
    (axes,) = run_figure(result).axes
    still, vibrating = axes.collections
    assert [one.get_label() for one in (still, vibrating)] == ["read still", "read vibrating"]
    assert [len(one.get_offsets()) for one in (still, vibrating)] == [
        (result.observations["observation"] == bit).sum() for bit in (0, 1)
    ]
    tiles, tile = result.floor(0).tiles.ravel(), result.observations["tile"].to_numpy()
    misread = (tile >= 0) & (tiles[tile] != result.observations["observation"].to_numpy())
    (struck,) = [line for line in axes.lines if line.get_label() == "misread"]
    assert 0 < len(struck.get_xdata()) == misread.sum()


def test_all_follow_light_and_dark(result: Result) -> None:
    """A colour that a page cannot replace would be dark on dark."""
    with settings():
        svg = themed_svg(run_figure(result))
    assert svg.count("var(--fig-paper") > 5  # open marks, and the robots' numbers
    styles = " ".join(re.findall(r' style="([^"]*)"', svg))
    fixed = set(re.findall(r"#[0-9a-f]{6}", re.sub(r"var\([^)]*\)", "", styles)))
    assert not fixed, fixed
