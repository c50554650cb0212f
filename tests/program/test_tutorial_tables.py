"""Every command of the tutorial at 80 columns: no lost name, no cut number, in any table."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest

from vibroswarm.cli import main
from vibroswarm.show import terminal

TUTORIAL = Path(__file__).parents[2] / "docs" / "tutorial.md"
COMMANDS = re.findall(
    r"^(?:\$ )?vibroswarm (.*?)(?: +#.*)?$", TUTORIAL.read_text(encoding="utf-8"), re.MULTILINE
)
FEW = {"evaluate": "--runs 4 --no-pictures"}


def few(command: str) -> list[str]:
    """The command with few runs; the last of two equal options counts."""
    return shlex.split(f"{command} {FEW.get(command.split()[0], '')}")


@pytest.fixture
def laid_out(monkeypatch, tmp_path):
    """Tables that commands print in an empty folder at 80 columns, before they are laid out."""
    found = []
    real = terminal.layouts

    def layouts(grid, width):
        assert width == 80
        found.append(grid)
        return real(grid, width)

    monkeypatch.setattr(terminal, "layouts", layouts)
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(tmp_path)
    study = re.search(
        r"^# fill.toml\n.*?^```", TUTORIAL.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )
    Path("fill.toml").write_text(study[0].removesuffix("```"), encoding="utf-8")
    return found


def lost(grid: terminal.Grid, printed: str) -> set[str]:
    """Words of a table that are not printed."""
    words = {word for row in grid.rows for text, _ in row for word in text.replace("\u00a0", " ").split()}
    return words - set(printed.split())


@pytest.mark.slow
def test_every_command(laid_out, capsys):
    assert {command.split()[0] for command in COMMANDS} == {
        "--version",
        "run",
        "scenario",
        "evaluate",
    }
    for command in COMMANDS:
        before = len(laid_out)
        assert main(few(command)) == 0, command
        printed = capsys.readouterr().out
        assert command.split()[0] not in ("run", "evaluate") or len(laid_out) > before, command
        for line in printed.splitlines():
            is_path = "/" in line or command.startswith("scenario")
            assert len(line) <= 80 or is_path, f"{command}: {line}"
        for grid in laid_out[before:]:
            assert lost(grid, printed) == set()


@pytest.mark.slow
def test_the_numbers_are_those_of_the_json(laid_out, capsys):
    command = "evaluate --strategy none,soft --runs 8 --no-pictures --no-confirm"
    assert main(shlex.split(f"{command} --json")) == 0
    summary = json.loads(capsys.readouterr().out)["tables"]["summary"]
    assert main(shlex.split(f"{command} --wide")) == 0
    printed = capsys.readouterr().out
    for cell in summary:
        share, low, high = (f"{100 * cell[f'swarm_right{end}']:.1f}" for end in ("", "_low", "_high"))
        assert re.search(rf"(?<!\d){share}(?!\d)", printed)
        assert f"[{low}, {high}]" in printed


def test_a_lost_name_and_a_cut_number_are_found():
    grid = terminal.Grid(
        ["cell", "time, s"], [[("random:0.48, soft", ""), ("773 [753, 793]", "")]], 1, [False, True]
    )
    assert lost(grid, "random:0.48, soft  773 [753, 793]") == set()
    assert lost(grid, "random:0.48, soft  773 [753,") == {"793]"}
    assert lost(grid, "om:0.48, soft  773 [753, 793]") == {"random:0.48,"}
