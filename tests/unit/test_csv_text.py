"""CSV that a spreadsheet opens without running anything."""

from __future__ import annotations

import ast
import io
from pathlib import Path

import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

import vibroswarm
from vibroswarm.cli import main
from vibroswarm.core.tables import csv_bytes, escaped, unescaped

FORMULAS = ["=1+1", "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1", "\r=1", '=HYPERLINK("http://x")', "'=1"]
PLAIN = ["soft", "", "-", "-5", "+1.5e-3", "1-2", "a=b", "'quoted'", "−5", None]


@pytest.mark.parametrize("text", FORMULAS)
def test_formulas_are_escaped(text: str) -> None:
    frame = pl.DataFrame({"name": [text], "x": [-1.5]})
    (cell,) = pl.read_csv(io.BytesIO(csv_bytes(frame)))["name"].to_list()
    assert cell == f"'{text}"
    assert unescaped(escaped(frame)).equals(frame)


def test_everything_else_stays_as_it_is() -> None:
    frame = pl.DataFrame({"name": PLAIN, "x": range(len(PLAIN)), "y": [-float(k) for k in range(len(PLAIN))]})
    assert csv_bytes(frame) == frame.write_csv().encode()


def test_heads_and_words_of_enums_are_escaped_too() -> None:
    frame = pl.DataFrame({"=head": pl.Series(["+word", "ok"], dtype=pl.Enum(["+word", "ok"]))})
    assert csv_bytes(frame).decode().splitlines() == ["'=head", "'+word", "ok"]


@given(st.lists(st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=8), max_size=5))
def test_nothing_is_lost(texts: list[str]) -> None:
    frame = pl.DataFrame({"name": texts}, schema={"name": pl.String})
    assert unescaped(escaped(frame)).equals(frame)


def test_no_table_is_written_in_another_way() -> None:
    """Every CSV of the package goes through ``csv_bytes``."""
    top = Path(vibroswarm.__file__).parent
    calls = [
        path.relative_to(top).as_posix()
        for path in top.rglob("*.py")
        if "write_csv" in (program := path.read_text(encoding="utf-8"))
        for node in ast.walk(ast.parse(program))
        if isinstance(node, ast.Attribute) and node.attr == "write_csv"
    ]
    assert calls == ["core/tables.py"]


@pytest.mark.usefixtures("blank_pictures")
def test_a_label_that_is_a_formula_is_escaped_in_all_files_of_a_study(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(
        'runs = 2\n[scenario.run]\nt_end_s = 20.0\n[[list]]\nlabel = "=1+1"\n"swarm.robots" = 2\n'
        '[[list]]\nlabel = "@x"\n"swarm.robots" = 3\n'
    )
    assert (
        main(["evaluate", str(tmp_path / "study.toml"), "--out", str(tmp_path / "out"), "--no-confirm"]) == 0
    )
    texts = [path.read_text(encoding="utf-8") for path in (tmp_path / "out").rglob("*.csv")]
    cells = [cell for text in texts for line in text.splitlines() for cell in line.split(",")]
    assert "'=1+1" in cells
    assert not [cell for cell in cells if cell.lstrip('"')[:1] in ("=", "@")]
