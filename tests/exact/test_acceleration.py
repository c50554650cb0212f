"""The physics of vibration against closed solutions, and its sensor against what every sensor must do."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from vibroswarm.floors.floor import Place
from vibroswarm.observation.energy_model import error_rates
from vibroswarm.observation.observe import sense_program
from vibroswarm.robot.sensing import begin_sense, cutoff_hz, energy, high_pass, sense_step
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.sensors import Samples, sensor
from vibroswarm.sensors.acceleration import (
    GRAVITY_M_S2,
    accelerations,
    response,
    sensing,
)
from vibroswarm.sensors.base import STUDY_GRID

QUIET = {
    f"sensor.acceleration.{name}": 0.0
    for name in (
        "motor_jitter",
        "motor_spread",
        "frequency_jitter",
        "gain_spread",
        "noise_m_s2",
        "lateral",
        "feet_m",
    )
}
"""Settings without chance: each sample of a tile is the same sine, but for its phase."""
SEVERAL = {"strategy.name": "dirichlet", "task.name": "majority"}
"""What robots do with more than two kinds of tile."""
MODEL = sensor("acceleration")


def scenario(**fields: object) -> Scenario:
    values = {f"sensor.acceleration.{name}": value for name, value in fields.items()}
    return Scenario().with_values({"sensor.model": "acceleration"} | values)


def quiet(**fields: object) -> Scenario:
    return scenario().with_values(
        QUIET | {f"sensor.acceleration.{name}": value for name, value in fields.items()}
    )


def samples_at(
    x_m: list[float], tiles: list[int], columns: int = 2, run: int = 0, every_s: float = 0.0, robot: int = 0
) -> Samples:
    """Samples of a robot in the middle of a row of tiles of 0.2 m."""
    rows = len(tiles) // columns
    number = np.arange(len(x_m))
    return Samples(
        Place(rows, columns, 0.2, 0.2, 0.0, 0.2 * rows), np.array(tiles, dtype=np.uint8), np.array(x_m),
        np.full(len(x_m), 0.1), every_s * number, np.full_like(number, robot), number, 1, run,
    )  # fmt: skip


def gain(frequency_hz: float, rate_hz: float, feedback: float, forward: float) -> float:
    turn = np.exp(-2j * np.pi * frequency_hz / rate_hz)
    return float(abs(forward * (1 - turn) / (1 - feedback * turn)))


@pytest.mark.parametrize("rate_hz", [350.0, 6000.0])
@pytest.mark.parametrize("share", [0.02, 0.2, 0.45])
def test_a_sine_has_the_energy_that_theory_says(rate_hz: float, share: float) -> None:
    """Three frequencies at two rates: A / sqrt(2) times the filter's gain."""
    frequency_hz, amplitude = share * rate_hz, 2.0
    program = sensing(scenario(rate_hz=rate_hz, cutoff_hz=rate_hz * 0.15, signal_ms=500.0).sensor.params)
    state, count = begin_sense(), 20_000
    for i in range(count):
        wave = amplitude * math.cos(2 * math.pi * share * i + 0.3)
        state = sense_step(state, program, 0.0, 0.0, GRAVITY_M_S2 + wave)
    feedback, forward, _ = high_pass(rate_hz * 0.15, rate_hz)
    right = amplitude / math.sqrt(2) * gain(frequency_hz, rate_hz, feedback, forward)
    assert energy(state) == pytest.approx(right, rel=1e-3)
    # Negative control: the study's filter, which has another cutoff, gives another energy.
    assert energy(state) != pytest.approx(amplitude / math.sqrt(2), rel=1e-3)


@pytest.mark.parametrize("frequency_hz", [60.0, 390.0, 500.0])
def test_a_coupled_pair_moves_as_its_closed_solution(frequency_hz: float) -> None:
    """(D + kappa) z_1 - kappa z_2 = D d_1 and (D + kappa) z_2 - kappa z_1 = 0."""
    p = quiet(coupling=0.3, damping=0.1).sensor.params
    r = frequency_hz / p.tile_hz
    own = complex(1 - r * r, 2 * p.damping * r)
    determinant = own * own + 2 * own * p.coupling
    driven, beside = abs(own * (own + p.coupling) / determinant), abs(own * p.coupling / determinant)
    assert response((1, 2), frequency_hz, p) == pytest.approx(
        np.array([[driven, beside], [beside, driven]]), rel=1e-12
    )


def test_robots_feel_the_pair() -> None:
    """Without chance a sample on either tile is the sine of the closed solution."""
    p = quiet(motor_hz=(100.0,)).sensor.params
    found = accelerations(samples_at([0.1, 0.3], [1, 0]), p)
    right = p.amplitude_m_s2 * response((1, 2), 100.0, p)[:, 0]
    t = np.arange(found.shape[2]) / p.rate_hz
    wave = np.exp(-2j * np.pi * 100.0 * t)
    amplitudes = 2 * np.abs((found[:, 2] - GRAVITY_M_S2) @ wave) / t.size
    assert amplitudes == pytest.approx(right, rel=1e-9)  # 50 periods: the window holds whole ones
    assert np.abs(found[:, :2]).max() == 0.0
    tilted = accelerations(
        samples_at([0.1, 0.3], [1, 0]), quiet(motor_hz=(100.0,), lateral=0.2).sensor.params
    )
    beside = (tilted[:, :2] @ wave) / ((tilted[:, 2] - GRAVITY_M_S2) @ wave)[:, np.newaxis]
    assert np.linalg.norm(beside, axis=1) == pytest.approx([0.2, 0.2])
    assert np.abs(beside.real).max() < 1e-9  # a quarter of a turn apart


