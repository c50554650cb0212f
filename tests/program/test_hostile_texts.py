"""Markup in the texts that a user gives stays text, and what a terminal would act on is not printed.

Texts are names of studies, cells, floors, entries, files, folders, logs, code and its reports, units, answers, numbers.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from helpers.markup import Markup
from vibroswarm.cli import main
from vibroswarm.documents import study

SCRIPT, IMAGE, ENTITY = "<script>alert(1)<!--", "<img src=x onerror=alert(2)>", "&lt;b&gt;\"'`{{7*7}}</b"
TEXTS = (SCRIPT, IMAGE, ENTITY)
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
    check_alike(folder, plain, pages)


def check_alike(folder: Path, plain: Path, pages: Sequence[Path]) -> None:
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
    assert main(["evaluate", str(path), "-q", "--out", str(out)]) == 0
    return out


DRAWN = (
    "outcomes",
    "decision_time_s",
    "incidence-robots",
    "consensus-box",
    "belief",
    "compared-decision-time-s",
)


@pytest.fixture
def drawn_alike_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the pictures of a study that the same code draws, with other numbers, a report has one."""
    for name in ("outcome_figures", "time_figures", "comparison_figures"):
        whole = getattr(study, name)
        some = lambda outcome, whole=whole: [one for one in whole(outcome) if one.name in DRAWN]  # noqa: E731
        monkeypatch.setattr(study, name, some)


@pytest.mark.usefixtures("svg_alone", "without_layout", "drawn_alike_once")
def test_a_study(tmp_path: Path) -> None:
    (tmp_path / "hostile").mkdir()
    (tmp_path / "plain").mkdir()
    hostile = evaluated(tmp_path / "hostile", TEXTS)
    plain = evaluated(tmp_path / "plain", ["name", "another", "a third"])
    for text in TEXTS:
        check(hostile, plain, text)


def test_the_check_sees_markup_that_is_not_escaped(tmp_path: Path) -> None:
    """Negative control."""
    for root, body in (("hostile", f"<p>{IMAGE}</p>{IMAGE.replace('<', '&lt;')}"), ("plain", "<p>name</p>")):
        (tmp_path / root).mkdir()
        (tmp_path / root / "page.html").write_text(body, encoding="utf-8")
    with pytest.raises(AssertionError):
        check(tmp_path / "hostile", tmp_path / "plain", IMAGE)
    assert re.search("onerror", (tmp_path / "hostile" / "page.html").read_text())
