"""Plain text and pictures as HTML: escaped text, code, minus signs; inline SVG whose ids clash with no other one."""

from __future__ import annotations

import html
import re
from typing import Final
from xml.etree import ElementTree

from vibroswarm.errors import InputError


def escape(text: object) -> str:
    """Escape text for HTML elements and attributes; replace lone surrogates and drop control characters."""
    valid = str(text).encode("utf-8", "replace").decode("utf-8")
    return html.escape(re.sub(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]", "", valid))


def code_html(text: str) -> str:
    """Escape text, mark words between backticks as code, and keep numbers and units on one line."""
    kept = re.sub(r"(?<=\d) (?=(?:%|s|ms|m|mm)(?!\w))", "\u00a0", text)
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(kept))


def minus_signs(text: str) -> str:
    """Replace hyphens before numbers by minus signs: ``[-1.0, +2.0]``, not ``2-3``."""
    return re.sub(r"(?<![\w\])-])-(?=\d)", "\u2212", text)


MOST_CHARACTERS: Final = 3_000_000
"""Size of one picture; a larger one should be rasterised by whoever draws it."""

DROPPED: Final = frozenset({"metadata", "style", "title", "desc", "script"})


def inline_svg(text: str, prefix: str, label: str) -> tuple[str, float]:
    """Turn an SVG document into an element for HTML; return it with its natural width in CSS pixels.

    Nothing outside the page is loaded: its content security policy forbids it, and scripts too.

    Args:
        text: the document; anything before its root element (such as a DTD) is ignored.
        prefix: put before each id, so that no two pictures on a page share one.
        label: what screen readers say in its place.

    Raises:
        InputError: it is not SVG or too large.
    """
    if len(text) > MOST_CHARACTERS:
        raise InputError(f"has {len(text):,} characters; a page takes {MOST_CHARACTERS:,}", field="svg")
    try:
        root = ElementTree.fromstring(text[max(text.find("<svg"), 0) :])
    except ElementTree.ParseError as error:
        raise InputError(f"is not an SVG: {error}", field="svg") from None
    if _local(root.tag) != "svg" or not root.get("viewBox"):
        raise InputError("is not an SVG with a viewBox", field="svg")
    width = float(re.split(r"[\s,]+", root.get("viewBox", "").strip())[2]) * 96 / 72
    drawing = _prefixed(root, prefix)
    for name in ("width", "height"):
        drawing.attrib.pop(name, None)
    drawing.attrib.update({"role": "img", "aria-label": label, "class": "drawing"})
    return ElementTree.tostring(drawing, encoding="unicode"), width


def _local(tag: str) -> str:
    return tag.rpartition("}")[2]


def _prefixed(element: ElementTree.Element, prefix: str) -> ElementTree.Element:
    """Copy an element without namespaces, with a prefix before its ids and references to them."""
    copy = ElementTree.Element(_local(element.tag))
    copy.text, copy.tail = element.text, element.tail
    for key, value in element.attrib.items():
        name = _local(key)
        if name == "id":
            value = prefix + value
        elif name == "href":
            value = re.sub("^#", f"#{prefix}", value)
        if name not in ("version", "type", "space"):
            copy.set(name, re.sub(r"url\(#([\w.-]+)\)", rf"url(#{prefix}\1)", value))
    for child in element:
        if isinstance(child.tag, str) and _local(child.tag) not in DROPPED:
            copy.append(_prefixed(child, prefix))
    return copy
