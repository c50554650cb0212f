"""The command ``vibroswarm``: one module for each command.

Exit codes: 0 success; 2 bad input; 1 failure during the work; 130 interrupted (Ctrl-C).
"""

from __future__ import annotations

import argparse
import atexit
import errno
import gc
import io
import multiprocessing
import os
import re
import signal
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Final, NoReturn

from vibroswarm.cli import interruption
from vibroswarm.errors import InputError, RunError, nearest


class _Formatter(argparse.HelpFormatter):
    """Wraps descriptions; keeps the lines of text that has several, such as examples."""

    def _format_action(self, action: argparse.Action) -> str:
        """Print commands in their groups."""
        groups: dict[str, tuple[str, ...]] | None = getattr(action, "groups", None)
        if groups is None:
            return super()._format_action(action)
        commands = {sub.dest: sub for sub in action._get_subactions()}  # type: ignore[attr-defined]
        text = ""
        for title, names in groups.items():
            text += f"\n  {title}:\n"
            self._indent()
            text += "".join(super(_Formatter, self)._format_action(commands[name]) for name in names)
            self._dedent()
        return text

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text.rstrip() if "\n" in text else super()._fill_text(text, width, indent)


class _Parser(argparse.ArgumentParser):
    """A parser whose errors suggest the nearest known word; errors of values are ``InputError``."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(allow_abbrev=False, formatter_class=_Formatter, **settings)
        self.set_defaults(parser=self)

    def error(self, message: str) -> NoReturn:
        if "invalid choice: " in message and "(choose from " in message:
            word = message.split("invalid choice: ")[1].split(" (")[0].strip("'")
            choices = message.split("(choose from ")[1].rstrip(")").replace("'", "").split(", ")
            message += nearest(word, choices)
        elif message.startswith("unrecognized arguments: "):
            word = message.removeprefix("unrecognized arguments: ").split()[0].split("=")[0]
            message += nearest(word, [o for action in self._actions for o in action.option_strings])
        of_value = re.fullmatch(
            r"argument (?:\S*/)?(--\S+): (?!expected|not allowed)(.*)", message, re.DOTALL
        )
        if of_value:
            raise InputError(of_value[2], field=of_value[1])
        self.print_usage(sys.stderr)
        self.exit(2, f"{self.prog}: error: {message}\n")


def parser() -> argparse.ArgumentParser:
    """Build the parser of all commands; what a command needs is imported when it runs."""
    from vibroswarm.cli import (
        calibrate,
        check,
        completion,
        detect,
        evaluate,
        export,
        floors,
        lab,
        league,
        merge,
        optimize,
        reproduce,
        run,
        scenario,
        show,
        sweep,
        tradeoff,
        tune,
        view,
    )
    from vibroswarm.cli.options import add_loudness, add_printing

    top = _Parser(
        prog="vibroswarm",
        description="Swarms of small robots that inspect a surface and decide together what it is like.",
        epilog="Run 'vibroswarm COMMAND --help' for more.",
    )
    top.add_argument("-V", "--version", action="store_true", help="show version and exit")
    add_loudness(top)
    commands = top.add_subparsers(title="commands", metavar="COMMAND", dest="command")
    groups = {
        "simulate": (run, evaluate, sweep, merge),
        "compare and search": (league, tune, detect, tradeoff, optimize),
        "the paper": (reproduce,),
        "real robots": (lab, calibrate),
        "results": (show, view),
        "scenarios, floors, code of your own, robots": (scenario, floors, check, export),
        "this program": (completion,),
    }
    names: dict[str, tuple[str, ...]] = {}
    for title, modules in groups.items():
        before = len(commands.choices)
        for module in modules:
            module.add_parser(commands)
        names[title] = tuple(commands.choices)[before:]
    vars(commands)["groups"] = names
    for command in commands.choices.values():
        _add_user_code(command)
    for leaf in leaves(top):
        add_printing(leaf)
    return top


def _add_user_code(command: argparse.ArgumentParser) -> None:
    """Add the options for running the user's own code."""
    own = command.add_argument_group("user code")
    own.add_argument(
        "--trust", action="store_true", help="run code named in scenario and study files (FILE.py:NAME)"
    )
    own.add_argument(PLAIN, action="store_true", help="run as plain, slow Python, for debuggers")


