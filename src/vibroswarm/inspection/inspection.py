"""``inspect``: what the samples of one inspection say."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import (
    InputError,
    check_choice,
    check_kind,
    number_of,
    shown,
    whole_number_of,
)
from vibroswarm.floors.floor import Floor
from vibroswarm.floors.io import parse_tiles
from vibroswarm.inspection.assessment import Assessment, assess
from vibroswarm.inspection.damage import SHAPES
from vibroswarm.inspection.laws import (
    DRAWS,
    known_from,
    law_for_session,
    law_named,
    law_of_bits,
    law_of_recordings,
    law_of_scenario,
)
from vibroswarm.inspection.patches import SIZES_M, Side
from vibroswarm.inspection.samples import Floats, Law, Samples, check_law
from vibroswarm.inspection.scan import REPLICATES
from vibroswarm.inspection.sources import grid_of, samples_of_csv, samples_of_result
from vibroswarm.inspection.stopping import Question
from vibroswarm.inspection.tile_map import any_but_still, kind_map, tile_map
from vibroswarm.recordings.recording import Recording, read_result
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import check_seed, simulate
from vibroswarm.statistics.map_scores import map_scores

TIMES: Final = 60
"""Most times of the maps, evenly spaced up to the last sample."""
LEAST_M: Final = 1e-3
"""Least width and height of a surface."""


@dataclass(frozen=True, eq=False)
class Inspection:
    """What the samples of one inspection say."""

    samples: Samples
    times_s: Floats
    """Times of the maps, (times,)."""
    pooled: Floats | None
    """Probability of each tile from the samples of all robots, (times, tiles); None: there is no grid."""
    own: dict[int, Floats]
    """Each robot's, from its own samples, (times, tiles)."""
    by_kind: Floats | None = None
    """Probability of each kind of each tile at the end, (tiles, kinds); None: there are two kinds."""
    assessment: Assessment | None = None
    """Answers about damage that is not bound to the grid; None: not asked, and there is a grid."""

    @property
    def maps(self) -> pl.DataFrame:
        """All maps of tiles: time_s, run, robot (null: pooled), row, column, probability, its spread, truth."""
        return self._maps_at(0)

    def _maps_at(self, first: int) -> pl.DataFrame:
        """Return the maps of the times from the one of index ``first`` on, as ``maps`` has them."""
        if self.pooled is None or self.samples.floor is None:
            return pl.DataFrame()
        each: list[tuple[int | None, Floats]] = [(None, self.pooled), *self.own.items()]
        shape, vibrates = (-1, *self.samples.floor.tiles.shape), self.vibrates
        truth = pl.lit(None, pl.UInt8) if vibrates is None else pl.Series(vibrates[first:].ravel())
        frames = [
            _of_cells(robot, self.times_s[first:], maps[first:].reshape(shape)).with_columns(vibrates=truth)
            for robot, maps in each
        ]
        return pl.concat(frames)

    @property
    def vibrates(self) -> NDArray[np.uint8] | None:
        """Which tiles vibrate at each time (1), (times, tiles); None: there is no grid, or it is not known."""
        if self.samples.floor is None or not self.samples.truth_known:
            return None
        return np.stack([self.samples.floor.at(time_s).tiles.ravel() for time_s in self.times_s])

    @property
    def last_maps(self) -> pl.DataFrame:
        """The last maps, as ``analysis.map_figures`` has them."""
        maps = self._maps_at(-1)
        return maps if maps.is_empty() else maps.drop("time_s")

    @property
    def rasters(self) -> pl.DataFrame:
        """The probability of damage of each cell over time, and by each robot's own samples; columns as of ``maps``."""
        found = self.assessment
        if found is None:
            return pl.DataFrame()
        last_s = found.raster_times_s[-1:]
        own = [_of_cells(robot, last_s, cells[None]) for robot, cells in found.own_rasters.items()]
        return pl.concat([_of_cells(None, found.raster_times_s, found.rasters), *own])

    @property
    def scores(self) -> pl.DataFrame:
        """Scores of the pooled map at each time, by the floor at that time; empty without a grid or a known truth."""
        if self.pooled is None or self.samples.floor is None or not self.samples.truth_known:
            return pl.DataFrame()
        floor = self.samples.floor
        rows = [map_scores(p, floor.at(time_s)) for p, time_s in zip(self.pooled, self.times_s, strict=True)]
        return pl.DataFrame(rows).insert_column(0, pl.Series("time_s", self.times_s))

    @property
    def right_from_s(self) -> float | None:
        """The first time from which on all tiles of the pooled map are right; None: not at the end, or not known."""
        scores = self.scores
        if scores.is_empty() or scores["right"][-1] < 1.0:
            return None
        wrong = np.flatnonzero(scores["right"].to_numpy() < 1.0)
        return float(self.times_s[wrong[-1] + 1 if wrong.size else 0])


