"""The page of a trade-off: how much time fewer wrong decisions cost.

The settings are combinations of the credible threshold p_c and the minimum of observations O_c. A setting is on the
front if no other setting is at least as good in decision time and in the share of robots wrong, and better in one of
them (``analysis.tradeoff``).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import polars as pl

from vibroswarm.analysis.true_places import true_places_notes
from vibroswarm.plots.front import draw_front
from vibroswarm.plots.picture import Picture
from vibroswarm.report.html import Column, Report, ReportTable, Section, picture_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.show.markup import minus_signs
from vibroswarm.simulation import versions

_SHARES: Final = {
    "error": "robots wrong",
    "robots_undecided": "robots undecided",
    "robots_right": "robots right",
    "swarm_right": "swarms right",
}
"""Shares in the tables of settings, with their headings."""


def front_picture(curve: pl.DataFrame, style: str) -> Picture:
    """Draw decision time against the share of robots wrong, a point for each setting.

    Args:
        curve: table of ``analysis.tradeoff.time_error_curve`` with ``undecided_counts=0``, so that its column ``error``
            is the share of robots wrong. style: one of ``plots.style``.
    """
    frame = curve.select(
        "error",
        "error_low",
        "error_high",
        "runs",
        name=pl.format("p_c {}, O_c {}", "credible_threshold", "min_observations"),
        time="decision_time_s",
        time_low="decision_time_s_low",
        time_high="decision_time_s_high",
        front="pareto",
    )
    return draw_front(frame, error_label="robots wrong", percent=True, style=style)


def answer(curve: pl.DataFrame, scenario: Scenario) -> list[str]:
    """Return notes, the question, and sentences on the ends of the front: the fastest, and the least often wrong.

    Args:
        curve: as in ``front_picture``. scenario: the scenario whose settings are varied.
    """
    front = curve.filter("pareto").sort("decision_time_s").to_dicts()
    notes = true_places_notes([scenario])
    question = (
        f"How much time do fewer wrong decisions cost? {scenario.strategy.name}, {scenario.swarm.robots} robots, floor "
        f"{scenario.floor.source}, up to {scenario.run.t_end_s:g} s; {curve.height} settings of p_c and O_c, replayed "
        f"on the same {curve['runs'][0]:,} runs."  # all settings have the same runs
    )
    if not front:
        return [*notes, question, "No setting has both a time and a share of wrong decisions."]
    fastest, surest = front[0], front[-1]  # on the front, slower settings are wrong less often
    sentences = [*notes, question, f"Fastest: {_setting(fastest)}, {_figures(fastest)}."]
    if len(front) > 1:
        sentences.append(f"Least often wrong: {_setting(surest)}, {_figures(surest)}.")
        sentences.append(
            f"{len(front)} of {curve.height} settings are on the front: no other is faster without being wrong more "
            "often. An undecided robot counts with the whole time, and not as wrong."
        )
    return sentences


def _setting(row: Mapping[str, Any]) -> str:
    """Name the setting of a row of the curve."""
    return f"p_c {row['credible_threshold']:g}, O_c {row['min_observations']}"


def _figures(row: Mapping[str, Any]) -> str:
    """Write decision time, robots wrong and robots undecided of a row of the curve, with their intervals."""

    def limits(name: str, scale: float, decimals: int) -> str:
        """Write the interval of a figure in brackets after a space; empty if it has none."""
        low, high = row[f"{name}_low"], row[f"{name}_high"]
        if low is None or high is None:
            return ""
        return f" [{scale * low:.{decimals}f}, {scale * high:.{decimals}f}]"

    return (
        f"{row['decision_time_s']:.0f} s{limits('decision_time_s', 1, 0)}, "
        f"{100 * row['error']:.1f} %{limits('error', 100, 1)} of the robots wrong, "
        f"{100 * row['robots_undecided']:.1f} %{limits('robots_undecided', 100, 1)} undecided"
    )


def report_of(curve: pl.DataFrame, scenario: Scenario, seed: int, *, with_picture: bool = True) -> Report:
    """Lay out the page.

    Args:
        curve: as in ``front_picture``. scenario, seed: of the replayed runs. with_picture: whether to draw the front.
    """
    picture = (picture_of(front_picture(curve, "page"), "front"),) if with_picture else ()
    front = curve.filter("pareto").sort("decision_time_s")
    text = (
        "The front is that of the estimates: the best of many settings are partly lucky, and worse on other seeds.",
    )
    return Report(
        title=f"Time against wrong decisions: {scenario.strategy.name}",
        lead=tuple(map(minus_signs, answer(curve, scenario))),
        sections=(
            Section("The front", text=text, parts=(*picture, _table(front, "front"))),
            Section("All settings", parts=(_table(curve, "tradeoff"),), folded=True),
        ),
        details={"scenario": scenario.hash, "seed": str(seed), **versions()},
    )


def _table(rows: pl.DataFrame, name: str) -> ReportTable:
    """Tabulate settings with their figures and intervals; ``name`` is that of the table in the page."""
    columns = {
        "credible_threshold": Column("credible threshold p_c"),
        "min_observations": Column("minimum of observations O_c"),
        "decision_time_s": Column(
            "decision time", "s", decimals=0, limits=("decision_time_s_low", "decision_time_s_high")
        ),
    }
    columns |= {
        key: Column(words, percent=True, limits=(f"{key}_low", f"{key}_high"))
        for key, words in _SHARES.items()
    }
    names = [end for key, column in columns.items() for end in (key, *(column.limits or ()))]
    caption = "In brackets: 95 % intervals over runs."
    return ReportTable(rows.select(names), columns, caption=caption, name=name)