def leaves(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """Yield the parsers of all commands and tasks that have no tasks below them."""
    parts = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    if not parts:
        yield parser
    for part in parts:
        for below in part.choices.values():
            yield from leaves(below)


PLAIN: Final = "--plain"
_parsed: Final[list[argparse.Namespace]] = []
"""The arguments of the command in progress."""

GC_THRESHOLD: Final = 50_000
"""New objects between garbage collections; with Python's default of 700, startup takes a tenth longer."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    if sys.stderr is None:  # closed by the caller: messages are lost, the exit code is not
        sys.stderr = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - open until the process ends
    if sys.stdout is None:
        return _failed("stdout is closed; redirect it to a file or to /dev/null", 1)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a file name may hold characters the terminal cannot show
            stream.reconfigure(errors="backslashreplace")
    if argv is None:
        interruption.listen()
    try:
        code = _command(argv)
        sys.stdout.flush()
        return code
    except (Exception, KeyboardInterrupt) as error:
        # After Ctrl-C any error is its consequence: raised where LLVM calls Python, it leaves a kernel half compiled.
        if not isinstance(error, KeyboardInterrupt) and not interruption.came():
            return _code_of(error)
        _failed(_resume_hint(argv), 130)
        if argv is None:
            _leave_at_once(130)
        return 130


def _code_of(error: Exception) -> int:
    """Print the message of an expected error and return its exit code; any other error, a bug, is raised again."""
    if isinstance(error, InputError):
        return _failed(str(error), 2)
    if isinstance(error, RunError):
        return _failed(str(error), 1)
    if isinstance(error, MemoryError):
        return _failed("out of memory; use fewer robots, tiles or runs", 1)
    if isinstance(error, BrokenPipeError):  # the reader, such as `head`, has closed the pipe
        _silence_stdout()
        return 1
    if isinstance(error, OSError):
        return _failed_with(error)
    raise error


def _leave_at_once(code: int) -> NoReturn:
    """End the process without waiting for its threads.

    One of them may be compiling, for up to a minute; tearing the interpreter down under it would crash LLVM.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(Exception):
        for process in multiprocessing.active_children():
            process.kill()
        atexit._run_exitfuncs()  # removes temporary folders, ends the second process
        sys.stdout.flush()
    os._exit(code)


def _resume_hint(argv: Sequence[str] | None) -> str:
    """Return the message after Ctrl-C; just "interrupted" if Ctrl-C comes again meanwhile or there is no better one."""
    try:
        return interruption.resume_hint(
            _parsed[-1] if _parsed else None, sys.argv[1:] if argv is None else argv
        )
    except (KeyboardInterrupt, OSError, InputError):
        return "interrupted"


def _silence_stdout() -> None:
    """Keep Python from writing the rest of stdout again when it exits."""
    with suppress(OSError, ValueError):  # a test's stream has no file descriptor
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


USER_ERRORS: Final = (
    errno.ENOENT, errno.EACCES, errno.EPERM, errno.ENOTDIR, errno.EISDIR, errno.ENAMETOOLONG, errno.ELOOP, errno.EEXIST,
)  # fmt: skip
"""Errors in a given file name rather than of the machine."""


def _failed_with(error: OSError) -> int:
    """Report an ``OSError`` and return the exit code."""
    cause = error.strerror or str(error)
    if error.filename is not None:
        code = 2 if error.errno in USER_ERRORS else 1
        return _failed(f"{shown_name(error.filename)}: cannot be used: {cause}", code)
    # `atomic_io` names the files it writes, so an error without a name is about this process's output.
    _silence_stdout()
    return _failed(f"the output could not be written: {cause}", 1)


def shown_name(name: object) -> str:
    """Return a file name for a message, cut if it is longer than file systems allow."""
    text = str(name)
    return text if len(text) <= 300 else f"{text[:200]}... ({len(text)} characters)"


def _command(argv: Sequence[str] | None) -> int:
    """Parse the arguments and run the command; return the exit code."""
    if PLAIN in (sys.argv[1:] if argv is None else argv) and "vibroswarm.core.jit" not in sys.modules:
        os.environ["VIBROSWARM_PLAIN"] = "1"  # read once, before anything is compiled; workers inherit it
    from vibroswarm.cli import scenario_options, terminal, user_settings

    gc.set_threshold(GC_THRESHOLD)
    scenario_options.forget()
    _parsed.clear()
    top = parser()
    wrong: InputError | None = None
    try:
        user_settings.apply(user_settings.read(), leaves(top))
    except InputError as error:  # --help works all the same
        wrong = error
    arguments, unknown = top.parse_known_args(argv)
    if unknown:
        of_command = getattr(arguments, "parser", top)
        of_command.error(f"unrecognized arguments: {' '.join(unknown)}")
    if arguments.version:
        from importlib.metadata import version

        print(f"vibroswarm {version('vibroswarm')}")
        return 0
    if arguments.command is None:
        top.print_help()
        return 0
    if wrong is not None:
        raise wrong
    terminal.use(arguments)
    _parsed.append(arguments)
    with ExitStack() as stack:
        if arguments.trust:
            from vibroswarm.scenario import plugins

            stack.enter_context(plugins.trust_code())
        if terminal.printing.verbose:
            from vibroswarm.cli.terminal import verbose

            stack.enter_context(verbose())
        return int(arguments.run(arguments))


def _failed(message: str, code: int) -> int:
    """Print an error message on stderr, after the traceback if verbose, and return the exit code."""
    from vibroswarm.cli import terminal

    if terminal.printing.verbose and sys.exc_info()[0] is not None:
        traceback.print_exc()
    with suppress(OSError):
        print(
            f"vibroswarm: {'error: ' if code != 130 else ''}{terminal.plain(message)}",
            file=sys.stderr,
            flush=True,
        )
    return code
