"""Strategies, networks and tasks from files: ``voter.py:voter`` names an object in a file.

A file is code, and runs when it is loaded. So nothing is loaded because a data file names it, unless the user has said
that it is to be trusted; and what is kept of a result is the text of the file and its hash, not a path.
"""

from __future__ import annotations

import hashlib
import linecache
import sys
import traceback
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from vibroswarm.errors import InputError, nearest, shown
from vibroswarm.plain_files import read_text
from vibroswarm.strategies import base
from vibroswarm.strategies.base import Strategy

MODULE: Final = "vibroswarm_file"
HASH: Final = " sha256:"


def is_file_name(text: str) -> bool:
    """Whether a name is that of an object in a file: ``folder/voter.py:voter``."""
    path, separator, name = text.rpartition(":")
    return bool(separator) and path.endswith(".py") and name.isidentifier()


def code_of(path: str | Path, name: str, text: str) -> str:
    """What a scenario keeps of code: ``voter.py:voter sha256:...``."""
    return f"{Path(path).name}:{name}{HASH}{hashlib.sha256(text.encode()).hexdigest()}"


def load_file(spec: str, folder: Path | None = None) -> tuple[Strategy, str]:
    """The strategy that ``path.py:name`` says, made known, and its code in a scenario's words.

    Args:
        folder: where a relative path begins.
    Raises:
        InputError: there is no such file or object, or it cannot be loaded: the file and line are named.
    """
    path_text, _, name = spec.partition(HASH)[0].rpartition(":")
    path = Path(path_text) if folder is None else folder / path_text
    text = read_text(path, "a strategy")
    code = code_of(path, name, text)
    if HASH in spec and spec.partition(HASH)[2] != code.partition(HASH)[2]:
        raise InputError(
            f"'{path}' is not the file that was used: its SHA-256 begins with {code.partition(HASH)[2][:12]}, that of "
            f"then with {spec.partition(HASH)[2][:12]}",
            field="strategy.code",
        )
    return install(code, text, str(path)), code


_texts: dict[str, str] = {}
"""Texts of what has been loaded, by their code."""


def text_of(code: str) -> str | None:
    """The text of a file that has been loaded."""
    return _texts.get(code)


def install(code: str, text: str, file: str | None = None) -> Strategy:
    """Make the strategy of a text known: of a file of the user's, or of a copy that a worker was given.

    Raises:
        InputError: the text cannot be loaded, or holds no such strategy; the file and line are named.
    """
    file = file or code.partition(HASH)[0].rpartition(":")[0]
    name = code.partition(HASH)[0].rpartition(":")[2]
    digest = hashlib.sha256(text.encode()).hexdigest()
    if code.partition(HASH)[2] != digest:
        raise InputError(f"{code} is not what this text is", field="strategy.code")
    module_name = f"{MODULE}_{digest[:16]}"
    module = sys.modules.get(module_name) or _module(module_name, text, file)
    found = vars(module).get(name)
    if not isinstance(found, Strategy):
        there = [one for one, value in vars(module).items() if isinstance(value, Strategy)]
        what = "is no Strategy" if name in vars(module) else f"is not there{nearest(name, there)}"
        raise InputError(
            f"'{name}' {what}; the file has {', '.join(there) if there else 'no Strategy at all'}", field=file
        )
    known = base.known().get(found.name)
    if known is not None and known.source == text:
        return known
    if known is not None:
        whose = "another file has" if known.source else "vibroswarm has"
        raise InputError(f"{whose} a strategy '{found.name}'; give yours another name", field=file)
    _texts[code] = text
    return base.register(replace(found, source=text))


def _module(name: str, text: str, file: str) -> ModuleType:
    module = ModuleType(name)
    module.__file__ = file
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    sys.modules[name] = module
    try:
        exec(compile(text, file, "exec"), vars(module))  # noqa: S102  (the user asked for it by name)
    except InputError as error:
        del sys.modules[name]
        raise InputError(f"{error}{_line_of(error, file)}", field=file) from None
    except BaseException as error:
        del sys.modules[name]
        if isinstance(error, KeyboardInterrupt):
            raise
        kind = type(error).__name__
        raise InputError(f"cannot be loaded: {kind}: {error}{_line_of(error, file)}", field=file) from None
    return module


def _line_of(error: BaseException, file: str) -> str:
    """`` (line 12)`` of the file, if the error has come from there."""
    if isinstance(error, SyntaxError) and error.filename == file:
        return f" (line {error.lineno})"
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == file]
    return f" (line {lines[-1]})" if lines else ""


def described(value: Any) -> str:
    """A value on one line."""
    return shown(value)
