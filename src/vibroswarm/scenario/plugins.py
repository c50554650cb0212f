"""Strategies, networks, tasks, sensors and motions from users' files: ``voter.py:voter`` names an object in a file.

A reference may have the hash of the file: ``voter.py:voter sha256:...``. Loading a file runs it, so one that a
scenario or study file refers to is loaded only inside ``trust_code``. A result keeps the file's text and hash, not a
path.
"""

from __future__ import annotations

import hashlib
import linecache
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path
from threading import RLock
from types import ModuleType
from typing import Any, Final, NamedTuple

from vibroswarm import networks, sensors, strategies, tasks
from vibroswarm.core.registry import unknown
from vibroswarm.core.untrusted_files import read_text
from vibroswarm.core.user_code import TEXT, errors_in
from vibroswarm.errors import InputError, nearest
from vibroswarm.networks import Network
from vibroswarm.sensors import SensorModel
from vibroswarm.strategies import Strategy
from vibroswarm.tasks import Task

HASH: Final = " sha256:"
"""Between name and hash in a reference to code."""


class Kind(NamedTuple):
    """A kind of object that a file may define: its class, and its registry."""

    declared: type
    register: Callable[[Any], Any]
    """Registers an object, and returns it."""
    known: Callable[[], Mapping[str, Any]]
    """Returns all registered objects, by name."""
    group: str
    """Entry point group of installed packages."""
    selector: str = "name"
    """Field of the section of this kind that selects one."""


KINDS: Final[dict[str, Kind]] = {
    "strategy": Kind(Strategy, strategies.register, strategies.known, "vibroswarm.strategies"),
    "network": Kind(Network, networks.register, networks.known, "vibroswarm.networks"),
    "task": Kind(Task, tasks.register, tasks.known, "vibroswarm.tasks"),
    "sensor": Kind(SensorModel, sensors.register, sensors.known, "vibroswarm.sensors", selector="model"),
}
"""Kinds of objects that a file may define, by name; ``motion.source`` adds "motion"."""

_texts: dict[str, str] = {}
"""Texts of the loaded files, by the reference to code with hash."""
_executing = RLock()
"""Held while a file is executed: threads of a worker would find its module registered before it defines anything."""
_trusted: list[Path | None] = []
"""Stack of ``trust_code``: the last is the folder in which trusted files are looked for (None: the working directory);
empty while no file is trusted."""


@contextmanager
def trust_code(folder: Path | None = None) -> Iterator[None]:
    """Allow files of code that data files name to be loaded, and so run, inside this context."""
    _trusted.append(folder)
    try:
        yield
    finally:
        _trusted.pop()


@contextmanager
def search_beside(folder: str | Path | None) -> Iterator[None]:
    """Start relative paths of code from ``folder`` inside this context, if it lies inside ``trust_code``."""
    if not _trusted or folder is None:
        yield
        return
    with trust_code(Path(folder)):
        yield


def field_of(kind: str) -> str:
    """Return the dotted name of the field that selects an object of a kind, such as "strategy.name"."""
    return f"{kind}.{KINDS[kind].selector}"


def is_code(text: object) -> bool:
    """Return whether a value is a reference to code: ``folder/voter.py:voter``, with or without hash."""
    if not isinstance(text, str):
        return False
    path, separator, name = text.partition(HASH)[0].rpartition(":")
    return bool(separator) and path.endswith(".py") and name.isidentifier()


def name_in(code: str) -> str:
    """Return the object's name in a reference to code: ``voter`` of ``voter.py:voter sha256:...``."""
    return code.partition(HASH)[0].rpartition(":")[2]


def resolve_code(kind: str, spec: str) -> str:
    """Return a reference to loaded code with its hash; load the code if that is allowed, in ``trust_code``."""
    known = KINDS[kind].known().get(name_in(spec))
    code = str(known.code) if known is not None else ""
    if code and code == spec:
        return code
    if _trusted:
        return str(load_file(kind, spec, _trusted[-1]).code)
    if code and code.partition(HASH)[0] == Path(spec).name:
        return code
    raise InputError(
        f"'{spec.partition(HASH)[0]}' is code that is not loaded; add --trust if you know what it does (in Python: "
        "load_code)",
        field=field_of(kind) if kind in KINDS else kind,
    )


def resolve_codes(values: Any, path: str = "") -> Any:
    """Return the values of a data file with hashes added to references to code, loaded if that is allowed."""
    if isinstance(values, Mapping):
        return {key: resolve_codes(value, f"{path}.{key}") for key, value in values.items()}
    if isinstance(values, list | tuple):
        return [resolve_codes(value, path) for value in values]
    # In a study the section is not the first part: it may be below ``grid``, where a key may be "strategy.name".
    section = [kind for kind in KINDS if is_code(values) and path.endswith(f".{field_of(kind)}")]
    return resolve_code(section[0], values) if section else values


