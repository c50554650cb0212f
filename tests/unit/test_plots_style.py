"""Pictures are legible in grey and to the colour-blind, and are written whole and the same each time."""

from __future__ import annotations

import re
import threading
from itertools import combinations

import matplotlib as mpl
import numpy as np
import polars as pl
import pytest
from matplotlib.figure import Figure

from vibroswarm.errors import InputError
from vibroswarm.plots import draw_boxes, draw_error_bars, draw_outcomes, picture
from vibroswarm.plots.layout import fitted, fitted_names, number, plain, share, width_pt
from vibroswarm.plots.picture import FORMATS, SVG_UP_TO, picture_bytes, save_figure, themed_svg, write_picture
from vibroswarm.plots.style import (
    NAMES,
    OUTCOME_HATCHES,
    OUTCOMES,
    PAPER,
    SERIES,
    SERIES_UP_TO,
    STYLES,
    look,
    settings,
    style_named,
)

# Machado, Oliveira and Fernandes (2009), severity 1, on linear RGB.
SEEN = {
    "all colours": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
}
TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.072175], [0.0193339, 0.119192, 0.9503041]]
)
WHITE = TO_XYZ.sum(axis=1)


def linear(colour: str) -> np.ndarray:
    coded = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    return np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)


def lab(colour: str, seen: str = "all colours") -> np.ndarray:
    t = TO_XYZ @ np.clip(SEEN[seen] @ linear(colour), 0, 1) / WHITE
    f = np.where(t > 0.008856, np.cbrt(t), 7.787 * t + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def nearest_pair(colours, seen: str) -> float:
    return min(float(np.linalg.norm(lab(a, seen) - lab(b, seen))) for a, b in combinations(colours, 2))


def nearest_greys(colours) -> float:
    return min(abs(float(lab(a)[0] - lab(b)[0])) for a, b in combinations(colours, 2))


@pytest.mark.parametrize("seen", SEEN)
def test_series_are_told_apart_whatever_colours_one_sees(seen):
    assert nearest_pair(SERIES, seen) > 34
    assert nearest_pair(OUTCOMES.values(), seen) > 15


def test_a_red_and_a_green_of_one_lightness_would_not_pass():
    red, green = "#c0392b", "#5a7d00"
    assert nearest_pair((red, green), "all colours") > 60
    assert nearest_pair((red, green), "deuteranopia") < 34
    assert nearest_greys((red, green)) < 9


def test_series_and_outcomes_are_told_apart_in_grey():
    assert nearest_greys(SERIES) > 9
    assert nearest_greys(OUTCOMES.values()) > 9


def test_series_stand_out_from_paper():
    paper = linear(PAPER) @ TO_XYZ[1]
    for colour in SERIES:
        assert (paper + 0.05) / (linear(colour) @ TO_XYZ[1] + 0.05) > 1.7, colour


def test_series_differ_in_shape_too():
    looks = [look(index) for index in range(SERIES_UP_TO)]
    assert len({one.marker for one in looks}) == len({one.hatch for one in looks}) == SERIES_UP_TO
    assert len({one.line for one in looks[: len(SERIES)]}) == len(SERIES)
    assert len(set(OUTCOME_HATCHES.values())) == len(OUTCOMES)


def test_colours_have_one_name_each():
    assert len(set(NAMES.values())) == len(NAMES)
    assert all(re.fullmatch(r"#[0-9a-f]{6}", colour) for colour in NAMES.values())


def test_a_style_that_does_not_exist_is_refused():
    with pytest.raises(InputError, match="did you mean 'column'"):
        style_named("colum")


FRAME = pl.DataFrame({"x": [1, 2], "estimate": [3.0, 4.0], "low": [2.5, 3.5], "high": [3.5, 4.5]})


def test_pictures_are_written_with_their_numbers_and_repeat(tmp_path):
    kept = {}
    for name in ("one v1.2", "two"):
        picture = draw_error_bars(FRAME, label="a $label$ & <b>")
        written = picture.write(tmp_path / name)
        assert [path.name for path in written] == [f"{name}.{kind}" for kind in (*FORMATS, "csv")]
        kept[name] = [path.read_bytes() for path in written]
    assert kept["one v1.2"] == kept["two"]
    svg, pdf, png, csv = kept["two"]
    assert svg.startswith(b"<?xml")
    assert b"a $label$ &amp; &lt;b&gt;</text>" in svg  # text is text, and no mathematics
    assert pdf.startswith(b"%PDF")
    assert b"/FontFile2" in pdf or b"/Type42" in pdf or b"CIDFontType2" in pdf
    assert not re.search(rb"CreationDate|Matplotlib|20\d\d-\d\d", svg + pdf + png)
    assert png.startswith(b"\x89PNG")
    assert pl.read_csv(csv).equals(
        picture.numbers.with_columns(
            pl.col("x").cast(pl.Int64), runs=pl.lit(None, pl.String), series=pl.lit("")
        ).cast({"x": pl.Float64}),
        null_equal=True,
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        f"{name}.{kind}" for name in kept for kind in (*FORMATS, "csv")
    )


@pytest.mark.parametrize(
    ("name", "formats", "written"),
    [
        ("x.pdf", None, ["x.pdf", "x.csv"]),
        ("x.v1", ("png",), ["x.v1.png", "x.v1.csv"]),
        ("x.pdf", (), ["x.pdf.csv"]),
    ],
)
def test_a_suffix_names_the_format(tmp_path, name, formats, written):
    assert [path.name for path in draw_error_bars(FRAME).write(tmp_path / name, formats)] == written


def test_writing_says_what_is_wrong(tmp_path):
    picture = draw_error_bars(FRAME)
    with pytest.raises(InputError, match="formats: there is no 'gif'"):
        picture.write(tmp_path / "x", formats=("gif",))
    with pytest.raises(InputError, match="cannot write"):
        picture.write(tmp_path / "nowhere" / "x")
    assert list(tmp_path.iterdir()) == []
    only = write_picture(picture.figure, picture.numbers, tmp_path / "x", formats=())
    assert [path.name for path in only] == ["x.csv"]


def test_a_figure_is_saved_by_the_suffix_and_others_are_refused(tmp_path):
    save_figure(Figure, tmp_path / "a b.PDF")
    assert (tmp_path / "a b.PDF").read_bytes().startswith(b"%PDF")
    for name in ("x.gif", "x"):
        with pytest.raises(InputError, match=r"end the name with \.png, \.svg or \.pdf"):
            save_figure(Figure, tmp_path / name)
    with pytest.raises(InputError, match="exists"):
        save_figure(Figure, tmp_path / "a b.PDF", replace=False)
    with pytest.raises(InputError, match="cannot write"):
        save_figure(Figure, tmp_path / "nowhere" / "x.svg")
    assert [path.name for path in tmp_path.iterdir()] == ["a b.PDF"]


def test_dots_follow_the_style(tmp_path):
    from PIL import Image

    assert STYLES["column"].font_pt == 8
    for style, across in (("column", 1050), ("page", 2160), ("slide", 2000)):
        draw_error_bars(FRAME, style=style).write(tmp_path / style, formats=("png",))
        with Image.open(tmp_path / f"{style}.png") as image:
            assert abs(image.width - across) <= 1
            assert style != "slide" or image.width / image.height == pytest.approx(16 / 9, abs=0.002)


def test_settings_of_others_are_neither_used_nor_changed():
    with mpl.rc_context({"font.size": 30, "svg.fonttype": "path", "axes.facecolor": "red"}):
        before = dict(mpl.rcParams)
        there = picture_bytes(draw_error_bars(FRAME).figure, "svg")
        assert dict(mpl.rcParams) == before
    assert there == picture_bytes(draw_error_bars(FRAME).figure, "svg")


def test_pictures_may_be_drawn_from_threads():
    made: list[bytes] = []
    styles = ["column", "slide", "page"] * 3

    def draw(style: str) -> None:
        made.append(style.encode() + picture_bytes(draw_error_bars(FRAME, style=style).figure, "svg"))

    threads = [threading.Thread(target=draw, args=(style,)) for style in styles]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(made) == len(styles)
    assert len(set(made)) == 3


def test_themed_svg_names_its_colours_and_leaves_words_alone():
    words = f'style="fill: {SERIES[0]}" {SERIES[0]}'
    svg = themed_svg(draw_error_bars(FRAME, label=words).figure)
    assert f"stroke: var(--fig-series-0, {SERIES[0]})" in svg
    assert f">{words}</text>" in svg
    left = set(re.findall(r"#[0-9a-f]{6}", re.sub(r"var\([^)]*\)|>[^<]*<|\"#\w+\"|url\([^)]*\)", "", svg)))
    assert not left & set(NAMES.values())


def test_hatched_grounds_are_themed_too():
    svg = themed_svg(draw_outcomes(pl.DataFrame({"cell": ["a"], "right": [1], "wrong": [1]})).figure)
    assert "<pattern" in svg
    assert f'style="fill: var(--fig-wrong, {OUTCOMES["wrong"]})"' in svg
    assert ' fill="#' not in svg


def test_very_many_marks_become_an_image(monkeypatch):
    """Here 1,400 are very many."""
    monkeypatch.setattr(picture, "SVG_UP_TO", SVG_UP_TO // 10)
    with settings():
        figure = Figure()
        axes = figure.add_subplot()
        rng = np.random.default_rng(1)
        marks = axes.scatter(*rng.random((2, 1400)), s=rng.random(1400))
    assert len(picture_bytes(figure, "svg")) > picture.SVG_UP_TO
    svg = themed_svg(figure)
    assert len(svg) < 100_000
    assert "data:image/png;base64," in svg
    assert not marks.get_rasterized()  # the figure is as it was


NAMES_LONG = [
    "walk.avoidance_threshold_mm = 55",
    "/very/long/folder/of/results/with/a name/floor.png",
    "word" * 40,
    "strategy.name = soft, decision.credible_threshold = 0.975",
]


@pytest.mark.parametrize("lines", [1, 2, 3])
@pytest.mark.parametrize("name", NAMES_LONG)
def test_names_are_made_to_fit(name, lines):
    short = fitted(name, 8, 90, lines)
    parts = short.split("\n")
    assert len(parts) <= lines
    assert all(width_pt(part, 8) <= 90 for part in parts)
    assert short[0] == name[0]
    assert parts[-1][-1] == name[-1]


@pytest.mark.parametrize("pair", ["Y-", "Y.", "F.", "T-", "P."])
def test_tight_letters_that_fit_are_not_shortened(pair: str) -> None:
    """Kerning moves these pairs together most: a text is said not to fit without a look at it."""
    for text in (pair, 20 * pair, f"{20 * pair} {20 * pair}"):
        assert fitted(text, 9.0, width_pt(text, 9.0)) == text
        assert fitted(text, 9.0, 0.99 * width_pt(text, 9.0)) != text


def test_numbers_are_not_broken():
    """Whatever room there is for a line, as long as the words of the label fit."""
    for room_pt in range(40, 140):
        lines = fitted("belief in a fill below 0.5, or 1,200 of them", 8, room_pt, lines=9).split("\n")
        for whole in ("0.5", "1,200"):
            assert any(whole in line for line in lines), lines


def place_of_axes(figure: Figure) -> list[float]:
    return list(figure.axes[0].get_position(original=True).bounds)


def test_a_picture_keeps_its_places_unless_it_is_changed():
    """What is drawn is laid out once; whoever changes it finds room for the change."""
    drawn = draw_error_bars(FRAME, label="label").figure
    before = place_of_axes(drawn)
    for kind in FORMATS:
        picture_bytes(drawn, kind)
        assert place_of_axes(drawn) == before
    drawn.axes[0].set_title("a title\nof two lines")
    picture_bytes(drawn, "svg")
    assert place_of_axes(drawn)[3] < before[3]


def test_different_names_never_look_alike():
    names = [f"a/very/long/path/{index:04}/with/the/same/end.png" for index in range(40)]
    assert len(set(fitted_names(names, 8, 60))) == 40
    assert fitted_names(["same", "same"], 8, 60) == ["same", "same"]


def test_words_hold_nothing_that_a_format_could_not():
    assert plain("a\x00b\nc\u2028d\udcffe") == "a b c d?e"
    for odd in ("\x00\x01\n", "\udcff", "日本語 🙂", "\ufffe"):
        svg = themed_svg(draw_error_bars(FRAME, label=f"x {odd}", title=odd).figure)
        svg.encode("utf-8")
        import xml.etree.ElementTree as ElementTree

        ElementTree.fromstring(svg)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.0, "0"),
        (-0.0, "0"),
        (None, "–"),
        (float("nan"), "–"),
        (1234.5, "1234"),
        (-2.5, "−2.5"),
        (1e-9, "1e−09"),
        (2.5e7, "25000000"),
        (1.2345e12, "1.23e+12"),
        (0.12345, "0.123"),
        (999.4, "999"),
        (999.7, "1000"),
        (-999.7, "−1000"),
        (9999.6, "10000"),
        (999_999.7, "1000000"),
    ],
)
def test_numbers_are_said_short(value, said):
    assert number(value) == said


