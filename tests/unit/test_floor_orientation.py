"""A floor that is turned or mirrored is said to be so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.recordings import floor_fit
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.floor_fit import ORIENTATIONS, floor_fits, turned
from vibroswarm.recordings.read import read_log
from vibroswarm.scenario.scenario import preset


@pytest.mark.parametrize("orientation", ORIENTATIONS[1:])
def test_a_floor_that_is_turned_is_told_so(logs: list[Path], ground: Floor, orientation: str) -> None:
    """What would have to be done to the floor that was given is the reverse of what was done to it."""
    wrong, log = Floor.filling(turned(ground.tiles, orientation)), read_log(logs[0])
    if np.array_equal(wrong.tiles, ground.tiles):
        pytest.skip("the floor is alike")
    with pytest.raises(InputError, match=r"does not fit: of random floors .* It fits"):
        recording_of([log], wrong, preset("paper"))
    fits = floor_fits(wrong, log.samples)
    assert np.array_equal(turned(wrong.tiles, fits[0].orientation), ground.tiles)
    assert fits[0].probability >= 1 / (floor_fit.FLOORS + 1)  # never 0, whatever other floors do
