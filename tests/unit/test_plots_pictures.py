"""Each picture draws the numbers that it gives, drops none in silence, and no word in it hides another."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from itertools import combinations
from typing import Any
from unittest import mock

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import settings as settings_of_tests
from hypothesis import strategies as st
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.text import Text

from vibroswarm import preset, simulate, tasks, verdict
from vibroswarm.analysis.verdict import headline
from vibroswarm.errors import InputError
from vibroswarm.plots import (
    Picture,
    draw_belief,
    draw_boxes,
    draw_density,
    draw_detection,
    draw_error_bars,
    draw_forest,
    draw_front,
    draw_heat,
    draw_incidence,
    draw_outcomes,
    draw_parameters,
    draw_reports,
    draw_search,
    draw_spectrum,
)
from vibroswarm.plots.certainty import draw_certainty, draw_rasters
from vibroswarm.plots.distributions import Group, quantile
from vibroswarm.plots.layout import lay_out
from vibroswarm.plots.picture import _as_laid_out, picture_bytes
from vibroswarm.plots.reports import draw_run_reports
from vibroswarm.plots.style import ON_DARK, ON_LIGHT, PAPER, STYLES, look, settings
from vibroswarm.tasks import Task

LONG = [
    "walk.avoidance_threshold_mm = 55",
    "/very/long/folder/of results/of/a/study/with $a_name$/floor.png",
    "<script>alert(1)</script>",
    "strategy.name = soft, decision.credible_threshold = 0.975",
]
FORTY = [f"walk.avoidance_threshold_mm = {index}" for index in range(40)]


def runs(
    cells: list[str], count: int = 60, series: list[str] | None = None, undecided: float = 0.2
) -> pl.DataFrame:
    rng = np.random.default_rng(1)
    rows = []
    for cell in cells:
        for name in series or [""]:
            values = np.clip(rng.gamma(3, 150, count), 0, 1199)
            lost = rng.random(count) < undecided
            rows += [
                {"cell": cell, "series": name, "value": None if gone else value}
                for value, gone in zip(values.tolist(), lost, strict=True)
            ]
    return pl.DataFrame(rows, schema={"cell": pl.String, "series": pl.String, "value": pl.Float64})


def estimates(xs: list[Any], series: list[str], breadth: float = 30.0) -> pl.DataFrame:
    rng = np.random.default_rng(2)
    rows = [
        {"x": x, "series": name, "estimate": 400 + 100 * rng.random(), "runs": 1000}
        for x in xs
        for name in series
    ]
    return pl.DataFrame(rows).with_columns(
        low=pl.col("estimate") - breadth, high=pl.col("estimate") + breadth
    )


def counts(cells: list[str]) -> pl.DataFrame:
    drawn = np.random.default_rng(3).multinomial(200, [0.5, 0.2, 0.1, 0.15, 0.05], len(cells))
    kinds = ("right", "wrong", "split", "incomplete", "truth_undefined")
    return pl.DataFrame(
        {"cell": cells, **{kind: drawn[:, at] for at, kind in enumerate(kinds)}}
    ).with_columns(right_low=pl.col("right") / 200 - 0.06, right_high=pl.col("right") / 200 + 0.06)


def differences(names: list[str]) -> pl.DataFrame:
    rng = np.random.default_rng(4)
    middle = rng.normal(0, 30, len(names))
    return pl.DataFrame(
        {
            "comparison": names, "difference": middle, "low": middle - 20, "high": middle + 20,
            "wins": 610, "ties": 20, "losses": 370, "runs": 1000,
        }
    )  # fmt: skip


def curves(series: list[str], rows: int = 200) -> pl.DataFrame:
    time = np.linspace(0, 1200, rows)
    return pl.concat(
        pl.DataFrame({"time_s": time, "series": name})
        .with_columns(right=0.7 * (1 - (-pl.col("time_s") / (300 + 50 * at)).exp()), wrong=pl.col("time_s") / 6000)
        .with_columns(
            right_low=pl.col("right") * 0.9, right_high=pl.col("right") * 1.05,
            wrong_low=pl.col("wrong") * 0.8, wrong_high=pl.col("wrong") * 1.2,
        )
        for at, name in enumerate(series)
    )  # fmt: skip


def beliefs(series: list[str], rows: int = 200) -> pl.DataFrame:
    time = np.linspace(0, 1200, rows)
    middle = 0.5 + 0.4 * (1 - np.exp(-time / 300))
    quantiles = {
        "q05": middle * 0.3,
        "q25": middle * 0.8,
        "q50": middle,
        "q75": middle + 0.05,
        "q95": middle + 0.09,
    }
    return pl.concat(pl.DataFrame({"time_s": time, **quantiles, "series": name}) for name in series)


def grid(xs: list[Any], ys: list[Any]) -> pl.DataFrame:
    rows = [
        {"x": x, "y": y, "value": 900.0 - 7 * i + 11 * j, "runs": 100}
        for i, x in enumerate(xs)
        for j, y in enumerate(ys)
    ]
    return pl.DataFrame(rows)


def choices(count: int) -> pl.DataFrame:
    rng = np.random.default_rng(5)
    time = rng.gamma(4, 150, count)
    error = np.clip(150 / time * rng.gamma(5, 0.3, count), 0, 1)
    return pl.DataFrame(
        {
            "name": [f"{LONG[at % 4]} {at}" for at in range(count)], "time": time, "error": error,
            "time_low": time - 30, "time_high": time + 30, "error_low": error - 0.04, "error_high": error + 0.04,
            "runs": 1000,
        }
    )  # fmt: skip


def misses(series: list[str]) -> pl.DataFrame:
    return pl.concat(
        pl.DataFrame(
            {"fill_ratio": [0.01, 0.02, 0.05, 0.1], "series": name, "missed": [0.8, 0.5 - 0.1 * at, 0.1, 0.0]}
        )
        for at, name in enumerate(series)
    ).with_columns(
        low=(pl.col("missed") - 0.05).clip(0), high=(pl.col("missed") + 0.05).clip(0, 1), runs=1000
    )


def places(count: int) -> pl.DataFrame:
    rng = np.random.default_rng(6)
    return pl.DataFrame({"x_m": rng.beta(1.3, 1.3, count), "y_m": rng.beta(1.3, 1.3, count)})


def scores(columns: list[str], rows: int = 30) -> pl.DataFrame:
    rng = np.random.default_rng(7)
    return pl.DataFrame(
        {"iteration": range(1, rows + 1)} | {name: 600 * rng.random(rows) for name in columns}
    )


def fields(series: list[str]) -> pl.DataFrame:
    return pl.concat(
        pl.DataFrame({"iteration": range(9), "series": name, "share": np.linspace(0, 1 / (at + 1), 9)})
        for at, name in enumerate(series)
    )


def spectra(series: list[str]) -> pl.DataFrame:
    hz = np.linspace(5, 200, 300)
    return pl.concat(
        pl.DataFrame({"hz": hz, "series": name, "amplitude": 0.02 + 1 / (1 + (hz - 60 - 20 * at) ** 2)})
        for at, name in enumerate(series)
    )


def reported(robots: int) -> pl.DataFrame:
    rows = [
        {"name": name, "robot": robot, "time_s": float(t), "value": t * 0.01 + robot}
        for name in ("estimate", "trust")
        for robot in range(robots)
        for t in range(0, 1200, 100)
    ]
    return pl.DataFrame(rows)


RASTER = np.random.default_rng(8).random((30, 40))
LINES_HZ = pl.DataFrame(
    {"hz": [60.0, 80.0], "low": [59.0, 79.0], "high": [61.0, 81.0], "amplitude": [1.0, 0.5]}
)
TILES = np.array([[1, 0, 0], [0, 1, 1], [0, 0, 1]], dtype=np.uint8)

PICTURES: dict[str, Callable[[str], Picture]] = {
    "boxes": lambda style: draw_boxes(runs(["none", "soft"]), t_end=1200, style=style),
    "boxes, long names": lambda style: draw_boxes(runs(LONG, 9, LONG[:3]), t_end=1200, title=LONG[1], style=style),
    "boxes, forty": lambda style: draw_boxes(runs(FORTY, 9, ["a", "b"]), t_end=1200, style=style),
    "boxes, one run": lambda style: draw_boxes(runs(["one"], 1, undecided=0), t_end=1200, style=style),
    "boxes, all undecided": lambda style: draw_boxes(runs(["one", "two"], undecided=1), t_end=1200, style=style),
    "boxes, no end": lambda style: draw_boxes(runs(["one", "two"], undecided=1), style=style),
    "boxes, no spread": lambda style: draw_boxes(
        runs(["a", "b"]).with_columns(value=pl.lit(7.0)), t_end=1200, style=style
    ),
    "outcomes": lambda style: draw_outcomes(counts(["none", "soft"]), style=style),
    "outcomes, long names": lambda style: draw_outcomes(counts(LONG), title=LONG[3], unit="robot", style=style),
    "outcomes, forty": lambda style: draw_outcomes(counts(FORTY), style=style),
    "outcomes, none": lambda style: draw_outcomes(pl.DataFrame({"cell": ["a"], "right": [0]}), style=style),
    "forest": lambda style: draw_forest(differences(["a", "b"]), better="low", style=style),
    "forest, long names": lambda style: draw_forest(differences(LONG), better="high", title="x", style=style),
    "forest, forty": lambda style: draw_forest(differences(FORTY), style=style),
    "forest, no value": lambda style: draw_forest(
        differences(["a"]).with_columns(pl.lit(None, pl.Float64).alias(n) for n in ("difference", "low", "high")),
        style=style,
    ),
    "bars": lambda style: draw_error_bars(estimates([0.1, 0.2, 0.4], ["none", "soft"]), x_label="eta", style=style),
    "bars, log": lambda style: draw_error_bars(
        estimates([1000, 2000, 5000, 12_000], list("abcdefgh")), log=True, x_label=LONG[0], label=LONG[3], style=style
    ),
    "bars, long names": lambda style: draw_error_bars(
        estimates(LONG, LONG), x_label=LONG[0], label=LONG[3], style=style
    ),
    "bars, forty": lambda style: draw_error_bars(estimates(FORTY, ["a", "b", "c"]), style=style),
    "bars, one without width": lambda style: draw_error_bars(estimates([5], [""], 0.0), title="t", style=style),
    "incidence": lambda style: draw_incidence(curves(["soft"]), runs=1000, style=style),
    "incidence, long names": lambda style: draw_incidence(curves(LONG), title=LONG[1], style=style),
    "incidence, nobody": lambda style: draw_incidence(
        pl.DataFrame({"time_s": [0.0], "right": [0.0], "wrong": [0.0]}), t_end=1200, style=style
    ),
    "belief": lambda style: draw_belief(beliefs([""]), runs=1000, style=style),
    "belief, long names": lambda style: draw_belief(beliefs(LONG), label=LONG[3], title="x", style=style),
    "belief, one time": lambda style: draw_belief(beliefs([""], 1), style=style),
    "heat": lambda style: draw_heat(grid([40, 55, 70], [1000, 3778]), best="low", best_within=8, style=style),
    "heat, long names": lambda style: draw_heat(
        grid(LONG, LONG), x_label=LONG[1], y_label=LONG[3], label=LONG[3], best="high", title=LONG[1], style=style
    ),
    "heat, forty": lambda style: draw_heat(grid(list(range(40)), FORTY), style=style),
    "heat, forty names": lambda style: draw_heat(grid(FORTY, list(range(40))), style=style),
    "heat, one": lambda style: draw_heat(grid([1], [1]), best="low", style=style),
    "heat, nothing": lambda style: draw_heat(
        grid([1, 2], [1]).with_columns(value=pl.lit(None, pl.Float64)), best="low", style=style
    ),
    "density": lambda style: draw_density(places(5000), tiles=TILES, style=style),
    "density, wide": lambda style: draw_density(
        places(900).with_columns(pl.col("x_m") * 3), width_m=3, title="wide", highest=1.1, style=style
    ),
    "density, one": lambda style: draw_density(places(1), tiles=TILES, bins=4, style=style),
    "front": lambda style: draw_front(choices(25), percent=True, style=style),
    "front, one": lambda style: draw_front(choices(1), style=style),
    "front, thousands": lambda style: draw_front(choices(5000), style=style),
    "detection": lambda style: draw_detection(misses(["600 s", "1200 s"]), boundary=0.03, tolerated=0.05, style=style),
    "detection, log": lambda style: draw_detection(misses(LONG), log=True, title="x", style=style),
    "search": lambda style: draw_search(scores(["best", "mean"]), true=300.0, style=style),
    "parameters": lambda style: draw_parameters(fields(list("abcdefgh")), style=style),
    "parameters, long names": lambda style: draw_parameters(fields(LONG), title=LONG[1], style=style),
    "spectrum": lambda style: draw_spectrum(spectra(["still", "vibrating"]), LINES_HZ, style=style),
    "spectrum, long names": lambda style: draw_spectrum(spectra(LONG), LINES_HZ, title=LONG[1], style=style),
    "reports": lambda style: draw_reports(reported(5), truth=0.48, style=style),
    "certainty": lambda style: draw_certainty(RASTER, (1.0, 0.75), np.full((4, 2), 0.4), style=style),
    "rasters": lambda style: draw_rasters({"1 s": RASTER, "2 s": RASTER, "robot 1": RASTER}, (1.0, 0.75), style=style),
    "certainty, wide": lambda style: draw_certainty(RASTER, (9.0, 1.0), np.full((4, 2), 0.4), style=style),
    "certainty, tall": lambda style: draw_certainty(RASTER, (0.5, 1.0), np.full((4, 2), 0.4), title="x", style=style),
}  # fmt: skip


@cache
def in_a_column(name: str) -> Picture:
    """The picture that several tests look at and leave as it is."""
    return PICTURES[name]("column")


def texts_of(figure: Figure) -> list[tuple[str, Any]]:
    """The words that a file would have, and their boxes in pixels; none for slanted ones. No pixel is drawn."""
    found: dict[int, Text] = {}

    def noted(text: Text, renderer: Any) -> None:
        if text.get_visible() and text.get_text().strip():
            found[id(text)] = text

    with settings(), _as_laid_out(figure), mock.patch.object(Text, "draw", noted):
        renderer = figure._get_renderer()
        figure.draw_without_rendering()
    return [
        (text.get_text(), None if text.get_rotation() % 90 else Text.get_window_extent(text, renderer))
        for text in found.values()
    ]


def faults_of(figure: Figure) -> list[str]:
    """Words over other words, and words that the picture's edge cuts. Slanted words are left out."""
    texts = [(words, box) for words, box in texts_of(figure) if box is not None]
    frame, faults = figure.bbox, []
    for words, box in texts:
        if box.x0 < frame.x0 - 1 or box.y0 < frame.y0 - 1 or box.x1 > frame.x1 + 1 or box.y1 > frame.y1 + 1:
            faults.append(f"{words!r} is cut")
    for (first, one), (second, two) in combinations(texts, 2):
        wide = min(one.x1, two.x1) - max(one.x0, two.x0)
        high = min(one.y1, two.y1) - max(one.y0, two.y0)
        if wide > 1 and high > 0.2 * min(one.height, two.height):
            faults.append(f"{first!r} and {second!r} overlap")
    return faults


