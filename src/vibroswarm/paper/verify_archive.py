"""Verify an archive of a reproduction: compute a sample of its cells again, and check the rest for consistency.

With the same versions of all software, cells must be equal bit by bit. With other versions, floating-point results may
differ slightly, so cells must be equal event by event: the same decisions and counts of each robot, and all other
numbers close.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.intervals import generator
from vibroswarm.core.atomic_io import tag
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.rng import SEED_LIMIT
from vibroswarm.core.tables import Schema, check_table, unescaped
from vibroswarm.errors import InputError
from vibroswarm.inference.outcomes import ROBOTS
from vibroswarm.paper.archive import FIGURES, FORMAT, HEAD, Zipped
from vibroswarm.paper.cells import FIRST_RUNS, Cell, CellResults, run_cells
from vibroswarm.paper.claims import MEASURED, UNKNOWN, decide
from vibroswarm.paper.columns import COLUMNS
from vibroswarm.paper.reproduction_report import claims_table
from vibroswarm.result import NULLABLE
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import versions
from vibroswarm.study.plan import plan_of
from vibroswarm.study.spec import Study

SAMPLE: Final = 8
"""Cells that are computed again by default."""
LARGEST: Final = {"robots": 100, "t_end_s": 10_000.0, "runs": 100_000}
"""Limits for archives of unknown origin, so that checking an archive ends in reasonable time."""
_WHOLE: Final = ("decision", "samples", "sent", "messages_received", "alpha", "beta")
"""Columns of whole numbers, which must be equal with any versions."""
_NEAR: Final = 1e-6
"""Largest difference of other numbers with other versions: relative for figures of cells above 1, otherwise absolute.
Decision times of robots may differ by half a tick."""
CELLS: Final = Schema(
    {
        **dict.fromkeys(("key", "column", "scenario"), pl.String), "block": pl.Int64, "seed": pl.Int64,
        "motion": pl.String, "runs": pl.Int64, "digest": pl.String, **dict.fromkeys(FIGURES, pl.Float64),
        "command": pl.String,
    },
    frozenset(FIGURES),
    ("key",),
)  # fmt: skip
"""Columns and types of ``cells.csv``."""
ROBOT_ROWS: Final = Schema(
    {"key": pl.String, **ROBOTS},
    NULLABLE["robots"] - {"decision", "alpha", "beta", "messages_received"},
    ("key", "run", "robot"),
)
"""Columns and types of ``robots.csv``."""


@dataclass(frozen=True)
class Verification(NotebookView):
    """Result of a check."""

    how: str
    """"bit by bit" or "event by event"."""
    why: str
    """Which versions differ; empty if none."""
    checked: tuple[str, ...]
    """Commands of the cells that were computed again."""
    wrong: tuple[str, ...]
    """Differences, in words."""


def verify(
    path: Path,
    count: int = SAMPLE,
    workers: int | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Verification:
    """Check an archive, and return what is wrong with it.

    Args:
        path: the archive. count: number of cells to compute again (all if there are fewer). They are chosen at random,
            seeded by the hashes of the archive's contents, so that the same archive gives the same cells.
        workers: number of threads; None: one for each processor.
        progress: called with the share of the computation that is done, 0 to 1.
    Raises:
        InputError: the file is not an archive, is damaged, or would take too long to check.
    """
    with Zipped(path) as archive:
        head = _head(archive)
        wrong = _hashes(archive, head)
        # An archive of items without cells has neither scenarios nor tables of cells.
        has_cells = any(name.startswith("scenarios/") for name in (*archive.names, *head["sha256"]))
        cells = _frame(archive, "cells.csv", CELLS) if has_cells else pl.DataFrame(schema=CELLS.columns)
        wrong += _tables(archive, cells)
        wrong += _verdicts(archive)
        chosen = _chosen(cells, count, json.dumps(head["sha256"], sort_keys=True))
        archived_cells = {str(row["key"]): _cell(archive, row, head) for row in chosen}
        robots = (
            _frame(archive, "robots.csv", ROBOT_ROWS)
            if has_cells
            else pl.DataFrame(schema=ROBOT_ROWS.columns)
        )
        check_work(archived_cells.values(), int(head["settings"]["runs"]), str(path))
    differing = _differing(head["versions"])
    runs, seed = int(head["settings"]["runs"]), int(head["settings"]["seed"])
    with TemporaryDirectory(prefix=f"vibroswarm-{tag()}.") as folder:
        results = run_cells(archived_cells.values(), runs, seed, Path(folder), workers, progress)
    for row in chosen:
        archived_robots = robots.filter(pl.col("key") == row["key"]).drop("key")
        wrong += _against(row, archived_robots, archived_cells[row["key"]], results, exact=not differing)
    return Verification(
        how="event by event" if differing else "bit by bit",
        why=", ".join(differing),
        checked=tuple(cell.command(runs, seed) for cell in archived_cells.values()),
        wrong=tuple(wrong),
    )


def _head(archive: Zipped) -> dict[str, Any]:
    """Read and check the head of an archive.

    Raises:
        InputError: it is malformed, or of another format.
    """
    try:
        head: dict[str, Any] = json.loads(archive.read(HEAD))
        right = _is_head(head)
    # RecursionError: the JSON text is nested too deeply.
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        right = False
    if not right:
        raise InputError(
            f"is not an archive of a reproduction: '{HEAD}' is malformed", field=str(archive.path)
        )
    if head["format"] < FORMAT:
        raise InputError(
            f"is of format {head['format']}, which had other claims; make the archive again with this version",
            field=str(archive.path),
        )
    if head["format"] > FORMAT:
        raise InputError(f"is of format {head['format']}; update vibroswarm", field=str(archive.path))
    return head


def _is_head(head: dict[str, Any]) -> bool:
    """Return whether the settings, format, versions and hashes of an archive's head have the right types and ranges.

    Raises:
        KeyError, TypeError, AttributeError: one of them is missing, or the head has another structure.
    """
    runs, seed = head["settings"]["runs"], head["settings"]["seed"]
    return (
        all(
            isinstance(number, int) and not isinstance(number, bool)  # true in JSON would count as 1
            for number in (runs, seed, head["format"])
        )
        and 1 <= runs <= LARGEST["runs"]
        and 0 <= seed < SEED_LIMIT
        and all(isinstance(value, str) for name in ("versions", "sha256") for value in head[name].values())
    )


def _hashes(archive: Zipped, head: dict[str, Any]) -> list[str]:
    """Return, in words, the entries that are missing or do not match their hash in the archive's head.

    The list is empty if there are none.
    """
    wrong = []
    stated = head["sha256"]
    for name in sorted({*archive.names, *stated} - {HEAD}):
        if name not in archive.names:
            wrong.append(f"{name} is missing")
        elif hashlib.sha256(archive.read(name)).hexdigest() != stated.get(name):
            wrong.append(f"{name} differs from the file that was archived")
    return wrong


def _frame(
    archive: Zipped, name: str, schema: Schema | None = None, kinds: Mapping[str, Any] | None = None
) -> pl.DataFrame:
    """Read a CSV table of the archive.

    Args:
        name: name of the entry. schema: columns and types that the table must have; None: they are not checked.
        kinds: types of some columns, if ``schema`` is None; the other types are inferred.
    Raises:
        InputError: the entry is missing or damaged, is not a table, or does not have this schema.
    """
    kinds = (kinds or {}) if schema is None else schema.columns
    try:
        data = io.BytesIO(archive.read(name))
        frame = unescaped(pl.read_csv(data, schema_overrides=dict(kinds), infer_schema_length=None))
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, ValueError) as error:
        # The first line of the message, shortened, because messages of polars may be long; the type if it is empty.
        words = (str(error).splitlines() or [type(error).__name__])[0][:120]
        raise InputError(f"'{name}' is not a table ({words})", field=str(archive.path)) from None
    return frame if schema is None else check_table(frame, schema, f"{archive.path}: {name}", name)


def _tables(archive: Zipped, cells: pl.DataFrame) -> list[str]:
    """Check that rows of cells in the items' tables agree with ``cells.csv``; return the errors in words.

    A row agrees if a row of ``cells.csv`` has the same scenario, decision time and belief in the truth. Tables without
    these columns are not checked.

    Args:
        cells: the table ``cells.csv``.
    """
    compared = ["scenario", *FIGURES[:2]]  # scenario, decision time, belief in the truth
    known = {tuple(row) for row in cells.select(compared).rows()}
    wrong = []
    for name in archive.names:
        if not name.startswith("tables/"):
            continue
        table = _frame(archive, name, kinds={"scenario": pl.String})
        if set(compared) <= set(table.columns):
            unknown = [row for row in table.select(compared).rows() if tuple(row) not in known]
            wrong += [f"{name} has {len(unknown)} rows that match no cell"] if unknown else []
    return wrong


def _verdicts(archive: Zipped) -> list[str]:
    """Check that the verdicts in ``claims.csv`` follow from ``measured.csv``; return the errors in words.

    The other columns of ``claims.csv``, with the words of the claims and the measured values in words, are not
    compared. An archive without measured values has no verdicts to check.
    """
    if "measured.csv" not in archive.names:
        return []
    measured = _frame(archive, "measured.csv", Schema(MEASURED, nullable=UNKNOWN))
    # An empty table of claims has the columns that ``claims.csv`` must have; all of them may be null.
    texts = Schema(claims_table([]).schema)
    claims_schema = Schema(texts.columns, nullable=frozenset(texts.columns), key=("claim",))
    archived = _frame(archive, "claims.csv", claims_schema)
    try:
        recomputed = claims_table(decide(measured.select(list(MEASURED))))
    except InputError as error:
        return [f"measured.csv: {error}"]
    columns = ["claim", *COLUMNS]
    same = recomputed.select(columns).sort("claim").equals(archived.select(columns).sort("claim"))
    return [] if same else ["claims.csv: the verdicts do not follow from measured.csv"]


def _chosen(cells: pl.DataFrame, count: int, text: str) -> list[dict[str, Any]]:
    """Choose ``count`` rows of the table of cells at random, seeded by a text; return them in the table's order.

    All rows are chosen if there are no more than ``count``.
    """
    seed = int(hashlib.sha256(text.encode()).hexdigest()[:12], 16)  # 48 bits of the text's hash
    order = generator(seed, "archive").permutation(cells.height)[:count]
    return [cells.row(int(place), named=True) for place in sorted(order)]


def _cell(archive: Zipped, row: dict[str, Any], head: dict[str, Any]) -> Cell:
    """Rebuild an archived cell from its row in ``cells.csv`` and its scenario file.

    Args:
        head: head of the archive, with the number of runs of a cell that has no number of its own.
    Raises:
        InputError: the scenario is invalid or too large, does not have the hash of its file name, or the cell has no
            runs.
    """
    name = f"scenarios/{row['scenario']}.toml"
    # Bytes that are not UTF-8 are replaced, so that they give an invalid scenario or another hash, not a UnicodeError.
    scenario = Scenario.from_toml(archive.read(name).decode("utf-8", "replace"), name=name)
    sizes = {"robots": scenario.swarm.robots, "t_end_s": scenario.run.t_end_s, "runs": int(row["runs"])}
    if sizes["runs"] < 1:
        raise InputError(f"{sizes['runs']} is wrong; a cell has at least 1 run", field=f"{name} (runs)")
    for size_name, value in sizes.items():
        if value > LARGEST[size_name]:
            raise InputError(f"{value} is too large to be recomputed here", field=f"{name} ({size_name})")
    default_runs = int(head["settings"]["runs"])
    column = row["column"] if row["column"] in COLUMNS else COLUMNS[0]  # only for the command that is shown
    runs = None if int(row["runs"]) == default_runs else int(row["runs"])
    cell = Cell(column, scenario, block=int(row["block"]), motion=str(row["motion"]), runs=runs)
    if cell.scenario.hash != row["scenario"]:
        raise InputError("does not match the scenario of that name", field=name)
    return cell


MOST_S: Final = 7200.0
"""Most core seconds that a check may take."""
MOST_SAMPLES: Final = 5_000_000
"""Most samples of one run."""


def check_work(cells: Iterable[Cell], runs: int, name: str) -> None:
    """Refuse an archive whose cells would take too long to compute.

    Args:
        cells: cells to compute. runs: runs of the reproduction, of which a cell may have fewer (``Cell.runs``).
        name: name of the file, for errors.
    Raises:
        InputError: a run would have too many samples, or all runs together would take too long.
    """
    seconds = 0.0
    for cell in cells:
        scenario = cell.scenario
        # Time between two samples of a robot, without the time spent avoiding, and at least one tick. The time is
        # rather too short, so the number of samples below is rather too large.
        spacing_s = max(
            (scenario.sample.sample_interval_ms + scenario.sample.stop_ms) / 1000.0, scenario.tick_s
        )
        samples = scenario.run.t_end_s / spacing_s * scenario.swarm.robots
        if samples > MOST_SAMPLES:
            raise InputError(
                f"cell {cell.key} has about {samples:.0e} samples a run; at most {MOST_SAMPLES} are allowed",
                field=name,
            )
        seconds += min(cell.runs or runs, runs) * run_s(scenario, cell.motion, samples)
    if seconds > MOST_S:
        raise InputError(
            f"recomputing its cells would take about {in_time(seconds)} of one core; at most "
            f"{in_time(MOST_S)} is allowed: check fewer with --check N",
            field=name,
        )


def run_s(scenario: Scenario, motion: str, samples: float) -> float:
    """Estimate the time of a run on one core, s; rather too long than too short.

    The factors are measured times, s: 1e-7 for a robot in a tick of an engine with fixed steps, 2e-8 for a tile that is
    drawn, 1e-6 for a sample. The factor 1 + robots / 10 makes the times of a robot grow with the size of its swarm.

    Args:
        motion: name of the engine. samples: expected number of samples of a run.
    """
    robots, tiles = scenario.swarm.robots, scenario.floor.rows * scenario.floor.columns
    # A study of this scenario alone has one group, whose plan estimates the time of a run with the event engine.
    motion_s = plan_of(Study.of(scenario, 1)).groups[0].run_s
    if motion != "event":
        motion_s += scenario.ticks * robots * (1 + robots / 10) * 1e-7
    floor_s = tiles * 2e-8 if scenario.floor.drawn_by_run else 0.0
    return motion_s + floor_s + samples * (1 + robots / 10) * 1e-6


def in_time(seconds: float) -> str:
    """Format a duration in hours, or in days from two days on: "2 hours", "24 days"."""
    days = seconds / 86400
    return f"{days:,.0f} days" if days >= 2 else f"{seconds / 3600:.2g} hours"


def _differing(theirs: dict[str, str]) -> list[str]:
    """Return, in words, the versions here that differ from those of the archive.

    Args:
        theirs: versions of the archive, by name.
    """
    own_versions = versions()
    return [
        f"{name} {theirs.get(name)} there, {value} here"
        for name, value in own_versions.items()
        if theirs.get(name) != value
    ]


def _against(
    row: dict[str, Any], robots: pl.DataFrame, cell: Cell, results: CellResults, *, exact: bool
) -> list[str]:
    """Return, in words, what differs between an archived cell and the same cell computed here; empty if nothing does.

    Args:
        row: the archived row of the cell. robots: the archived table of robots of its first runs.
        cell, results: the cell, and the results of all cells computed here.
        exact: whether values must be equal bit by bit, not only event by event.
    """
    result, words = results[cell], f"cell {row['key']}"
    figures = [name for name in FIGURES if not _same(row[name], result.row[name], exact)]
    wrong = [f"{words}: {', '.join(figures)} differ"] if figures else []
    if exact and row["digest"] != result.digest:
        wrong.append(f"{words}: its robots differ")
    # Decisions fall on ticks, so times less than half a tick apart belong to the same tick.
    runs = _runs_that_differ(robots, result.first, time_error_s=cell.scenario.tick_s / 2, exact=exact)
    if runs is None:
        wrong.append(f"{words}: the robots of its first {FIRST_RUNS} runs are missing")
    elif runs:
        wrong.append(f"{words}: runs {', '.join(map(str, runs))} differ")
    return wrong


def _same(there: Any, here: Any, exact: bool) -> bool:
    """Return whether two figures are equal, or at least close if ``exact`` is False; None equals only None."""
    if there is None or here is None:
        return there is here
    return bool(there == here) if exact else bool(abs(there - here) <= _NEAR * max(1.0, abs(here)))


def _runs_that_differ(
    there: pl.DataFrame, here: pl.DataFrame, *, time_error_s: float, exact: bool
) -> list[int] | None:
    """Return the numbers of the runs in which a robot's row differs; None if the tables have different runs or robots.

    Args:
        there, here: the archived table of robots, and the table computed here.
        time_error_s: largest difference of decision times, if ``exact`` is False.
        exact: whether all values must be equal; if not, whole numbers must be equal and other numbers close.
    """
    if not there.select("run", "robot").equals(here.select("run", "robot")):
        return None
    differs = np.zeros(here.height, dtype=np.bool_)
    for name in here.columns:
        archived_values, own_values = there[name].cast(pl.Float64), here[name].cast(pl.Float64)
        a, b = (column.fill_null(np.nan).to_numpy() for column in (archived_values, own_values))
        if exact or name in _WHOLE:
            tolerance = 0.0
        elif name == "decision_time_s":
            tolerance = time_error_s
        else:  # the beliefs, which are at most 1, so that an absolute tolerance suits all
            tolerance = _NEAR
        differs |= ~np.isclose(a, b, rtol=0.0, atol=tolerance, equal_nan=True)
    return sorted({int(run) for run in here["run"].to_numpy()[differs]})
