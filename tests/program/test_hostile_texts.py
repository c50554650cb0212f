"""Markup in the texts that a user gives (names of studies, cells, floors, entries, files, folders, code) stays text."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from helpers.markup import Markup
from vibroswarm.cli import main

SCRIPT, IMAGE, ENTITY = "<script>alert(1)<!--", "<img src=x onerror=alert(2)>", "&lt;b&gt;\"'`{{7*7}}</b"
TEXTS = (SCRIPT, IMAGE, ENTITY)
SHORT = ["--set", "run.t_end_s=60", "--robots", "2"]
ROWS = ["10", "01"]


def in_a_file_name(text: str) -> str:
    return text.replace("/", "|")


def check(folder: Path, plain: Path, text: str) -> None:
    """Fail if a page or picture below a folder has scripts or handlers that its twin with plain texts does not have."""
    pages = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.suffix in (".html", ".svg"))
    assert pages
    assert any(text in Markup((folder / page).read_text(encoding="utf-8")).text for page in pages), (
        "it is shown"
    )
    for page in pages:
        hostile, harmless = (Markup((root / page).read_text(encoding="utf-8")) for root in (folder, plain))
        assert hostile.tags.count("script") == harmless.tags.count("script")
        assert hostile.tags.count("img") == harmless.tags.count("img")
        assert {name for name, _ in hostile.attributes} <= {name for name, _ in harmless.attributes}


def evaluated(folder: Path, texts: Sequence[str]) -> Path:
    """The outcome of a study in whose title, file and floor all of these texts are, and whose labels are these."""
    title, out = " ".join(texts), folder / "out"
    path = folder / f"{in_a_file_name(title)}.toml"
    cells = [f'[[list]]\nlabel = {json.dumps(text)}\n"strategy.name" = "none"\n' for text in texts]
    path.write_text(
        f"name = {json.dumps(title)}\nruns = 4\n[scenario]\nrun.t_end_s = 60.0\nswarm.robots = 2\n"
        f"[floors]\n{json.dumps(title)} = {json.dumps(ROWS)}\n{''.join(cells)}"
        f'[grid]\n"floor.source" = [{json.dumps(title)}]\n',
        encoding="utf-8",
    )
    assert main(["evaluate", str(path), "--no-confirm", "-q", "--out", str(out)]) == 0
    return out


@pytest.mark.usefixtures("svg_alone")
def test_a_study(tmp_path: Path) -> None:
    (tmp_path / "hostile").mkdir()
    (tmp_path / "plain").mkdir()
    hostile = evaluated(tmp_path / "hostile", TEXTS)
    plain = evaluated(tmp_path / "plain", ["name", "another", "a third"])
    for text in TEXTS:
        check(hostile, plain, text)


@pytest.mark.parametrize("text", TEXTS)
def test_a_run_on_a_floor_from_a_file(tmp_path: Path, text: str) -> None:
    for root, name in (("hostile", in_a_file_name(text)), ("plain", "name")):
        folder = tmp_path / root / name
        folder.mkdir(parents=True)
        floor = folder / f"{name}.txt"
        floor.write_text("\n".join(ROWS), encoding="utf-8")
        assert main(["run", *SHORT, "--floor", str(floor), "-q", "--out", str(tmp_path / root / "out")]) == 0
    check(tmp_path / "hostile" / "out", tmp_path / "plain" / "out", in_a_file_name(text))


def test_the_check_sees_markup_that_is_not_escaped(tmp_path: Path) -> None:
    """Negative control."""
    for root, body in (("hostile", f"<p>{IMAGE}</p>{IMAGE.replace('<', '&lt;')}"), ("plain", "<p>name</p>")):
        (tmp_path / root).mkdir()
        (tmp_path / root / "page.html").write_text(body, encoding="utf-8")
    with pytest.raises(AssertionError):
        check(tmp_path / "hostile", tmp_path / "plain", IMAGE)
    assert re.search("onerror", (tmp_path / "hostile" / "page.html").read_text())
