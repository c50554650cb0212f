"""The robots' accelerometer: tiles that motors shake, a robot on two feet, and the robot's own chain of sensing.

| name | symbol | unit | equation |
|---|---|---|---|
| tile | z_i | m/s^2 | (D + kappa L) z = D d: rigid tiles on springs, joined to their neighbours by the frame |
| stiffness | D | - | 1 - r^2 + 2 j zeta r with r = f / ``tile_hz``: one tile's own, at the motor's frequency f |
| neighbours | L | - | the grid's Laplacian: (L z)_i = sum of z_i - z_j over the tiles j beside i |
| drive | d_s | m/s^2 | what the motor of tile s would give it alone: amplitude exp(spread m_s + jitter n_s) |
| response | G_is | - | abs of the element (i, s) of D (D + kappa L)^-1 |
| robot | a_s | m/s^2 | d_s sqrt(mean of G_is^2 over the tiles i below its two feet): heave and pitch together |
| upwards | a(t) | m/s^2 | gravity + gain [sum of a_s cos(2 pi f_s t + phase_s) + noise] |
| value | - | - | features of the signal after the robot's high-pass (``robot.sensing``, ``robot.features``) |

Kind 0 has no motor; kind k has one of ``motor_hz[k - 1]``. A motor's amplitude and frequency are drawn again every
``motor_hold_s``, the same for all robots; phases are drawn for each sample. n and m are standard normal.
Two kinds are read as energy > theta_E, as the paper's robots do. More are told apart by the peak's frequency: a sample
with an energy above theta_E is of the kind whose motor, as the rate folds it, is nearest to the peak.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import lru_cache
from typing import Annotated, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from vibroswarm.core.jit import inner, kernel, signed
from vibroswarm.core.rng import ALONE, FIRST, HARDWARE, MOTOR, OF_SENSOR, VIBRATION, normal, uniform
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Place, tile_below
from vibroswarm.robot.features import (
    POINTS,
    Band,
    alias_hz,
    band_coefficient,
    band_energy,
    band_step,
    signal_variance,
    spectrum_peak,
)
from vibroswarm.robot.sensing import (
    SenseProgram,
    begin_sense,
    cutoff_hz,
    energy,
    high_pass,
    readings,
    sense_step,
)
from vibroswarm.sensors.base import (
    MOST_KINDS,
    MOST_NUMBERS,
    STUDY_GRID,
    Samples,
    SensorModel,
    Values,
    register,
    with_read_only,
)
from vibroswarm.sensors.energies import density_of, scale_of

GRAVITY_M_S2: Final = 9.81
STUDY: Final = SenseProgram()
"""The chain of the study's robots."""
LASTING: Final = 1
"""In place of a robot's number, in the address of what a motor keeps for a whole run; 0 is in that of its jitter."""
STEPS: Final = 2
"""Motors are felt from at most this many rows and columns of tiles away."""
FAINT: Final = 1e-3
"""Sinusoids of less than this share of the largest drive are left out."""
FEATURES: Final = ("energy", "peak_hz", "peak_height", "variance")
"""Features by name, beside those of bands: ``band_82.5`` is the energy of the band at 82.5 Hz."""

Hertz = Annotated[float, Field(gt=0, le=1e5)]


