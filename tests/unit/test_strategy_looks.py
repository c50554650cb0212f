"""A strategy has one colour and marker, whichever others are drawn beside it; names at curves' ends do not overlap."""

from __future__ import annotations

from itertools import pairwise

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibroswarm import strategies
from vibroswarm.plots import draw_error_bars, draw_front
from vibroswarm.plots.labels import spread
from vibroswarm.plots.style import BUILT_IN, MARKERS, SERIES, look, looks_of, strategy_in


def test_every_strategy_of_the_package_has_a_look_of_its_own() -> None:
    # other tests of this process may have registered strategies of their own
    shipped = {
        name for name, one in strategies.known().items() if one.begin.__module__.startswith("vibroswarm.")
    }
    assert set(BUILT_IN) == shipped
    assert len(set(BUILT_IN.values())) == len(BUILT_IN)
    assert all(colour < len(SERIES) and marker < len(MARKERS) for colour, marker in BUILT_IN.values())


@given(st.lists(st.sampled_from(sorted(BUILT_IN)), unique=True, min_size=1, max_size=12))
def test_a_look_does_not_depend_on_the_others(names: list[str]) -> None:
    for name, found in zip(names, looks_of(names), strict=True):
        assert (found.colour, found.marker) == (SERIES[BUILT_IN[name][0]], MARKERS[BUILT_IN[name][1]])


@pytest.mark.parametrize(
    ("name", "strategy"),
    [
        ("soft", "soft"), ("random:0.48, soft", "soft"), ("soft (gate own)", "soft"), ("A (none)", "none"),
        ("soft feedback", "soft"), ("no feedback", "none"), ("no feedback 5 robots", "none"),
        ("A (positive feedback η 2)", "positive"), ("no feedbacks", None), ("no robots", None),
        ("600 s", None), ("robots 5", None), ("softer", None), ("", None),
    ],
)  # fmt: skip
def test_a_series_is_of_the_strategy_in_its_name(name: str, strategy: str | None) -> None:
    assert strategy_in(name) == strategy


def test_series_of_one_strategy_share_its_colour_and_differ_in_their_marks() -> None:
    found = looks_of(["soft, robots 5", "soft, robots 10", "none, robots 5", "none, robots 10"])
    assert [one.colour for one in found] == [SERIES[2], SERIES[2], SERIES[0], SERIES[0]]
    assert len({(one.colour, one.marker) for one in found}) == 4
    assert found[0].line != found[1].line
    assert looks_of(["5 robots", "10 robots"]) == [look(0), look(1)]


def test_a_source_of_the_reproduction_looks_the_same_beside_any_others() -> None:
    names = ["real robots", "authors' simulator", "paper", "text", "calibrated"]
    by_name = dict(zip(names, looks_of(names), strict=True))
    assert len(set(by_name.values())) == len(names)
    for some in (names[1:], ["paper", "calibrated"], ["calibrated", "text", "paper"]):
        assert looks_of(some) == [by_name[name] for name in some]
    assert looks_of(["published", "paper"])[1] == by_name["paper"]
    assert looks_of(["published", "real robots"]) == [look(0), look(1)]  # they would be alike
    assert looks_of(["paper", "600 s"]) == [look(0), look(1)]


@given(st.lists(st.floats(0, 300), min_size=1, max_size=12))
def test_labels_are_spread_apart_in_order(places: list[float]) -> None:
    moved = spread(places, 10.0)
    assert sum(moved) == pytest.approx(sum(places), abs=1e-6)
    ordered = sorted(range(len(places)), key=lambda k: places[k])
    assert all(moved[b] - moved[a] >= 10.0 - 1e-6 for a, b in pairwise(ordered))


def words(figure: object) -> list[str]:
    from matplotlib.text import Text

    return [text.get_text() for text in figure.findobj(Text) if text.get_text()]  # type: ignore[attr-defined]


def test_curves_that_end_apart_are_named_at_their_ends_and_others_in_a_legend() -> None:
    rows = [
        {"x": x, "series": name, "estimate": y + x, "low": y + x - 1.0, "high": y + x + 1.0}
        for name, y in (("none", 10.0), ("soft", 90.0))
        for x in (1.0, 2.0, 3.0)
    ]
    apart = draw_error_bars(pl.DataFrame(rows))
    assert not apart.figure.legends
    assert {"none", "soft"} <= set(words(apart.figure))
    long = pl.DataFrame(rows).with_columns(series=pl.format("{} with a name of many words", "series"))
    assert draw_error_bars(long).figure.legends


def test_a_series_that_does_not_change_is_a_band_and_has_no_marks() -> None:
    rows = [
        {"x": x, "series": name, "estimate": y, "low": y - 1.0, "high": y + 1.0}
        for name, values in (("none", (10.0, 10.0, 10.0)), ("soft", (20.0, 15.0, 12.0)))
        for x, y in zip((1.0, 2.0, 3.0), values, strict=True)
    ]
    (axes,) = draw_error_bars(pl.DataFrame(rows)).figure.axes
    marked = [line for line in axes.lines if line.get_marker() == "o" and len(line.get_xdata()) > 1]
    assert not marked  # "o" is the mark of none
    flat = [line for line in axes.lines if set(line.get_ydata()) == {10.0}]
    assert len(flat) == 1
    assert len(axes.patches) == 1


def test_constants_that_are_equal_are_one_band_under_their_strategys_name() -> None:
    rows = [
        {"x": x, "series": name, "estimate": y + x * slope, "low": y - 9.0, "high": y + 9.0}
        for name, y, slope in (("none, κ 1", 10.0, 0.0), ("none, κ 2", 10.0, 0.0), ("soft, κ 1", 30.0, 1.0))
        for x in (1.0, 2.0, 3.0)
    ]
    figure = draw_error_bars(pl.DataFrame(rows)).figure
    assert len(figure.axes[0].patches) == 1
    assert "none" in words(figure)
    assert not {"none, κ 1", "none, κ 2"} & set(words(figure))


def test_ranges_of_settings_are_bands_and_never_bars() -> None:
    frame = pl.DataFrame({"x": [1.0, 2.0], "estimate": [5.0, 6.0], "low": [2.0, 3.0], "high": [9.0, 9.0]})
    bars, spans = (draw_error_bars(frame, spans=spans).figure.axes[0] for spans in (False, True))
    assert [line.get_marker() for line in bars.lines].count("_") == 1
    assert [line.get_marker() for line in spans.lines].count("_") == 0
    assert len(spans.collections) == 1


def test_all_points_of_a_front_are_labelled() -> None:
    few = pl.DataFrame(
        {"name": ["soft", "none", "totals"], "time": [1.0, 2.0, 3.0], "error": [0.3, 0.2, 0.1]}
    )
    assert {"soft", "none", "totals"} <= set(words(draw_front(few).figure))
    many = pl.DataFrame(
        {
            "name": [f"p_c {k}, O_c {k}" for k in range(20)],
            "time": [float(k) for k in range(20)],
            "error": [1.0 / (k + 1) for k in range(20)],
        }
    )
    texts = words(draw_front(many).figure)
    assert all(any(f"p_c {k}, O_c {k}" in text for text in texts) for k in range(20))
