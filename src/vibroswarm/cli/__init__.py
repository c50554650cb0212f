"""The command ``vibroswarm``: one file a command, one public call each.

Exit codes: 0 done; 2 bad input; 1 a failure while working; 130 Ctrl-C.
"""

from __future__ import annotations

import argparse
import errno
import gc
import io
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from vibroswarm.errors import InputError, RunError, nearest


class _Parser(argparse.ArgumentParser):
    """Says which command or option is nearest to one that there is not."""

    def error(self, message: str) -> None:  # type: ignore[override]
        if "invalid choice: " in message and "(choose from " in message:
            word = message.split("invalid choice: ")[1].split(" (")[0].strip("'")
            choices = message.split("(choose from ")[1].rstrip(")").replace("'", "").split(", ")
            message += nearest(word, choices)
        elif message.startswith("unrecognized arguments: "):
            word = message.removeprefix("unrecognized arguments: ").split()[0].split("=")[0]
            message += nearest(word, [o for action in self._actions for o in action.option_strings])
        self.print_usage(sys.stderr)
        self.exit(2, f"{self.prog}: error: {message}\n")


def parser() -> argparse.ArgumentParser:
    """The parser of all commands. What a command needs is imported when it runs."""
    from vibroswarm.cli import (
        bench,
        calibrate,
        check,
        detect,
        evaluate,
        floors,
        lab,
        merge,
        optimize,
        reproduce,
        run,
        scenario,
        show,
        sweep,
        tradeoff,
    )

    top = _Parser(
        prog="vibroswarm",
        description="Swarms of small robots that inspect a surface and decide together what it is like.",
        epilog="'vibroswarm COMMAND --help' tells more.",
        allow_abbrev=False,
    )
    top.add_argument("--version", action="store_true", help="say the version and leave")
    commands = top.add_subparsers(title="commands", metavar="COMMAND", dest="command")
    run.add_parser(commands)
    evaluate.add_parser(commands)
    sweep.add_parser(commands)
    detect.add_parser(commands)
    tradeoff.add_parser(commands)
    optimize.add_parser(commands)
    reproduce.add_parser(commands)
    merge.add_parser(commands)
    show.add_parser(commands)
    lab.add_parser(commands)
    calibrate.add_parser(commands)
    scenario.add_parser(commands)
    check.add_parser(commands)
    floors.add_parser(commands)
    bench.add_parser(commands)
    for command in commands.choices.values():
        own = command.add_argument_group("code of your own")
        own.add_argument(
            "--trust",
            action="store_true",
            help="run the code that scenario and study files name (FILE.py:NAME)",
        )
        own.add_argument(
            PLAIN,
            action="store_true",
            help="run everything as plain Python, slowly, so that it can be stepped through",
        )
    return top


PLAIN: Final = "--plain"

OBJECTS_BETWEEN: Final = 50_000
"""Python looks for dead objects after as many new ones. After 700, as else, starting takes a tenth longer."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; gives the exit code."""
    if sys.stderr is None:  # closed by whoever started this; what is said is lost, the exit code is not
        sys.stderr = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - for as long as this lives
    if sys.stdout is None:
        return _failed("stdout is closed; send it to a file or to /dev/null", 1)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a file's name may hold what the terminal cannot show
            stream.reconfigure(errors="backslashreplace")
    try:
        code = _command(argv)
        sys.stdout.flush()
        return code
    except InputError as error:
        return _failed(str(error), 2)
    except RunError as error:
        return _failed(str(error), 1)
    except MemoryError:
        return _failed("out of memory; ask for fewer robots, tiles or runs", 1)
    except KeyboardInterrupt:
        return _failed("interrupted", 130)
    except BrokenPipeError:  # the reader, such as `head`, has had enough
        _leave_stdout()
        return 1
    except OSError as error:
        return _failed_with(error)


def _leave_stdout() -> None:
    """What could not be written is not tried again when Python ends."""
    with suppress(OSError, ValueError):  # a stream of a test has no number
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


OF_THE_USER: Final = (
    errno.ENOENT, errno.EACCES, errno.EPERM, errno.ENOTDIR, errno.EISDIR, errno.ENAMETOOLONG, errno.ELOOP, errno.EEXIST,
)  # fmt: skip
"""What is wrong with a name that was given, rather than with the machine."""


def _failed_with(error: OSError) -> int:
    why = error.strerror or str(error)
    if error.filename is not None:
        code = 2 if error.errno in OF_THE_USER else 1
        return _failed(f"{shown_name(error.filename)}: cannot be used: {why}", code)
    # Files are written by `files`, which names them: what has no name is an output of this process.
    _leave_stdout()
    return _failed(f"the output could not be written: {why}", 1)


def shown_name(name: object) -> str:
    """A file's name in a message: its beginning, where it is longer than any that there can be."""
    text = str(name)
    return text if len(text) <= 300 else f"{text[:200]}... ({len(text)} characters)"


def _command(argv: Sequence[str] | None) -> int:
    if PLAIN in (sys.argv[1:] if argv is None else argv) and "vibroswarm.compiled" not in sys.modules:
        os.environ["VIBROSWARM_PLAIN"] = "1"  # read once, before anything is compiled; workers get it too
    from vibroswarm.cli import warned

    gc.set_threshold(OBJECTS_BETWEEN)
    warned.forget()
    top = parser()
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
    if not arguments.trust:
        return int(arguments.run(arguments))
    from vibroswarm import code_files

    with code_files.trusting():
        return int(arguments.run(arguments))


def _failed(message: str, code: int) -> int:
    # On one line and printable: what a file holds may stand in it.
    plain = "".join(c if c.isprintable() else " " if c.isspace() else "?" for c in message)
    with suppress(OSError):
        print(f"vibroswarm: {'error: ' if code != 130 else ''}{plain}", file=sys.stderr, flush=True)
    return code
