"""``inspect``: what the samples of one inspection say."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.inspection.assessment import Assessment, Question, assess
from vibroswarm.inspection.laws import (
    DRAWS,
    known_from,
    law_for_session,
    law_named,
    law_of_recordings,
    law_of_scenario,
)
from vibroswarm.inspection.patches import SIZES_M, Sides
from vibroswarm.inspection.samples import Floats, Law, Samples
from vibroswarm.inspection.scan import REPLICATES
from vibroswarm.inspection.sources import Origin, samples_of_csv, samples_of_result
from vibroswarm.inspection.tile_map import any_but_still, kind_map, tile_map
from vibroswarm.recordings.recording import Recording, read_result
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate
from vibroswarm.statistics.map_figures import map_scores

TIMES: Final = 60
"""Most times of the maps, evenly spaced up to the last sample."""


@dataclass(frozen=True, eq=False)
class Inspection:
    """What the samples of one inspection say."""

    samples: Samples
    times_s: Floats
    """Times of the maps, (times,)."""
    by_kind: Floats | None
    """Probability of each kind of each tile, from the samples of all robots, (times, tiles, kinds); None: no grid."""
    own: dict[int, Floats]
    """Probability that each tile vibrates at the end, from each robot's own samples, (tiles,)."""
    assessment: Assessment | None = None
    """Answers about damage that is not bound to the grid; None: not asked, and there is a grid."""

    @property
    def pooled(self) -> Floats | None:
        """Probability that each tile vibrates, or is not of kind 0, over time, (times, tiles)."""
        return None if self.by_kind is None else 1.0 - self.by_kind[..., 0]

    @property
    def vibrates(self) -> NDArray[np.uint8] | None:
        """Which tiles vibrate at each time (1), (times, tiles); None: there is no grid, or it is not known."""
        floor = self.samples.floor
        if floor is None or not self.samples.truth_known:
            return None
        return np.stack([floor.at(time_s).tiles.ravel() for time_s in self.times_s])

    @property
    def maps(self) -> pl.DataFrame:
        """The last maps: run, robot (null: pooled), row, column, probability, its standard deviation, truth."""
        if self.pooled is None:
            return pl.DataFrame()
        row, column = (index.ravel() for index in np.indices(self.samples.grid.tiles.shape))
        truth = pl.lit(None, pl.UInt8) if self.vibrates is None else pl.Series(self.vibrates[-1])
        each: list[tuple[int | None, Floats]] = [(None, self.pooled[-1]), *self.own.items()]
        frames = [
            pl.DataFrame({"row": row, "column": column, "vibrating": p}).select(
                pl.lit(0, pl.UInt32).alias("run"),
                pl.lit(robot, pl.UInt16).alias("robot"),
                pl.all(),
                spread=(pl.col("vibrating") * (1.0 - pl.col("vibrating"))).sqrt(),
                vibrates=truth,
            )
            for robot, p in each
        ]
        return pl.concat(frames)

    @property
    def scores(self) -> pl.DataFrame:
        """Scores of the pooled map at each time, by the floor at that time; empty without a grid or a known truth."""
        floor = self.samples.floor
        if self.pooled is None or floor is None or not self.samples.truth_known:
            return pl.DataFrame()
        rows = [map_scores(p, floor.at(time_s)) for p, time_s in zip(self.pooled, self.times_s, strict=True)]
        return pl.DataFrame(rows).insert_column(0, pl.Series("time_s", self.times_s))


Source = Result | Scenario | Samples | str | Path
Laws = str | Path | Scenario | Sequence[Recording] | None


