"""The answer of a study in sentences: signs, intervals, what is confirmed, and what is said at equal error."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vibroswarm.analysis.forced_error import MatchedError, Reached, front_settings, matched_error
from vibroswarm.analysis.intervals import Interval
from vibroswarm.analysis.paired import Confirmation, Paired
from vibroswarm.core.numbers import count_of, listed
from vibroswarm.documents.study import study_document
from vibroswarm.documents.study_words import at_equal_error, question, sentence, title_of, warnings_of
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.strategies import known
from vibroswarm.study.cell_comparison import Answer, Compared, answers_of
from vibroswarm.study.equal_error import at_equal_error as at_equal_error_of
from vibroswarm.study.equal_error import reached
from vibroswarm.study.spec import Study
from vibroswarm.study.summary import outcome_of

STUDY = Study.of(preset("paper"), 1, strategy__name=["none", "soft"])
NONE, SOFT = STUDY.cells
FIGURES = ("decision_time_s", "right_share", "wrong_share", "undecided_share")


def paired(figure: str, value: float, low: float, high: float, p: float) -> Paired:
    interval = Interval(value, low, high, 0.95, 300, "sign flips")
    return Paired(figure, 0.0, 0.0, interval, 0, 0, 0, 300, 0, p_value=p / 10, p_holm=p)


def answer(
    *differences: tuple[float, float, float, float],
    confirmed: tuple[bool, ...] | None = (True,) * 4,
    matched: MatchedError | None = None,
) -> Answer:
    compared = []
    for k, (figure, values) in enumerate(zip(FIGURES, differences, strict=True)):
        one = paired(figure, *values)
        again = None if confirmed is None else Confirmation(one, one, confirmed[k], "")
        compared.append(Compared(SOFT, NONE, "strategy.name", one, again))
    (found,) = answers_of(compared, {} if matched is None else {(1, 0): matched})
    return found


PUBLISHED = (
    (-127.3, -153.2, -101.6, 0.0001),
    (0.119, 0.084, 0.155, 0.0001),
    (0.067, 0.039, 0.094, 0.0001),
    (-0.186, -0.230, -0.145, 0.0001),
)


def at_equal(value: float, low: float, high: float) -> MatchedError:
    interval = Interval(value, low, high, 0.95, 300, "bootstrap of fronts")
    return MatchedError(True, 0.248, 769.0, interval, interval)


def test_a_comparison_is_one_sentence_with_the_wrong_decisions_in_it() -> None:
    assert sentence(answer(*PUBLISHED)) == (
        "soft is faster than none, and wrong more often: 127 s faster [102, 153], 11.9 points more right [8.4, 15.5], "
        "6.7 points more wrong [3.9, 9.4], 18.6 points fewer undecided [14.5, 23.0]; confirmed on other seeds."
    )


def test_an_answer_names_its_cells_and_the_largest_difference_in_time_comes_first() -> None:
    assert answer(*PUBLISHED).as_row() == {"name": "soft against none", "cell": 1, "reference": 0}
    small, large = (paired("decision_time_s", time_s, -200.0, 0.0, 0.2) for time_s in (-10.0, -127.0))
    pairs = [(SOFT, NONE, small), (NONE, SOFT, large)]
    found = answers_of([Compared(*cells, "strategy.name", one, None) for *cells, one in pairs], {})
    assert [one.cell for one in found] == [NONE, SOFT]


def test_what_is_not_significant_or_not_confirmed_is_said_to_be_so() -> None:
    open_ = (PUBLISHED[0], (0.002, -0.01, 0.02, 0.8), (0.013, 0.001, 0.024, 0.06), PUBLISHED[3])
    found = answer(*open_, confirmed=(True, False, False, False))
    assert sentence(found) == (
        "soft is faster than none; no difference shown in wrong decisions: 127 s faster [102, 153], 18.6 points fewer "
        "undecided [14.5, 23.0]; time confirmed on other seeds, undecided not confirmed. Not significant: right +0.2 "
        "points [-1.0, +2.0], wrong +1.3 points [+0.1, +2.4], "
        "p = 0.060 after correction."
    )
    nothing = answer(*((0.004, -0.01, 0.02, 0.8),) * 4)
    assert sentence(nothing).startswith("soft and none: no significant difference (time 0.0 s [0.0, 0.0]")
    assert "not repeated on other seeds" in sentence(answer(*PUBLISHED, confirmed=None))
    undefined = answer(PUBLISHED[0], *((math.nan,) * 4,) * 3)
    assert sentence(undefined).startswith("soft is faster than none: 127 s faster")  # nothing can be wrong
    assert "right" not in sentence(undefined)


@pytest.mark.parametrize(
    ("matched", "ending"),
    [
        (at_equal(40.0, -57.0, 175.0), "not shown to be better: it is wrong more often."),
        (at_equal(40.0, 7.0, 175.0), "not shown to be better: it is wrong more often."),
        (at_equal(-40.0, -75.0, -7.0), "faster, and not only because it is wrong more often."),
        (
            at_equal(40.0, -math.inf, 57.0),
            "time, +40 s [-∞, +57]. ∞: none may not reach it. So soft is faster as run, but not shown to be better: "
            "it is wrong more often.",
        ),
        (
            at_equal(-40.0, -math.inf, -7.0),
            "soft 40 s faster [7, ∞]. ∞: none may not reach it. So soft is faster, and not only because it is wrong "
            "more often.",
        ),
    ],
)
def test_what_is_faster_only_because_it_errs_more_is_not_called_better(
    matched: MatchedError, ending: str
) -> None:
    found = at_equal_error(answer(*PUBLISHED, matched=matched), matched)
    assert found.startswith("At equal error (24.8 %, that of soft), each with its best settings: ")
    assert found.endswith(ending)


def test_a_strategy_that_is_faster_but_wrong_more_often_is_named() -> None:
    """The command then says how to compare at equal error."""
    assert answer(*PUBLISHED).faster_and_more_wrong == "soft"


def reached_of(curve: list[tuple[float, float]], noise: np.ndarray) -> Reached:
    """Points with given means; the runs differ by noise of mean 0, the same for all points."""
    time_s, error = (np.array(column)[:, None] for column in zip(*curve, strict=True))
    return Reached(time_s + 10 * noise, error + 0.01 * noise)


NOISE = np.random.default_rng(7).normal(size=400)
NOISE -= NOISE.mean()


def test_a_strategy_on_the_same_front_is_not_faster_at_equal_error() -> None:
    """It was run where it is faster and errs more; its front is that of the reference."""
    curve = [(100.0, 0.4), (300.0, 0.2), (500.0, 0.1)]
    careful = reached_of([curve[1], *curve], NOISE)
    hasty = reached_of([curve[0], *curve], NOISE)
    found = matched_error(hasty, careful)
    assert found.of_first
    assert found.error == pytest.approx(0.4)
    assert found.time_difference_s[:3] == pytest.approx((0.0, 0.0, 0.0))
    assert matched_error(careful, hasty).of_first is False


def test_a_front_that_is_better_everywhere_is_faster_at_equal_error() -> None:
    """Both fronts are straight lines, so that the difference is known: 60 s at each error."""
    slow = [(100.0, 0.4), (500.0, 0.0)]
    fast = [(time - 60.0, error) for time, error in slow]
    found = matched_error(reached_of([(240.0, 0.2), *fast], NOISE), reached_of([(300.0, 0.2), *slow], NOISE))
    assert found.time_difference_s.estimate == pytest.approx(-60.0)
    assert found.time_difference_s.high < 0
    assert found.error_difference.estimate == pytest.approx(-0.06)
    few = matched_error(reached_of(fast, NOISE[:299]), reached_of(slow, NOISE[:299]))
    assert math.isnan(few.time_difference_s.low)
    unreached = matched_error(
        reached_of([(50.0, 0.3)], NOISE), reached_of([(900.0, 0.1), (950.0, 0.09)], NOISE)
    )
    assert unreached.time_difference_s.estimate == pytest.approx(50.0 - 900.0)  # errs less: its fastest point
    assert math.isnan(unreached.error_difference.estimate)  # nothing as fast as 50 s


def test_a_front_that_may_not_reach_the_error_has_a_limit_on_one_side() -> None:
    """Once there were no limits at all if more than one draw in twenty did not reach the error."""
    own = [np.random.default_rng(seed).normal(size=400) for seed in (1, 2)]
    hasty, careful = (reached_of([(900.0, 0.1), (100.0, 0.4)], noise - noise.mean()) for noise in own)
    for first, other, sign in ((hasty, careful, 1), (careful, hasty, -1)):
        found = matched_error(replace(first, error=first.error + 1e-6), other)
        assert found.of_first
        assert found.time_difference_s.estimate == pytest.approx(0.0, abs=0.1)
        assert found.time_difference_s.low == -math.inf
        assert 0.0 < found.time_difference_s.high < 10.0, sign


def test_replays_are_those_of_the_scenario_and_its_settings() -> None:
    """The first point is the scenario as it is: the means of its own runs."""
    scenario = preset("paper").with_values({"run.t_end_s": 200.0, "decision.min_observations": 60})
    (found,) = reached([scenario], 3, 25)
    one = replace(STUDY, base=scenario, vary={}, runs=25, seed=3).run()
    time_s = one.robots(0)["decision_time_s"].fill_null(200.0).mean()
    assert found.time_s[0].mean() == pytest.approx(time_s)
    assert found.time_s.shape == (25, 25)  # as it is, and 6 x 4 settings


def test_pairs_are_compared_at_equal_error_by_the_runs_that_all_have(monkeypatch: pytest.MonkeyPatch) -> None:
    """From run 0 to the first that is missing, and 5,000 robots or 300 runs at most; cell less reference."""
    asked: list[int] = []

    def made(scenarios: list[Scenario], seed: int, runs: int, **how: Any) -> list[Reached]:
        asked.append(runs)
        early_s = [60.0 * (one.strategy.name == "soft") for one in scenarios]
        return [
            reached_of([(300.0 - s, 0.2), (100.0 - s, 0.4), (500.0 - s, 0.0)], NOISE[:runs]) for s in early_s
        ]

    monkeypatch.setattr("vibroswarm.study.equal_error.reached", made)
    one_missing = [*range(40), *range(41, 2000)]
    for robots, there, runs in (
        (5, one_missing, 40),
        (5, list(range(2000)), 1000),
        (50, list(range(2000)), 300),
    ):
        study = Study.of(
            preset("paper").with_values({"swarm.robots": robots}), 1, strategy__name=["none", "soft"]
        )
        of_cells = (list(range(2000)), there)
        result: Any = SimpleNamespace(study=study, runs_there=lambda k, most, kept=of_cells: kept[k][:most])
        none, soft = study.cells
        compared = [Compared(soft, none, "strategy.name", paired("decision_time_s", *PUBLISHED[0]), None)]
        found = at_equal_error_of(result, compared)
        assert asked.pop() == runs
        assert found[1, 0].time_difference_s.estimate == pytest.approx(-60.0)


def test_settings_are_of_strategies_that_exist() -> None:
    assert set(front_settings()) <= set(known())


def test_a_difference_at_equal_error_without_limits_is_not_called_insignificant() -> None:
    unknown = Interval(-127.0, math.nan, math.nan, 0.95, 300, "bootstrap")
    matched = MatchedError(True, 0.1, 769.0, unknown, unknown)
    told = at_equal_error(answer(*PUBLISHED, matched=matched), matched)
    assert "no significant difference" not in told
    assert "-127 s; an interval needs 300 runs." in told


def test_the_question_names_only_what_all_cells_share() -> None:
    def of(**varied: list[object]) -> str:
        return question(outcome_of(Study.of(preset("paper"), 3, **varied).run(), compare=False))

    ends = of(run__t_end_s=[50.0, 100.0])
    assert "5 robots, floor" in ends
    assert "up to" not in ends
    floors = ["random:0.48", "random:0.52"]
    all_varied = of(run__t_end_s=[50.0, 60.0], swarm__robots=[5, 6], floor__source=floors)
    values = "t_end_s 50 and 60; robots 5 and 6; random:0.48 and random:0.52"
    assert all_varied == f"{values}: 3 runs each, seed 1."
    assert "up to 1200 s" in of(swarm__robots=[5, 6])


def test_all_combinations_of_several_fields_are_named_by_their_values() -> None:
    base = preset("paper").with_values({"run.t_end_s": 5.0})
    strategies, robots = ["none", "positive", "soft"], [3, 5]
    result = Study.of(base, 1, strategy__name=strategies, swarm__robots=robots).run()
    assert title_of(result) == "none, positive and soft; robots 3 and 5"
    asked = question(outcome_of(result))
    assert ": none, positive or soft, for each of robots 3 and 5? " in asked
    assert question(outcome_of(result, compare=False)).startswith("none, positive and soft; robots 3 and 5: ")
    one_left_out = result.where(name=["none", "soft"], robots=3)
    assert title_of(one_left_out) == "none, robots 3; and soft, robots 3"


def test_work_that_is_nearly_done_is_not_called_done() -> None:
    assert count_of(1999, 2000, "run") == "1,999 of 2,000 runs (99 %)"
    assert count_of(0, 0, "run") == "0 of 0 runs (0 %)"


def test_names_with_commas_are_listed_between_semicolons() -> None:
    assert listed(["none"], "or") == "none"
    assert listed(["none", "positive", "soft"], "or") == "none, positive or soft"
    assert listed(["random:0.48, none", "random:0.52, none"]) == "random:0.48, none; and random:0.52, none"


def test_cells_of_which_no_difference_is_defined() -> None:
    """One estimates a number and the other does not: the page ended in a traceback."""
    short = preset("paper").with_values({"run.t_end_s": 2.0, "task.name": "share"})
    found = outcome_of(Study.of(short, 2, strategy__name=["none", "mcp"]).run(progress=False))
    document = study_document(found)
    assert document.answer == ("mcp and none cannot be compared: no difference between them is defined.",)
    assert not [name for name in document.figures if name.startswith("compared")]


def test_a_gate_that_no_robot_of_a_cell_reached_is_warned_of() -> None:
    """All were undecided, and nothing said why; robots with a map have no such gate."""
    study = Study.of(
        preset("paper").with_values({"run.t_end_s": 20.0}), 2, strategy__name=["none", "soft", "places"]
    )
    (warning,) = warnings_of(outcome_of(study.run(progress=False), compare=False))
    assert warning.startswith(
        "none and soft: No robot was allowed to decide: that takes more than 381 observations"
    )


def test_only_the_first_warnings_of_a_kind_are_listed() -> None:
    weak = preset("paper").with_values({"run.t_end_s": 2.0, "floor.source": "random:0.52"})
    study = Study.of(weak, 2, sensor__rms_threshold=[1.5 + k / 100 for k in range(8)])
    *_, sixth, more, _ = warnings_of(outcome_of(study.run(progress=False), compare=False))
    assert sixth.startswith("floor random:0.52, threshold 1.55: ")
    assert more == "... and 2 more warnings of this kind."
