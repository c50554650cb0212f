"""``vibroswarm completion``: a script that completes commands, options and names in a shell."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

from vibroswarm.cli.command_line import Option, Parser, fill
from vibroswarm.errors import RunError


def completion(
    shell: Annotated[Literal["bash", "zsh", "fish"], Option("bash, zsh or fish", "SHELL")], /
) -> None:
    """Print a script for a shell that completes commands, options, and names of strategies, networks and others.

    It starts no Python while you type. Install it once, and again after an update.

    examples:
      vibroswarm completion bash > ~/.local/share/bash-completion/completions/vibroswarm
      vibroswarm completion zsh > ~/.zfunc/_vibroswarm      with 'fpath+=~/.zfunc' before 'compinit' in ~/.zshrc
      vibroswarm completion fish > ~/.config/fish/completions/vibroswarm.fish
    """
    try:
        import shtab
    except ImportError:
        raise RunError("needs the package shtab: pip install shtab") from None
    print(shtab.complete(tree(), shell))


def tree() -> argparse.ArgumentParser:
    """Return one parser of all commands, as the package shtab reads it."""
    from vibroswarm.cli.commands import COMMANDS, COMMON, top_parser

    top = top_parser()
    parsers: dict[str, argparse.ArgumentParser] = {"": top}
    below: dict[str, Any] = {}
    for words, command in COMMANDS.items():
        parent, _, name = words.rpartition(" ")
        if parent not in below:
            below[parent] = parsers[parent].add_subparsers(metavar="COMMAND", parser_class=Parser)
        parser = parsers[words] = below[parent].add_parser(name, help=command.does)
        if command.place:
            fill(parser, command.function(), COMMON)
        parser.description = command.does
        for action in parser._actions:
            _complete(action)
    return top


def _complete(action: argparse.Action) -> None:
    """Set how the value of an option or argument is completed: with names, files or folders, or not at all.

    shtab reads this from the attribute ``complete``.
    """
    import shtab

    option: Option | None = getattr(action, "option", None)
    if option is None or action.nargs == 0:
        return
    if option.names is not None:
        vars(action)["complete"] = _words(action.dest, option.names())
    elif action.metavar == "DIR":
        vars(action)["complete"] = shtab.DIRECTORY
    elif action.type is Path or action.metavar in ("FLOOR", "FILE"):
        vars(action)["complete"] = shtab.FILE


def _words(name: str, names: Iterable[str]) -> dict[str, Any]:
    """Return how each shell completes an option that takes one of these names, in the form that shtab expects.

    zsh and fish take the list of names itself. bash takes the name of a function that prints the names that match what
    was typed; the function's code is the preamble, which shtab writes at the top of the script.
    """
    listed = " ".join(names)
    function = f"_vibroswarm_words_{name}_{len(listed)}"
    return {
        "bash": function,
        "zsh": f"({listed})",
        "fish": listed,
        "preamble": {"bash": f'{function}() {{\n  compgen -W "{listed}" -- "$1"\n}}'},
    }