LARGEST = ("outcomes, forty", "heat, forty", "boxes, forty", "front, thousands")
"""Cases with the most marks."""
OF_ODD_DATA = (
    "one run", "all undecided", "no end", "no spread", "none", "no value", "one without width", "nobody", "one time",
    "one", "nothing",
)  # fmt: skip
"""Cases of what is drawn, not of the room that words have: they are drawn in the narrowest style only."""
OF_SHORT_NAMES = (
    "outcomes", "forest", "incidence", "belief", "parameters", "spectrum", "boxes", "heat", "bars", "certainty",
)  # fmt: skip
"""Cases whose only words that have less room on a slide are names: those with long names are drawn there, and maps of
other shapes."""


def name_and_style() -> Iterator[tuple[str, str]]:
    """A column has the least width for its type, a slide the least height; a page, between them, has one case."""
    for name in PICTURES:
        yield name, "column"
        if name.partition(", ")[2] not in OF_ODD_DATA and name not in OF_SHORT_NAMES:
            yield name, "slide"
    yield "boxes, long names", "page"


MAPS = ("density", "certainty", "certainty, tall", "rasters")
"""Cases with axes to scale; a slide keeps its shape, elsewhere the picture gets theirs."""


def maps_fill_their_room(figure: Figure) -> bool:
    """Whether there are axes to scale, and all fill their room; the rest is the gap to a colour bar."""
    maps = [axes for axes in figure.axes if axes.get_aspect() != "auto"]
    rooms = [(axes.get_position(), axes.get_position(original=True)) for axes in maps]
    shares = [min(own.width / left.width, own.height / left.height) for own, left in rooms]
    return min(shares, default=0.0) > 0.94


