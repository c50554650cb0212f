"""The report in a real browser, from disk: pictures are seen, tables sort, it is read in the dark and on a phone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from helpers.browser import Tabs
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
    sentence = "soft against none: 127 s faster [102, 153], 6.7 points more wrong [3.9, 9.4]."
    aside = "Errors are of robots."
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
            "Errors are of robots",
        ):
            assert words in seen
    # Where the contents do not stand beside it, the answer comes before them.
    assert seen.index("Errors are of robots") < seen.index("Contents")


def cells(page: Any, column: int) -> list[str]:
    texts: list[str] = page.locator(f"#s1-2 tbody tr td:nth-child({column})").all_text_contents()
    return texts


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


def test_numbers_are_saved_from_the_page(open_report: Open, tmp_path: Path) -> None:
    page = open_report()
    with page.expect_download() as waiting:
        page.locator("a.csv").first.click()
    assert waiting.value.suggested_filename == "cells.csv"
    waiting.value.save_as(tmp_path / "cells.csv")
    assert pl.read_csv(tmp_path / "cells.csv").equals(FRAME)


def test_nothing_runs_over_the_side(open_report: Open) -> None:
    page = open_report()
    page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    for width in (320, 375, 768, 1280, 1920):
        page.set_viewport_size({"width": width, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.locator("svg.drawing").first.bounding_box()["width"] >= min(250, width - 80)


def test_without_scripts_all_is_there(open_report: Open) -> None:
    page = open_report(java_script_enabled=False)
    assert page.locator("svg.drawing").count() == 3
    assert page.locator("#s1-2").is_visible()
    assert not page.locator("#theme").is_visible()
