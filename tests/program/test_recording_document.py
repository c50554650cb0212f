"""What the example and the column map of docs/lab.md say; that its commands run is tested with the other documents."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def blocks(language: str, document: str) -> list[str]:
    text = (ROOT / "docs" / document).read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def test_the_example_runs(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    (example,) = blocks("python", "lab.md")
    monkeypatch.chdir(ROOT)
    exec(compile(example, "lab.md", "exec"), {})  # noqa: S102  (our own document)
    assert capsys.readouterr().out.startswith("right {")


def test_the_column_map_of_the_document_is_read() -> None:
    from vibroswarm.recordings.column_map import USES, column_map

    (text,) = blocks("toml", "lab.md")
    found = column_map(text, "lab.md")
    assert set(found.columns) <= set(USES)
    assert found.settings == {"sample.stop_ms": 1000.0}