@pytest.mark.parametrize(("name", "style"), list(name_and_style()))
def test_no_word_hides_another_or_is_cut(name, style):
    picture = in_a_column(name) if style == "column" else PICTURES[name](style)
    assert picture.style == style
    if name in MAPS and style == "column":
        assert maps_fill_their_room(picture.figure)
    elif name == "density":
        assert picture.figure.get_figheight() == STYLES[style].height_in
    assert faults_of(picture.figure) == []
    assert picture.figure.get_figwidth() == STYLES[style].width_in
    assert len(picture.caption) > 20
    assert picture.numbers.height > 0
    if style == "column" and name in LARGEST:
        assert len(picture.svg()) < 1_600_000


@pytest.mark.parametrize("style", STYLES)
def test_a_name_on_the_front_stands_nearer_to_its_own_point_than_to_any_other(style):
    """Eight points in a curve, whose last name had no room but beside the one before."""
    k = np.arange(8)
    frame = pl.DataFrame(
        {"name": [f"strategy-{n}" for n in k], "time": 300 + 60 * k, "error": 0.3 * np.exp(-k / 3)}
    )
    figure = draw_front(frame, style=style).figure
    boxes = {words: box for words, box in texts_of(figure) if words in frame["name"]}
    assert len(boxes) == (0 if style == "column" else 8)  # a column has numbers, and the names below
    at = figure.axes[0].transData.transform(frame.select("time", "error").to_numpy())
    for n, name in enumerate(frame["name"]):
        if box := boxes.get(name):
            outside = np.maximum([box.x0, box.y0] - at, at - [box.x1, box.y1])
            assert np.hypot(*np.maximum(outside, 0.0).T).argmin() == n


def test_the_check_for_hidden_words_finds_them():
    with settings():
        figure = Figure(figsize=(3, 2))
        axes = figure.add_subplot()
        axes.text(0.5, 0.5, "one thing")
        axes.text(0.52, 0.52, "another")
        axes.set_ylabel("cut " * 30)
    faults = " ".join(faults_of(figure))
    assert "'one thing' and 'another' overlap" in faults
    assert "is cut" in faults


KINDS_OF_MARKS = ("outcomes", "certainty")
"""Cases with hatches and images, which get names of their own in a file; ``test_plots_style`` has lines and markers."""


@pytest.mark.parametrize("name", KINDS_OF_MARKS)
def test_the_same_frame_gives_the_same_bytes(name):
    one, two = (PICTURES[name]("column").figure for _ in range(2))
    for kind in ("svg", "pdf", "png")[: 3 if name == "outcomes" else 2]:  # in PNG all marks are pixels
        assert picture_bytes(one, kind, dots_per_inch=60) == picture_bytes(two, kind, dots_per_inch=60), kind


# What is drawn is what the numbers say.


def lines_of(picture: Picture, panel: int = 0) -> list[np.ndarray]:
    return [np.asarray(line.get_xydata()) for line in picture.figure.axes[panel].lines]


def holds(lines: list[np.ndarray], points: Any) -> bool:
    wanted = np.asarray(points, dtype=float)
    return any(line.shape == wanted.shape and np.allclose(line, wanted, equal_nan=True) for line in lines)


def boxes_of(picture: Picture) -> list[Rectangle]:
    return [
        patch
        for patch in picture.figure.axes[0].patches
        if isinstance(patch, Rectangle) and patch.zorder == 2
    ]


@pytest.mark.usefixtures("without_layout")
def test_boxes_stand_at_their_quantiles():
    frame = runs(["a", "b"], 101, undecided=0)
    picture = draw_boxes(frame, t_end=1200)
    boxes = boxes_of(picture)
    assert len(boxes) == picture.numbers.height == 2
    for row, box in zip(picture.numbers.to_dicts(), boxes, strict=True):
        values = frame.filter(pl.col("cell") == row["cell"])["value"].to_numpy()
        assert [row[name] for name in ("q05", "q25", "median", "q75", "q95")] == pytest.approx(
            np.quantile(values, [0.05, 0.25, 0.5, 0.75, 0.95])
        )
        assert (box.get_x(), box.get_x() + box.get_width()) == pytest.approx((row["q25"], row["q75"]))
        for low, high in (
            ("q05", "q05"),
            ("q05", "q25"),
            ("median", "median"),
            ("q75", "q95"),
            ("q95", "q95"),
        ):
            assert any(np.allclose(line[:, 0], (row[low], row[high])) for line in lines_of(picture))
    assert "box: 25 % to 75 %; whiskers: 5 % to 95 % of the runs" in picture.caption


