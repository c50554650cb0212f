"""``vibroswarm completion``: a script that completes commands, options and names in a shell."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

from vibroswarm.cli.command_line import Option, Parser, fill
from vibroswarm.cli.deliver import print_text
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
    print_text(f"{shtab.complete(tree(), shell)}\n")


def tree() -> argparse.ArgumentParser:
    """Return one parser of all commands, as the package shtab reads it."""
    from vibroswarm.cli.commands import COMMANDS, COMMON, tasks_of, top_parser

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
            _complete(action, [task.words.split()[1] for task in tasks_of(words)])
    return top


def _complete(action: argparse.Action, tasks: list[str]) -> None:
    """Set how the value of an option or argument is completed: with names, files or folders, or not at all.

    shtab reads this from the attribute ``complete``.

    Args:
        tasks: of the command; they stand in the place of its argument, a file.
    """
    import shtab

    option: Option | None = getattr(action, "option", None)
    if option is None or action.nargs == 0:
        return
    if option.names is not None:
        vars(action)["complete"] = _words(action.dest, option.names())
    elif tasks and not action.option_strings:
        vars(action)["complete"] = _files_and(tasks)
    elif action.metavar == "DIR":
        vars(action)["complete"] = shtab.DIRECTORY
    elif action.type is Path or action.metavar in ("FLOOR", "FILE"):
        vars(action)["complete"] = shtab.FILE


def _files_and(tasks: list[str]) -> dict[str, Any]:
    """Return how each shell completes an argument that is a file, or one of these tasks; see ``_words``."""
    listed = " ".join(tasks)
    function = f"_vibroswarm_files_and_{'_'.join(tasks)}"
    return {
        "bash": function,
        "zsh": f"{{_alternative 'tasks:task:({listed})' 'files:file:_files'}}".replace(":", "\\:"),
        "fish": f"{listed} (__fish_complete_path (commandline -ct))",
        "preamble": {"bash": f'{function}() {{\n  compgen -W "{listed}" -- "$1"\n  compgen -f -- "$1"\n}}'},
    }


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
