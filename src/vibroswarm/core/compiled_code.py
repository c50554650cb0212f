"""A text of all that is compiled with a function, by which a cached kernel is known again, or not.

Numba compiles into a kernel what its functions call, and every value that they read from the modules, classes and
closures around them. A kernel may be used again only if none of it has changed, whichever file it is in.
"""

from __future__ import annotations

import dis
import sys
import sysconfig
from collections.abc import Callable, Iterator
from enum import Enum, EnumMeta
from functools import cache
from hashlib import sha256
from types import BuiltinFunctionType, CellType, CodeType, FunctionType, ModuleType
from typing import Any, Final

import numpy as np

PLAIN: Final = (
    bool,
    int,
    float,
    complex,
    str,
    bytes,
    type(None),
    type(Ellipsis),
    np.dtype,
    np.generic,
    np.ufunc,
)
"""Types whose ``repr`` tells values apart, and is the same in every process."""


class UnknownValueError(Exception):
    """A function reads a value of which no text tells whether it has changed; its kernels must not be cached."""


def compiled_text(function: Callable[..., Any]) -> str:
    """Return a text that differs if anything differs that is compiled with a function, and is the same in each process.

    It has bytecode and constants of the function, the values that it reads, and the same of all that it calls. Of this
    package, Python and NumPy only names are given: what they hold is known from a hash, or from their versions.

    Raises:
        UnknownValueError: the function reads a value that cannot be described.
    """
    return _of_function(function, set())


def globals_of(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the values of the globals that a function reads, by name; names that are not defined are left out."""
    names = {
        instruction.argval
        for code in codes_in(function.__code__)
        for instruction in dis.get_instructions(code)
        if instruction.opname in ("LOAD_GLOBAL", "LOAD_NAME")
    }
    return {name: function.__globals__[name] for name in sorted(names) if name in function.__globals__}


def is_ours(module: object) -> bool:
    """Return whether a module, by name, belongs to this package, of which ``jit.source_hash`` has all sources."""
    return str(module).startswith("vibroswarm.")


@cache
def is_known(module: object) -> bool:
    """Return whether the name of the cache folder tells the code of a module, by name: by a hash, or by a version."""
    root = str(module).partition(".")[0]
    if root not in sys.stdlib_module_names:
        return is_ours(module) or root in ("numpy", "numba")
    file = getattr(
        sys.modules.get(root), "__file__", None
    )  # a user's own file may have the name of a Python module
    return file is None or str(file).startswith(sysconfig.get_path("stdlib"))


def codes_in(code: CodeType) -> Iterator[CodeType]:
    """Yield the code of a function, and of the functions in it."""
    yield code
    for value in code.co_consts:
        if isinstance(value, CodeType):
            yield from codes_in(value)


def _of_function(function: Callable[..., Any], seen: set[Any]) -> str:
    """Return ``compiled_text``; what is in ``seen``, which is extended, has been described already."""
    seen.add(function)
    codes = list(codes_in(function.__code__))
    texts = [f"{code.co_code!r} {_constants(code)} {code.co_names} {_arguments(code)}" for code in codes]
    names = {name for code in codes for name in code.co_names}
    values = enclosed_by(function) | globals_of(function)
    texts += [f"{name}: {_of_value(value, names, seen)}" for name, value in values.items()]
    defaults = (function.__defaults__, *(function.__kwdefaults__ or {}).items())
    texts.append(_of_value(defaults, names, seen))
    return "; ".join(texts)


def enclosed_by(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the values that a function reads from the functions around it, by name."""
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    return {name: _content(cell) for name, cell in cells}


def _constants(code: CodeType) -> list[str]:
    return [_of_value(value, set(), set()) for value in code.co_consts if not isinstance(value, CodeType)]


def _arguments(code: CodeType) -> tuple[str, ...]:
    """Return the names of arguments, by which a call may give them."""
    return code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]


def _content(cell: CellType) -> Any:
    """Return what a closure's cell holds; None if nothing was assigned to it."""
    try:
        return cell.cell_contents
    except ValueError:
        return None


def _of_value(value: Any, names: set[str], seen: set[Any]) -> str:
    """Return the text of a value that a function reads.

    Args:
        names: those that the function uses, and so all attributes that it may read. seen: as in ``_of_function``.
    """
    kernel = value
    value = getattr(kernel, "py_func", kernel)  # the function of a kernel
    if isinstance(value, Enum):
        return f"{value!r} {_of_value(value.value, names, seen)}"
    if isinstance(value, PLAIN):
        return f"{type(value).__name__} {value!r}"
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, tuple | list):
        return f"{type(value).__name__} {[_of_value(each, names, seen) for each in value]}"
    if isinstance(value, set | frozenset):  # whose order differs from process to process
        return f"{type(value).__name__} {sorted(_of_value(each, names, seen) for each in value)}"
    if isinstance(value, dict):
        return f"dict {[_of_value(pair, names, seen) for pair in value.items()]}"
    if isinstance(value, ModuleType):
        return _of_module(value, names, seen)
    if isinstance(value, EnumMeta):
        members: list[Any] = list(value)
        return f"{[_of_value(member, names, seen) for member in members]}"
    where, name = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
    if isinstance(value, FunctionType) and not is_known(where):
        text = name or "" if value in seen else _of_function(value, seen)
        return f"{text} {_of_value(_options(kernel), names, seen)}"
    if isinstance(value, BuiltinFunctionType) or (name is not None and is_known(where)):
        return f"{where}.{name}"
    if isinstance(value, type) and issubclass(value, tuple):
        return f"{name} {getattr(value, '_fields', ())}"
    if isinstance(value, type) and issubclass(value, BaseException):
        return f"{where}.{name}"
    kind = type(value).__module__
    # The text of a type of Numba says all of it; that of other values of Numba, such as vectorized functions, may be a
    # mere name, and so is that of a class.
    says_all = is_known(kind) and (kind.startswith("numba.core.types.") or not kind.startswith("numba."))
    if says_all and not isinstance(value, type) and "0x" not in repr(value):
        return repr(value)
    raise UnknownValueError(f"a value of type {type(value).__name__}")


def _options(kernel: Any) -> dict[str, Any]:
    """Return how a kernel is compiled; nothing of a plain function."""
    if not hasattr(kernel, "targetoptions"):
        return {}
    declared = [] if kernel._can_compile else [str(each) for each in kernel.nopython_signatures]
    return {**kernel.targetoptions, "locals": kernel.locals, "signatures": declared}


def _of_module(module: ModuleType, names: set[str], seen: set[Any]) -> str:
    """Return the text of what a function may read from a module, and from modules in it."""
    read = sorted(names & vars(module).keys())
    if is_known(module.__name__) or (module, *read) in seen:
        return module.__name__
    seen.add((module, *read))
    return f"{module.__name__} {[f'{name}: {_of_value(vars(module)[name], names, seen)}' for name in read]}"