def group_of(values: list[float], runs: int) -> Group:
    return Group("", "", 0.0, look(0), np.array(values), runs)


def test_undecided_runs_count_as_later_than_the_end():
    assert quantile(group_of([1, 2, 3], 5), 0.5, censored=True) == 3
    assert (
        quantile(group_of([1, 2, 3], 6), 0.5, censored=True) is None
    )  # between the third and an undecided one
    assert quantile(group_of([1, 2, 3], 5), 0.5, censored=False) == 2
    assert quantile(group_of([], 4), 0.5, censored=True) is None
    assert quantile(group_of([], 0), 0.5, censored=True) is None


def test_undecided_runs_are_never_dropped_in_silence():
    frame = runs(["some", "all"], 40, undecided=0.5).with_columns(
        value=pl.when(pl.col("cell") == "all").then(None).otherwise(pl.col("value"))
    )
    lost = frame["value"].null_count()
    for t_end in (None, 1200.0):
        picture = draw_boxes(frame, t_end=t_end)
        told = [words for words, _ in texts_of(picture.figure)]
        assert {"undecided", "100 %"} <= set(told)
        assert f"{lost} of 80 are undecided" in picture.caption
        assert ("later than the end of the runs (shaded)" in picture.caption) == (t_end is not None)
        by_cell = picture.numbers.group_by("cell", maintain_order=True).first()
        assert by_cell["undecided"].sum() == lost
        assert by_cell["runs"].to_list() == [40, 40]
    assert picture.numbers["median"][1] is None
    assert 1200 < boxes_of(picture)[1].get_x() < picture.figure.axes[0].get_xlim()[1]


def test_a_value_behind_the_end_is_refused():
    with pytest.raises(InputError, match="later than the end at 100"):
        draw_boxes(runs(["a"]), t_end=100)


@pytest.mark.usefixtures("without_layout")
def test_few_runs_are_drawn_one_by_one():
    picture = draw_boxes(runs(["a"], 3, undecided=0), t_end=1200)
    assert picture.numbers["mark"].to_list() == ["run"] * 3
    assert holds(lines_of(picture), [(value, 0) for value in picture.numbers["value"]])


@pytest.mark.usefixtures("without_layout")
def test_outcome_bars_are_the_shares_and_fill_the_row():
    frame = counts(["a", "b", "c"])
    picture = draw_outcomes(frame)
    bars = picture.figure.axes[0].patches
    drawn = sorted((round(bar.get_y() + bar.get_height() / 2), bar.get_x(), bar.get_width()) for bar in bars)
    at = 0
    for row, values in enumerate(picture.numbers.to_dicts()):
        left = 0.0
        for kind in ("right", "wrong", "split", "incomplete", "truth_undefined"):
            if values[kind]:
                assert drawn[at] == pytest.approx((row, left, values[kind]))
                left, at = left + values[kind], at + 1
        assert left == pytest.approx(1)
        low, high = values["right_low"], values["right_high"]
        for ends in ((low, high), (low, low), (high, high)):
            assert any(
                np.allclose((*line[:, 0], line[:, 1].mean()), (*ends, row)) for line in lines_of(picture)
            )
    assert at == len(drawn)
    assert picture.numbers["right"].to_list() == [count / 200 for count in frame["right"]]
    words = [text.get_text() for text in picture.figure.axes[0].texts]
    assert words == [f"{round(100 * right)} %" for right in picture.numbers["right"]]
    assert picture.numbers["runs"].to_list() == [200] * 3
    for unit, beside in (("run", ""), ("robot", " (robots)")):
        (legend,) = draw_outcomes(frame, unit=unit).figure.legends
        kinds = ("right", "wrong", "split", "incomplete", "truth undefined")
        assert [text.get_text() for text in legend.get_texts()] == [f"{kind}{beside}" for kind in kinds]


@pytest.mark.parametrize(
    ("xs", "ticks"),
    [
        ([5, 6, 7, 8, 9, 10], [5, 6, 7, 8, 9, 10]),
        ([0.44, 0.48, 0.52, 0.56], [0.44, 0.48, 0.52, 0.56]),
        ([-1.5, 0.0, 2.0], [-1.5, 0.0, 2.0]),
        ([7], [7]),
    ],
)
def test_numbers_stand_at_the_values_where_these_are_few(xs, ticks):
    (axes,) = draw_error_bars(estimates(xs, ["none", "soft"])).figure.axes
    assert axes.get_xticks().tolist() == ticks
    shown = [axes.xaxis.get_major_formatter()(tick) for tick in ticks]
    assert shown == [f"{tick:g}".replace("-", "\u2212") for tick in ticks]


def test_measured_values_are_no_ticks():
    (axes,) = draw_error_bars(estimates([534.0960581, 612.1787862, 637.3786844], ["none"])).figure.axes
    assert [tick for tick in axes.get_xticks() if not float(tick).is_integer()] == []


@pytest.mark.parametrize("xs", [[1, 2, 500], list(range(5, 40))])
def test_of_values_that_are_many_or_crowded_whole_numbers_are_shown(xs):
    picture = draw_error_bars(estimates(xs, ["none"]))
    picture.figure.draw_without_rendering()
    ticks = picture.figure.axes[0].get_xticks()
    assert all(float(tick).is_integer() for tick in ticks)
    assert len(ticks) < 9


@pytest.mark.parametrize("name", ["bars", "density"])
def test_axes_are_laid_out_where_drawing_puts_them(name):
    """Those of a map have an aspect, and a bar beside them that follows it."""
    one, two = (PICTURES[name]("column").figure for _ in range(2))
    for figure in (one, two):
        figure.set_figheight(5)
    lay_out(one)
    two.draw_without_rendering()
    at, expected = ([axes.get_position().bounds for axes in figure.axes] for figure in (one, two))
    assert at == expected


def test_labels_of_thousands_of_values_are_not_laid_out():
    with mock.patch("vibroswarm.plots.layout.lay_out") as laid_out:
        draw_error_bars(estimates(list(range(5000)), ["none"]))
    assert not laid_out.called
    with mock.patch("vibroswarm.plots.layout.lay_out") as laid_out:
        draw_error_bars(estimates(list(range(5)), ["none"]))
    assert laid_out.called


