"""``vibroswarm completion``: a script that completes commands, options and names in a shell."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from vibroswarm.errors import RunError

SHELLS: Final = ("bash", "zsh", "fish")
"""Shells for which a script can be made."""
EPILOG = """\
install (once; again after an update):
  vibroswarm completion bash > ~/.local/share/bash-completion/completions/vibroswarm
  vibroswarm completion zsh > ~/.zfunc/_vibroswarm      with 'fpath+=~/.zfunc' before 'compinit' in ~/.zshrc
  vibroswarm completion fish > ~/.config/fish/completions/vibroswarm.fish
"""


def add_parser(commands: Any) -> None:
    """Add the command ``completion`` and its options to the program's commands."""
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
    """Print the script that the package shtab makes from the parser; return the exit code."""
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
    """Prepare a parser for the package shtab: set how values are completed, and shorten the commands' descriptions.

    The value of an option or positional argument is completed with names, files or folders, or not at all. shtab reads
    this from the attribute ``complete`` of the argument when it writes the script.

    Args:
        top: the parser of all commands, which is changed in place.
    """
    import shtab

    words = {option: _words(option, names) for option, names in names_by_option().items()}
    _describe_briefly(top)
    for leaf in _parsers(top):
        for action in leaf._actions:
            # the last name is the long one, as in -q, --quiet; positional arguments have none
            option = action.option_strings[-1] if action.option_strings else ""
            if option in words:
                complete = words[option]
            elif action.metavar == "DIR":
                complete = shtab.DIRECTORY
            # --out and --floor are named here because not all commands declare their values as Path
            elif action.type is Path or option in ("--out", "--floor") or action.metavar in ("FLOOR", "FILE"):
                complete = shtab.FILE
            else:
                continue
            if action.nargs != 0:  # flags take no value
                vars(action)["complete"] = complete


def _describe_briefly(parser: argparse.ArgumentParser) -> None:
    """Replace the description of each command and task by its one-line help.

    The completion script shows the description beside the command's name, where only a short text fits.
    """
    for part in parser._actions:
        if isinstance(part, argparse._SubParsersAction):
            # the help's entry of each command, whose `dest` is the command's name
            for listed in part._choices_actions:
                part.choices[listed.dest].description = listed.help
                _describe_briefly(part.choices[listed.dest])


def names_by_option() -> dict[str, Iterable[str]]:
    """Return, for each option whose value is one of some known names, such as ``--strategy``, these names."""
    import vibroswarm.simulation  # noqa: F401  (registers the engines)
    from vibroswarm.optimize.objective import NAMES
    from vibroswarm.optimize.spec import METHODS
    from vibroswarm.scenario import plugins
    from vibroswarm.scenario.presets import preset_names

    kinds = {f"--{kind}": plugins.KINDS[kind].known() for kind in ("strategy", "network", "task", "motion")}
    # `optimize --method` takes "grid" too, which is no method of a search.
    return {**kinds, "--preset": preset_names(), "--method": (*METHODS, "grid"), "--cost": NAMES}


def _parsers(parser: argparse.ArgumentParser) -> Iterable[argparse.ArgumentParser]:
    """Return the parsers of all commands and tasks that have no subcommands."""
    # Imported here, because vibroswarm.cli imports this module when it builds its parser.
    from vibroswarm.cli import leaves

    return leaves(parser)


def _words(option: str, names: Iterable[str]) -> dict[str, Any]:
    """Return how each shell completes an option that takes one of these names, in the form that shtab expects.

    zsh and fish take the list of names itself. bash takes the name of a function that prints the names that match what
    was typed; the function's code is the preamble, which shtab writes at the top of the script.
    """
    listed = " ".join(names)
    function = f"_vibroswarm_words_{option.strip('-')}"
    return {
        "bash": function,
        "zsh": f"({listed})",
        "fish": listed,
        "preamble": {"bash": f'{function}() {{\n  compgen -W "{listed}" -- "$1"\n}}'},
    }
