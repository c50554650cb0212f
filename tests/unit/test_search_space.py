"""Spaces: bounds, scales, whole numbers, choices."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibroswarm import preset
from vibroswarm.cli import main
from vibroswarm.errors import InputError
from vibroswarm.optimize.loop import run_search
from vibroswarm.optimize.space import PAPER, Dimension, Space
from vibroswarm.optimize.spec import Search
from vibroswarm.optimize.validation import score_fresh
from vibroswarm.optimize.words import search_of
from vibroswarm.strategies import none


def test_the_papers_space_holds_its_parameters() -> None:
    space = Space.of(PAPER)
    low, high = space.values(np.zeros(5)), space.values(np.ones(5))
    assert list(low.values()) == [0, 0, 1000, 50, 0]
    assert list(high.values()) == [20000, 20000, 6000, 150, 500]
    for name in ("paper", "paper-empirical"):
        values = space.values_of(preset(name))
        assert space.values(space.point(values)) == pytest.approx(values)
    assert space.values_of(preset("paper")) == dict(
        zip(space.names, [7860.0, 10725.0, 3778.0, 55.0, 381], strict=True)
    )


@given(st.floats(0, 1), st.sampled_from(["linear", "log"]), st.booleans())
def test_values_stay_in_bounds_and_come_back(u: float, scale: str, whole: bool) -> None:
    dimension = Dimension("decision.min_observations", 1.0, 500.0, scale, whole)
    value = dimension.value(u)
    assert 1 <= value <= 500
    assert isinstance(value, int) == whole
    assert dimension.value(dimension.share(value)) == pytest.approx(value, rel=1e-12)


def test_a_space_may_choose_whether_robots_estimate_places(tmp_path: Path) -> None:
    """No case of such a search does by itself."""
    file, noise = (
        tmp_path / "search.toml",
        '[space]\n"localisation.ray_noise_m" = { from = 0.001, to = 0.01 }\n',
    )
    file.write_text(noise + '"localisation.method" = ["mixture", "dead_reckoning"]\n')
    assert "localisation.ray_noise_m" in search_of(file).space.names
    file.write_text(noise)
    with pytest.raises(InputError, match="has no effect on robots that estimate no places"):
        search_of(file)


def test_a_space_may_choose_whether_robots_revise(tmp_path: Path) -> None:
    file = tmp_path / "search.toml"
    file.write_text('[space]\n"decision.revise" = [true, false]\n"strategy.name" = ["none", "soft"]\n')
    assert "decision.revise" in search_of(file).space.names


def test_a_base_need_not_fit_together_without_the_space(tmp_path: Path) -> None:
    """The paper's strategy reads two classes, and the sensor of the base has three."""
    file = tmp_path / "search.toml"
    text = """
        [scenario]
        sensor.model = "confusion"
        task.name = "majority"
        floor.source = "random:0.4,0.36,0.24"
        [space]
        "strategy.name" = ["dirichlet", "averaging"]
        [search]
        method = "random"
    """
    file.write_text(text)
    search = search_of(file)
    assert [cell.scenario.strategy.name for cell in search.cases] == ["dirichlet"]
    assert Search.from_toml(search.to_toml()).hash == search.hash
    file.write_text(text.replace("dirichlet", "soft"))
    with pytest.raises(InputError, match="'none' reads 0 or 1"):
        search_of(file)


def test_a_field_that_is_a_list_is_searched_over(tmp_path: Path) -> None:
    """From a preset on, through the tables, and again by ``verify``."""
    file, out = tmp_path / "search.toml", tmp_path / "out"
    file.write_text("""
        start = ["paper"]
        scenario.run.t_end_s = 20
        objective = { cost = "decision_time", statistic = "mean" }
        search = { method = "random", budget = 60, fresh = 2 }
        [space]
        "rays.angle_deg" = [[0.0, 90.0, -90.0], [0.0, 27.0, -27.0]]
    """)
    assert main(["optimize", str(file), "--out", str(out), "--no-pictures"]) == 0
    found = pl.read_csv(out / "candidates.csv")
    assert found["rays.angle_deg"][0] == "[0.0, 27.0, -27.0]"
    assert found["failed"].to_list() == [0] * found.height
    assert main(["verify", str(out)]) == 0


def test_a_strategy_of_the_users_own_may_be_a_choice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Worker processes run it, and the folder has it; once its file has changed, the search is refused."""
    code, file, out = tmp_path / "quiet.py", tmp_path / "search.toml", tmp_path / "out"
    own = Path(none.__file__).read_text().replace("none = register(", "quiet = (")
    code.write_text(own.replace('name="none"', 'name="quiet"'))
    file.write_text("""
        start = [{ "strategy.name" = "quiet.py:quiet" }]
        scenario.run.t_end_s = 20
        objective = { cost = "decision_time", statistic = "mean" }
        search = { method = "random", budget = 40, fresh = 2 }
        space = { "strategy.name" = ["none", "quiet.py:quiet"] }
    """)
    command = ["optimize", str(file), "--out", str(out), "--trust", "--no-pictures"]
    assert main([*command, "--executor", "processes", "--workers", "1"]) == 0
    assert pl.read_csv(out / "candidates.csv")["failed"].sum() == 0
    assert (out / "quiet.py").read_text() == code.read_text()
    code.write_text(code.read_text() + "# changed")
    assert main(command) == 2
    assert "another file" in capsys.readouterr().err


def test_a_choice_that_is_not_loaded_is_refused_before_any_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also before ``--force`` removes what is there."""
    words = "space.strategy.name: 'gone.py:gone' is not loaded"
    space = f'space = {{ "strategy.name" = ["none", "gone.py:gone sha256:{"0" * 64}"] }}'
    with pytest.raises(InputError, match=f"^{words}"):
        run_search(Search.from_toml(space))
    file, out = tmp_path / "search.toml", tmp_path / "out"
    file.write_text(
        f"scenario.run.t_end_s = 20\nsearch = {{ method = 'random', budget = 40, fresh = 2 }}\n{space}"
    )
    small = ["--set", "run.t_end_s=5", "--runs", "2", "--no-pictures"]
    assert main(["evaluate", "--strategy", "none,soft", *small, "--no-confirm", "--out", str(out)]) == 0
    assert main(["optimize", str(file), "--out", str(out), "--force"]) == 2
    assert main(["optimize", "sensitivity", str(file), "--out", str(out), "--force"]) == 2
    assert capsys.readouterr().err.count(words) == 2
    assert (out / "study.toml").is_file()


