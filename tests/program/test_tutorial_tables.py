"""Every command of the tutorial at 80 columns: no lost name, no cut number, in any table."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest

from helpers.table_checks import check_table, lost
from vibroswarm.cli import main, tables

TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorial.md"
COMMANDS = re.findall(
    r"^(?:\$ )?vibroswarm (.*?)(?: +#.*)?$", TUTORIAL.read_text(encoding="utf-8"), re.MULTILINE
)
FEW = {"evaluate": "--runs 4 --no-pictures", "sweep": "--runs 4 --no-pictures --no-confirm"}


def few(command: str) -> list[str]:
    """The command with few runs; the last of two equal options counts."""
    return shlex.split(f"{command} {FEW.get(command.split()[0], '')}")


@pytest.fixture
def laid_out(monkeypatch, tmp_path):
    """Tables and the lines that they became, as commands print them in an empty folder at 80 columns."""
    found = []
    real = tables.layout

    def layout(table, width):
        lines = real(table, width)
        found.append((table, width, lines))
        return lines

    monkeypatch.setattr(tables, "layout", layout)
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)
    study = re.search(
        r"^# fill.toml\n.*?^```", TUTORIAL.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )
    Path("fill.toml").write_text(study[0].removesuffix("```"), encoding="utf-8")
    return found


@pytest.mark.slow
def test_every_command(laid_out, capsys):
    assert {command.split()[0] for command in COMMANDS} == {
        "--version",
        "run",
        "scenario",
        "evaluate",
        "sweep",
    }
    for command in COMMANDS:
        before = len(laid_out)
        assert main(few(command)) == 0, command
        printed = capsys.readouterr().out
        assert command.split()[0] not in ("run", "evaluate", "sweep") or len(laid_out) > before, command
        for line in printed.splitlines():
            is_path = "/" in line or command.startswith("scenario")
            assert len(line) <= 80 or is_path, f"{command}: {line}"
    for table, width, lines in list(laid_out):
        assert width == 80
        assert lost(table, lines) == []
        check_table(table)


@pytest.mark.slow
def test_the_numbers_are_those_of_the_json(laid_out, capsys):
    command = "evaluate --strategy none,soft --runs 8 --no-pictures --no-confirm"
    assert main(shlex.split(f"{command} --json")) == 0
    cells = json.loads(capsys.readouterr().out)["cells"]
    assert main(shlex.split(f"{command} --wide")) == 0
    printed = capsys.readouterr().out
    for cell in cells:
        figure = cell["swarm_right"]
        share, low, high = (f"{100 * figure[k]:.1f}" for k in ("estimate", "low", "high"))
        assert re.search(rf"(?<!\d){share}(?!\d)", printed)
        assert f"[{low}, {high}]" in printed


def test_a_lost_name_and_a_cut_number_are_found():
    table = tables.table_of(["cell", "time, s"], [["random:0.48, soft", "773 [753, 793]"]])
    lines = tables.layout(table, 80)
    assert lost(table, lines) == []
    assert lost(table, [line[:-4] for line in lines]) == ["793"]
    assert lost(table, [line[4:] for line in lines]) == ["random:0.48, soft"]
