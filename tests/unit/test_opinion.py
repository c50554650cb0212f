"""Whose posterior is called an opinion, and that the verdict says so beside it."""

from __future__ import annotations

import pytest

from vibroswarm import preset, simulate
from vibroswarm.analysis.verdict import OPINION_NOTE, holds_opinions
from vibroswarm.documents.run import result_document
from vibroswarm.show.document import Text


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
    document = result_document(result)
    opinion = strategy == "soft"
    assert (Text(OPINION_NOTE) in document.parts) is opinion
    columns = document.tables["robots"].columns
    assert columns["posterior"].title == ("opinion (95 %)" if opinion else "share of ones (95 %)")
    assert columns["confidence"].share


@pytest.mark.parametrize("robots", [2, 25])
def test_robots_without_a_belief_have_no_columns_of_it(robots):
    """They had dashes there, in both tables of a large swarm."""
    values = {"strategy.name": "dmvd", "run.t_end_s": 60.0, "swarm.robots": robots}
    document = result_document(simulate(preset("paper").with_values(values), seed=1))
    tables = [document.tables[name] for name in ("robots", "decisions") if name in document.tables]
    assert len(tables) == 1 + (robots > 2)
    for table in tables:
        assert not {"confidence", "posterior", "posterior_low"} & set(table.frame.columns)
