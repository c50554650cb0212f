"""The tables of a league by name."""

from __future__ import annotations

import polars as pl

from vibroswarm.league.fronts import front_table
from vibroswarm.league.standings import Standings


def league_tables(standings: Standings, reference: str | None = None) -> dict[str, pl.DataFrame]:
    """Compute the tables of a league that need no further runs.

    Args:
        reference: label of the entry with which others are compared; by default the first.
    Returns: "standings", "differences", "floor_differences" and "floors" of ``Standings``, and "fronts" (from
        ``front_table``).
    Raises:
        InputError: no entry has the label ``reference``.
    """
    return {
        "standings": standings.table,
        "differences": standings.differences(reference),
        "floor_differences": standings.floor_differences(reference),
        "fronts": front_table(standings, reference),
        "floors": standings.floor_table,
    }
