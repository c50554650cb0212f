"""Kernels of different strategies have different keys, wherever their code was written."""

from __future__ import annotations

import importlib
import linecache
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import njit

from vibroswarm.core.compiled_code import UnknownValueError
from vibroswarm.inference.generated_kernels import _text_of, hooks_of, key_of
from vibroswarm.networks import network
from vibroswarm.scenario.plugins import load_code
from vibroswarm.strategies import strategy
from vibroswarm.strategies.base import Strategy


def cell(text: str, module: str = "not_imported") -> Strategy:
    """A strategy whose function ``decision`` was typed into a cell with other code."""
    names: dict[str, Any] = {"__name__": module, "np": np, "njit": njit}
    linecache.cache["<cell>"] = (len(text), None, text.splitlines(True), "<cell>")  # as notebooks do
    exec(compile(text, "<cell>", "exec"), names)  # noqa: S102 - a text of this file
    function: Any = names["decision"]
    return replace(strategy("none"), source=None, decision=function)


DECISION = "def decision(s, a, p, w):\n    return {}\n"


def test_strategies_of_a_module_without_a_source_file_are_told_apart_by_their_code() -> None:
    one, same, other = (cell(DECISION.format(decides), "builtins") for decides in (1, 1, 0))
    assert key_of(one) == key_of(same) != key_of(other)


CELLS = {
    "helper": "def limit(x):\n    return x > {}\n" + DECISION.format("limit(s.alpha)"),
    "helper of a helper": "def most():\n    return {}\ndef limit(x):\n    return x > most()\n"
    + DECISION.format("limit(s.alpha)"),
    "compiled helper": "@njit\ndef limit(x):\n    return x > {}\n" + DECISION.format("limit(s.alpha)"),
    "tuple": "LIMITS = (1, {})\n" + DECISION.format("LIMITS[1]"),
    "array": "LIMITS = np.array([1, {}])\n" + DECISION.format("LIMITS[1]"),
    "closure": "def made(limit):\n    def decision(s, a, p, w):\n        return limit\n"
    "    return decision\ndecision = made({})\n",
    "nested": DECISION.format("(lambda x: x + {})(1)"),
    "default": "def limit(x, most={}):\n    return x > most\n" + DECISION.format("limit(s.alpha)"),
    "default of a keyword": "def limit(x, *, most={}):\n    return x > most\n"
    + DECISION.format("limit(s.alpha)"),
    "names of arguments": "@njit\ndef limit(most, a{}):\n    return most > 1\n"
    + DECISION.format("limit(a4=2, most=3)"),
    "how a helper is compiled": "@njit(fastmath={} > 3)\ndef limit(x):\n    return x > 1.0\n"
    + DECISION.format("limit(s.alpha)"),
    "signature of a helper": "SIGNATURES = {{3: 'int32(int64)', 4: 'int64(int64)'}}\n"
    "@njit(SIGNATURES[{}])\ndef limit(x):\n    return x\n" + DECISION.format("limit(s.alpha)"),
    "set": "LIMITS = {{1, {}}}\n" + DECISION.format("s.alpha in LIMITS"),
    "dictionary": "LIMITS = {{'most': {}}}\n" + DECISION.format("LIMITS['most']"),
}

JITCLASS = """from numba.experimental import jitclass
@jitclass([("most", int64)])
class limit:
    def __init__(self, most):
        self.most = most
"""


@pytest.mark.parametrize("kind", CELLS)
def test_all_that_a_typed_in_function_is_compiled_with_is_in_its_key(kind: str) -> None:
    assert key_of(cell(CELLS[kind].format(3))) != key_of(cell(CELLS[kind].format(4)))
    assert key_of(cell(CELLS[kind].format(3))) == key_of(cell(CELLS[kind].format(3)))
    # In another process it is the same: no address in memory is part of it.
    assert "0x" not in _text_of(cell(CELLS[kind].format(3)))


def test_a_function_without_a_module_and_an_unassigned_variable_of_a_closure_have_a_key() -> None:
    """Neither stops the key from being made; the rest of the code still distinguishes two strategies."""
    lost = "def limit():\n    return {}\nlimit.__module__ = None\n" + DECISION.format("limit()")
    assert key_of(cell(lost.format(3))) != key_of(cell(lost.format(4)))
    empty = (
        "def made():\n    def decision(s, a, p, w):\n        return later if s.own < 0 else {}\n"
        "    if False:\n        later = 1\n    return decision\ndecision = made()\n"
    )
    assert key_of(cell(empty.format(3))) != key_of(cell(empty.format(4)))


def test_a_file_that_is_imported_and_loaded_by_name_has_two_keys(tmp_path, monkeypatch):
    """A cached kernel refers to the modules of its functions, and a later process may not have them."""
    text = (Path(__file__).parents[2] / "examples" / "strategies" / "voter.py").read_text(encoding="utf-8")
    (tmp_path / "voter_of_a_test.py").write_text(text.replace('"voter"', '"voter_of_a_test"').replace(
        "voter = ", "voter_of_a_test = "), encoding="utf-8")  # fmt: skip
    monkeypatch.syspath_prepend(tmp_path)
    imported = importlib.import_module("voter_of_a_test").voter_of_a_test
    code = load_code("voter_of_a_test.py:voter_of_a_test", tmp_path)
    loaded = strategy("voter_of_a_test")
    assert code.startswith("voter_of_a_test.py:voter_of_a_test sha256:")
    assert loaded.source == _text_of(imported)
    assert key_of(loaded) != key_of(imported)


