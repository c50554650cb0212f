"""Small files that state much: each is refused, or shown in part, before it takes minutes or fills the memory."""

from __future__ import annotations

import time

import polars as pl
import pytest

from helpers.commands import output_of, refusal_of
from vibroswarm.cli import main
from vibroswarm.core.untrusted_files import parsed_toml
from vibroswarm.documents import shown_file
from vibroswarm.errors import InputError
from vibroswarm.scenario.scenario import Scenario, parse_setting

MOST_CPU_S = 30.0
"""Far more than any of these needs, and far less than each took."""
MANY = 100_000


@pytest.fixture(autouse=True)
def soon():
    before = time.process_time()
    yield
    assert time.process_time() - before < MOST_CPU_S


KEYS = [
    "a" + ".a" * MANY + " = 1\n",
    "[" + "a." * MANY + "a]\n",
    "[[ " + "1 . " * MANY + "1 ]]\n",
    "x = {" + '"a,b".' * MANY + "a = 1}\n",
    "x = {" + "'a=b' .b." * MANY + "a = 1}\n",
    "{a = '''\n \" ''', " + "b." * MANY + 'b = 1, c = " "}\n',
]


@pytest.mark.parametrize("text", KEYS, ids=range(len(KEYS)))
def test_keys_of_very_many_parts(text, tmp_path, capsys):
    path = tmp_path / "keys.toml"
    path.write_text(f"runs = 3\n{text}")
    with pytest.raises(InputError, match="has a key of more than 200 parts"):
        parsed_toml(text, "text")
    with pytest.raises(InputError, match="has a key of more than 200 parts"):
        Scenario.from_toml(text)
    for command in (["show"], ["run", "--scenario"], ["evaluate"], ["optimize"]):
        assert main([*command, str(path)]) == 2


def test_settings_of_very_many_parts(capsys):
    with pytest.raises(InputError, match="more than 200 parts"):
        parse_setting("a={" + "b." * MANY + "b=1}")
    assert len(refusal_of(capsys, "run", "--set", "a." * MANY + "a=1")) < 1000


def test_lists_of_numbers_and_long_texts_are_no_keys():
    numbers = ", ".join(f"{k}.5" for k in range(5000))
    text = f"a = [{numbers}]\nb = ['{'x.' * 150}', '{'y.' * 150}']\n"
    assert len(parsed_toml(text, "text")["a"]) == 5000
    assert parse_setting(f"a=[{numbers}]")[1][-1] == 4999.5


def test_a_table_with_more_rows_than_its_file_can_hold(tmp_path, capsys):
    path = tmp_path / "rows.parquet"
    pl.select(pl.repeat(0, 60_000_000, dtype=pl.Int64).alias("a")).write_parquet(path)
    assert path.stat().st_size < 600_000
    assert "states 60,000,000 rows, too many for a file of" in refusal_of(capsys, "show", path)


def test_a_long_table_is_shown_in_part(tmp_path, capsys):
    for name in ("rows.parquet", "rows.csv"):
        table = pl.DataFrame({"a": [0] * 100_000})  # 171 cells per byte, and not too many
        table.write_parquet(tmp_path / name) if "parquet" in name else table.write_csv(tmp_path / name)
        out = output_of(capsys, "show", tmp_path / name)
        assert "... and 99,940 more rows; --wide prints all." in out
        assert (
            len(out.splitlines()) == 64
        )  # what it is, an empty line, the heading, 60 rows, and how many more


def test_a_table_of_very_many_columns(tmp_path, capsys):
    path = tmp_path / "columns.csv"
    path.write_text(",".join(f"c{k}" for k in range(300_000)) + "\n" + "1," * 299_999 + "1\n")
    assert "has more than 10,000 columns" in refusal_of(capsys, "show", path)


def test_a_table_in_utf_16_is_not_shown_as_zeros(tmp_path, capsys):
    path = tmp_path / "spreadsheet.csv"
    path.write_text("robot,time_s\n1,2\n", encoding="utf-16")
    assert "is binary or UTF-16; give a CSV in UTF-8" in refusal_of(capsys, "show", path)


def test_a_binary_file_is_refused_before_all_of_it_is_read(tmp_path, capsys, monkeypatch):
    path = tmp_path / "zeros.csv"
    with path.open("wb") as file:
        file.truncate(2**30)
    monkeypatch.setattr(shown_file, "read_bytes", None)
    assert "is binary or UTF-16; give a CSV in UTF-8" in refusal_of(capsys, "show", path)


def test_a_row_of_very_many_tiles(tmp_path, capsys):
    row = "01" * 2_000_001
    (tmp_path / "row.toml").write_text(f'[floor]\ntiles = ["{row}"]\n')
    (tmp_path / "row.txt").write_text(row)
    assert "floor.tiles: is too large; at most 4,000,000 tiles" in refusal_of(
        capsys, "show", tmp_path / "row.toml"
    )
    assert "line 1 is too long; a floor has at most 4,000,000 tiles" in refusal_of(
        capsys, "run", "--floor", tmp_path / "row.txt"
    )
