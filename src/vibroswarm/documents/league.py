"""The documents of a league (which entry, a strategy with its settings, is best, and where) and of a tuning."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, cast

import polars as pl

from vibroswarm.core.numbers import Estimate, count, listed, percent, span, whole, with_limits
from vibroswarm.documents.cell_figures import SIZES, TIME_AND_ERROR, figure_columns, map_table, with_limits_of
from vibroswarm.documents.file import NO_FIELDS
from vibroswarm.documents.knowledge import told
from vibroswarm.documents.league_answer import answers
from vibroswarm.league.belief_calibration import AT_95
from vibroswarm.league.entries import MAIN_AIM
from vibroswarm.league.fronts import NOT, OPEN, REACHES
from vibroswarm.league.standings import League, Standings
from vibroswarm.league.tuning import Tuned
from vibroswarm.league.words import league_tables
from vibroswarm.plots.error_bars import draw_error_bars
from vibroswarm.plots.front import draw_front
from vibroswarm.plots.heat import draw_heat
from vibroswarm.show.document import Column, Document, Figure, Part, Section, Table, Text, if_any
from vibroswarm.simulation import versions
from vibroswarm.study.factors import LABEL

ENTRY: Final = Column("entry")
SHARE: Final = Column(share=True)
FIGURES: Final = {
    "name": ENTRY,
    "forced_error": Column("forced error", share=True),
    "right": Column(share=True, wide=True),
    "wrong": SHARE,
    "undecided": SHARE,
    "decision_time_s": Column("decision time", "s", decimals=0),
    "worst_floor": Column("worst floor", wide=True),
    "worst_floor_error": Column("error on it", share=True, wide=True),
    "fill_ratio": Column("fill ratio"),
    "sent": Column("messages per robot", decimals=0),
    "bytes_on_air": Column("bytes per message"),
    "bytes_sent": Column("bytes per robot", decimals=0),
    "told": Column("what a robot knows"),
}
"""Headings and formats of the figures of entries, by column."""
DIFFERENCES: Final = {
    "name": ENTRY,
    "fill_ratio": FIGURES["fill_ratio"],
    "forced_error": Column("forced error", "points", share=True, sign=True, strip=True),
    "forced_error_p": Column("p", p_value=True),
    "decision_time_s": Column("decision time", "s", decimals=0, sign=True, strip=True),
    "decision_time_s_p": Column("p", p_value=True),
}
"""Headings and formats of differences from the reference, by column."""


def league_document(standings: Standings, tables: Mapping[str, pl.DataFrame] | None = None) -> Document:
    """Return the document of a league.

    Args:
        tables: by name: those of ``league_tables``, and "beliefs" (from ``belief_calibration``) and "summary"
            (``Standings.summary``) if these were computed. None: those of ``league_tables``.
    """
    league = standings.league
    tables = league_tables(standings) if tables is None else tables
    return Document(
        title="League",
        answer=answers(standings, tables),
        knew=(*told(cell.scenario for cell in league.study.cells), _wrong_grid_sentence(standings.table)),
        warnings=(_warning(league),),
        parts=(
            *_fronts(standings, tables["fronts"]),
            _time_and_error(standings),
            _costs(standings.main.table),
            *if_any(tables.get("maps"), lambda maps: _maps_of_main_entries(standings, maps)),
            *_differences(
                tables["differences"],
                "differences",
                "Difference from {}",
                "Entry - reference, motion by motion, with 95 % intervals; p by Holm over the entries. No significant "
                "difference is not evidence of no difference.",
                "name",
                # it compares single settings of fronts
                folded=len(league.entries) > len(standings.main.league.entries),
            ),
            *if_any(tables.get("beliefs"), _beliefs),
            *_by_floor(standings.main.floor_table, tables["floor_differences"], league.base.sensor.kinds),
            *if_any(tables.get("summary"), _all_figures),
            *_every_setting(standings),
            _settings(league),
        ),
        made_by={
            "floors": str(len(league.floors)),
            "robots": ", ".join(map(str, league.robots)),
            "runs": f"{whole(league.runs)} of each floor and swarm size",
            "seed": str(league.seed),
            "base scenario": league.base.hash,
            **versions(),
        },
        data=tables,
    )


def _warning(league: League) -> str:
    names = [entry.label for entry in league.entries if not entry.tuned]
    return f"Not tuned for a league (`vibroswarm league tune`): {', '.join(names)}." if names else ""


def _wrong_grid_sentence(table: pl.DataFrame) -> str:
    with_grid = table.filter(pl.col("told").str.split(", ").list.contains("grid"))["name"]
    if len(with_grid) in (0, table.height):
        return ""
    return f"With a wrong grid of tiles {listed(with_grid)} would do worse than by counting."


def _time_and_error(standings: Standings) -> Section:
    """Return the section with the standings of the main entries, and their picture if there are no others."""
    table, league = standings.main.table, standings.league
    points = table.select("name", **TIME_AND_ERROR)
    frame = table.select(
        "name",
        *with_limits_of(["forced_error"], table.columns),
        "right",
        "wrong",
        "undecided",
        *with_limits_of(["decision_time_s", "worst_floor", "worst_floor_error"], table.columns),
    )
    words = (
        f"Averages over {count(len(league.floors), 'floor')} and swarms of {listed(map(str, league.robots))}; "
        f"{count(league.runs, 'run')} of each, 95 % intervals over motions. Forced error: wrong, or undecided and "
        "leaning to the wrong side at the end. Undecided robots count with the whole time. The worst floor is chosen "
        "by other motions than those that measure it."
    )
    front = Figure(
        "front",
        lambda style: draw_front(points, error_label="forced error", percent=True, style=style),
    )
    if table.height < standings.table.height:
        words = f"For each strategy the setting tuned for {percent(MAIN_AIM, 0)}, or the nearest that it has. {words}"
        return Section(
            "One setting of each", (Table(frame, FIGURES, name="main"), Text(words, "aside")), folded=True
        )
    return Section("Time and error", (front, Table(frame, FIGURES, name="standings"), Text(words, "aside")))


def _costs(table: pl.DataFrame) -> Section:
    costs = Table(
        table.select("name", "told", "sent", "bytes_on_air", "bytes_sent"),
        FIGURES,
        caption="Messages and bytes are those that a robot sends in a run.",
        name="costs",
        folded=True,
    )
    return Section("What it costs, and what a robot knows", (costs,))


def _maps_of_main_entries(standings: Standings, maps: pl.DataFrame) -> tuple[Section, ...]:
    shown = maps.filter(pl.col("name").is_in(standings.main.table["name"].to_list()))
    return (Section("Maps", (map_table(shown, {"name": ENTRY}),)),)


def _differences(
    differences: pl.DataFrame, name: str, title: str, words: str, *index: str, folded: bool
) -> tuple[Section, ...]:
    """Return a section of differences from the reference; none for a single entry.

    In ``title`` {} becomes the reference; ``index``: columns of which each row has other values.
    """
    if differences.is_empty():
        return ()
    table = Table(_side_by_side(differences, *index), DIFFERENCES, name=name, names=len(index))
    parts = (table, Text(words, "aside"))
    return (Section(title.format(differences["reference"][0]), parts, folded=folded),)


def _side_by_side(differences: pl.DataFrame, *index: str) -> pl.DataFrame:
    """Put the differences in forced error and decision time beside each other: one row per index, in place of two."""
    frame = differences.select(*index)
    values: list[str] = [name for name in ("difference", "difference_low", "difference_high", "p_holm")
              if name in differences.columns]  # fmt: skip
    frame = frame.unique(maintain_order=True)
    for figure in ("forced_error", "decision_time_s"):
        of_figure = differences.filter(figure=figure)
        names = {
            value: value.replace("difference", figure).replace("p_holm", f"{figure}_p") for value in values
        }
        frame = frame.join(
            of_figure.select(*index, *values).rename(names), on=index, how="left", maintain_order="left"
        )
    return frame


def _fronts(standings: Standings, fronts: pl.DataFrame) -> tuple[Section, ...]:
    """Return the section on the fronts of strategies; none if every strategy has a single entry.

    Args:
        fronts: from ``front_table``.
    """
    if len(standings.league.entries) == fronts["strategy"].n_unique():
        return ()
    words = (
        "The settings of a strategy, each a point of its front, were chosen on other motions and floors. Between two "
        "of them, a swarm draws one for each run. Times are read at the same forced errors for all, which no strategy "
        "sets. An asterisk: among the fastest, which do not differ significantly (paired bootstrap, intervals that "
        "hold together with 95 % for all pairs at that error). A dash: not reached; errs less: along its whole front; "
        "open: reached in some bootstrap draws."
    )
    levels = _levels(fronts)
    compared = fronts.filter(reached=REACHES).drop("reached")
    columns = {
        "level": Column("forced error", share=True, decimals=0),
        "time_s": Column("time", "s", decimals=0),
        "behind_s": Column("behind the fastest", "s", decimals=0, sign=True, strip=True),
        "in_group": Column("among the fastest"),
    }
    table = Table(compared, columns, name="fronts", names=2, folded=True)
    below: list[Part] = [Text(words, "aside"), table] if compared.height else []
    return (Section("Time at equal error", (_fronts_figure(standings), *levels, *below)),)


def _levels(fronts: pl.DataFrame) -> tuple[Table, ...]:
    """Return the table of times, one row per strategy and one column per level that one of them reaches."""
    shown = fronts.filter(pl.col("reached").is_in([REACHES, OPEN]).any().over("level"))
    if shown.is_empty():
        return ()
    order = (
        shown.group_by("strategy", maintain_order=True)
        .agg(pl.col("time_s").last())
        .sort("time_s", nulls_last=True)
    )
    frame = order.select(name="strategy")
    columns: dict[str, Column] = {"name": Column("strategy")}
    for (level,), at_level in shown.group_by("level", maintain_order=True):
        title = f"time at {percent(cast(float, level), 0)}"
        cells = [
            {"name": row["strategy"], title: _time_in_words(row)} for row in at_level.iter_rows(named=True)
        ]
        frame = frame.join(pl.DataFrame(cells), on="name", how="left", maintain_order="left")
        columns[title] = Column(unit="s")
    return (Table(frame, columns, name="levels"),)


def _time_in_words(row: Mapping[str, Any]) -> str:
    if row["reached"] != REACHES:
        return "-" if row["reached"] == NOT else str(row["reached"])
    return with_limits(Estimate.of(row, "time_s"), "", 0) + ("*" if row["in_group"] else "")


def _fronts_figure(standings: Standings) -> Figure:
    marks = standings.table.sort("decision_time_s").select(
        x="decision_time_s",
        series="strategy",
        estimate="forced_error",
        low="forced_error_low",
        high="forced_error_high",
    )
    return Figure(
        "fronts",
        lambda style: draw_error_bars(
            marks.unique(["x", "series"], maintain_order=True),
            x_label="decision time (s)",
            label="forced error",
            interval="95 % interval over motions, which all strategies share",
            percent=True,
            style=style,
        ),
    )


def _every_setting(standings: Standings) -> tuple[Section, ...]:
    """Return the folded section with the standings of all entries, if ``_time_and_error`` shows only some."""
    table = standings.table
    if table.height == standings.main.table.height:
        return ()
    frame = table.select("name", *with_limits_of(["forced_error"], table.columns), "right", "wrong", "undecided",
                         *with_limits_of(["decision_time_s"], table.columns))  # fmt: skip
    return (Section("All settings", (Table(frame, FIGURES, name="standings"),), folded=True),)


def _beliefs(beliefs: pl.DataFrame) -> tuple[Section, ...]:
    """Return the section that compares the robots' confidence with how often they are right."""
    words = (
        "Robots that decided: their mean confidence, and the share of them that were right. Floors are those that the "
        "strategy expects (its own prior of the fill ratio), or have tiles that vibrate independently. "
        f"'{AT_95}': p_c = 0.95 and O_c = 0."
    )
    columns = {
        "name": ENTRY,
        "prior": Column("floors"),
        "confidence": Column(share=True),
        "right": Column(share=True),
        "decided": Column(share=True, decimals=0),
    }
    frame = beliefs.select(
        "name", "settings", "prior", *with_limits_of(["confidence", "right"], beliefs.columns), "decided"
    )
    marks = [
        {"x": f"{row['name']}, {row['settings']}", "series": f"{name}, {row['prior']}"}
        | {to: row[f"{name}{end}"] for to, end in (("estimate", ""), ("low", "_low"), ("high", "_high"))}
        for row in beliefs.iter_rows(named=True)
        for name in ("confidence", "right")
    ]
    figure = Figure(
        "beliefs",
        lambda style: draw_error_bars(
            pl.DataFrame(marks, infer_schema_length=None), label="robots that decided", percent=True,
            interval="95 % jackknife interval over motions", style=style,
        ),
    )  # fmt: skip
    table = Table(frame, columns, name="beliefs", names=3, folded=True)
    return (Section("Belief and truth", (figure, table, Text(words, "aside"))),)


