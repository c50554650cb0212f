"""Where the law of the sensor is known from: a scenario, measured energies, or sessions on a known floor.

A law that was fitted is not exact. Its error is a number of laws fitted to resampled references (``Law.draws``):

| reference | resampled |
|---|---|
| measured energies | the energies of each kind, with replacement |
| sessions | robots in sessions (``fit_sensor``), and the mean factor of the tiles and robots that were there |

The tiles and robots of a reference are a sample of all: with spreads s_t and s_r, the mean of their log factors has a
standard deviation of sqrt(s_t^2 / tiles + s_r^2 / robots), which multiplies all values of the law alike.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.intervals import generator
from vibroswarm.calibrate.camera import RIGHT, Camera, corrected
from vibroswarm.calibrate.dataset import Dataset, dataset_of
from vibroswarm.calibrate.fit_camera import fit_camera
from vibroswarm.calibrate.fit_sensor import FIELDS, SPREADS, SensorFit, fit_sensor
from vibroswarm.core.atomic_io import write_text
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError
from vibroswarm.inspection.samples import SELF_JUDGED, Law, session_hash
from vibroswarm.observation.decision_boundary import grid_of
from vibroswarm.observation.measured_csv import read_energies
from vibroswarm.recordings.recording import Recording
from vibroswarm.recordings.threshold import robot_clusters
from vibroswarm.result import Result
from vibroswarm.scenario.presets import preset_names
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.show.numbers import count

DRAWS: Final = 20
"""Laws fitted to resampled references, for an inspection."""
KEPT: Final = 40
"""The same in a file of a law."""
SCALED: Final = (
    "vibrating_scale",
    "vibrating_location",
    "still_scale",
    "still_location",
)
"""Fields that a factor of all values multiplies."""


@dataclass(frozen=True)
class FittedLaw(NotebookView):
    """A law fitted to sessions on a known floor, and the camera that saw them."""

    law: Law
    camera: Camera


def law_of_sessions(found: Dataset, sessions: Sequence[int], words: str, *, draws: int = DRAWS) -> FittedLaw:
    """Fit the law of the sensor and the camera to some sessions.

    Differences between tiles and robots are part of the law: a sample counts less because of them.

    Args:
        found: recordings, with positions as the camera saw them. sessions: numbers of those that are used.
        words: what the sessions are. draws: laws of resampled sessions; 0: the law's error is not needed.
    Raises:
        InputError: all samples lie on one kind of tile.
    """
    chosen = found.only(sessions)
    camera = fit_camera(chosen, draws=0).camera
    seen = chosen.corrected(camera)
    fitted = fit_sensor(seen, draws=draws)
    base = found.results[0].scenario
    return FittedLaw(
        Law(
            _sensor_of(base, fitted.values),
            words,
            hashlib.sha256(csv_bytes(chosen.samples)).hexdigest()[:16],
            _hashes(found, sessions),
            tuple(_sensor_of(base, values) for values in _drawn(fitted, seen, draws)),
        ),
        camera,
    )


def _sensor_of(base: Scenario, values: dict[str, float]) -> Any:
    """Return the sensor of a scenario with fitted values, by field; without a difference a spread is None."""
    rounded = {f"sensor.{name}": round(values[name], 5) for name in FIELDS}
    spreads = {f"sensor.{name}": round(values[name], 5) or None for name in SPREADS}
    return base.with_values({"sensor.model": "gamma"} | rounded | spreads).sensor


def _drawn(fitted: SensorFit, seen: Dataset, draws: int) -> list[dict[str, float]]:
    """Return the values of each draw by field, with the error of the mean factor of the tiles and robots."""
    samples = seen.samples
    tiles = samples.select("tile").n_unique()
    robots = int(robot_clusters(samples).max()) + 1
    tile_spread, robot_spread = (fitted.values[name] for name in SPREADS)
    error = np.sqrt(tile_spread**2 / tiles + robot_spread**2 / robots)
    factors = np.exp(error * generator(1, "mean factor of a reference").standard_normal(draws))
    return [
        {
            name: float(values[k]) * (factors[k] if name in SCALED else 1.0)
            for name, values in fitted.draws.items()
        }
        for k in range(draws)
    ]


def _hashes(found: Dataset, sessions: Sequence[int]) -> tuple[str, ...]:
    """Return the hash of the values of each session; sessions are numbered over all results."""
    numbered = [(result, int(run)) for result in found.results for run in result.runs["run"].to_list()]
    return tuple(hash_of_run(*numbered[session]) for session in sessions)


def hash_of_run(result: Result, run: int) -> str:
    """Return the hash of the energies of one run or session (``session_hash``)."""
    table = result.rows if isinstance(result, Recording) else result.observations
    return session_hash(table.filter(pl.col("run") == run)["energy"].to_numpy())


def law_for_session(
    recording: Recording | None, run: int, others: Sequence[Recording] = (), *, draws: int = DRAWS
) -> FittedLaw:
    """Return the law of a recorded session, fitted to other sessions if there are any.

    Args:
        recording: of the session; None if ``others`` are given. run: the session. others: recordings to which the law
            is fitted; none: the recording's other sessions. draws: as in ``law_of_sessions``.
    Raises:
        InputError: there is no such session, or all samples lie on one kind of tile.
    """
    if others:
        found = dataset_of(others)
        words = f"fitted to {count(len(found.sessions), 'session')} of other recordings, whose floor is known"
        return law_of_sessions(found, found.sessions, words, draws=draws)
    assert recording is not None
    runs = recording.runs["run"].to_list()
    if run not in runs:
        raise InputError(f"there is no session {run + 1} of {len(runs)}", field="--session")
    found = dataset_of([recording])
    rest = [session for session in found.sessions if session != runs.index(run)]
    if rest:
        words = f"fitted to the other {count(len(rest), 'session')} of the recording, whose floor is known"
        return law_of_sessions(found, rest, words, draws=draws)
    words = "fitted to this session itself, on its known floor"
    return law_of_sessions(found, found.sessions, words, draws=draws)


def law_named(text: str, *, draws: int = DRAWS) -> FittedLaw:
    """Return the law of a scenario (preset or TOML), of measured energies (CSV), or of a recording (folder).

    Args:
        draws: laws of resampled references; a file of a law (``write_law``) has its own.
    Raises:
        InputError: there is no such preset or file, or it holds no law.
    """
    path = Path(text)
    if path.is_dir():
        found = dataset_of([Recording.read(path)])
        words = f"fitted to {count(len(found.sessions), 'session')} of '{path.name}', whose floor is known"
        return law_of_sessions(found, found.sessions, words, draws=draws)
    if path.suffix == ".csv":
        return _measured(path, draws)
    if text in preset_names():
        return law_of_scenario(preset(text), f"preset '{text}'")
    return known_from(Scenario.read(path), f"'{path.name}'")


def _measured(path: Path, draws: int) -> FittedLaw:
    """Return the law of measured energies, and those of resampled ones."""
    vibrating, still = (np.array(energies) for energies in read_energies(path))
    values = {"model": "energies", "vibrating_energies": vibrating.tolist(), "still_energies": still.tolist()}
    sensor = preset("paper").with_values({f"sensor.{name}": value for name, value in values.items()}).sensor
    random = generator(1, "resampled energies")
    drawn = []
    for _ in range(draws):
        again = {
            f"{kind}_energies": tuple(random.choice(each, each.size).tolist())
            for kind, each in (("vibrating", vibrating), ("still", still))
        }
        drawn.append(sensor.model_copy(update=again))
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    words = f"'{path.name}': {still.size} measured values on still places, {vibrating.size} on vibrating ones"
    own = (session_hash(np.concatenate([vibrating, still])),)
    return FittedLaw(Law(sensor, words, digest, own, tuple(drawn)), RIGHT)


def law_of_scenario(scenario: Scenario, words: str) -> FittedLaw:
    """Return the law and the camera that a scenario states, as if they were exact."""
    law = Law(scenario.sensor, f"stated by {words}", scenario.hash, place=grid_of(scenario))
    return FittedLaw(law, Camera.of(scenario))


def known_from(scenario: Scenario, words: str) -> FittedLaw:
    """Return the law and the camera of a scenario; of a file of a law (``write_law``) with its error and sessions."""
    if scenario.law.sessions is None:
        return law_of_scenario(scenario, words)
    drawn = [
        _sensor_of(scenario, dict(zip((*FIELDS, *SPREADS), row, strict=True)))
        for row in scenario.law.draws or ()
    ]
    words = f"{words}, fitted to {count(len(scenario.law.sessions), 'session')} on a known floor"
    return FittedLaw(
        Law(scenario.sensor, words, scenario.hash, scenario.law.sessions, tuple(drawn)), Camera.of(scenario)
    )


def scenario_of_law(fitted: FittedLaw, base: Scenario) -> Scenario:
    """Return a scenario with a fitted law: its sensor, the camera, and in the section law its error and sessions."""
    sensor, law = fitted.law.sensor, fitted.law
    rows = [[getattr(drawn, name) or 0.0 for name in (*FIELDS, *SPREADS)] for drawn in law.draws]
    changed = {f"sensor.{name}": getattr(sensor, name) for name in (*FIELDS, *SPREADS)}
    return base.with_values(
        {f"camera.{name}": None for name in Camera.__dataclass_fields__}
        | {"sensor.model": "gamma", "law.sessions": list(law.sessions), "law.draws": rows}
        | changed
        | fitted.camera.fields()
    )


def with_law(recording: Recording, fitted: FittedLaw) -> tuple[Recording, tuple[str, ...]]:
    """Return a recording whose scenario has a law, with its own threshold, and places corrected by the law's camera.

    Returns: the recording, and a warning if the law was fitted to one of its sessions.
    """
    threshold = recording.scenario.sensor.rms_threshold
    sensor = fitted.law.sensor.model_copy(update={"rms_threshold": threshold})
    seen = corrected(recording, fitted.camera)
    assert isinstance(seen, Recording)
    own = any(hash_of_run(recording, run) in fitted.law.sessions for run in recording.runs["run"].to_list())
    return replace(seen, scenario=seen.scenario.model_copy(update={"sensor": sensor})), (SELF_JUDGED,) * own


def law_table(law: Law) -> pl.DataFrame:
    """Return the fitted law: field, value, standard error, and limits of 95 % (of the draws), a row for each field."""
    names = (*FIELDS, *SPREADS)
    drawn = np.array([[getattr(one, name) or 0.0 for name in names] for one in law.draws])
    low, high = np.quantile(drawn, (0.025, 0.975), axis=0)
    return pl.DataFrame(
        {
            "field": [f"sensor.{name}" for name in names],
            "value": [getattr(law.sensor, name) or 0.0 for name in names],
            "error": drawn.std(axis=0, ddof=1),
            "low": low,
            "high": high,
        }
    )


def law_of_recording(recording: Recording) -> FittedLaw:
    """Return the law of all sessions of a recording, with its error.

    Raises:
        InputError: all samples lie on one kind of tile.
    """
    found = dataset_of([recording])
    words = f"fitted to {count(len(found.sessions), 'session')}, whose floor is known"
    return law_of_sessions(found, found.sessions, words, draws=KEPT)


def write_law(fitted: FittedLaw, base: Scenario, path: Path, *, replace: bool = False) -> None:
    """Write a fitted law as a scenario: as the sensor of simulations, and as ``--laws`` of inspections.

    Args:
        base: what the scenario is in all else. replace: whether a file that exists is replaced.
    """
    write_text(path, scenario_of_law(fitted, base).to_toml(), replace=replace)
