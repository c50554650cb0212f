"""Spectra of recorded acceleration: by robot, tile, place and time, with the lines in them and what may be behind each.

| name | symbol | unit | equation |
|---|---|---|---|
| sample | - | - | the last N readings of a stop, N = rate x time: those of which a robot makes an energy |
| power | P(f) | m^2/s^4 | mean over samples of the Hann-windowed periodogram: A^2 / 2 at a sine of amplitude A |
| line | f | Hz | a peak of P that stands ``STANDS_OUT`` times above the median of its spectrum; its top by a parabola |
| interval | - | Hz | of the line's frequency: 95 % of resamples of samples, but at least +- resolution / 10 |
| resolution | - | Hz | 2 / time, as two lines nearer than that are one |

A robot stands between pauses of the recording. One without pauses needs a column ``sample`` that numbers its stops, or
is cut into pieces of equal length.

Spectra are of the magnitude if gravity is in the readings. Without it, a magnitude is that of the vibration alone, and
doubles every frequency; then they are of the axis that is shaken most. A sensor that is polled faster than it measures
repeats its readings: only the first of each run counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, NamedTuple

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Bools, Floats, Ints
from vibroswarm.core.numbers import count, number
from vibroswarm.core.read_tables import ACCELERATIONS
from vibroswarm.errors import InputError
from vibroswarm.lab.acceleration import (
    GRAVITY,
    RATE_TOLERANCE,
    WIDEST_GAP,
    Acceleration,
    Gravity,
    gravity_in,
    read_acceleration,
    strongest_axis,
)
from vibroswarm.recordings.threshold import resample
from vibroswarm.robot.features import alias_hz

Group = Literal["robot", "tile", "time"]
LONGEST_STOP: Final = 20
"""Longer stretches, in samples, are not stops."""
SLOWEST_HZ: Final = 10.0
FASTEST_HZ: Final = 1e5
REPEATED: Final = 1.05
"""If readings are repeated more often, the sensor is polled faster than it measures."""
PILED: Final = 5
"""So many readings of an axis' largest value, and as many times those of the next, are at the end of its range."""
STANDS_OUT: Final = 12.0
"""How far a line stands above the median of its spectrum."""
MOST_LINES: Final = 8
"""Lines of one spectrum; the highest are kept."""
FEWEST: Final = 5
"""Fewest samples of a group."""
DRAWS: Final = 200
_SEED: Final = 41


class Line(NamedTuple):
    """A line of a spectrum; frequencies in Hz."""

    hz: float
    low: float
    high: float
    amplitude: float
    """Amplitude of its sine (root mean square over samples), in ``Spectra.unit``."""
    words: str
    """What else it may be: twice a horizontal frequency; empty: nothing known."""
    folds_from: tuple[float, ...]
    """The lowest frequencies above half of the rate that readings show here, Hz."""


@dataclass(frozen=True)
class Spectrum:
    """The mean spectrum of some samples."""

    group: str
    name: str
    samples: int
    power: Floats
    """(frequencies,): P(f)."""
    lines: tuple[Line, ...]


@dataclass(frozen=True)
class Spectra:
    """Spectra of a recording."""

    hz: Floats
    rate_hz: float
    signal_s: float
    axis: str
    samples: int
    stops: int
    """Number of stops found; those shorter than a sample are not used."""
    spectra: tuple[Spectrum, ...]
    unit: str = "m/s²"
    """Of amplitudes: empty if gravity is in the readings, but in none of the known units."""
    warnings: tuple[str, ...] = ()

    @property
    def whole(self) -> Spectrum:
        """The spectrum of all samples."""
        return self.spectra[0]


def spectra_frame(found: Spectra) -> pl.DataFrame:
    """Return all spectra as a table: group, where, hz, amplitude."""
    return pl.concat(
        pl.DataFrame({"hz": found.hz, "amplitude": np.sqrt(2.0 * np.maximum(one.power, 1e-24))}).select(
            pl.lit(one.group).alias("group"), pl.lit(one.name).alias("where"), "hz", "amplitude"
        )
        for one in found.spectra
    )


