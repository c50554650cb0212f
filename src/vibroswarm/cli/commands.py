"""All commands of the program, by group: their words, what they do, and the function that does it.

A command's module is imported when the command is called, and only then.
"""

from __future__ import annotations

import argparse
import shutil
import textwrap
from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from typing import Any, Final, NamedTuple

from vibroswarm.cli.command_line import Parser, bound, group_of, parser_of
from vibroswarm.cli.options import Printing, UserCode
from vibroswarm.cli.put_off import put_off
from vibroswarm.cli.terminal import LEAST
from vibroswarm.errors import InputError, nearest

PROGRAM: Final = "vibroswarm"
COMMON: Final[dict[str, type]] = {"user_code": UserCode, "printing": Printing}
"""Groups of options that all commands have."""


class Command(NamedTuple):
    """A command, or the name that several share, such as ``lab`` of ``lab import``."""

    words: str
    does: str
    """One line for lists of commands."""
    place: str
    """Module and function, such as "league:tune"; empty if it only has tasks."""

    def function(self) -> Callable[..., Any]:
        """Import and return the function."""
        module, _, name = self.place.partition(":")
        return getattr(import_module(f"vibroswarm.cli.{module}"), name)  # type: ignore[no-any-return]

    def parser(self) -> Parser:
        """Return the parser of its options; a command with tasks lists them at the end of its help."""
        parser = parser_of(f"{PROGRAM} {self.words}", self.function(), COMMON)
        if tasks := tasks_of(self.words):
            parser.epilog = "\n\n".join(filter(None, (parser.epilog, f"tasks:\n{listed(tasks)}")))
        return parser


GROUPS: Final[dict[str, tuple[Command, ...]]] = {
    "simulate": (
        Command("run", "run one inspection and print its verdict", "run:run"),
        Command(
            "inspect", "where it vibrates, how sure, and what would have been missed", "inspection:inspect"
        ),
        Command(
            "evaluate", "run a scenario or a study many times, or several side by side", "evaluate:evaluate"
        ),
    ),
    "compare and search": (
        Command(
            "league",
            "compare strategies on equal terms: time at equal error, error at equal time",
            "league:league",
        ),
        Command("league tune", "find settings for the strategies: time against error", "league:tune"),
        Command(
            "detect", "how many robots and how much time for few misses and false alarms", "detect:detect"
        ),
        Command("optimize", "search for good parameters", "optimize:optimize"),
        Command("optimize sensitivity", "find which fields matter (Sobol indices)", "optimize:sensitivity"),
    ),
    "the paper": (
        Command(
            "reproduce",
            "recompute the paper's figures and tables, with a verdict on each claim",
            "reproduce:reproduce",
        ),
    ),
    "real robots": (
        Command("lab", "import recordings of real robots, replay and measure them", ""),
        Command(
            "lab import", "import logs of sessions into a folder that is read as a result", "lab:import_logs"
        ),
        Command("lab export", "write the tables of a result as CSV", "lab:export"),
        Command(
            "lab replay", "what each strategy would have decided on a recording's readings", "lab:replay"
        ),
        Command("lab threshold", "estimate theta_E from recordings on a known floor", "lab:threshold"),
        Command(
            "lab spectrum",
            "at which frequencies a surface vibrates, from recorded acceleration",
            "lab:spectrum",
        ),
        Command("lab track", "track robots with ArUco markers in the video of a camera", "lab_track:track"),
        Command("calibrate", "compare a simulation with recordings, and fit it to them", ""),
        Command("calibrate compare", "how similar recordings and simulations are", "calibrate:compare"),
        Command("calibrate figures", "how robots drive, avoid, spread and read", "calibrate:figures"),
        Command("calibrate fit", "fit a scenario to recordings, and validate it", "calibrate:fit"),
        Command("calibrate bursts", "whether robots lose messages in bursts", "calibrate:bursts"),
    ),
    "results": (
        Command("show", "show state and results of a folder or file that a command has written", "show:show"),
        Command("verify", "simulate saved runs again: are they the same?", "verify:verify"),
    ),
    "names": (
        Command("strategies", "list strategies, with one line each", "known:strategies"),
        Command("networks", "list networks", "known:networks"),
        Command("sensors", "list sensors", "known:sensors"),
        Command("motions", "list sources of motion", "known:motions"),
        Command("tasks", "list tasks", "known:tasks"),
        Command("presets", "list presets", "known:presets"),
    ),
    "scenarios, floors, code of your own, robots": (
        Command("scenario", "write a scenario as TOML, with every field", "scenario:scenario"),
        Command("floors", "list, show, measure and make floors", ""),
        Command("floors list", "list known patterns and their difficulty", "floors:list_patterns"),
        Command("floors show", "draw a floor in the terminal or to a file", "floors:show"),
        Command("floors measure", "measure fill ratio, Moran index, entropy and clusters", "floors:measure"),
        Command("floors make", "make a floor of given difficulty", "floors:make"),
        Command(
            "check", "check a strategy, network, sensor, task, motion source or search method", "check:check"
        ),
        Command("export", "write the robot's program as C for microcontrollers", ""),
        Command("export c", "C99 library with a sketch for Arduino and PlatformIO", "export:c"),
        Command("export check", "compare an exported header of parameters with a scenario", "export:check"),
    ),
    "this program": (
        Command(
            "completion", "print a script that completes words in bash, zsh or fish", "completion:completion"
        ),
    ),
}
RENAMED: Final = {
    "sweep": "evaluate STUDY.toml",
    "tune": "league tune",
}
"""Older words of commands, and the words in their place."""
RENAMED_OPTIONS: Final = {
    ("optimize", "--sensitivity"): "vibroswarm optimize sensitivity",
}
"""Older options of a command, and what is in their place."""
COMMANDS: Final = {command.words: command for group in GROUPS.values() for command in group}


