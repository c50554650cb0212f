"""The report of ``detect``: which fill ratios are found, by how many robots, and how soon.

A floor is *missed* in a run without a right consensus, a *false alarm* is a wrong consensus on "more". A floor is
*found* when its misses and the false alarms on some floor below are both rare (``study.detection``).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Final

import polars as pl

from vibroswarm.core.numbers import count, stated, stated_percent
from vibroswarm.plots.curves import draw_detection
from vibroswarm.plots.picture import Picture
from vibroswarm.report.knowledge import known_beyond, setting
from vibroswarm.report.report import Figure, Report, Table, report
from vibroswarm.simulation import versions
from vibroswarm.study.detection import Detection

MOST_CURVES: Final = 8
"""Most numbers of robots with a picture of their own."""


@report.register
def of_detection(detection: Detection) -> Report:
    """Return which floors robots find, and how soon."""
    tables, scenario = detection.tables, detection.scenario
    hardest = hardest_pairs(tables["pairs"])
    end, alarms = stated(scenario.run.t_end_s), stated_percent(detection.false_alarms)
    found_caption = f"Floors above the boundary; empty: not found by {end} s."
    needed_caption = f"By {end} s, with upper limits (95 %, Wilson) that must be below what is tolerated."
    titles = {
        "fill_ratio_below_share": f"at most {alarms} false alarms on floors up to",
        "time_s": "found within",
    }
    knows = known_beyond([scenario])[0]
    parts: dict[str, Table | Figure] = {
        "found": Table(_as_shares(hardest), "Found", found_caption, titles),
        "every_floor": Table(
            _needed(tables["needed"], scenario.run.t_end_s), "Every floor", needed_caption, NEEDED
        ),
        **dict(_figures(detection)),
        **{name: Table(tables[name], title, folded=True) for name, title in FOLDED.items() if name in tables},
    }
    asked = setting(scenario, ("floor.source", "swarm.robots"))
    runs = f"{count(detection.runs, 'run')} each, seed {detection.seed}"
    return Report(
        title="How many robots, and how much time?",
        answer=tuple(_answer(hardest, detection)),
        parts=parts,
        setting=f"{asked}; {runs}{f'; robots know {knows}' if knows else ''}",
        warnings=detection.warnings,
        made_by={"scenario": scenario.hash, "seed": str(detection.seed), **versions()},
    )


FOLDED: Final = {
    "needed": "Every floor, all columns",
    "detection": "Misses and false alarms over time",
    "pairs": "All pairs of floors",
    "summary": "All figures",
}
NEEDED: Final = {
    "missed_share": "missed",
    "false_alarm_share": "false alarms",
    "needed_s": "time needed",
    "clear_until_s": "no alarms until",
}


def hardest_pairs(pairs: pl.DataFrame) -> pl.DataFrame:
    """Select, for each floor above the boundary and number of robots, the highest floor below that they distinguish."""
    is_found = pl.col("time_s").is_not_null()
    order = ["fill_ratio", "robots", is_found, "fill_ratio_below"]
    chosen = pairs.sort(order, descending=[False, False, True, True]).group_by(
        "fill_ratio", "robots", maintain_order=True
    )
    return chosen.first().with_columns(
        pl.when(is_found).then(name).alias(name) for name in ("fill_ratio_below", "fewest")
    )


def _as_shares(frame: pl.DataFrame) -> pl.DataFrame:
    names = ("fill_ratio", "fill_ratio_below", "missed", "wrong", "false_alarm")
    renamed = {
        f"{robots}{name}{end}": f"{robots}{name}_share{end}"
        for robots in ("", "robots_")
        for name in names
        for end in ("", "_low", "_high")
    }
    return frame.rename({old: new for old, new in renamed.items() if old in frame.columns})


def _needed(needed: pl.DataFrame, t_end_s: float) -> pl.DataFrame:
    """Select misses and false alarms at the end, and times; a missing false alarm is that of the whole run."""
    clear = pl.when(pl.col("truth") == 0).then(pl.col("clear_until_s").fill_null(t_end_s))
    columns = (
        "fill_ratio",
        "robots",
        "missed",
        "missed_high",
        "needed_s",
        "false_alarm",
        "false_alarm_high",
        "clear_until_s",
    )
    highs = {"missed_high": "missed_limit_share", "false_alarm_high": "false_alarm_limit_share"}
    return _as_shares(needed.with_columns(clear_until_s=clear).select(columns).rename(highs))


def _answer(hardest: pl.DataFrame, detection: Detection) -> Iterator[str]:
    scenario = detection.scenario
    boundary = stated_percent(scenario.decision.decision_boundary)
    if hardest.is_empty():
        yield f"All floors are on one side of {boundary}: misses and false alarms cannot be compared."
        return
    if detection.runs < detection.runs_needed:
        yield f"Too few runs to say: at least {count(detection.runs_needed, 'run')} each are needed (--runs)."
        return
    for (robots,), rows in hardest.group_by("robots", maintain_order=True):
        nearest = rows.drop_nulls("time_s").sort("fill_ratio").head(1).to_dicts()
        who = f"{count(robots, 'robot')} with {scenario.strategy.name}"
        if not nearest:
            yield f"{who}: none of these floors within {stated(scenario.run.t_end_s)} s."
            continue
        row = nearest[0]
        share, below = stated_percent(row["fill_ratio"]), stated_percent(row["fill_ratio_below"])
        yield f"{who}: {share} vibrating is told from {below} within {row['time_s']:.0f} s."


def _figures(detection: Detection) -> Iterator[tuple[str, Figure]]:
    """Yield misses against the fill ratio: a picture for each number of robots, a line for each time."""
    curve = detection.tables["detection"].drop_nulls("missed")
    for robots in curve["robots"].unique().sort().to_list()[:MOST_CURVES]:
        times = pl.format("{} s", pl.col("horizon_s").round(0).cast(pl.Int64))
        part = curve.filter(robots=robots).with_columns(series=times)
        title = f"Misses against the fill ratio: {count(robots, 'robot')}"
        yield f"detection_{robots}", Figure(partial(_draw, detection, part), title)


def _draw(detection: Detection, part: pl.DataFrame) -> Picture:
    frame = part.select("fill_ratio", "missed", "runs", "series", low="missed_low", high="missed_high")
    names = part["series"].unique(maintain_order=True).to_list()
    order = pl.col("series").replace_strict(names, range(len(names)), return_dtype=pl.Int64)
    return draw_detection(
        frame.sort(order, "fill_ratio"),
        boundary=detection.scenario.decision.decision_boundary,
        tolerated=detection.error,
        percent=True,
    )
