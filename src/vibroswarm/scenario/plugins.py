"""Strategies, networks, tasks and motion sources from files: ``voter.py:voter`` names an object in a file.

A file is code, and runs when it is loaded. So a file named by a data file is loaded only if the user trusts it;
and a result keeps the text of the file and its hash, not a path.
"""

from __future__ import annotations

import hashlib
import linecache
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, Final, NamedTuple

from vibroswarm import networks, strategies, tasks
from vibroswarm.core.untrusted_files import read_text
from vibroswarm.errors import InputError, nearest
from vibroswarm.networks import Network
from vibroswarm.strategies import Strategy
from vibroswarm.tasks import Task

MODULE: Final = "vibroswarm_file"
HASH: Final = " sha256:"


class Kind(NamedTuple):
    """A kind of object that a file may define."""

    declared: type
    register: Callable[[Any], Any]
    known: Callable[[], Mapping[str, Any]]
    group: str
    """Entry point group of installed packages."""


KINDS: Final[dict[str, Kind]] = {
    "strategy": Kind(Strategy, strategies.register, strategies.known, "vibroswarm.strategies"),
    "network": Kind(Network, networks.register, networks.known, "vibroswarm.networks"),
    "task": Kind(Task, tasks.register, tasks.known, "vibroswarm.tasks"),
}

_texts: dict[str, str] = {}
"""Texts of the loaded files, by their code."""
_code_names: set[str] = set()
"""Names that refer to code, loaded or not."""
_trusted: list[Path | None] = []
"""Folders of the files that data files may name; empty while nothing is trusted."""


@contextmanager
def trust_code(folder: Path | None = None) -> Iterator[None]:
    """Load the files that data files name, from ``folder`` or the working directory, inside this context."""
    _trusted.append(folder)
    try:
        yield
    finally:
        _trusted.pop()


@contextmanager
def search_beside(folder: str | Path | None) -> Iterator[None]:
    """Look for trusted files in this folder, inside this context."""
    if not _trusted or folder is None:
        yield
        return
    with trust_code(Path(folder)):
        yield


def is_code(text: object) -> bool:
    """Return whether a name refers to an object in a file: ``folder/voter.py:voter``, with or without hash."""
    if not isinstance(text, str):
        return False
    path, separator, name = text.partition(HASH)[0].rpartition(":")
    return bool(separator) and path.endswith(".py") and name.isidentifier()


def name_in(code: str) -> str:
    """Return ``voter`` of ``voter.py:voter sha256:...``."""
    return code.partition(HASH)[0].rpartition(":")[2]


def is_code_name(name: str) -> bool:
    """Return whether code of this name is known, loaded or not."""
    return name in _code_names


def remember_code_names(values: object) -> None:
    """Remember the names of the code that values of a data file refer to."""
    if isinstance(values, str):
        if HASH in values and is_code(values):
            _code_names.add(name_in(values))
    elif isinstance(values, Mapping):
        for value in values.values():
            remember_code_names(value)
    elif isinstance(values, Iterable):
        for value in values:
            remember_code_names(value)


def resolve_code(kind: str, spec: str) -> str:
    """Return a data file's reference to code, with its hash; load the code if it is trusted.

    A reference with a hash may stay unloaded.

    Raises:
        InputError: a file that is not trusted, cannot be loaded, or is not the one that was used.
    """
    name = name_in(spec)
    _code_names.add(name)
    known = KINDS[kind].known().get(name)
    if known is not None and known.code and (known.code == spec or HASH not in spec):
        return str(known.code)
    if _trusted:
        return str(load_file(kind, spec, _trusted[-1]).code)
    if HASH in spec:
        return spec
    raise InputError(f"{spec} is code; add --trust if you know what it does", field=f"{kind}.name")


def resolve_codes(values: Any, path: str = "") -> Any:
    """Return the values of a data file, with hashes added to references to code; see ``resolve_code``.

    Args:
        path: dotted name of the table that these are.
    """
    if isinstance(values, str):
        kind = path.split(".")[-2:-1]
        is_named = path.endswith(".name") and kind and kind[0] in KINDS
        return resolve_code(kind[0], values) if is_named and is_code(values) else values
    if isinstance(values, Mapping):
        return {key: resolve_codes(value, f"{path}.{key}") for key, value in values.items()}
    if isinstance(values, list | tuple):
        return [resolve_codes(value, path) for value in values]
    return values


def load_file(kind: str | None, spec: str, folder: Path | None = None) -> Any:
    """Load and register the object named ``path.py:name``.

    Args:
        kind: one of ``KINDS``, or None: any. folder: where a relative path begins.
    Raises:
        InputError: there is no such file or object, or it cannot be loaded: the file and line are named.
    """
    path_text, _, name = spec.partition(HASH)[0].rpartition(":")
    path = Path(path_text) if folder is None else folder / path_text
    text = read_text(path, f"a {kind or 'file of code'}")
    digest = hashlib.sha256(text.encode()).hexdigest()
    expected = spec.partition(HASH)[2]
    if expected and expected != digest:
        raise InputError(
            f"'{path}' is not the file that was used: its SHA-256 begins with {digest[:12]}, that of then with "
            f"{expected[:12]}",
            field=f"{kind}.code" if kind else path_text,
        )
    return install(kind, f"{path.name}:{name}{HASH}{digest}", text, str(path))