def logs(samples: Samples, **fields: object) -> np.ndarray:
    """Logarithms of the energies of samples, without any other chance than that of fields."""
    return np.log(MODEL.sensed(samples, quiet(**fields).sensor.params)[:, 0])


def test_motors_keep_their_amplitude_for_a_time_and_are_felt_alike_by_all_robots() -> None:
    jitter = {"motor_jitter": 0.5, "motor_hold_s": 4.0}
    one, other = (logs(samples_at([0.1] * 400, [1, 0], every_s=1.0, robot=k), **jitter) for k in (0, 1))
    held = one.reshape(-1, 4)  # four samples in each time for which amplitudes are kept
    assert np.ptp(held, axis=1).max() < 0.02  # only phases differ
    assert held.mean(axis=1).std() == pytest.approx(0.5, rel=0.2)
    assert np.corrcoef(held.mean(axis=1)[1:], held.mean(axis=1)[:-1])[0, 1] == pytest.approx(0.0, abs=0.2)
    assert np.abs(one - other).max() < 0.02


def test_the_window_is_the_chains() -> None:
    ours = scenario()
    program = sense_program(ours)
    assert (program.rate_hz, program.signal_ms, program.settle_ms) == (350.0, 500.0, 500.0)
    assert (program.feedback, program.forward) == (0.2, 0.6)
    program = sense_program(
        scenario(rate_hz=1000.0)
    )  # another rate has the same cutoff, by other coefficients
    assert cutoff_hz(program.feedback, 1000.0) == pytest.approx(cutoff_hz(0.2, 350.0))
    faster = scenario(rate_hz=1000.0, cutoff_hz=40.0, signal_ms=250.0)
    program = sense_program(faster)
    assert cutoff_hz(program.feedback, 1000.0) == pytest.approx(40.0)
    assert (program.rate_hz, program.signal_ms, program.settle_ms) == (1000.0, 250.0, 750.0)


def test_the_energies_are_near_the_recordings() -> None:
    """Rates of the study's robots at theta_E 1.55, on floors at random."""
    positive, negative = error_rates(scenario().with_values({"sensor.rms_threshold": 1.55}).sensor)
    assert positive == pytest.approx(0.11, abs=0.03)
    assert negative == pytest.approx(0.22, abs=0.05)


def test_its_law_of_energies_tells_the_kinds_apart() -> None:
    p = scenario().sensor.params
    values = np.linspace(0.2, 6.0, 30)[:, None]
    still, vibrating = (MODEL.likelihood(kind, values, p) for kind in (0, 1))  # type: ignore[misc]
    assert vibrating[-1] > 20 * still[-1]
    assert still[2] > 5 * vibrating[2]


def confusion(
    motor_hz: tuple[float, ...], kinds: tuple[int, ...], threshold: float
) -> tuple[float, float, int]:
    """Shares of samples read right, at least 3 cm and less than 1 cm from tiles of other kinds, and their number."""
    base = SEVERAL | {"sensor.rms_threshold": threshold}
    one = scenario().with_values(base | {"sensor.acceleration.motor_hz": motor_hz})
    rng, count = np.random.default_rng(3), 200
    right: dict[bool, list[bool]] = {True: [], False: []}
    for run in range(20):
        tiles = rng.permutation(np.resize(kinds, 25)).reshape(5, 5).astype(np.uint8)
        x_m, y_m, number = rng.random(count), rng.random(count), np.arange(count)
        samples = Samples(
            STUDY_GRID, tiles.ravel(), x_m, y_m, 3.0 * number, np.zeros_like(number), number, 5, run
        )
        read = MODEL.classes(MODEL.sensed(samples, one.sensor.params), one.sensor.params)
        column, row = (x_m / 0.2).astype(int), 4 - (y_m / 0.2).astype(int)
        from_edge_m = np.minimum(*(np.minimum(z % 0.2, 0.2 - z % 0.2) for z in (x_m, y_m)))
        is_right = read == tiles[row, column]
        right[True] += is_right[from_edge_m >= 0.03].tolist()
        right[False] += is_right[from_edge_m < 0.01].tolist()
    return float(np.mean(right[True])), float(np.mean(right[False])), len(right[True])


def test_a_sample_measures_the_features_that_are_asked_for() -> None:
    names = ("peak_hz", "peak_height", "variance", "band_100")
    p = quiet(motor_hz=(100.0,), features=names, amplitude_m_s2=0.5).sensor.params
    samples, program = samples_at([0.1], [1, 0]), sensing(p)
    found = dict(zip(("energy", *names), MODEL.sensed(samples, p)[0], strict=True))
    z = accelerations(samples, p)[0, 2]  # as is the magnitude, without anything beside and less than gravity
    filtered = lfilter([program.forward, program.before], [1.0, -program.feedback], z - z[0])
    turns = np.exp(-2j * np.pi * 100.0 / 350.0 * np.arange(z.size))
    assert found["band_100"] == pytest.approx(2 * abs(filtered @ turns) ** 2 / z.size**2, rel=1e-9)
    assert found["variance"] == pytest.approx(filtered.var(), rel=1e-9)
    assert found["energy"] == pytest.approx(math.sqrt((filtered**2).mean()), rel=1e-3)
    own = (
        p.amplitude_m_s2
        * response((1, 2), 100.0, p)[0, 0]
        * gain(100.0, 350.0, program.feedback, program.forward)
    )
    assert found["peak_hz"] == pytest.approx(100.0, abs=0.3)
    assert found["peak_height"] == pytest.approx(own, rel=0.05)
