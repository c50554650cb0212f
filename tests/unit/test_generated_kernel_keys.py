"""Kernels of different strategies have different keys, wherever their code was written."""

from __future__ import annotations

import linecache
from dataclasses import replace
from typing import Any

import pytest

from vibroswarm.inference.generated_kernels import key_of
from vibroswarm.strategies import strategy
from vibroswarm.strategies.base import Strategy


def typed_in(module: str, decides: int) -> Strategy:
    """A strategy of which one function was typed in: its module is unknown, or one without a file."""
    text, names = f"def decision(s, a, p, w):\n    return {decides}\n", {"__name__": module}
    linecache.cache["<cell>"] = (len(text), None, text.splitlines(True), "<cell>")  # as notebooks do
    exec(compile(text, "<cell>", "exec"), names)  # noqa: S102 - the text above
    function: Any = names["decision"]
    return replace(strategy("none"), source=None, decision=function)


@pytest.mark.parametrize("module", ["not_imported", "builtins"])
def test_strategies_without_a_source_file_are_told_apart_by_their_code(module: str) -> None:
    assert key_of(typed_in(module, 1)) != key_of(typed_in(module, 0))
    assert key_of(typed_in(module, 1)) == key_of(typed_in(module, 1))