@pytest.mark.usefixtures("without_layout")
def test_error_bars_are_where_the_frame_says():
    frame = estimates([3, 1, 2], ["only"]).with_columns(
        estimate=pl.when(pl.col("x") == 2).then(None).otherwise(pl.col("estimate"))
    )
    picture = draw_error_bars(frame)
    ordered = frame.sort("x")
    lines = lines_of(picture)
    assert holds(lines, np.column_stack([ordered["x"], ordered["estimate"].fill_null(np.nan)]))
    bars = picture.figure.axes[0].collections[0].get_segments()
    known = ordered.drop_nulls("estimate")
    assert np.allclose(
        bars, [[(x, low), (x, high)] for x, low, high in known.select("x", "low", "high").iter_rows()]
    )
    assert "1 of 3 has no value" in picture.caption
    assert "1,000 runs each" in picture.caption
    assert picture.numbers["estimate"].to_list() == frame["estimate"].to_list()


@pytest.mark.usefixtures("without_layout")
def test_a_logarithmic_axis_refuses_0_of_a_constant_series_too():
    rows = [
        (x, name, 1.0 if name == "level" else x + 1.0)
        for name in ("level", "rising")
        for x in (1.0, 2.0, 4.0)
    ]
    frame = pl.DataFrame([*rows, (0.0, "level", 1.0)], schema=["x", "series", "estimate"], orient="row")
    frame = frame.with_columns(low=pl.col("estimate") - 0.1, high=pl.col("estimate") + 0.1)
    draw_error_bars(frame.filter(pl.col("x") > 0), log=True)
    with pytest.raises(InputError, match="x: a logarithmic axis needs numbers above 0"):
        draw_error_bars(frame, log=True)


@pytest.mark.usefixtures("without_layout")
def test_a_constant_series_is_drawn_at_its_first_value():
    """A series may have no value at some x, or nowhere."""
    levels = {
        "first": [None, 2.0, 2.0],
        "same": [2.0] * 3,
        "never": [None, None, None],
        "rising": [1.0, 2.0, 3.0],
    }
    rows = [(float(x), name, value) for name, values in levels.items() for x, value in enumerate(values)]
    frame = pl.DataFrame(rows, schema={"x": float, "series": str, "estimate": float}, orient="row")
    frame = frame.with_columns(low=pl.col("estimate") - 0.1, high=pl.col("estimate") + 0.1)
    picture = draw_error_bars(frame, constant=("first", "same", "never"))
    (axes,) = picture.figure.axes
    assert [
        line.get_ydata()[0]
        for line in axes.lines
        if len(set(line.get_xdata())) == 2 and list(line.get_xdata()) == [0, 1]
    ] == [2.0]
    (band,) = axes.patches
    assert (band.get_y(), band.get_y() + band.get_height()) == pytest.approx((1.9, 2.1))
    (legend,) = picture.figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["first = same", "never", "rising"]
    assert "4 of 12 have no value." in picture.caption


def test_names_without_a_value_say_so():
    frame = estimates(["a", "b"], [""]).with_columns(
        estimate=pl.when(pl.col("x") == "a").then(float("nan")).otherwise(pl.col("estimate"))
    )
    picture = draw_error_bars(frame)
    assert "no value" in [words for words, _ in texts_of(picture.figure)]
    assert holds(lines_of(picture), [(frame["low"][1], 1), (frame["high"][1], 1)])


@pytest.mark.usefixtures("without_layout")
def test_a_range_is_drawn_as_a_band():
    (band,) = draw_error_bars(estimates([1, 2], [""], 30.0), spans=True).figure.axes[0].collections
    limits = estimates([1, 2], [""], 30.0).select("low", "high").to_numpy()
    vertices = band.get_paths()[0].vertices[:, 1]
    assert (vertices.min(), vertices.max()) == pytest.approx((limits.min(), limits.max()))


@pytest.mark.usefixtures("without_layout")
def test_incidence_rises_and_falls_as_told():
    frame = curves(["soft"], 30)
    picture = draw_incidence(frame, runs=500, t_end=1300)
    (axes,) = picture.figure.axes
    bands = dict(
        zip(
            ("right", "wrong"), (band.get_paths()[0].vertices[:, 1] for band in axes.collections), strict=True
        )
    )
    for kind, sign in (("right", 1), ("wrong", -1)):
        heights = sign * frame[kind].to_numpy()
        points = np.column_stack([[*frame["time_s"], 1300.0], [*heights, heights[-1]]])
        assert holds(lines_of(picture), points)
        limits = sign * frame.select(f"{kind}_low", f"{kind}_high").to_numpy()
        assert (bands[kind].min(), bands[kind].max()) == pytest.approx((limits.min(), limits.max()))
    assert {line.get_drawstyle() for line in axes.lines if len(line.get_xdata()) > 2} == {"steps-post"}
    heights = {text.get_text(): text.xy[1] for text in axes.texts}
    assert heights["wrong"] < 0.5 < heights["right"]
    rest = 1 - frame["right"][-1] - frame["wrong"][-1]
    assert f"Without consensus at 1300 s: soft {100 * rest:.0f} %" in picture.caption  # split or incomplete
    assert "500 runs" in picture.caption
    assert "Undecided at" in draw_incidence(frame, unit="robot").caption
    last = pl.DataFrame({"time_s": [9.0], "right": [0.7], "wrong": [0.3]})  # 1 - 0.7 - 0.3 is above 0
    assert draw_incidence(last).caption.endswith("Without consensus at 9 s: 0 %.")


@pytest.mark.usefixtures("without_layout")
def test_long_curves_are_thinned_and_say_so():
    frame = curves(["soft"], 100_000)
    picture = draw_incidence(frame)
    assert picture.numbers.height == 1000
    assert picture.numbers["time_s"][0] == 0
    assert picture.numbers["time_s"][-1] == 1200
    assert "Drawn at 1000 of the times" in picture.caption
    assert len(picture.svg()) < 300_000
    belief = draw_belief(beliefs([""], 100_000))
    assert belief.numbers.height == 1000
    assert len(belief.svg()) < 400_000


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        ({"right": [0.2, 0.1]}, "falls with time"),
        ({"right": [0.2, 0.9]}, "at most 1"),
        ({"right": [0.2, None]}, "missing number"),
        ({"right": ["a", "b"]}, "holds String, not numbers"),
    ],
)
def test_shares_that_cannot_be_are_refused(change, wrong):
    frame = pl.DataFrame({"time_s": [0.0, 1.0], "right": [0.1, 0.2], "wrong": [0.1, 0.2]} | change)
    with pytest.raises(InputError, match=wrong):
        draw_incidence(frame)


@pytest.mark.usefixtures("without_layout")
def test_belief_draws_its_quantiles():
    frame = beliefs([""], 50)
    picture = draw_belief(frame, thresholds=(0.95, 0.05))
    assert holds(lines_of(picture), frame.select("time_s", "q50").to_numpy())
    levels = {line[0, 1] for line in lines_of(picture) if len(line) == 2 and line[0, 1] == line[1, 1]}
    assert levels == {0.95, 0.05, 0.5}
    bands = [band.get_paths()[0].vertices for band in picture.figure.axes[0].collections]
    for band, (low, high) in zip(bands, (("q05", "q95"), ("q25", "q75")), strict=True):
        assert band[:, 1].min() == pytest.approx(frame[low].min())
        assert band[:, 1].max() == pytest.approx(frame[high].max())
    assert "bands: 5 % to 95 % and 25 % to 75 % of the runs" in picture.caption
    with pytest.raises(InputError, match="q05: is the same quantile as q050"):
        draw_belief(frame.with_columns(q050=pl.col("q05")))
    with pytest.raises(InputError, match="no partner at 75 %"):
        draw_belief(frame.drop("q75"))
    with pytest.raises(InputError, match="out of order"):
        draw_belief(frame.with_columns(q05=pl.lit(0.99)))


