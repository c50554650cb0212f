"""Write the report of a league as one page: which entry (a strategy with settings) is best where, with intervals.

"The reference" is the entry with which all others are compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import polars as pl

from vibroswarm.league.report_sections import belief_sentences, beliefs_section, faults_section, limits_text
from vibroswarm.league.standings import Standings
from vibroswarm.plots.front import draw_front
from vibroswarm.plots.heat import draw_heat
from vibroswarm.report.html import Column, Report, ReportTable, Section, picture_of, write_report

REPORT = "report.html"
"""Name of the report's file."""
PERCENT = Column(percent=True)
COSTS = ("name", "told", "sent", "bytes_on_air", "bytes_sent")
"""Columns of the standings that the table of costs has."""
_COLUMNS = {
    "name": Column("entry"),
    "forced_error": Column("forced error", percent=True),
    "right": PERCENT,
    "wrong": PERCENT,
    "undecided": PERCENT,
    "decision_time_s": Column("decision time", "s"),
    "sent": Column("messages per robot"),
    "bytes_sent": Column("bytes per robot"),
    "bytes_on_air": Column("bytes per message"),
    "worst_floor": Column("worst floor"),
    "worst_floor_error": Column("error on it", percent=True),
    "told": Column("told to a robot"),
}
"""Headings and formats of the columns of the standings, by name."""


def write_league_report(folder: Path, standings: Standings, tables: Mapping[str, pl.DataFrame]) -> None:
    """Write the report of a league as ``report.html`` into a folder.

    Args:
        folder: it must exist. standings: results of the league.
        tables: tables by name: "differences" and "floor_differences" (of ``Standings``) and "fronts" (from
            ``front_table``), all with the same reference; optionally "beliefs" (from ``belief_calibration``) and
            "faults" (from ``fault_curves``).
    """
    write_report(folder / REPORT, report_of(standings, tables))


def report_of(standings: Standings, tables: Mapping[str, pl.DataFrame]) -> Report:
    """Lay out the report of a league: its sections, the sentences at its top, and the details at its end.

    Args:
        standings: results of the league. tables: the tables that ``write_league_report`` describes, by name.
    """
    table, league = standings.table, standings.league
    sections = (
        _time_and_error(table),
        Section(
            "What it costs, and what a robot is told",
            text=("Messages and bytes are those that a robot sends in a run.",),
            parts=(ReportTable(table.select(COSTS), _COLUMNS, name="costs"),),
        ),
        *_compared_section(tables["differences"]),
        *_fronts_section(tables["fronts"]),
        *beliefs_section(tables.get("beliefs")),
        *faults_section(tables.get("faults")),
        *_by_floor(standings.floor_table, tables["floor_differences"]),
        Section("Settings", parts=(ReportTable(_settings(standings), name="settings"),)),
    )
    details = {
        "floors": str(len(league.floors)),
        "robots": ", ".join(map(str, league.robots)),
        "runs": f"{league.runs} of each floor and size",
        "seed": str(league.seed),
        "base scenario": league.base.hash,
    }
    return Report(
        "League", lead=(*standings.notes, *answers(table, tables)), sections=sections, details=details
    )


def _time_and_error(table: pl.DataFrame) -> Section:
    """Return the section with the standings (``Standings.table``) and their picture."""
    front = draw_front(
        table.select(
            "name",
            error="forced_error",
            error_low="forced_error_low",
            error_high="forced_error_high",
            time="decision_time_s",
            time_low="decision_time_s_low",
            time_high="decision_time_s_high",
        ),
        error_label="forced error",
        percent=True,
        style="page",
    )
    text = (
        "Each point is an entry, averaged over all floors. An undecided robot counts with the whole time, and "
        "as wrong if it leans to the wrong side at the end (forced error)."
    )
    standings = ReportTable(_with_limits(table), _COLUMNS, name="standings")
    return Section("Time and error", text=(text,), parts=(picture_of(front, "front"), standings))


def _compared_section(differences: pl.DataFrame) -> tuple[Section, ...]:
    """Return the section with ``Standings.differences``; none for a single entry, which is compared with nothing."""
    if differences.is_empty():
        return ()
    text = (
        "Differences motion by motion (entry - reference), with 95 % intervals; p by Holm over the entries. "
        "No significant difference is not evidence of no difference."
    )
    table = ReportTable(_side_by_side(differences), {"name": Column("entry")}, name="differences")
    return (Section("Compared with the reference", text=(text,), parts=(table,)),)


def _by_floor(floors: pl.DataFrame, differences: pl.DataFrame) -> tuple[Section, ...]:
    """Return the sections on single floors: a picture, differences from the reference, and all figures.

    Args:
        floors: ``Standings.floor_table``. differences: ``Standings.floor_differences``.
    """
    heat = draw_heat(
        by_difficulty(floors),
        x_label="pattern and share of tiles in the minority",
        y_label="",
        label="forced error (%)",
        best="low",
        style="page",
    )
    all_figures = ReportTable(floors, _COLUMNS, name="floors")
    picture = (picture_of(heat, "floors"),)
    all_section = Section("All figures, floor by floor", parts=(all_figures,), folded=True)
    if differences.is_empty():  # a single entry, which is compared with nothing
        return (Section("Floor by floor", parts=picture), all_section)
    by_pair = ReportTable(differences, {"name": Column("entry")}, name="floor_differences")
    return (
        Section("Floor by floor", text=(_floors_text(differences),), parts=picture),
        Section("Differences from the reference, floor by floor", parts=(by_pair,), folded=True),
        all_section,
    )


