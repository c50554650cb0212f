"""Strategies, networks, tasks, sensors and motions from users' files: ``voter.py:voter`` names an object in a file.

A reference to code is such a name, or the same with the hash of the file: ``voter.py:voter sha256:...``. A data file
is a scenario or study file, which may contain references. Loading a Python file runs it, so a file that a data file
refers to is loaded only inside ``trust_code``. A result keeps the text of the file and its hash, not a path.

Loaded objects are registered by name, like those of this package. Their ``code`` is the reference with hash.
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
from threading import RLock
from types import ModuleType
from typing import Any, Final, NamedTuple, TypeVar

from vibroswarm import networks, sensors, strategies, tasks
from vibroswarm.core.registry import Named, Registry, other_name
from vibroswarm.core.untrusted_files import read_text
from vibroswarm.core.user_code import TEXT
from vibroswarm.errors import InputError, check_kind, nearest, shown
from vibroswarm.networks import Network
from vibroswarm.sensors import SensorModel
from vibroswarm.strategies import Strategy
from vibroswarm.tasks import Task

T = TypeVar("T", bound=Named)

MODULE: Final = "vibroswarm_file"
"""Beginning of the names of modules that are made of users' files."""
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
_code_names: set[str] = set()
"""Names of objects that were loaded from users' files, or that data files refer to as code, loaded or not."""
_executing = RLock()
"""Held while a file is executed: threads of a worker would find its module registered before it defines anything."""
_trusted: list[Path | None] = []
"""Stack of ``trust_code``: the last is the folder in which trusted files are looked for (None: the working directory);
empty while no file is trusted."""


@contextmanager
def trust_code(folder: Path | None = None) -> Iterator[None]:
    """Allow files of code that data files name to be loaded, and so run, inside this context.

    Args:
        folder: folder that relative paths of code start from; None: the working directory.
    """
    _trusted.append(folder)
    try:
        yield
    finally:
        _trusted.pop()


@contextmanager
def search_beside(folder: str | Path | None) -> Iterator[None]:
    """Start relative paths of code from ``folder`` inside this context, if it lies inside ``trust_code``.

    Outside of ``trust_code``, or with None, nothing changes.
    """
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


def is_code_name(name: str) -> bool:
    """Return whether an object of users' code has this name: it was loaded, or a data file refers to it."""
    return name in _code_names


def remember_code_names(values: object) -> None:
    """Remember the names of all objects that values of a data file refer to with a hash, however deeply nested.

    Tables of parameters of such an object are then accepted although its code is not loaded. A reference without a hash
    is refused unless its code can be loaded, by ``resolve_code``, which remembers the name itself.
    """
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
    """Return a reference to code with its hash, and load the code if that is allowed, that is, inside ``trust_code``.

    A reference without hash means the object of this kind and name that is loaded already, if its file has the same
    name and cannot be read, or must not be. If loading is not allowed, a reference that has a hash is returned
    unchanged.

    Args:
        kind: one of ``KINDS``. spec: the reference, with or without hash.
    Raises:
        InputError: the file may not be loaded and ``spec`` has no hash; or as of ``load_file``.
    """
    name = name_in(spec)
    _code_names.add(name)
    known = KINDS[kind].known().get(name)
    # Code that is loaded already is used again if it has the hash required. If no hash is required, and the file can be
    # read, it is read: it may be another file, or have changed.
    if known is not None and known.code:
        code = str(known.code)
        if code == spec:
            return code
        path = Path(spec.rpartition(":")[0])
        can_be_read = bool(_trusted) and (_trusted[-1] or Path()).joinpath(path).is_file()
        if HASH not in spec and not can_be_read and path.name == code.partition(":")[0]:
            return code
    if _trusted:
        return str(load_file(kind, spec, _trusted[-1]).code)
    if HASH in spec:
        return spec
    raise InputError(
        f"{spec} is code; add --trust if you know what it does (in Python: load_code)", field=field_of(kind)
    )


def resolve_codes(values: Any, path: str = "") -> Any:
    """Return the values of a data file with hashes added to references to code, and load the code if that is allowed.

    Args:
        values: nested tables, lists and values. path: the keys that lead to ``values``, each after a dot. Only fields
            such as ``strategy.name`` and ``sensor.model`` are references; their section is the kind.
    Raises:
        InputError: as of ``resolve_code``.
    """
    if isinstance(values, str):
        # A list with the last part but one, such as "strategy"; empty if there is none. In a study the section is not
        # the first part: it may be below ``grid``, where a key may also be the dotted name "strategy.name".
        section = path.split(".")[-2:-1]
        is_name = section and section[0] in KINDS and path.endswith(field_of(section[0]))
        return resolve_code(section[0], values) if is_name and is_code(values) else values
    if isinstance(values, Mapping):
        return {key: resolve_codes(value, f"{path}.{key}") for key, value in values.items()}
    if isinstance(values, list | tuple):
        return [resolve_codes(value, path) for value in values]
    return values


