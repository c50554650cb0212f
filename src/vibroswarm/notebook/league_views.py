"""What a notebook shows of a league and its standings."""

from __future__ import annotations

from typing import Any

from vibroswarm.league.standings import League, Standings
from vibroswarm.notebook.elements import card, paragraph, table
from vibroswarm.notebook.views import view_of

HEADS = ("entry", "forced error, %", "right, %", "wrong, %", "undecided, %", "decision time, s", "messages")


@view_of.register
def _standings(value: Standings) -> str:
    """Show one row per entry with intervals, those with the smallest forced error first."""
    body = [
        [
            row["name"],
            _interval(row, "forced_error", 100.0, 1),
            *(f"{100 * row[name]:.1f}" for name in ("right", "wrong", "undecided")),
            _interval(row, "decision_time_s", 1.0, 0),
            f"{row['sent']:.0f}",
        ]
        for row in value.table.iter_rows(named=True)
    ]
    return card(
        "Standings of a league",
        paragraph(_words(value.league)),
        table(HEADS, body),
        paragraph("95 % intervals. Next: .table, .differences(), .floor_table"),
    )


@view_of.register
def _league(value: League) -> str:
    body = [[entry.label, entry.strategy, len(entry.settings)] for entry in value.entries]
    return card("League", paragraph(_words(value)), table(["entry", "strategy", "fields set"], body, texts=2))


def _words(league: League) -> str:
    sizes = " and ".join(map(str, league.robots))
    return (
        f"{len(league.entries)} entries, {len(league.floors)} floors, {sizes} robots, {league.runs:,} runs of each; "
        f"seed {league.seed}"
    )


def _interval(row: dict[str, Any], name: str, scale: float, digits: int) -> str:
    if row[name] is None:
        return "-"
    text = f"{scale * row[name]:.{digits}f}"
    limits = [row[f"{name}_low"], row[f"{name}_high"]]
    return (
        text if None in limits else f"{text} [{', '.join(f'{scale * limit:.{digits}f}' for limit in limits)}]"
    )
