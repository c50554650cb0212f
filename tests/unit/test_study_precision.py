"""Runs until a precision: the looks, their correction, and that the last interval is honest."""

from __future__ import annotations

import math
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from vibroswarm.analysis.cell_summary import summary
from vibroswarm.analysis.figures import interval
from vibroswarm.analysis.intervals import Interval, mean_interval
from vibroswarm.errors import InputError
from vibroswarm.study.precision import FIGURES, FIRST_LOOK, RENAMED, Precision
from vibroswarm.study.settled import figure_of, settled
from vibroswarm.study.spec import Study
from vibroswarm.study.study_result import StudyResult

BASE = {"swarm": {"robots": 2}, "run": {"t_end_s": 60.0}, "decision": {"min_observations": 5}}


@given(st.integers(FIRST_LOOK, 10**7))
def test_looks_double_and_end_with_the_most(most):
    looks = list(Precision(0.02, max_runs=most).looks())
    assert looks[0] == 100
    assert looks[-1] == most
    for before, after in pairwise(looks):
        assert before < after <= 2 * before
        assert after == 2 * before or after == most


@pytest.mark.parametrize("level", [0.9, 0.95, 0.99])
def test_the_errors_of_all_looks_sum_to_that_of_the_level(level: float) -> None:
    precision = Precision(0.02, level=level)
    errors = np.array([1 - precision.level_at(look) for look in range(20_000)])
    assert errors[0] == pytest.approx((1 - level) * 6 / math.pi**2)
    assert np.all(np.diff(errors) < 0)
    assert 0.9999 * (1 - level) < errors.sum() < 1 - level


def is_reached(half_width: float, figure: str, *limits: float, runs: int = 10_000) -> bool:
    return Precision(half_width, figure).reached(Interval(*limits, 0.95, runs, "t"), 1200.0)


def test_times_are_known_relatively_and_shares_absolutely():
    assert is_reached(0.1, "decision_time_s", 500.0, 450.0, 550.0)
    assert not is_reached(0.1, "decision_time_s", 500.0, 449.0, 551.0)
    assert is_reached(0.1, "sent", 80.0, 72.0, 88.0), "of the messages, not a tenth of one"
    assert is_reached(0.1, "robots_right", 0.5, 0.4, 0.6)
    assert not is_reached(0.05, "robots_right", 0.5, 0.4, 0.6)
    assert not is_reached(0.1, "robots_right", 0.5, 0.5, 0.5), "an interval without a width is not known"
    assert not is_reached(0.1, "robots_right", math.nan, math.nan, math.nan)
    assert not is_reached(0.1, "robots_right", 0.5, -math.inf, math.inf)


@pytest.mark.parametrize(
    ("figure", "usual", "late"), [("decision_time_s", 300.0, 1200.0), ("belief_in_truth", 0.99, 0.01)]
)
def test_a_study_does_not_stop_before_rare_runs_can_have_occurred(
    figure: str, usual: float, late: float
) -> None:
    """Of runs that end within 50 s of each other 1 % are late: of 100, four studies in ten have none of these, and
    stopped there with an interval of some seconds (the control)."""
    precision, truth = Precision(0.05 if late > 1.0 else 0.02, figure, 3200), usual + 0.01 * (late - usual)
    random = np.random.default_rng(3)
    held, held_at_first = [], []
    for _ in range(300):
        scatter = random.uniform(-0.01, 0.01, 3200) * usual
        values = np.where(random.random(3200) < 0.01, late, usual + scatter)
        for look, runs in enumerate(precision.looks()):
            found = interval(figure, {figure: values[:runs]}, precision.level_at(look), t_end_s=1200.0)
            held_at_first += [not found.excludes(truth)] if look == 0 else []
            if precision.reached(found, 1200.0):
                break
        held.append(not found.excludes(truth))
    assert np.mean(held) > 0.95
    assert np.mean(held_at_first) < 0.7


@pytest.mark.parametrize(
    ("text", "share"), [("2%", 0.02), (" 0.5 %", 0.005), ("21.9%", 0.219), ("1e1%", 0.1)]
)
def test_a_precision_from_words(text: str, share: float) -> None:
    precision = Precision.from_words(text)
    assert precision.half_width == share
    assert Precision.from_words(precision.as_values()["until"]) == precision
    assert ".%" not in precision.as_values()["until"]


@pytest.mark.parametrize("text", ["2", "%", "0%", "-1%", "100%", "nan%", "inf%", "two%", 2, 0.02, None, True])
def test_what_is_no_precision_is_said(text: object) -> None:
    with pytest.raises(InputError, match="not a percentage above 0% and below 100%; give one such as 2%"):
        Precision.from_words(text)


@pytest.mark.parametrize("level", [0.0, 1.0, 1.5, -0.1, math.nan, math.inf, 1, True, "0.9", None])
def test_what_is_no_level_is_refused(level: object) -> None:
    with pytest.raises(
        InputError, match=r"level: .* is not a level of confidence; give a share such as 0\.95"
    ):
        Precision(0.02, level=level)  # type: ignore[arg-type]


LONG_S, SHORT_S, SHARE = 1200.0, 300.0, 0.1
TRUTH_S = SHARE * LONG_S + (1 - SHARE) * SHORT_S


def stopped(times_s: NDArray[np.float64], precision: Precision, *, corrected: bool) -> bool:
    """Whether the interval at which a study stops holds the truth."""
    for look, runs in enumerate(precision.looks()):
        level = precision.level_at(look) if corrected else precision.level
        found = mean_interval(times_s[:runs], level)
        if precision.reached(found, LONG_S):
            break
    return found.low <= TRUTH_S <= found.high


