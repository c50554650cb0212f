"""Pictures draw the numbers of their frames, and save them beside the picture."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from polars.testing import assert_frame_equal

from vibroswarm import plots
from vibroswarm.plots.picture import Picture
from vibroswarm.plots.style import looks_of

X, LOW, VALUE, HIGH = [1.0, 2.0, 4.0], [0.1, 0.2, 0.3], [0.2, 0.3, 0.5], [0.3, 0.4, None]
INTERVAL = {"low": LOW, "high": HIGH}
FRAMES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "draw_boxes": ({"cell": ["a", "a", "b"], "value": [1.0, 3.0, None]}, {}),
    "draw_error_bars": ({"x": X, "estimate": VALUE, **INTERVAL, "series": ["none"] * 3}, {}),
    "draw_outcomes": ({"cell": ["a", "b", "c"], "right": [2, 1, 0], "wrong": [2, 0, 0]}, {}),
    "draw_incidence": ({"time_s": X, "right": VALUE, "wrong": LOW}, {}),
    "draw_detection": ({"fill_ratio": X, "missed": VALUE, **INTERVAL}, {"log": True}),
    "draw_heat": ({"x": X, "y": ["a", "b", "a"], "value": VALUE}, {"best": "low"}),
    "draw_density": ({"x_m": LOW, "y_m": VALUE}, {"bins": 4}),
    "draw_front": (
        {"name": ["a", "b", "c"], "time": X, "error": [0.3, 0.1, 0.2], "strategy.name": ["soft", "soft", "none"]},
        {"series": "strategy.name"},
    ),
    "draw_reports": ({"name": ["n"] * 3, "robot": [0, 0, 1], "time_s": X, "value": VALUE}, {"truth": 0.4}),
    "draw_search": ({"iteration": X, "best": LOW, "mean": VALUE}, {"true": 0.3}),
    "draw_parameters": ({"iteration": X, "share": VALUE, "series": ["walk.a_ms", "b", "b"]}, {}),
    "draw_spectrum": (
        {"hz": X, "amplitude": VALUE},
        {"lines": pl.DataFrame({"hz": [2.0], "low": [1.9], "high": [2.1], "amplitude": [0.3]})},
    ),
}  # fmt: skip


def drawn(name: str, **options: Any) -> Picture:
    columns, arguments = FRAMES[name]
    draw: Callable[..., Picture] = getattr(plots, name)
    return draw(pl.DataFrame(columns), **arguments, **options)


def test_all_pictures_are_here() -> None:
    assert {*FRAMES, "draw_run"} == {name for name in plots.__all__ if name.startswith("draw_")}


@pytest.mark.parametrize("name", FRAMES)
def test_a_picture_has_the_numbers_of_its_frame(name: str, tmp_path: Path) -> None:
    picture = drawn(name)
    if name not in ("draw_boxes", "draw_outcomes", "draw_density", "draw_parameters"):  # these compute theirs
        own = pl.DataFrame(FRAMES[name][0])
        both = picture.numbers.select(own.columns).sort(own.columns)
        assert_frame_equal(both, own.cast(dict(both.schema)).sort(own.columns))
    assert "<svg" in picture.svg() == drawn(name).svg()
    *files, numbers = picture.write(tmp_path / name)
    assert [path.suffix for path in files] == [".svg", ".pdf", ".png"]
    assert all(path.stat().st_size > 1000 for path in files)
    assert pl.read_csv(numbers).shape == picture.numbers.shape


def test_computed_numbers() -> None:
    boxes = drawn("draw_boxes", t_end=5.0).numbers.to_dicts()
    assert (boxes[0]["median"], boxes[0]["q25"], boxes[1]["median"], boxes[1]["undecided"]) == (
        2,
        1.5,
        None,
        1,
    )
    assert drawn("draw_outcomes").numbers["right"].to_list() == [0.5, 1.0, None]
    density = drawn("draw_density").numbers
    assert density["count"].sum() == 3
    assert density["density"].mean() == pytest.approx(1.0)
    assert drawn("draw_front").numbers["front"].to_list() == [True, True, True]


def test_marks_stand_at_the_numbers() -> None:
    (axes,) = drawn("draw_error_bars").figure.axes
    assert [np.allclose(line.get_xydata(), [*zip(X, VALUE, strict=True)]) for line in axes.lines[:1]] == [
        True
    ]
    (axes,) = drawn("draw_front").figure.axes
    colours = {look.colour for look in looks_of(["soft", "none"])}
    assert colours <= {line.get_color() for line in axes.lines}
