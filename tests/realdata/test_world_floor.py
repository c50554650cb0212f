"""The floor of the real robots, from the lab's own list of coordinates."""

from __future__ import annotations

from pathlib import Path

import pytest

from vibroswarm.floors.difficulty import measure
from vibroswarm.floors.io import read_tiles
from vibroswarm.floors.source import resolve
from vibroswarm.paper.columns import ROWS


@pytest.fixture
def world(recordings: Path) -> Path:
    return recordings / "world.txt"


def test_the_world_of_the_real_robots(world):
    tiles = read_tiles(world, (5, 5))
    assert tuple("".join(map(str, row)) for row in tiles.tolist()) == ROWS
    found = measure(tiles)
    assert (found.ones, found.fill_ratio, found.clusters) == (12, 0.48, 7)
    assert resolve(str(world), (5, 5))[1] == "world.txt"
