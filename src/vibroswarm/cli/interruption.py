"""Ctrl-C: it always ends the command, which says what is saved, and how to resume."""

from __future__ import annotations

import _thread
import argparse
import shlex
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import Any, Final

from vibroswarm.errors import InputError

AGAIN_AFTER_S: Final = 0.05
_came = threading.Event()


def came() -> bool:
    """Return whether Ctrl-C came since ``listen``."""
    return _came.is_set()


def listen() -> None:
    """Take note of Ctrl-C in this process, and repeat it where it is lost.

    Python cannot pass an exception on where LLVM calls it, as it does while a kernel is compiled: ``KeyboardInterrupt``
    would be printed and forgotten.
    """
    _came.clear()
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        return  # ignored, as by nohup, or somebody else's

    def interrupt(number: int, frame: FrameType | None) -> None:
        _came.set()
        raise KeyboardInterrupt

    report_lost = sys.unraisablehook

    def lost(unraisable: Any) -> None:
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            report_lost(unraisable)
            return
        timer = threading.Timer(AGAIN_AFTER_S, _again)
        timer.daemon = True
        timer.start()

    signal.signal(signal.SIGINT, interrupt)
    sys.unraisablehook = lost


def _again() -> None:
    """Send Ctrl-C to the main thread again: as a signal, which also ends a wait, where the system can send it one."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:
        _thread.interrupt_main()


def resume_hint(arguments: argparse.Namespace | None, words: Sequence[str]) -> str:
    """Return the message after an interruption.

    Args:
        arguments: of the command; None if they were not read yet. words: the command line, without the program.
    """
    if arguments is None or not getattr(arguments, "resumes", None):
        return (
            "interrupted; nothing is saved" if getattr(arguments, "out", None) is not None else "interrupted"
        )
    out: Path | None = arguments.out
    if out is None:
        return "interrupted; nothing is saved: with --out, finished work is saved and can be resumed"
    where = folder_of_runs(out) if arguments.resumes == "file" else out
    if not where.is_dir() or not any(where.iterdir()):
        return "interrupted; nothing is saved yet"
    command = shlex.join(["vibroswarm", *words])
    return f"interrupted; finished work is saved in '{where}'. To resume: {command}"


def folder_of_runs(file: Path) -> Path:
    """Return the folder beside a result file in which its runs are kept until it is written.

    Raises:
        InputError: a file has its name.
    """
    folder = file.with_name(f"{file.name}.runs")
    if folder.exists() and not folder.is_dir():
        raise InputError(
            "is a file; the runs of an interrupted search are kept under that name", field=str(folder)
        )
    return folder