def spectra_of(
    path: Path,
    *,
    rate_hz: float | None = None,
    signal_ms: float = 500.0,
    stop_s: float | None = None,
    unit: str = "m/s2",
    axis: Literal["magnitude", "x", "y", "z"] | None = None,
    by: Sequence[Group] = ("robot",),
    size_m: tuple[float, float] = (1.0, 1.0),
    tiles: tuple[int, int] = (5, 5),
) -> Spectra:
    """Return the spectra of a file of acceleration.

    Args:
        path: table with the columns of ``acceleration.COLUMNS``, of which one axis is enough, and if known x_m, y_m
            (place) and sample.
        rate_hz: readings per second; None: as the times say. signal_ms: the part of each stop that is used, its end.
        stop_s: length of the pieces into which a recording without pauses is cut; None: it is not.
        unit: of the acceleration, one of ``acceleration.GRAVITY``, unless the names of the columns say it.
        axis: None: the magnitude, or the axis that is shaken most if gravity is not in the readings.
        by: groups of samples that get spectra of their own, beside all. size_m, tiles: width and height of the surface,
            and rows and columns of its tiles.
    """
    read = read_acceleration(path, rate_hz)
    unit = "m/s2" if read.in_m_s2 else unit
    samples, stops, repeats, rate_hz = _sampled(read.rows, path, rate_hz, signal_ms, stop_s)
    values = np.array([sample.select(ACCELERATIONS).to_numpy() for sample in samples])
    gravity = gravity_in(list(values), unit)
    known_unit = gravity.unit == unit
    readings = values * (GRAVITY["m/s2"] / GRAVITY[unit] if known_unit else 1.0)  # (samples, readings, 3)
    of_axis: str = axis or (
        "magnitude" if gravity.is_there else ACCELERATIONS[strongest_axis(list(values))][1:]
    )
    hz, powers = periodograms(_signals(readings, of_axis), rate_hz)
    across_hz = _lines_across(readings, rate_hz) if of_axis == "magnitude" else ()
    groups = [
        ("all", "", np.arange(len(samples))),
        *((group, *named) for group in by for named in _groups(samples, group, size_m, tiles, path)),
    ]
    found = tuple(
        Spectrum(
            group, name, rows.size, powers[rows].mean(axis=0), _lines(hz, powers[rows], rate_hz, across_hz)
        )
        for group, name, rows in groups
        if rows.size >= FEWEST
    )
    warnings = tuple(_warnings(read, stops, gravity, unit, of_axis, repeats, rate_hz))
    return Spectra(
        hz,
        rate_hz,
        signal_ms / 1000.0,
        of_axis,
        len(samples),
        len(stops),
        found,
        "m/s²" if known_unit else "",
        warnings,
    )


def _sampled(
    rows: pl.DataFrame, path: Path, stated_hz: float | None, signal_ms: float, stop_s: float | None
) -> tuple[list[pl.DataFrame], list[pl.DataFrame], float, float]:
    """Return samples, stops, how often each reading was repeated (it is there once now), and the sensor's rate, Hz."""
    robots = rows.partition_by("robot", maintain_order=True)
    stops = [stop for robot in robots for stop in _stops_of(robot, stop_s)]
    rate_hz, repeats = _rate(stops, stated_hz, path), _repeats(stops)
    if repeats > 1.0:
        stops = [stop.filter(_is_new(stop)) for stop in stops]
        rate_hz = _rate(stops, None, path)
    length = round(rate_hz * signal_ms / 1000.0)
    longest = max(stops, key=lambda stop: stop.height)
    if longest.height > LONGEST_STOP * length:
        raise InputError(
            f"robot {longest['robot'][0]:g} has {longest.height} readings without a pause, more than {LONGEST_STOP} "
            "samples; add a column 'sample', which numbers its stops, or cut it (--stop-s)",
            field=f"{path}, row {longest['line'][0]}",
        )
    samples = [stop[-length:] for stop in stops if stop.height >= length]
    if len(samples) < FEWEST or length < 16:
        raise InputError(
            f"{len(samples)} of {len(stops)} stops have the {length} readings of a sample ({signal_ms:g} ms at "
            f"{rate_hz:.4g} Hz); at least {FEWEST} are needed, of at least 16 readings",
            field=str(path),
        )
    return samples, stops, repeats, rate_hz


def _stops_of(rows: pl.DataFrame, stop_s: float | None) -> list[pl.DataFrame]:
    """Return the readings of each stop of one robot."""
    if "sample" in rows.columns:
        return rows.partition_by("sample", maintain_order=True)
    steps = rows["time_s"].diff()
    is_pause = (steps > WIDEST_GAP * (steps.median() or 0.0)).fill_null(False)  # type: ignore[operator]  # to polars a median may be of dates
    rows = rows.with_columns(stretch=is_pause.cum_sum())
    since_s = pl.col("time_s") - pl.col("time_s").first().over("stretch")
    rows = rows.with_columns(piece=(since_s / (stop_s or np.inf) + 1e-9).floor())
    return rows.partition_by("stretch", "piece", maintain_order=True, include_key=False)


