"""The command ``vibroswarm``: one module for each command.

Exit codes: 0 success; 2 bad input; 1 failure during the work; 130 interrupted (Ctrl-C).
"""

from __future__ import annotations

import atexit
import errno
import gc
import io
import os
import re
import signal
import sys
import threading
import time
import traceback
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Final, NoReturn, TextIO

from vibroswarm.cli import interruption
from vibroswarm.errors import InputError, RunError, named

INTERRUPTED: Final = 130
"""Exit code of a command that Ctrl-C ended."""
PLAIN: Final = "--plain"
"""The option that runs the kernels as plain Python, without compiling them."""

GC_THRESHOLD: Final = 700_000
"""New objects between garbage collections: more than short commands make (300,000 a run, 460,000 a small study).
A single collection at their end would take a tenth longer."""
POOLS_S: Final = 1.0
"""Time that an interrupted command waits for its pools of processes to end."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line and return the exit code.

    Args:
        argv: the words after the program's name. None means the words that this process was started with; then Ctrl-C
            is handled too, and ends the process.
    Raises:
        SystemExit: after ``--help``.
    """
    if sys.stderr is None:  # closed by the caller: messages are lost, but the exit code must be right
        sys.stderr = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - open until the process ends
    if sys.stdout is None:  # closed by the caller: results would be lost
        return _failed("stdout is closed; redirect it to a file or to /dev/null", 1)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a file name may hold characters the terminal cannot show
            stream.reconfigure(errors="backslashreplace")
    try:
        if argv is None:
            interruption.listen(_end_interrupted)
            # Threads of linear algebra would take a tenth of a short command to start. Ours is small, our workers
            # already use all cores, and its last bits would depend on the number of cores.
            os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
            # Pictures are files: the backend for windows that is set may be missing or mistyped.
            os.environ["MPLBACKEND"] = "agg"
        code = _code(argv)
        if argv is None:  # the process ends now: its exit need not search all that is loaded for garbage
            interruption.ignore()
            gc.freeze()
            try:
                sys.stderr.flush()
            except OSError:
                # What could not be written is lost. From Python 3.13 on the process would end with 120 because of it.
                _silence(sys.stderr)
        return code
    except KeyboardInterrupt:
        if argv is None:  # this process runs nothing but this command, so it may be ended
            _end_interrupted()
        return _failed(_resume_hint(), INTERRUPTED)


