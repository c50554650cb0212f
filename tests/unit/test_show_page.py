"""A page is one file that nothing in the data can break, that repeats, and that stays small; so is a fragment."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import re
from html.parser import HTMLParser
from importlib.resources import files
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibroswarm.analysis.intervals import Interval
from vibroswarm.core.numbers import (
    counts,
    decimals_of,
    duration,
    every,
    first_of,
    number,
    percent,
    some,
    span,
    verb,
    with_limits,
)
from vibroswarm.errors import InputError
from vibroswarm.plots import draw_boxes, draw_front, draw_outcomes
from vibroswarm.plots.style import NAMES
from vibroswarm.show.data import document_data, document_from, document_values
from vibroswarm.show.document import Column, Document, Figure, Part, Photo, Photos, Section, Table, Text
from vibroswarm.show.figures import write_figures
from vibroswarm.show.markup import code_html, escape, inline_svg
from vibroswarm.show.page import fragment_html, page_html, write_page

NASTY = '</script><script>alert(1)</script><!-- <b onclick="x"> {{title}} &amp; \u2028 \' " \\ ]]> `code` \udcff\x00'
IN_FRAME = NASTY.replace("\udcff", "")  # a frame cannot hold half a letter
SAID = NASTY.replace("\udcff", "?").replace("\x00", "")

VOID = {"meta", "link", "img", "br", "hr", "wbr"}


class Page(HTMLParser):
    """Collects elements and what is seen in each; tells whether all are closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, list[str]] = {}
        self.open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self.texts.setdefault(tag, []).append("")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        for tag in set(self.open):
            self.texts[tag][-1] += data


def table(name: str = "cells") -> Table:
    frame = pl.DataFrame(
        {"cell": ["a", "b", IN_FRAME], "time": [887.1234, None, 12.0], "right": [0.5, 1.0, 0.123456]}
    )
    return Table(frame, {"time": Column("decision time", "s"), "right": Column(share=True)}, NASTY, name)


def figure() -> Figure:
    frame = pl.DataFrame({"cell": ["a", IN_FRAME], "right": [3, 4], "wrong": [1, 6]})
    return Figure(NASTY, lambda style: draw_outcomes(frame, title=NASTY, style=style), NASTY)


def document() -> Document:
    folded = Section(NASTY, (Text(NASTY),), folded=True)
    section = Section(NASTY, (Text(NASTY), table(), figure(), folded))
    return Document(
        title=NASTY,
        answer=(NASTY,),
        knew=(NASTY,),
        warnings=(NASTY,),
        parts=(Text(NASTY, "aside"), Text(NASTY, "code"), *[section] * 3),
        made_by={NASTY: NASTY},
    )


def page_of(*parts: Part) -> str:
    return page_html(Document("x", (), parts=parts))


def test_nasty_names_break_nothing() -> None:
    page = Page(page_html(document()))
    assert page.open == []
    tags = [tag for tag, _ in page.tags]
    assert tags.count("script") == 1
    assert not {"img", "b", "iframe", "object"} & set(tags)
    assert page.texts["title"] == [SAID]
    assert "".join(page.texts["h1"]).strip() == SAID
    without_ticks = SAID.replace("`code`", "code")
    assert page.texts["td"][6::9] == [IN_FRAME.replace("\x00", "")] * 3
    assert page.texts["aside"][0].endswith(without_ticks)
    assert page.texts["dd"] == [SAID]
    for _, attributes in page.tags:
        assert not [name for name in attributes if name.startswith("on")]


def test_nasty_names_break_no_fragment() -> None:
    text = fragment_html(document())
    page = Page(text)
    assert page.open == []
    assert {tag for tag, _ in page.tags} <= {
        "div", "strong", "p", "code", "details", "summary", "table", "thead", "tbody", "tr", "th", "td", "img", "pre",
    }  # fmt: skip
    assert not [name for _, attributes in page.tags for name in attributes if name.startswith("on")]
    assert page.texts["td"][6::9] == [IN_FRAME.replace("\x00", "")] * 3
    sources = [attributes["src"] or "" for tag, attributes in page.tags if tag == "img"]
    assert [source.startswith("data:image/svg+xml;base64,") for source in sources] == [True] * 3


def test_json_has_the_named_tables_and_no_number_that_json_lacks() -> None:
    frame = pl.DataFrame(
        {"cell": ["a"], "low": [float("-inf")], "mean": [float("nan")], "all": [[1.5, float("nan")]]}
    )
    said = document_data(Document("x", ("Yes.",), parts=(Section("y", (Table(frame, name="cells"),)),)))
    assert said["answer"] == ["Yes."]
    assert said["tables"] == {"cells": [{"cell": "a", "low": None, "mean": None, "all": [1.5, None]}]}
    assert json.loads(json.dumps(said, allow_nan=False)) == said


