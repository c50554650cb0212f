"""Errors raised by a user's strategy or network, translated into one sentence with file and line."""

from __future__ import annotations

import dis
import linecache
import re
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType
from typing import Any

from vibroswarm.core.jit import PACKAGE
from vibroswarm.errors import CodeError, InputError, RunError
from vibroswarm.networks import Network
from vibroswarm.strategies import Strategy

ALLOCATES = re.compile(
    r"NRT required|function Function\(<built-in function (zeros|empty|ones|full|arange|array|linspace|copy)"
)
"""Words of the compiler's messages about code that creates an array. (NRT is Numba's memory management.)"""


@contextmanager
def translate_errors(strategy: Strategy, network: Network) -> Iterator[None]:
    """Translate errors that users' functions of a strategy or a network raise within the ``with`` block.

    Other errors pass unchanged. So do errors of this package's own strategies and networks, which are bugs.

    Raises:
        InputError: a function cannot be compiled.
        CodeError: a function raised an error; the message names file and line.
    """
    try:
        yield
    except (InputError, RunError, KeyboardInterrupt, MemoryError):
        raise  # these have a message for users already, or are no errors in the user's code
    except Exception as error:
        files = files_of(strategy) | files_of(network)
        if not files:
            raise
        if _is_of_compiler(error):
            raise InputError(_compiler_message(error, files), field=_field(strategy, network)) from None
        place = _place(error, files)
        if place is None and (reason := _reason_of(error)):
            raise CodeError(f"{_field(strategy, network)}: {reason}; --plain may name the line") from None
        if place is None:
            raise
        raise CodeError(f"{place}: {type(error).__name__}: {error}") from None


def _reason_of(error: Exception) -> str | None:
    """Return what a user's function has done, from an error that compiled code raises without a line; None: unknown."""
    if isinstance(error, IndexError):
        return "an index is beyond the end of an array"
    if isinstance(error, TypeError) and "None" in str(error):
        return (
            "a function returned None (on_sample, on_timer and lost return True or False, decision a number)"
        )
    return None


def files_of(declared: Strategy | Network) -> dict[str, Callable[..., Any]]:
    """Return the user's files in which functions of a strategy or network are defined.

    Returns: file names, each with one of the functions in it; empty if all functions belong to this package.
    """
    functions = [function for function in vars(declared).values() if hasattr(function, "__code__")]
    return {
        function.__code__.co_filename: function
        for function in functions
        if not function.__module__.startswith("vibroswarm.")
    }


def _is_of_compiler(error: Exception) -> bool:
    """Return whether an error comes from Numba's compiler.

    It does if its type, or a base of its type, is defined in Numba, or if it was raised while a function of Numba that
    compiles was running.
    """
    kinds = {kind.__module__.partition(".")[0] for kind in type(error).__mro__}
    return "numba" in kinds or any(
        frame.name in ("_compile_for_args", "compile") and "numba" in frame.filename
        for frame in traceback.extract_tb(error.__traceback__)
    )


def _compiler_message(error: Exception, files: dict[str, Callable[..., Any]]) -> str:
    """Shorten a message of Numba's compiler to the user's file, the line and the cause.

    Args:
        files: the user's files, as ``files_of`` returns them.
    """
    text = str(error)
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    noise = (  # beginnings of lines that do not name the cause
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
        # The compiler writes: File "NAME", line 12 or NAME (12).
        line_numbers = re.findall(re.escape(file) + r"[\" ,]*\(?(?:line )?(\d+)", text)
        if line_numbers:
            return f"cannot be compiled: {file}, line {line_numbers[0]}: {message}"
    for file in files:
        line = _line_of_unknown(message, file)
        if line is not None:
            return f"cannot be compiled: {file}, line {line}: {message}"
    return f"cannot be compiled: {', '.join(files)}: {message}"


def _line_of_unknown(message: str, file: str) -> int | None:
    """Return the first line of a file that reads the name which is not defined; the compiler does not tell it."""
    unknown = re.search(r"name '(\w+)' is not defined", message)
    if unknown is None:
        return None
    try:
        codes = [compile("".join(linecache.getlines(file)), file, "exec")]  # not run
    except SyntaxError:  # the file has changed since
        return None
    lines = []
    for code in codes:  # grows by the functions within
        codes += [part for part in code.co_consts if isinstance(part, CodeType)]
        reads = (one for one in dis.get_instructions(code) if one.opname == "LOAD_GLOBAL")
        lines += [one.positions.lineno for one in reads if one.argval == unknown[1] and one.positions]
    return min((line for line in lines if line), default=None)


def _place(error: Exception, files: dict[str, Callable[..., Any]]) -> str | None:
    """Return file, line and function in a user's code where an error was raised; None if it was raised elsewhere.

    Elsewhere means: in code of this package that no other code called, or in an installed library.

    Args:
        files: the user's files, as ``files_of`` returns them.
    """
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if PACKAGE not in Path(frame.filename).parents
    ]
    if not frames or "site-packages" in frames[-1].filename:
        return None
    # A cached kernel reports the path that the file had when it was compiled. The file may have been moved since, so
    # only its name is compared; or it may have been renamed, so without a match the first of the user's files is named.
    last, by_name = frames[-1], {Path(file).name: file for file in files}
    alike = by_name.get(Path(last.filename).name) or next(iter(files))
    file = last.filename if last.filename in files else alike
    return f"{file}, line {last.lineno}, in {last.name}"


def _field(strategy: Strategy, network: Network) -> str:
    return f"strategy '{strategy.name}'" if files_of(strategy) else f"network '{network.name}'"