def load_code(code: str, folder: str | Path | None = None) -> str:
    """Run a file of your own, and register the object in it that ``code`` names, such as a strategy.

    Args:
        code: ``counter.py:counter``, the file and the object in it. folder: folder that a relative path starts from;
            None: the working directory.
    Returns:
        The reference for scenarios (``strategy.name``, ``network.name``, ``sensor.model``, ``task.name``), for
        ``motion`` or for the ``method`` of a search: ``code`` with a hash of the file.
    Raises:
        InputError: there is no such file or object, or the file cannot be run.
    """
    check_kind(code, str, "code", "text such as counter.py:counter")
    if not is_code(code):
        raise InputError(f"{shown(code)} is not of the form FILE.py:NAME", field="code")
    return str(load_file(None, code, None if folder is None else Path(folder)).code)


def load_file(kind: str | None, spec: str, folder: Path | None = None) -> Any:
    """Load a file, and register and return the object in it that ``path.py:name`` refers to.

    Args:
        kind: required kind, one of ``KINDS``, or None: any. spec: the reference, with or without hash. folder: folder
            that a relative path starts from; None: the working directory.
    Raises:
        InputError: there is no such file, the file has another hash than ``spec``, or as of ``install`` (an error in
            the file's code is reported with file and line).
    """
    path_text, _, name = spec.partition(HASH)[0].rpartition(":")
    path = Path(path_text) if folder is None else folder / path_text
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


def text_of(code: str) -> str | None:
    """Return the text of a loaded file, by its reference to code with hash; None if it is not loaded."""
    return _texts.get(code)


def texts_of(codes: Iterable[str | None]) -> tuple[tuple[str, str], ...]:
    """Return references to code with the texts of their files, for ``install_all`` in a worker process.

    References that are None or not loaded are left out. Each reference is returned once, in alphabetical order.
    """
    return tuple((code, _texts[code]) for code in sorted({code for code in codes if code in _texts}))


def install_all(texts: Iterable[tuple[str, str]]) -> None:
    """Register the objects that ``texts_of`` returned in another process or on another machine."""
    for code, text in texts:
        install(None, code, text)


def install(kind: str | None, code: str, text: str, file: str | None = None) -> Any:
    """Register and return an object defined by the text of a file: of a user's file, or of a worker's copy of it.

    Args:
        kind: required kind, one of ``KINDS``, or None: any. code: reference to the object, with the hash of ``text``.
            file: path of the file, for errors; None: as in ``code``.
    Returns:
        The registered object; if the same text has been registered before, that object.
    Raises:
        InputError: the text has another hash, cannot be loaded, or defines no such object, or the object's name is
            taken by a different object.
    """
    name, digest = name_in(code), hashlib.sha256(text.encode()).hexdigest()
    file = file or code.partition(HASH)[0].rpartition(":")[0]
    if code.partition(HASH)[2] != digest:
        raise InputError(f"the text is not that of '{code}': its SHA-256 is {digest}", field=file)
    # The module is named by the hash, so that a text is executed only once, even if it defines several objects.
    module_name = f"{MODULE}_{digest[:16]}"
    with _executing:
        module = sys.modules.get(module_name) or _module(module_name, text, file)
    found: Any = vars(module).get(name)
    found_kind = kind_of(found)
    if found_kind is None or kind not in (None, found_kind):
        wanted = KINDS if kind is None else (kind,)
        names = [defined for defined, value in vars(module).items() if kind_of(value) in wanted]
        problem = (
            f"is not a {kind or ', '.join(KINDS)}"
            if name in vars(module)
            else f"is not there{nearest(name, names)}"
        )
        raise InputError(f"'{name}' {problem}; the file has {', '.join(names) or 'none'}", field=file)
    if found.name != name:
        raise InputError(f"'{name}' calls itself '{found.name}'; give both one name", field=file)
    known = KINDS[found_kind].known().get(name)
    if known is None:
        known = KINDS[found_kind].register(replace(found, source=text, code=code))
    elif known is found:
        raise InputError(f"registers '{name}' itself; leave out register(...)", field=file)
    elif known.source != text:
        whose = "another file has been loaded with" if known.source else "vibroswarm has"
        raise InputError(f"{whose} a {found_kind} '{name}' already; {other_name(known)}", field=file)
    _texts[code] = text
    _code_names.add(name)
    return known


