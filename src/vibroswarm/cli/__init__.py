"""The command ``vibroswarm``: one module for each command.

Exit codes: 0 success; 2 bad input; 1 failure during the work; 130 interrupted (Ctrl-C).
"""

from __future__ import annotations

import argparse
import atexit
import errno
import gc
import io
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
from vibroswarm.errors import InputError, RunError, nearest, shown_name


class _Formatter(argparse.HelpFormatter):
    """Formats help: wraps descriptions of one line, and keeps the line breaks of longer texts, such as examples."""

    def _format_action(self, action: argparse.Action) -> str:
        """Format the list of commands in groups with titles; format any other action as argparse does.

        The list of commands is the only action with an attribute ``groups``, which the function ``parser`` sets: for
        each title, the names of its commands.
        """
        groups: dict[str, tuple[str, ...]] | None = getattr(action, "groups", None)
        if groups is None:
            return super()._format_action(action)
        # argparse lists each command as an action, whose `dest` is the command's name
        commands = {sub.dest: sub for sub in action._get_subactions()}  # type: ignore[attr-defined]
        text = ""
        for title, names in groups.items():
            text += f"\n  {title}:\n"
            self._indent()
            # super() without arguments does not work inside a generator
            text += "".join(super(_Formatter, self)._format_action(commands[name]) for name in names)
            self._dedent()
        return text

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text.rstrip() if "\n" in text else super()._fill_text(text, width, indent)


class _Parser(argparse.ArgumentParser):
    """A parser whose errors suggest the nearest known word, and which raises ``InputError`` for a wrong value."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(allow_abbrev=False, formatter_class=_Formatter, **settings)
        # The parsed arguments hold the parser of the chosen command or task, whose ``error`` knows its options.
        self.set_defaults(parser=self)

    def error(self, message: str) -> NoReturn:
        """Report an error in the command line, with the nearest known word if one is similar.

        argparse passes only a finished message, so the wrong word and the known words are cut out of its text. If the
        message is about the value of an option, an ``InputError`` with the option as its field is raised, so that the
        message looks like other errors of input. For any other message, the usage is printed and the exit code is 2.
        """
        if "invalid choice: " in message and "(choose from " in message:
            word = message.split("invalid choice: ")[1].split(" (")[0].strip("'")
            choices = message.split("(choose from ")[1].rstrip(")").replace("'", "").split(", ")
            message += nearest(word, choices)
        elif message.startswith("unrecognized arguments: "):
            word = message.removeprefix("unrecognized arguments: ").split()[0].split("=")[0]
            message += nearest(word, [o for action in self._actions for o in action.option_strings])
        # Matches "argument -o/--option: text", unless the text says that a value is missing ("expected one argument")
        # or that the option may not be given ("not allowed with argument ...").
        of_value = re.fullmatch(
            r"argument (?:\S*/)?(--\S+): (?!expected|not allowed)(.*)", message, re.DOTALL
        )
        if of_value:
            option, text = of_value.groups()
            raise InputError(text, field=option)
        self.print_usage(sys.stderr)
        self.exit(2, f"{self.prog}: error: {message}\n")


def parser() -> argparse.ArgumentParser:
    """Build the parser of all commands.

    The modules of the commands are imported here. What a command needs for its work is imported only when the command
    runs, so that ``--help`` is fast. The options for user code come directly after the command's name, the options for
    printing after the name of its task, if it has tasks.
    """
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
        names[title] = tuple(commands.choices)[before:]  # the commands that this group's modules added
    vars(commands)["groups"] = names  # read by _Formatter._format_action
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
    """Yield the parsers of all commands that do work themselves, from ``parser`` downwards.

    A command such as ``calibrate`` only has tasks, which are subcommands; the parsers of its tasks are yielded.
    """
    subcommands = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    if not subcommands:
        yield parser
    for action in subcommands:
        for below in action.choices.values():
            yield from leaves(below)


PLAIN: Final = "--plain"
"""The option that runs the kernels as plain Python, without compiling them."""
_parsed: Final[list[argparse.Namespace]] = []
"""The parsed arguments of the command in progress, as the only entry; empty until they are parsed."""

GC_THRESHOLD: Final = 300_000
"""New objects between garbage collections: more than a short run makes, which collections would take a tenth longer."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line and return the exit code.

    Args:
        argv: the words after the program's name. None means the words that this process was started with; then Ctrl-C
            is handled too, and ends the process.
    Raises:
        SystemExit: after ``--help``, or for an error in the command line that ``_Parser.error`` reports itself.
    """
    if sys.stderr is None:  # closed by the caller: messages are lost, but the exit code must be right
        sys.stderr = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - open until the process ends
    if sys.stdout is None:  # closed by the caller: results would be lost
        return _failed("stdout is closed; redirect it to a file or to /dev/null", 1)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a file name may hold characters the terminal cannot show
            stream.reconfigure(errors="backslashreplace")
    if argv is None:
        interruption.listen()
    try:
        code = _command(argv)
        sys.stdout.flush()
        if argv is None:  # the process ends now: its exit need not search all that is loaded for garbage
            gc.freeze()
        return code
    except (Exception, KeyboardInterrupt) as error:
        # After Ctrl-C, any error counts as a result of the interruption: a KeyboardInterrupt that is raised while LLVM
        # calls Python is lost and leaves a kernel half compiled, and that kernel then fails with some other error.
        if not isinstance(error, KeyboardInterrupt) and not interruption.came():
            return _code_of(error)
        _failed(_resume_hint(argv), 130)
        if argv is None:  # this process runs nothing but this command, so it may be ended
            _leave_at_once(130)
        return 130


def _code_of(error: Exception) -> int:
    """Print the message of an expected error and return its exit code; any other error, a bug, is raised again.

    No message is printed if the reader of stdout closed the pipe.
    """
    if isinstance(error, InputError):
        return _failed(str(error), 2)
    if isinstance(error, RunError):
        return _failed(str(error), 1)
    if isinstance(error, MemoryError):
        return _failed("out of memory; use fewer robots, tiles or runs", 1)
    if isinstance(error, BrokenPipeError):  # the reader is, for example, `head`
        _silence_stdout()
        return 1
    if isinstance(error, OSError):
        return _failed_with(error)
    raise error


def _leave_at_once(code: int) -> NoReturn:
    """End the process without waiting for its threads.

    A thread may be compiling for up to a minute; if the interpreter were shut down meanwhile, LLVM would crash.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C must not interrupt the clean-up
    with suppress(Exception):  # the process must end, even if a part of the clean-up fails
        import multiprocessing  # here, since --help needs none of it

        for process in multiprocessing.active_children():  # worker processes, which would outlive this one
            process.kill()
        atexit._run_exitfuncs()  # removes temporary folders, ends the process of background_compile
        sys.stdout.flush()
    os._exit(code)