def text_of(code: str) -> str | None:
    """Return the text of a loaded file."""
    return _texts.get(code)


def texts_of(codes: Iterable[str | None]) -> tuple[tuple[str, str], ...]:
    """Return those of these codes that are loaded, with their texts: what a worker process needs."""
    return tuple((code, _texts[code]) for code in sorted({code for code in codes if code in _texts}))


def install_all(texts: Iterable[tuple[str, str]]) -> None:
    """Register what ``texts_of`` returned, in another process or on another machine."""
    for code, text in texts:
        install(None, code, text)


def install(kind: str | None, code: str, text: str, file: str | None = None) -> Any:
    """Register the object defined by a text: a user's file, or the copy that a worker was given.

    Args:
        kind: one of ``KINDS``, or None: any.
    Raises:
        InputError: the text cannot be loaded, or holds no such thing; the file and line are named.
    """
    name, digest = name_in(code), hashlib.sha256(text.encode()).hexdigest()
    file = file or code.partition(HASH)[0].rpartition(":")[0]
    if code.partition(HASH)[2] != digest:
        raise InputError(f"'{code}' is not what this text is", field=file)
    module_name = f"{MODULE}_{digest[:16]}"
    module = sys.modules.get(module_name) or _module(module_name, text, file)
    declared: Any = vars(module).get(name)
    is_a = kind_of(declared)
    if is_a is None or kind not in (None, is_a):
        classes = (
            tuple(kind_info.declared for kind_info in KINDS.values())
            if kind is None
            else KINDS[kind].declared
        )
        names = [defined for defined, value in vars(module).items() if isinstance(value, classes)]
        problem = (
            f"is not a {kind or ', '.join(KINDS)}"
            if name in vars(module)
            else f"is not there{nearest(name, names)}"
        )
        raise InputError(f"'{name}' {problem}; the file has {', '.join(names) or 'none'}", field=file)
    if declared.name != name:
        raise InputError(f"'{name}' calls itself '{declared.name}'; give both one name", field=file)
    known = KINDS[is_a].known().get(name)
    if known is None:
        known = KINDS[is_a].register(replace(declared, source=text, code=code))
    elif known.source != text:
        whose = "another file has been loaded with" if known.source else "vibroswarm has"
        raise InputError(f"{whose} a {is_a} '{name}' already; give yours another name", field=file)
    _texts[code] = text
    _code_names.add(name)
    return known


def kind_of(found: object) -> str | None:
    """Return the kind of an object (one of ``KINDS``), or None."""
    return next((kind for kind, info in KINDS.items() if isinstance(found, info.declared)), None)


def known_for(kind: str, name: object) -> Mapping[str, Any]:
    """Return all objects of a kind by name; search installed packages if ``name`` is missing.

    Raises:
        InputError: what an installed package offers cannot be loaded.
    """
    known = KINDS[kind].known
    if isinstance(name, str) and name not in known():
        load_installed()
    return known()


def load_installed() -> None:
    """Register the entry points of installed packages (groups ``vibroswarm.strategies``, ...).

    Raises:
        InputError: one cannot be loaded, or is none.
    """
    for kind, (declared, register, known, group) in KINDS.items():
        for point in entry_points(group=group):
            try:
                loaded: Any = point.load()
            except Exception as error:
                raise InputError(
                    f"cannot be loaded: {type(error).__name__}: {error}", field=point.value
                ) from None
            if not isinstance(loaded, declared):
                raise InputError(f"is not a {kind}", field=point.value)
            if vars(loaded)["name"] not in known():
                register(loaded)


def _module(name: str, text: str, file: str) -> ModuleType:
    """Execute a text as a module; errors name the file and line."""
    module = ModuleType(name)
    module.__file__ = file
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    sys.modules[name] = module
    try:
        exec(compile(text, file, "exec", dont_inherit=True), vars(module))  # noqa: S102  (the user asked for it by name)
    except KeyboardInterrupt:
        del sys.modules[name]
        raise
    except BaseException as error:
        del sys.modules[name]
        message = (
            str(error)
            if isinstance(error, InputError)
            else f"cannot be loaded: {type(error).__name__}: {error}"
        )
        raise InputError(f"{message}{_line_of(error, file)}", field=file) from None
    return module


def _line_of(error: BaseException, file: str) -> str:
    """Return `` (line 12)``, the line of the file that raised the error, or an empty string."""
    if isinstance(error, SyntaxError) and error.filename == file:
        return f" (line {error.lineno})"
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == file]
    return f" (line {lines[-1]})" if lines else ""
