"""The report of saved runs that were simulated again."""

from __future__ import annotations

from vibroswarm.core.numbers import count, percent
from vibroswarm.report.report import Report, Table, report
from vibroswarm.simulation import versions
from vibroswarm.study.verify import Verified


@report.register
def of_verified(verified: Verified) -> Report:
    """Return how many runs came out the same, and which did not."""
    again = verified.runs.height
    upper = percent(verified.differing_share.high, None, digits=2)
    answer = (
        f"{'Verified' if verified.holds else 'NOT VERIFIED'}: {verified.same} of {count(again, 'run')} came out the "
        f"same again, bit by bit; of all {verified.saved}, less than {upper} differ (95 %).",
    )
    return Report(
        f"Runs of {verified.folder} simulated again",
        answer,
        {"differing": Table(verified.runs.filter(~verified.runs["same"]).drop("same"), "Differing runs")},
        warnings=tuple(f"damaged: {path}" for path in verified.damaged),
        made_by=versions(),
    )