def test_the_page_refers_to_nothing_outside_and_runs_only_its_own_script():
    text = page_html(document())
    page = Page(text)
    for tag, attributes in page.tags:
        assert "src" not in attributes, tag
        address = attributes.get("href") or attributes.get("xlink:href") or "#"
        assert address.startswith(("#", "data:")), tag
    assert not re.search(r"@import|innerHTML|\beval\(|url\((?!#)", text)
    (script,) = re.findall(r"<script>(.*?)</script>", text, flags=re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"default-src 'none'; script-src 'sha256-{digest}';" in text


def test_ids_are_unique_and_references_lead_to_them():
    text = page_html(document())
    ids = [attributes["id"] for _, attributes in Page(text).tags if "id" in attributes]
    assert len(ids) == len(set(ids)) > 50
    used = set(re.findall(r"url\(#([^)]+)\)", text)) | {
        (attributes.get("href") or "")[1:] for tag, attributes in Page(text).tags if tag in ("use", "a")
        and (attributes.get("href") or "").startswith("#")
    }  # fmt: skip
    assert len(used) > 5
    assert used <= set(ids)


def kept(whole: Document) -> str:
    return json.dumps(document_values(whole), allow_nan=False)


def test_a_document_that_is_kept_is_the_same_without_its_figures() -> None:
    whole = document()
    again = document_from(json.loads(kept(whole)), "document.json")
    assert kept(again) == kept(whole)
    assert not again.figures
    assert again.answer == whole.answer
    assert again.tables["cells"].frame.equals(whole.tables["cells"].frame)


def test_columns_without_a_value_are_texts_or_numbers_as_before() -> None:
    types = {"cell": pl.String, "better": pl.String, "time": pl.Float64, "runs": pl.Int64}
    frame = pl.DataFrame({"cell": ["a"], "better": [None], "time": [None], "runs": [None]}, schema=types)
    again = document_from(json.loads(kept(Document("x", (), parts=(Table(frame),)))), "document.json")
    types_again = again.tables["table"].frame.schema
    assert [kind.is_numeric() for kind in types_again.values()] == [False, False, True, True]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"title": "x"', '"title": 3'),
        ('"title"', '"titles"'),
        ('"time": [', '"times": ['),
        ('"right": [', '"right": 3, "x": ['),
        ('"right": [0.5', f'"right": [{10**40}'),
        ('"names": 2', '"names": 9'),
        ('"right": {', '"right": {"decimals": -1, '),
        ('"parts": [', '"parts": [[], '),
    ],
)
def test_a_damaged_document_is_refused(old: str, new: str) -> None:
    frame = pl.DataFrame({"cell": ["a"], "right": [0.5], "low": [0.1], "high": [0.9], "time": [1.0]})
    part = Table(
        frame, {"right": Column(limits=("low", "high")), "cell": Column(limits=("time", "time"))}, names=2
    )
    text = kept(Document("x", ("Yes.",), parts=(part,)))
    document_from(json.loads(text), "document.json")
    assert old in text
    with pytest.raises(InputError, match=r"^document\.json: is damaged"):
        document_from(json.loads(text.replace(old, new)), "document.json")


def test_figures_are_written_with_their_captions(tmp_path: Path) -> None:
    counts = pl.DataFrame({"cell": ["a"], "right": [3], "wrong": [1]})
    shown = Figure("outcomes", lambda style: draw_outcomes(counts, style=style), "Outcomes")
    write_figures(tmp_path / "pictures", Document("x", (), parts=(Section("y", (shown,)),)), "column")
    names = {f"outcomes.{suffix}" for suffix in ("svg", "pdf", "png", "csv")}
    assert {path.name for path in (tmp_path / "pictures").iterdir()} == {*names, "captions.csv"}
    assert pl.read_csv(tmp_path / "pictures" / "captions.csv")["name"].to_list() == ["outcomes"]


def saved(text: str) -> list[bytes]:
    return [
        base64.b64decode(coded)
        for coded in re.findall(r'href="data:text/csv;charset=utf-8;base64,([^"]*)"', text)
    ]


