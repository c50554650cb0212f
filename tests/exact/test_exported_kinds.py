"""Exported robots that tell several kinds of tile apart do what simulated ones do, in double precision bit by bit."""

from __future__ import annotations

import math
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.exported_robots import (
    Swarm,
    built,
    built_for_arm,
    check_events,
    measured_at_each_tick,
    needs_arm,
    needs_gcc,
    rows,
    run_on_arm,
    run_program,
)
from helpers.plain_program import plain_program
from vibroswarm import preset, simulate
from vibroswarm.export import c_library
from vibroswarm.export.assembly import parts_of
from vibroswarm.sensors import SensorModel, forget, register
from vibroswarm.sensors.base import Samples

SEED = 4
CLASSES = preset("paper").with_values(
    {
        "sensor.model": "confusion",
        "task.name": "majority",
        "strategy.name": "dirichlet",
        "floor.source": "random:0.28,0.48,0.24",
        "run.stop": "t_end",
        "run.t_end_s": 300.0,
        "decision.min_observations": 30,
    }
)
STRATEGIES = ["averaging", "dirichlet", "dirichlet_positive", "dirichlet_soft"]
WHOLE = "dirichlet"
"""The strategy of which the whole program is run, walk and inbox included; the others walk as it does."""


@pytest.fixture(scope="module")
def measured() -> np.ndarray[Any, Any]:
    return measured_at_each_tick(CLASSES, SEED, 14_999)


@pytest.fixture(scope="module")
def swarms(measured: np.ndarray[Any, Any]) -> Any:
    made: dict[str, tuple[Any, Swarm]] = {}

    def swarm_of(name: str) -> tuple[Any, Swarm]:
        if name not in made:
            scenario = CLASSES.with_values({"strategy.name": name})
            inspection = simulate(scenario, SEED, [0])
            readings = [inspection.observations.filter(robot=i)["observation"].to_list() for i in range(5)]
            swarm = Swarm(scenario, SEED, measured, readings)
            if name == WHOLE:
                swarm.run()
            else:
                swarm.run_as(swarm_of(WHOLE)[1])
            made[name] = inspection, swarm
        return made[name]

    return swarm_of


@pytest.mark.parametrize("name", STRATEGIES)
def test_the_plain_program_does_what_the_simulation_did(name: str, swarms: Any) -> None:
    inspection, swarm = swarms(name)
    decided = set()
    for i in range(5):
        found, expected = rows(swarm.did[i], swarm), inspection.inference.filter(robot=i)
        assert found.shape[0] == expected.height > 45
        np.testing.assert_array_equal(found[:, 3], expected["decision"])
        np.testing.assert_array_equal(found[:, 5], expected["messages_received"])
        final = inspection.reports.filter(robot=i).sort("sample", "index").tail(3)["value"]
        np.testing.assert_array_equal(swarm.robots[i].arrays.counts, final)  # of what all sent
        decided.add(int(found[-1, 3]))
    assert decided == {1}
    sent = {float(kind) for i in range(5) for kind in rows(swarm.did[i], swarm)[:, 6]}
    assert sent == (
        {1.0, 2.0} if name == "averaging" else {0.0, 1.0, 2.0}
    )  # whose share of kind 0 is the rest


@needs_gcc
@pytest.mark.parametrize("name", STRATEGIES)
def test_c_in_double_precision_is_the_plain_program_bit_by_bit(
    name: str, swarms: Any, tmp_path: Path
) -> None:
    _, swarm = swarms(name)
    program = built(CLASSES.with_values({"strategy.name": name}), tmp_path, precision=3, optimise="-O0")
    for events, did in zip(swarm.short, swarm.did, strict=True):
        assert np.array(run_program(program, events)).tobytes() == np.array(did).tobytes()
    if name == WHOLE:
        for events, walked in zip(swarm.whole, swarm.walked, strict=True):
            assert np.array(run_program(program, events)).tobytes() == np.array(walked).tobytes()


@needs_arm
@pytest.mark.parametrize("name", STRATEGIES)
def test_a_cortex_m0_makes_the_same_events(name: str, swarms: Any, tmp_path: Path) -> None:
    _, swarm = swarms(name)
    program = built_for_arm(CLASSES.with_values({"strategy.name": name}), tmp_path)
    check_events(run_on_arm(program, swarm.short[0]), swarm.did[0], swarm)


CALLER = """
#include <stdio.h>
#include "vibroswarm.h"
int main(void)
{
    static vs_Robot robot;
    %s
    return 0;
}
"""
ONE_VALUE = """double value;
    while (scanf("%lf", &value) == 1)
        printf("%d\\n", (int)vs_class_of(&robot, (vs_real)value));"""
FOUR_NUMBERS = """double v[4];
    while (scanf("%lf %lf %lf %lf", &v[0], &v[1], &v[2], &v[3]) == 4)
        printf("%d\\n", (int)vs_class_of_numbers(&robot, v));"""


