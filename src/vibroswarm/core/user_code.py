"""A user's Python code: its texts, and its errors in one sentence."""

from __future__ import annotations

import dis
import sys
import sysconfig
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any, Final

from vibroswarm.errors import CodeError, InputError, RunError

TEXT: Final = "__text__"
"""Global variable of the module of a user's file that was loaded by name: its text. Several files may have its name."""


@contextmanager
def errors_in(code: str, otherwise: str = "") -> Iterator[None]:
    """Report an error that a user's file raises within the ``with`` block in one sentence, with file and line."""
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
        does_not_compile = type(error).__module__.startswith("numba.")
        kind = InputError if does_not_compile else CodeError
        raise kind(f"{place}: {type(error).__name__}: {error}") from None


def is_known(module: object) -> bool:
    """Return whether a module, by name, is of this package, of Python, NumPy or Numba: it is known by its version."""
    root = str(module).partition(".")[0]
    if root in ("vibroswarm", "numpy", "numba"):
        return True
    file = str(
        getattr(sys.modules.get(root), "__file__", None)
    )  # a user's file may have the name of one of Python's
    return root in sys.stdlib_module_names and (
        file == "None" or file.startswith(sysconfig.get_path("stdlib"))
    )


def globals_of(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the values of the globals that a function, and functions in it, read, by name."""
    plain: Any = getattr(function, "py_func", function)
    codes = [plain.__code__]
    for code in codes:  # grows by the functions within
        codes += [part for part in code.co_consts if isinstance(part, CodeType)]
    names = {
        each.argval for code in codes for each in dis.get_instructions(code) if each.opname == "LOAD_GLOBAL"
    }
    return {name: plain.__globals__[name] for name in sorted(names) if name in plain.__globals__}


def users_parts(*functions: Any) -> list[FunctionType | ModuleType]:
    """Return those functions that are users' own, and users' functions and modules that they name, in turn."""
    found: list[Any] = [getattr(one, "py_func", one) for one in functions]
    for one in found:  # grows
        if isinstance(one, FunctionType) and not is_known(one.__module__):
            named = [getattr(value, "py_func", value) for value in globals_of(one).values()]
            found += [each for each in named if not any(each is known for known in found)]
    parts = [one for one in found if isinstance(one, FunctionType | ModuleType)]
    return [
        one for one in parts if not is_known(one.__name__ if isinstance(one, ModuleType) else one.__module__)
    ]


def users_text(*functions: Any) -> str | None:
    """Return the texts of all ``users_parts``, empty without any; None: their kernels must not be cached."""
    names, texts, folders = list[str](), set[str](), set[Path]()
    for part in users_parts(*functions):
        if isinstance(part, ModuleType):
            space, file, name = vars(part), Path(str(part.__file__)), part.__name__
        else:
            space, file = part.__globals__, Path(part.__code__.co_filename)
            name = f"{part.__module__} {part.__qualname__} {part.__defaults__}"
        is_open = isinstance(part, FunctionType) and part.__closure__
        if is_open or (TEXT not in space and not file.is_file()):
            return None
        names.append(name)
        if TEXT in space:
            texts.add(space[TEXT])
        else:
            folders.add(file.parent)
    files = sorted(file for folder in folders for file in folder.glob("*.py"))
    return "\0".join((*names, *sorted(texts), *(file.read_text("utf-8", "replace") for file in files)))
