"""At theta_E 1.33 the floor of the real robots is indistinguishable from the boundary, however long they sample.

The recordings stay where they are; VIBROSWARM_RUGBOT names their folder.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vibroswarm.floors.floor import Floor
from vibroswarm.floors.io import read_tiles
from vibroswarm.paper.columns import REAL
from vibroswarm.statistics.decidability import decidability_of_share, observed_share, samples_needed
from vibroswarm.statistics.intervals import mean_interval
from vibroswarm.statistics.sampling import effective_samples, effective_with_sensor

BY_SESSION = (0.482, 0.506, 0.499)
"""Share that reads as vibrating at 1.33, each tile counting alike."""


def samples(folder: Path, session: str) -> tuple[np.ndarray, np.ndarray]:
    """Tile and energy of each sample of a session."""
    frame = pl.read_csv(folder / session, infer_schema=False)
    rows = frame.filter(pl.col("Energy") != "None").select(
        x=pl.col("X Meter").cast(pl.Float64),
        y=pl.col("Y Meter").cast(pl.Float64),
        e=pl.col("Energy").cast(pl.Float64),
    )
    floor = Floor.filling(read_tiles(folder / "world.txt", (5, 5)))
    inside = rows.with_columns(pl.col("x", "y").clip(1e-9, 1 - 1e-9))
    return floor.tile_at(inside["x"].to_numpy(), inside["y"].to_numpy()), rows["e"].to_numpy()


RATES = (0.163, 0.147)
"""False positives and negatives of all recordings at 1.33."""


@pytest.mark.parametrize(("session", "share"), list(zip(REAL, BY_SESSION, strict=True)))
def test_no_session_can_be_told_from_the_boundary(recordings: Path, session: str, share: float) -> None:
    """As its bits are worth where they were read; told tile by tile the first alone would stand a little off."""
    tile, energy = samples(recordings, session)
    seen = observed_share(tile, energy > 1.33)
    assert seen == pytest.approx(share, abs=0.0006)
    visits = np.bincount(tile) / tile.size
    worth = float(effective_with_sensor(tile.size, effective_samples(visits @ visits, 25), 0.48, *RATES))
    assert 0.3 * tile.size < worth < tile.size
    told = decidability_of_share(seen, 0.5, 0, worth)
    assert told.verdict == "indistinguishable from the boundary", told.says


def test_nor_all_three_together_but_at_a_higher_threshold(recordings: Path) -> None:
    """With the session as the unit."""
    by_session = [samples(recordings, session) for session in REAL]
    tile, energy = (np.concatenate(parts) for parts in zip(*by_session, strict=True))
    over_sessions = {}
    for threshold in (1.33, 1.55):
        over_sessions[threshold] = mean_interval([observed_share(t, e > threshold) for t, e in by_session])
    assert not over_sessions[1.33].excludes(0.5)
    assert over_sessions[1.55].high < 0.5
    # Were the pooled share exact, independent samples of more than ten such sessions would still be needed.
    assert samples_needed(observed_share(tile, energy > 1.33), 0.5) > 10 * 1800
