"""Where the law of the sensor is known from: a scenario, measured energies, or sessions on a known floor.

A law that was fitted is not exact. Its error is a number of laws fitted to resampled references, each with what samples
measure that this reference has not seen (``Law.draws``):

| reference | resampled | not seen |
|---|---|---|
| measured energies | the energies of each kind, with replacement | those that were left out |
| sessions | robots in sessions, and the mean factor of the tiles and robots (``fit_sensor``) | the law itself |
| bits of sessions | the shares of ones (Beta, by Jeffreys' prior) | the law itself |

The tiles and robots of a reference are a sample of all: with spreads s_t and s_r, the mean of their log factors has a
standard deviation of sqrt(s_t^2 / tiles + s_r^2 / robots), which multiplies all values of the law alike.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.calibrate.camera import RIGHT, Camera, corrected, corrected_sessions, fit_camera
from vibroswarm.calibrate.dataset import Dataset, dataset_of
from vibroswarm.calibrate.few_groups import limits_of
from vibroswarm.calibrate.fit_sensor import FIELDS, SPREADS, fit_sensor
from vibroswarm.core.atomic_io import write_file
from vibroswarm.errors import InputError, in_file
from vibroswarm.inspection.samples import FEWEST, Doubt, Draw, Floats, Law, session_hash
from vibroswarm.observation.decision_boundary import grid_of
from vibroswarm.recordings.recording import Recording
from vibroswarm.recordings.threshold import robot_clusters
from vibroswarm.result import Result
from vibroswarm.scenario.fields import Sensor
from vibroswarm.scenario.presets import preset_names
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.sensors.energies import Scale, read_energies, scale_of, smoothed
from vibroswarm.statistics.intervals import generator

DRAWS: Final = 20
"""Laws fitted to resampled references, for an inspection."""
KEPT: Final = 40
"""The same in a file of a law."""
MEASURED: Final = 64
"""The same of measured energies."""
LARGEST: Final = 2_000_000
"""With more energies in all draws there are fewer draws: so many energies have hardly an error."""
SMOOTH: Final = 4000
"""Energies of a kind that drawn surfaces have, unless more were measured."""
OFTEN: Final = 0.05
"""Share of the measured energies of a kind from which on equal ones are no chance."""
FITTED: Final = (*FIELDS, *SPREADS)
"""Fields of the sensor that are fitted to sessions, in the order of ``law.draws``."""


def law_of_sessions(found: Dataset, sessions: Sequence[int], words: str, *, draws: int = DRAWS) -> Law:
    """Fit the law of the sensor and the camera to some sessions."""
    chosen = found.only(sessions)
    # A camera saw the places, or may have seen them, unless a recording has no tracks.
    is_seen = not any(isinstance(one, Recording) and one.tracks.is_empty() for one in found.results)
    camera = fit_camera(chosen) if is_seen else RIGHT
    fitted = fit_sensor(corrected_sessions(chosen, camera), draws=draws)
    base = found.results[0].scenario
    draws_of = ({name: float(values[k]) for name, values in fitted.draws.items()} for k in range(draws))
    sensor, *drawn = (_sensor_of(base, fitted.rounded(values)) for values in (fitted.values, *draws_of))
    # Sessions are numbered over all results.
    numbered = [(result, int(run)) for result in found.results for run in result.runs["run"].to_list()]
    hashes = tuple(hash_of_run(*numbered[session]) for session in sessions)
    return Law(sensor, words, hashes, _with_law(sensor, drawn), camera=camera)


def _with_law(sensor: Sensor, judges: Sequence[Sensor]) -> tuple[Draw, ...]:
    """Return the laws of resampled sessions with the law itself, but for the differences that they found."""
    return tuple(
        Draw(judge, sensor.model_copy(update={name: getattr(judge, name) for name in SPREADS}))
        for judge in judges
    )


def _sensor_of(base: Scenario, values: dict[str, float]) -> Any:
    fields = {
        f"sensor.{name}": (value or None) if name in SPREADS else value for name, value in values.items()
    }
    return base.with_values({"sensor.model": "gamma"} | fields).sensor


def hash_of_run(result: Result, run: int, column: str = "energy") -> str:
    """Return the hash of the energies, or bits, of one run or session (``session_hash``)."""
    from_log = isinstance(result, Recording) and column == "energy"
    table = result.rows if isinstance(result, Recording) and from_log else result.observations
    return session_hash(table.filter(pl.col("run") == run)[column].to_numpy())


def law_for_session(recording: Recording, run: int, *, draws: int = DRAWS, bits: bool = False) -> Law:
    """Return the law of a recorded session, fitted to the recording's other sessions if there are any."""
    runs = recording.runs["run"].to_list()
    if run not in runs:
        raise InputError(f"there is no session {run} of {len(runs)}", field="--run")
    rest = [other for other in runs if other != run]
    words = "fitted to the other sessions of the recording" if rest else "fitted to this session itself"
    if bits:
        return law_of_bits(recording, rest or runs, words, draws=draws)
    numbers = [runs.index(other) for other in rest or runs]
    return law_of_sessions(dataset_of([recording]), numbers, words, draws=draws)