def _by_floor(floors: pl.DataFrame, differences: pl.DataFrame, kinds: int) -> tuple[Section, ...]:
    """Return the sections on single floors: a picture, differences from the reference, and all figures.

    Args:
        floors: ``Standings.floor_table``. differences: ``Standings.floor_differences``; empty for a single entry.
        kinds: of tile.
    """
    share = "tiles in the minority" if kinds == 2 else "kind 1"
    picture = Figure(
        "floors",
        lambda style: draw_heat(
            by_difficulty(floors, kinds), x_label=f"pattern and share of {share}", y_label="",
            label="forced error (%)", best="low", style=style,
        ),
    )  # fmt: skip
    every = Table(floors.drop("strategy"), FIGURES, name="floors", names=3)
    return (
        Section("Floor by floor", (picture,)),
        *_differences(
            differences,
            "floor_differences",
            "Differences from the reference, floor by floor",
            "Entry - reference; p by Holm over entries and floors.",
            "name",
            "pattern",
            "fill_ratio",
            folded=True,
        ),
        Section("All figures, floor by floor", (every,), folded=True),
    )


def _all_figures(summary: pl.DataFrame) -> tuple[Section, ...]:
    """Return the section with all figures of the main entries, from ``Standings.summary``."""
    formats = figure_columns()
    shown = [name for name in summary.columns if name in formats and name not in SIZES]
    means = summary.group_by(name=LABEL, maintain_order=True).agg(pl.col(shown).mean())
    caption = "Means over floors and swarm sizes. `summary.csv` has each of them, with intervals."
    table = Table(
        means, {**formats, "name": ENTRY, "sent": FIGURES["sent"]}, name="figures", caption=caption, names=1
    )
    return (Section("All figures of an entry", (table,), folded=True),)


