"""A method of search of a user's own is one file."""

from __future__ import annotations

from pathlib import Path

import pytest

from helpers.commands import output_of, refusal_of
from vibroswarm.search.methods import forget

EXAMPLE = Path(__file__).parents[2] / "examples" / "methods" / "near.py"
SMALL = (
    Path(__file__).parents[1] / "helpers" / "small_search.toml"
).read_text() + "\n[search]\nbudget = 90\nfinal = 30\nevaluations = 3\n"


def test_a_file_is_a_method(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("optuna")
    search, out = tmp_path / "search.toml", tmp_path / "out"
    search.write_text(SMALL)
    line = ["optimize", search, "--fresh", "20", "--no-pictures", "--out", out, "--method", f"{EXAMPLE}:near"]
    assert "over 2 fields" in output_of(capsys, *line)
    assert (out / "near.py").read_text() == EXAMPLE.read_text()
    forget("near")
    again = ["optimize", out / "search.toml", "--no-pictures"]
    assert "is code that is not loaded" in refusal_of(capsys, *again)