def law_of_bits(recording: Recording, runs: Sequence[int], words: str, *, draws: int = DRAWS) -> Law:
    """Return the law of the readings of some sessions: the shares of ones on still and on vibrating tiles."""
    ones, number = np.zeros(2), np.zeros(2)
    for run in runs:
        own = recording.observations.filter(pl.col("run") == run, pl.col("tile") >= 0)
        kind = recording.floor(run).tiles.ravel()[own["tile"].to_numpy()]
        ones += np.bincount(kind, own["observation"].to_numpy(), 2)
        number += np.bincount(kind, minlength=2)
    if not number.all():
        raise InputError("all samples lie on one kind of tile; give a law of bits", field="--laws")
    drawn = generator(1, "shares of ones").beta(ones + 0.5, number - ones + 0.5, (draws, 2))
    sensor, *judges = map(sensor_of_bits, [(ones + 0.5) / (number + 1.0), *drawn])
    hashes = tuple(hash_of_run(recording, run, "observation") for run in runs)
    of_law = tuple(Draw(judge, sensor) for judge in judges)
    return Law(sensor, f"shares of ones, {words}", hashes, of_law, bits=True)


def sensor_of_bits(ones: NDArray[Any]) -> Sensor:
    """Return the sensor that reads 1 on still and on vibrating tiles with these shares."""
    rates = [[1.0 - share, share] for share in ones.tolist()]
    return Scenario().with_values({"sensor.model": "confusion", "sensor.confusion.rates": rates}).sensor


def law_named(text: str, *, draws: int = DRAWS, spreads: tuple[float, float] = (0.0, 0.0)) -> Law:
    """Return the law of a scenario (preset or TOML), of measured energies (CSV), or of a recording (folder)."""
    path = Path(text)
    if path.is_dir():
        return law_of_recordings([Recording.read(path)], draws)
    if path.suffix.lower() == ".csv":
        vibrating, still = (np.array(each) for each in read_energies(path))
        return law_of_measured(vibrating, still, f"'{path.name}'", spreads)
    if text in preset_names():
        return law_of_scenario(preset(text), f"preset '{text}'")
    with in_file(path):  # laws of draws may be wrong too
        return known_from(Scenario.read(path), f"'{path.name}'")


def law_of_measured(
    vibrating: Floats, still: Floats, words: str, spreads: tuple[float, float] = (0.0, 0.0)
) -> Law:
    """Return the law of energies that were measured where it vibrates and where it is still."""
    if min(vibrating.size, still.size) < FEWEST:
        raise InputError(
            f"{vibrating.size} vibrating and {still.size} still values; {FEWEST} of each are needed",
            field=words,
        )
    values = {
        "sensor.model": "energies",
        "sensor.vibrating_energies": vibrating.tolist(),
        "sensor.still_energies": still.tolist(),
        **{f"sensor.{name}": value or None for name, value in zip(SPREADS, spreads, strict=True)},
    }
    sensor = preset("paper").with_values(values).sensor
    scale, often = scale_of((still, vibrating)), np.union1d(_often(still), _often(vibrating))
    draws = tuple(
        Draw(one.judge, _smoothed(one.truth, scale, often)) for one in _resampled(sensor, vibrating, still)
    )
    origin = (
        f"{words}: {still.size} still and {vibrating.size} vibrating values; places of 20 cm differ by "
        f"{spreads[0]:.0%}, robots by {spreads[1]:.0%}"
    )
    return Law(sensor, origin, (session_hash(np.concatenate([vibrating, still])),), draws)


