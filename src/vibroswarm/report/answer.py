"""The answers of a report's first screen: for each comparison a headline, its differences side by side, a sentence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from vibroswarm.report.text import code_html, escape, minus_signs

SHOWN: Final = 3
"""Answers that are not folded."""
WIDTH: Final = 200
"""Of a strip, in units of its drawing."""


@dataclass(frozen=True)
class ReportEffect:
    """A difference of one figure."""

    title: str
    number: str
    """The difference with sign and unit."""
    limits: str
    """Its limits as text; empty: none."""
    estimate: float
    low: float
    high: float
    tone: str
    """"good", "bad", or "open" where no difference is shown."""
    words: str
    """What the tone means: "better"."""


@dataclass(frozen=True)
class ReportAnswer:
    """A comparison."""

    headline: str
    sentence: str
    aside: str = ""
    """What must be said beside it."""
    effects: tuple[ReportEffect, ...] = ()


def answers_html(answers: Sequence[ReportAnswer]) -> str:
    """Write the answers; those after the first few are folded."""
    if not answers:
        return ""
    scales = _scales(answers)
    texts = [_answer(answer, scales) for answer in answers]
    more = len(texts) - SHOWN
    folded = (
        f"<details>\n<summary>{more} more comparison{'s' * (more > 1)}</summary>\n"
        f'<div class="answers">\n{"".join(texts[SHOWN:])}</div>\n</details>\n'
        if more > 0
        else ""
    )
    return f'<div class="answers">\n{"".join(texts[:SHOWN])}</div>\n{folded}'


def _scales(answers: Sequence[ReportAnswer]) -> dict[str, float]:
    """Return the largest value of each figure: the strips of one figure share their scale."""
    scales: dict[str, float] = {}
    for answer in answers:
        for effect in answer.effects:
            sizes = [abs(v) for v in (effect.estimate, effect.low, effect.high) if math.isfinite(v)]
            scales[effect.title] = max([scales.get(effect.title, 0.0), *sizes])
    return scales


def _answer(answer: ReportAnswer, scales: dict[str, float]) -> str:
    """Write one answer."""
    effects = "".join(_effect(effect, scales[effect.title]) for effect in answer.effects)
    strip = f'<div class="effects">\n{effects}</div>\n' if effects else ""
    aside = f'<p class="aside">{code_html(minus_signs(answer.aside))}</p>\n' if answer.aside else ""
    return (
        f'<section class="answer">\n<h2>{escape(answer.headline)}</h2>\n{strip}'
        f"<p>{code_html(minus_signs(answer.sentence))}</p>\n{aside}</section>\n"
    )


def _effect(effect: ReportEffect, scale: float) -> str:
    """Write one difference with its strip."""
    limits = f' <span class="limits">{escape(minus_signs(effect.limits))}</span>' if effect.limits else ""
    return (
        f'<div class="effect {escape(effect.tone)}">{escape(effect.title)}'
        f"<b>{escape(minus_signs(effect.number))}</b>{limits}{_strip(effect, scale)}"
        f'<span class="tone">{escape(effect.words)}</span></div>\n'
    )


def _strip(effect: ReportEffect, scale: float) -> str:
    """Draw the interval and the mean on a line with 0 in its middle."""
    if not math.isfinite(effect.estimate):
        return ""

    def at(value: float) -> str:
        value = max(min(value, scale), -scale)
        return f"{WIDTH / 2 * (1 + (value / scale if scale else 0.0)):.1f}"

    low, high = (end if math.isfinite(end) else effect.estimate for end in (effect.low, effect.high))
    return (
        f'<svg viewBox="0 0 {WIDTH} 15" preserveAspectRatio="none" aria-hidden="true">'
        f'<path class="zero" d="M{WIDTH / 2:g} 0V15"/><path class="bar" d="M{at(low)} 7.5H{at(high)}"/>'
        f'<path class="mean" d="M{at(effect.estimate)} 2V13"/></svg>'
    )
