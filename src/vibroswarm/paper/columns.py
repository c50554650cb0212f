"""Read the paper's own numbers, and make the scenarios of the columns of the reproduction.

``published.json`` holds the paper's numbers, printed or read off its figures: the only numbers that were typed in. A
column is a preset; its scenarios have the optimised parameters P* or the empirical parameters P0. A negative control
changes every scenario in a way that must change the verdicts; if it did not, the claims would test nothing.

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

from vibroswarm.errors import InputError, check_choice
from vibroswarm.floors import read_tiles
from vibroswarm.floors.floor import Floor
from vibroswarm.networks.loss_by_size import MOST
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.log_readers import read_log
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

CONTROLS: Final = {
    "labels": "the energies of vibrating and still tiles are swapped, as the paper prints them",
    "threshold": "the sensor's threshold is 1.55, as in Algorithm 2",
    "false-positives": "24 % of the still tiles read as vibrating and 4.5 % of the vibrating ones as still, with the "
    "same total number of errors",
    "standstill": "robots hardly move (a twentieth of their speed, with normal turns) and never avoid",
    "no-messages": "no message arrives",
    "losses": "a tenth of the messages is lost, independently at each receiver",
}
"""Negative controls: changes of every scenario that must change the verdicts."""
VARIANTS: Final = {
    "physics": "energies are computed from the vibration of tiles (sensor `acceleration`), and not drawn from laws",
}
"""Other changes of every scenario, which show what verdicts depend on."""
CHANGES: Final = CONTROLS | VARIANTS

RECORDED_ROBOTS: Final = 5
"""Robots in the recordings to which `calibrated` is fitted, and with them its share of lost messages."""

FALSE: Final = (0.24, 0.045)
"""False positive and false negative rate under the control "false-positives"; both are 14 % in the simulations."""
SLOWER: Final = 0.05
"""Factor of the robots' speed under the control "standstill"."""

_THRESHOLD: Final = "walk.avoidance_threshold_mm"
"""Field of the distance at which robots turn away from obstacles."""
_OF_LAWS: Final = tuple(
    f"sensor.{name}" for name in ("edge_reach_m", "edge_blur_m", "tile_spread", "robot_spread")
)
"""Options that change the law of a kind of tile."""


def scenario_of(
    column: str,
    values: dict[str, Any] | None = None,
    *,
    parameter_set: str = OPTIMISED,
    control: str | None = None,
) -> Scenario:
    """Return the scenario of a column.

    In `calibrated`, swarms larger than the recorded one, up to ``MOST`` robots, get the network ``loss_by_size``, in
    which the share of lost messages grows with the size of the swarm, unless ``values`` set the network. It is not
    fitted to larger swarms, which keep the network of the preset.

    Args:
        column: one of ``COLUMNS``. values: fields to set, by dotted name; they override those of P0.
        parameter_set: ``OPTIMISED`` (P*, which the presets have) or ``EMPIRICAL`` (P0).
        control: negative control or variant, one of ``CHANGES``; None: no control.
    Raises:
        InputError: no such control.
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
    if control is not None:
        changes |= _controlled(base.with_values(changes), control)
    return base.with_values(changes)


def _controlled(scenario: Scenario, control: str) -> dict[str, Any]:
    """Return the fields that a negative control or variant sets in this scenario, by dotted name; see ``CHANGES``.

    Raises:
        InputError: no such control.
    """
    check_choice(control, "--control", CHANGES)
    return _COMPUTED[control](scenario) if control in _COMPUTED else _FIXED[control]


def standing(scenario: Scenario) -> dict[str, Any]:
    """Return the fields, by dotted name, of robots that hardly move and never avoid.

    The distances between the wheels shrink as the speed does, so robots turn as fast as before. Robots never avoid,
    because nothing is nearer than the threshold 0.
    """
    slowed = ("full_speed_m_s", "drive_track_m", "turn_track_m")
    return {f"robot.{name}": getattr(scenario.robot, name) * SLOWER for name in slowed} | {_THRESHOLD: 0.0}


def with_errors(scenario: Scenario) -> dict[str, Any]:
    """Return the fields, by dotted name, that give the sensor the error rates ``FALSE``.

    They are the share of the readings of still tiles that are above the threshold, and the share of those of vibrating
    tiles that are below it. The energy distributions of both kinds of tiles are shifted; their shapes and scales stay.
    """
    from scipy.stats import gamma  # here, because importing it takes long

    sensor, changes = scenario.sensor, {}
    false_positive, false_negative = FALSE
    for kind, share_above in (("still", false_positive), ("vibrating", 1.0 - false_negative)):
        shape, scale = (float(getattr(sensor, f"{kind}_{name}")) for name in ("shape", "scale"))
        # The energy that ``share_above`` of the unshifted energies exceed is moved to the threshold.
        exceeded = float(gamma.isf(share_above, shape, scale=scale))
        changes[f"sensor.{kind}_location"] = sensor.rms_threshold - exceeded
    return changes


def swapped_labels(scenario: Scenario) -> dict[str, Any]:
    """Return the fields, by dotted name, that swap the energy distributions of vibrating and still tiles."""
    return {
        f"sensor.{kind}_{name}": getattr(scenario.sensor, f"{other}_{name}")
        for kind, other in (("vibrating", "still"), ("still", "vibrating"))
        for name in ("shape", "scale", "location")  # parameters of the Gamma distribution
    }


_FIXED: Final[dict[str, dict[str, Any]]] = {
    "threshold": {"sensor.rms_threshold": 1.55},  # the threshold in the paper's Algorithm 2
    "no-messages": {"network.name": "loss", "network.loss.share": 1.0},
    "losses": {"network.name": "loss", "network.loss.share": 0.1},
    "physics": {"sensor.model": "acceleration"} | dict.fromkeys(_OF_LAWS),
}
"""Fields of the controls and variants that set the same in every scenario."""
_COMPUTED: Final = {"labels": swapped_labels, "false-positives": with_errors, "standstill": standing}
"""Functions of the others."""


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