def _resampled(sensor: Sensor, vibrating: Floats, still: Floats) -> Iterator[Draw]:
    """Yield laws of resampled energies, each with the energies that were left out."""
    random = generator(1, "resampled energies")
    for _ in range(max(1, min(MEASURED, LARGEST // (vibrating.size + still.size)))):
        seen: dict[str, Any] = {}
        left_out: dict[str, Any] = {}
        for kind, each in (("vibrating_energies", vibrating), ("still_energies", still)):
            chosen = random.integers(each.size, size=each.size)
            seen[kind] = tuple(each[chosen].tolist())
            left_out[kind] = tuple(np.delete(each, chosen).tolist())
        yield Draw(sensor.model_copy(update=seen), sensor.model_copy(update=left_out))


def _often(energies: Floats) -> Floats:
    """Return the energies of a kind that were measured often, such as zeros or low counts."""
    different, number = np.unique(energies, return_counts=True)
    return np.asarray(different[number > OFTEN * energies.size])


def _smoothed(truth: Sensor, scale: Scale, often: Floats) -> Sensor:
    """Return a law of energies between and beyond those measured; by these alone too many surfaces were called."""
    update: dict[str, Any] = {}
    for field in ("vibrating_energies", "still_energies"):
        energies = np.array(getattr(truth, field))
        each, equal = max(1, SMOOTH // energies.size), np.isin(energies, often)
        about, as_measured = smoothed(energies[~equal], scale, each), np.repeat(energies[equal], each)
        update[field] = (*about.tolist(), *as_measured.tolist())
    return truth.model_copy(update=update)


def law_of_scenario(scenario: Scenario, words: str) -> Law:
    """Return the law and the camera that a scenario states, as if they were exact."""
    camera = Camera.of(scenario)
    return Law(
        scenario.sensor, f"stated by {words} ({scenario.hash})", place=grid_of(scenario), camera=camera
    )


def known_from(scenario: Scenario, words: str) -> Law:
    """Return the law and the camera of a scenario; of a file of a law (``write_law``) with its error and sessions."""
    if scenario.law.sessions is None:
        return law_of_scenario(scenario, words)
    drawn = [_sensor_of(scenario, dict(zip(FITTED, row, strict=True))) for row in scenario.law.draws or ()]
    words = f"{words}, fitted to {len(scenario.law.sessions)} sessions on a known floor"
    draws, camera = _with_law(scenario.sensor, drawn), Camera.of(scenario)
    return Law(scenario.sensor, f"{words} ({scenario.hash})", scenario.law.sessions, draws, camera=camera)


def with_law(recording: Recording, law: Law) -> tuple[Recording, tuple[str, ...]]:
    """Return a recording with a law and its own threshold, places corrected by the law's camera, and warnings."""
    threshold = recording.scenario.sensor.rms_threshold
    sensor = law.sensor.model_copy(update={"rms_threshold": threshold})
    seen = corrected(recording, law.camera)
    assert isinstance(seen, Recording)
    own = any(hash_of_run(recording, run) in law.sessions for run in recording.runs["run"].to_list())
    return replace(seen, scenario=seen.scenario.model_copy(update={"sensor": sensor})), (
        Doubt.OWN_LAW.value,
    ) * own


def law_table(law: Law) -> pl.DataFrame:
    """Return the fitted law, a row a field: value, standard error, and 95 % limits of the draws."""
    drawn = np.array(_rows_of(law))
    low, high = limits_of(drawn)
    return pl.DataFrame(
        {
            "field": [f"sensor.{name}" for name in FITTED],
            "value": [getattr(law.sensor, name) or 0.0 for name in FITTED],
            "error": drawn.std(axis=0, ddof=1),
            "low": low,
            "high": high,
        }
    )


def _rows_of(law: Law) -> list[list[float]]:
    return [[getattr(one.judge, name) or 0.0 for name in FITTED] for one in law.draws]


def law_of_recordings(recordings: Sequence[Recording], draws: int = KEPT) -> Law:
    """Return the law of all sessions of recordings."""
    found = dataset_of(recordings)
    if draws and robot_clusters(found.samples).max() == 0:
        raise InputError("has one robot in one session; give at least two", field="the recording")
    words = f"fitted to {len(found.sessions)} sessions on a known floor"
    return law_of_sessions(found, found.sessions, words, draws=draws)


def write_law(law: Law, base: Scenario, path: Path, *, replace: bool = False) -> None:
    """Write a fitted law as a scenario: as the sensor of simulations, and as ``--laws`` of inspections."""
    scenario = base.with_values(
        {f"camera.{name}": None for name in Camera.__dataclass_fields__}
        | {"sensor.model": "gamma", "law.sessions": list(law.sessions), "law.draws": _rows_of(law)}
        | {f"sensor.{name}": getattr(law.sensor, name) for name in FITTED}
        | law.camera.fields()
    )
    write_file(path, scenario.to_toml(), replace=replace)