def _is_new(stop: pl.DataFrame) -> Bools:
    """Return which readings differ from the one before."""
    values = stop.select(ACCELERATIONS).to_numpy()
    return np.append(True, (np.diff(values, axis=0) != 0.0).any(axis=1))


def _repeats(stops: Sequence[pl.DataFrame]) -> float:
    """Return how often each reading is repeated; 1 if equal readings are chance: then runs have all lengths."""
    runs = np.concatenate([np.diff(np.flatnonzero(_is_new(stop))) for stop in stops])
    if runs.size == 0 or runs.mean() < REPEATED or np.mean(np.abs(runs - runs.mean()) < 1.0) < 0.95:
        return 1.0
    return float(runs.mean())


def _warnings(
    read: Acceleration,
    stops: Sequence[pl.DataFrame],
    gravity: Gravity,
    unit: str,
    axis: str,
    repeats: float,
    rate_hz: float,
) -> Iterator[str]:
    mean = number(gravity.steady, digits=4)
    if not gravity.is_there:
        yield (
            f"the mean acceleration is {mean}: gravity is not in the readings, and a magnitude without it doubles "
            f"every frequency; spectra are of {f'axis {axis}' if axis != 'magnitude' else 'the magnitude'}"
        )
    elif gravity.unit is None:
        yield (
            f"the mean acceleration is {mean}, which is gravity in none of {', '.join(GRAVITY)}: amplitudes are in the "
            "file's own unit"
        )
    elif gravity.unit != unit:
        yield (
            f"the mean acceleration is {mean}, which is gravity in {gravity.unit}, and not in {unit}: add --unit "
            f"{gravity.unit}; amplitudes are in the file's own unit"
        )

    if read.missing:
        yield f"{count(read.missing, 'reading')} missing: left out, or bridged by straight lines if few in a row"
    if repeats > 1.0:
        yield (
            f"each reading is there {number(repeats, 1)} times: the sensor is polled at "
            f"{number(repeats * rate_hz, 0)} Hz and measures at {number(rate_hz, 1)} Hz, the rate of the spectra"
        )
    values = pl.concat(stops).select(read.axes).to_numpy()
    if ends := sum(_at_the_end(sign * one) for one in values.T for sign in (1.0, -1.0)):
        yield f"{count(ends, 'reading')} at the end of the sensor's range: amplitudes are larger than they seem"


def _at_the_end(values: Floats) -> int:
    """Return how many readings have the largest value, if they are more than chance."""
    levels, counts = np.unique(values, return_counts=True)
    piled = levels.size > 1 and counts[-1] >= PILED * max(1, int(counts[-2]))
    return int(counts[-1]) if piled else 0


def periodograms(signals: Floats, rate_hz: float) -> tuple[Floats, Floats]:
    """Return frequencies, (frequencies,), and the power of each signal, (samples, readings), at them."""
    from scipy.signal import periodogram

    hz, power = periodogram(signals, rate_hz, window="hann", detrend="constant", scaling="spectrum", axis=-1)
    return np.asarray(hz), np.asarray(power)


def _rate(stops: Sequence[pl.DataFrame], stated_hz: float | None, path: Path) -> float:
    """Return the rate of the readings in stops; refuse another one than is stated."""
    periods = [np.diff(stop["time_s"].to_numpy()) for stop in stops if stop.height > 1]
    if not periods:
        raise InputError("no two readings of a robot that stands follow each other", field=str(path))
    seconds = sum(float(one.sum()) for one in periods)
    found_hz = sum(one.size for one in periods) / seconds if seconds > 0.0 else np.inf
    if not SLOWEST_HZ <= found_hz <= FASTEST_HZ:
        raise InputError(
            f"readings come at {found_hz:.4g} Hz; is time_s in seconds? Rates are from {SLOWEST_HZ:g} to "
            f"{FASTEST_HZ:g} Hz",
            field=f"{path}, column time_s",
        )
    if stated_hz is not None and abs(found_hz / stated_hz - 1.0) > RATE_TOLERANCE:
        raise InputError(
            f"readings come at {found_hz:.4g} Hz, and {stated_hz:g} Hz is stated", field="--rate"
        )
    return stated_hz if stated_hz is not None else found_hz


def _signals(readings: Floats, axis: str) -> Floats:
    """Return the signals of an axis, or the magnitudes, (samples, readings)."""
    if axis == "magnitude":
        return np.asarray(np.sqrt((readings**2).sum(axis=2)))
    return readings[:, :, "xyz".index(axis)]


