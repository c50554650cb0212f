"""Ctrl-C: it always ends the command; a message says what is saved and how to resume."""

from __future__ import annotations

import _thread
import os
import shlex
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Final

from vibroswarm.errors import InputError

AGAIN_AFTER_S: Final = 0.05
"""Time after which a lost Ctrl-C is repeated."""
STUCK_AFTER_S: Final = 2.0
"""Time after which a Ctrl-C that the main thread has not seen, because it runs compiled code, ends the process."""
_came = threading.Event()
"""Set when Ctrl-C was pressed since ``listen`` was called."""


def came() -> bool:
    """Return whether Ctrl-C was pressed since ``listen`` was called."""
    return _came.is_set()


def listen(end: Callable[[], object]) -> None:
    """Record from now on whether Ctrl-C is pressed in this process (``came``), and repeat a Ctrl-C that is lost.

    Args:
        end: ends the process; called in another thread if the main thread does not see Ctrl-C within ``STUCK_AFTER_S``,
            as in a user's function that never returns.

    If the process ignores Ctrl-C, or the program that imports this package handles it, nothing is recorded or repeated.

    A Ctrl-C is lost while a kernel is compiled: LLVM then calls Python functions and cannot pass on their exceptions,
    so Python only prints the ``KeyboardInterrupt`` (``sys.unraisablehook``) and continues. The hook that is installed
    here does not print it, but sends Ctrl-C to the main thread again a moment later. This is repeated until the
    exception is raised outside LLVM. Nor is it raised below a call of polars, which calls Python functions as well and
    would print it as a panic of its own: it is repeated until that call has returned.
    """
    _came.clear()
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        # Ctrl-C is ignored, as under nohup, or handled by the program that imports this package; or an earlier call has
        # installed ``interrupt``, which continues to record.
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        if _is_in_polars(frame):
            repeat_soon()
            return
        _came.set()
        raise KeyboardInterrupt

    def repeat_soon() -> None:
        timer = threading.Timer(AGAIN_AFTER_S, _again)
        timer.daemon = True
        timer.start()

    usual_hook = sys.unraisablehook

    def repeat_if_interrupt(unraisable: Any) -> None:
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            usual_hook(unraisable)
            return
        repeat_soon()

    def end_if_stuck() -> None:
        while os.read(reading, 1) != bytes([signal.SIGINT]) or _came.wait(STUCK_AFTER_S):
            pass
        end()

    signal.signal(signal.SIGINT, interrupt)
    sys.unraisablehook = repeat_if_interrupt
    if os.name == "posix":
        reading, writing = os.pipe()
        os.set_blocking(writing, False)
        signal.set_wakeup_fd(writing)  # gets numbers of signals at once, whatever the main thread does
        threading.Thread(target=end_if_stuck, daemon=True).start()


def ignore() -> None:
    """Ignore Ctrl-C from now on: the work is done, and the process only ends."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_DFL:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _is_in_polars(frame: FrameType | None) -> bool:
    """Return whether a frame, or one that called it, is polars'."""
    while frame is not None:
        if str(frame.f_globals.get("__name__")).split(".")[0] == "polars":
            return True
        frame = frame.f_back
    return False


def _again() -> None:
    """Send Ctrl-C to the main thread again.

    It is sent as a signal where the system allows that, because a signal also ends a system call that is waiting.
    """
    if hasattr(signal, "pthread_kill"):
        # `ident` is None only for a thread that has not started, so 0 is never used
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:
        _thread.interrupt_main()


class _Work:
    """What is known of the command in progress: its words, and where its work is saved."""

    words: Sequence[str] = ()
    begun = resumes = False
    out: Path | None = None


_work = _Work()


def begin(words: Sequence[str]) -> None:
    """Forget the work of an earlier command.

    Args:
        words: the command line, without the program's name.
    """
    _work.words, _work.begun, _work.resumes, _work.out = words, False, False, None


def saves_in(out: Path | None, *, resumes: bool) -> None:
    """Remember where the command in progress saves.

    Args:
        out: a folder of finished work, or the file that is written at last; None if nothing is saved.
        resumes: whether the command continues what is in that folder.
    """
    _work.begun, _work.resumes, _work.out = True, resumes, out


def resume_hint() -> str:
    """Return the message after an interruption: whether work is saved, where, and how to resume."""
    out = _work.out
    if not _work.resumes:
        return "interrupted; nothing is saved" if out is not None else "interrupted"
    if out is None:
        return "interrupted; nothing is saved: with --out, finished work is saved and can be resumed"
    if not out.is_dir() or not any(out.iterdir()):
        return "interrupted; nothing is saved yet"
    # --force stays: it replaces no work of the same command, but a file that is written at last.
    return f"interrupted; finished work is saved in '{out}'. To resume: {shlex.join(['vibroswarm', *_work.words])}"


def folder_of_runs(file: Path) -> Path:
    """Return the folder beside a result file in which finished runs are saved until the file itself is written.

    Raises:
        InputError: a file has the folder's name.
    """
    folder = file.with_name(f"{file.name}.runs")
    if folder.exists() and not folder.is_dir():
        raise InputError(
            "is a file; a folder of that name is needed to save finished runs", field=str(folder)
        )
    return folder
