"""The notebooks in ``examples/`` run, and their results show HTML.

Jupyter is not needed: the code cells are run in order by this file, as a kernel does, and the value of a cell's last
line is shown as a notebook shows it.
"""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

EXAMPLES = Path(__file__).parents[2] / "examples"
NOTEBOOKS = ("first_run", "study")


def cells_of(name: str) -> list[dict[str, Any]]:
    return list(json.loads((EXAMPLES / f"{name}.ipynb").read_text(encoding="utf-8"))["cells"])


def shown_by(code: list[str]) -> list[Any]:
    """Run cells in one namespace; return the values of their last lines, None where that is no expression."""
    names: dict[str, Any] = {"__name__": "__main__"}
    values = []
    for number, text in enumerate(code):
        body = ast.parse(text).body
        last = body.pop() if isinstance(body[-1], ast.Expr) else None
        exec(compile(ast.Module(body, []), f"cell {number}", "exec"), names)  # noqa: S102
        value = None if last is None else ast.Expression(last.value)
        values.append(None if value is None else eval(compile(value, f"cell {number}", "eval"), names))  # noqa: S307
    return values


def run(name: str) -> list[Any]:
    return shown_by(["".join(cell["source"]) for cell in cells_of(name) if cell["cell_type"] == "code"])


def test_every_notebook_is_tested_and_is_without_outputs() -> None:
    assert tuple(sorted(path.stem for path in EXAMPLES.glob("*.ipynb"))) == NOTEBOOKS
    for name in NOTEBOOKS:
        for cell in cells_of(name):
            assert cell["cell_type"] == "markdown" or (
                cell["outputs"] == [] and cell["execution_count"] is None
            )


def test_the_first_run_shows_verdict_picture_and_player() -> None:
    scenario, _, result, found, robots = run("first_run")
    assert "Right: all" in result._repr_html_()
    assert "<iframe" in result._repr_html_()
    assert found.consensus == "right"
    assert scenario._repr_html_().startswith("<div")
    assert robots.height == 5


def test_the_study_shows_its_answer() -> None:
    _, runs, summary, table, frame = run("study")
    assert runs._repr_html_().startswith("<div")
    assert summary.height == 2
    assert table.height > 3
    assert len(frame) == 5