def test_the_numbers_to_be_saved_are_the_frames():
    frame = pl.DataFrame({"cell": ["a", "b"], "value": [1 / 3, None], "pair": [[1, 2], None]})
    drawn = draw_outcomes(pl.DataFrame({"cell": ["a", "b"], "right": [1, 2], "wrong": [2, 0]}))
    text = page_of(Section("y", (Table(frame), Figure("a b/c", lambda style: drawn))))
    first, second = saved(text)
    assert first == b'cell,value,pair\na,0.3333333333333333,"[1, 2]"\nb,,\n'
    assert pl.read_csv(second).equals(
        drawn.numbers.with_columns(
            pl.col("runs").cast(pl.Int64),
            right_low=pl.lit(None, pl.String),
            right_high=pl.lit(None, pl.String),
        ),
        null_equal=True,
    )
    assert 'download="a-b-c.csv"' in text


def test_long_tables_are_cut_and_say_so_and_vast_numbers_are_left_out():
    frame = pl.DataFrame({"run": range(2000), "time": np.linspace(0, 1, 2000)})
    text = page_of(Section("y", (Table(frame),)))
    assert text.count("<tr>") == 501
    assert "First 500 of 2,000 rows." in text
    assert saved(text)[0].count(b"\n") == 2001
    vast = pl.concat([frame] * 50)
    text = page_of(Section("y", (Table(vast),)))
    assert saved(text) == []
    assert "100,000 rows of numbers, too many" in text


def test_very_many_runs_make_no_large_page():
    rng = np.random.default_rng(1)
    count = 10_000  # a mark of each takes 106 bytes
    frame = pl.DataFrame(
        {
            "cell": "a",
            "value": rng.random(count) * 1200,
            "name": "n",
            "time": rng.random(count),
            "error": rng.random(count),
        }
    )
    boxes = Figure("boxes", lambda style: draw_boxes(frame, t_end=1200, style=style))
    assert len(page_of(boxes, Figure("front", lambda style: draw_front(frame, style=style)))) < 1_000_000


def test_a_report_is_the_same_each_time_and_whole(tmp_path: Path):
    write_page(tmp_path / "report.html", document())
    first = (tmp_path / "report.html").read_bytes()
    write_page(tmp_path / "report.html", document())
    assert (tmp_path / "report.html").read_bytes() == first
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    with pytest.raises(InputError, match="cannot write"):
        write_page(tmp_path / "nowhere" / "report.html", document())


def test_long_reports_have_contents_and_short_ones_none():
    assert "Contents</h2>" in page_html(document())
    assert "Contents</h2>" not in page_of(Section("one", (Text("It is."),)))


def test_what_is_empty_is_dropped():
    empty = Section("y", (Text("", "code"), Section("z", ())))
    made = Document("x", ("", "It is."), knew=("",), warnings=("",), parts=(Text(""), empty))
    assert (made.answer, made.knew, made.warnings, made.parts) == (("It is.",), (), (), ())


def test_prose_has_room_and_verdicts_have_marks():
    frame = pl.DataFrame(
        {"says": ["It does."] * 5, "verdict": ["good", "not good", "good indeed", "else", None]}
    )
    columns = {
        "says": Column(prose=True),
        "verdict": Column(tones={"good": "good", "not good": "bad", "good i": "fair"}),
    }
    page = Page(page_of(Table(frame, columns)))
    kinds = [attributes.get("class") for tag, attributes in page.tags if tag == "td"]
    assert kinds == ["prose", "good", "prose", "bad", "prose", "fair", "prose", "", "prose", ""]


def test_long_headings_of_numbers_have_room():
    frame = pl.DataFrame({"gamma_0": [1.0], "a_heading_of_many_more_words": [2.0]})
    page = Page(page_of(Section("y", (Table(frame),))))
    assert [attributes.get("class") for tag, attributes in page.tags if tag == "th"] == [
        "number",
        "number wordy",
    ]
    assert page.texts["th"] == ["gamma_0", "a_heading_of_many_more_words"]
    assert [tag for tag, _ in page.tags].count("wbr") == 5


def test_sections_stand_side_by_side_only_where_asked():
    below = (Section("a", (Text("c"),), folded=True), Section("b", (Text("d"),)))
    beside = page_of(Section("y", below, side_by_side=True))
    assert beside.count('<div class="beside">') == 1
    assert beside.index('<div class="beside">') < beside.index("<details>")
    assert '<div class="beside">' not in page_of(Section("y", below))


def test_contents_of_many_sections_say_that_they_are_long():
    part = Section("z", (Text("It is."),))
    few, many = (page_of(Section("y", (part,) * count)) for count in (28, 29))
    assert '<nav class="contents" ' in few
    assert '<nav class="contents long" ' in many