def mesh_of(picture: Picture) -> QuadMesh:
    (mesh,) = [part for part in picture.figure.axes[0].collections if isinstance(part, QuadMesh)]
    return mesh


def test_heat_puts_each_value_at_its_place_and_finds_the_best():
    frame = grid([70, 40, 55], [1, 2]).filter(~((pl.col("x") == 55) & (pl.col("y") == 2)))
    picture = draw_heat(frame, best="low", best_within=8.0)
    cells = mesh_of(picture).get_array().reshape(2, 3)
    for x, y, value in frame.select("x", "y", "value").iter_rows():
        assert cells[[1, 2].index(y), [40, 55, 70].index(x)] == value
    assert cells.mask.sum() == 1
    assert picture.numbers.filter("best").select("x", "y").rows() == [(40, 1), (55, 1)]
    assert (
        "Outlined: the lowest and all within 8 of it. Hatched: 1 of 6 cells has no value" in picture.caption
    )
    highest = in_a_column("heat, long names")
    assert highest.numbers.filter("best")["value"].to_list() == [highest.numbers["value"].max()]
    assert highest.caption.endswith("Outlined: the highest.")
    told = [words for words, _ in texts_of(picture.figure)]
    assert {"900", "893", "886", "911", "904"} <= set(told)
    colours = {text.get_text(): text.get_color() for text in picture.figure.axes[0].texts}
    assert (colours["886"], colours["911"]) == (ON_DARK, ON_LIGHT)  # the scale begins dark
    shares = pl.DataFrame({"x": [1, 2, 3], "y": 1, "value": [29.17, 25.0, 0.417]})
    assert {"29.2", "25.0", "0.4"} <= {words for words, _ in texts_of(draw_heat(shares).figure)}
    in_percent = draw_heat(shares.with_columns(pl.col("value") / 100), percent=True).figure
    assert {"29.2", "25.0", "0.4"} <= {words for words, _ in texts_of(in_percent)}
    assert in_percent.axes[1].get_yticklabels()[1].get_text().endswith(" %")


def test_heat_leaves_numbers_out_where_they_do_not_fit():
    told = [words for words, _ in texts_of(draw_heat(grid(list(range(40)), list(range(40)))).figure)]
    assert "886" not in told


@pytest.mark.parametrize("name", ["certainty, tall", "rasters"])
def test_maps_to_scale_fill_the_room_that_the_layout_leaves(name):
    """On a page; in a column the test of words looks too."""
    assert maps_fill_their_room(PICTURES[name]("page").figure)


@pytest.mark.usefixtures("without_layout")
def test_certainty_is_a_standard_deviation_and_marks_stand_at_their_places():
    probability = np.array([[0.5, 0.9], [0.1, 1.0], [0.0, 0.2]])
    marked = [(0.2, 0.4, 1.0, 0.5, True), (0.1, 0.3, 0.2, 0.4, False)]
    picture = draw_certainty(probability, (2.0, 3.0), np.array([[0.5, 1.0], [2.1, 0.2]]), marked_m=marked)
    for axes, values, most in zip(
        picture.figure.axes[:2],
        (probability, np.sqrt(probability * (1 - probability))),
        (1.0, 0.5),
        strict=True,
    ):
        (image,) = axes.images
        assert np.allclose(image.get_array(), values)
        assert (image.get_extent(), image.get_clim()) == ([0.0, 2.0, 0.0, 3.0], (0.0, most))
        # A place outside the surface made the map on the right smaller than the one on the left.
        assert (axes.get_xlim(), axes.get_ylim()) == ((0.0, 2.0), (0.0, 3.0))
        places = [(*mark.get_center(), mark.get_width(), mark.get_height()) for mark in axes.patches[::2]]
        assert np.allclose(places, [(0.7, 0.65, 1.0, 0.5), (0.2, 0.5, 0.2, 0.4)])
    assert holds(lines_of(picture, 1), [(0.5, 1.0), (2.1, 0.2)])
    assert picture.numbers["standard_deviation"].to_list() == pytest.approx([0.5, 0.3, 0.3, 0.0, 0.0, 0.4])


@pytest.mark.usefixtures("without_layout")
def test_density_is_in_units_of_even_sampling():
    even = pl.DataFrame(
        [(x + 0.5, y + 0.5) for x in range(4) for y in range(2)], schema=["x_m", "y_m"], orient="row"
    )
    picture = draw_density(even, width_m=4, height_m=2, bins=4)
    assert picture.numbers["density"].to_list() == [1.0] * 8
    picture = draw_density(places(3000), bins=10)
    numbers = picture.numbers
    assert numbers["density"].mean() == pytest.approx(1)
    assert numbers["count"].sum() == 3000
    drawn = mesh_of(picture).get_array().reshape(10, 10)
    for row in numbers.sample(20, seed=1).to_dicts():
        assert drawn[round(row["y_low_m"] * 10), round(row["x_low_m"] * 10)] == pytest.approx(row["density"])
    counted = numbers.with_columns(
        x_m=(pl.col("x_low_m") + pl.col("x_high_m")) / 2, y_m=(pl.col("y_low_m") + pl.col("y_high_m")) / 2
    )
    assert draw_density(counted, bins=10).numbers.equals(numbers)
    assert "above the colours' end" not in picture.caption
    wide = PICTURES["density, wide"]("column")
    above = wide.numbers.filter(pl.col("density") > 1.1).height
    assert f"{above} bins lie above the colours' end at 1.1." in wide.caption
    with pytest.raises(InputError, match="outside the arena of 1 m x 1 m"):
        draw_density(places(9).with_columns(pl.col("x_m") + 1))


@pytest.mark.usefixtures("without_layout")
def test_the_front_is_what_nothing_beats():
    frame = choices(30)
    picture = draw_front(frame)
    for row in picture.numbers.to_dicts():
        beaten = frame.filter(
            (pl.col("time") <= row["time"]) & (pl.col("error") <= row["error"])
            & ((pl.col("time") < row["time"]) | (pl.col("error") < row["error"]))
        )  # fmt: skip
        assert row["front"] == beaten.is_empty()
    front = picture.numbers.filter("front").sort("number")
    assert front["number"].to_list() == list(range(1, front.height + 1))
    assert holds(lines_of(picture), front.select("time", "error").to_numpy())
    off, on = (line for line in picture.figure.axes[0].lines if line.get_marker() in ("s", "o"))
    assert "steps-post" in {line.get_drawstyle() for line in picture.figure.axes[0].lines}
    assert (off.get_markerfacecolor(), len(off.get_xdata())) == (PAPER, 30 - front.height)
    assert on.get_markerfacecolor() != PAPER
    bars = np.concatenate([part.get_segments() for part in picture.figure.axes[0].collections])
    for row in frame.to_dicts():
        for low, high in (
            (("time_low", "error"), ("time_high", "error")),
            (("time", "error_low"), ("time", "error_high")),
        ):
            ends = [[row[name] for name in end] for end in (low, high)]
            assert np.isclose(bars, ends).all(axis=(1, 2)).any()
    assert (
        "2 without a value"
        in draw_front(
            frame.with_columns(time=pl.when(pl.int_range(30) < 2).then(None).otherwise(pl.col("time")))
        ).caption
    )


