"""The two pictures of a search."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from vibroswarm.errors import InputError
from vibroswarm.plots import draw_parameters, draw_search

SCORES = pl.DataFrame({"iteration": [1, 2, 3], "best": [5.0, 4.0, 4.5], "mean": [9.0, None, 7.0]})
OWN = pl.DataFrame(
    {"iteration": [1, 1, 2, 2], "particle": [0, 1, 0, 1], "score": [5.0, 8.0, 4.0, None]},
)
SHARES = pl.DataFrame(
    {"iteration": [1, 2, 1, 2], "series": ["tau", "tau", "O_c", "O_c"], "share": [0.5, 0.75, 0.25, 1.0]}
)


@pytest.mark.parametrize("style", ["column", "page", "slide"])
def test_scores_best_mean_and_truth_are_drawn(style: str, tmp_path: Path) -> None:
    picture = draw_search(SCORES, OWN, label="cost", true=6.0, style=style)
    (axes,) = picture.figure.axes
    assert len(axes.lines) == 2 + 2 + 1  # particles, best and mean, truth
    drawn = {tuple(line.get_ydata()) for line in axes.lines}
    assert (5.0, 4.0, 4.5) in drawn
    (legend,) = picture.figure.legends
    of_name = {
        text.get_text(): line.get_color()
        for text, line in zip(legend.get_texts(), legend.get_lines(), strict=True)
    }
    of_values = {tuple(line.get_ydata()): line.get_color() for line in axes.lines}
    assert of_name["best as the search believes"] == of_values[5.0, 4.0, 4.5]
    assert of_name["true, on fresh runs"] == of_values[6.0, 6.0]
    assert picture.numbers["best"].to_list() == [5.0, 4.0, 4.5]
    assert "6" in picture.caption
    assert "selection bias" in picture.caption
    assert len(picture.write(tmp_path / "scores")) == 4


def test_the_axis_of_scores_begins_at_0_or_below_the_lowest() -> None:
    below = SCORES.with_columns(best=-pl.col("best"), mean=-pl.col("mean"))
    for frame, personal, true in (
        (SCORES, OWN, 6.0),
        (SCORES, None, -6.0),
        (below, None, None),
        (below, OWN, 6.0),
    ):
        (axes,) = draw_search(frame, personal, true=true).figure.axes
        low, high = axes.get_ylim()
        values = [value for line in axes.lines for value in line.get_ydata() if value == value]  # not nan
        assert low == 0.0 if min(values) >= 0 else low < min(values)
        assert high > max(values)


def test_parameters_are_drawn_by_field() -> None:
    picture = draw_parameters(SHARES)
    (axes,) = picture.figure.axes
    assert [tuple(line.get_ydata()) for line in axes.lines] == [(0.5, 0.75), (0.25, 1.0)]
    assert picture.numbers.columns == ["iteration", "series", "share"]
    (alone,) = draw_parameters(SHARES.filter(series="tau")).figure.legends
    assert [text.get_text() for text in alone.get_texts()] == ["tau"]
    assert not draw_parameters(SHARES.filter(series="tau").drop("series")).figure.legends


def test_iterations_are_whole_numbers() -> None:
    first = pl.col("iteration") == 1
    for picture in (
        draw_search(SCORES),
        draw_parameters(SHARES),
        draw_search(SCORES.filter(first)),
        draw_parameters(SHARES.filter(first)),
    ):
        picture.figure.draw_without_rendering()
        assert all(float(tick).is_integer() for tick in picture.figure.axes[0].get_xticks())


def test_a_single_iteration_is_drawn_by_marks() -> None:
    first = pl.col("iteration") == 1
    picture = draw_search(SCORES.filter(first), OWN.filter(first), true=6.0)
    assert "over 1 iteration:" in picture.caption
    for line in picture.figure.axes[0].lines:
        is_level = list(line.get_ydata()) == [6.0, 6.0]
        assert (line.get_marker() == "None") == is_level
    assert all(line.get_marker() == "None" for line in draw_search(SCORES).figure.axes[0].lines)


def test_frames_that_are_wrong() -> None:
    with pytest.raises(InputError, match="outside 0 to 1"):
        draw_parameters(SHARES.with_columns(share=pl.col("share") * 2))
    with pytest.raises(InputError, match="iteration"):
        draw_search(SCORES.drop("iteration"))
    with pytest.raises(InputError, match="best"):
        draw_search(SCORES.drop("best"))
