"""Standard terms: no text that users read has a word that ``docs/terms.toml`` lists as one to avoid."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
MADE = {"commands.md", "scenario.md"}
"""Made from the sources, whose texts are looked at."""
TERMS = tomllib.loads((DOCS / "terms.toml").read_text(encoding="utf-8"))["instead_of"]
ANY = re.compile("|".join(TERMS))


class Found(NamedTuple):
    place: str
    words: str
    instead: str


def texts_of_a_program(program: str) -> Iterator[tuple[int, str]]:
    """Line and text of each literal of a program, and of docstrings of fields; not those of modules and functions."""
    nodes = list(ast.walk(ast.parse(program)))
    internal = set()
    for node in nodes:
        if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef) and node.body:
            first = node.body[0]
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                internal.add(id(first.value))
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            parts = [part.value if isinstance(part, ast.Constant) else "0" for part in node.values]
            yield node.lineno, "".join(str(part) for part in parts)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in internal:
            yield node.lineno, node.value


def texts_of_a_script(script: str) -> Iterator[tuple[int, str]]:
    """Line and text of JavaScript and HTML, without comments of whole lines."""
    for number, line in enumerate(script.splitlines(), start=1):
        if not line.lstrip().startswith(("//", "/*", "*", "<!--")):
            yield number, line


def texts_of_a_document(text: str) -> Iterator[tuple[int, str]]:
    """Line and text of the paragraphs of Markdown, each as one line, since a term may be broken."""
    line = 1
    for paragraph in re.split(r"(\n\s*\n)", text):
        if paragraph.strip():
            yield line, paragraph
        line += paragraph.count("\n")


def found_in(texts: Iterator[tuple[int, str]], name: str) -> Iterator[Found]:
    for line, text in texts:
        plain = " ".join(text.lower().split())
        if ANY.search(plain) is None:
            continue
        for pattern, instead in TERMS.items():
            for match in re.finditer(pattern, plain):
                yield Found(f"{name}:{line}", match[0], instead)


def sources(*endings: str) -> list[Path]:
    return sorted(path for end in endings for path in (ROOT / "src").rglob(f"*{end}"))


def test_programs_use_standard_terms():
    files = sources(".py")
    assert len(files) > 100
    found = [
        one
        for file in files
        for one in found_in(texts_of_a_program(file.read_text(encoding="utf-8")), str(file.relative_to(ROOT)))
    ]
    assert found == []


def test_pages_use_standard_terms():
    files = sources(".js", ".html")
    assert len(files) > 10
    assert [
        one
        for file in files
        for one in found_in(texts_of_a_script(file.read_text(encoding="utf-8")), str(file.relative_to(ROOT)))
    ] == []


def test_documents_use_standard_terms():
    files = [file for file in (ROOT / "README.md", *sorted(DOCS.rglob("*.md"))) if file.name not in MADE]
    texts = ((file.name, texts_of_a_document(file.read_text(encoding="utf-8"))) for file in files)
    assert [one for name, text in texts for one in found_in(text, name)] == []


def test_a_word_to_avoid_is_found():
    program = '"""Came of."""\nclass A:\n    x = 1\n    """Nothing is kept."""\nprint(f"add {x} bots; say --force")\n'
    found = list(found_in(texts_of_a_program(program), "a.py"))
    assert {(one.place, one.words) for one in found} == {
        ("a.py:4", "nothing is kept"),
        ("a.py:5", "bots"),
        ("a.py:5", "say --f"),
    }
    document = "A line.\n\nThe mean belief in\ntruth of Bayes Bots.\n"
    assert list(found_in(texts_of_a_document(document), "a.md")) == [
        Found("a.md:3", "belief in truth", "belief in the truth")
    ]
    assert list(found_in(texts_of_a_script("// bots\nsay('bots')\n"), "a.js")) == [
        Found("a.js:2", "bots", "robots")
    ]


def test_terms_are_patterns_and_recommend_nothing_that_they_forbid():
    for instead in TERMS.values():
        assert [pattern for pattern in TERMS if re.search(pattern, instead.lower())] in ([], [r"\bsay --\w"])