def by_difficulty(floors: pl.DataFrame, kinds: int = 2) -> pl.DataFrame:
    """Average each entry's forced error over a floor and its mirror 1 - f, for a heat map.

    Floors of more kinds of tile have no mirror.

    Returns: x (pattern and the smaller fill ratio, or the share of kind 1), y (entry) and value (forced error in %).
    """
    share = pl.col("fill_ratio")
    if kinds == 2:
        share = pl.min_horizontal(share, 1.0 - share)
    return (
        floors.with_columns(x=pl.format("{} {}", "pattern", share.round(6)), y="name")
        .group_by("x", "y", maintain_order=True)
        .agg(value=100.0 * pl.col("forced_error").mean())
    )


def _settings(league: League) -> Section:
    """Return the section with the fields that each entry sets."""
    rows = [
        (
            entry.label,
            entry.strategy,
            ", ".join(f"{name} = {value}" for name, value in entry.settings.items()) or "by default",
            entry.tuned,
        )
        for entry in league.entries
    ]
    frame = pl.DataFrame(rows, schema=["name", "strategy", "settings", "tuned"], orient="row")
    columns = {"name": ENTRY, "settings": Column(prose=True)}
    return Section("Settings", (Table(frame, columns, name="settings", folded=True),))


COLUMNS: Final = {
    "is_chosen": Column("chosen"),
    "forced_error": Column("forced error", share=True),
    "decision_time_s": Column("decision time", "s", decimals=0),
    "settings": Column(prose=True),
}


def tune_document(tuned: Tuned) -> Document:
    """Return the document of a tuning."""
    settings = pl.when(pl.col("settings") == "").then(pl.lit(NO_FIELDS)).otherwise("settings")
    table = tuned.table.with_columns(settings=settings)
    chosen = table.filter("is_chosen").drop("name", "is_chosen").sort("strategy", "forced_error")
    return Document(
        title="Settings for a league",
        answer=tuple(
            _chosen_settings_in_words(name, chosen.filter(strategy=name)) for name in tuned.settings
        ),
        warnings=("The figures favour the settings that were lucky: play a league with a seed of no round.",),
        parts=(
            Table(chosen, COLUMNS, name="settings"),
            Text(tuned.how, "aside"),
            Section(
                "All settings of the last round",
                (Table(table.drop("strategy"), COLUMNS, name="finalists"),),
                folded=True,
            ),
        ),
    )


def _chosen_settings_in_words(name: str, chosen: pl.DataFrame) -> str:
    errors, times = (
        span([100 * error for error in chosen["forced_error"]], 1),
        span(chosen["decision_time_s"], 0),
    )
    return f"{name}: {count(chosen.height, 'setting')} along its front, {errors} % forced error in {times} s."
