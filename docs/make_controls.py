"""Generate the table in docs/figures/paper.md of the verdicts that change under each negative control.

    python docs/make_controls.py --runs 500 --out out/controls [--recordings DIR] [--write]

Runs ``vibroswarm reproduce`` without and with each control, for preset ``paper``, and the items that have claims of
another preset only for that one; run it again to resume.
Exit code 1: a reproduced claim changes under no control and gives no reason (``no_control`` in claims.toml).
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from vibroswarm.documents.reproduction import reproduction_document
from vibroswarm.paper.claims import Decided, all_claims
from vibroswarm.paper.columns import CONTROLS
from vibroswarm.paper.item import Item, Settings
from vibroswarm.paper.items import all_items
from vibroswarm.paper.reproduce import reproduce
from vibroswarm.paper.reproduction_tables import TABLES, write_tables
from vibroswarm.show.document import without_pictures
from vibroswarm.show.page import write_page

COLUMN = "paper"
"""Preset of the verdicts, of claims that are tested in it."""
PAGE = Path(__file__).parent / "figures" / "paper.md"
BEGIN, END = "<!-- controls: made by docs/make_controls.py -->", "<!-- controls: end -->"
HOLDS = "reproduced"


def others() -> dict[str, list[Item]]:
    """Items of which no claim is tested in ``COLUMN``, by the first preset of their claims."""
    found: dict[str, list[Item]] = {}
    for item in all_items():
        claims = [claim for claim in all_claims() if claim.item == item.name]
        if claims and not any(COLUMN in claim.columns for claim in claims):
            found.setdefault(claims[0].columns[0], []).append(item)
    return found


def verdicts(settings: Settings, folder: Path, items: Sequence[Item] | None = None) -> dict[str, str]:
    """Verdict by claim, in the one column of the settings."""
    (column,) = settings.columns

    def show(what: str, share: float) -> None:
        print(f"\r{settings.control or 'plain'}: {share:.0%}", end="", file=sys.stderr)

    made = reproduce(settings, folder, items, progress=show)
    write_tables(made, folder / TABLES)
    write_page(folder / "report.html", without_pictures(reproduction_document(made)))
    print(file=sys.stderr)
    decided: list[Decided] = made.decided
    return {one.claim.id: one.verdict for one in decided if one.column == column}


def table(found: Mapping[str | None, Mapping[str, str]], runs: int) -> tuple[str, list[str]]:
    """The table in Markdown, and the reproduced claims that do not change and give no reason."""
    lines = ["| claim | changed by |", "|---|---|"]
    without = []
    reproduced = [claim for claim in all_claims() if found[None].get(claim.id) == HOLDS]
    for claim in reproduced:
        turned: dict[str, list[str]] = {}
        for name in CONTROLS:
            turned.setdefault(found[name].get(claim.id, "not measured"), []).append(f"`{name}`")
        turned.pop(HOLDS, None)
        without += [] if turned or claim.no_control else [claim.id]
        words = "; ".join(f"{verdict}: {', '.join(names)}" for verdict, names in turned.items())
        lines.append(f"| `{claim.id}` | {words or f'none: {claim.no_control}'} |")
    claims = sum(claim.kind == "claim" and claim.id in found[None] for claim in all_claims())
    head = f"Of {claims} claims, {len(reproduced)} are reproduced with {runs} runs per cell:"
    return "\n".join([head, "", *lines]), without


def main() -> int:
    """Run everything, then print or write the table."""
    parser = argparse.ArgumentParser(description="Which verdicts change under which negative control.")
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--recordings", type=Path, default=os.environ.get("VIBROSWARM_RUGBOT"))
    parser.add_argument("--write", action="store_true", help="write the table into docs/figures/paper.md")
    arguments = parser.parse_args()
    recordings = None if arguments.recordings is None else Path(arguments.recordings)
    found = {}
    for control in (None, *CONTROLS):
        settings = Settings(arguments.runs, arguments.seed, (COLUMN,), control, recordings)
        folder = arguments.out / (control or "plain")
        found[control] = verdicts(settings, folder)
        for column, items in others().items():
            of_column = replace(settings, columns=(column,))
            found[control] |= verdicts(of_column, folder / column, items)
    text, without = table(found, arguments.runs)
    if arguments.write:
        page = PAGE.read_text(encoding="utf-8")
        before, after = page.index(BEGIN) + len(BEGIN), page.index(END)
        PAGE.write_text(f"{page[:before]}\n{text}\n\n{page[after:]}", encoding="utf-8")
    else:
        print(text)
    for name in without:
        print(f"{name}: reproduced, changed by no control, and gives no reason", file=sys.stderr)
    return 1 if without else 0


if __name__ == "__main__":
    raise SystemExit(main())
