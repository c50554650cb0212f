"""Verify saved runs of studies: simulate a sample of them again from their seed, and compare them bit by bit.

A run that differs was made by other code or other versions of libraries, on another kind of processor, or its files
were changed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.statistics.intervals import generator
from vibroswarm.study.batch import Task, simulate_runs
from vibroswarm.study.store import FOLDER, SCENARIOS, Store


@dataclass(frozen=True)
class Verified:
    """Runs that were simulated again."""

    folder: Path
    runs: pl.DataFrame
    """A row for each: strategy, run, same, and the columns that differ."""
    saved: int
    """Number of runs in the folder."""
    damaged: tuple[Path, ...]
    """Files that cannot be read, whose runs are not among them."""

    @property
    def holds(self) -> bool:
        """Whether all of them came out the same, and no file is damaged."""
        return bool(self.runs["same"].all()) and not self.damaged


def verify(
    folder: str | Path, runs: int = 20, seed: int = 1, progress: Callable[[float], None] = lambda share: None
) -> Verified:
    """Simulate a sample of the saved runs in a folder, and in those within, again.

    Args:
        folder: of a study, or of anything that holds studies. runs: number that is drawn. seed: of the draw.
        progress: called with the share of the runs that is done.
    Raises:
        InputError: the folder holds no runs of studies of this version.
    """
    folder = Path(folder)
    places = sorted(path.parents[1] for path in folder.rglob(f"{FOLDER}/{SCENARIOS}"))
    stores = [Store(place, *world) for place in places for world in Store.worlds(place)]
    saved = [
        (store, key, run)
        for store in stores
        for key, ranges in sorted(store.ranges.items())
        for run in sorted({run for first, last in ranges for run in range(first, last)})
    ]
    damaged = tuple(dict.fromkeys(path for store in stores for path in store.damaged))
    if not saved and not damaged:
        raise InputError("holds no runs of studies of this version", field=str(folder))
    drawn = generator(seed, "runs to verify").permutation(len(saved))[:runs]
    rows = []
    for place in sorted(drawn):
        store, key, run = saved[place]
        text = (store.folder / SCENARIOS / f"{key}.toml").read_text(encoding="utf-8")
        kept = store.scan([key], run + 1)
        assert kept is not None  # it is among those that are saved
        task = Task(
            ((key, text),), run, run + 1, store.world["seed"], store.world["motion"], store.world["code"]
        )
        mine, again = kept.filter(pl.col("run") == run).collect(), simulate_runs(task)
        differing = [name for name in mine.columns if not mine[name].equals(again[name], null_equal=True)]
        rows.append((Scenario.from_toml(text).strategy.name, run, not differing, ", ".join(differing)))
        progress(len(rows) / len(drawn))
    schema = {"strategy": pl.String, "run": pl.UInt32, "same": pl.Boolean, "columns": pl.String}
    return Verified(folder, pl.DataFrame(rows, schema=schema, orient="row"), len(saved), damaged)
