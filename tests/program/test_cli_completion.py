"""Scripts for shells, and the list of commands in groups."""

from __future__ import annotations

import argparse
import contextlib
import io
import shutil
import subprocess

import pytest

from vibroswarm.cli import main, parser
from vibroswarm.cli.completion import SHELLS

BASH = """
source "$1"
shift
COMP_WORDS=("$@")
COMP_CWORD=$(($# - 1))
_shtab_vibroswarm
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture(scope="module")
def scripts(tmp_path_factory):
    """The script of each shell."""
    found = {}
    for shell in SHELLS:
        with contextlib.redirect_stdout(io.StringIO()) as made:
            assert main(["completion", shell]) == 0
        found[shell] = tmp_path_factory.mktemp("scripts") / f"vibroswarm.{shell}"
        found[shell].write_text(made.getvalue())
    return found


def commands() -> list[str]:
    (found,) = (a for a in parser()._actions if isinstance(a, argparse._SubParsersAction))
    return list(found.choices)


def test_every_script_has_all_commands_and_options(scripts):
    for path in scripts.values():
        text = path.read_text()
        for word in (*commands(), "paper-empirical", "soft", "bursts", "fixed-step", "nsga2", "column"):
            assert word in text, (path.name, word)


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash on this machine")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["ev"], ["evaluate"]),
        (["run", "--strategy", "so"], ["soft"]),
        (["lab", "re"], ["replay"]),
        (["run", "--pre"], ["--preset"]),
        (["evaluate", "--network", "loss_"], ["loss_by_size"]),
        (["evaluate", "--style", "sl"], ["slide"]),
        (["completion", "f"], ["fish"]),
        (["run", "--nothing"], [""]),
    ],
)
def test_bash_completes(scripts, words, expected):
    done = subprocess.run(
        ["bash", "-c", BASH, "bash", scripts["bash"], "vibroswarm", *words], capture_output=True, text=True
    )
    assert done.stderr == ""
    assert done.stdout.splitlines() == expected


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_understand_their_script(scripts, shell):
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f"no {shell} on this machine")
    assert subprocess.run([program, "-n", scripts[shell]], check=False).returncode == 0


def test_another_shell_is_refused(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["completion", "fihs"])
    assert "did you mean 'fish'?" in capsys.readouterr().err


def test_the_help_lists_each_command_once_in_a_group():
    text = parser().format_help()
    for name in commands():
        assert sum(line.split()[:1] == [name] for line in text.splitlines()) == 1, name
    titles = [line.strip() for line in text.splitlines() if line.startswith("  ") and line.endswith(":")]
    assert titles[:2] == ["simulate:", "compare and search:"]


def test_several_strategies_for_one_run_suggest_evaluate(capsys):
    assert main(["run", "--strategy", "none,soft"]) == 2
    assert "vibroswarm evaluate --strategy none,soft" in capsys.readouterr().err
    assert main(["run", "--strategy", "none,sofd"]) == 2
    assert "unknown strategy" in capsys.readouterr().err
