"""Reports: numbers as tables write them, nothing cut in a terminal, markup of users harmless, pages in a browser."""

from __future__ import annotations

import io
import json
import math
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from rich.console import Console

from helpers.browser import Tabs
from helpers.markup import Markup
from vibroswarm.cli import main
from vibroswarm.plots import draw_heat
from vibroswarm.report.format import text_table
from vibroswarm.report.page import page
from vibroswarm.report.report import Figure, Report, Table, report
from vibroswarm.report.save import data, read, save
from vibroswarm.report.terminal import show

NASTY = "</script><img src=x onerror=alert(1)><script>alert(2)</script>[red]\x1b[31m"
FRAME = pl.DataFrame(
    {
        "cell": ["cell 10", "cell 9", NASTY, "a" * 50],
        "decision_time_s": [887.5, None, 3.0, 1204.0],
        "decision_time_s_low": [850.0, None, 1.0, 1100.0],
        "decision_time_s_high": [920.0, None, 5.0, 1300.0],
        "robots_right": [0.5, 0.25, 1.0, 0.0],
        "p_holm": [0.03, 0.0001, 1.0, math.nan],
    }
)
GRID = pl.DataFrame([{"x": x, "y": y, "value": x * y + 0.5} for x in range(4) for y in range(3)])


def example() -> Report:
    return Report(
        f"A study {NASTY}",
        ("soft is faster than none.", NASTY),
        {
            "cells": Table(FRAME, "Cells", NASTY, {"cell": NASTY}),
            "map": Figure(lambda: draw_heat(GRID, best="low", label=NASTY), NASTY),
            "hidden": Table(FRAME, "Hidden", folded=True),
            "runs": Table(FRAME.head(1), "Runs"),
        },
        setting=NASTY,
        warnings=(NASTY,),
        made_by={NASTY: NASTY},
    )


def test_numbers_are_written_by_the_names_of_their_columns() -> None:
    table = text_table(FRAME, {})
    assert [(heading.title, heading.unit) for heading in table.headings[1:]] == [
        ("decision time", "s"),
        ("robots right", "%"),
        ("p (Holm)", ""),
    ]
    first, second = ([f"{entry.text} {entry.limits}".strip() for entry in row] for row in table.rows[:2])
    assert first == ["cell 10", "888 [850, 920]", "50", "0.030"]
    assert second == ["cell 9", "", "25", "< 0.001"]
    rows = pl.DataFrame({"figure": ["decision_time_s", "robots_right"], "soft": [887.5, 0.5]})
    by_row = text_table(rows, {"figure": ""})
    assert [[entry.text for entry in row] for row in by_row.rows] == [
        ["decision time, s", "888"],
        ["robots right, %", "50"],
    ]


@pytest.mark.parametrize("width", [60, 80, 140])
def test_a_terminal_cuts_nothing(width: int) -> None:
    stream = io.StringIO()
    show(example(), Console(file=stream, width=width))
    lines = stream.getvalue().splitlines()
    assert max(map(len, lines)) <= width
    assert "\x1b" not in stream.getvalue()
    joined = "".join(stream.getvalue().split())
    assert "[1100,1300]" in joined
    assert joined.count("a") >= 50


def test_json_is_finite_and_a_report_is_read_back(tmp_path: Path) -> None:
    save(example(), tmp_path)
    values = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert values["tables"]["cells"][3]["p_holm"] is None
    again = read(tmp_path / "report.json")
    assert again.answer == example().answer
    assert again.tables["cells"].frame.equals(FRAME)
    assert data(again) == data(example())
    (tmp_path / "report.html").write_text("as it was", encoding="utf-8")
    save(example(), tmp_path)
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == "as it was"  # nothing has changed


def evaluated(folder: Path, name: str) -> str:
    """The page of a study in whose name, floor and labels this text is."""
    folder.mkdir()
    cells = [f'[[list]]\nlabel = {json.dumps(f"{name} {k}")}\n"strategy.name" = "none"\n' for k in range(2)]
    (folder / "study.toml").write_text(
        f"name = {json.dumps(name)}\nruns = 4\n[scenario]\nrun.t_end_s = 60.0\nswarm.robots = 2\n"
        f'[floors]\n{json.dumps(name)} = ["10", "01"]\n{"".join(cells)}'
        f'[grid]\n"floor.source" = [{json.dumps(name)}]\n',
        encoding="utf-8",
    )
    assert main(["evaluate", str(folder / "study.toml"), "-q", "--out", str(folder / "out")]) == 0
    return (folder / "out" / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_markup_in_texts_of_users_stays_text(tmp_path: Path) -> None:
    harmless = Markup(evaluated(tmp_path / "plain", "name"))
    for place, text in enumerate(
        ("<script>alert(1)<!--", "<img src=x onerror=alert(2)>", "&lt;b&gt;\"'`{{7*7}}")
    ):
        hostile = Markup(evaluated(tmp_path / f"{place}", text))
        assert text in hostile.text
        for tag in ("script", "img"):
            assert hostile.tags.count(tag) == harmless.tags.count(tag)
        assert {name for name, _ in hostile.attributes} <= {name for name, _ in harmless.attributes}


def test_a_page_in_a_browser(tabs: Tabs, tmp_path: Path) -> None:
    """It logs nothing and asks for nothing; tables sort, numbers are saved, nothing runs over the side."""
    file = tmp_path / "report.html"
    file.write_text(page(example()), encoding="utf-8")
    opened = tabs.open(file.as_uri(), viewport={"width": 1280, "height": 800})
    assert "soft is faster than none" in opened.locator("p.answer").first.text_content()
    heading = opened.locator("#cells thead th").nth(1)

    def times() -> list[Any]:
        texts = opened.locator("#cells tbody tr td:nth-child(2)").all_text_contents()
        return [text.split("[")[0].strip() for text in texts]

    heading.click()
    assert times() == ["3", "888", "1204", ""]
    heading.focus()
    opened.keyboard.press("Enter")
    assert times() == ["1204", "888", "3", ""]  # what is missing stays last
    with opened.expect_download() as waiting:
        opened.locator("#cells a[download]").click()
    waiting.value.save_as(tmp_path / "cells.csv")
    assert pl.read_csv(tmp_path / "cells.csv")["robots_right"].to_list() == [0.5, 0.25, 1.0, 0.0]
    for width in (320, 768, 1920):
        opened.set_viewport_size({"width": width, "height": 800})
        assert opened.evaluate("document.documentElement.scrollWidth") <= width
    assert tabs.emptied() == []


def test_a_report_of_nothing_known() -> None:
    with pytest.raises(TypeError, match="no report of int"):
        report(1)
