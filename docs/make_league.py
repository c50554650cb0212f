"""Write each strategy's rows of two leagues into ``strategies.md``: the lines that begin with "- **League**".

vibroswarm league --runs 1000 --seed 2 --out out/league
vibroswarm league --own-motion --runs 300 --seed 2 --out out/own-motion
python docs/make_league.py out/league out/own-motion
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import polars as pl

PAGE = Path(__file__).with_name("strategies.md")
MARK = "- **League**"


def rows_of(folder: Path) -> dict[str, dict[str, float]]:
    """Return the standings of a league by strategy."""
    table = pl.read_csv(folder / "standings.csv")
    return {row["name"]: row for row in table.iter_rows(named=True)}


def line_of(name: str, shared: dict[str, float], own: dict[str, float]) -> str:
    """Return a strategy's line."""

    def figures(row: dict[str, float]) -> str:
        low, high = 100 * row["forced_error_low"], 100 * row["forced_error_high"]
        return f"{100 * row['forced_error']:.1f} % [{low:.1f}, {high:.1f}] in {row['decision_time_s']:.0f} s"

    return (
        f"{MARK} `{name}`: forced error {figures(shared)}, {shared['bytes_sent']:.0f} bytes per robot; "
        f"on its own motion {figures(own)}, {own['bytes_sent']:.0f} bytes."
    )


def main() -> None:
    """Rewrite the page."""
    shared, own = (rows_of(Path(folder)) for folder in sys.argv[1:3])
    sections = re.split(r"(?m)^(?=## )", PAGE.read_text(encoding="utf-8"))
    written = []
    for section in sections:
        names = [
            name for name in section.partition("\n")[0].removeprefix("## ").split(", ") if name in shared
        ]
        if names:
            kept = [line for line in section.rstrip("\n").splitlines() if not line.startswith(MARK)]
            if not kept[-1].startswith(("-", "  ")):
                kept.append("")
            section = "\n".join([*kept, *(line_of(name, shared[name], own[name]) for name in names)]) + "\n\n"
        written.append(section)
    PAGE.write_text("".join(written).rstrip("\n") + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
