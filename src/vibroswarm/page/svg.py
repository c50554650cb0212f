"""A picture's SVG made fit to stand in a page: only known elements, no ids that clash, no address but its own."""

from __future__ import annotations

import re
from typing import Final
from xml.etree import ElementTree

from vibroswarm.errors import InputError

SVG_UP_TO: Final = 3_000_000
"""Characters of one picture; what is larger should have been painted as an image by who made it."""

ELEMENTS: Final = frozenset(
    [
        "svg",
        "g",
        "defs",
        "path",
        "use",
        "clipPath",
        "pattern",
        "rect",
        "circle",
        "ellipse",
        "line",
        "polyline",
        "polygon",
        "text",
        "tspan",
        "image",
    ]
)
DROPPED: Final = frozenset({"metadata", "style", "title", "desc"})
ATTRIBUTES: Final = frozenset(
    [
        "id",
        "style",
        "d",
        "transform",
        "x",
        "y",
        "x1",
        "y1",
        "x2",
        "y2",
        "dx",
        "dy",
        "width",
        "height",
        "r",
        "rx",
        "ry",
        "cx",
        "cy",
        "points",
        "href",
        "clip-path",
        "fill",
        "stroke",
        "stroke-width",
        "stroke-linejoin",
        "stroke-linecap",
        "opacity",
        "viewBox",
        "preserveAspectRatio",
        "patternUnits",
        "patternTransform",
        "patternContentUnits",
        "clipPathUnits",
        "clip-rule",
        "fill-rule",
        "text-anchor",
        "font-size",
    ]
)

_PICTURE: Final = re.compile(r"data:image/png;base64,[A-Za-z0-9+/=\s]*")
_OWN: Final = re.compile(r"url\(#([\w.-]+)\)")


def inline_svg(text: str, prefix: str, label: str) -> tuple[str, float]:
    """An SVG document as an element for HTML, and its natural width in CSS pixels.

    Args:
        text: the document; what stands before its root (a DTD with entities, say) is not read.
        prefix: put before each id, so that no two pictures of a page share one.
        label: what is read aloud in its place.

    Raises:
        InputError: it is no SVG, too large, or holds an element, attribute or address that a picture has no need of.
    """
    if len(text) > SVG_UP_TO:
        raise InputError(f"has {len(text):,} characters; a page takes {SVG_UP_TO:,}", field="svg")
    try:
        root = ElementTree.fromstring(text[max(text.find("<svg"), 0) :])
    except ElementTree.ParseError as error:
        raise InputError(f"is no SVG: {error}", field="svg") from None
    if _local(root.tag) != "svg" or not root.get("viewBox"):
        raise InputError("is no SVG with a viewBox", field="svg")
    clean = _clean(root, prefix)
    width = float(re.split(r"[\s,]+", root.get("viewBox", "").strip())[2]) * 96 / 72
    for name in ("width", "height"):
        clean.attrib.pop(name, None)
    clean.attrib.update({"role": "img", "aria-label": label, "class": "drawing"})
    return ElementTree.tostring(clean, encoding="unicode"), width


def _local(tag: str) -> str:
    return tag.rpartition("}")[2]


def _clean(element: ElementTree.Element, prefix: str) -> ElementTree.Element:
    tag = _local(element.tag)
    if tag not in ELEMENTS:
        raise InputError(f"holds an element <{tag}>, which no picture needs", field="svg")
    clean = ElementTree.Element(tag)
    clean.text, clean.tail = element.text, element.tail
    for name, value in element.attrib.items():
        kept = _attribute(_local(name), value, prefix)
        if kept is not None:
            clean.set(_local(name), kept)
    for child in element:
        if isinstance(child.tag, str) and _local(child.tag) not in DROPPED:
            clean.append(_clean(child, prefix))
    return clean


def _attribute(name: str, value: str, prefix: str) -> str | None:
    if name in ("version", "type", "space"):
        return None
    if name not in ATTRIBUTES:
        raise InputError(f"holds an attribute {name}, which no picture needs", field="svg")
    if name == "id":
        return prefix + value
    if name == "href":
        if value.startswith("#"):
            return f"#{prefix}{value[1:]}"
        if not _PICTURE.fullmatch(value):
            raise InputError("refers to something outside it", field="svg")
        return value
    if re.search(r"url\(|@|\\", _OWN.sub("", value)):
        raise InputError("refers to something outside it", field="svg")
    return _OWN.sub(lambda match: f"url(#{prefix}{match[1]})", value)
