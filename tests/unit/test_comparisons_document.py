"""What is said of comparisons of a recording: which simulation is recognised least, and what was not compared."""

from __future__ import annotations

from dataclasses import replace

import pytest

from vibroswarm import preset, simulate
from vibroswarm.analysis.intervals import share_interval
from vibroswarm.calibrate.classifier import ClassifierAccuracy
from vibroswarm.calibrate.features import WORDS
from vibroswarm.calibrate.interval_classifier import IntervalAccuracy, Told
from vibroswarm.calibrate.real_vs_simulated import Comparison, compare
from vibroswarm.documents.calibration import comparison_document, comparisons_document


def compared(*by_session: float, simulations: int = 3) -> Comparison:
    share = share_interval(by_session)
    return Comparison((), (), ClassifierAccuracy(share, share, None, by_session, simulations), missing=())


@pytest.mark.parametrize(
    ("others", "words"),
    [
        ([(0.72, 0.83, 0.89)], "Least: ours, significantly less than each of the others (paired by 3 sessions)."),
        ([(0.50, 0.66, 0.80)], "Least: ours, not significantly less than other-0 (paired by 3 sessions)."),
        # as sessions that share no training, they differ significantly
        ([(0.585, 0.73, 0.835)], "Least: ours, not significantly less than other-0 (paired by 3 sessions)."),
        # with a correction for two comparisons, not for all three pairs, both differences are significant
        (
            [(0.6044, 0.73, 0.8156), (0.6044, 0.73, 0.8156)],
            "Least: ours, not significantly less than other-0 and other-1 (paired by 3 sessions).",
        ),
    ],
)  # fmt: skip
def test_the_least_recognised_is_told_from_the_others_or_not(
    others: list[tuple[float, ...]], words: str
) -> None:
    found = {"ours": compared(0.52, 0.63, 0.70)}
    found |= {f"other-{k}": compared(*shares) for k, shares in enumerate(others)}
    assert comparisons_document(found).answer[1] == words


def test_one_real_session_tells_no_simulations_apart() -> None:
    found = {"ours": compared(0.5), "other": compared(0.9)}
    assert comparisons_document(found).answer[1] == (
        "Least: ours, not significantly less than other (paired by 1 session; it takes 3 real and 3 simulated "
        "ones)."
    )


def test_one_simulated_session_tells_no_simulations_apart() -> None:
    """Where all real sessions were tested against it, 3 of 5 pairs of equal simulations were told apart."""
    found = {"ours": compared(0.52, 0.63, 0.70, simulations=1), "other": compared(0.72, 0.83, 0.89)}
    assert comparisons_document(found).answer[1].startswith("Least: ours, not significantly less than other ")


def test_a_recording_of_one_robot_is_compared_without_the_classifier() -> None:
    """It was refused as a whole."""
    one = preset("paper-empirical").with_values({"swarm.robots": 1, "run.t_end_s": 200.0})
    found = compare(simulate(one, 1, 1), simulate(one, 2, 1))
    assert len(found.similarities) >= 4
    assert found.classifier is None
    document = comparison_document(found)
    assert document.warnings[-1] == (
        "Without the classifier: a classifier split by robot needs at least two robots."
    )
    assert document.answer[0].startswith("Most different: ")
    alike = [replace(one, at_equal_counts=one.null + 0.01) for one in found.similarities]
    alike[1] = replace(alike[1], at_equal_counts=alike[1].null)
    even = comparison_document(replace(found, similarities=tuple(alike))).answer[-1]
    assert even == f"No more similar than evenly spread values: {WORDS[alike[1].feature]}."
    (units, _) = comparison_document(replace(found, missing=("still",))).warnings
    assert units == (
        "Too few values to compare: energy on still tiles (only energies below 3 count: if their unit is another, "
        "convert it in the column map)."
    )
    told = IntervalAccuracy(Told((0.5, 0.7), (0.4, 0.5, 0.9)), Told((), ()), {"turn_rad": 0.6})
    ranges = comparison_document(replace(found, intervals=told)).tables["intervals_told_apart"].frame
    assert ranges.row(0)[1:] == pytest.approx((0.6, 0.5, 0.7, 0.6, 0.4, 0.9))
    assert comparisons_document({"one": found, "two": found}).answer == (
        "The classifier compared no simulation.",
    )
