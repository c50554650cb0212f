"""The document of a trade-off: how much time fewer wrong decisions cost.

The settings are combinations of the credible threshold p_c and the minimum of observations O_c. A setting is on the
front if no other setting is at least as good in decision time and in the share of robots wrong, and better in one of
them (``study.tradeoff``).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import polars as pl

from vibroswarm.analysis.decidability import decidability
from vibroswarm.core.numbers import Estimate, count, stated, with_limits
from vibroswarm.documents.cell_figures import figure_columns, with_limits_of
from vibroswarm.documents.knowledge import setting, told
from vibroswarm.plots.front import draw_front
from vibroswarm.plots.picture import Picture
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.show.document import Column, Document, Figure, Section, Table, Text
from vibroswarm.simulation import versions
from vibroswarm.study.tradeoff import Tradeoff


def tradeoff_document(found: Tradeoff) -> Document:
    """Return what a trade-off says: the ends of the front, the front, and all settings."""
    curve, scenario = found.curve, found.scenario
    decidable = decidability(scenario)
    front = curve.filter("pareto").sort("decision_time_s", maintain_order=True).drop("pareto")
    figure = Figure("front", lambda style: _draw_front(curve, style))
    on_front = (Section("The front", (Text(_FRONT), figure, _front_table(front))),) if front.height else ()
    return Document(
        title=f"Time against wrong decisions: {scenario.strategy.name}",
        answer=_answer(front, curve.height),
        knew=told([scenario]),
        warnings=(decidable.says if decidable.is_warning else "",),
        parts=(
            Text(_setting_of(curve, scenario)),
            Text("" if scenario.task.costs is None else _COSTS),
            *on_front,
            Section("All settings", (_all_table(curve),), folded=bool(on_front)),
        ),
        made_by={"scenario": scenario.hash, "seed": str(found.seed), **versions()},
        data={"tradeoff": curve},
    )


_COSTS: Final = (
    "Mistakes differ in cost (`task.costs`): a wrong decision counts by its cost, relative to the dearest."
)
_FRONT: Final = (
    "Settings on the front: no other is faster without being wrong more often. An undecided robot counts with the "
    "whole time, and not as wrong. The front is that of the estimates: the best of many settings are partly lucky, and "
    "worse on other seeds."
)


def _answer(front: pl.DataFrame, settings: int) -> tuple[str, ...]:
    """Return sentences on the ends of the front: the fastest, and the least often wrong."""
    rows = _distinct(front).to_dicts()
    if not rows:
        return ("No decision is right in these runs, so no setting has a share of wrong decisions.",)
    fastest, surest = rows[0], rows[-1]  # on the front, slower settings are wrong less often
    ends: tuple[str, ...] = (f"Fastest: {_words(fastest)}.", f"Least often wrong: {_words(surest)}.")
    if len(rows) == 1 and front.height == settings > 1:
        return (f"All {settings} settings decide alike: {_words(fastest)}.",)
    if len(rows) == 1:
        ends = (f"Fastest and least often wrong: {_words(fastest)}.",)
    if front.height == 1:
        return ends
    return (*ends, f"{front.height} of {count(settings, 'setting')} are on the front.")


def _words(row: Mapping[str, Any]) -> str:
    time, wrong, undecided = (
        Estimate.of(row, name) for name in ("decision_time_s", "error", "robots_undecided")
    )
    return (
        f"p_c {stated(row['credible_threshold'])}, O_c {row['min_observations']}, {with_limits(time, 's', 0)}, "
        f"{with_limits(wrong, '%')} of the robots wrong, {with_limits(undecided, '%')} undecided"
    )


def _setting_of(curve: pl.DataFrame, scenario: Scenario) -> str:
    return (
        f"How much time do fewer wrong decisions cost? Strategy {scenario.strategy.name}, {setting(scenario)}; "
        f"{count(curve.height, 'setting')} of p_c and O_c, replayed on the same {count(curve['runs'][0], 'run')}."
    )


_FIRST: Final = ("decision_time_s", "error", "robots_undecided", "robots_right", "swarm_right")
"""The figures that come first in tables."""


def _distinct(front: pl.DataFrame) -> pl.DataFrame:
    """Leave out settings that decide like an earlier one in all runs."""
    alike = ("decision_time_s", "error", "robots_undecided")
    return front.unique(alike, keep="first", maintain_order=True)


def _front_table(front: pl.DataFrame) -> Table:
    """Tabulate the settings on the front; of those that decide alike in all runs, the first."""
    rows = _distinct(front).select(*_SETTINGS, *with_limits_of(_FIRST, front.columns))
    columns = _SETTINGS | figure_columns(wide=_FIRST[3:])
    more = count(front.height - rows.height, "further setting")
    caption = f"{_CAPTION} {more} with the same figures left out." if rows.height < front.height else _CAPTION
    return Table(rows, columns, caption=caption, name="front", names=2)


def _all_table(curve: pl.DataFrame) -> Table:
    """Tabulate all settings with the first figures; all of them are too wide for a screen or a sheet."""
    rows = curve.select(*_SETTINGS, *with_limits_of(_FIRST, curve.columns), "pareto")
    columns = {**_SETTINGS, **figure_columns(), "pareto": Column("on the front")}
    caption = f"{_CAPTION} `tradeoff.csv` has all figures."
    return Table(rows, columns, caption=caption, name="tradeoff", names=2)


_SETTINGS: Final = {
    "credible_threshold": Column("p_c"),
    "min_observations": Column("O_c"),
}
_CAPTION: Final = (
    "p_c: credible threshold; O_c: minimum of observations. In brackets: 95 % intervals over runs."
)


def _draw_front(curve: pl.DataFrame, style: str) -> Picture:
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
