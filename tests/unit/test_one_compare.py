"""One comparison of cells: who estimates or tests paired differences, and who draws runs, by the names they use.

Everything else gives its values to ``analysis.paired``, which pairs, rounds, tests and draws.
"""

from __future__ import annotations

from pathlib import Path

from helpers.sources import called, imported, modules

TESTS = {
    "vibroswarm.analysis.intervals": {"sign_flip", "student_test"},
    "scipy.stats": {"ttest_1samp", "ttest_rel", "wilcoxon"},
}
"""Tests of paired differences, by module."""
COMPARE = {
    "analysis/paired.py": "the comparison",
}
NAME_A_TEST = {
    "league/standings.py": "says by which test the comparison is made, over floors and floor by floor",
    "league/fault_curves.py": "the same",
    "calibrate/classifier.py": "says by which test simulations are compared, over few sessions",
}
DRAW = {
    "analysis/paired.py": "draws that several cells share",
    "analysis/intervals.py": "the bootstrap of a single cell's figure",
}


def test_only_these_test_differences() -> None:
    assert {name for name, path in modules() if imported(path, TESTS)} == {*COMPARE, *NAME_A_TEST}


def test_only_these_draw_runs_again() -> None:
    assert {name for name, path in modules() if called(path, {"multinomial"})} == set(DRAW)


def test_a_comparison_of_its_own_is_seen(tmp_path: Path) -> None:
    """Negative control: a test within a function, and draws."""
    file = tmp_path / "own.py"
    file.write_text("def compare(d):\n    from scipy.stats import ttest_1samp as t\n    return t(d, 0)\n")
    assert imported(file, TESTS) == {"ttest_1samp"}
    file.write_text("def draws(random, shares):\n    return random.multinomial(9, shares)\n")
    assert called(file, {"multinomial"})
