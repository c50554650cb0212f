"""Make the table of docs/paper.md that says which verdicts turn under which negative control.

    python docs/make_controls.py --runs 500 --out out/controls [--recordings DIR] [--write]

It runs ``vibroswarm reproduce`` plainly and under each control, for preset ``paper``, and goes on where it was stopped.
Exit code 1: a claim that is reproduced turns under no control, and does not say why (``no_control`` in claims.toml).
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping
from pathlib import Path

from vibroswarm.paper.claims import Decided, all_claims
from vibroswarm.paper.columns import CONTROLS
from vibroswarm.paper.item import Settings
from vibroswarm.paper.report import write_all
from vibroswarm.paper.reproduce import reproduce

COLUMN = "paper"
PAGE = Path(__file__).parent / "paper.md"
BEGIN, END = "<!-- controls: made by docs/make_controls.py -->", "<!-- controls: end -->"
HOLDS = "reproduced"


def verdicts(settings: Settings, folder: Path) -> dict[str, str]:
    """Verdict by claim."""

    def told(what: str, share: float) -> None:
        print(f"\r{settings.control or 'plain'}: {share:.0%}", end="", file=sys.stderr)

    made = reproduce(settings, folder, tell=told)
    write_all(made, folder, pictures=False)
    print(file=sys.stderr)
    decided: list[Decided] = made.decided
    return {one.claim.id: one.verdict for one in decided if one.column == COLUMN}


def table(found: Mapping[str | None, Mapping[str, str]], runs: int) -> tuple[str, list[str]]:
    """The table in Markdown, and the claims that are reproduced, do not turn, and do not say why."""
    lines = ["| claim | " + " | ".join(f"`{name}`" for name in CONTROLS) + " | turned by |"]
    lines += ["|---" * (len(CONTROLS) + 2) + "|"]
    without = []
    reproduced = [claim for claim in all_claims() if found[None].get(claim.id) == HOLDS]
    for claim in reproduced:
        mine = {name: found[name].get(claim.id, "not measured") for name in CONTROLS}
        turned = [name for name, verdict in mine.items() if verdict != HOLDS]
        last = str(len(turned)) if turned else f"none: {claim.no_control}"
        without += [] if turned or claim.no_control else [claim.id]
        words = ["holds" if verdict == HOLDS else f"**{verdict}**" for verdict in mine.values()]
        lines.append(f"| `{claim.id}` | " + " | ".join(words) + f" | {last} |")
    asked = sum(claim.kind == "claim" and claim.id in found[None] for claim in all_claims())
    head = f"Of {asked} claims, {len(reproduced)} are reproduced with {runs} runs a cell:"
    return "\n".join([head, "", *lines]), without


def main() -> int:
    """Run all, print or write the table."""
    parser = argparse.ArgumentParser(description="Which verdicts turn under which negative control.")
    parser.add_argument("--runs", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--recordings", type=Path, default=os.environ.get("VIBROSWARM_RUGBOT"))
    parser.add_argument("--write", action="store_true", help="put the table into docs/paper.md")
    asked = parser.parse_args()
    recordings = None if asked.recordings is None else Path(asked.recordings)
    found = {}
    for control in (None, *CONTROLS):
        settings = Settings(asked.runs, asked.seed, (COLUMN,), control, recordings)
        found[control] = verdicts(settings, asked.out / (control or "plain"))
    text, without = table(found, asked.runs)
    if asked.write:
        page = PAGE.read_text(encoding="utf-8")
        before, after = page.index(BEGIN) + len(BEGIN), page.index(END)
        PAGE.write_text(f"{page[:before]}\n{text}\n\n{page[after:]}", encoding="utf-8")
    else:
        print(text)
    for name in without:
        print(f"{name}: reproduced, turned by no control, and does not say why", file=sys.stderr)
    return 1 if without else 0


if __name__ == "__main__":
    raise SystemExit(main())
