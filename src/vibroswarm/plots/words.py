"""Words in pictures: names made to fit, numbers made short, counts of runs."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Sequence
from functools import lru_cache

ELLIPSIS = "…"
NARROWEST_EM = 0.27
"""Width of the letter i, less a little: no more letters than this allows can fit."""


def plain(text: object) -> str:
    """Text that every format can hold: control letters become spaces, halves of letters a replacement mark."""
    cleaned = "".join(
        " " if unicodedata.category(letter) in ("Cc", "Zl", "Zp") else letter for letter in str(text)
    )
    return cleaned.encode("utf-8", "replace").decode("utf-8").replace("\ufffe", "?").replace("\uffff", "?")


def width_pt(text: str, size_pt: float) -> float:
    """Width of a line of text in the pictures' font, points; letter by letter, without kerning."""
    return size_pt * sum(map(_letter_em, text))


@lru_cache(maxsize=4096)
def _letter_em(letter: str) -> float:
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    font = FontProperties(family="DejaVu Sans", size=100)
    between = f"|{letter}|"  # of a space alone no width would be told
    width, bars = (
        text_to_path.get_text_width_height_descent(text, font, ismath=False)[0] for text in (between, "||")
    )
    return float(width - bars) / 100


def fitted(text: object, size_pt: float, room_pt: float, lines: int = 1) -> str:
    """Text broken into at most ``lines`` lines of ``room_pt``; what is too long loses its middle.

    It breaks behind spaces and the signs that join parts of paths and names.
    """
    whole = plain(text).strip()
    most = int(lines * room_pt / (size_pt * NARROWEST_EM)) + 1
    for kept in range(min(len(whole), most), 0, -1):
        shorter = whole if kept == len(whole) else _without_middle(whole, kept)
        broken = _broken(shorter, size_pt, room_pt)
        if len(broken) <= lines:
            return "\n".join(broken)
    return ELLIPSIS if whole else ""


def fitted_names(names: Sequence[object], size_pt: float, room_pt: float, lines: int = 1) -> list[str]:
    """``fitted`` for many names: those that would look alike though they differ are numbered."""
    made = [fitted(name, size_pt, room_pt, lines) for name in names]
    seen: dict[str, set[str]] = {}
    for name, short in zip(names, made, strict=True):
        seen.setdefault(short, set()).add(str(name))
    return [
        short if len(seen[short]) == 1 else fitted(f"{place}) {plain(name)}", size_pt, room_pt, lines)
        for place, (name, short) in enumerate(zip(names, made, strict=True), start=1)
    ]


def _without_middle(text: str, kept: int) -> str:
    head = math.ceil(kept * 0.4)
    tail = kept - head
    return text[:head].rstrip() + ELLIPSIS + (text[-tail:].lstrip() if tail else "")


def _broken(text: str, size_pt: float, room_pt: float) -> list[str]:
    lines = [""]
    for piece in re.findall(r"[^\s/\\_=,;:.+-]*[\s/\\_=,;:.+-]+|[^\s/\\_=,;:.+-]+", text):
        longer = lines[-1] + piece
        if lines[-1] and width_pt(longer.rstrip(), size_pt) > room_pt:
            lines.append(piece.lstrip())
        else:
            lines[-1] = longer
        while width_pt(lines[-1].rstrip(), size_pt) > room_pt and len(lines[-1]) > 1:
            cut = next(
                (n for n in range(len(lines[-1]) - 1, 1, -1) if width_pt(lines[-1][:n], size_pt) <= room_pt),
                1,
            )
            lines[-1:] = [lines[-1][:cut], lines[-1][cut:]]
    return [line.strip() for line in lines]


def number(value: float | None, digits: int = 3) -> str:
    """A number in ``digits`` significant digits without needless zeros; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    if value and abs(value) >= 10**digits:
        text = f"{value:.0f}" if abs(value) < 1e6 else f"{value:.{digits - 1}e}"
    else:
        text = f"{value:.{digits}g}"
    return ("0" if text in ("-0", "0") else text).replace("-", "−")


def share(part: float, whole: float) -> str:
    """A share in percent that never rounds some to none, nor nearly all to all."""
    if not whole:
        return "–"
    percent = 100 * part / whole
    if 0 < percent < 0.1:
        return "< 0.1 %"
    if 99.9 < percent < 100:
        return "> 99.9 %"
    return f"{percent:.0f} %" if percent in (0, 100) or 1 <= percent <= 99 else f"{percent:.1f} %"


def of_runs(counts: Sequence[int], unit: str = "run") -> str:
    """``1000 runs each``, ``12 to 1000 runs each``, ``1 run``."""
    least, most = min(counts), max(counts)
    units = unit if most == 1 else f"{unit}s"
    each = " each" if len(counts) > 1 else ""
    return f"{most} {units}{each}" if least == most else f"{least} to {most} {units}{each}"