def _of_cells(robot: int | None, times_s: Floats, maps: Floats) -> pl.DataFrame:
    """Return maps as a table.

    Args:
        robot: whose samples they are of; None: all. maps: (times, rows, columns).
    """
    time, row, column = (index.ravel() for index in np.indices(maps.shape))
    return pl.DataFrame(
        {
            "time_s": times_s[time],
            "run": np.zeros(row.size, np.uint32),
            "robot": pl.Series([robot] * row.size, dtype=pl.UInt16),
            "row": row,
            "column": column,
            "vibrating": maps.ravel(),
            "spread": np.sqrt(maps * (1.0 - maps)).ravel(),
        }
    )


Source = Result | Scenario | Samples | str | Path
Laws = str | Scenario | Sequence[Recording] | None


def inspect(
    source: Source,
    *,
    run: int = 0,
    seed: int = 1,
    laws: Laws | Path = None,
    bits: bool = False,
    size_m: tuple[float, float] | None = None,
    spread_m: float = 0.0,
    spreads: tuple[float, float] = (0.0, 0.0),
    floor: Floor | tuple[int, int] | None = None,
    question: Question | None = None,
    sides_m: Sequence[Side] = SIZES_M,
    replicates: int = REPLICATES,
    looks: int = 1,
    shapes: Sequence[str] = ("square",),
    progress: Callable[[float], None] | None = None,
) -> Inspection:
    """Inspect a surface by the samples of one run, session or file: where does it vibrate, and how sure is that?

    Args:
        source: a result or recording, or its folder; a scenario, which is simulated; a CSV of places and values
            (``sources.samples_of_csv``); or samples.
        run: number of the run or session, from 0. seed: of the simulation of a scenario.
        laws: where the law of the sensor is known from: the name of a preset, a scenario, its file (.toml), measured
            values (.csv), a folder of a recording, or recordings. By default that of the result's scenario; for a
            recording it is fitted to the other sessions, or to the session itself if it is the only one.
        bits: use readings of 0 and 1 in the place of energies.
        size_m: width and height of the surface, for a CSV. spread_m: standard deviation of its places, or of those of a
            camera. floor: grid of tiles of a CSV, as a floor that says which tiles vibrate, or as rows and columns.
        spreads: how much tiles and robots differ (standard deviations of the logarithm of their factors), for a law of
            measured values, which does not say it.
        question: what damage must be found, and how surely; without a grid it is always asked.
        sides_m: declared sizes of damage: sides of squares, width and height of cracks, or forms.
        replicates: intact surfaces drawn for the scan. looks: how often it is looked at.
        shapes: of ``damage.SHAPES``, of which PoD is fitted. progress: called with the share that is done.
    Raises:
        InputError: nothing can be said of these samples, with the reason.
    """
    known: Laws = str(laws) if isinstance(laws, Path) else laws
    _check_types(source, known)
    run, seed = whole_number_of(run, "run", 0, 2**32 - 1), check_seed(seed)
    spread_m = number_of(spread_m, "spread_m")
    size_m = None if size_m is None else _pair_of(size_m, "size_m", LEAST_M)
    spreads = _pair_of(spreads, "spreads", 0.0)
    check_kind(floor, (Floor, tuple, NoneType), "floor", "a Floor, or a pair of rows and columns")
    _check_asked(question, replicates, looks, shapes)
    # The error of a law costs many fits to sessions; a map alone does not use it.
    draws = 0 if question is None else DRAWS
    samples = _samples_of(source, run, seed, known, spreads, bits, size_m, spread_m, floor, draws)
    check_law(samples.law)
    end_s = float(samples.column("time_s").max())
    # One, if all samples have the same time.
    times_s = np.unique(np.linspace(samples.began_s + (end_s - samples.began_s) / TIMES, end_s, TIMES))
    damage: dict[str, Any] = {
        "sides_m": sides_m, "replicates": replicates, "seed": seed, "looks": looks, "shapes": shapes,
        "progress": progress,
    }  # fmt: skip
    if samples.floor is None:
        return Inspection(samples, times_s, None, {}, assessment=assess(samples, question, **damage))
    pooled, by_kind = _maps(samples, times_s)
    own = {robot: _maps(samples.of(robot), times_s)[0] for robot in samples.robots if len(samples.robots) > 1}
    judged = samples if by_kind is None else any_but_still(samples)
    assessment = None if question is None else assess(judged, question, **damage)
    return Inspection(samples, times_s, pooled, own, by_kind, assessment)


def _check_types(source: object, laws: object) -> None:
    """Refuse a source of samples, or of the law of the sensor, of another type.

    Raises:
        InputError: as said.
    """
    check_kind(
        source,
        (Result, Scenario, Samples, str, Path),
        "source",
        "a result, a scenario, samples, or the path of a folder or CSV",
    )
    if isinstance(laws, str | Scenario | None):
        return
    words = "the name of a preset, a path, a scenario, or a list of recordings"
    check_kind(laws, (list, tuple), "laws", words)
    for one in laws:  # type: ignore[attr-defined]  # a list or a tuple, as checked
        check_kind(one, Recording, "laws", words)


