"""A document as plain values, which a folder keeps to show it again; without figures and photographs."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any

from vibroswarm.errors import InputError
from vibroswarm.show.data import plain
from vibroswarm.show.document import Document, Figure, Part, Photos, Section

if TYPE_CHECKING:
    from pydantic import TypeAdapter


def document_values(document: Document) -> dict[str, Any]:
    """Return a document as values that JSON has, from which ``document_from`` makes it again."""
    kept = replace(document, parts=_without_pictures(document.parts))
    values: dict[str, Any] = plain(_adapter().dump_python(kept, exclude_defaults=True))
    return values


def document_from(values: object, name: str) -> Document:
    """Make the document that ``document_values`` has written.

    Args:
        values: as read from JSON. name: of the file, for errors.
    Raises:
        InputError: it is damaged, or something else.
    """
    from pydantic import ValidationError

    try:
        document: Document = _adapter().validate_python(values)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "it"
        raise InputError(f"is damaged: {place}: {first['msg']}", field=name) from None
    return document


def _without_pictures(parts: tuple[Part, ...]) -> tuple[Part, ...]:
    return tuple(
        replace(part, parts=_without_pictures(part.parts)) if isinstance(part, Section) else part
        for part in parts
        if not isinstance(part, Figure | Photos)
    )


@cache
def _adapter() -> TypeAdapter[Any]:
    """Return what checks and converts documents, by the types of their fields."""
    from pydantic import TypeAdapter

    return TypeAdapter(Document)
