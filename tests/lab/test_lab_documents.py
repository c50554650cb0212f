"""The example and the commands of docs/lab.md and docs/calibration.md."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from vibroswarm.cli import parser

ROOT = Path(__file__).parents[2]


def blocks(language: str, document: str) -> list[str]:
    text = (ROOT / "docs" / document).read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def test_the_example_runs(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    (example,) = blocks("python", "lab.md")
    monkeypatch.chdir(ROOT)
    exec(compile(example, "lab.md", "exec"), {})  # noqa: S102  (our own document)
    assert capsys.readouterr().out.startswith("right {")


def test_the_commands_are_understood() -> None:
    lines = [line.split("#")[0].strip() for line in "\n".join(blocks("sh", "lab.md")).splitlines()]
    commands = [shlex.split(line)[1:] for line in lines if line.startswith("vibroswarm ")]
    assert len(commands) >= 5
    for command in commands:
        assert parser().parse_args(command).command in ("lab", "calibrate")


def test_the_column_map_of_the_document_is_read() -> None:
    from vibroswarm.lab.mapped import USES, column_map

    (text,) = blocks("toml", "lab.md")
    found = column_map(text, "lab.md")
    assert set(found.columns) <= set(USES)
    assert found.settings == {"sample.stop_ms": 1000.0}