@settings(max_examples=50)
@given(st.text(alphabet=st.characters(codec=None)))
def test_escaped_text_is_only_text(text: str):
    page = Page(f"<p>{escape(text)}</p>")
    assert [tag for tag, _ in page.tags] == ["p"]
    escape(text).encode("utf-8")


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (5, "5"), (5.0, "5"), (1234.56, "1235"), (0.123456, "0.123"), (-2.5, "-2.5"), (float("inf"), "∞"),
        (-float("inf"), "-∞"), (1e-7, "1e-07"), (None, "-"), (float("nan"), "-"), (999.7, "1000"),
    ],
)  # fmt: skip
def test_a_number_alone_has_three_digits(value: float | None, said: str) -> None:
    assert number(value) == said


def test_shares_and_limits_have_their_units() -> None:
    assert percent(0.12345) == "12.3 %"
    assert percent(None) == "-"
    assert percent(0.012, sign=True) == "+1.2 %"
    assert number(-0.0004, 2) == "0.00", "no sign of zero"
    assert with_limits(Interval(441.2, 410.0, 472.0, 0.95, 9, ""), "s") == "441 s [410, 472]"
    assert with_limits(Interval(0.5, 0.25, 0.75, 0.95, 9, ""), "%") == "50.0 % [25.0, 75.0]"
    assert with_limits(Interval(0.5, -math.inf, math.inf, 0.95, 2, ""), "s") == "0.5 s"
    assert with_limits(Interval(math.nan, math.nan, math.nan, 0.95, 0, ""), "s") == "-"
    assert with_limits(Interval(12.0, -3.0, 27.0, 0.95, 9, ""), "s", sign=True) == "+12 s [-3, +27]"


def test_words_follow_the_number_of_things() -> None:
    assert [verb(n, "are", "is") for n in (0, 1, 2)] == ["are", "is", "are"]
    assert [verb(n, "vibrate") for n in (0, 1, 2)] == ["vibrate", "vibrates", "vibrate"]
    assert [first_of(6, n, "floor") for n in (5, 6, 9)] == ["", "", "the first 6 of 9 floors"]
    assert [some(list("abc"), most) for most in (2, 3)] == ["a, b and 1 more", "a, b and c"]
    assert [every(n, "robot") for n in (1, 2, 1000)] == ["the robot", "both robots", "all 1,000 robots"]
    assert [counts(n, "run") for n in ([5, 5], [1000, 500, 100])] == ["5 runs", "100 to 1,000 runs"]
    assert [span(values) for values in ([2.0, None, 2.0], [2.5, 1.0], [])] == ["2", "1.0 to 2.5", "-"]


def test_numbers_of_a_column_have_the_same_decimals_and_their_limits():
    """44.0, 8.3, 0.3; and p-values below 0.001 as such. What is true or false is yes or no."""
    frame = pl.DataFrame(
        {
            "share": [0.44, 0.0833, 0.0033], "low": [0.4, 0.05, 0.0], "high": [0.5, 0.1, None],
            "time": [1204.0, 887.5, 31.25], "small": [1e-9, 5.0, None], "p": [0.0004, 0.0051, 1.0],
            "known": [True, False, None],
        }
    )  # fmt: skip
    columns = {"share": Column(share=True, limits=("low", "high")), "p": Column(p_value=True)}
    page = Page(page_of(Table(frame, columns)))
    assert page.texts["td"] == [
        "44.0 [40.0, 50.0]", "1204", "1e-09", "< 0.001", "yes",
        "8.3 [5.0, 10.0]", "888", "5", "0.005", "no",
        "0.3", "31", "–", "1.000", "–",
    ]  # fmt: skip
    assert "low" not in "".join(page.texts["th"])


def test_settings_have_no_more_decimals_than_they_need():
    assert decimals_of([0.7, 0.95, 0.9]) == 2
    assert decimals_of([0.7, 0.995]) == 3
    assert decimals_of([0.5, 0.5]) == 1
    assert decimals_of([2.0, None, 40.0]) == 0
    assert decimals_of([0.486, 0.5]) == 3
    assert decimals_of([29.17, 0.417]) == 1
    assert decimals_of([29.17, 0.06]) == 1
    assert decimals_of([29.17, 0.04]) is None  # it would be written as 0


def test_times_have_the_unit_that_suits_them():
    times_s = (0.4, 12.0, 89.0, 180.0, 5399.0, 9000.0)
    assert list(map(duration, times_s)) == ["0.4 s", "12 s", "89 s", "3 min", "90 min", "2.5 h"]


