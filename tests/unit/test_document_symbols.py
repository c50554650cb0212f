"""Symbols of the documents become formulas; words, numbers and names of files do not."""

from __future__ import annotations

import re
import runpy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("sphinx", reason="Sphinx is not installed: pip install 'vibroswarm[docs]'")
from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def typeset() -> Callable[[str], list[Any]]:
    return runpy.run_path(str(DOCS / "symbols.py"))["typeset"]


def test_the_search_has_formulas_as_words() -> None:
    as_words = runpy.run_path(str(DOCS / "search_texts.py"))["as_words"]
    assert as_words(r"1 - t / (7 \, T_\mathrm{end})") == "1 - t / (7 T_end)"
    assert as_words(r"\hat{E} > \theta_E") == "E > theta_E"
    assert as_words(r"\alpha / (\alpha + \beta)") == "alpha / (alpha + beta)"


@pytest.mark.parametrize(
    ("text", "formulas"),
    [
        ("at theta_E 1.55, tau and T_end.", [r"\theta_{E}", r"\tau", r"T_\mathrm{end}"]),
        ("gamma_0 (7860), H_c^max", [r"\gamma_{0}", r"H_{c}^\mathrm{max}"]),
        ("least gap 1.8 x 10^-13 m", ["10^{-13}"]),
        ("eps_f of p_i^k", [r"\epsilon_{f}", "p_{i}^{k}"]),
        ("the incomplete beta function, a beta-binomial and a Gamma distribution", []),
        ("a robot in run_page/assets or best_scenario(found), mean + sd, x", []),
        ("alphabet, betas, tau-leaping, delta.py", []),
    ],
)
def test_symbols_are_found(typeset: Callable[[str], list[Any]], text: str, formulas: list[str]) -> None:
    parts = typeset(text)
    assert [part.astext() for part in parts if isinstance(part, nodes.math)] == formulas
    for latex in formulas:
        assert tex2mathml(latex, as_block=False).startswith("<math")
    kept = "".join(part.astext() for part in parts if isinstance(part, nodes.Text))
    assert kept == text or formulas


def test_columns_of_results_are_not_typeset(typeset: Callable[[str], list[Any]]) -> None:
    text = (DOCS / "results.md").read_text(encoding="utf-8")
    table = text[text.index("| table | one row |") : text.index("**consensus**")]
    parts = typeset(re.sub(r"`[^`\n]*`|\$[^$\n]*\$", "", table))
    assert [part.astext() for part in parts if isinstance(part, nodes.math)] == []


def test_every_formula_of_the_documents_can_be_typeset() -> None:
    found = 0
    for page in DOCS.glob("*.md"):
        plain = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        for latex in re.findall(r"(?<![\\$])\$([^$\n]+)\$", plain):
            assert tex2mathml(latex, as_block=False).startswith("<math"), f"{page.name}: {latex}"
            found += 1
    assert found > 50
