"""A document as plain values, which a folder keeps to show it again; without figures and photographs."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

from vibroswarm.errors import InputError
from vibroswarm.show.data import plain
from vibroswarm.show.document import Document, without_pictures

if TYPE_CHECKING:
    from pydantic import TypeAdapter


def document_values(document: Document) -> dict[str, Any]:
    """Return a document as values that JSON has, from which ``document_from`` makes it again."""
    kept = without_pictures(document)
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


@cache
def _adapter() -> TypeAdapter[Any]:
    """Return what checks and converts documents, by the types of their fields."""
    from pydantic import TypeAdapter

    return TypeAdapter(Document)
