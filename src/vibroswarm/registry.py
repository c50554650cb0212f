"""Things that are known by name: strategies, networks, sources of motion, tasks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Generic, Protocol, TypeVar

from vibroswarm.errors import InputError, nearest, shown


class Named(Protocol):
    """What has a name."""

    @property
    def name(self) -> str:
        """By which it is known."""


T = TypeVar("T", bound=Named)


class Registry(Generic[T]):
    """What is known of one kind.

    Args:
        kind: in words. field: that a user names one by.
    """

    def __init__(self, kind: str, field: str) -> None:
        self.kind, self.field = kind, field
        self._known: dict[str, T] = {}

    def register(self, one: T) -> T:
        """Make one known by its name; gives it back, or its equal that is known already.

        Raises:
            InputError: another of that name is known.
        """
        if self._known.setdefault(one.name, one) != one:
            raise InputError(f"there is a {self.kind} '{one.name}' already", field="name")
        return self._known[one.name]

    def forget(self, name: str) -> None:
        """Make one unknown again, if it was known."""
        self._known.pop(name, None)

    def names(self) -> tuple[str, ...]:
        """Names of all, as they became known."""
        return tuple(self._known)

    def known(self) -> Mapping[str, T]:
        """All by name."""
        return self._known

    def get(self, name: str) -> T:
        """The one of that name.

        Raises:
            InputError: there is none; the nearest is named.
        """
        if not isinstance(name, str) or name not in self._known:
            raise InputError(
                f"there is no {self.kind} {shown(name)}{nearest(name, self._known)} "
                f"(there are {', '.join(self._known)})",
                field=self.field,
            )
        return self._known[name]
