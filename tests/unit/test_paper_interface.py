"""The reproduction is a client of the public interface; what it imports besides has a reason, and no other use."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import vibroswarm
from vibroswarm.paper.claims import all_claims

HERE = Path(vibroswarm.__file__).parent / "paper"
NAMES = Path(__file__).parents[2] / "docs" / "api" / "names.md"
INSIDE = {
    "core": "a reproduction is saved, hashed, guarded, written in numbers and shown as every result of the house",
    "errors.check_choice": "misspelled names are answered as everywhere",
    "errors.check_known_keys": "the same",
    "simulation.versions": "what a saved table was computed with",
    "scenario.scenario.differences": "the options that make a cell's scenario from its preset",
    "inference.outcomes": "cells are summed up from arrays, since frames of a million runs took most of the time",
    "study.batch_table.WALK": "the columns of how robots walked that a study saves",
    "study.cell_comparison.second_seed": "fresh runs have the seed that a study's own confirmation has",
    "observation.decision_boundary.expected_ones": "the mean over random floors, where decidability takes one floor",
    "networks.loss_by_size.MOST": "the largest swarm for which the fitted network holds",
    "floors.difficulty.paper_table": "printed difficulties beside the right ones, as 'floors list' has them",
    "league.entries": "the settings that the league keeps for a strategy, from its own data",
}
"""Why the paper imports what is not public, by module or name below ``vibroswarm``."""


def public() -> dict[str, set[str]]:
    """Public names by module, of the generated page."""
    rows = re.findall(r"^\| `([\w.]+)` \| (.*) \|$", NAMES.read_text(encoding="utf-8"), re.MULTILINE)
    return {module: set(re.findall(r"`(\w+)`", names)) for module, names in rows}


def imported() -> Iterator[tuple[str, str, str]]:
    """Module and name of what the paper imports from outside of its folder, and the file."""
    for path in sorted(HERE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("vibroswarm."):
                for alias in node.names:
                    if not str(node.module).startswith("vibroswarm.paper"):
                        yield str(node.module), alias.name, path.name


def reason_for(module: str, name: str) -> str | None:
    """The key of ``INSIDE`` under which an import is allowed; None if there is none."""
    full = f"{module}.{name}".removeprefix("vibroswarm.")
    return next((key for key in INSIDE if full == key or full.startswith(f"{key}.")), None)


def test_the_paper_imports_public_names_or_says_why_not() -> None:
    known, used = public(), set()
    for module, name, path in imported():
        # A name of the package's root is imported from where it is, as no module imports through the root.
        if name in known.get(module, ()) or (
            name in known["vibroswarm"] and getattr(import_module(module), name) is getattr(vibroswarm, name)
        ):
            continue
        reason = reason_for(module, name)
        assert reason is not None, f"{path} imports {module}.{name}, which is not public"
        used.add(reason)
    assert used == set(INSIDE)  # no reason outlives its import


def test_inner_names_are_found() -> None:
    known = public()
    assert "simulate" in known["vibroswarm"]
    assert "paired_score" in known["vibroswarm.optimize"]
    assert reason_for("vibroswarm.plots.layout", "new_figure") is None
    assert reason_for("vibroswarm.core.folders", "FORMAT") == "core"


OTHERWISE_NAMED = {"corners": "a table", "estimate": "a column", "headline-seeds": "a picture"}
"""Texts of the code that are a claim's id too, and what else they name."""


def test_no_code_knows_the_id_of_a_claim() -> None:
    ids = {claim.id for claim in all_claims()} - set(OTHERWISE_NAMED)
    assert len(ids) > 50
    for path in sorted(HERE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            assert not (isinstance(node, ast.Constant) and node.value in ids), f"{path.name}: {node.value}"
