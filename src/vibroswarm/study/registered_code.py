"""Recognise code that a program registered itself, or an installed package brings, when its runs are continued.

A scenario has the hash of a user's file that was loaded by name, but only the name of what ``register`` was given. What
such code is, is therefore saved with each batch, beside the versions of the programs.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable, Iterator, Mapping
from enum import Enum
from functools import cached_property, partial
from pathlib import Path
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any, Final

import numpy as np

from vibroswarm.core.compiled_code import PLAIN, codes_in, enclosed_by, globals_of, is_known
from vibroswarm.errors import InputError
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario

NOT_READ: Final = frozenset({"__doc__", "__module__", "__qualname__"})
"""Entries of a class that say nothing of what it does."""
ABOUT: Final = frozenset({"about", "source", "code"})
"""Fields of what is registered that say nothing of what it does."""
PACKAGES: Final = frozenset({"site-packages", "dist-packages"})
"""Folders of installed packages."""


def registered_code(
    scenarios: Iterable[Scenario], motion: str = "", method: str = "", *_files: str
) -> dict[str, str]:
    """Return a hash of the code of all that is selected and has no file, by kind and name.

    What belongs to this package is left out. Not seen are changes of other installed packages, and of values that may
    change as code runs: lists, tables and private attributes.

    Args:
        motion, method: name of the source of motion, and of the method of search. _files: ignored: code that has a file
            is known by the hash in its name.
    """
    selected = {(one.kind, one.selected) for scenario in scenarios for one in scenario.choices}
    selected |= {("motion", motion), ("method", method)}
    known = {kind: one.known() for kind, one in plugins.KINDS.items()}
    found = {
        f"{kind} {name}": known[kind][name] for kind, name in sorted(selected) if name in known.get(kind, ())
    }
    hashes = {name: _hash(declared) for name, declared in found.items() if not declared.code}
    return {name: digest for name, digest in hashes.items() if digest}


def _hash(declared: Any) -> str:
    """Return the hash of what is registered, 16 hexadecimal digits; empty if it has no functions of its own."""
    cached = {
        name for name in vars(declared) if isinstance(getattr(type(declared), name, None), cached_property)
    }
    values = {name: value for name, value in vars(declared).items() if name not in ABOUT | cached}
    functions = tuple(value for value in values.values() if callable(value))
    homes = {_root(_module_of(owner)) for one in functions for owner in (one, getattr(one, "__self__", one))}
    own: list[Any] = []
    text = "\0".join(_texts(tuple(values.items()), homes, own))
    return hashlib.sha256(text.encode()).hexdigest()[:16] if own else ""


def _texts(value: Any, homes: set[str], seen: list[Any]) -> Iterator[str]:
    """Yield texts that differ if a value, or code that it leads to, differs.

    Args:
        homes: packages whose code is read although they are installed. seen: code that was read, which is extended.
    """
    value = getattr(value, "py_func", value)  # the function of a kernel
    if isinstance(value, PLAIN):
        yield f"{type(value).__name__} {value!r}"
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape} {value.tobytes()!r}"
    elif isinstance(value, frozenset):
        yield from sorted(text for one in value for text in _texts(one, homes, seen))
    elif _is_read(value, homes) and not any(value is one for one in seen):
        if isinstance(value, FunctionType | type):
            seen.append(value)
        for part in _parts(value):
            yield from _texts(part, homes, seen)


def _is_read(value: Any, homes: set[str]) -> bool:
    """Return whether a value that is not plain is read: it belongs neither to Python, nor to an installed package."""
    if isinstance(
        value, tuple | partial | MethodType | staticmethod | classmethod | property | CodeType | Enum
    ):
        return True
    module = _module_of(value)
    root = _root(module)
    file = getattr(sys.modules.get(root), "__file__", None)
    is_installed = file is not None and not PACKAGES.isdisjoint(Path(file).parts)
    return not is_known(module) and (root in homes or not is_installed)


def _module_of(value: Any) -> str:
    """Return the name of the module of a function or class, or of the class of another value."""
    has_module = isinstance(value, FunctionType | MethodType | type)
    return str((value if has_module else type(value)).__module__)


def _root(module: str) -> str:
    return module.partition(".")[0]


def _parts(value: Any) -> Iterable[Any]:
    """Return what a value consists of."""
    match value:
        case tuple():
            return value
        case partial():
            return (value.func, *value.args, *value.keywords.items())
        case MethodType():
            return (value.__func__, value.__self__)
        case staticmethod() | classmethod():
            return (value.__func__,)
        case property():
            return (value.fget, value.fset)
        case Enum():
            return (value.name, value.value)
        case CodeType():
            return (value.co_code, value.co_names, value.co_consts)
        case FunctionType():
            return _parts_of_function(value)
        case type():
            own = {name: one for name, one in vars(value).items() if name not in NOT_READ}
            return (value.__name__, *sorted(own.items()), *value.__bases__)
    public = {name: one for name, one in getattr(value, "__dict__", {}).items() if not name.startswith("_")}
    return (type(value), *sorted(public.items()))


def _parts_of_function(function: FunctionType) -> Iterator[Any]:
    """Yield the code of a function, its defaults, and what it reads from around it, also from modules."""
    yield from (function.__code__, function.__defaults__, *sorted((function.__kwdefaults__ or {}).items()))
    names = {name for code in codes_in(function.__code__) for name in code.co_names}
    values = enclosed_by(function) | globals_of(function)
    for name, value in sorted(values.items()):
        if isinstance(value, ModuleType):
            yield from ((one, vars(value)[one]) for one in sorted(names & vars(value).keys()))
        yield name, value


def check_registered(
    made_by: Iterable[Mapping[str, str]], folder: Path, scenarios: Iterable[Scenario], *others: str
) -> None:
    """Refuse to continue runs whose registered code has changed since.

    Args:
        made_by: versions with which runs in ``folder`` were made, ``registered_code`` among them.
        scenarios, others: as of ``registered_code``.
    Raises:
        InputError: code has changed; the message names it.
    """
    now = registered_code(scenarios, *others)
    for saved in made_by:
        changed = [name for name, digest in now.items() if saved.get(name, digest) != digest]
        if changed:
            raise InputError(
                f"its runs were made with another {changed[0]}, whose code has changed since; take another folder",
                field=str(folder),
            )
