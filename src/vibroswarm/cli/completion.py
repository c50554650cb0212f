"""``vibroswarm completion``: a script that completes commands, options and names in a shell."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from vibroswarm.errors import RunError

SHELLS: Final = ("bash", "zsh", "fish")
EPILOG = """\
install (once; again after an update):
  vibroswarm completion bash > ~/.local/share/bash-completion/completions/vibroswarm
  vibroswarm completion zsh > ~/.zfunc/_vibroswarm      with 'fpath+=~/.zfunc' before 'compinit' in ~/.zshrc
  vibroswarm completion fish > ~/.config/fish/completions/vibroswarm.fish
"""


def add_parser(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "completion",
        help="print a script that completes commands and options in bash, zsh or fish",
        description="Print a script for a shell that completes commands, options, and names of strategies, networks, "
        "presets and others. It starts no Python while you type.",
        epilog=EPILOG,
    )
    parser.add_argument("shell", metavar="SHELL", choices=SHELLS, help="bash, zsh or fish")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print the script."""
    try:
        import shtab
    except ImportError:
        raise RunError("needs the package shtab: pip install shtab") from None
    from vibroswarm.cli import parser

    top = parser()
    add_completions(top)
    print(shtab.complete(top, arguments.shell))
    return 0


def add_completions(top: argparse.ArgumentParser) -> None:
    """Tell the writer of scripts what each option takes: names, files or folders."""
    import shtab

    words = {option: _words(option, names) for option, names in names_by_option().items()}
    _describe_briefly(top)
    for leaf in _parsers(top):
        for action in leaf._actions:
            option = action.option_strings[-1] if action.option_strings else ""
            if option in words:
                complete = words[option]
            elif action.metavar == "DIR":
                complete = shtab.DIRECTORY
            elif action.type is Path or option in ("--out", "--floor") or action.metavar in ("FLOOR", "FILE"):
                complete = shtab.FILE
            else:
                continue
            if action.nargs != 0:
                vars(action)["complete"] = complete


def _describe_briefly(parser: argparse.ArgumentParser) -> None:
    """Describe commands by their line in the list of commands, which shells show beside them."""
    for part in parser._actions:
        if isinstance(part, argparse._SubParsersAction):
            for listed in part._choices_actions:
                part.choices[listed.dest].description = listed.help
                _describe_briefly(part.choices[listed.dest])


def names_by_option() -> dict[str, Iterable[str]]:
    """Return the names that each option takes, by option."""
    import vibroswarm.simulation  # noqa: F401  (registers the engines)
    from vibroswarm.optimize.objective import NAMES
    from vibroswarm.optimize.spec import METHODS
    from vibroswarm.scenario import plugins
    from vibroswarm.scenario.presets import preset_names

    kinds = {f"--{kind}": plugins.KINDS[kind].known() for kind in ("strategy", "network", "task", "motion")}
    return {**kinds, "--preset": preset_names(), "--method": (*METHODS, "grid"), "--cost": NAMES}


def _parsers(parser: argparse.ArgumentParser) -> Iterable[argparse.ArgumentParser]:
    from vibroswarm.cli import leaves

    return leaves(parser)


def _words(option: str, names: Iterable[str]) -> dict[str, Any]:
    """Return how each shell completes an option that takes one of these names, in the form that the writer expects."""
    listed = " ".join(names)
    function = f"_vibroswarm_words_{option.strip('-')}"
    return {
        "bash": function,
        "zsh": f"({listed})",
        "fish": listed,
        "preamble": {"bash": f'{function}() {{\n  compgen -W "{listed}" -- "$1"\n}}'},
    }
