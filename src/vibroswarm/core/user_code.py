"""Calls of a user's Python code: its errors in one sentence, and how calls in other threads are ended."""

from __future__ import annotations

import ctypes
import threading
import traceback
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from vibroswarm.errors import CodeError, InputError, RunError

_running: list[int] = []
"""Identifiers of the threads that are in a block of ``errors_in``, once for each block."""


@contextmanager
def errors_in(code: str, otherwise: str = "") -> Iterator[None]:
    """Report an error that a user's file raises within the ``with`` block in one sentence, with file and line.

    Args:
        code: ``FILE.py:NAME``, with or without its folder; empty for code of this package, whose errors pass unchanged.
        otherwise: the place that is named if no line of the file was being run; empty: the file.
    Raises:
        CodeError: the file raised an error.
    """
    thread = threading.get_ident()
    _running.append(thread)
    try:
        yield
    except (CodeError, InputError, RunError):  # these have a message for users already
        raise
    except (Exception, SystemExit) as error:  # a user's function may raise anything
        if not code:
            raise
        file = code.partition(" sha256:")[0].rpartition(":")[0]
        frames = traceback.extract_tb(error.__traceback__)
        lines = [line for line in frames if file in (line.filename, Path(line.filename).name)]
        place = f"{file}, line {lines[-1].lineno}, in {lines[-1].name}" if lines else otherwise or file
        raise CodeError(f"{place}: {type(error).__name__}: {error}") from None
    finally:
        _running.remove(thread)


def interrupt_in(threads: Collection[int]) -> None:
    """Raise ``KeyboardInterrupt`` in those of some threads that are in a block of ``errors_in``.

    It ends also a function that would never return, as soon as the thread runs a line of Python.

    Args:
        threads: their identifiers.
    """
    for thread in set(threads).intersection(_running):
        ctypes.pythonapi.PyThreadState_SetAsyncExc(
            ctypes.c_ulong(thread), ctypes.py_object(KeyboardInterrupt)
        )
