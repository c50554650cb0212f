"""A document as plain values: for JSON (answer and named tables), and whole but for its pictures, to show it again."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

from pydantic import TypeAdapter, ValidationError

from vibroswarm.errors import InputError
from vibroswarm.show.document import Document, without_pictures


def document_data(document: Document) -> dict[str, Any]:
    """Return a document as values that JSON has; numbers that are not finite become None.

    Returns: ``answer``, ``robots_were_told`` and ``warnings`` (lists of sentences), ``tables`` (by name: a list of rows
        by column) and ``made_by``.
    """
    frames = {name: table.frame for name, table in document.tables.items()} | dict(document.data)
    return {
        "answer": list(document.answer),
        "robots_were_told": list(document.knew),
        "warnings": list(document.warnings),
        "tables": {name: plain(frame.to_dicts()) for name, frame in frames.items()},
        "made_by": dict(document.made_by),
    }


def plain(value: Any) -> Any:
    """Return a value for JSON: a float that is not finite becomes None, what is in collections too."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {name: plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    return value


def document_values(document: Document) -> dict[str, Any]:
    """Return a document as values that JSON has, from which ``document_from`` makes it again, without its pictures."""
    values: dict[str, Any] = plain(
        _document_adapter().dump_python(without_pictures(document), exclude_defaults=True)
    )
    return values


def document_from(values: object, name: str) -> Document:
    """Make the document that ``document_values`` has written.

    Args:
        values: as read from JSON. name: of the file, for errors.
    Raises:
        InputError: it is damaged, or something else.
    """
    try:
        return _document_adapter().validate_python(values)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"])) or "it"
        raise InputError(f"is damaged: {place}: {first['msg']}", field=name) from None


@cache
def _document_adapter() -> TypeAdapter[Document]:
    return TypeAdapter(Document)
