"""Write commands.md from the parser of the command line: ``python docs/make_commands.py``."""

from __future__ import annotations

import argparse
import inspect
import textwrap
from collections.abc import Iterator
from pathlib import Path

from vibroswarm import cli

TARGET = Path(__file__).with_name("commands.md")
HEAD = """\
# The command line

<!-- Made by docs/make_commands.py from the parser; a test holds it to that. -->

`vibroswarm COMMAND --help` says the same in the terminal. No option has a short form, and none may be cut short. A
folder that is there is never overwritten without `--force`; that of a study or a search is gone on with.

{codes}
"""


def reference() -> str:
    """The whole document."""
    codes = inspect.cleandoc(str(cli.__doc__)).split("\n\n", 1)[1]
    lines = [HEAD.format(codes=codes)]
    for name, description, parser in commands(cli.parser(), ()):
        title = f"{'#' * (1 + len(name))} vibroswarm {' '.join(name)}"
        lines += [title, "", sentence(description), "", *section(name, parser)]
    return "\n".join(lines).rstrip() + "\n"


def commands(
    parser: argparse.ArgumentParser, name: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], str, argparse.ArgumentParser]]:
    """Every command and task below a parser: name, description, its own parser."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            briefly = {str(a.dest): str(a.help) for a in action._choices_actions}
            for word, below in action.choices.items():
                yield (*name, word), below.description or briefly[word], below
                yield from commands(below, (*name, word))


def section(name: tuple[str, ...], parser: argparse.ArgumentParser) -> list[str]:
    """How one command is said, its options group by group, and examples; or its tasks."""
    tasks = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    if tasks:
        said = f"vibroswarm {' '.join(name)}"
        return [*(f"- `{said} {a.dest}`: {words(a.help or '')}" for a in tasks[0]._choices_actions), ""]
    required = [
        f" {a.option_strings[0]} {metavar(a)}" for a in parser._actions if a.option_strings and a.required
    ]
    positional = [f" {usage_of(a)}" for a in parser._actions if not a.option_strings]
    lines = ["```text", f"vibroswarm {' '.join(name)} [options]{''.join(required + positional)}", "```", ""]
    for group in parser._action_groups:
        actions = [a for a in group._group_actions if a.help != argparse.SUPPRESS and a.dest != "help"]
        if actions:
            title = {"options": "option", "positional arguments": "argument"}.get(
                group.title or "", group.title
            )
            lines += [f"| {title} | what it is |", "|---|---|"]
            lines += [f"| {shown(a)} | {words(a.help or '')} |" for a in actions]
            lines.append("")
    if parser.epilog:
        lines += ["```text", *textwrap.dedent(parser.epilog).strip().splitlines(), "```", ""]
    return lines


def metavar(action: argparse.Action) -> str:
    """What stands for the option's value."""
    return str(action.metavar or action.dest.upper())


def usage_of(action: argparse.Action) -> str:
    """A positional argument as the usage has it."""
    word = metavar(action)
    return {"?": f"[{word}]", "+": f"{word} [{word} ...]", "*": f"[{word} ...]"}.get(str(action.nargs), word)


def shown(action: argparse.Action) -> str:
    """An option with its value, or the name of an argument."""
    if not action.option_strings:
        return code(metavar(action))
    if action.nargs == 0:
        return code(action.option_strings[-1])
    value = f"[{metavar(action)}]" if action.nargs == "?" else metavar(action)
    return code(f"{action.option_strings[-1]} {value}")


def code(text: str) -> str:
    """Code within a table."""
    return f"`{text}`".replace("|", "\\|")


def words(text: str) -> str:
    """Help as Markdown shows it: one line, signs of percent single, nothing taken for markup."""
    text = " ".join(text.replace("%%", "%").split())
    for sign in "\\|*<>_[]":
        text = text.replace(sign, "\\" + sign)
    return text


def sentence(text: str) -> str:
    """A description as a sentence."""
    text = words(text)
    text = text[:1].upper() + text[1:]
    return text if text.endswith(".") else text + "."


if __name__ == "__main__":
    TARGET.write_text(reference(), encoding="utf-8")
