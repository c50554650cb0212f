"""Texts of the sections, for the search: excerpts and counts of words also where pages are opened from disk.

Sphinx' own index says which pages have a word, not how often, and its excerpts are read from the other pages, which
browsers refuse from disk. ``_static/search_texts.js`` has the texts; ``search_scorer.js`` uses them.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from docutils import nodes

LONGEST = 6000
"""Characters of a section that are searched."""


def as_words(latex: str) -> str:
    """Return a formula as the sources write symbols: ``theta_E``, ``T_end``, ``alpha / (alpha + beta)``."""
    text = re.sub(r"\\(?:mathrm|hat)\{([^}]*)\}", r"\1", latex)
    text = re.sub(r"\\[,;! ]", "", text)
    return " ".join(re.sub(r"\\([a-zA-Z]+)", r"\1", text).split())


def text_of(node: nodes.Node) -> str:
    """Return the text of a part of a section, its formulas as words."""
    copy = node.deepcopy()
    for formula in list(copy.findall(nodes.math)):
        formula.parent.replace(formula, nodes.Text(as_words(formula.astext())))
    return " ".join(copy.astext().split())


def sections(doctree: nodes.document) -> list[tuple[str, str, str]]:
    """Return anchor, title and text of each section, without the sections in it."""
    found = []
    for section in doctree.findall(nodes.section):
        title = section.next_node(nodes.title)
        own = [child for child in section.children if not isinstance(child, nodes.section | nodes.title)]
        text = " ".join(text_of(child) for child in own if not isinstance(child, nodes.raw))
        found.append((section["ids"][0], title.astext() if title else "", text[:LONGEST]))
    return found


def write_texts(app: Any, failed: Exception | None) -> None:
    """Write the texts of all pages but those of the API, whose names the index has."""
    if failed is not None or app.builder.format != "html":
        return
    texts = {
        name: sections(app.env.get_doctree(name))
        for name in sorted(app.env.found_docs)
        if not name.startswith("api/")
    }
    content = "const SECTION_TEXTS = " + json.dumps(texts, ensure_ascii=False, separators=(",", ":")) + ";\n"
    (Path(app.outdir) / "_static" / "search_texts.js").write_text(content, encoding="utf-8")


def load_on_search_page(app: Any, pagename: str, *_: Any) -> None:
    """Load the texts where they are used only."""
    if pagename == "search":
        app.add_js_file("search_texts.js")


def setup(app: Any) -> dict[str, bool]:
    """Register the hooks."""
    app.connect("html-page-context", load_on_search_page)
    app.connect("build-finished", write_texts)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
