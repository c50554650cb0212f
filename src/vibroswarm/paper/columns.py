"""Read the paper's own numbers, and make the scenarios of the columns of the reproduction.

``published.json`` holds the paper's numbers, printed or read off its figures: the only numbers that were typed in. A
column is a preset, with the optimised parameters P* or the empirical parameters P0.
"""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from vibroswarm.errors import InputError
from vibroswarm.floors import read_tiles
from vibroswarm.floors.floor import Floor
from vibroswarm.networks.loss import MOST
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.read import read_log
from vibroswarm.recordings.recording import Recording
from vibroswarm.scenario.scenario import Scenario, preset

FIELDS: Final = {
    "gamma0_ms": "walk.walk_duration_location_ms",
    "gamma_ms": "walk.walk_duration_scale_ms",
    "tau_ms": "sample.sample_interval_ms",
    "theta_c_mm": "walk.avoidance_threshold_mm",
    "O_c": "decision.min_observations",
}
"""Names of the optimised parameters in the paper, and the fields of a scenario."""


@cache
def _all() -> Any:
    return json.loads(files("vibroswarm.paper").joinpath("published.json").read_text(encoding="utf-8"))


def published(path: str) -> Any:
    """Return the value (a number, list or table) under a dotted name of ``published.json``."""
    node = _all()
    for name in path.split("."):
        if not isinstance(node, dict) or name not in node:
            raise InputError("is not a number of the paper", field=path)
        node = node[name]
    return node


def parameters(name: str) -> dict[str, Any]:
    """Return the scenario fields, by dotted name, that the parameter set ``P0`` or ``P_star`` sets."""
    values = zip(published("parameters.names"), published(f"parameters.{name}"), strict=True)
    return {FIELDS[key]: value for key, value in values}


COLUMNS: Final = ("paper", "text", "calibrated")
"""Presets of the reproduction: each has a column in its tables."""
OPTIMISED, EMPIRICAL = "P*", "P0"
"""The paper's parameter sets: P* of its search, and P0, from which the search started."""
STRATEGIES: Final = ("none", "positive", "soft")
"""No feedback, positive feedback, soft feedback. Items rely on this order."""

RECORDED_ROBOTS: Final = 5
"""Robots in the recordings to which `calibrated` is fitted, and with them its share of lost messages."""


def scenario_of(
    column: str, values: dict[str, Any] | None = None, *, parameter_set: str = OPTIMISED
) -> Scenario:
    """Return the scenario of a column."""
    fields = parameters("P0") if parameter_set == EMPIRICAL else {}
    return adapted(column, preset(column).with_values(fields | (values or {})))


def adapted(column: str, scenario: Scenario) -> Scenario:
    """Return a scenario of `calibrated` with a loss of messages that grows with the swarm, unless it sets its own."""
    is_larger = RECORDED_ROBOTS < scenario.swarm.robots <= MOST
    if column == "calibrated" and is_larger and scenario.network == preset(column).network:
        return scenario.with_values({"network.name": "loss_by_size"})
    return scenario


def sizes() -> list[int]:
    """Return the swarm sizes of the paper."""
    return [int(value) for value in published("simulation.swarm_sizes")]


REAL_FLOOR: Final = "real-floor"
"""Name of the floor of the recordings in scenarios."""
ROWS: Final = ("01010", "10010", "10101", "01101", "10010")
"""Rows from the top; 12 of the 25 tiles vibrate."""


def real_floor() -> dict[str, Any]:
    """Return the fields, by dotted name, that put a scenario on the floor of the recordings."""
    return {"floor.source": REAL_FLOOR, "floor.tiles": ROWS}


REAL: Final = tuple(f"CAL_{session}.csv" for session in (1, 2, 3))
"""Files of the recordings."""
AUTHORS: Final = tuple(f"webots_log_{session}.txt" for session in (0, 1, 2))
"""Logs of the authors' simulator."""
FLOOR: Final = "world.txt"
"""File with the tiles of the floor."""
SIZE: Final = (5, 5)
"""Rows and columns of tiles in that file."""


def missing_in(folder: Path | None) -> str:
    """Return why the recordings in a folder cannot be read; empty if they can."""
    if folder is None:
        return "needs the study's recordings: name their folder with --recordings or in VIBROSWARM_RUGBOT"
    gone = [name for name in (*REAL, *AUTHORS, FLOOR) if not (folder / name).is_file()]
    return f"the folder of recordings lacks {', '.join(gone)}" if gone else ""


def read_recordings(folder: Path, names: tuple[str, ...]) -> Recording:
    """Read the logs with these file names as one recording, in which each log is a session (run)."""
    floor = Floor.filling(read_tiles(folder / FLOOR, SIZE), name=FLOOR)
    return recording_of([read_log(folder / name) for name in names], floor, preset("paper"))
