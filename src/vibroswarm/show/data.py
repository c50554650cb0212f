"""A document as plain values for JSON: the answer and the named tables, not titles and captions."""

from __future__ import annotations

import math
from typing import Any

from vibroswarm.show.document import Document


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
