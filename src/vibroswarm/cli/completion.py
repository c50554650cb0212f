"""``vibroswarm completion``: a script that completes commands and options in a shell."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from vibroswarm.cli.command_line import Option, Parser, fill
from vibroswarm.cli.option_values import path


def completion(
    shell: Annotated[Literal["bash", "zsh", "fish"], Option("bash, zsh or fish", "SHELL")], /
) -> None:
    """Print a script for a shell that completes commands, options and files. Install it again after an update.

    It needs the package shtab (pip install shtab).

    examples:
      vibroswarm completion bash > ~/.local/share/bash-completion/completions/vibroswarm
      vibroswarm completion zsh > ~/.zfunc/_vibroswarm      with 'fpath+=~/.zfunc' before 'compinit' in ~/.zshrc
      vibroswarm completion fish > ~/.config/fish/completions/vibroswarm.fish
    """
    import shtab

    from vibroswarm.cli.commands import COMMANDS, COMMON, tasks_of, top_parser

    top = top_parser()
    below: dict[str, Any] = {"": top.add_subparsers(metavar="COMMAND", parser_class=Parser)}
    for words, command in COMMANDS.items():
        parent, _, name = words.rpartition(" ")
        parser = below[parent].add_parser(name, help=command.does)
        if command.place:
            fill(parser, command.function(), COMMON)
        if tasks_of(words):
            below[words] = parser.add_subparsers(metavar="TASK", parser_class=Parser)
        for action in parser._actions:
            if action.type is path:
                vars(action)["complete"] = shtab.FILE
    print(shtab.complete(top, shell))
