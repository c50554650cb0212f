"""Write plain text into HTML."""

from __future__ import annotations

import html
import re


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