def classes_in_c(folder: Path, calls: str, values: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """The classes that the exported program in a folder reads of values, in double precision."""
    (folder / "caller.c").write_text(CALLER % calls)
    sources = [str(path) for path in (folder / "src").glob("*.c")]
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-DVS_PRECISION=3", "-I", str(folder / "src")]
    subprocess.run(["gcc", *flags, *sources, "caller.c", "-lm", "-o", "caller"], cwd=folder, check=True)
    text = "\n".join(map(repr, values.ravel().tolist()))
    found = subprocess.run([str(folder / "caller")], input=text, capture_output=True, text=True, check=True)
    return np.array(found.stdout.split(), dtype=int)


@needs_gcc
def test_c_reads_values_of_a_sensor_of_ones_own_as_its_file_does(tmp_path: Path) -> None:
    """Grey levels, read by NumPy's functions; also next to the borders, and far beyond what is measured."""

    def reading(value: Any, p: Any) -> Any:
        return np.searchsorted([80.3, 160.7], value**2 / 100.0, side="right")

    register(
        SensorModel(
            name="grey",
            kinds=lambda p: 3,
            readings=lambda p: 3,
            measure=lambda kind, u, p: (70.0, 110.0, 160.0)[kind] + 30.0 * (u - 0.5),
            reading=reading,
        )
    )
    try:
        c_library.export_library(CLASSES.with_values({"sensor.model": "grey"}), tmp_path)
    finally:
        forget("grey")
    assert "read_value()" in (tmp_path / "examples/inspection/inspection.ino").read_text()
    values = np.concatenate([np.linspace(0.0, 300.0, 5000), 10.0 * np.sqrt([80.3, 160.7]), [89.0, 1e9]])
    values = np.concatenate([values, np.nextafter(values, 0.0)])
    classes = classes_in_c(tmp_path, ONE_VALUE, values)
    np.testing.assert_array_equal(classes, reading(values, None))
    assert (
        classes != reading(values + 1e-9, None)
    ).any()  # control: the values next to the borders see the last bits


class Nearest:
    """Parameters of a sensor of four numbers."""

    width: float = 0.7
    dark: float = 0.2
    levels: tuple[float, ...] = (0.0, 1.0)  # no number: robots do without it


def four_numbers(samples: Samples, p: Any) -> np.ndarray[Any, Any]:
    chance = np.random.default_rng([samples.seed, samples.run])
    return chance.normal(1.0, 0.8, size=(samples.x_m.size, 4))


def nearest_class(v: Any, p: Any) -> int:
    """The class with the greatest sum of bells around its own number and the last one; 3, no reading, if it is dark."""
    most, found = -1.0, 0
    for k in range(3):
        height = math.exp(-((v[k] - 1.0) ** 2) / p.width) + 0.3 * math.sqrt(abs(v[3] - k))
        if height > most:
            most, found = height, k
    return 3 if v[0] * v[0] + v[3] * v[3] < p.dark else found


def of_four_numbers(**more: Any) -> SensorModel:
    return SensorModel(
        name="bells",
        params=Nearest,
        kinds=lambda p: 3,
        readings=lambda p: 4,
        numbers=lambda p: ("a", "b", "c", "d"),
        sense=four_numbers,
        **more,
    )


@needs_gcc
def test_c_reads_several_numbers_as_the_file_of_the_sensor_does(tmp_path: Path) -> None:
    register(of_four_numbers(class_of=nearest_class))
    scenario = CLASSES.with_values({"sensor.model": "bells", "run.t_end_s": 60.0})
    try:
        c_library.export_library(scenario, tmp_path)
        read = simulate(scenario, SEED, [0]).observations
        program = plain_program(parts_of(scenario))
        p = scenario.sensor.params
    finally:
        forget("bells")
    assert "read_numbers(vs_real numbers[4])" in (tmp_path / "examples/inspection/inspection.ino").read_text()
    values = np.random.default_rng(3).normal(1.0, 1.0, size=(20_000, 4))
    expected = [nearest_class(row, p) for row in values.tolist()]
    assert np.bincount(expected).min() > 200
    np.testing.assert_array_equal(classes_in_c(tmp_path, FOUR_NUMBERS, values), expected)
    robot = program.Robot()
    assert [program.class_of_numbers(robot, row) for row in values[:500].tolist()] == expected[:500]
    # The simulation reads them so, too. Its tables hold floats, so that a few next to a border are left out.
    measured = read.select("energy", "b", "c", "d").to_numpy().astype(float)
    tables = np.array([nearest_class(row, p) for row in measured.tolist()])
    assert (tables == read["observation"].to_numpy()).mean() > 0.999
    # A control: other parameters read other classes.
    other = p.model_copy(update={"width": 0.69})
    assert [nearest_class(row, other) for row in values.tolist()] != expected