@pytest.mark.usefixtures("without_layout")
def test_detection_draws_each_curve():
    frame = misses(["600 s", "1200 s"])
    picture = draw_detection(frame, boundary=0.03, tolerated=0.05)
    for name in ("600 s", "1200 s"):
        # Curves are a little apart, so that their bars do not cover each other.
        missed = frame.filter(pl.col("series") == name)["missed"].to_numpy()
        assert any(np.array_equal(line[:, 1], missed) for line in lines_of(picture))
    assert picture.numbers.select(frame.columns).equals(frame.cast({"runs": pl.Float64}))
    assert holds(lines_of(picture), [(0, 0.05), (1, 0.05)])
    assert holds(lines_of(picture), [(0.03, 0), (0.03, 1)])
    assert "5 % tolerated" in picture.caption
    assert "decision boundary 0.03" in picture.caption
    in_percent = draw_detection(frame, boundary=0.025, percent=True)  # as the tables of `detect`
    assert "decision boundary 2.5 %" in in_percent.caption
    (axes,) = in_percent.figure.axes
    assert axes.xaxis.get_major_formatter()(0.04) == "4 %"
    with pytest.raises(InputError, match="missed: contains a number outside 0 to 1"):
        draw_detection(frame.with_columns(missed=pl.lit(1.5)))


def test_forest_rows_are_the_differences():
    frame = differences(["a", "b", "c"])
    picture = draw_forest(frame)
    lines = lines_of(picture)
    open_marks = [
        line.get_markerfacecolor() == PAPER
        for line in picture.figure.axes[0].lines
        if line.get_marker() == "D"
    ]
    assert open_marks == frame.select((pl.col("low") <= 0) & (pl.col("high") >= 0)).to_series().to_list()
    assert len(set(open_marks)) == 2
    for name, arrow in (("forest", "← better"), ("forest, long names", "better →")):  # low, high
        assert arrow in [text.get_text() for text in in_a_column(name).figure.axes[0].texts]
    for row, values in enumerate(frame.to_dicts()):
        assert holds(lines, [(values["low"], row), (values["high"], row)])
        assert holds(lines, [(values["difference"], row)])
    assert [words for words, _ in texts_of(picture.figure)].count("610 / 20 / 370") == 3
    assert picture.numbers.select(frame.columns).equals(frame.cast({pl.Int32: pl.Float64}), null_equal=True)


@pytest.mark.parametrize(
    ("frame", "wrong"),
    [
        (
            pl.DataFrame({"x": [1], "estimat": [1.0], "low": [0.0], "high": [2.0]}),
            "estimate: .*did you mean 'estimat'",
        ),
        (pl.DataFrame({"x": [1], "estimate": [3.0], "low": [0.0], "high": [2.0]}), "3.0 does not lie in"),
        (
            pl.DataFrame({"x": [1, 1], "estimate": [1.0] * 2, "low": [0.0] * 2, "high": [2.0] * 2}),
            "two rows have x 1",
        ),
        (pl.DataFrame({"x": [1], "estimate": [float("inf")], "low": [0.0], "high": [2.0]}), "infinite"),
        (
            pl.DataFrame(
                {"x": [None], "estimate": [1.0], "low": [0.0], "high": [2.0]},
                schema_overrides={"x": pl.Float64},
            ),
            "x: holds a missing",
        ),
        (
            pl.DataFrame(
                schema={"x": pl.Float64, "estimate": pl.Float64, "low": pl.Float64, "high": pl.Float64}
            ),
            "no rows",
        ),
    ],
)
def test_frames_that_are_not_as_asked_are_refused(frame, wrong):
    with pytest.raises(InputError, match=wrong):
        draw_error_bars(frame)
    with pytest.raises(InputError, match="needs numbers above 0"):
        draw_error_bars(estimates([0, 1], [""]), log=True)


ODD = st.sampled_from([None, float("nan"), 0.0, -0.0, 1e-300, 1e-9, 0.3, 1.0, -5.5, 1e12, -1e12, 1e300])
NAMES_ODD = st.sampled_from(["", "\x00", "$a_b$", "日本 🙂", "\n\t", "x" * 300, "a/b", None, "\u202e\ufffe"])


@settings_of_tests(max_examples=4, deadline=None)
@given(st.lists(st.tuples(NAMES_ODD, ODD), min_size=1, max_size=6), NAMES_ODD, st.sampled_from(list(STYLES)))
def test_odd_numbers_and_names_are_drawn(rows, title, style):
    """Nothing warns (warnings are errors here), and every missing value is told."""
    names, values = ([row[part] for row in rows] for part in (0, 1))
    value = pl.Series("value", values, dtype=pl.Float64, strict=False)
    title = title or ""
    numbered = pl.Series([f"{name}{at}" for at, name in enumerate(names)])
    pictures = [
        draw_boxes(
            pl.DataFrame({"cell": pl.Series(names, dtype=pl.String), "value": value}),
            title=title,
            style=style,
        )
    ]
    lost = value.fill_nan(None).null_count()
    for picture in pictures:
        told = f"{lost} of {len(rows)} {'is' if lost == 1 else 'are'} undecided"
        assert told in picture.caption or lost == 0
    marks = pl.DataFrame({"x": numbered, "estimate": value, "low": value, "high": value})
    pictures.append(draw_error_bars(marks, title=title, style=style))
    grid = pl.DataFrame({"x": numbered, "y": numbered, "value": value})
    pictures.append(draw_heat(grid, best="low", title=title, style=style))
    for picture in pictures:
        assert faults_of(picture.figure) == []


def test_the_true_number_of_reports_follows_a_floor_that_changes() -> None:
    values = {"floor.source": "random:0.4", "change.at_s": [20.0, 40.0, 90.0], "change.to": "invert",
              "run.t_end_s": 60.0, "strategy.name": "mcp", "task.name": "share"}  # fmt: skip
    result = simulate(preset("paper").with_values(values), 1, 1)
    assert "the share of tiles that vibrate at the end is 0.4." in headline(verdict(result))
    picture = draw_run_reports(result)
    true = picture.figure.axes[0].lines[-1]
    assert true.get_xdata()[:3].tolist() == [0.0, 20.0, 40.0]
    assert true.get_ydata().tolist() == pytest.approx([0.4, 0.6, 0.4, 0.4])
    assert picture.caption.endswith("dashed: the true number.")
    redrawn = simulate(result.scenario.with_values({"change.to": "redraw"}), 1, 1)
    assert draw_run_reports(redrawn).caption.endswith("dashed: the true number, 0.4.")


