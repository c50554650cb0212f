"""The document of the checks of a strategy, network, task or source of motion."""

from __future__ import annotations

from collections.abc import Sequence

import polars as pl

from vibroswarm.core.numbers import count, verb
from vibroswarm.show.document import Column, Document, Table


def check_document(name: str, findings: Sequence[tuple[str, bool, bool, str]]) -> Document:
    """Return which checks hold.

    Args:
        findings: of each check: what it says, whether it holds, whether a failure is only a warning, and why it fails.
    """
    failed = any(not holds and not is_warning for _, holds, is_warning, _ in findings)
    held = sum(holds for _, holds, _, _ in findings)
    rows = [
        ("ok" if holds else "note" if is_warning else "FAIL", f"{what}: {why}" if why else what)
        for what, holds, is_warning, why in findings
    ]
    table = Table(
        pl.DataFrame(rows, schema=["state", "check"], orient="row"),
        {"state": Column(tones={"ok": "good", "note": "fair", "FAIL": "bad"}), "check": Column(prose=True)},
        name="checks",
    )
    return Document(
        title=f"Checks of {name}",
        answer=(
            f"'{name}' {'fails' if failed else 'passes'}: {held} of {count(len(findings), 'check')} "
            f"{verb(held, 'hold')}.",
        ),
        parts=(table,),
        data={
            "checks": pl.DataFrame(findings, schema=["check", "holds", "is_warning", "why"], orient="row"),
        },
    )