class Params:
    """Motors, tiles, frame, robot and accelerometer."""

    motor_hz: Annotated[tuple[Hertz, ...], Field(min_length=1, max_length=MOST_KINDS - 1, strict=False)] = (
        165.0,
    )
    """Frequency of the motor below tiles of kind 1, 2, ..., Hz; tiles of kind 0 have no motor."""
    amplitude_m_s2: Annotated[float, Field(gt=0, le=1e4)] = 6.08
    """Peak acceleration that a motor gives its tile alone (median). It depends on the motors."""
    amplitude_shares: Annotated[
        tuple[Annotated[float, Field(gt=0, le=1e3)], ...], Field(max_length=MOST_KINDS - 1, strict=False)
    ] = ()
    """That of the motor below tiles of kind 1, 2, ..., as a share of amplitude_m_s2, for motors of different
    strengths; if empty, 1 for all."""
    motor_spread: Annotated[float, Field(ge=0, le=2)] = 0.159
    """Standard deviation of the logarithm of the amplitude from motor to motor, drawn per tile and run."""
    motor_jitter: Annotated[float, Field(ge=0, le=2)] = 0.539
    """Standard deviation of the logarithm of a motor's amplitude in time."""
    motor_hold_s: Annotated[float, Field(ge=0.01, le=1e5)] = 1.0
    """Time for which a motor keeps its amplitude and frequency, s."""
    frequency_jitter: Annotated[float, Field(ge=0, le=0.2)] = 0.005
    """Standard deviation of a motor's frequency in time, as a share of it: how well its controller holds it."""
    coupling: Annotated[float, Field(ge=0, le=10)] = 0.191
    """kappa: stiffness of the frame between two tiles, as a share of a tile's own springs. It depends on the
    surface, as do the next two."""
    tile_hz: Annotated[float, Field(gt=0, le=1e5)] = 400.0
    """Frequency at which a tile would swing on its springs, alone."""
    damping: Annotated[float, Field(gt=0, le=10)] = 0.05
    """zeta: damping of a tile, as a share of the critical one."""
    lateral: Annotated[float, Field(ge=0, le=10)] = 0.1
    """Horizontal acceleration of a tile, as a share of the vertical one."""
    feet_m: Annotated[float, Field(ge=0, le=1)] = 0.0394
    """Distance between the robot's feet, which straddle edges. It depends on the robot, as do the next two."""
    gain_spread: Annotated[float, Field(ge=0, le=2)] = 0.12
    """Standard deviation of the logarithm of the gain of a robot's accelerometer, drawn per robot and run."""
    noise_m_s2: Annotated[float, Field(ge=0, le=1e4)] = 0.319
    """Standard deviation of the accelerometer's noise, in each axis."""
    rate_hz: Annotated[float, Field(gt=0, le=1e5)] = 350.0
    """Readings of the accelerometer per second. It limits which frequencies can be told apart."""
    signal_ms: Annotated[float, Field(gt=0, le=1e5)] = 500.0
    """How long it is read for a sample."""
    cutoff_hz: Annotated[float, Field(gt=0, le=1e5)] | None = None
    """Where the high-pass has -3 dB; if omitted, at 65.5 Hz, as that of the study's robots. Lower it for
    surfaces that vibrate more slowly."""
    features: Annotated[tuple[str, ...], Field(max_length=MOST_NUMBERS - 1, strict=False)] = ()
    """What a sample measures beside its energy: peak_hz, peak_height, variance, and energies of bands such as
    band_82.5 (Hz). A magnitude shows horizontal vibration at twice its frequency."""


def kinds(p: Any) -> int:
    """Return the number of kinds of tile: without a motor, and with each motor."""
    return 1 + len(p.motor_hz)


def numbers(p: Any) -> tuple[str, ...]:
    """Return the names of what a sample measures."""
    chosen = ("energy", *p.features)
    return chosen if len(p.motor_hz) == 1 or "peak_hz" in chosen else (*chosen, "peak_hz")


def sensing(p: Any) -> SenseProgram:
    """Return the program of the robot's chain, without the time that it stands before."""
    usual = SenseProgram(rate_hz=p.rate_hz, settle_ms=0.0, signal_ms=p.signal_ms)
    if p.cutoff_hz is None and p.rate_hz == STUDY.rate_hz:
        return usual  # with the coefficients that the robots have
    feedback, forward, before = high_pass(cutoff_of(p), p.rate_hz)
    return usual._replace(feedback=feedback, forward=forward, before=before)


def cutoff_of(p: Any) -> float:
    """Return the frequency at which the high-pass has -3 dB, Hz."""
    return cutoff_hz(STUDY.feedback, STUDY.rate_hz) if p.cutoff_hz is None else float(p.cutoff_hz)


class Shaking(NamedTuple):
    """Parameters of the physics, as kernels read them."""

    place: Place
    motor_hz: Values
    """(kinds - 1,): frequencies of the motors."""
    squares: Values
    """Their ``_squares``."""
    amplitude_m_s2: float
    motor_spread: float
    motor_jitter: float
    motor_hold_s: float
    frequency_jitter: float
    lateral: float
    feet_m: float
    gain_spread: float
    noise_m_s2: float