def test_reports_are_drawn_without_a_true_number_where_the_code_of_the_task_is_not_loaded() -> None:
    tasks.register(Task(name="half", truth=lambda floor, asked, p: 0.5, estimated="half", answers=("a", "b")))
    values = {"change.at_s": 20.0, "change.to": "invert", "run.t_end_s": 60.0, "strategy.name": "mcp"}
    try:
        result = simulate(preset("paper").with_values(values | {"task.name": "half"}), 1, 1)
        assert "dashed" in draw_run_reports(result).caption
    finally:
        tasks.base.forget("half")
    assert "dashed" not in draw_run_reports(result).caption


@pytest.mark.usefixtures("without_layout")
def test_reports_over_time_have_a_line_for_each_robot_and_quartiles_of_many() -> None:
    def reports(robots: int) -> pl.DataFrame:
        rows = [
            {"name": name, "robot": robot, "time_s": float(t), "value": t * 0.1 + robot}
            for name in ("estimate", "trust")
            for robot in range(robots)
            for t in range(robot % 3, 20)
        ]
        return pl.DataFrame(rows)

    few, many = draw_reports(reports(4), truth=0.4), draw_reports(reports(40))
    panels = [axes for axes in few.figure.axes if axes.get_title()]
    assert [axes.get_title() for axes in panels] == ["estimate", "trust"]
    assert [len(axes.lines) for axes in panels] == [5, 4]  # and the truth
    dashes = {str(line._unscaled_dash_pattern) for line in panels[1].lines}  # type: ignore[attr-defined]
    assert len(dashes) == 4  # robots are told apart without colours
    assert [len(axes.lines) for axes in many.figure.axes[:2]] == [1, 1]
    assert "dashed" in few.caption
    assert "dashed" not in many.caption
    assert few.numbers.height == reports(4).height
    # the median at the end is that of the last values of all robots
    last = (
        reports(40).filter(pl.col("name") == "trust").group_by("robot").agg(pl.col("value").last())["value"]
    )
    assert many.figure.axes[1].lines[0].get_ydata()[-1] == pytest.approx(last.median())
    edges = many.figure.axes[1].collections[0].get_paths()[0].vertices
    at_end = edges[edges[:, 0] == edges[:, 0].max(), 1]
    quartiles = [last.quantile(q, "linear") for q in (0.25, 0.75)]
    assert [at_end.min(), at_end.max()] == pytest.approx(quartiles)
    assert {line.get_drawstyle() for line in panels[1].lines} == {"steps-post"}
    with pytest.raises(InputError):
        draw_reports(reports(1).clear())


@pytest.mark.usefixtures("without_layout")
def test_a_picture_says_how_many_of_the_reported_values_it_draws() -> None:
    rows = [{"name": f"value_{k}", "robot": 0, "time_s": 1.0, "value": 0.5} for k in range(9)]
    assert "a robot; the first 6 of 9 values." in draw_reports(pl.DataFrame(rows)).caption
    assert "each line a robot." in draw_reports(pl.DataFrame(rows[:6])).caption


@pytest.mark.usefixtures("without_layout")
def test_borders_and_words_of_tiles_know_all_kinds() -> None:
    frame = pl.DataFrame({"x_m": [0.1, 0.9], "y_m": [0.1, 0.9]})
    two = draw_density(frame, tiles=np.array([[0, 1], [1, 0]], dtype=np.uint8))
    three = draw_density(frame, tiles=np.array([[0, 1], [2, 0]], dtype=np.uint8))
    assert "vibrating (dots) and still tiles" in two.caption
    assert "circles: kind 1, squares: kind 2" in three.caption
    of_kind = [line for line in three.figure.axes[0].lines if line.get_marker() in ("o", "s")]
    assert [len(line.get_xdata()) for line in of_kind] == [1, 1]
    # row 0 is at the top; the lower left corner of the second floor is not that of the arena
    assert holds(lines_of(two), [(0.25, 0.25), (0.75, 0.75)])
    tiles = np.array([[0, 1], [1, 1]], dtype=np.uint8)
    part = draw_density(frame, tiles=tiles, tile_size_m=(0.2, 0.1), corner_m=(0.3, 0.5))
    assert holds(lines_of(part), [(0.4, 0.55), (0.6, 0.55), (0.6, 0.65)])
    # each of the tiles (0, 1) and (1, 0) has four sides, of which they share none
    assert len(three.figure.axes[0].collections[-1].get_segments()) == 8


@pytest.mark.usefixtures("without_layout")
def test_the_strongest_lines_of_a_spectrum_are_named() -> None:
    """At their frequencies: it has seven lines, and room for the names of six."""
    hz = [20.0 * k for k in range(1, 8)]
    lines = pl.DataFrame(
        {
            "hz": hz,
            "low": [f - 1 for f in hz],
            "high": [f + 1 for f in hz],
            "amplitude": [0.1 * k for k in range(1, 8)],
        }
    )
    (axes,) = draw_spectrum(spectra(["still"]), lines).figure.axes
    assert [(text.get_text(), text.xy[0]) for text in axes.texts] == [(f"{f:.0f}", f) for f in hz[:0:-1]]


def test_a_spectrum_speaks_of_bands_only_where_lines_are() -> None:
    """Groups have no lines in their picture: it spoke of the "intervals of 0 lines"."""
    for lines, words in ((0, "over frequency."), (1, "intervals of 1 line."), (2, "intervals of 2 lines.")):
        assert draw_spectrum(spectra(["still"]), LINES_HZ.head(lines)).caption.endswith(words)


DOUBLED: dict[str, Callable[[], object]] = {
    "forest": lambda: draw_forest(differences(["a", "a"]), better="low"),
    "outcomes": lambda: draw_outcomes(counts(["none", "none"])),
    "heat": lambda: draw_heat(pl.concat([grid([1], [1])] * 2), best="low"),
}


@pytest.mark.parametrize("kind", DOUBLED)
def test_two_rows_of_one_mark_are_refused(kind: str) -> None:
    with pytest.raises(InputError, match="two rows have"):
        DOUBLED[kind]()


def beyond(frame: pl.DataFrame, high: str) -> pl.DataFrame:
    """Put the upper limits below what they limit."""
    return frame.with_columns(pl.lit(-1e9).alias(high))


OUTSIDE: dict[str, Callable[[], object]] = {
    "forest": lambda: draw_forest(beyond(differences(["a", "b"]), "high"), better="low"),
    "incidence": lambda: draw_incidence(beyond(curves(["soft"]), "right_high"), runs=9),
}


@pytest.mark.parametrize("kind", OUTSIDE)
def test_limits_that_do_not_hold_their_estimate_are_refused(kind: str) -> None:
    with pytest.raises(InputError, match="does not lie in"):
        OUTSIDE[kind]()
