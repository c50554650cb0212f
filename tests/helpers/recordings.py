"""Small recordings of our own: made by our simulator, written in the formats of the lab."""

from __future__ import annotations

from pathlib import Path

import pytest

from vibroswarm.floors.floor import Floor
from vibroswarm.recordings.export import write_rugbot, write_webots
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import simulate

TILES = ("01010", "10010", "10101", "01101", "10010")


@pytest.fixture(scope="session")
def told() -> Scenario:
    """Five robots for 400 s with positive feedback; they decide."""
    return preset("paper-empirical").with_values(
        {
            "floor.tiles": TILES,
            "floor.source": "ours",
            "strategy.name": "positive",
            "sensor.rms_threshold": 1.55,
            "decision.min_observations": 40,
            "decision.gate": "own",
            "run.t_end_s": 400.0,
        }
    )


@pytest.fixture(scope="session")
def made(told: Scenario) -> Result:
    return simulate(told, 7, 2, segments=True)


@pytest.fixture(scope="session")
def logs(made: Result, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("logs")
    found = [folder / f"session-{run}.csv" for run in (0, 1)]
    for run, path in enumerate(found):
        write_rugbot(made, path, run)
    return found


@pytest.fixture(scope="session")
def console_logs(made: Result, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("console")
    found = [folder / f"console-{run}.txt" for run in (0, 1)]
    for run, path in enumerate(found):
        write_webots(made, path, run)
    return found


@pytest.fixture(scope="session")
def ground(told: Scenario) -> Floor:
    return told.floor_for(0, 0)
