"""Parts of a report and their HTML: formats of table columns, rows of photographs, and the answers at the top.

An answer is a comparison: a headline, its differences side by side (each with a strip that draws its interval), and a
sentence.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.show.markup import code_html, escape, minus_signs


@dataclass(frozen=True)
class Column(NotebookView):
    """The heading of a column and the format of its numbers."""

    title: str = ""
    """Heading; empty: the column's name."""
    unit: str = ""
    """Empty: "%" if percent."""
    digits: int = 3
    """Significant digits of the largest number; all numbers of a column have the same decimals. The CSV has all."""
    percent: bool = False
    """Whether a share from 0 to 1 is written in percent, or a difference of shares in percentage points."""
    prose: bool = False
    """Whether it holds sentences, which get extra width."""
    tones: Mapping[str, str] = field(default_factory=dict)
    """Tones of cells, of ``TONES``, by the longest matching beginning of their text."""
    decimals: int | None = None
    """Decimals of all numbers; by default one in percent, else by ``digits``."""
    limits: tuple[str, str] | None = None
    """Names of the columns with the lower and the upper limit, which stand in brackets behind each number."""
    p_value: bool = False
    """Whether numbers are p-values; those below 0.001 are written as such."""

    @property
    def units(self) -> str:
        """The unit of the heading."""
        return self.unit or ("%" if self.percent else "")


def decimals_of(values: Iterable[float | None], column: Column) -> int | None:
    """Return the number of decimals with which all numbers of a column are written.

    It is ``column.decimals`` if given, else 1 in percent, else 0 if all numbers are whole. Otherwise the largest number
    gets ``column.digits`` significant digits, and zeros at the end that all numbers have in common are dropped.

    Args:
        values: numbers of the column and their limits; None and numbers that are not finite do not count.
    Returns: the number of decimals; None if the last rule does not suit all numbers: the largest is below 1e-4 or at
        least 1e12, or the smallest above 0 would be written as 0. Then each number is written with decimals of its own.
    """
    if column.decimals is not None:
        return column.decimals
    if column.percent:
        return 1
    sizes = [abs(float(value)) for value in values if value is not None and math.isfinite(value)]
    if all(size.is_integer() for size in sizes):  # also if there are no sizes
        return 0
    largest = max(sizes)
    if not 1e-4 <= largest < 1e12:
        return None
    decimals = max(column.digits - 1 - math.floor(math.log10(largest)), 0)
    smallest = min(size for size in sizes if size > 0)
    if smallest < 0.5 * 10**-decimals:  # it would be written as 0
        return None
    while decimals and all(f"{size:.{decimals}f}".endswith("0") for size in sizes):
        decimals -= 1
    return decimals


def number_text(value: float, column: Column, decimals: int | None = None) -> str:
    """Write a number in the format of its column, with minus signs in place of hyphens.

    Args:
        value: the number, not nan. decimals: number of decimals, from ``decimals_of``; None: 1 in percent, else as many
            as this number needs to have ``column.digits`` significant digits. P-values have three in any case.
    """
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if column.p_value:
        return "< 0.001" if value < 0.001 else f"{value:.3f}"
    if column.percent:
        value, decimals = 100 * value, 1 if decimals is None else decimals
    # Floats of 10^12 and more are written with an exponent, by the last format; integers of any size are written whole.
    # Smaller floats with more than ``column.digits`` digits before the point are written whole too, since the last
    # format would give them an exponent.
    if decimals is not None and abs(value) < 10**12:
        text = f"{value:.{decimals}f}"
        text = text if float(text) else text.removeprefix("-")  # 0, not -0
    elif isinstance(value, int) or (float(value).is_integer() and abs(value) < 10**12):
        text = f"{int(value)}"
    elif abs(value) >= 10**column.digits and abs(value) < 10**12:
        text = f"{value:.0f}"
    else:
        text = f"{value:.{column.digits}g}"
    return text.replace("-", "−")


PICTURE_ADDRESS: Final = re.compile(r"data:image/(?:jpeg|png);base64,[A-Za-z0-9+/=]+")
"""Allowed addresses of photographs. They hold the photograph itself, and no character that has to be escaped."""


@dataclass(frozen=True)
class ReportFrame(NotebookView):
    """A photograph."""

    address: str
    """The picture itself, as a data URI of a JPEG or PNG."""
    words: str
    """What it shows; stands below it."""


@dataclass(frozen=True)
class ReportFrames(NotebookView):
    """Photographs in a row."""

    words: str
    """A sentence above; empty: none."""
    frames: tuple[ReportFrame, ...]


def frames_html(group: ReportFrames, key: str) -> str:
    """Write a row of photographs that wraps where the page is narrow.

    Width and height in the HTML only reserve a square before a photograph is loaded; the style sheet sets the size.

    Args:
        key: id of the HTML element.
    Raises:
        InputError: the address of a photograph is not a data URI of a JPEG or PNG.
    """
    shots = []
    for frame in group.frames:
        if PICTURE_ADDRESS.fullmatch(frame.address) is None:
            raise InputError("must be a data URI of a JPEG or PNG", field="address")
        label = escape(f"{group.words} {frame.words}")
        shots.append(
            f'<figure><img src="{frame.address}" alt="{label}" width="300" height="300" loading="lazy">'
            f"<figcaption>{code_html(frame.words)}</figcaption></figure>\n"
        )
    above = f"<p>{code_html(group.words)}</p>\n" if group.words else ""
    return f'<div class="part shots" id="{key}">\n{above}<div>\n{"".join(shots)}</div>\n</div>\n'


