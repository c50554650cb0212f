"""The runs of cells as frames: everything that is reported, compared or searched is a function of them.

| column of ``Runs.frame`` | what it is |
|---|---|
| cell, name, varied fields | number and name of the cell, and its value of each varied field |
| run | number of the run; run r of all cells has the same motion and floor |
| decision_time_s | mean over robots; one that did not decide counts with the end of the run (``robots_undecided``) |
| consensus_time_s | null if ``swarm_undecided`` (without consensus), where ``swarm_time_s`` is the end of the run |
| robots, robots_right, ... | numbers of robots |
| right_share, ... | shares of robots, and the other figures of ``statistics.figures`` |
| swarm_right, ... | whether the run ended so |
| avoid_per_sample_s, ... | how robots sampled (``statistics.sampling``) |
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.optional_library import needed
from vibroswarm.errors import InputError
from vibroswarm.inference.outcomes import ROBOTS, RUNS
from vibroswarm.result import Result
from vibroswarm.scenario import plugins
from vibroswarm.simulation import simulate
from vibroswarm.statistics.figures import BY_NAME, FIGURES, interval
from vibroswarm.study.batch import OF_ROBOTS, WALK, motion_key
from vibroswarm.study.cells import Cell
from vibroswarm.study.precision import Precision, Settled
from vibroswarm.study.store import Store

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

COUNTS: Final = {name: f"robots_{name}" for name in ("right", "wrong", "undecided", "decided", "stated")}
"""Names of numbers of robots in frames."""
OF_ROBOT: Final = r"^robot[.].*$"
"""Pattern of the columns with a list of values of robots."""
OF_RUN: Final = pl.exclude("key", "run", "reported", OF_ROBOT)
"""All columns with one value for a run, but its number."""
YES_OR_NO: Final = tuple(figure.by_run for figure in FIGURES if figure.kind == "runs")
ROWS_AT_A_TIME: Final = 50_000
"""Most rows of a block of cells, unless a single cell has more."""


@dataclass(frozen=True)
class Runs(NotebookView):
    """The runs of cells, which are read from a store when they are asked for."""

    cells: tuple[Cell, ...]
    runs: int
    """Of each cell, unless a figure is to be known to some precision."""
    seed: int
    motion: str
    store: Store
    keys: Mapping[int, str]
    """What the store knows each cell by (``store.key_of``), by its number."""
    until: Precision | None = None
    name: str = ""
    folder: Path | None = None
    """Where they are saved; None: they are not."""
    whole: Runs | None = None
    """Those of which these cells were selected; None: these are all."""

    def __repr__(self) -> str:
        where = f"in {str(self.folder)!r}" if self.folder else "not saved"
        return f"Runs({len(self.cells)} cells, {sum(self.there.values())} runs, {where})"

    @cached_property
    def varied(self) -> list[str]:
        """The varied fields, in order of first use."""
        return list(dict.fromkeys(name for cell in self.cells for name in cell.point))

    @cached_property
    def there(self) -> dict[int, int]:
        """How many of the runs that enter the figures of a cell are there, by its number."""
        return {
            cell.number: self.store.there(self.keys[cell.number], 0, self.runs_of(cell))
            for cell in self.cells
        }

    def runs_of(self, cell: Cell) -> int:
        """Return how many runs of a cell, from run 0 on, enter its figures."""
        if self.until is None:
            return self.runs
        if cell.number in self.settled:
            return self.settled[cell.number].runs
        # Before the first look, those that are there without a gap.
        return next(iter(self.store.ranges.get(self.keys[cell.number], ())), (0, 0))[1]

    @cached_property
    def settled(self) -> dict[int, Settled]:
        """The last look at each cell, by its number; cells that share motion are looked at together."""
        if self.whole is not None:
            return self.whole.settled
        if (until := self.until) is None:
            return {}
        found = dict[int, Settled]()
        for group in groups_of(self.cells):
            for look, runs in enumerate(until.looks()):
                if any(self.store.there(self.keys[cell.number], 0, runs) < runs for cell in group):
                    break
                level = until.level_at(look)
                last = Settled(runs, level, all(self._is_precise(until, cell, runs, level) for cell in group))
                found |= {cell.number: last for cell in group}
                if last.reached:
                    break
        return found

    def _is_precise(self, until: Precision, cell: Cell, runs: int, level: float) -> bool:
        figure, t_end_s = BY_NAME[until.figure], cell.scenario.run.t_end_s
        rows = self.rows(*figure.read, cells=[cell], runs=runs)
        return until.reached(interval(figure.name, rows, level, t_end_s), t_end_s)

    def rows(
        self, *columns: str | pl.Expr, cells: Sequence[Cell] | None = None, runs: int | None = None
    ) -> pl.DataFrame:
        """Return columns of the store by run, and the number of the ``cell``, sorted by cell and run.

        Args:
            columns: names, or patterns such as ``^robot[.].*$``; none: ``OF_RUN``.
            runs: of each cell; None: those that enter its figures.
        Raises:
            InputError: none of these cells has runs yet.
        """
        cells = self.cells if cells is None else cells
        wanted = pl.DataFrame(
            [(cell.number, self.keys[cell.number], runs or self.runs_of(cell)) for cell in cells],
            schema={"cell": pl.UInt32, "key": pl.String, "_runs": pl.UInt32}, orient="row",
        )  # fmt: skip
        stored = self.store.scan(wanted["key"].to_list(), max(wanted["_runs"].to_list(), default=0))
        if stored is None:
            raise InputError("holds no runs of these cells yet", field=str(self.folder or "runs"))
        stored = stored.select("key", "run", *(columns or [OF_RUN]))
        if len(cells) == 1:
            cell = pl.lit(cells[0].number, pl.UInt32).alias("cell")
            rows = stored.filter(pl.col("run") < wanted["_runs"][0]).select(cell, pl.exclude("key")).collect()
        else:
            joined = wanted.lazy().join(stored, on="key").filter(pl.col("run") < pl.col("_runs"))
            rows = joined.drop("key", "_runs").collect()
        return rows if len(cells) == 1 and rows["run"].is_sorted() else rows.sort("cell", "run")

    def by_cell(self, *columns: str, cells: Sequence[Cell]) -> list[tuple[Cell, pl.DataFrame]]:
        """Return the ``rows`` of each cell, in the order of the cells, all of which have some."""
        rows = self.rows(*columns, cells=cells)
        # A copy of a single cell would take memory twice.
        parts = rows.partition_by("cell", as_dict=True) if len(cells) > 1 else {(cells[0].number,): rows}
        return [(cell, parts[cell.number,]) for cell in cells]

    def blocks(self) -> Iterator[Sequence[Cell]]:
        """Yield some cells at a time, so that few of their ``rows`` need to be in memory."""
        size = max(ROWS_AT_A_TIME // max(1, *map(self.runs_of, self.cells)), 1)
        for first in range(0, len(self.cells), size):
            yield self.cells[first : first + size]

    @cached_property
    def frame(self) -> pl.DataFrame:
        """A row for each cell and run, see the head of this module."""
        is_open = pl.col("consensus_time_s").is_null()
        rows = self.rows().with_columns(pl.col(YES_OR_NO).cast(pl.Boolean), swarm_undecided=is_open)
        return self._with_cells(rows.rename(COUNTS))

    @cached_property
    def robots(self) -> pl.DataFrame:
        """A row for each cell, run and robot; ``decision_time_s`` is null if the robot is ``undecided``."""
        rows = self._robots(self.rows(OF_ROBOT))
        return self._with_cells(rows.with_columns(undecided=pl.col("decision") == -1))

    def tables(self, cell: Cell) -> tuple[pl.DataFrame, pl.DataFrame]:
        """Return the tables of robots and of runs of a cell, as a ``Result`` has them, with how robots sampled."""
        rows = self.rows(*(name for name in RUNS if name != "run"), *WALK, OF_ROBOT, cells=[cell])
        counts = pl.col("right", "wrong", "undecided").fill_null(
            0
        )  # null in figures where no answer is right
        runs = rows.with_columns(counts).select(
            *(pl.col(name).cast(kind) for name, kind in RUNS.items()), *WALK
        )
        return self._robots(rows.drop("cell")).select(list(ROBOTS)), runs

    @staticmethod
    def _robots(rows: pl.DataFrame) -> pl.DataFrame:
        lists = [f"robot.{name}" for name in OF_ROBOTS]
        number = pl.int_ranges(pl.col(lists[0]).list.len(), dtype=pl.UInt16)
        keys = [name for name in ("cell", "run") if name in rows.columns]
        rows = rows.select(*keys, number.alias("robot"), *lists).explode("robot", *lists)
        return rows.rename({name: name.removeprefix("robot.") for name in lists}).cast({"run": pl.UInt32})

    def check_complete(self) -> None:
        """Raise InputError if runs of a cell are missing."""
        for cell in self.cells:
            if self.there[cell.number] < self.runs_of(cell):
                raise InputError(
                    f"has {self.there[cell.number]} of {self.runs_of(cell)} runs; run it again",
                    field=cell.name,
                )

    def where(self, **values: Any) -> Runs:
        """Select cells by values of varied fields, such as ``where(strategy__name="soft")``; a list: any of them.

        Raises:
            InputError: no cell has these values.
        """
        wanted = {
            name.replace("__", "."): value if isinstance(value, list) else [value]
            for name, value in values.items()
        }
        cells = [
            cell
            for cell in self.cells
            if all(plain_of(cell.point.get(name)) in choices for name, choices in wanted.items())
        ]
        if not cells:
            raise InputError(f"no cell has {wanted}; varied are {', '.join(self.varied)}", field="where")
        return self.select(cells)

    def select(self, cells: Iterable[Cell]) -> Runs:
        """Return the runs of some of the cells."""
        return replace(self, cells=tuple(cells), whole=self.whole or self)

    def again(self, cell: Cell, runs: int | Iterable[int] = 1, **how: Any) -> Result:
        """Simulate runs of a cell again from the seed, with all their samples, which are not saved.

        Args:
            runs: how many, from run 0, or the numbers of the runs. how: such as ``poses=True``, see ``simulate``.
        """
        return simulate(cell.scenario, self.seed, runs, motion=self.motion, **how)

    def to_pandas(self, table: str = "frame") -> pd.DataFrame:
        """Convert ``frame`` or ``robots`` to pandas, which must be installed."""
        needed("pandas", "frames", "to_pandas")
        frame: pl.DataFrame = getattr(self, table)
        return frame.to_pandas()

    def to_xarray(self, table: str = "frame") -> xr.Dataset:
        """Convert ``frame`` or ``robots`` to an xarray Dataset, whose dimensions are the varied fields and ``run``.

        Cells that do not set all varied fields, or of which some are equal, have the dimension ``cell`` instead.
        """
        needed("xarray", "frames", "to_xarray")
        frame = self.to_pandas(table)
        further = ["run", "robot"] if table == "robots" else ["run"]
        keys = frame[[*self.varied, *further]]
        is_grid = bool(self.varied) and not (keys.duplicated().any() or keys.isna().to_numpy().any())
        texts = frame.astype(dict.fromkeys(frame.select_dtypes("category"), str))
        index = [*(self.varied if is_grid else ["cell"]), *further]
        return texts.set_index(index).to_xarray()  # type: ignore[no-any-return]  # xarray adds this method to pandas

    @cached_property
    def cell_table(self) -> pl.DataFrame:
        """A row for each cell: number, varied fields, name, hash of the scenario, runs wanted and there."""
        rows = [
            (cell.number, cell.name, cell.scenario.hash, self.runs_of(cell), self.there[cell.number])
            for cell in self.cells
        ]
        schema = {
            "cell": pl.UInt32, "name": pl.String, "scenario_hash": pl.String, "wanted": pl.UInt32, "there": pl.UInt32
        }  # fmt: skip
        frame = pl.DataFrame(rows, schema=schema, orient="row")
        return frame.select("cell", *self._varied_columns, *frame.columns[1:])

    @property
    def _varied_columns(self) -> list[pl.Series]:
        return [
            _column(name, [plain_of(cell.point.get(name)) for cell in self.cells]) for name in self.varied
        ]

    def _with_cells(self, rows: pl.DataFrame) -> pl.DataFrame:
        cells = pl.DataFrame(
            [
                pl.Series("cell", [cell.number for cell in self.cells], pl.UInt32),
                *self._varied_columns,
                pl.Series("name", [cell.name for cell in self.cells], pl.String),
            ]
        )
        return cells.join(rows, on="cell", suffix="_reported", maintain_order="right")


def groups_of(cells: Sequence[Cell]) -> list[list[Cell]]:
    """Return the cells that share motion, group by group."""
    groups: dict[str, list[Cell]] = {}
    for cell in cells:
        groups.setdefault(motion_key(cell.scenario), []).append(cell)
    return list(groups.values())


def plain_of(value: Any) -> Any:
    """Return the name of code, ``voter`` of ``voter.py:voter sha256:...``, and any other value as it is."""
    return plugins.name_in(value) if plugins.is_code(value) else value


def _column(name: str, values: list[Any]) -> pl.Series:
    """Return values as a column; mixed kinds, lists and tables are text."""
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float} or (len(kinds) == 1 and not kinds & {list, tuple, dict}):
        return pl.Series(name, values, strict=False) if kinds else pl.Series(name, values, pl.String)
    texts = [value if value is None or isinstance(value, str) else json.dumps(value) for value in values]
    return pl.Series(name, texts)
