"""Generate commands.md from the command-line parser."""

from __future__ import annotations

import argparse
import inspect
import re
import textwrap
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from vibroswarm import cli
from vibroswarm.cli.command_line import add_group, help_of
from vibroswarm.cli.commands import COMMANDS, COMMON, tasks_of
from vibroswarm.cli.options import Drawn, ScenarioOptions

TARGET = Path(__file__).with_name("commands.md")
HEAD = """\
# The command line

<!-- Made from the source by the build of the site. -->

`vibroswarm COMMAND --help` prints the same. Options cannot be abbreviated; only `-h`, `-V`, `-q` and `-v` are short.
A folder of other results is never overwritten without `--force`; studies and searches are resumed.

{codes}

All commands have these options.
"""
MANY = 3
"""An option that so many commands have with the same words is described once."""
BUNDLES = {"Scenario options": ScenarioOptions, "Output options": Drawn}
"""Groups of options that commands have as a whole."""
SHARED_HEAD = """\
## Options of many commands

Below, each command names those that it has. Where it describes one of these itself, that text holds.
"""
Row = tuple[str, str]
"""An option with its value, and what it is."""


def reference() -> str:
    """The whole document."""
    codes = inspect.cleandoc(str(cli.__doc__)).split("\n\n", 1)[1]
    lines = [HEAD.format(codes=codes)]
    for title, kind in COMMON.items():
        lines += listed(title.replace("_", " "), rows_of_group(title, kind))
    many = of_many_commands()
    lines += ["", SHARED_HEAD]
    for title, rows in bundled(many):
        lines += [f"### {title}", "", *listed("options", rows), ""]
    for command in COMMANDS.values():
        depth = 2 + command.words.count(" ")
        lines += [f"{'#' * depth} vibroswarm {command.words}", ""]
        if command.place:
            lines += section(command.parser(), many)
        else:
            tasks = tasks_of(command.words)
            lines += [
                sentence(command.does),
                "",
                *(f"- `vibroswarm {task.words}`: {words(task.does)}" for task in tasks),
                "",
            ]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).rstrip() + "\n"


def groups_of(parser: argparse.ArgumentParser) -> Iterator[tuple[str, list[Row]]]:
    """The groups of a command's own options, without those that all commands have."""
    for group in parser._action_groups:
        rows = rows_of([action for action in group._group_actions if action.dest != "help"])
        if rows and str(group.title).replace(" ", "_") not in COMMON:
            yield str(group.title), rows


def of_many_commands() -> list[Row]:
    """Options that many commands have with the same words, in the order in which commands have them."""
    parsers = [command.parser() for command in COMMANDS.values() if command.place]
    counted = Counter(row for parser in parsers for _, rows in groups_of(parser) for row in rows)
    shared: dict[str, Row] = {}
    for row, count in counted.items():
        if count >= MANY and (row[0] not in shared or count > counted[shared[row[0]]]):
            shared[row[0]] = row  # one of a name, so that a reader need not choose
    return list(shared.values())


def bundled(rows: list[Row]) -> Iterator[tuple[str, list[Row]]]:
    """Shared options by bundle, those of none last."""
    rest = rows
    for title, kind in BUNDLES.items():
        names = {name for name, _ in rows_of_group(title, kind)}
        yield title, [row for row in rest if row[0] in names]
        rest = [row for row in rest if row[0] not in names]
    yield "Other shared options", rest


def named(has: list[Row], own: list[Row], many: list[Row]) -> str:
    """Links to the bundles that a command has as a whole, besides its own, and names of its other shared options."""
    flags = {name.split()[0] for name, _ in own}
    parts = []
    for title, rows in bundled(many):
        names = [name for name, _ in rows if (name, _) in has]
        whole = title in BUNDLES and all(row in has or row[0].split()[0] in flags for row in rows)
        parts += [f"[{title.lower()}](#{title.lower().replace(' ', '-')})"] if whole else names
    return ", ".join(parts)


def section(parser: argparse.ArgumentParser, many: list[Row]) -> list[str]:
    """Description, usage, options by group and examples of one command."""
    usage = (parser.usage or parser.format_usage().removeprefix("usage: ")).strip()
    lines = [sentence(parser.description or ""), ""]
    if usage != f"{parser.prog} [options]":
        lines += ["```text", usage, "```", ""]
    has = [row for _, rows in groups_of(parser) for row in rows]
    for title, rows in groups_of(parser):
        own = [row for row in rows if row not in many]
        lines += listed(title, own) if own else []
    if shared := named(has, [row for row in has if row not in many], many):
        lines += ["", f"[Also](#options-of-many-commands): {shared}."]
    lines.append("")
    examples = (parser.epilog or "").partition("tasks:\n")[0]
    if examples:
        lines += ["```text", *textwrap.dedent(examples).strip().splitlines(), "```", ""]
    return lines


def rows_of_group(title: str, kind: type) -> list[Row]:
    """The options of a group."""
    return rows_of(add_group(argparse.ArgumentParser(), title, kind)._group_actions)


def rows_of(actions: list[argparse.Action]) -> list[Row]:
    """Options with what they are."""
    return [(shown(action), words(help_of(action))) for action in actions]


def listed(title: str, rows: list[Row]) -> list[str]:
    """Options as a list of Markdown, under the title of their group if it says more than that they are options."""
    untitled = title in ("options", "positional arguments")
    heading = [] if untitled else ["", f"{sentence(title).removesuffix('.')}:", ""]
    return [*heading, *(f"- {name}: {text}" for name, text in rows)]


def shown(action: argparse.Action) -> str:
    """An option with its value, or the name of an argument."""
    if not action.option_strings:
        return code(str(action.metavar))
    value = "" if action.nargs == 0 else f" {action.metavar}"
    return code(f"{action.option_strings[-1]}{value}")


def code(text: str) -> str:
    """Code in a text."""
    return f"`{text}`"


def words(text: str) -> str:
    """Help text as one line of Markdown, with markup escaped."""
    parts = re.split("(`[^`]*`)", " ".join(text.split()))  # every second one is code, as it stands
    return "".join(
        part if at % 2 else re.sub(r"([\\|*<>_\[\]])", r"\\\1", part) for at, part in enumerate(parts)
    )


def sentence(text: str) -> str:
    """A description as a sentence."""
    text = words(text)
    text = text[:1].upper() + text[1:]
    return text if text.endswith(".") else text + "."
