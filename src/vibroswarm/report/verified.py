"""The report of saved runs that were simulated again."""

from __future__ import annotations

from vibroswarm.core.numbers import count, percent
from vibroswarm.report.report import Report, Table, report
from vibroswarm.search.verify import Verified


@report.register
def of_verified(verified: Verified) -> Report:
    """Return how many runs came out the same, and which did not."""
    differing = verified.runs.filter(~verified.runs["same"]).select("cell", "run", "tables")
    answer = (
        f"{'Verified' if verified.holds else 'NOT VERIFIED'}: {verified.same} of {count(verified.runs.height, 'run')} "
        f"came out the same again, bit by bit."
    )
    if verified.runs.height < verified.saved:
        upper = percent(verified.share_that_differs.high, None, digits=2)
        answer += f" Up to {upper} of {count(verified.saved, 'saved run')} may differ (95 %)."
    other = [f"made by {name} {theirs}, not {own}" for name, (theirs, own) in verified.other_versions.items()]
    return Report(
        title=f"Runs of {verified.folder} simulated again",
        answer=(answer,),
        parts={
            "differing": Table(differing, "Runs that differ", titles={"tables": "tables that differ"}),
            "runs": Table(verified.runs, "All runs", folded=True),
        },
        warnings=(*(f"damaged: {each}" for each in verified.damaged), *other),
    )
