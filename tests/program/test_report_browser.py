"""The report in a real browser, from disk: pictures are seen, tables sort, it is read in the dark and on a phone."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from helpers.browser import Tabs
from vibroswarm.documents.search import search_document
from vibroswarm.optimize import Search, run_search, truth_of
from vibroswarm.plots import draw_boxes, draw_heat, draw_outcomes
from vibroswarm.show.document import Column, Document, Figure, Section, Table, Text
from vibroswarm.show.page import write_page

Open = Callable[..., Any]
NASTY = "</script><img src=x onerror=alert(1)><script>alert(2)</script>"
FOLDER = "/a/very/long/folder/of/results/of/a/study/without/any/space/in/its/name/floor.png"

FRAME = pl.DataFrame(
    {
        "cell": ["cell 10", "cell 9", NASTY, FOLDER],
        "time": [887.5, None, -3.0, 1204.0],
        "right": [0.5, 0.25, 1.0, 0.0],
    }
)


@cache
def made() -> Document:
    table = Table(
        FRAME,
        {"time": Column("decision time", "s"), "right": Column("right", share=True)},
        "What came out",
        "cells",
    )
    counts = pl.DataFrame(
        {"cell": FRAME["cell"], "right": [5, 2, 3, 4], "wrong": [1, 1, 1, 1], "incomplete": [4, 7, 6, 5]}
    )
    values = pl.DataFrame({"cell": FRAME["cell"].to_list() * 10, "value": [float(n * 29) for n in range(40)]})
    grid = pl.DataFrame([{"x": x, "y": y, "value": x * y + 0.5} for x in range(4) for y in range(3)])
    outcomes = Figure("outcomes", cache(lambda style: draw_outcomes(counts, style=style)))
    times = Figure("times", cache(lambda style: draw_boxes(values, t_end=1200, style=style)))
    heat = Figure("map", cache(lambda style: draw_heat(grid, best="low", style=style)))
    return Document(
        f"A study {NASTY}",
        ("What was found.",),
        warnings=(f"Mind {NASTY}",),
        parts=(
            Section("Outcomes", (Text("Text."), table, outcomes)),
            Section("Times", (times,)),
            Section("Map", (heat,)),
            Section("More", (Text("Below."), Section("Hidden", (Text("Inside."), table))), folded=True),
        ),
        made_by={"seed": "7", "folder": FOLDER},
    )


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("report") / "report.html"
    write_page(file, made())
    return file


@pytest.fixture(scope="module")
def long_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report of many sections, each with two parts beside each other and a folded table; and a table of claims.

    The parts are pictures where tests look at them, else words, which are drawn sooner.
    """
    counts = pl.DataFrame({"cell": ["a", "b"], "right": [5, 2], "wrong": [1, 1]})
    drawn = cache(lambda style: draw_outcomes(counts, style=style))
    pictures = tuple(Section(f"Picture {n}", (Figure(f"p{n}", drawn),)) for n in (1, 2))
    words = tuple(Section(f"Words {n}", (Text("Long. " * 200),)) for n in (1, 2))
    table = Section("All numbers", (Table(FRAME),), folded=True)
    prose, marked = Column(prose=True), Column(tones={"not": "bad"})
    kinds = {"says": prose, "measured": prose, "paper": marked, "text": marked, "calibrated": marked}
    claims = Table(pl.DataFrame([dict.fromkeys(kinds, "not so, but nearly all of it")]), kinds)
    first = Section("Item 0", (Text("Text."), claims, *words, table), side_by_side=True)
    others = (
        Section(
            f"Item {n}", (Text("Text."), *(pictures if n in (1, 12) else words), table), side_by_side=True
        )
        for n in range(1, 20)
    )
    file = tmp_path_factory.mktemp("long") / "report.html"
    write_page(file, Document("Long", (), parts=(first, *others)))
    return file


