"""The documents of scenarios and of runs, which a notebook shows."""

from __future__ import annotations

import polars as pl

from vibroswarm.core.numbers import size, stated
from vibroswarm.errors import shown
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.show.document import Document, Section, Table, Text
from vibroswarm.study.runs import Runs


def scenario_document(scenario: Scenario) -> Document:
    """Return the document of a scenario: its most important fields, and all of them as TOML."""
    values = {
        "robots": str(scenario.swarm.robots),
        "strategy": scenario.strategy.name,
        "floor": shown(scenario.floor.source),
        "arena": size(scenario.arena.width_m, scenario.arena.height_m),
        "network": scenario.network.name,
        "task": scenario.task.name,
        "up to": f"{stated(scenario.run.t_end_s)} s",
        "hash": scenario.hash,
    }
    table = Table(pl.DataFrame({"field": list(values), "value": list(values.values())}), name="values")
    toml = Section("All fields (TOML)", (Text(scenario.to_toml(), "code"),), folded=True)
    return Document("Scenario", (), parts=(table, toml))


def runs_document(runs: Runs) -> Document:
    """Return the document of runs before they are summarised: their cells, and how many runs each has."""
    cells = runs.cell_table.select(
        pl.col("cell").cast(pl.String), "name", runs_wanted="wanted", runs_saved="there"
    )
    return Document("Runs", (repr(runs),), parts=(Table(cells, name="cells", names=2),))
