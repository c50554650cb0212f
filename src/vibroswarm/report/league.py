"""The report of a league: time at equal error, standings, differences, and whether robots are too confident."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Final

import polars as pl

from vibroswarm.core.numbers import count, listed, number, percent
from vibroswarm.league.fronts import LEVELS, guess_level
from vibroswarm.league.play import League, Standings
from vibroswarm.plots.front import draw_front
from vibroswarm.plots.picture import Picture
from vibroswarm.report.report import Figure, Report, Table, report
from vibroswarm.simulation import versions

MANY: Final = 12
"""Settings from which their table is folded."""
TITLES: Final = {"fastest": "", "p_c": "p_c", "O_c": "O_c", "behind_s": "behind the fastest"}


@report.register
def of_league(standings: Standings) -> Report:
    """Return what a league says."""
    league, tables = standings.league, standings.tables
    by = [name for name in ("floor", "robots") if name in tables.get("fronts_by", pl.DataFrame()).columns]
    parts: dict[str, Table | Figure] = {
        "front": Figure(partial(_front, tables["standings"]), "Time and error"),
        "fronts": Table(
            _with_asterisks(tables["fronts"]),
            "Time at equal error",
            "Least time of the settings with at most this error, with 95 % bootstrap limits; no upper limit: some "
            "draws do not reach it. *: does not differ from the fastest. p (Holm): against the fastest.",
            TITLES,
        ),
        "standings": Table(
            tables["standings"],
            "Standings",
            "Means over floors and swarm sizes, with 95 % intervals over runs. Forced error: wrong, or undecided and "
            "leaning to the wrong side. Undecided robots count with the whole run.",
            TITLES,
            tables["standings"].height > MANY,
        ),
    }
    if by:
        named = f"by {listed(by)}"
        parts["fronts_by"] = Table(
            _with_asterisks(tables["fronts_by"]), f"Time at equal error {named}", titles=TITLES
        )
        parts["standings_by"] = Table(tables["standings_by"], f"Standings {named}", "", TITLES, True)
    if tables["differences"].height:
        reference = tables["differences"]["reference"][0]
        frame = tables["differences"].drop("reference")
        parts["differences"] = Table(frame, f"Difference from {reference}", "Run by run.", TITLES, True)
    if tables["beliefs"].height:
        caption = "Of the robots that decided, on these floors; too confident: intervals do not overlap."
        parts["beliefs"] = Table(tables["beliefs"], "Belief and truth", caption, TITLES, True)
    without = [entry.name for entry in league.entries if not entry.settings]
    return Report(
        title="League",
        answer=tuple(_answer(league, tables["fronts"], tables["standings"])),
        parts=parts,
        setting=f"{count(len(league.floors), 'floor')}, swarms of {listed(map(str, league.robots))}, "
        f"{count(league.runs, 'run')} each, seed {league.seed}",
        warnings=(f"With default settings, not chosen for a league: {listed(without)}.",) if without else (),
        made_by={"seed": str(league.seed), "base scenario": league.base.hash, **versions()},
    )


def _answer(league: League, fronts: pl.DataFrame, standings: pl.DataFrame) -> Iterator[str]:
    fastest = [
        f"at {percent(level[0], 0)} {listed(own['strategy'])} ({number(own['time_s'][0], 0)} s)"
        for level, own in fronts.filter("fastest").group_by("forced_error", maintain_order=True)
    ]
    most = percent(LEVELS[-1], 0)
    yield f"Fastest by forced error: {'; '.join(fastest) or f'no strategy reaches {most}'}."
    level = guess_level(league.base)
    lowest = standings.group_by("strategy", maintain_order=True).agg(pl.col("forced_error_high").min())
    guessing = lowest.filter(pl.col("forced_error_high") >= level)["strategy"]
    if len(guessing):
        yield f"No better than a guess (forced error below {percent(level, 0)} not shown): {listed(guessing)}."


def _with_asterisks(fronts: pl.DataFrame) -> pl.DataFrame:
    """Return the rows of strategies that some draws reach, with an asterisk beside the fastest."""
    star = pl.when("fastest").then(pl.lit("*")).otherwise(pl.lit(""))
    first = [name for name in ("floor", "robots") if name in fronts.columns]
    return fronts.filter(pl.col("reached_share") > 0.0).select(
        *first, "forced_error", "strategy", "^time_s.*$", star.alias("fastest"), "^behind_s.*$", "p_holm",
        "reached_share", "name", "p_c", "O_c", "settings",
    )  # fmt: skip


def _front(standings: pl.DataFrame) -> Picture:
    columns = {"time": "decision_time_s", "error": "forced_error"}
    limits = {f"{to}{end}": f"{name}{end}" for to, name in columns.items() for end in ("", "_low", "_high")}
    points = standings.select("name", "strategy", **limits)
    return draw_front(points, series="strategy", error_label="forced error", percent=True)