def by_difficulty(floors: pl.DataFrame) -> pl.DataFrame:
    """Average each entry's forced error over a floor and its mirror 1 - f, for a heat map.

    Returns: x (pattern and the smaller fill ratio), y (entry) and value (forced error in %).
    """
    minority = pl.min_horizontal("fill_ratio", 1.0 - pl.col("fill_ratio")).round(6)
    return (
        floors.with_columns(x=pl.format("{} {}", "pattern", minority), y="name")
        .group_by("x", "y", maintain_order=True)
        .agg(value=100.0 * pl.col("forced_error").mean())
    )


def answers(table: pl.DataFrame, tables: Mapping[str, pl.DataFrame]) -> tuple[str, ...]:
    """Write the sentences at the top of the report.

    They name the fastest entry and the one with the smallest error, the entries that know the grid of tiles, the
    significant differences from the reference (over all floors and floor by floor), the fastest front, and the
    strategies whose robots are too confident.

    Args:
        table: the standings, by rising forced error.
        tables: the tables that ``write_league_report`` describes, by name.
    """
    differences, fronts = tables["differences"], tables["fronts"]
    fastest = table.sort("decision_time_s").row(0, named=True)
    surest = table.row(0, named=True)  # smallest forced error
    found = [
        f"Smallest forced error: {surest['name']}, {_share(surest, 'forced_error')}; it decides after "
        f"{surest['decision_time_s']:.0f} s. Fastest: {fastest['name']}, {fastest['decision_time_s']:.0f} s; its "
        f"forced error is {_share(fastest, 'forced_error')}."
    ]
    # Entries whose robots are told the grid of tiles. ``table`` may lack the column ``told``.
    if with_grid := [row["name"] for row in table.iter_rows(named=True) if "grid" in (row.get("told") or "")]:
        found.append(
            "Told the grid of tiles, which the other entries are not (with a wrong grid, worse than counting): "
            f"{', '.join(with_grid)}."
        )
    if differences.height:
        reference = differences["reference"][0]
        # For each entry the signs of its differences in forced error and in decision time: -1 if smaller than the
        # reference, which is better, 1 if larger, and 0 if no difference is shown.
        by_entry = {
            name: _signs(differences, name) for name in differences["name"].unique(maintain_order=True)
        }
        better = [
            name for name, (error, time) in by_entry.items() if error <= 0 and time <= 0 and error + time < 0
        ]
        worse = [
            name for name, (error, time) in by_entry.items() if error >= 0 and time >= 0 and error + time > 0
        ]
        mixed = [name for name, (error, time) in by_entry.items() if error * time < 0]
        kinds = (
            ("better in one and not shown to be worse in the other", better),
            ("worse in one and not shown to be better in the other", worse),
            ("better in one and worse in the other", mixed),
        )
        words = [f"{kind}: {', '.join(names)}" for kind, names in kinds if names]
        result = "; ".join(words) or "no difference shown"
        found.append(f"Time and forced error against {reference}, at p < 0.05 after Holm: {result}.")
        found.append(_floors_text(tables["floor_differences"]))
    # Fronts of more than one entry that reach the reference's error.
    several = fronts.filter((pl.col("points") > 1) & pl.col("time_at_equal_error_s").is_not_null())
    if several.height:
        best = several.sort("time_at_equal_error_s").row(0, named=True)
        found.append(
            f"At the forced error of {best['reference']}, the fastest front is that of {best['strategy']}: "
            f"{best['time_at_equal_error_s']:.0f} s, against {best['reference_time_s']:.0f} s."
        )
    found += belief_sentences(tables.get("beliefs"))
    return tuple(found)


def _floors_text(floors: pl.DataFrame) -> str:
    """Write the sentence that says on how many floors each entry errs significantly less, or more, than the reference.

    Args:
        floors: table from ``Standings.floor_differences``.
    """
    sure = floors.filter((pl.col("figure") == "forced_error") & (pl.col("p_holm") < 0.05))
    count = floors.select("pattern", "fill_ratio").unique().height
    if not sure.height:
        return f"Floor by floor, at p < 0.05 after Holm over strategies and {count} floors: no forced error differs."
    parts = []
    for name in sure["name"].unique(maintain_order=True):
        found = sure.filter(pl.col("name") == name)["difference"]
        numbers = (("fewer", int((found < 0).sum())), ("more", int((found > 0).sum())))
        parts.append(f"{name} " + ", ".join(f"{word} on {number}" for word, number in numbers if number))
    reference = floors["reference"][0]
    return (
        f"Forced errors against {reference} floor by floor, at p < 0.05 after Holm over strategies and {count} floors: "
        f"{'; '.join(parts)}."
    )


