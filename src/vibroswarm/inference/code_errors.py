"""Errors raised by a strategy or a network, translated into one sentence with file and line."""

from __future__ import annotations

import re
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from vibroswarm.core.jit import PACKAGE
from vibroswarm.errors import CodeError, InputError, RunError
from vibroswarm.networks import Network
from vibroswarm.strategies import Strategy

ALLOCATES = re.compile(
    r"NRT required|function Function\(<built-in function (zeros|empty|ones|full|arange|array|linspace|copy)"
)


@contextmanager
def translate_errors(strategy: Strategy, network: Network) -> Iterator[None]:
    """Translate errors raised by the functions of a strategy or a network into one sentence each.

    Raises:
        InputError: a function cannot be compiled. CodeError: it raised.
    """
    try:
        yield
    except (InputError, RunError, KeyboardInterrupt, MemoryError):
        raise
    except Exception as error:
        files = files_of(strategy) | files_of(network)
        if not files:
            raise
        if _is_numbas(error):
            raise InputError(_of_compiling(error, files), field=_field(strategy, network)) from None
        place = _place(error, files)
        if place is None:
            raise
        raise CodeError(f"{place}: {type(error).__name__}: {error}") from None


def files_of(declared: Strategy | Network) -> dict[str, Callable[..., Any]]:
    """Return the files of the functions that do not belong to this package, with one function of each file; empty if
    all do."""
    functions = [function for function in vars(declared).values() if hasattr(function, "__code__")]
    return {
        function.__code__.co_filename: function
        for function in functions
        if not function.__module__.startswith("vibroswarm.")
    }


def _is_numbas(error: Exception) -> bool:
    """Return whether an error comes from Numba's compiler."""
    kinds = {kind.__module__.partition(".")[0] for kind in type(error).__mro__}
    return "numba" in kinds or any(
        frame.name in ("_compile_for_args", "compile") and "numba" in frame.filename
        for frame in traceback.extract_tb(error.__traceback__)
    )


def _of_compiling(error: Exception, files: dict[str, Callable[..., Any]]) -> str:
    """Shorten Numba's message to file, line and cause."""
    text = str(error)
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    noise = (
        "Failed in",
        "During:",
        "- Resolution",
        "- Of which",
        "There are",
        "File ",
        "raised from",
        "<source",
    )
    message = next((line for line in lines if not line.startswith(noise)), lines[0] if lines else repr(error))
    if ALLOCATES.search(text):
        message = "creates an array, but a robot's memory is fixed: use loops, and keep arrays in Arrays"
    for file in files:
        line_numbers = re.findall(re.escape(file) + r"[\" ,]*\(?(?:line )?(\d+)", text)
        if line_numbers:
            return f"cannot be compiled: {file}, line {line_numbers[0]}: {message}"
    return f"cannot be compiled: {', '.join(files)}: {message}"


def _place(error: Exception, files: dict[str, Callable[..., Any]]) -> str | None:
    """Return the file and line in user code at which an error was raised; None if it was not in user code."""
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if PACKAGE not in Path(frame.filename).parents
    ]
    if not frames or "site-packages" in frames[-1].filename:
        return None
    # A cached kernel reports the path that the file had when it was compiled: the same text, elsewhere.
    last, by_name = frames[-1], {Path(file).name: file for file in files}
    file = by_name.get(Path(last.filename).name) or next(iter(files))
    return f"{file}, line {last.lineno}, in {last.name}"


def _field(strategy: Strategy, network: Network) -> str:
    return f"strategy '{strategy.name}'" if files_of(strategy) else f"network '{network.name}'"
