"""Scripts for shells, and the list of commands in groups."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import subprocess

import pytest

from helpers.commands import printed_by, refusal_of
from vibroswarm.cli import main
from vibroswarm.cli.commands import COMMANDS, top_parser
from vibroswarm.cli.optimize import method_names
from vibroswarm.cli.options import MOTIONS
from vibroswarm.core.registry import written_names

SHELLS = ("bash", "zsh", "fish")

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
    return [words for words in COMMANDS if " " not in words]


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
        (["evaluate", "mer"], ["merge"]),
        (["optimize", "sens"], ["sensitivity"]),
        (["evaluate", "READ"], ["README.md"]),
        (["evaluate", "merge", "--for"], ["--force"]),
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
    assert "did you mean 'fish'?" in refusal_of(capsys, "completion", "fihs")


def test_the_help_lists_each_command_once_in_a_group():
    text = top_parser().format_help()
    for name in commands():
        assert sum(line.split()[:1] == [name] for line in text.splitlines()) == 1, name
    titles = [line.strip() for line in text.splitlines() if line.endswith(":") and line != "options:"]
    assert titles[:2] == ["simulate:", "compare and search:"]


REGISTERED = """
import json
import vibroswarm.simulation
import vibroswarm.optimize.spec
from vibroswarm.scenario import plugins
from vibroswarm.scenario.presets import preset_names

kinds = {kind: list(plugins.KINDS[kind].known()) for kind in plugins.KINDS}
print(json.dumps({**kinds, "preset": preset_names(), "method": [*kinds["method"], "grid"]}))
"""


def test_names_in_help_are_those_of_the_registries():
    in_help = {
        "strategy": written_names("strategies"),
        "network": written_names("networks"),
        "task": written_names("tasks"),
        "sensor": written_names("sensors"),
        "motion": MOTIONS,
        "preset": written_names("scenario/presets", ".toml"),
        "method": method_names(),
    }
    registered = json.loads(printed_by(REGISTERED))
    assert {kind: sorted(names) for kind, names in in_help.items()} == {
        kind: sorted(names) for kind, names in registered.items()
    }
