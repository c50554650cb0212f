"""Time, error, cost and belief of each entry of a league, and differences from a reference, with intervals over runs.

The unit is the run: entries and floors share its motion, so figures are averaged over floors and swarm sizes first, or
over those that are not told apart (``by``). They hold for this set of floors and sizes, which all count the same.

| column | what it is |
|---|---|
| p_c, O_c | confidence, and number of readings and messages, that a robot needs; null if its strategy does not use it |
| settings | own parameters of the strategy, and other fields that the entry sets |
| knows | what a robot knows in advance |
| forced_error | share of robots wrong, or undecided and leaning to the wrong side |
| sent, message_bytes, bytes_sent | messages that a robot sends in a run; bytes of one; bytes of all |
| confidence_share, right_share | of robots that decided: mean confidence at decision time, share of right decisions |
| too_confident | whether the interval of right_share lies below that of confidence_share, on these floors |
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.numbers import stated
from vibroswarm.errors import check_choice
from vibroswarm.inference.agents import strategy_used
from vibroswarm.league.entries import Entry, LeagueFloor
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.statistics.figures import BY_COLUMN
from vibroswarm.statistics.intervals import cluster_shares, columns_of
from vibroswarm.statistics.paired import compare, holm
from vibroswarm.strategies.static_analysis import fields_read, told
from vibroswarm.study.cells import Cell
from vibroswarm.study.runs import Runs

FIGURES: Final = ("forced_error", "right_share", "wrong_share", "undecided_share", "decision_time_s", "sent")
"""Figures of runs that are averaged."""
COMPARED: Final = ("forced_error", "decision_time_s")
"""Figures that are compared with the reference."""
ENTRY: Final = ("name", "strategy", "p_c", "O_c", "settings")
"""What names an entry in all tables."""


def cell_table(
    cells: Sequence[Cell], entries: Sequence[Entry], floors: Sequence[LeagueFloor]
) -> pl.DataFrame:
    """Return a row for each cell of the league's study: cell, floor, robots, and what is known of its entry."""
    names = {floor.source: floor.name for floor in floors}
    each = len(cells) // len(entries)  # the cells of an entry follow each other
    rows = [
        {
            "cell": cell.number,
            "floor": names[cell.point["floor.source"]],
            "robots": cell.point["swarm.robots"],
            **_entry_columns(entries[place // each], cell.scenario),
        }
        for place, cell in enumerate(cells)
    ]
    return pl.DataFrame(rows, infer_schema_length=None, schema_overrides={"cell": pl.UInt32})


def _entry_columns(entry: Entry, scenario: Scenario) -> dict[str, Any]:
    strategy, decision, own = (
        strategy_used(scenario),
        scenario.decision,
        scenario.strategy.params.model_dump(),
    )
    read = fields_read(strategy)
    others = {
        field.rpartition(".")[2]: value
        for field, value in entry.settings.items()
        if not field.startswith(("decision.", "strategy."))
    }
    settings = [
        f"{name} {stated(value) if isinstance(value, float) else value}"
        for name, value in (own | others).items()
    ]
    return {
        "name": entry.name,
        "strategy": scenario.strategy.selected,
        "p_c": decision.credible_threshold if "credible_threshold" in read else None,
        "O_c": decision.min_observations if "min_observations" in read else None,
        "settings": ", ".join(settings),
        "knows": ", ".join(told(strategy, decision.boundary_of)),
        "message_bytes": strategy.bytes_on_air,
        "t_end_s": scenario.run.t_end_s,
    }


def units_of(runs: Runs, cells: pl.DataFrame, by: Sequence[str] = ()) -> pl.DataFrame:
    """Return figures of runs, means over the floors and swarm sizes that are not told apart."""
    keys = [*by, *cells.columns[3:], "run"]
    rows = runs.rows(*FIGURES).join(cells, on="cell", maintain_order="left")
    return rows.group_by(keys, maintain_order=True).agg(pl.col(FIGURES).mean())


def standing_table(units: pl.DataFrame, by: Sequence[str] = ()) -> pl.DataFrame:
    """Return a row for each group and entry with its figures and their limits, by rising forced error, then time."""
    keys, rows = [*by, *ENTRY, "knows", "message_bytes"], []
    for own in units.partition_by([*by, "name"], maintain_order=True):
        first = own.row(0, named=True)
        row = {key: first[key] for key in keys}
        for figure in FIGURES:
            interval = BY_COLUMN[figure].mean(own[figure].to_numpy(), t_end_s=first["t_end_s"])
            row |= columns_of(figure, interval)
        rows.append(row | {"bytes_sent": row["sent"] * row["message_bytes"]})
    frame = pl.DataFrame(rows, infer_schema_length=None)
    return frame.sort(*by, "forced_error", "decision_time_s", nulls_last=True, maintain_order=True)


def difference_table(units: pl.DataFrame, reference: str | None = None) -> pl.DataFrame:
    """Compare each entry with a reference (entry, or strategy; None: the first), run by run, in ``COMPARED``."""
    entries = units.select("name", "strategy").unique(maintain_order=True)
    if reference is not None:
        check_choice(reference, "--reference", [*entries["name"], *entries["strategy"]])
        entries = entries.filter((pl.col("name") == reference) | (pl.col("strategy") == reference))
    against = entries["name"][0]
    parts = units.partition_by("name", maintain_order=True, as_dict=True)
    other = parts.pop((against,))
    rows = []
    for figure in COMPARED:
        compared = [compare(own, other, [figure])[0] for own in parts.values()]
        corrected = holm([one.p_value for one in compared])
        for own, one, p_holm in zip(parts.values(), compared, corrected, strict=True):
            row = own.select(ENTRY).row(0, named=True) | {"reference": against, "figure": figure}
            rows.append(row | columns_of("difference", one.difference) | {"p_holm": p_holm})
    return pl.DataFrame(rows, infer_schema_length=None)


def belief_table(runs: Runs, cells: pl.DataFrame) -> pl.DataFrame:
    """Return a row for each entry whose robots decided with a belief."""
    decision, below = pl.col("robot.decision"), pl.col("robot.belief_below")
    lists = "robot.decision", "robot.belief_below"
    robots = runs.rows("truth", *lists).explode(*lists).drop_nulls()
    by_run = (
        robots.join(cells, on="cell")
        .group_by(*ENTRY, "run", maintain_order=True)
        .agg(
            robots=pl.len(),
            decided=(decision >= 0).sum(),
            confidence=pl.when(decision == 0).then(below).when(decision > 0).then(1.0 - below).sum(),
            right=(decision == pl.col("truth")).sum(),
        )
    )
    rows = []
    for own in by_run.partition_by("name", maintain_order=True):
        sums = own.select("confidence", "right").to_numpy().T
        row = own.select(ENTRY).row(0, named=True)
        row["decided_share"] = int(own["decided"].sum()) / int(own["robots"].sum())
        confidence, right = np.transpose(cluster_shares(sums, own["decided"])).tolist()
        row |= columns_of("confidence_share", confidence) | columns_of("right_share", right)
        rows.append(row | {"too_confident": right[2] < confidence[1]})
    return pl.DataFrame(rows, infer_schema_length=None)