def response(tiles: tuple[int, int], frequency_hz: float, p: Any) -> Values:
    """Return G, (tiles, tiles): motion of each tile (rows) per drive of each tile's motor, at one frequency."""
    rows, columns = tiles
    row, column = np.divmod(np.arange(rows * columns), columns)
    beside = np.abs(row[:, None] - row) + np.abs(column[:, None] - column) == 1
    laplacian = np.diag(beside.sum(axis=1)) - beside.astype(np.float64)
    share = frequency_hz / p.tile_hz
    own = complex(1.0 - share * share, 2.0 * p.damping * share)
    return np.abs(own * np.linalg.inv(own * np.eye(rows * columns) + p.coupling * laplacian))


@lru_cache(maxsize=16)
def _squares(rows: int, columns: int, p: Any) -> Values:
    """Return G^2 of the motors of each kind, (kinds - 1, tiles, tiles), per ``amplitude_m_s2``."""
    shares = p.amplitude_shares or [1.0] * len(p.motor_hz)
    of_kinds = zip(p.motor_hz, shares, strict=True)
    return np.stack([(share * response((rows, columns), hz, p)) ** 2 for hz, share in of_kinds])


@kernel
def shake(shaking: Shaking, samples: Samples, sample: int, rate_hz: float, out: Values) -> None:
    """Write the accelerations that a robot reads at a sample, without gravity, (3, readings): x, y and z."""
    x_m, y_m, tiles = samples.x_m[sample], samples.y_m[sample], samples.tiles
    seed, run, robot, number = samples.seed, samples.run, samples.robot[sample], samples.sample[sample]
    place = shaking.place
    out[:] = 0.0
    direction = 2.0 * math.pi * uniform(seed, run, robot, VIBRATION, number, ALONE)
    cosine, sine = math.cos(direction), math.sin(direction)
    half_m = 0.5 * shaking.feet_m
    one = tile_below(x_m + half_m * cosine, y_m + half_m * sine, place)
    other = tile_below(x_m - half_m * cosine, y_m - half_m * sine, place)
    gain = math.exp(shaking.gain_spread * normal(seed, run, robot, HARDWARE, FIRST, OF_SENSOR))
    slot = int(samples.time_s[sample] / shaking.motor_hold_s)
    for source in range(tiles.size):
        if tiles[source] > 0:
            k = signed(tiles[source]) - 1
            square = 0.5 * (
                square_at(shaking.squares, k, one, source, place)
                + square_at(shaking.squares, k, other, source, place)
            )
            if square < FAINT * FAINT:
                continue
            drive = shaking.amplitude_m_s2 * math.exp(
                shaking.motor_jitter * normal(seed, run, 0, MOTOR, slot, 4 * source)
            )
            if shaking.motor_spread > 0.0:
                drive *= math.exp(shaking.motor_spread * normal(seed, run, LASTING, MOTOR, source, ALONE))
            amplitude = gain * drive * math.sqrt(square)
            frequency_hz = shaking.motor_hz[k] * (
                1.0 + shaking.frequency_jitter * normal(seed, run, 0, MOTOR, slot, 4 * source + 2)
            )
            phase = 2.0 * math.pi * uniform(seed, run, robot, VIBRATION, number, 8 + source)
            add_sine(out, amplitude, 2.0 * math.pi * frequency_hz / rate_hz, phase)
    for i in range(out.shape[1]):  # horizontally in the robot's direction
        across = shaking.lateral * out[0, i]
        out[0, i], out[1, i] = cosine * across, sine * across
    if shaking.noise_m_s2 > 0.0:
        # The address of a sample's noise is one number; readings follow from it by a cheaper generator.
        word = np.uint64(uniform(seed, run, robot, VIBRATION, number, 3) * 2.0**52)
        add_noise(out, gain * shaking.noise_m_s2, word)  # type: ignore[arg-type]


