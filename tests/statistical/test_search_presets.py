"""The presets that searches found do what their documents say, and the searches' files are there to find them again."""

from __future__ import annotations

from pathlib import Path

import pytest

from vibroswarm import preset
from vibroswarm.scenario.presets import preset_names
from vibroswarm.search.objective import Objective
from vibroswarm.search.spec import Search
from vibroswarm.search.validation import Scored, paired_score, score_fresh

SEARCHES = Path(__file__).parents[2] / "examples" / "searches"


def scored(search: Search, names: list[str], runs: int) -> list[Scored]:
    return score_fresh(search, [(name, search.space.values_of(preset(name))) for name in names], runs)


def test_on_random_floors_few_are_undecided_and_the_error_is_out_of_reach() -> None:
    search = Search.read(SEARCHES / "error-on-random-floors.toml")
    found, paper = scored(search, ["optimised-error", "paper"], 500)
    assert found.parts["robots_undecided"].high <= 0.1
    assert found.parts["robot_error"].low > 0.05
    assert paper.parts["robots_undecided"].low > 0.1  # the control
    assert paired_score(search.objectives[0], found, paper).high < 0


def test_the_papers_cost_rewards_waiting() -> None:
    """What was found under it leaves more robots undecided than P*."""
    search = Search.read(SEARCHES / "error-on-random-floors.toml")
    found, paper = scored(search, ["optimised-cost", "paper"], 200)
    assert found.parts["robots_undecided"].low > paper.parts["robots_undecided"].high


@pytest.mark.parametrize("path", sorted(SEARCHES.glob("*.toml")), ids=lambda path: path.stem)
def test_the_files_of_the_searches_name_what_they_found(path: Path) -> None:
    search = Search.read(path)
    assert search.objectives == (Objective("time_at_error"),)
    named = [
        name for name in preset_names() if f"`{name}`" in path.read_text(encoding="utf-8").splitlines()[0]
    ]
    assert len(named) == 1
    search.space.point(search.space.values_of(preset(named[0])))  # within the bounds