@pytest.fixture(scope="module")
def search_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a small search of a hostile name, with a start that won and so two warnings at least."""
    small = (Path(__file__).parents[1] / "helpers" / "small_search.toml").read_text()
    begin = 'start = [{ "sample.sample_interval_ms" = 6000.0, "decision.min_observations" = 60 }]\n'
    search = Search.from_toml(f"name = {json.dumps(NASTY)}\n{begin}{small}[search]\nbudget = 60\n")
    found = run_search(search)
    truth = truth_of(found, runs=60)
    at_start = replace(truth.others[0], values=truth.winner.values)
    file = tmp_path_factory.mktemp("search") / "report.html"
    write_page(file, search_document(found, replace(truth, believed=0.1, others=(at_start,))))
    return file


@pytest.fixture
def open_report(tabs: Tabs, path: Path, tmp_path: Path) -> Iterator[Open]:
    """Opens the report, another file, or a document; at the end, whatever it logged or asked for fails the test."""

    def opened(hash_: str = "", *, file: Path = path, of: Document | None = None, **options: Any) -> Any:
        if of is not None:
            file = tmp_path / "report.html"
            write_page(file, of)
        return tabs.open(file.as_uri() + hash_, **{"viewport": {"width": 1280, "height": 800}} | options)

    yield opened
    assert tabs.emptied() == []


IN_SIGHT = """() => {
    const words = [], range = document.createRange();
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    for (let node = walker.nextNode(); node; node = walker.nextNode()) {
        range.selectNodeContents(node);
        const box = range.getBoundingClientRect();
        const inside = box.left >= 0 && box.right <= innerWidth && box.top >= 0 && box.bottom <= innerHeight;
        if (box.width && inside) words.push(node.data.trim());
    }
    return words.filter(Boolean).join(" ");
}"""


def test_the_first_screen_answers(open_report: Open) -> None:
    """Which is faster, which is wrong more often, and how sure that is: in sight without scrolling, with 3 answers."""
    effects = pl.DataFrame(
        {
            "figure": ["time", "right", "wrong", "undecided"],
            "difference": [-127.0, 11.9, 6.7, -18.6],
            "low": [-153.0, 8.4, 3.9, -23.0],
            "high": [-102.0, 15.5, 9.4, -14.5],
            "it is": ["better", "better", "worse", "better"],
        }
    )
    columns = {
        "difference": Column(sign=True, decimals=1, strip=True, limits=("low", "high")),
        "it is": Column(tones={"better": "good", "worse": "bad"}),
    }
    sentence = "soft against none: 127 s faster [102, 153], 6.7 points more wrong [3.9, 9.4]; confirmed on other seeds."
    aside = "At equal error (24.8 %, that of soft): no significant difference in time, +94 s [-56, +226]."
    parts = (Text(aside, "aside"), Table(effects, columns), *made().parts)
    found = ("soft is faster than none, and wrong more often", sentence)
    report = replace(made(), title="none and soft", answer=found, warnings=(), parts=parts)
    for width, height in ((1400, 900), (400, 800)):
        seen = open_report(of=report, viewport={"width": width, "height": height}).evaluate(IN_SIGHT)
        for words in (
            "soft is faster than none, and wrong more often",
            "−127.0",
            "+6.7",
            "[+3.9, +9.4]",
            "worse",
            "confirmed on other seeds",
            "no significant difference in time",
        ):
            assert words in seen
    # Where the contents do not stand beside it, the answer comes before them.
    assert seen.index("no significant difference") < seen.index("Contents")


def cells(page: Any, column: int) -> list[str]:
    texts: list[str] = page.locator(f"#s1-2 tbody tr td:nth-child({column})").all_text_contents()
    return texts


def test_pictures_are_seen_and_draw(open_report: Open) -> None:
    page = open_report()
    drawings = page.locator("svg.drawing")
    assert drawings.count() == 3
    for place in range(3):
        drawing = drawings.nth(place)
        box = drawing.bounding_box()
        assert box["width"] > 250
        assert box["height"] > 100
        assert drawing.is_visible()
        shown = drawing.evaluate(
            "(e) => [...e.querySelectorAll('path,text,use')].filter((p) => p.getBoundingClientRect().width > 0).length"
        )
        assert shown > 20
        assert len(drawing.screenshot()) > 4000
    assert page.locator("svg.drawing text", has_text="share of runs").count() == 1


def test_tables_sort_by_mouse_and_by_keyboard(open_report: Open) -> None:
    page = open_report()
    before = cells(page, 1)
    heading = page.locator("#s1-2 th").nth(1)
    button = heading.locator("button")
    button.click()
    assert heading.get_attribute("aria-sort") == "ascending"
    assert cells(page, 2) == ["−3", "888", "1204", "–"]
    button.focus()
    page.keyboard.press("Enter")
    assert heading.get_attribute("aria-sort") == "descending"
    assert cells(page, 2) == ["1204", "888", "−3", "–"]  # what is missing stays last
    page.keyboard.press("Space")
    assert heading.get_attribute("aria-sort") == "none"
    assert cells(page, 1) == before
    page.locator("#s1-2 th").nth(0).locator("button").click()
    names = cells(page, 1)
    assert names.index("cell 9") < names.index("cell 10")


def test_what_can_be_pressed_is_reached_by_tab(open_report: Open) -> None:
    page = open_report()
    reached = set()
    for _ in range(40):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.textContent.trim().slice(0, 12)"))
    assert {"Skip to the ", "Dark", "Outcomes", "decision tim", "Numbers of o"} <= reached


def test_numbers_are_saved_from_the_page(open_report: Open, tmp_path: Path) -> None:
    page = open_report()
    with page.expect_download() as waiting:
        page.locator("a.csv").first.click()
    assert waiting.value.suggested_filename == "cells.csv"
    waiting.value.save_as(tmp_path / "cells.csv")
    assert pl.read_csv(tmp_path / "cells.csv").equals(FRAME)


INK = "getComputedStyle(document.querySelector('svg.drawing text')).fill"
GROUND = "getComputedStyle(document.body).backgroundColor"


def test_pictures_follow_light_and_dark(open_report: Open) -> None:
    light = open_report()
    dark = open_report(color_scheme="dark")
    assert light.evaluate(INK) == "rgb(27, 30, 35)"
    assert dark.evaluate(INK) == "rgb(236, 234, 228)"
    assert light.evaluate(GROUND) != dark.evaluate(GROUND)
    assert dark.inner_text("#theme") == "Light"
    dark.click("#theme")
    assert dark.evaluate(INK) == light.evaluate(INK)
    assert dark.evaluate(GROUND) == light.evaluate(GROUND)
    light.click("#theme")
    assert light.evaluate(INK) == "rgb(236, 234, 228)"


def test_print_is_light_open_and_bare(open_report: Open) -> None:
    page = open_report(color_scheme="dark")
    page.emulate_media(media="print", color_scheme="dark")
    assert page.evaluate(INK) == "rgb(27, 30, 35)"
    assert not page.locator("#theme").is_visible()
    assert not page.locator(".contents").is_visible()
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.locator("#s4-2-2").is_visible()
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert not page.locator("#s4-2-2").is_visible()


def test_nothing_runs_over_the_side(open_report: Open) -> None:
    page = open_report()
    page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    for width in (320, 375, 768, 1280, 1920):
        page.set_viewport_size({"width": width, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.locator("svg.drawing").first.bounding_box()["width"] >= min(250, width - 80)


def test_letters_and_captions_on_a_phone_can_be_read(open_report: Open) -> None:
    page = open_report(viewport={"width": 375, "height": 800})
    caption = page.locator("caption span").first.bounding_box()  # of a wide table, without scrolling
    assert caption["x"] >= 0
    assert caption["x"] + caption["width"] <= 375
    sizes = page.evaluate(
        """() => [...document.querySelectorAll("svg.drawing text")].map((e) => {
             const { a, b } = e.getScreenCTM();
             return parseFloat(getComputedStyle(e).fontSize) * Math.hypot(a, b);
           })"""
    )
    assert len(sizes) > 50
    assert min(sizes) > 6.5


def test_contents_lead_to_folded_sections(open_report: Open) -> None:
    page = open_report()
    hidden = page.locator("#s4-2")
    assert not hidden.is_visible()
    page.locator("nav a", has_text="Hidden").click()
    assert hidden.is_visible()
    assert open_report("#s4-2").locator("#s4-2").is_visible()


def test_sentences_and_verdicts_fit_a_printed_page(open_report: Open, long_path: Path) -> None:
    """Room that is given on a screen, where a table can be scrolled, would be cut on paper."""
    page = open_report(file=long_path, viewport={"width": 640, "height": 900})
    table = page.locator("#s1-2").first
    assert table.bounding_box()["width"] > 640
    page.emulate_media(media="print")
    assert table.bounding_box()["width"] <= 640
    assert page.evaluate("document.documentElement.scrollWidth") <= 640


def test_tables_of_many_columns_fit_a_screen_and_a_sheet(open_report: Open) -> None:
    """Those of more than 13 columns stand in pieces, each with the names; a heading is printed on each sheet."""
    for width, pieces in ((13, 1), (36, 3)):
        values = {
            f"figure {k}{end}": [0.512, 0.25] for k in range(width - 1) for end in ("", "_low", "_high")
        }
        columns = {f"figure {k}": Column(f"robots wrong {k}", share=True) for k in range(width - 1)}
        table = Table(pl.DataFrame({"name": ["none", "soft"], **values}), columns, name="all")
        wide = Document("Wide", (), parts=(Section("All", (table,)),))
        page = open_report(of=wide, viewport={"width": 1920, "height": 800})
        tables = page.locator("table")
        assert tables.count() == pieces
        assert {tables.nth(k).locator("td").first.inner_text() for k in range(pieces)} == {"none"}
        headings = page.locator("th").all_inner_texts()
        assert (headings.count("name"), len({*headings})) == (pieces, width)
        assert page.get_by_role("rowheader", name="soft").count() == pieces
        assert page.evaluate(SIDEWAYS) == []
        page.set_viewport_size({"width": 718, "height": 1000})  # A4 without its margins
        assert page.evaluate(SIDEWAYS) != []
        page.emulate_media(media="print")
        assert page.evaluate(SIDEWAYS) == []
        assert page.evaluate("getComputedStyle(document.querySelector('th button')).display") == "contents"


SIDEWAYS = """[...document.querySelectorAll('.sideways')].filter((e) => e.scrollWidth > e.clientWidth)
    .map((e) => e.scrollWidth)"""

WHERE = "nav [aria-current]"


def test_long_contents_mark_where_one_reads_and_scroll_by_themselves(
    open_report: Open, long_path: Path
) -> None:
    page = open_report(file=long_path, viewport={"width": 1280, "height": 420})
    assert page.locator("nav a").count() == 80
    assert page.inner_text(WHERE) == "Item 0"
    below = page.locator("nav ol ol")
    assert below.nth(0).is_visible()
    assert not below.nth(12).is_visible()
    page.evaluate("document.getElementById('s13-3').scrollIntoView()")
    page.locator(WHERE, has_text="Picture 1").wait_for()  # which stands beside it
    assert below.nth(12).is_visible()
    assert not below.nth(0).is_visible()
    assert page.locator(WHERE).count() == 1
    nav, at = page.locator("nav").bounding_box(), page.locator(WHERE).bounding_box()
    assert nav["y"] <= at["y"]
    assert at["y"] + at["height"] <= nav["y"] + nav["height"]
    assert page.evaluate("document.querySelector('nav').scrollTop") > 0  # without which it would not be seen
    page.evaluate("scrollTo(0, document.documentElement.scrollHeight)")
    page.locator(WHERE, has_text="All numbers").wait_for()


def test_a_table_too_large_for_its_csv_is_not_wider_than_a_phone(open_report: Open) -> None:
    many = pl.DataFrame({"value": [n / 7 for n in range(40_000)]})
    report = Document("Many", ("Many.",), parts=(Table(many, caption="Many", name="many"),))
    page = open_report(of=report, viewport={"width": 360, "height": 800})
    assert "too many to include in this page" in page.inner_text("main")
    assert page.evaluate("document.documentElement.scrollWidth") <= 360


def test_contents_are_short_on_a_phone_and_whole_where_they_are_few(
    open_report: Open, long_path: Path
) -> None:
    phone = open_report(file=long_path, viewport={"width": 375, "height": 800})
    assert phone.locator("nav ol > li").first.is_visible()
    assert not phone.locator("nav ol ol").first.is_visible()
    assert open_report().locator("nav ol ol").first.is_visible()  # wherever one is


def test_pictures_stand_beside_each_other_where_there_is_room(open_report: Open, long_path: Path) -> None:
    page = open_report(file=long_path)
    for width in (1280, 375):
        page.set_viewport_size({"width": width, "height": 800})
        first, second = (page.locator(f"#s2-{n}-1").bounding_box() for n in (2, 3))
        assert (first["y"] == second["y"]) == (width == 1280)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        folded = page.locator("#s2-4").bounding_box()
        assert folded["y"] > max(first["y"] + first["height"], second["y"] + second["height"])


def test_options_in_a_caption_stand_among_the_words(open_report: Open) -> None:
    """And not on lines of their own, as the caption itself does."""
    table = Table(pl.DataFrame({"n": [1]}), caption="Command: `vibroswarm run --seed 1 --robots 5`")
    shown = open_report(of=replace(made(), parts=(table,))).eval_on_selector_all(
        "caption .option", "all => all.map(one => getComputedStyle(one).display)"
    )
    assert shown == ["inline", "inline"]


def test_without_scripts_all_is_there(open_report: Open) -> None:
    page = open_report(java_script_enabled=False)
    assert page.locator("svg.drawing").count() == 3
    assert page.locator("#s1-2").is_visible()
    assert not page.locator("#theme").is_visible()


@pytest.mark.parametrize(("width", "scheme"), [(1000, "light"), (420, "dark")])
def test_the_page_of_a_search_is_read_from_its_warnings_down(
    open_report: Open, search_path: Path, width: int, scheme: str
) -> None:
    page = open_report(file=search_path, viewport={"width": width, "height": 900}, color_scheme=scheme)
    assert page.inner_text("h1") == NASTY
    assert page.locator("img").count() == 0
    warnings = page.locator("aside.warning").all_inner_texts()
    assert "partly lucky" in warnings[0]
    assert any("nothing better was found" in text for text in warnings)
    tops = [
        page.locator(at).first.bounding_box()["y"]
        for at in ("aside.warning", ".lead", "#s1-1", "svg.drawing")
    ]
    assert tops == sorted(tops)
    assert page.locator("#s1-1 tbody tr").count() == 3
    assert page.locator("#s1-1 td.bad").inner_text() == "lucky"
    drawings = page.locator("svg.drawing")
    assert drawings.count() == 2
    assert all(drawings.nth(k).bounding_box()["width"] > 250 for k in range(2))
    beside = drawings.nth(0).bounding_box()["y"] == drawings.nth(1).bounding_box()["y"]
    assert beside == (width == 1000)
    folded = page.locator("details pre")
    assert not folded.is_visible()
    page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    assert folded.inner_text().startswith("format = 2")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.emulate_media(media="print")
    assert folded.evaluate("(e) => getComputedStyle(e).whiteSpace") == "pre-wrap"