@pytest.mark.parametrize(
    ("space", "words"),
    [
        (
            '"strategy.name" = ["none", "sotf"]',
            "strategy.name: there is no strategy 'sotf', did you mean 'soft'",
        ),
        ('"rays.angle_deg" = [[0.0, 90.0, -90.0], [0.0, 27.0, "x"]]', "rays.angle_deg: "),
    ],
)
def test_a_choice_that_fits_nowhere_is_refused(space: str, words: str) -> None:
    with pytest.raises(InputError, match=f"^space.{words}"):
        Search.from_toml(f"space = {{ {space} }}")


def test_fresh_runs_take_numbers_of_numpy() -> None:
    search = Search.from_toml('scenario.run.t_end_s = 20\nspace = { "decision.min_observations" = [1, 5] }')
    plain, numpy = (
        score_fresh(search, [("a", {"decision.min_observations": value})], 2)[0] for value in (3, np.int64(3))
    )
    assert plain.score == numpy.score


def test_a_log_scale_has_its_geometric_mean_in_the_middle() -> None:
    assert Dimension("x", 1.0, 10000.0, "log").value(0.5) == pytest.approx(100.0)


def test_choices_have_equal_shares() -> None:
    space = Space.of({"strategy.name": ["none", "positive", "soft"]})
    assert [space.values(np.array([u]))["strategy.name"] for u in (0.0, 0.3, 0.4, 0.7, 1.0)] == [
        "none", "none", "positive", "soft", "soft",
    ]  # fmt: skip
    assert space.point({"strategy.name": "soft"}) == pytest.approx([5 / 6])  # the middle of its part
    assert space.values(space.point({"strategy.name": "soft"})) == {"strategy.name": "soft"}


def test_a_space_comes_back_from_its_block() -> None:
    space = Space.of({
        "walk.leg_min_ms": {"from": 1, "to": 100, "scale": "log"},
        "decision": {"min_observations": {"from": 0, "to": 9}},
        "strategy.name": ["none", "soft"],
    })  # fmt: skip
    assert Space.of(space.to_block()) == space
    assert space.dimensions[1].whole


@pytest.mark.parametrize(
    ("block", "told"),
    [
        ({"walk.leg_min_ms": {"from": 9, "to": 1}}, "9 is not below 1"),
        ({"walk.leg_min_ms": {"from": 1, "to": 1}}, "not below"),
        ({"walk.leg_min_ms": {"from": 0, "to": 1, "scale": "log"}}, "above 0"),
        ({"walk.leg_min": {"from": 0, "to": 1}}, "did you mean 'walk.leg_m"),
        ({"walk.leg_min_ms": [1]}, "at least two"),
        ({"walk.leg_min_ms": {"from": 0, "to": 1, "steps": 3}}, "for a grid"),
        ({"walk.leg_min_ms": 3}, "not a range"),
        ({"walk.leg_min_ms": {"from": "a", "to": 1}}, "give a number"),
        ({"preset": ["paper", "text"]}, "name fields"),
        ({}, "empty"),
    ],
)
def test_spaces_that_are_wrong(block: dict[str, object], told: str) -> None:
    with pytest.raises(InputError, match=told):
        Space.of(block)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"walk.leg_min_ms": 5}, "strategy.name: is missing"),
        ({"walk.leg_min_ms": 50, "strategy.name": "soft"}, "outside the bounds 0 to 10"),
        ({"walk.leg_min_ms": 5, "strategy.name": "positive"}, "not among"),
        ({"walk.leg_min_ms": "5", "strategy.name": "soft"}, "not a number"),
        ({"walk.leg_min_ms": 5, "strategy.name": "soft", "run.t_end_s": 3}, "not in the space"),
    ],
)
def test_values_that_do_not_lie_in_the_space(values: dict[str, object], told: str) -> None:
    space = Space.of({"walk.leg_min_ms": {"from": 0, "to": 10}, "strategy.name": ["none", "soft"]})
    with pytest.raises(InputError, match=told):
        space.point(values)


def test_whole_numbers_have_whole_bounds() -> None:
    """0.5 to 3.5 would give 0 and 4."""
    with pytest.raises(InputError, match="not bounds of whole numbers"):
        Dimension.of("decision.min_observations", {"from": 0.5, "to": 3.5, "whole": True})
    assert Dimension.of("decision.min_observations", {"from": 1.0, "to": 3.0, "whole": True}).value(1.0) == 3


@pytest.mark.parametrize(
    "ends", [{"from": 1.5, "to": 20}, {"from": 1.0, "to": 20.0}, {"from": 1, "to": 20, "whole": False}]
)
def test_a_field_of_whole_numbers_is_not_searched_between_them(ends: dict[str, Any]) -> None:
    """Every run failed."""
    with pytest.raises(InputError, match="holds whole numbers"):
        Dimension.of("decision.min_observations", ends)
