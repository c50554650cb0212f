"""Methods of search: the contract that all pass, and one of a user's own, which is one file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from helpers.commands import output_of, refusal_of
from vibroswarm.cli import main
from vibroswarm.search.methods import forget

EXAMPLE = Path(__file__).parents[2] / "examples" / "methods" / "near.py"
SMALL = (
    Path(__file__).parents[1] / "helpers" / "small_search.toml"
).read_text() + "\n[search]\nbudget = 90\nfinal = 30\nevaluations = 3\n"


@pytest.fixture(autouse=True)
def _own_methods() -> Iterator[None]:
    yield
    for name in ("near", "forgetful", "lavish", "blind", "early", "twice", "moving"):
        forget(name)


def test_a_file_is_a_method(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One file, named where the name of a method stands; it is kept with the search, and run from there if trusted."""
    search, out, own = tmp_path / "search.toml", str(tmp_path / "out"), f"{EXAMPLE}:near"
    search.write_text(SMALL)
    line = ["optimize", str(search), "--fresh", "20", "--no-pictures", "--out", out]
    assert "`near` over 2 fields" in output_of(capsys, *line, "--method", own)
    assert (tmp_path / "out" / "near.py").read_text() == EXAMPLE.read_text()
    forget("near")
    again = ["optimize", str(tmp_path / "out" / "search.toml"), "--no-pictures", "--out", out]
    assert "is code that is not loaded" in refusal_of(capsys, *again)
    assert main([*again, "--trust"]) == 0