def load_code(code: str, folder: str | Path | None = None) -> str:
    """Run a file of your own, and register the object in it that ``code`` names, such as a strategy.

    Args:
        code: ``counter.py:counter``, the file and the object in it. folder: folder that a relative path starts from;
            None: the working directory.
    Returns:
        The reference for scenarios (``strategy.name``, ``network.name``, ``sensor.model``, ``task.name``), for
        ``motion`` or for the ``method`` of a search: ``code`` with a hash of the file.
    Raises:
        InputError: there is no such file or object. CodeError: the file raised an error.
    """
    return str(load_file(None, code, None if folder is None else Path(folder)).code)


def load_file(kind: str | None, spec: str, folder: Path | None = None) -> Any:
    """Load a file, and register and return the object in it that ``path.py:name`` refers to."""
    path_text, _, name = spec.partition(HASH)[0].rpartition(":")
    path = Path(folder or "", path_text)
    text = read_text(path, f"a {kind or 'file of code'}")
    digest = hashlib.sha256(text.encode()).hexdigest()
    expected = spec.partition(HASH)[2]
    if expected and expected != digest:
        raise InputError(
            f"'{path}' is not the file that was used: its SHA-256 begins with {digest[:12]}, "
            f"that of the file used with {expected[:12]}",
            field=f"{kind}.code" if kind else path_text,
        )
    return install(kind, f"{path.name}:{name}{HASH}{digest}", text, str(path))


def texts_of(codes: Iterable[str | None]) -> tuple[tuple[str, str], ...]:
    """Return references to code with the texts of their files, for ``install_all`` in a worker process."""
    return tuple((code, _texts[code]) for code in sorted({code for code in codes if code in _texts}))


def install_all(texts: Iterable[tuple[str, str]]) -> None:
    """Register the objects that ``texts_of`` returned in another process or on another machine."""
    for code, text in texts:
        install(None, code, text)


def install(kind: str | None, code: str, text: str, file: str | None = None) -> Any:
    """Register and return an object defined by the text of a file: of a user's file, or of a worker's copy of it."""
    name, file = name_in(code), file or code.partition(HASH)[0].rpartition(":")[0]
    # The module is named by the hash, so that a text is executed only once, even if it defines several objects.
    module_name = f"vibroswarm_file_{code.partition(HASH)[2][:16]}"
    with _executing:
        module = sys.modules.get(module_name) or _module(module_name, text, file)
    found: Any = vars(module).get(name)
    found_kind = kind_of(found)
    if found_kind is None or kind not in (None, found_kind) or found.name != name:
        names = [key for key, one in vars(module).items() if kind_of(one) in ([kind] if kind else KINDS)]
        raise InputError(
            f"has no {kind or 'object'} '{name}'{nearest(name, names)}; it has {', '.join(names) or 'none'}",
            field=file,
        )
    known = KINDS[found_kind].known().get(name)
    if known is found:
        raise InputError(f"registers '{name}' itself; leave out register(...)", field=file)
    if known is None or known.source != text:
        known = KINDS[found_kind].register(replace(found, source=text, code=code))
    _texts[code] = text
    return known


def kind_of(found: object) -> str | None:
    """Return the kind of an object, one of ``KINDS``, or None if it is of no kind."""
    return next((kind for kind, info in KINDS.items() if isinstance(found, info.declared)), None)


def known_for(kind: str, name: object) -> Mapping[str, Any]:
    """Return all registered objects of a kind, by name, and the one that an installed package offers as ``name``."""
    known = KINDS[kind].known
    if isinstance(name, str) and name not in known():
        load_installed(kind, name)
    return known()


def found(kind: str, name: str) -> Any:
    """Return the object of that name, or of a reference to code (``resolve_code``)."""
    name = name_in(resolve_code(kind, name)) if is_code(name) else name
    known = known_for(kind, name)
    if not isinstance(name, str) or name not in known:
        raise unknown(kind, name, known, field_of(kind))
    return known[name]


def load_installed(kind: str, name: str | None = None) -> None:
    """Register the objects of a kind that installed packages offer as entry points, or that of one ``name``."""
    points = entry_points(group=KINDS[kind].group)
    for point in points if name is None else points.select(name=name):
        loaded: Any = point.load()
        if loaded.name not in KINDS[kind].known():
            KINDS[kind].register(loaded)


def _module(name: str, text: str, file: str) -> ModuleType:
    """Execute a text as a new module; errors name ``file`` and the line."""
    module = ModuleType(name)
    module.__file__ = file
    # With the text in linecache, tracebacks and ``inspect.getsource`` work although a worker has no such file. None in
    # place of the time of the file's last change keeps linecache from looking for the file.
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    setattr(module, TEXT, text)  # linecache has the text of one of the files that have this name
    sys.modules[name] = module
    # dont_inherit: without it, this module's ``from __future__ import annotations`` would apply to the text too.
    try:
        with errors_in(f"{file}:"):
            exec(compile(text, file, "exec", dont_inherit=True), vars(module))  # noqa: S102  (the user asked for it by name)
    except BaseException:
        del sys.modules[name]  # so that the text is executed again at the next attempt
        raise
    return module