def _signs(differences: pl.DataFrame, name: str) -> tuple[int, int]:
    """Return the signs of an entry's differences from the reference: of forced error, and of decision time.

    A sign is 1 or -1 for a significant difference above or below 0 (p < 0.05 after Holm), else 0.
    """
    rows = {row["figure"]: row for row in differences.filter(pl.col("name") == name).iter_rows(named=True)}

    def sign(figure: str) -> int:
        """Return the sign of the entry's difference in one figure."""
        row = rows[figure]
        sure = row["p_holm"] is not None and row["p_holm"] < 0.05
        return 0 if not sure else 1 if row["difference"] > 0 else -1

    return sign("forced_error"), sign("decision_time_s")


def _share(row: Mapping[str, float], name: str) -> str:
    """Write a share in percent, with its limits in brackets if it has any."""
    low, high = row[f"{name}_low"], row[f"{name}_high"]
    limits = "" if low is None or high is None else f" [{100 * low:.1f}, {100 * high:.1f}]"
    return f"{100 * row[name]:.1f} %{limits}"


def _fronts_section(fronts: pl.DataFrame) -> tuple[Section, ...]:
    """Return a tuple with the section on the strategies' fronts; an empty tuple if no front has more than one point.

    Args:
        fronts: table from ``front_table``.
    """
    if not (fronts["points"] > 1).any():
        return ()
    rows = [
        {
            "strategy": row["strategy"],
            "entries on its front": row["points"],
            "time at equal error (s)": row["time_at_equal_error_s"],
            "time, 95 %": limits_text(row, "time_at_equal_error_s", scale=1, form=".0f"),
            "error at equal time (%)": _times_100(row["error_at_equal_time"]),
            "error, 95 %": limits_text(row, "error_at_equal_time", scale=100, form=".1f"),
        }
        for row in fronts.iter_rows(named=True)
    ]
    # All rows have the same reference.
    reference, time_s, error = fronts.select("reference", "reference_time_s", "reference_error").row(0)
    text = (
        f"Along the front of each strategy's own entries: the time at which it reaches the forced error of {reference} "
        f"({100 * error:.1f} %), and its forced error at the decision time of {reference} ({time_s:.0f} s). A dash: "
        "its front does not reach there."
    )
    table = ReportTable(pl.DataFrame(rows, infer_schema_length=None), name="fronts")
    return (Section("At equal error, and at equal time", text=(text,), parts=(table,)),)


def _side_by_side(differences: pl.DataFrame) -> pl.DataFrame:
    """Convert ``Standings.differences`` from one row per entry and figure to one row per entry.

    Each of the two figures has three columns: the difference, its limits as text, and the corrected p-value.
    """
    rows: dict[str, dict[str, Any]] = {}
    for row in differences.iter_rows(named=True):
        scale, title, form = (
            (100, "forced error (points)", "+.1f")
            if row["figure"] == "forced_error"
            else (1, "decision time (s)", "+.0f")
        )
        without_unit = title.partition(" (")[0]
        of_entry = rows.setdefault(row["name"], {"name": row["name"], "reference": row["reference"]})
        of_entry |= {  # changes the dictionary in ``rows``
            title: scale * row["difference"],
            f"{without_unit}, 95 %": limits_text(row, "difference", scale=scale, form=form),
            f"{without_unit}, p": row["p_holm"],
        }
    return pl.DataFrame(list(rows.values()), infer_schema_length=None)


def _times_100(value: float | None) -> float | None:
    """Convert a share to percent; None stays None."""
    return None if value is None else 100.0 * value


def _with_limits(table: pl.DataFrame) -> pl.DataFrame:
    """Return the table of standings that the report shows, with the limits of a figure as text in the next column.

    The limits of right, wrong and undecided are left out. Messages and bytes have a table of their own (``COSTS``).
    """
    rows = [
        {
            "name": row["name"],
            "forced_error": row["forced_error"],
            "forced error, 95 %": limits_text(row, "forced_error", scale=100, form=".1f"),
            "right": row["right"],
            "wrong": row["wrong"],
            "undecided": row["undecided"],
            "decision_time_s": row["decision_time_s"],
            "time, 95 %": limits_text(row, "decision_time_s", scale=1, form=".0f"),
            "worst_floor": row["worst_floor"],
            "worst_floor_error": row["worst_floor_error"],
            "error on it, 95 %": limits_text(row, "worst_floor_error", scale=100, form=".1f"),
        }
        for row in table.iter_rows(named=True)
    ]
    return pl.DataFrame(rows)


def _settings(standings: Standings) -> pl.DataFrame:
    """Return one row per entry: name, its settings as text, and whether they were given for the league."""
    rows = [
        (
            entry.label,
            ", ".join(f"{name} = {value}" for name, value in entry.settings.items()) or "by default",
            "yes" if entry.tuned else "no",
        )
        for entry in standings.league.entries
    ]
    return pl.DataFrame(rows, schema=["name", "settings", "tuned"], orient="row")