@pytest.mark.parametrize(
    ("value", "digits", "said"),
    [(9999.6, 4, "10000"), (1_234_567.0, 7, "1234567")],
)
def test_numbers_that_are_rounded_up_have_no_exponent_below_a_million(value, digits, said):
    assert number(value, digits) == said


@pytest.mark.parametrize(
    ("part", "whole", "said"),
    [
        (0, 10, "0 %"),
        (10, 10, "100 %"),
        (1, 100_000, "< 0.1 %"),
        (99_999, 100_000, "> 99.9 %"),
        (1, 3, "33 %"),
        (1, 200, "0.5 %"),
        (199, 200, "99.5 %"),
        (0, 0, "–"),
    ],
)
def test_shares_never_round_some_to_none(part, whole, said):
    assert share(part, whole) == said


def test_more_series_than_marks_are_refused():
    frame = pl.DataFrame({"cell": ["a"] * 13, "series": [str(i) for i in range(13)], "value": [1.0] * 13})
    with pytest.raises(InputError, match="13 series cannot be distinguished; at most 12"):
        draw_boxes(frame)


def test_the_page_has_the_colours_of_further_kinds() -> None:
    import re
    from importlib.resources import files

    from vibroswarm.plots.style import KINDS

    sheet = files("vibroswarm.run_page").joinpath("assets", "page.css").read_text(encoding="utf-8")
    light, *dark = (
        dict(re.findall(r"--kind-(\d): (#[0-9a-f]{6});", part)) for part in sheet.split("color-scheme: dark")
    )
    assert light == {str(kind): colour for kind, (_, colour) in enumerate(KINDS) if kind > 1}
    assert len(dark) == 2
    assert dark[0] == dark[1]
    assert dark[0].keys() == light.keys()