def _resume_hint(argv: Sequence[str] | None) -> str:
    """Return the message after Ctrl-C: what is saved and how to resume.

    The message is only "interrupted" if Ctrl-C is pressed again meanwhile, or if the folder cannot be read.
    """
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
"""Errors that a wrong file name causes, such as a missing file; others, such as a full disk, are not the user's."""


def _failed_with(error: OSError) -> int:
    """Print the message of an ``OSError`` and return the exit code: 2 for a wrong file name, 1 for any other error."""
    cause = error.strerror or str(error)
    if error.filename is not None:
        code = 2 if error.errno in USER_ERRORS else 1
        return _failed(f"{shown_name(error.filename)}: cannot be used: {cause}", code)
    # `atomic_io` names the files it writes, so an error without a name is about this process's output.
    _silence_stdout()
    return _failed(f"the output could not be written: {cause}", 1)


def _command(argv: Sequence[str] | None) -> int:
    """Parse the arguments and run the command; return the exit code.

    Tests run several commands in one process, so the state that an earlier command left is cleared first.
    """
    from vibroswarm.cli import scenario_warnings, terminal, user_settings
    from vibroswarm.cli.options import run_plain

    # --plain is looked for before parsing, which may import core.jit. Worker processes inherit the setting.
    if PLAIN in (sys.argv[1:] if argv is None else argv):
        run_plain()

    gc.set_threshold(GC_THRESHOLD)  # fewer garbage collections: a faster start
    scenario_warnings.forget()  # the warnings that an earlier command has printed
    _parsed.clear()
    top = parser()
    settings_error: InputError | None = None
    try:  # the user's settings file replaces the defaults of options
        user_settings.apply(user_settings.read(), leaves(top))
    except InputError as error:  # raised below, after --help and --version, which need no settings
        settings_error = error
    arguments, unknown = top.parse_known_args(argv)
    if unknown:
        # the parser of the command or task, which _Parser stores in the arguments
        of_command = getattr(arguments, "parser", top)
        of_command.error(f"unrecognized arguments: {' '.join(unknown)}")
    if arguments.version:
        from importlib.metadata import version

        print(f"vibroswarm {version('vibroswarm')}")
        return 0
    if arguments.command is None:
        top.print_help()
        return 0
    if settings_error is not None:
        raise settings_error
    terminal.use(arguments)  # --wide, --quiet and --verbose
    arguments.own_process = argv is None  # then nothing else runs in this process
    _parsed.append(arguments)
    with ExitStack() as stack:
        if arguments.trust:
            from vibroswarm.scenario import plugins

            stack.enter_context(plugins.trust_code())
        if terminal.printing.verbose:
            stack.enter_context(terminal.verbose())
        return int(arguments.run(arguments))


def _failed(message: str, code: int) -> int:
    """Print an error message on stderr and return ``code`` unchanged.

    With ``--verbose``, the traceback is printed before the message. Code 130 means that Ctrl-C was pressed; its message
    does not begin with "error:".
    """
    from vibroswarm.cli import terminal

    if terminal.printing.verbose and sys.exc_info()[0] is not None:
        traceback.print_exc()
    with suppress(OSError):  # stderr may be closed
        print(
            f"vibroswarm: {'error: ' if code != 130 else ''}{terminal.plain(message)}",
            file=sys.stderr,
            flush=True,
        )
    return code