def _pair_of(value: object, field: str, low: float) -> tuple[float, float]:
    """Return a pair of numbers of at least ``low``.

    Raises:
        InputError: it is something else.
    """
    if not isinstance(value, tuple | list) or len(value) != 2:
        raise InputError(f"{shown(value)} is not a pair of numbers", field=field)
    return number_of(value[0], field, low), number_of(value[1], field, low)


def _check_asked(question: object, replicates: object, looks: object, shapes: object) -> None:
    """Refuse what is asked about damage, if it is of another type.

    Raises:
        InputError: as said.
    """
    check_kind(question, (Question, NoneType), "question", "a Question")
    whole_number_of(replicates, "replicates", 0, 10**6)
    whole_number_of(looks, "looks", 1, 100)
    check_kind(shapes, (tuple, list), "shapes", f"a list of shapes ({', '.join(SHAPES)})")
    for shape in shapes:  # type: ignore[attr-defined]  # a list or a tuple, as checked
        check_choice(shape, "shapes", SHAPES)


def _maps(samples: Samples, times_s: Floats) -> tuple[Floats, Floats | None]:
    """Return the probability of each tile over time, and that of each kind at the end if there are more than two."""
    if samples.kinds is None:
        return tile_map(samples, times_s), None
    kinds = kind_map(samples, times_s)
    return 1.0 - kinds[..., 0], kinds[-1]


def _samples_of(
    source: Source, run: int, seed: int, laws: Laws, spreads: tuple[float, float], bits: bool,
    size_m: tuple[float, float] | None, spread_m: float, floor: Floor | tuple[int, int] | None, draws: int,
) -> Samples:  # fmt: skip
    """Return the samples of a source; the arguments are those of ``inspect``, and the draws of the law."""
    if isinstance(source, str | Path) and (path := Path(source)).suffix.lower() == ".csv":
        _refuse_given({"--run": run, "--bits": bits}, "a CSV has one inspection, with the values that it has")
        return _of_csv(path, laws, spreads, size_m, spread_m, floor, draws)
    _refuse_given({"size_m": size_m, "floor": floor}, "describes a CSV; the source has its own")
    if isinstance(source, Samples):
        own = {"run": run, "laws": laws, "bits": bits, "spread_m": spread_m, "spreads": any(spreads)}
        _refuse_given(own, "samples have their own")
        return source
    if isinstance(source, str | Path):
        source = read_result(Path(source))
    if isinstance(source, Scenario):
        source = simulate(source, seed, [run])
    law = _law_of(source, run, laws, spreads, draws, bits=bits)
    return samples_of_result(source, run, law, bits=bits, spread_m=spread_m)


def _refuse_given(values: dict[str, Any], words: str) -> None:
    """Refuse arguments that a source does not have; one that is None, False or 0 is not given.

    Raises:
        InputError: one is given.
    """
    for field, value in values.items():
        if value:
            raise InputError(f"leave it out: {words}", field=field)


def _law_of(
    result: Result | None,
    run: int,
    laws: Laws,
    spreads: tuple[float, float],
    draws: int,
    *,
    bits: bool = False,
) -> Law:
    """Return the law by which samples are judged; ``result`` is None for a CSV, whose law must be given."""
    if any(spreads) and not (isinstance(laws, str) and laws.lower().endswith(".csv")):
        raise InputError(
            "belongs to a law of measured values (--laws CSV); others say how much robots and tiles differ",
            field="--tile-spread" if spreads[0] else "--robot-spread",
        )
    if isinstance(laws, str):
        return law_named(laws, draws=draws, spreads=spreads)
    if isinstance(laws, Scenario):
        return known_from(laws, "a scenario")
    if laws:
        return law_of_recordings(laws, " of other recordings", draws)
    if isinstance(result, Recording):
        return (law_of_bits if bits else law_for_session)(result, run, draws=draws)
    if result is None:
        raise InputError(
            "a CSV needs a law of the sensor: values measured where it vibrates and where not (kind,energy as CSV), a "
            "recording on a known floor, or a scenario",
            field="--laws",
        )
    return law_of_scenario(
        result.scenario, "the scenario, which simulated it: no real robot knows it so well"
    )


def _of_csv(
    path: Path, laws: Laws, spreads: tuple[float, float], size_m: tuple[float, float] | None, spread_m: float,
    floor: Floor | tuple[int, int] | None, draws: int,
) -> Samples:  # fmt: skip
    """Return the samples of a CSV of places and values."""
    if size_m is None:
        raise InputError(
            "a CSV needs the size of the surface (in Python: size_m=(width, height))", field="--size"
        )
    # Without a grid the question is always whether there is damage, and that needs the error of the law.
    law = _law_of(None, 0, laws, spreads, DRAWS if floor is None else draws)
    is_known = isinstance(floor, Floor)
    if isinstance(floor, tuple):
        floor = grid_of(*parse_tiles("x".join(map(str, floor)), "floor"), size_m)
    return samples_of_csv(path, law, size_m, spread_m, floor, truth_known=is_known)
