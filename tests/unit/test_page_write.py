"""The page is one file that nothing in the data can break, and that stays small."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibroswarm.run_page.payload import RunRecord, payload
from vibroswarm.run_page.write import page_html, script_json, write_page

NASTY = (
    "</script><script>alert(1)</script><!-- <script> {{data}} {{title}} &amp; \u2028\u2029 ' \" \\ ]]> <b>"
)


class Page(HTMLParser):
    """Collects the elements and what stands in script elements and in the title."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, list[str]] = {}
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self.texts.setdefault(tag, []).append("")

    def handle_data(self, data: str) -> None:
        self.texts.setdefault(self.tags[-1][0] if self.tags else "", [""])[-1] += data


def test_nasty_names_break_nothing(record: RunRecord) -> None:
    floor = replace(record.floor, name=NASTY)
    nasty = replace(record, title=NASTY, floor=floor, details={NASTY: NASTY})
    page = Page(page_html(nasty))
    assert sum(tag == "script" for tag, _ in page.tags) == 2
    data = json.loads(page.texts["script"][0])
    assert data["title"] == data["floor"]["name"] == NASTY
    assert data["details"] == [[NASTY, NASTY]]
    assert page.texts["title"][0].strip() == NASTY


@given(st.text())
def test_json_in_a_script_stays_there(text: str) -> None:
    made = script_json({"title": text})
    assert not re.search(r"[<>&\u2028\u2029]", made)
    assert json.loads(made) == {"title": text}


def test_half_a_character_in_a_title_can_be_written(record: RunRecord, tmp_path: Path) -> None:
    write_page(replace(record, title="odd \udcff name"), tmp_path / "run.html")


def test_numbers_that_json_lacks_are_refused() -> None:
    with pytest.raises(ValueError, match="Out of range float"):
        script_json({"x": float("nan")})


def test_page_refers_to_nothing_outside(record: RunRecord) -> None:
    text = page_html(record)
    page = Page(text)
    (script,) = re.findall(r"<script>(.*?)</script>", text, flags=re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"default-src 'none'; script-src 'sha256-{digest}';" in text
    assert not re.search(r"\beval\(|new Function|innerHTML|@import|url\((?!data:font/woff2;base64,)", text)
    for tag, attributes in page.tags:
        assert "src" not in attributes, tag
        assert (attributes.get("href") or "#").startswith(("#", "data:")), tag
    assert "{{" not in text


def test_largest_run_is_under_three_megabytes(long_record: RunRecord, tmp_path: Path) -> None:
    path = tmp_path / "run.html"
    write_page(long_record, path)
    assert path.stat().st_size < 3_000_000
    assert json.loads(script_json(payload(long_record)))["time"]["end_s"] == 1200.0


def test_a_page_is_the_same_each_time(record: RunRecord) -> None:
    assert page_html(record) == page_html(record)
