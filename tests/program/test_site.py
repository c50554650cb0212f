"""The documentation site: built without a warning, whole, with all public names, and usable from disk."""

from __future__ import annotations

import importlib
import importlib.util
import os
import re
import subprocess
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

import vibroswarm

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


SPHINX = """
import functools, gc, sys
from sphinx.cmd.build import main
from sphinx.domains.python import PythonDomain

gc.disable()  # documents stay in memory: looking for garbage among them takes a fifth of the time
PythonDomain.find_obj = functools.cache(PythonDomain.find_obj)  # another tenth: most names are on many pages
sys.exit(main(sys.argv[1:]))
"""


def build(target: Path) -> None:
    # Not by -c: from Python 3.13 on, Sphinx takes its text for the source of all that has the file "<string>".
    command = [sys.executable, "-", "-q", "-W", "--keep-going", "-b", "html"]
    done = subprocess.run(
        [*command, "-d", str(target.with_name("doctrees")), str(DOCS), str(target)],
        input=SPHINX,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": str(Path(vibroswarm.__file__).parents[1])},
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """The site, built once: the first worker that asks builds it, others wait for it."""
    if os.environ.get("CI") != "true" and importlib.util.find_spec("sphinx") is None:
        pytest.skip("Sphinx is not installed: pip install 'vibroswarm[docs]'")
    shared = tmp_path_factory.getbasetemp()
    folder = (shared if worker_id == "master" else shared.parent) / "site"
    try:
        folder.mkdir()
    except FileExistsError:
        deadline = time.monotonic() + 300
        while not (folder / "done").exists():
            assert time.monotonic() < deadline, "another worker did not build the site"
            time.sleep(0.2)
    else:
        try:
            build(folder / "html")
        finally:
            (folder / "done").touch()
    assert (folder / "html" / "index.html").is_file(), "the site could not be built"
    return folder / "html"


class Asked(HTMLParser):
    """What a page loads by itself, and where it links to; its anchors."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = {name: value or "" for name, value in attrs}
        self.anchors |= {found[name] for name in ("id", "name") if name in found}
        if tag == "a" and "href" in found:
            self.links.append(found["href"])
        elif tag == "link" and found.get("rel") not in ("index", "search", "next", "prev", "canonical"):
            self.loads.append(found["href"])
        elif "src" in found:
            self.loads.append(found["src"])


@cache
def asked_of(page: Path) -> Asked:
    return Asked(page)


def pages(site: Path) -> list[Path]:
    return sorted(site.rglob("*.html"))


def dead(site: Path) -> Iterator[str]:
    """Links within the site that lead nowhere."""
    known = {page.resolve(): asked_of(page) for page in pages(site)}
    for page, asked in known.items():
        for link in [*asked.links, *asked.loads]:
            if re.match(r"[a-z]+:", link):
                continue
            path, _, anchor = link.partition("#")
            target = page if not path else (page.parent / path.partition("?")[0]).resolve()
            there = target.is_file() and (
                not anchor or target not in known or anchor in known[target].anchors
            )
            if not there:
                yield f"{page.relative_to(site.resolve())} -> {link}"


@pytest.mark.long
def test_every_document_is_in_the_site(site):
    made = {path.relative_to(site).with_suffix(".md") for path in pages(site)}
    written = {path.relative_to(DOCS) for path in DOCS.rglob("*.md")}
    assert written <= made
    assert len(written) >= 15


def test_links_of_the_site_lead_somewhere(site, tmp_path):
    assert list(dead(site)) == []
    (tmp_path / "a.html").write_text(
        '<a href="b.html">b</a><a href="#there" id="there"></a><a href="#not"></a>'
    )
    assert list(dead(tmp_path)) == ["a.html -> b.html", "a.html -> #not"]


def test_the_site_asks_no_other_host_for_anything(site):
    for page in pages(site):
        outside = [load for load in asked_of(page).loads if re.match(r"([a-z]+:)?//", load)]
        assert outside == [], page
    for sheet in site.rglob("*.css"):
        assert not re.search(r"(url\(|@import)\s*[\"']?(https?:)?//", sheet.read_text(encoding="utf-8")), (
            sheet
        )


def formulas(page: str) -> tuple[int, list[str]]:
    """How many formulas a page has as MathML, and what looks like one that was not converted."""
    prose = re.sub(r"<(script|style|pre|code|math)\b.*?</\1>", "", page, flags=re.DOTALL)
    return page.count("<math "), re.findall(r"\\[a-z]{3,}|\$[^$]+\$", re.sub(r"<[^>]+>", "", prose))


def test_formulas_are_typeset_without_scripts(site):
    page = (site / "model.html").read_text(encoding="utf-8")
    count, left = formulas(page)
    assert count >= 10
    assert left == []
    assert not re.search(r"<script[^>]*mathjax", page.lower())
    assert formulas("<p>$x$ or \\delta</p><code>$HOME$</code>") == (0, ["$x$", "\\delta"])


def inventory(site: Path) -> set[str]:
    """Names of all Python objects that the site documents."""
    data = (site / "objects.inv").read_bytes().split(b"\n", 4)[4]
    lines = zlib.decompress(data).decode().splitlines()
    return {line.split(" ")[0] for line in lines if " py:" in line}


def rooms() -> list[str]:
    return ["vibroswarm", *(f"vibroswarm.{name}" for name in ("floors", "optimize", "plots"))]


def names_in_documents() -> set[tuple[str, str]]:
    """What documents and examples import from vibroswarm: (module, name)."""
    found = set()
    files = [ROOT / "README.md", *DOCS.glob("*.md"), *(ROOT / "examples").rglob("*.py")]
    for file in files:
        text = file.read_text(encoding="utf-8")
        for module, names in re.findall(
            r"^ *from (vibroswarm[\w.]*) import ([\w, ]+)", text, flags=re.MULTILINE
        ):
            found |= {(module, name.strip()) for name in names.split(",")}
    return found


def documented(module: str, name: str, known: set[str]) -> bool:
    found = getattr(importlib.import_module(module), name)
    home = getattr(found, "__module__", module)
    return bool({f"{module}.{name}", f"{home}.{name}", f"vibroswarm.{name}"} & known)


def test_every_public_name_is_in_the_reference(site):
    known = inventory(site)
    assert "vibroswarm.Floor.fill_ratio" in known
    public = {(room, name) for room in rooms() for name in importlib.import_module(room).__all__}
    public |= names_in_documents()
    assert len(public) >= 70
    missing = [f"{module}.{name}" for module, name in sorted(public) if not documented(module, name, known)]
    assert missing == []
    assert not documented("vibroswarm.core.rng", "uniform", known)


def internals(names: set[str]) -> set[str]:
    """Names that are not for users: with an underscore, and functions of shipped strategies that the engine calls."""
    hooks = r"vibroswarm\.strategies\.(?!base\.|bayes\.|soft\.)\w+\.(begin|on_\w+|decision|State|Message)"
    return {name for name in names if re.search(r"\._[a-z]", name) or re.fullmatch(hooks, name)}


def test_the_reference_has_no_internals(site):
    assert internals(inventory(site)) == set()
    assert internals({"vibroswarm.strategies.mcp.on_sample", "vibroswarm.a._b", "vibroswarm.simulate"}) == {
        "vibroswarm.strategies.mcp.on_sample",
        "vibroswarm.a._b",
    }


def test_every_module_of_the_reference_is_one(site):
    modules = re.findall(r"automodule:: (\S+)", "\n".join(p.read_text() for p in (DOCS / "api").glob("*.md")))
    for module in modules:
        assert importlib.import_module(module).__doc__, module


@pytest.fixture
def opened(browser: Any) -> Iterator[Callable[..., tuple[Any, list[str]]]]:
    """Opens a page from disk, and tells what went wrong in it or came from elsewhere; closed after the test."""
    contexts = []

    def of(page: Path, **how: Any) -> tuple[Any, list[str]]:
        wrong: list[str] = []
        contexts.append(browser.new_context(**how))
        tab = contexts[-1].new_page()
        tab.on("console", lambda message: wrong.append(message.text))
        tab.on("pageerror", lambda error: wrong.append(str(error)))
        tab.on(
            "request", lambda request: request.url.startswith(("file:", "data:")) or wrong.append(request.url)
        )
        tab.goto(page.as_uri())
        return tab, wrong

    yield of
    for context in contexts:
        context.close()


@pytest.mark.parametrize("name", ["index", "tutorial", "commands", "api/vibroswarm"])
def test_pages_are_whole_on_a_phone(site, opened, name):
    tab, wrong = opened(site / f"{name}.html", viewport={"width": 375, "height": 800})
    for scheme in ("light", "dark"):
        tab.emulate_media(color_scheme=scheme)
        assert tab.locator("h1").first.is_visible()
        assert tab.evaluate("document.documentElement.scrollWidth") <= 375
        assert all(tab.evaluate("[...document.images].map(image => image.naturalWidth > 0)"))
        shade = tab.evaluate("getComputedStyle(document.body).backgroundColor.match(/\\d+/g).map(Number)")
        assert (sum(shade) > 600) == (scheme == "light")
    assert wrong == []


def test_long_commands_are_whole_on_paper(site, opened):
    tab, _ = opened(site / "optimizing.html", viewport={"width": 720, "height": 1000})
    tab.emulate_media(media="print")
    blocks = tab.locator("article pre")
    assert blocks.count() > 3
    assert all(blocks.evaluate_all("all => all.map(one => one.scrollWidth <= one.clientWidth)"))


@pytest.mark.parametrize(
    ("name", "width"), [("troubleshooting", 1200), ("troubleshooting", 375), ("which-strategy", 375)]
)
def test_the_answer_stands_beside_the_case(site, opened, name, width):
    tab, _ = opened(site / f"{name}.html", viewport={"width": width, "height": 800})
    cut = "[...document.querySelectorAll('.table-wrapper')].filter(table => table.scrollWidth > table.clientWidth + 4)"
    assert tab.locator(".table-wrapper").count()
    assert tab.evaluate(f"{cut}.length") == 0


SOUGHT = {
    "moran": "Floors",
    "install": "Tutorial",
    "own strategy": "How to write your own strategy",
    "confidence interval": "Statistics",
    "packet loss": "Networks",
    "cluster": "On more machines than one",
    "robots fail": "Robots that fail",
    "kilosim": "Coming from ARGoS, Webots, Kilosim",
    "belief_below": "vibroswarm.robot.belief.belief_below",
}
"""What readers look for, and the beginning of the first result."""


def test_the_search_finds_the_right_page_first_with_an_excerpt(site, opened):
    tab, wrong = opened(site / "index.html", viewport={"width": 1200, "height": 800})
    first = {}
    for query in SOUGHT:
        tab.goto((site / "search.html").as_uri() + "?q=" + query.replace(" ", "+"))
        tab.locator("#search-results li a").first.wait_for()
        first[query] = tab.locator("#search-results li > a").first.inner_text()
        if "_" not in query:
            excerpt = tab.locator("#search-results li").first.locator(".excerpt")
            excerpt.wait_for()
            assert len(excerpt.inner_text()) > 20
    assert {q: first[q] for q in SOUGHT if not first[q].startswith(SOUGHT[q])} == {}
    assert wrong == []


def test_the_front_page_plays_an_inspection(site, opened):
    tab, wrong = opened(site / "index.html", viewport={"width": 1200, "height": 900})
    player = tab.frame_locator(".replay iframe")
    player.locator("#actors").wait_for()
    assert "0.48" in player.locator("body").inner_text()
    assert (site / "_static" / "replay.html").stat().st_size < 400_000
    assert wrong == []


def test_the_search_works_from_disk(site, opened):
    tab, wrong = opened(site / "index.html", viewport={"width": 1200, "height": 800})
    tab.fill("input[name=q]", "moran")
    tab.keyboard.press("Enter")
    found = tab.locator("#search-results li a")
    found.first.wait_for()
    assert "Floors" in found.all_inner_texts()
    tab.locator("#search-results li > a").get_by_text("Floors", exact=True).first.click()
    assert tab.locator("h1").first.inner_text().startswith("Floors")
    tab.goto((site / "search.html").as_uri() + "?q=zzzznothing")
    tab.get_by_text("did not match any documents").wait_for()
    assert wrong == []