ELSEWHERE = """import enum
import numba
K = 1.0
LIMITS = (1, 2)
WORDS = b"1"
TURN = 1 + 2j
NOT_READ = 0
class Side(enum.IntEnum):
    LESS = 1
@numba.njit
def inner():
    return 3.0
@numba.njit
def limit():
    return inner()
def plain():
    return 4.0
"""
READING = """import read_by_it.sides
import read_by_it.sides as elsewhere
from vibroswarm.strategies import strategy_in
from read_by_it.sides import K, Side, TURN, WORDS, limit
class State:
    n: float
def begin(s, a, d, p, w):
    s.n = 0.0
def on_sample(s, a, x, out, d, p, w):
    s.n += K * elsewhere.LIMITS[0] + len(WORDS) + TURN.imag
    return False
def on_message(s, a, m, sender, t_s, d, p, w):
    s.n += read_by_it.sides.plain()
def decision(s, a, p, w):
    return Side.LESS if s.n > limit() else -1
mine = strategy_in(__name__, "of_another_file", decides="opinion", about="reads another file")
"""


@pytest.fixture
def key_after(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str, str], str]]:
    """The key of a strategy that takes constants and functions from a module in a package, after a change there."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    (tmp_path / "reading_strategy.py").write_text(READING, encoding="utf-8")
    (tmp_path / "read_by_it").mkdir()
    (tmp_path / "read_by_it" / "__init__.py").touch()
    modules = ("read_by_it.sides", "read_by_it", "reading_strategy")

    def key(before: str, after: str) -> str:
        assert before in ELSEWHERE
        text = ELSEWHERE.replace(before, after)
        (tmp_path / "read_by_it" / "sides.py").write_text(text, encoding="utf-8")
        for name in modules:
            sys.modules.pop(name, None)
        importlib.invalidate_caches()
        return key_of(importlib.import_module("reading_strategy").mine)

    yield key
    for name in modules:
        sys.modules.pop(name, None)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("K = 1.0", "K = 0.25"),
        ("(1, 2)", "(2, 2)"),
        ('b"1"', 'b"2"'),
        ("2j", "3j"),
        ("LESS = 1", "LESS = 0"),
        ("return 3.0", "return 1.0"),
        ("return 4.0", "return 5.0"),
    ],
)
def test_what_is_read_from_another_file_is_in_the_key(
    before: str, after: str, key_after: Callable[[str, str], str]
) -> None:
    """Constants of several types, what a compiled function calls, a function of a module in a package."""
    same = key_after(before, before)
    assert key_after(before, after) != same
    assert key_after(before, before) == same
    assert key_after("NOT_READ = 0", "NOT_READ = 1") == same


def test_a_constant_that_is_set_anew_in_a_session_is_in_the_key() -> None:
    """As in a notebook, where the strategy is not declared again."""
    made = cell("LIMIT = 3\n" + DECISION.format("LIMIT"))
    before = key_of(made)
    hooks = hooks_of(made, network("ideal"))
    assert hooks_of(made, network("ideal")) is hooks
    made.decision.__globals__["LIMIT"] = 4  # type: ignore[union-attr]
    assert key_of(made) != before
    assert hooks_of(made, network("ideal")) is not hooks


def test_the_order_of_a_set_which_differs_from_process_to_process_is_not_in_the_key() -> None:
    one, other = (
        f"LIMITS = {{{order}}}\n" + DECISION.format("s.alpha in LIMITS") for order in ("0, 8", "8, 0")
    )
    assert key_of(cell(one)) == key_of(cell(other))


def test_errors_of_one_name_in_two_modules_are_told_apart() -> None:
    text = "class Wrong(Exception):\n    pass\n" + DECISION.format("Wrong()")
    assert key_of(cell(text, "one")) != key_of(cell(text, "other"))


CLASS = "class limit:\n    def __init__(self, most):\n        self.most = most\n"


@pytest.mark.parametrize("helper", ["@vectorize\ndef limit(x):\n    return x > 1\n", JITCLASS, CLASS])
def test_what_was_made_of_functions_that_cannot_be_seen_has_no_key(helper: str) -> None:
    with pytest.raises(UnknownValueError):
        key_of(cell("from numba import int64, vectorize\n" + helper + DECISION.format("limit(s.alpha)")))


def test_kernels_of_a_value_that_cannot_be_described_are_not_cached(caplog: pytest.LogCaptureFixture) -> None:
    made = cell("class Limit:\n    most = 3\nLIMIT = Limit()\n" + DECISION.format("LIMIT.most"))
    with pytest.raises(UnknownValueError, match="type Limit"):
        key_of(made)
    assert not hooks_of(made, network("ideal")).IS_SAVED
    assert "no change can be seen" in caplog.text
    assert hooks_of(cell(DECISION.format(1)), network("ideal")).IS_SAVED  # the control
