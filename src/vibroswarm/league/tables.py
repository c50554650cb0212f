"""The tables of a league by name."""

from __future__ import annotations

import polars as pl

from vibroswarm.league.best import best_table
from vibroswarm.league.fronts import front_table
from vibroswarm.league.standings import Standings


def league_tables(standings: Standings, reference: str | None = None) -> dict[str, pl.DataFrame]:
    """Compute the tables of a league that need no further runs.

    Args:
        reference: label of the entry with which others are compared, or name of its strategy; by default the first.
    Returns: "fronts" (from ``front_table``), "best" (from ``best_table``), "standings" and "floors" of ``Standings``;
        of its ``main`` entries "differences" and "floor_differences"; and "maps" if robots keep maps.
    Raises:
        InputError: there is no such entry.
    """
    main, maps = standings.main, standings.maps
    return {
        "fronts": front_table(standings),
        "best": best_table(standings),
        "standings": standings.table,
        "differences": main.differences(reference),
        "floor_differences": main.floor_differences(reference),
        "floors": standings.floor_table,
    } | ({"maps": maps} if maps.height else {})
