"""Registries of named objects: strategies, networks, motion sources, tasks."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

from vibroswarm.errors import InputError, nearest, shown

T = TypeVar("T", bound=Any)
"""Objects with a ``name``."""

REGISTERED: Final = re.compile(r"= register\(\s*\w+\(\s*(?:__name__,\s*)?(?:name=)?\"(\w+)\"")
"""How a file of this package registers an object, with its name."""


def unknown(kind: str, name: object, known: Iterable[str], field: str) -> InputError:
    """Return the error that no object of a kind has this name; it suggests a similar name and lists all."""
    known = list(known)
    return InputError(
        f"there is no {kind} {shown(name)}{nearest(name, known)} (there are {', '.join(known)})", field=field
    )


def written_names(folder: str, suffix: str = ".py") -> list[str]:
    """Return the sorted names that files of a folder of this package register; importing these would be slow."""
    files = (Path(__file__).parents[1] / folder).glob(f"*{suffix}")
    if suffix != ".py":
        return sorted(file.stem for file in files)
    return sorted(name for file in files for name in REGISTERED.findall(file.read_text(encoding="utf-8")))


class Registry(Generic[T]):
    """The registered objects of one kind, and the setting that selects one, for messages."""

    def __init__(self, kind: str, field: str) -> None:
        self.kind, self.field = kind, field
        self._known: dict[str, T] = {}

    def register(self, one: T) -> T:
        """Register an object under its name; return it, or an equal one that is registered already."""
        registered = self._known.setdefault(one.name, one)
        if registered != one:
            raise InputError(
                f"there is a {self.kind} '{one.name}' already; give yours another name, or call forget before if it "
                "is an earlier one of yours",
                field="name",
            )
        return registered

    def forget(self, name: str) -> None:
        """Remove an object, if it is registered."""
        self._known.pop(name, None)

    def names(self) -> tuple[str, ...]:
        """Return all names, in the order of registration."""
        return tuple(self._known)

    def known(self) -> Mapping[str, T]:
        """Return all objects by name."""
        return self._known

    def get(self, name: str) -> T:
        """Return the object registered under ``name``."""
        if not isinstance(name, str) or name not in self._known:
            raise unknown(self.kind, name, self._known, self.field)
        return self._known[name]
