"""No module imports in a circle, not even inside functions, and nothing inside imports through the root."""

from __future__ import annotations

import graphlib

import grimp
import pytest


def modules_in_a_circle(imported_by: dict[str, set[str]]) -> list[str]:
    """Some circle of modules; empty if there is none."""
    try:
        list(graphlib.TopologicalSorter(imported_by).static_order())
    except graphlib.CycleError as error:
        return list(error.args[1])
    return []


@pytest.fixture(scope="module")
def imported_by() -> dict[str, set[str]]:
    graph = grimp.build_graph("vibroswarm", exclude_type_checking_imports=True)
    return {module: set(graph.find_modules_directly_imported_by(module)) for module in graph.modules}


def test_no_module_imports_in_a_circle(imported_by: dict[str, set[str]]) -> None:
    assert len(imported_by) > 300
    assert modules_in_a_circle(imported_by) == []


def test_nothing_inside_imports_through_the_root(imported_by: dict[str, set[str]]) -> None:
    through = {module for module, found in imported_by.items() if "vibroswarm" in found}
    assert through <= {"vibroswarm.testing", "vibroswarm.__main__"}