def _groups(
    samples: Sequence[pl.DataFrame],
    group: Group,
    size_m: tuple[float, float],
    tiles: tuple[int, int],
    path: Path,
) -> list[tuple[str, Ints]]:
    """Return the name and the samples of each group, in order."""
    if group == "robot":
        keys, form = np.array([[sample["robot"][0]] for sample in samples]), "robot {:.0f}"
    elif group == "time":
        times = np.array([sample["time_s"][-1] for sample in samples])
        edges = np.linspace(times.min(), times.max(), 7)
        part = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, 5)
        keys, form = np.column_stack((edges[part], edges[part + 1])), "{:.0f} to {:.0f} s"
    else:
        if not {"x_m", "y_m"} <= set(samples[0].columns):
            raise InputError(f"has no columns x_m and y_m, which --by {group} needs", field=str(path))
        x_m, y_m = (np.array([sample[name].mean() for sample in samples]) for name in ("x_m", "y_m"))
        rows, columns = tiles
        column = np.clip((x_m / size_m[0] * columns).astype(np.int64), 0, columns - 1)
        row = rows - 1 - np.clip((y_m / size_m[1] * rows).astype(np.int64), 0, rows - 1)
        keys, form = np.column_stack((row + 1, column + 1)), "tile {}, {}"
    found, of_sample = np.unique(keys, axis=0, return_inverse=True)
    return [
        (form.format(*key), np.flatnonzero(of_sample.ravel() == k)) for k, key in enumerate(found.tolist())
    ]


def _peaks(hz: Floats, power: Floats) -> Ints:
    """Return the bins of the lines of a spectrum, the highest first."""
    from scipy.signal import find_peaks

    least = STANDS_OUT * float(np.median(power[1:]))
    padded = np.append(power, 0.0)  # so that the last bin may be a peak
    found, _ = find_peaks(padded, height=least, distance=3)
    inside = found[(found > 0) & (found < hz.size)]
    return np.asarray(inside[np.argsort(-power[inside])][:MOST_LINES])


def _top(hz: Floats, power: Floats, k: int) -> float:
    """Return the frequency of the top of the highest of the bins ``k`` - 1 to ``k`` + 1, by a parabola."""
    near = np.clip(np.arange(k - 1, k + 2), 1, hz.size - 1)
    best = int(near[np.argmax(power[near])])
    if best in (1, hz.size - 1):
        return float(hz[best])
    low, middle, high = np.log(np.maximum(power[best - 1 : best + 2], 1e-300))
    bend = low - 2.0 * middle + high
    shift = 0.5 * (low - high) / bend if bend < 0.0 else 0.0
    return float(hz[best] + np.clip(shift, -0.5, 0.5) * (hz[1] - hz[0]))


def _lines(hz: Floats, powers: Floats, rate_hz: float, across_hz: Sequence[float]) -> tuple[Line, ...]:
    """Return the lines of the mean of some powers (samples, frequencies), with intervals from resampled samples."""
    mean = powers.mean(axis=0)
    again = [powers[resample(_SEED, draw, 0, len(powers))].mean(axis=0) for draw in range(DRAWS)]
    bin_hz = float(hz[1] - hz[0])
    lines = []
    for k in _peaks(hz, mean).tolist():
        at_hz = _top(hz, mean, k)
        low, high = np.quantile([_top(hz, power, k) for power in again], [0.025, 0.975])
        # Hann's line spreads 1.5 bins' power.
        amplitude = float(np.sqrt(2.0 * mean[max(k - 1, 0) : k + 2].sum() / 1.5))
        doubled = [one for one in across_hz if abs(alias_hz(2.0 * one, rate_hz) - at_hz) < 2.0 * bin_hz]
        words = "; ".join(
            f"twice the horizontal {number(one, 1)} Hz, as a magnitude shows it" for one in doubled
        )
        low, high = min(float(low), at_hz - 0.2 * bin_hz), max(float(high), at_hz + 0.2 * bin_hz)
        lines.append(Line(at_hz, low, high, amplitude, words, (rate_hz - at_hz, rate_hz + at_hz)))
    return tuple(lines)


def _lines_across(readings: Floats, rate_hz: float) -> tuple[float, ...]:
    """Return the frequencies of the lines of the two horizontal axes together."""
    (hz, along), (_, across) = (periodograms(_signals(readings, axis), rate_hz) for axis in ("x", "y"))
    total = along.mean(axis=0) + across.mean(axis=0)
    return tuple(_top(hz, total, int(k)) for k in _peaks(hz, total))
