"""Write the standings of a league on motions of their own into ``figures/strategies.md``, between its marks.

vibroswarm league --own-motion --runs 300 --seed 2 --out out/own-motion
python docs/make_league.py out/own-motion
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

import polars as pl

PAGE = Path(__file__).parent / "figures" / "strategies.md"


def row_of(row: dict[str, float]) -> str:
    """Return a strategy's row of the table."""
    error, low, high = (100 * row[name] for name in ("forced_error", "forced_error_low", "forced_error_high"))
    times = f"{row['decision_time_s']:.0f} | {row['bytes_sent']:.0f}"
    return f"| `{row['name']}` | {error:.1f} [{low:.1f}, {high:.1f}] | {times} |"


def main() -> None:
    """Rewrite the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder of a league")
    standings = pl.read_csv(parser.parse_args().folder / "standings.csv").sort("forced_error")
    lines = [
        "| strategy | forced error, % | decision time, s | bytes of a robot |",
        "|---|---|---|---|",
        *map(row_of, standings.iter_rows(named=True)),
    ]
    page = PAGE.read_text(encoding="utf-8")
    marked = re.compile(r"(<!-- made: own motion -->\n).*?(<!-- end -->)", re.DOTALL)
    made = marked.sub(lambda found: found[1] + "\n".join(lines) + "\n" + found[2], page)
    PAGE.write_text(made, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
