"""The document of saved runs that were simulated again."""

from __future__ import annotations

from vibroswarm.core.numbers import count, every, percent, verb, whole
from vibroswarm.search.verify import Verified
from vibroswarm.show.document import Column, Document, Table


def verified_document(verified: Verified) -> Document:
    """Return how many runs came out the same, which did not, and what else made them."""
    again, differing = verified.runs.height, verified.runs.height - verified.same
    is_sample = again < verified.saved
    runs = every(again, "run")
    if is_sample:
        runs = f"{whole(again)} of {count(verified.saved, 'run')}, drawn at random,"
    if verified.damaged and not differing:
        answer = (
            f"NOT VERIFIED: {count(len(verified.damaged), 'file')} cannot be read. Of the others, {runs} came out the "
            "same again, bit by bit.",
        )
    elif verified.holds:
        upper = percent(verified.share_that_differs.high, None, digits=2)
        rest = f" With 95 % confidence, less than {upper} of the saved runs differ." if is_sample else ""
        answer = (f"Verified: {runs} came out the same again, bit by bit.{rest}",)
    else:
        were = verb(again, "were", "was")
        answer = (
            f"NOT VERIFIED: {runs} {were} simulated again, and {whole(differing)} came out differently.",
        )
    table = verified.runs.filter(~verified.runs["same"]).select("cell", "run", "tables")
    columns = {"tables": Column("tables that differ", prose=True)}
    if not any(verified.runs["cell"]):
        table = table.drop("cell")
    return Document(
        title=f"Runs of {verified.folder} simulated again",
        answer=answer,
        warnings=tuple(f"damaged: {one}" for one in verified.damaged)
        + tuple(
            f"made by {name} {theirs}; this is {name} {own}, so that runs may differ"
            for name, (theirs, own) in verified.other_versions.items()
        ),
        parts=(Table(table, columns, name="differing", names=table.width - 1),) if table.height else (),
        data={"runs": verified.runs},
    )
