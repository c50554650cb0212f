"""All commands of the program, by group; a command's module is imported when the command is called."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from typing import Annotated, Any, Final, Literal, NamedTuple

from vibroswarm.cli.command_line import Option, Parser, fill, parser_of, path
from vibroswarm.cli.options import Common
from vibroswarm.errors import InputError, nearest

PROGRAM: Final = "vibroswarm"
COMMON: Final[dict[str, type]] = {"all commands": Common}
"""Groups of options that all commands have."""


class Command(NamedTuple):
    """A command, or the name that several share, such as ``lab`` of ``lab import``."""

    words: str
    does: str
    """One line for lists of commands."""
    place: str = ""
    """Module and function, such as "optimize:sensitivity"; empty if it only has tasks."""

    def function(self) -> Callable[..., Any]:
        """Import and return the function."""
        module, _, name = self.place.partition(":")
        return getattr(import_module(f"vibroswarm.cli.{module}"), name)  # type: ignore[no-any-return]

    def parser(self) -> Parser:
        """Return the parser of its options; a command with tasks lists them at the end of its help."""
        prog = f"{PROGRAM} {self.words}"
        if self.place:
            parser = parser_of(prog, self.function(), COMMON)
        else:
            parser = Parser(prog, usage=f"{prog} TASK [options]", description=self.does)
        if tasks := tasks_of(self.words):
            parser.epilog = f"{parser.epilog or ''}\n\ntasks:\n{listed(tasks)}".strip()
        return parser


GROUPS: Final[dict[str, tuple[Command, ...]]] = {
    "simulate": (
        Command("run", "run one inspection and print its verdict", "simulate:run"),
        Command(
            "inspect", "where it vibrates, how sure, and what would have been missed", "inspection:inspect"
        ),
        Command(
            "evaluate", "run a scenario or a study many times, or several side by side", "simulate:evaluate"
        ),
    ),
    "compare and search": (
        Command("league", "compare strategies on equal terms: time at equal error", "league:league"),
        Command(
            "detect", "how many robots and how much time for few misses and false alarms", "simulate:detect"
        ),
        Command("optimize", "search for good parameters", "optimize:optimize"),
        Command("optimize sensitivity", "find which fields matter (Sobol indices)", "optimize:sensitivity"),
    ),
    "the paper": (
        Command(
            "reproduce", "the paper's figures and tables, with a verdict on each claim", "reproduce:reproduce"
        ),
    ),
    "real robots": (
        Command("lab", "import recordings of real robots, replay and measure them"),
        Command(
            "lab import", "import logs of sessions into a folder that is read as a result", "lab:import_logs"
        ),
        Command("lab export", "write the tables of a result as CSV", "lab:export"),
        Command(
            "lab replay", "what each strategy would have decided on a recording's readings", "lab:replay"
        ),
        Command("lab threshold", "estimate theta_E from recordings on a known floor", "lab:threshold"),
        Command("lab spectrum", "at which frequencies a surface vibrates", "lab:spectrum"),
        Command("lab track", "track robots with ArUco markers in the video of a camera", "lab_track:track"),
        Command("calibrate", "compare a simulation with recordings, and fit it to them"),
        Command("calibrate compare", "how similar recordings and simulations are", "calibrate:compare"),
        Command("calibrate fit", "fit a scenario to recordings, and validate it", "calibrate:fit"),
    ),
    "results": (
        Command("show", "show a folder or file that a command has written", "results:show"),
        Command("verify", "simulate saved runs again: are they the same?", "results:verify"),
    ),
    "scenarios, floors, code of your own, robots": (
        Command(
            "list", "list strategies, networks, sensors, motions, tasks, presets or floors", "known:known"
        ),
        Command("scenario", "write a scenario as TOML, with every field", "scenario_options:scenario"),
        Command("floors", "show, measure and make floors"),
        Command("floors show", "draw a floor in the terminal or to a file", "floors:show"),
        Command("floors measure", "measure fill ratio, Moran index, entropy and clusters", "floors:measure"),
        Command("floors make", "make a floor of given difficulty", "floors:make"),
        Command("check", "check a strategy, network, sensor, task or motion source", "known:check"),
        Command("export", "write the robot's program as C for microcontrollers"),
        Command("export c", "C99 library with a sketch for Arduino and PlatformIO", "export:c"),
        Command("export check", "compare an exported header of parameters with a scenario", "export:check"),
        Command("completion", "print a script that completes words in a shell", "commands:completion"),
    ),
}
COMMANDS: Final = {command.words: command for group in GROUPS.values() for command in group}


def tasks_of(words: str) -> list[Command]:
    """Return the commands that begin with another command's words."""
    return [command for command in COMMANDS.values() if command.words.startswith(f"{words} ")]


def listed(commands: Iterable[Command]) -> str:
    """Return a list of commands with what they do, as wide as the terminal."""
    width = shutil.get_terminal_size().columns - 2
    lines = []
    for command in commands:
        first = f"  {command.words:<{20 if ' ' in command.words else 12}} "
        lines.append(
            textwrap.fill(command.does, width, initial_indent=first, subsequent_indent=" " * len(first))
        )
    return "\n".join(lines)


def top_parser() -> Parser:
    """Return the parser of the program's own options."""
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
    return parser


def run_top(words: Sequence[str]) -> int:
    """Print the version or the help of the program."""
    parser = top_parser()
    if parser.parse_args(words).version:
        from importlib.metadata import version

        print(f"{PROGRAM} {version(PROGRAM)}")
    else:
        parser.print_help()
    return 0


def command_in(words: Sequence[str]) -> tuple[Command, list[str]]:
    """Return the command that words begin with, and the other words."""
    for count in (2, 1):
        command = COMMANDS.get(" ".join(words[:count]))
        rest = list(words[count:])
        if command is not None and (command.place or not rest or rest[0].startswith("-")):
            return command, rest if command.place else ["--help"]
    known = [*COMMANDS, *(task.words.split()[1] for task in tasks_of(words[0]))]
    word = words[1] if tasks_of(words[0]) else words[0]
    raise InputError(f"unknown command{nearest(word, known)}; '{PROGRAM} --help' lists all", field=word)


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