def test_the_interval_at_which_a_study_stops_holds_the_truth_often_enough():
    """One run in ten is long. A study that stops at the first narrow interval stops where by luck few were long: with
    95 % at each look its last interval holds the truth too seldom (the negative control), corrected often enough."""
    precision, studies = Precision(0.1, max_runs=6400), 1000
    dice = np.random.default_rng(1)
    times_s = np.where(dice.random((studies, 6400)) < SHARE, LONG_S, SHORT_S)
    honest = np.mean([stopped(row, precision, corrected=True) for row in times_s])
    naive = np.mean([stopped(row, precision, corrected=False) for row in times_s])
    standard_error = math.sqrt(0.95 * 0.05 / studies)
    assert naive < 0.95 - 3 * standard_error
    assert honest > 0.95


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> StudyResult:
    return Study(BASE, {"grid": {"floor.source": ["random:0.44"]}}, 200).run(
        tmp_path_factory.mktemp("p") / "s"
    )


@pytest.mark.parametrize(
    "figure", [*RENAMED.values(), "decision_time_s", "belief_in_truth", "consensus_time_s"]
)
def test_figures_are_those_of_the_tables(figure: str, result: StudyResult) -> None:
    robots, runs = result.robots(), result.runs()
    joined = robots.join(runs.select("run", "truth"), on="run")
    hit = {
        "robots_right": pl.col("decision") == pl.col("truth"),
        "robots_wrong": (pl.col("decision") != -1) & (pl.col("decision") != pl.col("truth")),
        "robots_undecided": pl.col("decision") == -1,
    }
    if figure in ("decision_time_s", "belief_in_truth"):
        wanted = robots[figure].fill_null(60.0).mean()
    elif figure == "consensus_time_s":
        wanted = runs[figure].fill_null(60.0).mean()
    elif figure in hit:
        wanted = joined.select(hit[figure].mean()).item()
    else:
        wanted = (runs["consensus"] == figure.removeprefix("swarm_")).mean()
    found = figure_of(result.store.scan(0, 200), figure, 60.0, 0.95)  # type: ignore[arg-type]
    assert found.estimate == pytest.approx(wanted, rel=1e-12)
    assert found.n == 200
    assert found.low < found.estimate < found.high


@pytest.mark.parametrize(("old", "new"), RENAMED.items())
def test_a_renamed_figure_is_named(old: str, new: str) -> None:
    with pytest.raises(InputError, match=f"'{old}' is called '{new}' now"):
        Precision(0.02, old)


@pytest.fixture(scope="module")
def with_and_without_truth(tmp_path_factory: pytest.TempPathFactory) -> pl.DataFrame:
    """Rows of the store: runs 0 to 39 have a truth; runs 40 to 79 have none, as half of the floor's tiles vibrate."""
    base = {
        **BASE,
        "floor": {"source": "random:0.5", "rows": 4, "columns": 4},
        "decision": {"min_observations": 0},
    }
    study = Study(base, {"grid": {"floor.source": ["random:0.25", "random:0.5"]}}, 40)
    rows = study.run(tmp_path_factory.mktemp("p") / "s").rows().collect()
    return rows.with_columns(run=pl.col("run") + 40 * pl.col("cell"))


@pytest.mark.parametrize("truth", ["all", "some", "none"])
def test_figures_agree_with_the_summary_of_the_cell(truth: str, with_and_without_truth: pl.DataFrame) -> None:
    of_cells = {"all": [0], "some": [0, 1], "none": [1]}[truth]
    rows = with_and_without_truth.filter(pl.col("cell").is_in(of_cells))
    runs = rows.filter(pl.col("robot") == 0)
    assert runs["truth"].null_count() == {"all": 0, "some": 40, "none": 40}[truth]
    if truth == "none":
        assert {-1, 0, 1} == set(rows["decision"]), "robots decide, and stay undecided"
    shown = summary(rows, runs, 60.0)
    for figure in FIGURES:
        found, wanted = figure_of(rows.lazy(), figure, 60.0, 0.95), getattr(shown, figure)
        assert found.n == wanted.n, figure
        assert math.isnan(found.estimate) == (found.n == 0), figure
        assert found.estimate == pytest.approx(wanted.estimate, rel=1e-12, nan_ok=True), figure
        assert found[1:3] == pytest.approx(wanted[1:3], rel=1e-12, nan_ok=True), "the interval that is shown"


def test_a_group_is_settled_when_its_worst_cell_is(tmp_path: Path) -> None:
    study = partial(Study, BASE, {"grid": {"strategy.name": ["none", "positive"]}})
    result = study(200).run(tmp_path / "s")
    group, half_widths = result.plan.groups[0], []
    for cell in (0, 1):
        rows = result.store.scan(0, 100)
        assert rows is not None
        found = figure_of(
            rows.filter(pl.col("cell") == cell), "robots_right", 60.0, Precision(0.5).level_at(0)
        )
        half_widths.append((found.high - found.low) / 2)
    worst = max(half_widths)
    assert settled(result.store, group, Precision(worst, "robots_right")) == (
        0,
        100,
        Precision(0.5).level_at(0),
        True,
    )
    later = settled(result.store, group, Precision((worst + min(half_widths)) / 2, "robots_right"))
    assert later is None or later.look > 0
    assert settled(result.store, group, Precision(0.001, "robots_right")) is None, "400 runs are not there"
    most = settled(result.store, group, Precision(0.001, "robots_right", max_runs=200))
    assert most is not None, "as many as are there"
    assert (most.runs, most.reached) == (200, False)