@inner
def square_at(squares: Values, k: int, tile: int, source: int, place: Place) -> float:
    """Return G^2 of a motor of kind ``k`` + 1 below ``source``, at a tile; 0 if it is -1 (none) or too far."""
    down = abs(source // place.columns - tile // place.columns)
    if tile < 0 or max(down, abs(source % place.columns - tile % place.columns)) > STEPS:
        return 0.0
    square: float = squares[k, tile, source]
    return square


@inner
def add_sine(out: Values, amplitude: float, step_rad: float, phase_rad: float) -> None:
    """Add a sinusoid to the third row, and the same a quarter of a turn later to the first."""
    real, imaginary = amplitude * math.cos(phase_rad), amplitude * math.sin(phase_rad)
    turn_real, turn_imaginary = math.cos(step_rad), math.sin(step_rad)
    for i in range(out.shape[1]):
        out[0, i] = out[0, i] + imaginary
        out[2, i] = out[2, i] + real
        real, imaginary = (
            turn_real * real - turn_imaginary * imaginary,
            turn_real * imaginary + turn_imaginary * real,
        )


@inner
def add_noise(out: Values, spread: float, word: int) -> None:
    """Add nearly normal noise (sums of four 16-bit parts) from a state of SplitMix64 (Steele et al., OOPSLA 2014)."""
    state, mask = np.uint64(word), np.uint64(0xFFFF)
    scale = (
        spread * math.sqrt(3.0) / 65536.0
    )  # the sum of four numbers uniform on [0, 1) has the variance 1/3
    for axis in range(3):
        for i in range(out.shape[1]):
            state += np.uint64(0x9E3779B97F4A7C15)
            mixed = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            mixed = mixed ^ (mixed >> np.uint64(31))
            total = (
                (mixed & mask)
                + ((mixed >> np.uint64(16)) & mask)
                + ((mixed >> np.uint64(32)) & mask)
                + (mixed >> np.uint64(48))
            )
            out[axis, i] += scale * (float(total) - 131070.0)


class Measuring(NamedTuple):
    """How a robot measures the features of a sample."""

    program: SenseProgram
    codes: NDArray[np.int64]
    """(numbers,): index of each feature in ``FEATURES``; -1 a band."""
    bands_hz: Values
    """(numbers,): frequencies of bands."""
    acceleration: Values
    """(3, readings), without gravity; this and the next two are overwritten by each sample."""
    signal: Values
    """(readings,): filtered."""
    spectrum: Values
    """(2, POINTS)."""


@kernel
def measure_signal(measuring: Measuring, out: Values) -> None:
    """Write the features of one sample, (numbers,), as the robot computes them from its ``acceleration``."""
    program, codes, bands_hz, acceleration, signal, spectrum = measuring
    count = acceleration.shape[1]
    state = begin_sense()
    for i in range(count):
        ax, ay, az = acceleration[0, i], acceleration[1, i], acceleration[2, i] + GRAVITY_M_S2
        state = sense_step(state, program, ax, ay, az)
        signal[i] = state.filtered
    out[0] = energy(state)
    hz, height = -1.0, 0.0
    for n in range(1, codes.size):
        code = codes[n]
        if code < 0:
            coefficient, band = band_coefficient(bands_hz[n], program.rate_hz), Band(0.0, 0.0)
            for i in range(count):
                band = band_step(band, coefficient, signal[i])
            out[n] = band_energy(band, coefficient, count)
        elif code == 3:
            out[n] = signal_variance(signal)
        else:
            if hz < 0.0:
                peak = spectrum_peak(signal, count, program.rate_hz, spectrum[0], spectrum[1])
                hz, height = peak.hz, peak.height
            out[n] = hz if code == 1 else height


@kernel
def sense_samples(shaking: Shaking, samples: Samples, measuring: Measuring, out: Values) -> None:
    """Write what all samples of a run measure, (samples, numbers); see ``shake`` and ``measure_signal``."""
    for k in range(samples.x_m.size):
        shake(shaking, samples, k, measuring.program.rate_hz, measuring.acceleration)
        measure_signal(measuring, out[k])


def shaking_of(place: Place, p: Any) -> Shaking:
    """Return the parameters of the physics on a floor."""
    squares = _squares(place.rows, place.columns, p)
    return Shaking(
        place, np.array(p.motor_hz), squares, *(float(getattr(p, name)) for name in Shaking._fields[3:])
    )


def sense(samples: Samples, p: Any) -> Values:
    """Return what samples of a run measure, (samples, numbers)."""
    names, program = numbers(p), sensing(p)
    codes = np.array([FEATURES.index(name) if name in FEATURES else -1 for name in names], dtype=np.int64)
    bands_hz = np.array([band_of(name) if name not in FEATURES else 0.0 for name in names])
    count = readings(program)
    out = np.empty((samples.x_m.size, len(names)))
    scratch = np.empty((3, count)), np.empty(count), np.empty((2, POINTS))
    sense_samples(shaking_of(samples.place, p), samples, Measuring(program, codes, bands_hz, *scratch), out)
    return out


def accelerations(samples: Samples, p: Any) -> Values:
    """Return what the accelerometer reads at samples of a run, gravity included, (samples, 3, readings)."""
    samples, shaking = with_read_only(samples), shaking_of(samples.place, p)
    out = np.empty((samples.x_m.size, 3, readings(sensing(p))))
    for k in range(samples.x_m.size):
        shake(shaking, samples, k, p.rate_hz, out[k])
    out[:, 2] += GRAVITY_M_S2
    return out


def band_of(name: str) -> float:
    """Return the frequency in the name of a band's feature, Hz."""
    match = re.fullmatch(r"band_(\d+\.?\d*)", name)
    if match is None:
        raise InputError(
            f"'{name}' is none of {', '.join(FEATURES)}, nor a band such as band_82.5",
            field="sensor.acceleration.features",
        )
    return float(match[1])


def reading(value: Values, p: Any) -> NDArray[np.int64]:
    """Return the kinds that robots read: without vibration, or with the motor nearest to the peak's frequency."""
    above = value[:, 0] > p.rms_threshold
    if len(p.motor_hz) == 1:
        return np.asarray(above.astype(np.int64))
    seen_hz = np.array([alias_hz(motor_hz, p.rate_hz) for motor_hz in p.motor_hz])  # as the rate folds them
    peak_hz = value[:, numbers(p).index("peak_hz")]
    return np.asarray(np.where(above, 1 + np.abs(peak_hz[:, None] - seen_hz).argmin(axis=1), 0))


def likelihood(kind: int, value: Values, p: Any) -> Values:
    """Return the density of energies on a kind of tile, from those at reference places."""
    return _densities(p, getattr(p, "place", STUDY_GRID))[kind](value[:, 0])


@lru_cache(maxsize=16)
def _densities(p: Any, place: Place) -> list[Callable[[Values], Values]]:
    """Return the densities of energies at reference places of a grid; cached, as each piece of a run needs it."""
    own = acceleration.reference_values(acceleration.at_place(p, place))
    energies = [values[:, 0] for values in own]
    scale = scale_of(energies)
    return [density_of(each, scale) for each in energies]


def check(p: Any) -> None:
    """Refuse frequencies beyond half of the rate, signals shorter than a period, and features that do not exist."""
    field, nyquist_hz = "sensor.acceleration", 0.5 * p.rate_hz
    bands_hz = [band_of(name) for name in p.features if name not in FEATURES]
    if max([cutoff_of(p), *bands_hz]) >= nyquist_hz:
        raise InputError(
            f"is to be below half of rate_hz, {nyquist_hz:g} Hz, as are bands", field=f"{field}.cutoff_hz"
        )
    if p.signal_ms * min(*p.motor_hz, *bands_hz, math.inf) < 1000.0 or readings(sensing(p)) < 8:
        raise InputError(
            f"{p.signal_ms:g} ms is too short for a period and 8 readings", field=f"{field}.signal_ms"
        )


acceleration = register(
    SensorModel(
        name="acceleration",
        params=Params,
        kinds=kinds,
        readings=kinds,
        sense=sense,
        reading=reading,
        likelihood=likelihood,
        numbers=numbers,
        check=check,
        accelerometer=sensing,
        for_more_kinds="give each kind from 1 on a motor, in sensor.acceleration.motor_hz",
        has_threshold=True,
        about="tiles shaken by motors, felt by an accelerometer: the physics, through the robot's own filter",
    )
)
