"""Show a public object in an interactive session: on one short line, and as HTML in a notebook.

The line shows the object's class, and as many of its public values as fit. The HTML, and the work that methods of
studies offer, come from layers above; the package's root adds their functions (``above``), so that nothing here
imports upwards.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sized
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

from vibroswarm.core.numbers import count, stated
from vibroswarm.errors import shown

Kind = TypeVar("Kind", bound=type)

above: dict[str, Callable[..., Any]] = {}
"""The functions, by name."""


def html_view(value: object) -> str:
    """Return the HTML that a notebook shows for a public object; texts from scenarios and files are escaped."""
    return str(above["html"](value))


def viewed(kind: Kind) -> Kind:
    """Give a named tuple the view of ``NotebookView``, which cannot be its base."""
    kind._repr_html_ = html_view  # type: ignore[attr-defined]
    return kind


def document_of(value: object) -> Any:
    """Return the document of a result (``vibroswarm.show.document.Document``)."""
    return above["document"](value)


def study_verbs() -> Any:
    """Return ``vibroswarm.study.evaluation``, the functions behind methods of ``Study`` and ``StudyResult``."""
    return above["study verbs"]()


MOST_CHARACTERS: Final = 180
"""Length up to which values are added to an object's line; parentheses and ``...`` are not counted."""


def short_text(value: object) -> str:
    """Return ``Name(field=value, field=value)`` on one line.

    ``...`` replaces the first field that does not fit in MOST_CHARACTERS, and all fields after it.
    """
    name, text = type(value).__name__, ""
    for field, content in public_values(value).items():
        part = f"{', ' if text else ''}{field}={short_value(content)}"
        if len(name) + len(text) + len(part) > MOST_CHARACTERS:
            return f"{name}({text}{', ' if text else ''}...)"
        text += part
    return f"{name}({text})"


def public_values(value: object) -> dict[str, Any]:
    """Return the public fields of a dataclass, a named tuple or any other object: name to value.

    An object that has no ``__dict__``, such as a number, has none.
    """
    if is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in fields(value) if field.name[0] != "_"}
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return dict(zip(value._fields, value, strict=True))
    return {name: content for name, content in getattr(value, "__dict__", {}).items() if name[0] != "_"}


def short_value(value: object) -> str:
    """Return a value as it is shown in ``short_text``.

    Texts are cut to 60 characters, and floats have six significant digits. Arrays, tables and collections are shown by
    their size only, but a list or tuple of at most three numbers in full. A function is shown by its name, and any
    other object by the name of its class, with its length if it has one.
    """
    if value is None or isinstance(value, bool | int | str | Path):
        return shown(str(value) if isinstance(value, Path) else value)
    if isinstance(value, float):
        return stated(value)
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple):  # an array or a table
        if hasattr(value, "columns"):  # a table
            return count(shape[0], "row")
        # An empty shape is that of a single number, such as np.int64(3).
        return shown(value.item()) if not shape and hasattr(value, "item") else f"array {shape}"
    # A dataclass, a named tuple or a Pydantic model.
    if is_dataclass(value) or hasattr(value, "_fields") or hasattr(type(value), "model_fields"):
        return type(value).__name__
    if isinstance(value, tuple | list) and len(value) <= 3 and all(isinstance(v, int | float) for v in value):
        return f"({', '.join(short_value(v) for v in value)})"
    if isinstance(value, Mapping | tuple | list | set | frozenset):
        return count(len(value), "item")
    if callable(value) and hasattr(value, "__name__"):
        return str(value.__name__)
    return f"{type(value).__name__} of {len(value)}" if isinstance(value, Sized) else type(value).__name__


class NotebookView:
    """Base of public classes: a short ``repr``, and a view as HTML."""

    __slots__ = ()

    def __init_subclass__(cls, **settings: Any) -> None:
        """Give each subclass a ``__repr__`` of its own, so that ``@dataclass`` does not write one with all its tables.

        ``@dataclass`` writes a ``__repr__`` unless the class itself defines one; an inherited one does not count. So
        the inherited ``__repr__`` is copied into the subclass.
        """
        super().__init_subclass__(**settings)
        if "__repr__" not in vars(cls):
            cls.__repr__ = cls.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        return short_text(self)

    def _repr_html_(self) -> str:
        return html_view(self)
