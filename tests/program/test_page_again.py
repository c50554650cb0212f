"""The page of a study is drawn again only if something of what it shows has changed, or if it is damaged."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from helpers.study_pictures import keep_first_picture
from vibroswarm.cli import main
from vibroswarm.show import page

OPTIONS = ["--set", "run.t_end_s=60", "--set", "decision.min_observations=5", "--robots", "2",
           "--strategy", "none,soft", "--runs", "20", "--quiet"]  # fmt: skip
pytestmark = pytest.mark.slow
LONG_AGO_S = 1_000_000_000


@pytest.fixture(scope="module", autouse=True)
def few_pictures() -> Iterator[None]:
    """Pages have the first picture of a study alone: whether they are made again does not depend on their number."""
    with pytest.MonkeyPatch.context() as patch:
        keep_first_picture(patch)
        yield


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("page again") / "study"
    assert main(["evaluate", *OPTIONS, "--out", str(out)]) == 0
    return out


def is_drawn_again(out: Path, *options: str) -> bool:
    """Give the same command again, and return whether the page was written."""
    report = out / "report.html"
    os.utime(report, (LONG_AGO_S, LONG_AGO_S))
    assert main(["evaluate", *OPTIONS, "--out", str(out), *options]) == 0
    return report.stat().st_mtime != LONG_AGO_S


def test_a_page_that_shows_the_same_is_not_drawn_again(evaluated, monkeypatch):
    before = (evaluated / "report.html").read_bytes()
    monkeypatch.setattr(page, "page_html", lambda document: pytest.fail("the page was made again"))
    assert not is_drawn_again(evaluated)
    assert (evaluated / "report.html").read_bytes() == before
