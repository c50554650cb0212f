"""Opening the replay page in a browser, and asking it things."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from helpers.browser import Tabs
from vibroswarm.result import Result
from vibroswarm.run_page.payload import RunRecord
from vibroswarm.run_page.write import record_of, write_page

BLANK = """(id) => {
  const canvas = document.getElementById(id);
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [canvas.width, canvas.height];
  const context = copy.getContext("2d", { willReadFrequently: true });
  context.drawImage(canvas, 0, 0);
  const seen = new Set(new Uint32Array(context.getImageData(0, 0, copy.width, copy.height).data.buffer));
  return seen.size < 3;
}"""

Open = Callable[..., Any]


@pytest.fixture(scope="module")
def page_path(record: RunRecord, tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("page") / "run.html"
    write_page(record, file)
    return file


@pytest.fixture
def open_page(tabs: Tabs, page_path: Path, tmp_path: Path) -> Iterator[Open]:
    """Opens the page of a record or result, or a file; at the end, whatever it logged or asked for fails the test."""
    number = count()

    def opened(
        hash_: str = "#t=0", file: Path = page_path, of: RunRecord | Result | None = None, **options: Any
    ) -> Any:
        if of is not None:
            file = tmp_path / f"page {next(number)}.html"
            write_page(record_of(of) if isinstance(of, Result) else of, file)
        page = tabs.open(file.as_uri() + hash_, **{"viewport": {"width": 1280, "height": 800}} | options)
        if options.get("java_script_enabled", True):
            page.evaluate("document.fonts.ready.then(() => null)")  # the page lays itself out again then
        return page

    yield opened
    assert tabs.emptied() == []


def state(page: Any) -> dict[str, Any]:
    got: dict[str, Any] = page.evaluate("vibroswarm.state()")
    return got


def settled(page: Any) -> dict[str, Any]:
    """The state after the frame that was asked for has been drawn."""
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return state(page)


def latest(record: RunRecord, robot: int, time_s: float) -> dict[str, Any]:
    table = record.motion.join(record.inference, on=["run", "robot", "sample"])
    return (
        table.filter((pl.col("robot") == robot) & (pl.col("time_s") <= time_s)).sort("sample").to_dicts()[-1]
    )
