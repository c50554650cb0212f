"""Convert plain text and SVG pictures to HTML: escaped text, code, minus signs, and inline SVG with unique ids."""

from __future__ import annotations

import html
import re
from typing import Final
from xml.etree import ElementTree

from vibroswarm.errors import InputError


def escape(text: object) -> str:
    """Escape text for HTML elements and attributes.

    Lone surrogates, which UTF-8 cannot encode, become "?". Control characters are dropped, except for tabs, line feeds
    and carriage returns.
    """
    valid = str(text).encode("utf-8", "replace").decode("utf-8")
    return html.escape(re.sub(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]", "", valid))


def code_html(text: str) -> str:
    """Escape text, mark words between backticks as code, and keep a number and its unit, or an option, on one line."""
    unbroken = re.sub(r"(?<=\d) (?=(?:%|s|ms|m|mm)(?!\w))", "\u00a0", text)  # a space that does not break
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", unbroken_options(escape(unbroken)))


def unbroken_options(markup: str) -> str:
    """Mark options such as ``--spread-mm`` in HTML, so that the page's style keeps each on one line."""
    return re.sub(r"(?<![\w-])--[a-z][\w-]*", r'<span class="option">\g<0></span>', markup)


def minus_signs(text: str) -> str:
    """Replace the hyphen of a negative number by a minus sign, as in ``[-1.0, +2.0]``, but not that of ``2-3``.

    A hyphen before a digit belongs to a number unless it follows a letter, a digit, an underscore, a closing bracket
    or another hyphen.
    """
    return re.sub(r"(?<![\w\])-])-(?=\d)", "\u2212", text)


MOST_CHARACTERS: Final = 3_000_000
"""Largest picture; the parts of a larger one should be rasterised when it is drawn."""

DROPPED: Final = frozenset({"metadata", "style", "title", "desc", "script"})
"""SVG elements that are left out. A style would apply to the whole page; the page's style sheet has the same rules for
pictures alone. A label takes the place of title and desc."""


def inline_svg(text: str, prefix: str, label: str) -> tuple[str, float]:
    """Convert an SVG document to an element for HTML; return the element and its natural width in CSS pixels.

    References to outside the page and scripts need no check here: the page's content security policy blocks them.

    Args:
        text: the document; anything before its root element (such as a DTD) is ignored.
        prefix: put before each id, so that no two pictures on a page have the same ids.
        label: text that screen readers read in place of the picture.
    Raises:
        InputError: it is not SVG, has no viewBox, or is too large.
    """
    if len(text) > MOST_CHARACTERS:
        raise InputError(f"has {len(text):,} characters; a page takes {MOST_CHARACTERS:,}", field="svg")
    start = max(text.find("<svg"), 0)  # without "<svg" the whole text is parsed, and refused below
    try:
        root = ElementTree.fromstring(text[start:])
    except ElementTree.ParseError as error:
        raise InputError(f"is not an SVG: {error}", field="svg") from None
    if _without_namespace(root.tag) != "svg" or not root.get("viewBox"):
        raise InputError("is not an SVG with a viewBox", field="svg")
    # The viewBox is "x y width height" in points, of which 72 make an inch; an inch is 96 CSS pixels.
    width = float(re.split(r"[\s,]+", root.get("viewBox", "").strip())[2]) * 96 / 72
    drawing = _prefixed(root, prefix)
    for name in ("width", "height"):  # the page sets the size
        drawing.attrib.pop(name, None)
    drawing.attrib.update({"role": "img", "aria-label": label, "class": "drawing"})
    return ElementTree.tostring(drawing, encoding="unicode"), width


def _without_namespace(tag: str) -> str:
    return tag.rpartition("}")[2]


def _prefixed(element: ElementTree.Element, prefix: str) -> ElementTree.Element:
    """Copy an element and its children for a page: without namespaces and ``DROPPED`` elements, and with new ids.

    ``prefix`` is put before each id, and before the id in each reference (``href="#id"``, ``url(#id)``). The attributes
    ``version``, ``type`` and ``xml:space``, which matplotlib's drawings do not need in HTML, are left out.
    """
    copy = ElementTree.Element(_without_namespace(element.tag))
    copy.text, copy.tail = element.text, element.tail
    for key, value in element.attrib.items():
        name = _without_namespace(key)
        if name == "id":
            value = prefix + value
        elif name == "href":
            value = re.sub("^#", f"#{prefix}", value)
        if name not in ("version", "type", "space"):
            copy.set(name, re.sub(r"url\(#([\w.-]+)\)", rf"url(#{prefix}\1)", value))
    for child in element:
        if isinstance(child.tag, str) and _without_namespace(child.tag) not in DROPPED:
            copy.append(_prefixed(child, prefix))
    return copy
