"""Read the paper's own numbers, and make the scenarios of the columns of the reproduction.

``published.json`` holds the paper's numbers, printed or read off its figures: the only numbers that were typed in. A
column is a preset; its scenarios have the optimised parameters P* or the empirical parameters P0.

The recordings of real robots (``read_recordings``) are three sessions of five robots on one floor (``world.txt``);
three logs of the authors' simulator belong to them.
"""

from __future__ import annotations

import hashlib
import json
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from vibroswarm.errors import InputError
from vibroswarm.floors import read_tiles
from vibroswarm.floors.floor import Floor
from vibroswarm.networks.loss_by_size import MOST
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
    """Return the contents of ``published.json``."""
    return json.loads(files("vibroswarm.paper").joinpath("published.json").read_text(encoding="utf-8"))


def published(path: str) -> Any:
    """Return the value (a number, list or table) under a dotted name of ``published.json``.

    An example of a name is ``simulation.fill_ratios``.

    Raises:
        InputError: there is no such name.
    """
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

_THRESHOLD: Final = "walk.avoidance_threshold_mm"
"""Field of the distance at which robots turn away from obstacles."""


def scenario_of(
    column: str,
    values: dict[str, Any] | None = None,
    *,
    parameter_set: str = OPTIMISED,
) -> Scenario:
    """Return the scenario of a column.

    In `calibrated`, swarms larger than the recorded one, up to ``MOST`` robots, get the network ``loss_by_size``, in
    which the share of lost messages grows with the size of the swarm, unless ``values`` set the network. It is not
    fitted to larger swarms, which keep the network of the preset.

    Args:
        column: one of ``COLUMNS``. values: fields to set, by dotted name; they override those of P0.
        parameter_set: ``OPTIMISED`` (P*, which the presets have) or ``EMPIRICAL`` (P0).
    """
    base = preset(column)
    changes: dict[str, Any] = {}
    robots = (values or {}).get("swarm.robots", base.swarm.robots)
    if column == "calibrated" and RECORDED_ROBOTS < robots <= MOST and "network.name" not in (values or {}):
        changes["network.name"] = "loss_by_size"
    if parameter_set == EMPIRICAL:
        changes |= parameters("P0")
        # In a fitted preset, robots may turn at another distance than the commanded one. Presets have P*, and the same
        # factor between the two distances is used for P0. It is 1 in all of ``COLUMNS``.
        commanded = parameters("P_star")[_THRESHOLD]
        changes[_THRESHOLD] = float(changes[_THRESHOLD]) * base.walk.avoidance_threshold_mm / commanded
    changes |= values or {}
    return base.with_values(changes)


def fills() -> list[float]:
    """Return the fill ratios of the paper's simulations."""
    return [float(value) for value in published("simulation.fill_ratios")]


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


def missing(folder: Path | None) -> str | None:
    """Return why the recordings in a folder cannot be read, as a sentence for the report; None if they can be read.

    Args:
        folder: folder of the recordings; None: the user named none.
    """
    if folder is None:
        return (
            "It needs the study's recordings, which are not part of this software: name their folder with "
            "`--recordings` "
            "or in `VIBROSWARM_RUGBOT`."
        )
    gone = [name for name in (*REAL, *AUTHORS, FLOOR) if not (folder / name).is_file()]
    return f"The folder of recordings lacks {', '.join(gone)}." if gone else None


def hash_of(folder: Path) -> str:
    """Return the SHA-256 of the contents of all files that are read in a folder: recordings, logs and floor.

    All these files must exist, see ``missing``.
    """
    digest = hashlib.sha256()
    for name in (*REAL, *AUTHORS, FLOOR):
        digest.update((folder / name).read_bytes())
    return digest.hexdigest()


def read_recordings(folder: Path, names: tuple[str, ...]) -> Recording:
    """Read the logs with these file names as one recording, in which each log is a session (run).

    The files must exist, see ``missing``. Fields of the recording's scenario that neither the logs nor the floor
    determine have the values of preset ``paper``.
    """
    floor = Floor.filling(read_tiles(folder / FLOOR, SIZE), name=FLOOR)
    return recording_of([read_log(folder / name) for name in names], floor, preset("paper"))