def inspect(
    source: Source, *, run: int = 0, seed: int = 1, laws: Laws = None, bits: bool = False,
    size_m: tuple[float, float] | None = None, origin: Origin = "bottom-left", spread_m: float = 0.0,
    spreads: tuple[float, float] = (0.0, 0.0), floor: Floor | tuple[int, int] | None = None,
    question: Question | None = None, sides_m: Sequence[float | Sides] = SIZES_M, replicates: int = REPLICATES,
    progress: Callable[[float], None] | None = None,
) -> Inspection:  # fmt: skip
    """Inspect a surface by the samples of one run, session or file: where does it vibrate, and how sure is that?

    Args:
        source: a result or recording, or its folder; a scenario, which is simulated; a CSV of places and values
            (``sources.samples_of_csv``); or samples.
        run: number of the run or session, from 0. seed: of the simulation of a scenario, and of all that is drawn.
        laws: where the law of the sensor is known from: the name of a preset, a scenario, its file (.toml), measured
            values (.csv), a folder of a recording, or recordings. By default that of the result's scenario; for a
            recording it is fitted to the other sessions, or to the session itself if it is the only one.
        bits: use readings of 0 and 1 in the place of energies.
        size_m: width and height of the surface, for a CSV. origin: from where its places count. spread_m: standard
            deviation of its places, or of those of a camera. floor: grid of tiles of a CSV, as a floor that says which
            tiles vibrate, or as rows and columns.
        spreads: how much tiles and robots differ (standard deviations of the logarithm of their factors), for a law of
            measured values, which does not say it.
        question: what damage must be found, and how surely; without a grid it is always asked.
        sides_m: sizes that are scanned for: sides of squares, or widths and heights.
        replicates: intact surfaces drawn for the scan. progress: called with the share that is done.
    Raises:
        InputError: nothing can be said of these samples, with the reason.
    """
    is_csv = isinstance(source, str | Path) and Path(source).suffix.lower() == ".csv"
    # The error of a law costs many fits to sessions; a map alone does not use it.
    draws = 0 if question is None and not (is_csv and floor is None) else DRAWS
    if is_csv:
        samples = _of_csv(Path(str(source)), laws, spreads, size_m, spread_m, floor, origin, draws)
    elif isinstance(source, Samples):
        samples = source
    else:
        result = read_result(Path(source)) if isinstance(source, str | Path) else source
        result = simulate(result, seed, [run]) if isinstance(result, Scenario) else result
        law = _law_of(result, run, laws, spreads, draws, bits=bits)
        samples = samples_of_result(result, run, law, bits=bits, spread_m=spread_m)
    time_s = samples.column("time_s")
    times_s = np.unique(np.linspace(time_s.min(), time_s.max(), TIMES))
    damage: dict[str, Any] = {
        "sides_m": sides_m, "replicates": replicates, "seed": seed, "progress": progress,
    }  # fmt: skip
    if samples.floor is None:
        return Inspection(samples, times_s, None, {}, assess(samples, question, **damage))
    own = {
        robot: tile_map(samples.where(pl.col("robot") == robot), [np.inf])[0]
        for robot in samples.robots
        if len(samples.robots) > 1
    }
    judged = samples if samples.kinds is None else any_but_still(samples)
    assessment = None if question is None else assess(judged, question, **damage)
    return Inspection(samples, times_s, kind_map(samples, times_s), own, assessment)


def _law_of(
    result: Result | None,
    run: int,
    laws: Laws,
    spreads: tuple[float, float],
    draws: int,
    *,
    bits: bool = False,
) -> Law:
    if isinstance(laws, str | Path):
        return law_named(str(laws), draws=draws, spreads=spreads)
    if isinstance(laws, Scenario):
        return known_from(laws, "a scenario")
    if laws:
        return law_of_recordings(laws, draws)
    if isinstance(result, Recording):
        return law_for_session(result, run, draws=draws, bits=bits)
    if result is None:
        raise InputError(
            "is needed for a CSV: measured values (kind,energy), a recording, or a scenario", field="--laws"
        )
    return law_of_scenario(
        result.scenario, "the scenario, which simulated it: no real robot knows it so well"
    )


def _of_csv(
    path: Path, laws: Laws, spreads: tuple[float, float], size_m: tuple[float, float] | None, spread_m: float,
    floor: Floor | tuple[int, int] | None, origin: Origin, draws: int,
) -> Samples:  # fmt: skip
    if size_m is None:
        raise InputError("is needed for a CSV: width and height of the surface, m", field="--size")
    law, is_known = _law_of(None, 0, laws, spreads, draws), isinstance(floor, Floor)
    if isinstance(floor, tuple):
        rows, columns = floor
        floor = Floor(np.zeros((rows, columns), dtype=np.uint8), size_m[0] / columns, size_m[1] / rows)
    return samples_of_csv(path, law, size_m, spread_m, floor, truth_known=is_known, origin=origin)