ANSWERS_SHOWN: Final = 3
"""Answers that are not folded."""
STRIP_WIDTH: Final = 200
"""Width of a strip, in units of its drawing."""


@dataclass(frozen=True)
class ReportEffect(NotebookView):
    """A difference in one figure between the two sides of a comparison."""

    title: str
    """Name of the figure."""
    number: str
    """The difference with sign and unit."""
    limits: str
    """Its limits as text; empty: none."""
    estimate: float
    """The difference as a number, from which the strip is drawn."""
    low: float
    """Its lower limit."""
    high: float
    """Its upper limit."""
    tone: str
    """"good", "bad", or "open" if no difference is shown; sets the colour."""
    words: str
    """What the tone means, such as "better"."""


@dataclass(frozen=True)
class ReportAnswer(NotebookView):
    """A comparison."""

    headline: str
    """Heading of the answer."""
    sentence: str
    """The answer in one sentence."""
    aside: str = ""
    """A further remark in small print; empty: none."""
    effects: tuple[ReportEffect, ...] = ()


def answers_html(answers: Sequence[ReportAnswer]) -> str:
    """Write the answers as HTML; those after the first ``ANSWERS_SHOWN`` are hidden until the reader unfolds them."""
    if not answers:
        return ""
    scales = _scales(answers)
    texts = [_answer(answer, scales) for answer in answers]
    rest = len(texts) - ANSWERS_SHOWN
    folded = (
        f"<details>\n<summary>{rest} more comparison{'s' * (rest > 1)}</summary>\n"
        f'<div class="answers">\n{"".join(texts[ANSWERS_SHOWN:])}</div>\n</details>\n'
        if rest > 0
        else ""
    )
    return f'<div class="answers">\n{"".join(texts[:ANSWERS_SHOWN])}</div>\n{folded}'


def _scales(answers: Sequence[ReportAnswer]) -> dict[str, float]:
    """Return for each figure, by its title, its largest finite absolute value over all answers, limits included.

    The strips of a figure in all answers are drawn to this value, so that they have the same scale.
    """
    scales: dict[str, float] = {}
    for answer in answers:
        for effect in answer.effects:
            sizes = [abs(v) for v in (effect.estimate, effect.low, effect.high) if math.isfinite(v)]
            scales[effect.title] = max([scales.get(effect.title, 0.0), *sizes])
    return scales


def _answer(answer: ReportAnswer, scales: dict[str, float]) -> str:
    """Write one answer as HTML; ``scales`` has for each figure, by title, the value at the right end of its strips."""
    effects = "".join(_effect(effect, scales[effect.title]) for effect in answer.effects)
    strip = f'<div class="effects">\n{effects}</div>\n' if effects else ""
    aside = f'<p class="aside">{code_html(minus_signs(answer.aside))}</p>\n' if answer.aside else ""
    return (
        f'<section class="answer">\n<h2>{escape(answer.headline)}</h2>\n{strip}'
        f"<p>{code_html(minus_signs(answer.sentence))}</p>\n{aside}</section>\n"
    )


def _effect(effect: ReportEffect, scale: float) -> str:
    """Write one difference of an answer as HTML: title, number, limits, strip, and the meaning of its tone.

    Args:
        scale: value at the right end of the strip.
    """
    limits = f' <span class="limits">{escape(minus_signs(effect.limits))}</span>' if effect.limits else ""
    return (
        f'<div class="effect {escape(effect.tone)}">{escape(effect.title)}'
        f"<b>{escape(minus_signs(effect.number))}</b>{limits}{_strip(effect, scale)}"
        f'<span class="tone">{escape(effect.words)}</span></div>\n'
    )


def _strip(effect: ReportEffect, scale: float) -> str:
    """Draw the interval and the estimate of a difference as SVG, on a line from -``scale`` to ``scale``.

    A limit that is not finite is drawn at the estimate. The result is empty if the estimate is not finite.
    """
    if not math.isfinite(effect.estimate):
        return ""

    def at(value: float) -> str:
        """Return the horizontal position of a value in the drawing, cut off at the ends of the line."""
        value = max(min(value, scale), -scale)
        return f"{STRIP_WIDTH / 2 * (1 + (value / scale if scale else 0.0)):.1f}"

    low, high = (end if math.isfinite(end) else effect.estimate for end in (effect.low, effect.high))
    return (
        f'<svg viewBox="0 0 {STRIP_WIDTH} 15" preserveAspectRatio="none" aria-hidden="true">'
        f'<path class="zero" d="M{STRIP_WIDTH / 2:g} 0V15"/><path class="bar" d="M{at(low)} 7.5H{at(high)}"/>'
        f'<path class="mean" d="M{at(effect.estimate)} 2V13"/></svg>'
    )
