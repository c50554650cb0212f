"""The short ledger is as it was kept, and the ledger sees the smallest changes; ``helpers.ledger`` makes the whole."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from helpers.ledger import (
    LIST,
    Hashes,
    combinations,
    differences,
    hash_of_program,
    hash_of_result,
    hashes_of_file,
    hashes_of_table,
    kept_hashes,
)
from vibroswarm import Result, preset, simulate


@pytest.fixture(scope="module")
def result() -> Result:
    return simulate(preset("paper").with_values({"run.t_end_s": 60.0}), LIST["seed"], 2)


@pytest.mark.parametrize(
    ("table", "column"),
    [("motion", "x_m"), ("observations", "energy"), ("robots", "alpha"), ("robots", "estimate")],
)
def test_one_bit_of_one_number_is_seen(result: Result, table: str, column: str) -> None:
    """Negative control: the least change of the last number of a column."""
    frame = getattr(result, table)
    values = frame[column].cast(pl.Float64).to_numpy().copy()
    values[-1] = np.nextafter(values[-1], np.inf)
    changed = Result(**{**vars(result), table: frame.with_columns(pl.Series(column, values))})
    also = {"robots": ["estimate"]}
    assert hash_of_result(changed, also) != hash_of_result(result, also)
    assert hash_of_result(Result(**vars(result)), also) == hash_of_result(result, also)


def test_another_uniform_number_is_seen(result: Result) -> None:
    """Negative control: one bit of the seed."""
    other = simulate(result.scenario, LIST["seed"] ^ 1, 2)
    assert hash_of_result(other) != hash_of_result(result)


def test_one_sum_of_a_table_is_seen(tmp_path: Path) -> None:
    """Negative control: numbers that are added in another order; words and new columns do not count."""
    kept = hashes_of_table(pl.DataFrame({"name": ["a"], "sum": [0.1 + 0.2 + 0.3]}))
    other = hashes_of_table(pl.DataFrame({"name": ["b"], "sum": [0.3 + 0.2 + 0.1], "new": [1]}))
    assert kept.keys() == {"sum"}
    assert differences({"x": other}, {"x": kept}, all_there=True) == ["x: sum differ"]
    same = hashes_of_table(pl.DataFrame({"name": ["b"], "sum": [0.1 + 0.2 + 0.3], "new": [1]}))
    assert differences({"x": same}, {"x": kept}, all_there=True) == []
    (tmp_path / "numbers.toml").write_text("a = 1.5\n[b]\nc = [1, 2]\n")
    assert hashes_of_file(tmp_path / "numbers.toml").keys() == {"a", "b.c"}


def test_what_is_gone_or_new_is_seen() -> None:
    kept: Hashes = {"a": "1", "b": {"c": "2"}}
    assert differences({"a": "1"}, kept, all_there=True) == ["b: is missing"]
    assert differences({"a": "1"}, kept, all_there=False) == []
    assert differences({"a": "2", "b": {}}, kept, all_there=True) == ["a: differs", "b: c differ"]
    assert differences(kept | {"d": "3"}, kept, all_there=True) == ["d: is not in the ledger"]


def test_of_a_program_only_tokens_count() -> None:
    program = "int f(int x) { return x + 1; } /* made by 0123456789abcdef */"
    assert hash_of_program(program) == hash_of_program("int f(int x)\n{ return x + 1; } // made by another")
    assert hash_of_program(program) != hash_of_program(program.replace("+ 1", "+ 2"))


def test_the_short_ledger_has_every_strategy_and_every_fault() -> None:
    (block,) = (block for block in LIST["runs"] if block["name"] == "strategies")
    in_short = [name.split(", ") for name, _ in combinations(block, short=True)]
    for place, kind in enumerate(block["of"]):
        if kind != "network":
            assert {names[place] for names in in_short} == set(LIST["choices"][kind])


def test_the_ledger_holds_what_its_list_names() -> None:
    kept = json.dumps(kept_hashes())
    for block in (*LIST["runs"], *LIST["export"], *LIST["command"]):
        assert f"{block['name']}: " in kept
