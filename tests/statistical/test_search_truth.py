"""Searches on the simulation itself: what they believed against what is true, by default and the paper's way."""

from __future__ import annotations

from vibroswarm.search.loop import run_search
from vibroswarm.search.spec import Search
from vibroswarm.search.validation import truth_of

SMALL = """
[scenario]
preset = "paper"
[scenario.run]
t_end_s = 100.0
[scenario.swarm]
robots = 2
[space]
"walk.walk_duration_scale_ms" = { from = 0, to = 20000 }
"sample.sample_interval_ms" = { from = 1000, to = 6000 }
"decision.min_observations" = { from = 0, to = 30 }
[pso]
particles = 15
"""


def believed_too_little(noise: str, seed: int, budget: int) -> float:
    search = Search.from_toml(f"seed = {seed}\n{SMALL}\nnoise = '{noise}'").with_settings(budget=budget)
    found = run_search(search)
    assert found.archive.failed == 0
    truth = truth_of(found, runs=3000)
    return truth.bias.estimate / truth.winner.score.estimate


def test_the_defaults_leave_a_difference_under_10_percent() -> None:
    assert max(abs(believed_too_little("rescore", seed, 6000)) for seed in (1, 2)) < 0.1


def test_fixed_bests_leave_more() -> None:
    """The negative control: scores that are fixed when they are made are believed for their luck."""
    assert min(believed_too_little("fixed", seed, 1500) for seed in (1, 2)) > 0.25
