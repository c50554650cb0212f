"""The folder of a search that somebody else made or damaged: refused in words that name the file."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from helpers.commands import refusal_of
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


def put(kind: str, path: Path) -> None:
    """Put something else in the place of a file."""
    path.unlink()
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to({"loop": path.name, "device": "/dev/zero"}[kind])


@pytest.mark.parametrize("name", ["vibroswarm.json", "search.toml", "printed.json"])
@pytest.mark.parametrize("kind", ["folder", "pipe", "loop", "device"])
def test_only_plain_files_are_opened(name: str, kind: str, out: Path) -> None:
    put(kind, out / name)
    # The steps say what was found, without what was printed.
    assert main(["show", str(out)]) in ((0,) if name == "printed.json" else (1, 2))


@pytest.mark.parametrize("kind", ["folder", "pipe", "loop", "device"])
def test_what_is_no_plain_file_is_no_step(kind: str, out: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = next((out / "steps").iterdir())
    put(kind, path)
    assert main(["show", str(out)]) == 0
    assert str(path) in caplog.text
    assert again(out) == (0 if kind == "loop" else 2)
    if kind == "loop":
        assert path.is_file()
        assert not path.is_symlink()


@pytest.mark.parametrize("key", ["answer", "parts", "data"])
@pytest.mark.parametrize("value", [3, "x", {"x": [3]}, [3], True, None], ids=repr)
def test_a_damaged_result_is_said(
    key: str, value: Any, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = out / "printed.json"
    about = json.loads(path.read_text())
    about["document"] |= {key: value}
    path.write_text(json.dumps(about))
    assert main(["show", str(out)]) == 0  # the steps are there
    said = capsys.readouterr()
    assert "printed.json: is damaged" in " ".join(said.out.split())  # a warning of the document, in lines
    assert "runs" in said.out


@pytest.mark.parametrize("key", ["format", "hash", "versions"])
@pytest.mark.parametrize("value", [None, "x", [], {"x": 1}, float("inf")], ids=repr)
def test_a_head_of_wrong_types_is_refused(key: str, value: Any, out: Path) -> None:
    path = out / "vibroswarm.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: value}))
    assert again(out) == 2


def test_a_step_that_describes_the_table_of_another_is_repeated(
    out: Path, caplog: pytest.LogCaptureFixture
) -> None:
    first, second, *_ = sorted((out / "steps").glob("*.json"))
    before = first.read_bytes()
    shutil.copy(second, first)
    assert main(["show", str(out)]) == 0
    assert f"{first}: names a file elsewhere" in caplog.text
    assert again(out) == 0
    assert first.read_bytes() == before


def test_a_description_is_no_manifest_of_a_folder(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copy(next((out / "steps").glob("*.json")), out / "vibroswarm.json")
    assert "vibroswarm.json: is damaged: 'kind' is 'step'" in refusal_of(capsys, "verify", str(out))
