"""Methods of search: the contract that all pass, and one of a user's own, which is one file."""

from __future__ import annotations

import importlib.util
import multiprocessing
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from helpers.commands import output_of, refusal_of
from vibroswarm import InputError, preset
from vibroswarm.cli import main
from vibroswarm.optimize import Method, Sampler, Search, run_search
from vibroswarm.optimize.methods import Ask, forget, known, method, register
from vibroswarm.optimize.search_files import candidate_table
from vibroswarm.scenario.plugins import trust_code
from vibroswarm.testing import check_method

EXAMPLE = Path(__file__).parents[2] / "examples" / "methods" / "near.py"
SMALL = (
    Path(__file__).parents[1] / "helpers" / "small_search.toml"
).read_text() + "\n[search]\nbudget = 90\nfinal = 30\nevaluations = 3\n"
LIBRARIES = {
    "tpe": ("optuna",),
    "nsga2": ("optuna",),
    "gp": ("optuna", "torch"),
    "cmaes": ("optuna", "cmaes"),
}


@pytest.fixture(autouse=True)
def _own_methods() -> Iterator[None]:
    yield
    for name in ("near", "forgetful", "lavish", "blind", "early", "twice", "moving"):
        forget(name)


@pytest.mark.parametrize("name", sorted(known()))
def test_every_method_keeps_the_contract(name: str) -> None:
    for library in LIBRARIES.get(name, ()):
        if importlib.util.find_spec(library) is None:
            pytest.skip(f"needs {library}")
    assert [finding for finding in check_method(name) if not finding.holds and not finding.is_warning] == []


class Forgetful(Sampler):
    name = "forgetful"

    def propose(self, count: int) -> Sequence[np.ndarray]:
        return list(np.random.default_rng().random((count, self.archive.space.size)))


class Lavish(Sampler):
    name = "lavish"

    def propose(self, count: int) -> Sequence[np.ndarray]:
        return list(self.random().random((2 * count, self.archive.space.size)))


class Blind(Sampler):
    name = "blind"

    def propose(self, count: int) -> Sequence[np.ndarray]:
        return list(self.random().random((count, self.archive.space.size)))

    def best(self) -> int:
        return 0


class Early(Lavish):
    name = "early"

    def propose(self, count: int) -> Sequence[np.ndarray]:
        return super().propose(count)[:count]

    def ask(self) -> list[Ask]:
        return super().ask() if self.iteration < 1 else []


class Twice(Early):
    name = "twice"

    def ask(self) -> list[Ask]:
        return super().ask() * 2


class Moving(Early):
    name = "moving"

    def learn(self, keys: Sequence[int]) -> None:
        self.archive[keys[0]].point[:] = 0.0


@pytest.mark.parametrize(
    ("kind", "fails"),
    [
        (Early, "it requests runs until"),
        (Twice, "it requests runs until"),
        (Moving, "it ranks candidates that have runs"),
        (Forgetful, "the same results lead"),
        (Lavish, "it requests runs until"),
        (Blind, "it goes on if runs fail"),
    ],
)
def test_a_method_that_breaks_the_contract_is_told_so(kind: type[Sampler], fails: str) -> None:
    register(Method(kind.name, kind.begin))
    findings = [f.what for f in check_method(kind.name) if not f.holds and not f.is_warning]
    assert any(what.startswith(fails) for what in findings)


def test_a_worker_process_says_why_it_may_not_know_a_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """It does not run what stands below ``if __name__ == "__main__":``, where a script may register its own."""
    unknown = {"strategy.name": "mine"}
    with pytest.raises(InputError, match=r"there is no strategy 'mine' \(there are [^)]*\)$"):
        preset("paper").with_values(unknown)
    monkeypatch.setattr(multiprocessing, "parent_process", object)
    with pytest.raises(
        InputError, match=r"under 'if __name__ == .*: register it elsewhere .*, or name a file"
    ):
        preset("paper").with_values(unknown)
    with pytest.raises(InputError, match="register it elsewhere"):
        method("mine")


def test_a_file_is_a_method(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One file, named where the name of a method stands; it is kept with the search, and run from there if trusted."""
    search, out, own = tmp_path / "search.toml", str(tmp_path / "out"), f"{EXAMPLE}:near"
    search.write_text(SMALL)
    line = ["optimize", str(search), "--fresh", "20", "--no-pictures", "--out", out]
    assert main(["check", own]) == 0
    assert "`near` over 2 fields" in output_of(capsys, *line, "--method", own)
    assert (tmp_path / "out" / "near.py").read_text() == EXAMPLE.read_text()
    forget("near")
    assert main(["show", out]) == 0  # code is not needed to look at it
    again = ["optimize", str(tmp_path / "out" / "search.toml"), "--no-pictures", "--out", out]
    assert "'near.py:near' is not loaded" in refusal_of(capsys, *again)
    assert main([*again, "--trust"]) == 0


def test_a_file_names_a_method_beside_it_which_runs_if_it_is_trusted(tmp_path: Path) -> None:
    (tmp_path / "near.py").write_text(EXAMPLE.read_text())
    (tmp_path / "search.toml").write_text(SMALL.replace("[search]", '[search]\nmethod = "near.py:near"'))
    with pytest.raises(InputError, match="add --trust"):
        Search.read(tmp_path / "search.toml")
    assert "near" not in known()
    with trust_code(tmp_path):
        search = Search.read(tmp_path / "search.toml")
    assert Search.from_toml(search.to_toml()).hash == search.hash
    whole = run_search(search, tmp_path / "whole")
    (tmp_path / "whole" / "steps" / "00002.parquet").unlink()
    assert candidate_table(run_search(search, tmp_path / "whole")).equals(candidate_table(whole))
    assert {c.origin.split()[0] for c in whole.archive.candidates} >= {"near", "finalist"}


@pytest.mark.parametrize(
    ("line", "told"),
    [("1 / 0", "near.py, line 10, in propose: ZeroDivisionError"), ("return [[0.5]]", "near.propose: gives [[0.5]]"),
     ("return [[0.5, float('nan')]] * count", "return 10 points of 2 numbers")],
)  # fmt: skip
def test_errors_of_a_file_are_told_in_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], line: str, told: str
) -> None:
    (tmp_path / "search.toml").write_text(SMALL)
    text = EXAMPLE.read_text().replace('"""A method', '"""Wrong: a method')
    text = text.replace("    def propose(self, count):\n", f"    def propose(self, count):\n        {line}\n")
    (tmp_path / "near.py").write_text(text)
    own = f"{tmp_path / 'near.py'}:near"
    assert main(["optimize", str(tmp_path / "search.toml"), "--method", own]) in (1, 2)
    error = capsys.readouterr().err
    assert told in error
    assert "Traceback" not in error
