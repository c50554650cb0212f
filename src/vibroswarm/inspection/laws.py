"""Where the law of the sensor is known from: a scenario, measured energies, or sessions on a known floor."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from vibroswarm.calibrate.camera import RIGHT, Camera
from vibroswarm.calibrate.dataset import Dataset, dataset_of
from vibroswarm.calibrate.fit_camera import fit_camera
from vibroswarm.calibrate.fit_sensor import FIELDS, SPREADS, fit_sensor
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError
from vibroswarm.inspection.samples import Law
from vibroswarm.observation.measured_csv import read_energies
from vibroswarm.recordings.recording import Recording
from vibroswarm.scenario.presets import preset_names
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.show.numbers import count


@dataclass(frozen=True)
class FittedLaw(NotebookView):
    """A law fitted to sessions on a known floor, and the camera that saw them."""

    law: Law
    camera: Camera


def law_of_sessions(found: Dataset, sessions: Sequence[int], words: str) -> FittedLaw:
    """Fit the law of the sensor and the camera to some sessions.

    Differences between tiles and robots are part of the law: a sample counts less because of them.

    Args:
        found: recordings, with positions as the camera saw them. sessions: numbers of those that are used.
        words: what the sessions are.
    Raises:
        InputError: all samples lie on one kind of tile.
    """
    chosen = found.only(sessions)
    camera = fit_camera(chosen, draws=0).camera
    fitted = fit_sensor(chosen.corrected(camera), draws=0).values
    base = found.results[0].scenario
    values = {f"sensor.{name}": round(fitted[name], 5) for name in FIELDS}
    # Without a difference the field is None.
    spreads = {f"sensor.{name}": round(fitted[name], 5) or None for name in SPREADS}
    scenario = base.with_values({"sensor.model": "gamma"} | values | spreads)
    digest = hashlib.sha256(csv_bytes(chosen.samples)).hexdigest()[:16]
    return FittedLaw(Law(scenario.sensor, words, digest), camera)


def law_for_session(recording: Recording | None, run: int, others: Sequence[Recording] = ()) -> FittedLaw:
    """Return the law of a recorded session, fitted to other sessions if there are any.

    Args:
        recording: of the session; None if ``others`` are given. run: the session. others: recordings to which the law
            is fitted; none: the recording's other sessions.
    Raises:
        InputError: there is no such session, or all samples lie on one kind of tile.
    """
    if others:
        found = dataset_of(others)
        words = f"fitted to {count(len(found.sessions), 'session')} of other recordings, whose floor is known"
        return law_of_sessions(found, found.sessions, words)
    assert recording is not None
    runs = recording.runs["run"].to_list()
    if run not in runs:
        raise InputError(f"there is no session {run + 1} of {len(runs)}", field="--session")
    found = dataset_of([recording])
    rest = [session for session in found.sessions if session != runs.index(run)]
    if rest:
        words = f"fitted to the other {count(len(rest), 'session')} of the recording, whose floor is known"
        return law_of_sessions(found, rest, words)
    own = law_of_sessions(found, found.sessions, "fitted to this session itself, on its known floor")
    warning = "The session judges itself: the law was fitted to the same samples and floor."
    law = Law(own.law.sensor, own.law.origin, own.law.hash, warning)
    return FittedLaw(law, own.camera)


def law_named(text: str) -> FittedLaw:
    """Return the law of a scenario (preset or TOML), of measured energies (CSV), or of a recording (folder).

    Raises:
        InputError: there is no such preset or file, or it holds no law.
    """
    path = Path(text)
    if path.is_dir():
        found = dataset_of([Recording.read(path)])
        words = f"fitted to {count(len(found.sessions), 'session')} of '{path.name}', whose floor is known"
        return law_of_sessions(found, found.sessions, words)
    if path.suffix == ".csv":
        vibrating, still = read_energies(path)
        values = {"model": "energies", "vibrating_energies": vibrating, "still_energies": still}
        scenario = preset("paper").with_values({f"sensor.{name}": value for name, value in values.items()})
        digest = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
        words = (
            f"'{path.name}': {len(still)} measured values on still places, {len(vibrating)} on vibrating ones"
        )
        return FittedLaw(Law(scenario.sensor, words, digest), RIGHT)
    if text in preset_names():
        return law_of_scenario(preset(text), f"preset '{text}'")
    return law_of_scenario(Scenario.read(path), f"'{path.name}'")


def law_of_scenario(scenario: Scenario, words: str) -> FittedLaw:
    """Return the law and the camera that a scenario states."""
    return FittedLaw(Law(scenario.sensor, f"stated by {words}", scenario.hash), Camera.of(scenario))
