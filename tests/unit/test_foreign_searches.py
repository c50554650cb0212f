"""The folder of a search that somebody else made or damaged: refused in words that name file and line."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from vibroswarm.cli import main

SEARCH = Path(__file__).parents[1] / "helpers" / "small_search.toml"
MORE = '\n[search]\nmethod = "random"\nbudget = 12\nevaluations = 3\nfinal = 3\nfresh = 4\n'


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("search")
    (folder / "search.toml").write_text(SEARCH.read_text() + MORE)
    assert main(["optimize", str(folder / "search.toml"), "--out", str(folder / "out"), "--no-pictures"]) == 0
    return folder


@pytest.fixture
def out(made: Path, tmp_path: Path) -> Path:
    shutil.copy(made / "search.toml", tmp_path)
    return Path(shutil.copytree(made / "out", tmp_path / "out"))


def again(out: Path) -> int:
    line = ["optimize", str(out.parent / "search.toml"), "--out", str(out), "--no-pictures"]
    return main(line)


def test_what_was_not_touched_is_shown_and_gone_on_with(out: Path) -> None:
    """Control of all below."""
    assert main(["show", str(out)]) == 0
    assert again(out) == 0


def line_changed(out: Path, change: Callable[[dict[str, Any]], None]) -> None:
    path = out / "journal.jsonl"
    first, *rest = path.read_text().splitlines()
    step = json.loads(first)
    change(step)
    path.write_text("\n".join([json.dumps(step), *rest]) + "\n")


LINES: dict[str, Callable[[dict[str, Any]], None]] = {
    "no asks": lambda s: s.pop("asks"),
    "asks of text": lambda s: s.update(asks="x"),
    "an ask of no runs": lambda s: s["asks"][0].__setitem__(1, 0),
    "an ask of a fraction": lambda s: s["asks"][0].__setitem__(1, 1.5),
    "a huge ask": lambda s: s["asks"][0].__setitem__(1, 10**30),
    "fewer pieces": lambda s: s["found"].pop(),
    "fewer runs": lambda s: s["found"][0][0].pop(),
    "a piece of nothing": lambda s: s["found"][0].__setitem__(0, []),
    "a number alone": lambda s: s["found"][0].__setitem__(0, 5),
    "no number": lambda s: s["found"][0][0][0][0].__setitem__(0, None),
    "not finite": lambda s: s["found"][0][0][0][0].__setitem__(0, float("nan")),
    "another width": lambda s: [run[0].append(1.0) for run in s["found"][0][0]],
    "a failure without runs": lambda s: s["found"][0].__setitem__(0, ["why"]),
}


@pytest.mark.parametrize("harm", LINES)
def test_a_damaged_line_of_the_journal_is_named(
    harm: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line_changed(out, LINES[harm])
    for read in (lambda: main(["show", str(out)]), lambda: again(out)):
        assert read() == 2
        assert "journal.jsonl: line 1 is damaged" in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize("name", ["journal.jsonl", "search.json", "search.toml", "printed.json"])
@pytest.mark.parametrize("kind", ["folder", "pipe", "loop", "device"])
def test_only_plain_files_are_opened(name: str, kind: str, out: Path) -> None:
    path = out / name
    path.unlink()
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to({"loop": name, "device": "/dev/zero"}[kind])
    assert main(["show", str(out)]) in (1, 2)


@pytest.mark.parametrize("key", ["answer", "parts", "data"])
@pytest.mark.parametrize("value", [3, "x", {"x": [3]}, [3], True, None], ids=repr)
def test_a_damaged_result_is_said(
    key: str, value: Any, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = out / "printed.json"
    about = json.loads(path.read_text())
    about["document"] |= {key: value}
    path.write_text(json.dumps(about))
    assert main(["show", str(out)]) == 2
    assert "printed.json: is damaged" in capsys.readouterr().err


@pytest.mark.parametrize("key", ["format", "hash", "versions"])
@pytest.mark.parametrize("value", [None, "x", [], {"x": 1}, float("inf")], ids=repr)
def test_a_head_of_wrong_types_is_refused(key: str, value: Any, out: Path) -> None:
    path = out / "search.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: value}))
    assert again(out) == 2
