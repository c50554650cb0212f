"""The project's own pictures: as their command makes them, small, and readable on light and on dark pages."""

from __future__ import annotations

import re
import runpy
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
IMAGES = ROOT / "docs" / "images"
MADE = runpy.run_path(str(ROOT / "docs" / "make_diagrams.py"))
SVG = "{http://www.w3.org/2000/svg}"


@pytest.mark.parametrize("name", ["inspection", "stages", "model"])
def test_a_picture_is_what_its_command_draws(name):
    written = (IMAGES / f"{name}.svg").read_text(encoding="utf-8")
    assert written == MADE["PICTURES"][name](), "python docs/make_diagrams.py draws it again"
    assert len(written) < 150_000
    assert not re.search(r"(href|url)\(?=?[\"']?https?:", written), "pictures load nothing"


def luminance(colour: str) -> float:
    channels = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("name", ["inspection", "stages", "model"])
def test_a_picture_brings_its_background_and_its_words_stand_out(name):
    root = ET.parse(IMAGES / f"{name}.svg").getroot()
    (ground,) = [r for r in root.findall(f"{SVG}rect") if r.get("width") == root.get("width")]
    assert ground.get("height") == root.get("height")
    words = root.findall(f"{SVG}text")
    assert len(words) > 5
    for one in words:
        assert contrast(one.get("fill", ""), MADE["TILE"]) >= 4.5, one.text
    assert contrast("#c9c4b8", MADE["PAPER"]) < 4.5  # a line's colour would not do for words


def test_the_readme_begins_with_the_problem_and_the_picture():
    before, picture, _ = (
        (ROOT / "README.md").read_text(encoding="utf-8").partition("](docs/images/inspection.svg)")
    )
    assert picture
    text = before.split("\n", 1)[1].partition("![")[0]
    assert "#" not in text
    assert len(re.findall(r"[.?](?=\s)", text)) == 3