def tasks_of(words: str) -> list[Command]:
    """Return the commands that begin with another command's words."""
    return [command for command in COMMANDS.values() if command.words.startswith(f"{words} ")]


def listed(commands: Iterable[Command], indent: str = "  ") -> str:
    """Return a list of commands with what they do, as wide as the terminal."""
    width = max(shutil.get_terminal_size().columns, LEAST) - 2
    lines = []
    for command in commands:
        first = f"{indent}{command.words:<{20 if ' ' in command.words else 12}} "
        lines += textwrap.wrap(command.does, width, initial_indent=first, subsequent_indent=" " * len(first))
    return "\n".join(lines)


def top_parser() -> Parser:
    """Return the parser of the program's own options, which stand before the command."""
    texts = [
        f"{title}:\n{listed(command for command in group if ' ' not in command.words)}"
        for title, group in GROUPS.items()
    ]
    parser = Parser(
        PROGRAM,
        usage=f"{PROGRAM} COMMAND [options]",
        description="Swarms of small robots that inspect a surface and decide together what it is like.",
        epilog="\n\n".join([*texts, f"Run '{PROGRAM} COMMAND --help' for more."]),
    )
    parser.add_argument("-V", "--version", action="store_true", help="show version and exit")
    parser.add_argument("-q", "--quiet", action="store_true", help="as after a command")
    parser.add_argument("-v", "--verbose", action="store_true", help="as after a command")
    return parser


def task_parser(command: Command) -> Parser:
    """Return the parser of a command that only has tasks, for its help."""
    return Parser(
        f"{PROGRAM} {command.words}",
        usage=f"{PROGRAM} {command.words} TASK [options]",
        description=f"{command.does[:1].upper()}{command.does[1:]}.",
        epilog=f"tasks:\n{listed(tasks_of(command.words))}",
    )


def found(words: Sequence[str]) -> tuple[Command, list[str]]:
    """Return the command that words begin with, and the other words.

    Raises:
        InputError: there is no such command; a similar one is suggested.
    """
    for count in (2, 1):
        command = COMMANDS.get(" ".join(words[:count])) if len(words) >= count else None
        if command is not None:
            break
    else:
        if words[0] in RENAMED:
            raise InputError(f"'{PROGRAM} {words[0]}' is now '{PROGRAM} {RENAMED[words[0]]}'")
        known = [name for name in COMMANDS if " " not in name]
        raise InputError(
            f"unknown command{nearest(words[0], known)}; '{PROGRAM} --help' lists all", field=words[0]
        )
    rest = list(words[count:])
    if not command.place and rest and not rest[0].startswith("-"):
        known = [task.words.split()[1] for task in tasks_of(command.words)]
        raise InputError(
            f"unknown task of '{command.words}'{nearest(rest[0], known)} (tasks: {', '.join(known)})",
            field=rest[0],
        )
    return command, rest


def parsed(words: Sequence[str], before: Sequence[str] = ()) -> tuple[Command, argparse.Namespace]:
    """Return the command of a command line, and the values of its options by name.

    Args:
        before: options that stood before the command's name.
    Raises:
        InputError: there is no such command or option, or a value is wrong.
        SystemExit: help was requested, and printed.
    """
    command, rest = found(words)
    for word in rest:
        option = word.partition("=")[0]
        new = RENAMED_OPTIONS.get((command.words, option))
        if new is not None:
            raise InputError(f"'{command.words} {option}' is now '{new}'")
    if command.place:
        return command, command.parser().parse_args([*before, *rest])
    task_parser(command).parse_args([*rest, "--help"])
    raise AssertionError("help has ended the program")


def call(command: Command, values: argparse.Namespace) -> int:
    """Call a command with its parsed options; return the exit code."""
    put_off("numpy", "f2py")
    call = bound(command.function(), vars(values))
    return int(command.function()(*call.args, **call.kwargs) or 0)


def common(values: argparse.Namespace) -> tuple[UserCode, Printing]:
    """Return the groups of options that all commands have."""
    return group_of(UserCode, vars(values)), group_of(Printing, vars(values))