def test_answers_come_before_what_follows_and_before_the_contents() -> None:
    sections = tuple(Section(f"part {n}", (Text("It is."),)) for n in range(5))
    text = page_html(
        Document("x", ("It does.",), knew=("They were told.",), parts=(Text("before"), *sections))
    )
    places = [
        text.index(words)
        for words in ("They were told.", "It does.", ">before<", '<nav class="contents"', "part 0</h2>")
    ]
    assert places == sorted(places)


def test_options_are_not_broken_at_their_hyphens() -> None:
    """In texts, in code and in tables; a dash between words, or a double one within a word, is no option."""
    option = '<span class="option">--spread-mm</span>'
    assert (
        code_html("state it: --spread-mm, `--spread-mm 5`") == f"state it: {option}, <code>{option} 5</code>"
    )
    assert code_html("a -- b, c--d-e") == "a -- b, c--d-e"
    assert option in page_of(Table(pl.DataFrame({"advice": ["--spread-mm"]})))


def test_strips_of_a_column_share_their_scale() -> None:
    """The strip of the largest value reaches its edge; others are drawn in proportion, 0 in the middle."""
    frame = pl.DataFrame(
        {"d": [-127.0, -127.0, None], "low": [-153.0, -140.0, None], "high": [-102.0, -114.0, None]}
    )
    text = page_of(Table(frame, {"d": Column(strip=True, limits=("low", "high"))}))
    bars = re.findall(r'class="bar" d="M([\d.]+) 7.5H([\d.]+)"', text)
    assert [tuple(map(float, ends)) for ends in bars] == [
        (0.0, pytest.approx(100 * (1 - 102 / 153), abs=0.1)),
        (pytest.approx(100 * (1 - 140 / 153), abs=0.1), pytest.approx(100 * (1 - 114 / 153), abs=0.1)),
    ]


def test_photographs_hold_themselves() -> None:
    inside = Photo("data:image/png;base64,aGE=", NASTY)
    assert 'src="data:image/png;base64,aGE="' in page_of(Photos("seen", (inside,)))
    for address in (
        "https://elsewhere/a.png",
        'data:image/png;base64,a" onerror="b',
        "data:image/svg+xml;base64,aGE=",
    ):
        with pytest.raises(InputError, match="data URI"):
            page_of(Photos("seen", (Photo(address, "x"),)))


HEAD = '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" viewBox="0 0 9 9">'


@pytest.mark.parametrize("inside", ["<path", "&x;"])
def test_a_picture_that_is_no_svg_is_refused(inside):
    with pytest.raises(InputError, match="is not an SVG"):
        inline_svg(f"{HEAD}{inside}</svg>", "p-", "label")


def test_scripts_of_a_picture_are_dropped():
    text, _ = inline_svg(f"{HEAD}<script>alert(1)</script><path d='M 0 0'/></svg>", "p-", "label")
    assert "alert" not in text
    assert "<path" in text


def test_svg_is_inlined_with_its_own_ids():
    use = "<use xlink:href='#a' clip-path='url(#b)' style='fill: url(#a)'/>"
    inside = f"<defs><path id='a' d='M 0 0'/></defs>{use}<text>1 &lt; 2</text>"
    text, width = inline_svg(f"<!DOCTYPE svg [<!ENTITY x 'y'>]>{HEAD}{inside}</svg>", "p1-", 'a "label" <b>')
    assert width == 12
    assert 'id="p1-a"' in text
    assert 'href="#p1-a" clip-path="url(#p1-b)" style="fill: url(#p1-a)"' in text
    assert "<text>1 &lt; 2</text>" in text
    assert 'aria-label="a &quot;label&quot; &lt;b&gt;"' in text
    with pytest.raises(InputError, match="a page takes 3,000,000"):
        inline_svg(HEAD + " " * 3_000_000 + "</svg>", "p", "x")


def dark_colours() -> dict[str, str]:
    css = files("vibroswarm.show").joinpath("assets", "page.css").read_text(encoding="utf-8")
    found = re.findall(r"--fig-([\w-]+): (#[0-9a-f]{6})", css)
    assert len(found) == 2 * len(dict(found))
    once = dict(found[: len(found) // 2])
    assert once == dict(found[len(found) // 2 :])
    return once


def test_every_colour_of_pictures_has_a_dark_one_that_stands_out():
    dark = dark_colours()
    assert dark.keys() == NAMES.keys()

    def luminance(colour: str) -> float:
        coded = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
        linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    ground = luminance(dark["paper"])
    for name, colour in dark.items():
        if name.startswith("series") or name in ("ink", "faint", "right", "wrong"):
            assert (luminance(colour) + 0.05) / (ground + 0.05) > 3, name