def kind_of(found: object) -> str | None:
    """Return the kind of an object, one of ``KINDS``, or None if it is of no kind."""
    return next((kind for kind, info in KINDS.items() if isinstance(found, info.declared)), None)


def known_for(kind: str, name: object, *, is_field: bool = False) -> Mapping[str, Any]:
    """Return all registered objects of a kind, by name.

    Args:
        kind: one of ``KINDS``. name: if no object has this name, what installed packages offer by it is registered
            first, or if they do not, all that they offer; None: they are not searched. is_field: the name may be that
            of a field, for which not all is loaded.
    Raises:
        InputError: an object of an installed package cannot be loaded.
    """
    known = KINDS[kind].known
    if isinstance(name, str) and name not in known():
        load_installed(kind, name)
        if not is_field and name not in known():
            load_installed(kind)
    return known()


def found(kind: str, name: str, registry: Registry[T]) -> T:
    """Return the object of that name, or of a file that is already loaded (``FILE.py:NAME`` with the file's hash).

    Args:
        kind: one of ``KINDS``. registry: of this kind.
    Raises:
        InputError: there is no such object, or its file is not loaded; the message suggests a similar name.
    """
    if not is_code(name):
        known_for(kind, name)  # if the name is not known yet, registers the objects of installed packages
        return registry.get(name)
    known: Any = registry.known().get(name_in(name))
    if known is None or known.code != name:
        raise not_loaded(name, registry.field)
    return known  # type: ignore[no-any-return]


def not_loaded(code: str, field: str) -> InputError:
    """Return the error that the file of a reference to code is not loaded; ``field`` names what selects the object."""
    return InputError(
        f"'{code.partition(HASH)[0]}' is not loaded; add --trust to run the file (in Python: load_code)",
        field=field,
    )


def load_installed(kind: str, name: str | None = None) -> None:
    """Register the objects of a kind that installed packages offer as entry points (``vibroswarm.strategies``, ...).

    An object whose name is taken already is left out.

    Args:
        name: of the entry points to load, as others may be broken; None: all of the kind.
    Raises:
        InputError: an entry point cannot be loaded, or is not of its group's kind, or another one has its name.
    """
    declared, register, known, group, _ = KINDS[kind]
    points, offered = entry_points(group=group), dict[str, tuple[str, Any]]()
    for point in points if name is None else points.select(name=name):
        try:
            loaded: Any = point.load()
        except Exception as error:  # whatever the package's code raises
            raise InputError(
                f"cannot be loaded: {type(error).__name__}: {error}", field=point.value
            ) from None
        if not isinstance(loaded, declared):
            raise InputError(f"is not a {kind}", field=point.value)
        # Objects of every kind have a name; ``vars``, because a type checker takes ``loaded`` for a plain object.
        own = vars(loaded)["name"]
        if own in known():
            continue
        first, other = offered.setdefault(own, (point.value, loaded))
        if other is not loaded:
            raise InputError(
                f"is another {kind} '{own}' than {first}; uninstall or rename one of them", field=point.value
            )
    for _, loaded in offered.values():
        register(loaded)


def _module(name: str, text: str, file: str) -> ModuleType:
    """Execute a text as a new module, and return it.

    Args:
        name: of the module. text: Python code. file: path of the file, for errors.
    Raises:
        InputError: the code raised an error; the file and the line are named.
    """
    module = ModuleType(name)
    module.__file__ = file
    # With the text in linecache, tracebacks and ``inspect.getsource`` work although a worker has no such file. None in
    # place of the time of the file's last change keeps linecache from looking for the file.
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    setattr(module, TEXT, text)  # linecache has the text of one of the files that have this name
    sys.modules[name] = module
    # dont_inherit: without it, this module's ``from __future__ import annotations`` would apply to the text too.
    try:
        exec(compile(text, file, "exec", dont_inherit=True), vars(module))  # noqa: S102  (the user asked for it by name)
    except KeyboardInterrupt:
        del sys.modules[name]  # so that the text is executed again at the next attempt
        raise
    except BaseException as error:  # SystemExit too, which would end the program
        del sys.modules[name]
        if isinstance(error, InputError) and str(error).startswith(f"{file}, line "):
            raise error from None  # of ``check_function``, which names the line of the function
        raise InputError(_reason(error, file), field=file) from None
    return module


def _reason(error: BaseException, file: str) -> str:
    """Return why a file cannot be loaded and the line, from the error that its code raised."""
    if isinstance(error, SyntaxError) and error.filename == file:
        return f"cannot be loaded: SyntaxError: {error.msg} (line {error.lineno})"
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == file]
    reason = (
        str(error) if isinstance(error, InputError) else f"cannot be loaded: {type(error).__name__}: {error}"
    )
    return f"{reason} (line {lines[-1]})" if lines else reason
