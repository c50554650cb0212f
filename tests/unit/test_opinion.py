"""Whose posterior is called an opinion, and that the verdict says so beside it."""

from __future__ import annotations

import pytest

from vibroswarm import preset, simulate, verdict
from vibroswarm.analysis.verdict import OPINION_NOTE, holds_opinions
from vibroswarm.cli.verdict_text import verdict_text


@pytest.mark.parametrize(
    ("strategy", "more", "expected"),
    [
        ("none", {}, False),
        ("positive", {}, True),
        ("soft", {}, True),
        ("totals", {}, False),
        ("bayes_bots", {}, True),
        ("bayes_bots", {"strategy.bayes_bots.positive_feedback": False}, False),
    ],
)
def test_feedback_makes_a_posterior_an_opinion(strategy, more, expected):
    assert holds_opinions(preset("paper").with_values({"strategy.name": strategy, **more})) is expected


@pytest.mark.parametrize("strategy", ["none", "soft"])
def test_the_verdict_calls_an_opinion_by_its_name(strategy):
    result = simulate(preset("paper").with_values({"strategy.name": strategy, "run.t_end_s": 60.0}), seed=1)
    text = " ".join(verdict_text(result, verdict(result)).split())
    opinion = strategy == "soft"
    assert (OPINION_NOTE in text) is opinion
    assert ("opinion (95 %)" in text) is opinion
    assert ("share of ones (95 %)" in text) is not opinion
    assert "belief, %" not in text
    assert "confidence, %" in text