def _end_interrupted() -> NoReturn:
    """End the process after Ctrl-C, with what is saved and how to resume."""
    hint = _resume_hint()
    # No further Ctrl-C may interrupt the message and the clean-up. ValueError: only the main thread may ignore it.
    with suppress(KeyboardInterrupt, ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    _failed(hint, INTERRUPTED)
    _leave_at_once(INTERRUPTED)


def _code(argv: Sequence[str] | None) -> int:
    """Run a command line and return its exit code, or that of its error, whose message is printed.

    After Ctrl-C, any error counts as a result of the interruption: a KeyboardInterrupt that is raised while LLVM calls
    Python is lost and leaves a kernel half compiled, and that kernel then fails with some other error.
    """
    try:
        try:
            code = _command(argv)
        except SystemExit:  # after --help
            sys.stdout.flush()
            raise
        sys.stdout.flush()
        return code
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:
        if interruption.came():
            raise KeyboardInterrupt from error
        return _code_of(error)


def _code_of(error: BaseException) -> int:
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
        _silence(sys.stdout)
        return 1
    if isinstance(error, OSError):
        return _failed_with(error)
    # Of polars, as where the system refuses it a thread or a file.
    if type(error).__name__ == "PanicException":
        return _failed(f"polars failed: {error}; see the traceback with --verbose", 1)
    raise error


def _leave_at_once(code: int) -> NoReturn:
    """End the process without waiting for its threads.

    A thread may be compiling for up to a minute; if the interpreter were shut down meanwhile, LLVM would crash.
    """
    with suppress(Exception):  # the process must end, even if a part of the clean-up fails
        import multiprocessing  # here, since --help needs none of it

        for process in multiprocessing.active_children():  # worker processes, which would outlive this one
            process.kill()
        if "multiprocessing.synchronize" in sys.modules:
            _wait_for_pools()
        atexit._run_exitfuncs()  # removes temporary folders
        sys.stdout.flush()
    os._exit(code)


def _wait_for_pools() -> None:
    """Wait up to ``POOLS_S`` for the threads that end pools of processes.

    A semaphore whose removal is cut short would be reported on stderr by the process that tracks them.
    """
    until_s = time.monotonic() + POOLS_S
    others = set(threading.enumerate()) - {threading.current_thread(), threading.main_thread()}
    for thread in others:
        if thread.is_alive() and not thread.daemon:  # one that is only being started cannot be joined
            thread.join(max(until_s - time.monotonic(), 0.0))


def _resume_hint() -> str:
    """Say what is saved and how to resume; only "interrupted" after another Ctrl-C, or if that cannot be read."""
    try:
        return interruption.resume_hint()
    except (KeyboardInterrupt, OSError, InputError):
        return "interrupted"


def _silence(stream: TextIO) -> None:
    """Keep Python from writing the rest of a stream again when it exits."""
    with suppress(OSError, ValueError):  # a test's stream has no file descriptor
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


USER_ERRORS: Final = (
    errno.ENOENT, errno.EACCES, errno.EPERM, errno.ENOTDIR, errno.EISDIR, errno.ENAMETOOLONG, errno.ELOOP, errno.EEXIST,
)  # fmt: skip
"""Errors that a wrong file name causes, such as a missing file; others, such as a full disk, are not the user's."""
OF_POLARS: Final = re.compile(r"(.+) \(os error (\d+)\): (.+)")
"""An error of polars about a file: cause, error number and name."""


def _is_working_folder_gone() -> bool:
    try:
        Path.cwd()
    except FileNotFoundError:
        return True
    return False


def _failed_with(error: OSError) -> int:
    """Print the message of an ``OSError`` and return the exit code: 2 for a wrong file name, 1 for any other error."""
    cause, number, name = error.strerror or str(error), error.errno, error.filename
    if of_polars := OF_POLARS.fullmatch(cause):  # as of a table in a folder that was removed meanwhile
        cause, number, name = of_polars[1], int(of_polars[2]), of_polars[3]
    if name is not None:
        code = 2 if number in USER_ERRORS else 1
        return _failed(f"{name}: cannot be used: {cause}", code)
    if number == errno.ENOENT and _is_working_folder_gone():  # `os.getcwd` has no name to give
        return _failed("the working folder was removed; change to another one", 2)
    if number is None or number == errno.ENOENT:  # raised by a library, such as one that cannot be loaded
        return _failed(cause, 1)
    # `atomic_io` names the files it writes, so an error of the system without a name is about this process's output.
    _silence(sys.stdout)
    return _failed(f"the output could not be written: {cause}", 1)


def _command(argv: Sequence[str] | None) -> int:
    """Find the command, parse its options and call it; return the exit code.

    Tests run several commands in one process, so the state that an earlier command left is cleared first.
    """
    from vibroswarm.cli import commands, scenario_options, terminal
    from vibroswarm.cli.options import Printing, run_plain

    words = sys.argv[1:] if argv is None else list(argv)
    if PLAIN in words:  # before parsing, which may import core.jit; worker processes inherit the setting
        run_plain()
    gc.set_threshold(GC_THRESHOLD)  # fewer garbage collections: a faster start
    scenario_options.forget()  # the warnings that an earlier command has printed
    interruption.begin(words)
    terminal.use(Printing(), own_process=argv is None)
    first = next((number for number, word in enumerate(words) if not word.startswith("-")), len(words))
    top = commands.top_parser()
    before = top.parse_args(words[:first])
    if before.version:
        from importlib.metadata import version

        print(f"vibroswarm {version('vibroswarm')}")
        return 0
    if first == len(words):
        top.print_help()
        return 0
    command, values = commands.parsed(words[first:], words[:first])
    user_code, printing = commands.common(values)
    terminal.use(printing, own_process=argv is None)
    with ExitStack() as stack:
        if user_code.trust:
            from vibroswarm.scenario import plugins

            stack.enter_context(plugins.trust_code())
        if printing.verbose:
            stack.enter_context(terminal.verbose())
        if any(word.partition("=")[0] == "--floor" for word in words):
            stack.enter_context(named("--floor", of="floor.source"))
        stack.enter_context(terminal.own_stdout())
        return commands.call(command, values)


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
            f"vibroswarm: {'error: ' if code != INTERRUPTED else ''}{terminal.plain(message)}",
            file=sys.stderr,
            flush=True,
        )
    return code
