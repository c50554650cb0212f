"""The report of saved runs that were simulated again."""

from __future__ import annotations

from vibroswarm.core.numbers import count
from vibroswarm.report.report import Report, Table, report
from vibroswarm.simulation import versions
from vibroswarm.study.store import Verified


@report.register
def of_verified(verified: Verified) -> Report:
    """Return how many runs came out the same, and which did not."""
    again = verified.runs.height
    answer = (
        f"{'Verified' if verified.holds else 'NOT VERIFIED'}: {verified.runs['same'].sum()} of "
        f"{count(again, 'run')}, of {verified.saved}, came out the same again, bit by bit.",
    )
    return Report(
        f"Runs of {verified.folder} simulated again",
        answer,
        {"differing": Table(verified.runs.filter(~verified.runs["same"]).drop("same"), "Differing runs")},
        warnings=tuple(f"damaged: {path}" for path in verified.damaged),
        made_by=versions(),
    )
