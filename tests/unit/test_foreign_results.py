"""Results and recordings that somebody else made or damaged: refused in one sentence that names file and column."""

from __future__ import annotations

import json
import math
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from helpers.manifests import resealed
from helpers.scenario_fields import named
from vibroswarm import inspect, replay, verdict
from vibroswarm.core.folders import FORMAT
from vibroswarm.core.tables import ALLOWED, Schema, check_table
from vibroswarm.errors import InputError
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.export import write_rugbot
from vibroswarm.recordings.log_readers import read_log
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import SCHEMAS, TABLES, Result
from vibroswarm.run_page.write import write_run_page
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate

Change = Callable[[pl.DataFrame], pl.DataFrame]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a result of two runs, and a recording of its first."""
    folder = tmp_path_factory.mktemp("made")
    scenario = preset("paper-empirical").with_values({
        "floor.tiles": ("01", "10"), "floor.source": "ours", "strategy.name": "positive", "swarm.robots": 3,
        "decision.min_observations": 10, "decision.gate": "own", "run.t_end_s": 100.0,
        "faults.stuck_at_0": [1], "localisation.method": "mixture", "change.at_s": 50, "change.to": "invert",
    })  # fmt: skip
    result = simulate(scenario, 7, 2, segments=True, moves=True)
    failed = pl.DataFrame([(0, 40.0, "a warning")], schema=TABLES["failures"], orient="row")
    reported = pl.DataFrame([(0, 0, 0, "trust", 0, 0.5)], schema=TABLES["reports"], orient="row")
    result = replace(result, failures=failed, reports=reported)
    result.write(folder / "result")
    write_rugbot(result, folder / "log.csv")
    log = read_log(folder / "log.csv")
    recording_of([log], scenario.floor_for(0, 0), scenario, any_floor=True).write(folder / "recording")
    return folder


@pytest.fixture
def there(made: Path, tmp_path: Path) -> Path:
    """A copy of both, to be damaged."""
    for name in ("result", "recording"):
        shutil.copytree(made / name, tmp_path / name)
    return tmp_path


def test_a_result_altered_in_memory_has_no_page(made: Path, tmp_path: Path) -> None:
    result = Result.read(made / "result")
    write_run_page(result, tmp_path / "run.html")
    altered = replace(result, robots=result.robots.drop("decision"))
    with pytest.raises(InputError, match=r"^result\.robots: .* 'decision' is missing$"):
        write_run_page(altered, tmp_path / "run.html")


@pytest.mark.parametrize("use", [verdict, inspect, lambda result: replay(result, result.scenario)])
def test_a_result_altered_in_memory_is_refused_where_it_does_not_serve(
    made: Path, use: Callable[[Result], object]
) -> None:
    result = Result.read(made / "result")
    use(result)
    with pytest.raises(InputError, match=r"^result\.observations: None is not a polars data frame$"):
        use(replace(result, observations=None))  # type: ignore[arg-type]


def test_a_path_is_refused_by_the_name_of_the_argument(made: Path) -> None:
    result = Result.read(made / "result")
    for write in (result.write, lambda path: write_run_page(result, path)):
        with pytest.raises(InputError, match=r"^path: "):
            write(made / "log.csv" / "it")  # in a file


def changed(path: Path, change: Change) -> None:
    change(pl.read_parquet(path)).write_parquet(path)


def refused(read: Callable[[Path], Any], folder: Path, path: Path, *said: str) -> None:
    with pytest.raises(InputError) as caught:
        read(folder)
    assert caught.value.field == str(path)
    assert all(word in str(caught.value) for word in said), str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("name", ["scenario.toml", "observations.parquet", "rows.parquet"])
def test_values_that_could_have_been_written_are_refused_if_they_were_not(there: Path, name: str) -> None:
    path = there / "recording" / name
    if path.suffix == ".toml":
        path.write_text("# a comment\n" + path.read_text())
    else:
        changed(path, lambda f: f.with_columns(energy=pl.col("energy") * 2))
    refused(Recording.read, there / "recording", path)


def test_a_folder_of_the_version_before_hashes_is_read(there: Path) -> None:
    path = there / "recording" / "vibroswarm.json"
    about = json.loads(path.read_text())
    path.write_text(json.dumps({key: about[key] for key in about if key not in ("files", "sha256")}))
    assert Recording.read(there / "recording") == Recording.read(there / "recording")


def test_what_was_not_touched_is_read(there: Path) -> None:
    """Control of all below."""
    assert Result.read(there / "result").runs.height == 2
    assert Recording.read(there / "recording").runs.height == 1


def put(column: str, value: Any, row: int = 0) -> Change:
    """A value in one row."""
    return lambda frame: frame.with_columns(
        pl.when(pl.int_range(pl.len()) == row)
        .then(pl.lit(value))
        .otherwise(column)
        .cast(frame.schema[column])
        .alias(column)
    )


def _outside(column: str, kind: Any) -> Any:
    """A value that the type can hold and the column may not; None where there is none."""
    low, high = ALLOWED.get(column, (None, None))
    for value in () if low in (None, -math.inf) else (max(high + 1, math.nextafter(high, math.inf)), low - 1):
        series = pl.Series([value], dtype=pl.Float64).cast(kind, strict=False)
        if series[0] is not None and float(series[0]) == value:
            return series[0]
    return None


def _ways(name: str, column: str) -> dict[str, Change]:
    kind = TABLES[name][column]
    other = pl.lit(1) if kind == pl.String else pl.col(column).cast(pl.String)
    ways: dict[str, Change] = {
        "missing": lambda frame: frame.drop(column),
        "renamed": lambda frame: frame.rename({column: "other"}),
        "retyped": lambda frame: frame.with_columns(other.alias(column)),
    }
    if kind != SCHEMAS[name].further:  # else it is refused with the scenario (tests/exact/test_numbers.py)
        ways["one too many"] = lambda frame: frame.with_columns(pl.col(column).alias(f"{column}'"))
    if column not in SCHEMAS[name].nullable:
        ways["null"] = put(column, None)
    if (value := _outside(column, kind)) is not None:
        ways["outside"] = put(column, value)
    if kind in (pl.Float32, pl.Float64):
        ways["nan"] = put(column, math.nan)
        if ALLOWED.get(column) != (-math.inf, math.inf):
            ways["infinite"] = put(column, -math.inf)
    return ways


@pytest.mark.parametrize("name", list(TABLES))
def test_each_column_of_each_table_is_checked(made: Path, name: str) -> None:
    frame = pl.read_parquet(made / "result" / f"{name}.parquet")
    assert check_table(frame, SCHEMAS[name], "file", name).equals(frame)
    count = 0
    for column in TABLES[name]:
        for way, change in _ways(name, column).items():
            with pytest.raises(InputError, match=f"^file: .*'{column}") as caught:
                check_table(change(frame), SCHEMAS[name], "file", name)
            assert caught.value.field == "file", (column, way)
            count += 1
    assert count >= 4 * len(TABLES[name])


def test_the_first_wrong_row_is_named() -> None:
    table, schema = pl.DataFrame({"ones": [0.5, 1.5, 0.5, 2.5]}), Schema({"ones": pl.Float64})
    with pytest.raises(InputError, match=r"'ones' holds 1\.5 in row 1; it has to be from 0 to 1"):
        check_table(table, schema, "file", "floors")


KEYS: list[tuple[str, str, Change]] = [
    ("motion", "twice", lambda f: pl.concat([f, f.head(1)])),
    ("motion", "order", lambda f: f.reverse()),
    ("motion", "'robot'", put("robot", 3)),
    ("motion", "'run'", lambda f: put("run", 9, row=f.height - 1)(f)),
    ("motion", "'time_s'", put("time_s", 500.0)),
    ("observations", "'sample'", lambda f: f.head(5)),
    ("observations", "'sample'", lambda f: f.reverse()),
    ("observations", "'tile'", put("tile", 4)),
    ("changes", "'tile'", lambda f: f.with_columns(tile=pl.col("tile") + 1)),
    ("changes", "'run'", lambda f: f.with_columns(run=(pl.col("run") + 1).cast(pl.UInt32))),
    ("changes", "'kind'", put("kind", 2)),
    ("changes", "'time_s'", put("time_s", 0.0)),
    ("changes", "order", lambda f: f.reverse()),
    ("inference", "'sample'", lambda f: f.clear()),
    ("inference", "'messages_received'", put("messages_received", None)),
    ("ends", "rows", lambda f: f.head(5)),
    ("ends", "twice", lambda f: pl.concat([f, f])),
    ("ends", "'end_s'", put("end_s", 1e6)),
    ("robots", "'robot'", put("robot", 7)),
    ("robots", "'samples'", put("samples", 0)),
    ("robots", "'decision_time_s'", lambda f: f.with_columns(decision_time_s=pl.lit(None, pl.Float64))),
    ("runs", "holds no run", lambda f: f.clear()),
    ("runs", "'run'", lambda f: f.reverse()),
    ("runs", "'right'", put("right", 60_000)),
    ("floors", "'tiles'", put("tiles", "010")),
    ("floors", "'tiles'", put("tiles", "01x0")),
    ("floors", "'rows'", put("rows", 100_000_000)),
    ("floors", "'run'", put("run", 5)),
    ("segments", "'start_s'", lambda f: f.filter(pl.col("robot") != 1)),
    ("segments", "'robot'", put("robot", 65_535)),
    ("moves", "'robot'", put("robot", 3)),
    ("moves", "'run'", lambda f: f.with_columns(run=pl.lit(9, pl.UInt32))),
    ("moves", "'start_s'", lambda f: f.filter(pl.col("robot") != 1)),
    ("moves", "'start_s'", lambda f: f.reverse()),
    ("moves", "after the end", lambda f: f.with_columns(pl.col("start_s") * 6)),
]  # fmt: skip


OF_A_RECORDING: list[tuple[str, str, Change]] = [
    ("rows", "'energy'", lambda f: f.drop("energy")),
    ("rows", "'sample'", lambda f: f.reverse()),
    ("rows", "'line'", put("line", None)),
    ("tracks", "'robot'", put("robot", 12)),
    ("tracks", "'time_s'", lambda f: f.reverse()),
    ("tracks", "'x_m'", put("x_m", float("inf"))),
]
"""Tables that only a recording has."""


@pytest.mark.parametrize(
    ("kind", "name", "said", "change"),
    [*((Result, *keys) for keys in KEYS), *((Recording, *keys) for keys in OF_A_RECORDING)],
)
def test_tables_fit_each_other_and_the_scenario(
    there: Path, kind: Any, name: str, said: str, change: Change
) -> None:
    folder = there / kind.__name__.lower()
    path = folder / f"{name}.parquet"
    changed(path, change)
    refused(kind.read, folder, path, said)


def test_a_robot_whose_decision_is_not_known_has_no_decision_time(there: Path) -> None:
    path = there / "recording" / "robots.parquet"
    without_time = put("decision_time_s", None)
    changed(path, lambda f: without_time(put("decision", None)(f)))
    resealed(there / "recording" / "vibroswarm.json")
    Recording.read(there / "recording")
    changed(path, put("decision_time_s", 50.0))
    refused(Recording.read, there / "recording", path, "'decision_time_s'")


ODD: list[Any] = [None, "x", -1, 1.5, [], {}, [1], {"a": None}, [[]], True, ["motion"], "study"]


@pytest.mark.parametrize("key", ["names", "sessions", "stated", "inferred", "floor"])
def test_the_head_of_a_recording_is_checked(there: Path, key: str) -> None:
    path = there / "recording" / "vibroswarm.json"
    about = json.loads(path.read_text())
    gone = {name: value for name, value in about.items() if name != key}
    for changed in (gone, *(about | {key: value} for value in ODD)):
        path.write_text(json.dumps(changed))
        with named(key, changed.get(key, "gone")):
            refused(Recording.read, there / "recording", path, "damaged")


@pytest.mark.parametrize("key", ["format", "kind", "seed", "source", "tables", "versions", "scenario_hash"])
def test_the_head_of_a_result_is_checked(there: Path, key: str) -> None:
    path = there / "result" / "vibroswarm.json"
    about = json.loads(path.read_text())
    for value in ODD:
        path.write_text(json.dumps(about | {key: value}))
        with named(key, value), pytest.raises(InputError) as caught:
            Result.read(there / "result")
        assert str(caught.value.field).startswith(str(there / "result"))


@pytest.mark.parametrize(
    ("kind", "key", "value"),
    [
        (Recording, "floor", "x"),
        (Recording, "stated", []),
        (Recording, "inferred", []),
        (Result, "versions", {}),
        (Result, "source", "x"),
    ],
)
def test_what_a_head_may_say_is_refused_if_it_was_not_written(
    there: Path, kind: Any, key: str, value: Any
) -> None:
    folder = there / kind.__name__.lower()
    path = folder / "vibroswarm.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: value}))
    refused(kind.read, folder, path, "not what was written")
    resealed(path)
    kind.read(folder)


@pytest.mark.parametrize("text", ["[" * 100_000, "9" * 5000, "NaN", '{"a": Infinity}', "\x00", "\xff\xfe", '"x"',
                                  "", "{", "[]", "null", "{}", f'{{"format": {FORMAT}}}'])  # fmt: skip
def test_json_that_no_reader_survives_is_refused(there: Path, text: str) -> None:
    path = there / "result" / "vibroswarm.json"
    path.write_text(text, encoding="latin-1")
    refused(Result.read, there / "result", path, "UTF-8" if text == "\xff\xfe" else "damaged")


@pytest.mark.parametrize("name", ["vibroswarm.json", "scenario.toml", "runs.parquet"])
@pytest.mark.parametrize("kind", ["folder", "pipe", "loop", "device", "nowhere"])
def test_only_plain_files_are_opened(there: Path, name: str, kind: str) -> None:
    path = there / "result" / name
    path.unlink()
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)  # opening it would wait for ever
    else:
        path.symlink_to({"loop": path.name, "device": "/dev/zero", "nowhere": "nothing"}[kind])
    with pytest.raises(InputError):
        Result.read(there / "result")


def test_a_table_that_ends_like_a_parquet_file_but_is_none_is_refused(there: Path) -> None:
    """Readers of polars may panic, which is no Exception of Python."""
    path = there / "result" / "runs.parquet"
    whole = path.read_bytes()
    outcomes = set()
    for place in range(len(whole) - 400, len(whole), 7):
        broken = bytearray(whole)
        broken[place] ^= 0xFF
        path.write_bytes(bytes(broken))
        try:
            Result.read(there / "result")
        except InputError as error:
            outcomes.add(error.field)
    assert outcomes == {str(path)}
