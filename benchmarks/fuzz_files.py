"""Damaged and foreign files given to every command that reads them: the long check.

    python benchmarks/fuzz_files.py [--inputs 2000] [--seed 1] [--only study,league] [--list]

Valid folders and files are made by the commands themselves. Then one of them is copied, damaged in one or two ways
(bytes, whole files, columns and values of tables, keys of JSON and TOML, cells of CSV; hashes are made to fit half of
the time, as in a file that somebody else made), and read by a command in this process. Counted are inputs that were

    accepted   exit code 0
    refused    exit code 1 or 2 and one message, or an InputError or RunError in Python
    raw        any other exception, a dead process, or no answer in a minute: each is a bug

Raw ones are listed by the line of our code that they came through, with the inputs that led there. An input is repeated
with ``--input NUMBER``. Exit code 1 where there was a raw one.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import json
import math
import multiprocessing
import os
import random
import resource
import shutil
import sys
import tempfile
import tomllib
import traceback
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import tomli_w

from vibroswarm.analysis.verdict import verdict
from vibroswarm.cli import main
from vibroswarm.errors import InputError, RunError
from vibroswarm.result import Result
from vibroswarm.run_page.write import record_of
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import replay, simulate

ANSWER_S = 60.0
MEMORY = 6 * 2**30
TILES = ("01010", "10010", "10101", "01101", "10010")
STUDY = """
runs = 4
keep = ["samples"]
[scenario]
preset = "paper"
[scenario.run]
t_end_s = 60.0
[scenario.swarm]
robots = 2
[scenario.decision]
min_observations = 5
[grid]
"floor.source" = ["random:0.44", "diagonal:0.46"]
"strategy.name" = ["none", "soft"]
"""
SEARCH = """
seed = 3
start = [{ "sample.sample_interval_ms" = 2000, "decision.min_observations" = 10 }]
[scenario]
preset = "paper"
[scenario.run]
t_end_s = 60.0
[scenario.swarm]
robots = 2
[space]
"sample.sample_interval_ms" = { from = 1000, to = 6000 }
"decision.min_observations" = { from = 0, to = 60 }
[search]
budget = 24
evaluations = 3
final = 6
fresh = 4
[pso]
particles = 3
evaluations = 2
extra = 1
"""
GRID = """
runs = 3
[scenario]
preset = "paper"
[scenario.run]
t_end_s = 60.0
[scenario.swarm]
robots = 2
[scenario.strategy]
name = "soft"
[space]
"strategy.soft.eta" = [750.0, 1000.0]
"strategy.soft.kappa" = [1.0, 2.0]
"""
COLUMNS = """
[columns]
robot = "ROV Number"
time_s = "Timestamp"
x_m = "X Meter"
y_m = "Y Meter"
energy = "Energy"
alpha = "Alpha"
beta = "Beta"
sent = { name = "Swarm Send", wraps_at = 65536 }
"""


def made(base: Path) -> None:
    """All that is damaged later, in ``base``."""
    told = preset("paper-empirical").with_values({
        "floor.tiles": TILES, "floor.source": "ours", "strategy.name": "positive", "decision.min_observations": 10,
        "decision.gate": "own", "run.t_end_s": 100.0, "swarm.robots": 3,
    })  # fmt: skip
    result = simulate(told, 7, 2, segments=True)
    result.write(base / "result")
    floor = base / "floor.txt"
    floor.write_text("\n".join(TILES) + "\n")
    for name, text in (
        ("study.toml", STUDY), ("search.toml", SEARCH), ("grid.toml", GRID), ("columns.toml", COLUMNS),
        ("scenario.toml", told.to_toml()),
        ("energies.csv", "kind,energy\n" + "vibrating,2.5\nstill,0.6\n" * 20),
    ):  # fmt: skip
        (base / name).write_text(text)
    for run in (1, 2):
        asked(["lab", "export", base / "result", "--session", str(run), "--out", base / f"log-{run}.csv"])
    asked(["lab", "export", base / "result", "--format", "webots", "--out", base / "console.txt"])
    logs = [base / "log-1.csv", base / "log-2.csv"]
    asked(["lab", "import", *logs, "--floor", floor, "--any-floor", "--out", base / "recording"])
    asked([*_evaluate(base), "--out", base / "study"])
    for share in ("1/2", "2/2"):
        asked([*_evaluate(base), "--out", base / f"share-{share[0]}", "--shard", share])
    for method in ("pso", "random"):
        asked([*_search(base, method), "--out", base / f"search-{method}"])
    asked(["optimize", base / "grid.toml", "--method", "grid", "--fresh", "3", "--no-pictures",
           "--out", base / "grid"])  # fmt: skip
    asked(_reproduce(base / "paper"))
    for name in OTHERS:
        asked([*OTHERS[name], "--out", base / name])


def asked(line: Sequence[str | Path]) -> None:
    """A command that must succeed."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()) as told:
        code = main([str(word) for word in line])
    if code:
        raise SystemExit(f"{line}: {told.getvalue()}")


def _evaluate(base: Path) -> list[str | Path]:
    return ["evaluate", base / "study.toml", "--no-pictures", "--no-confirm"]


def _search(base: Path, method: str) -> list[str | Path]:
    return ["optimize", base / "search.toml", "--method", method, "--no-pictures"]


def _reproduce(out: Path) -> list[str | Path]:
    asked = ["--only", "fill-ratios", "--columns", "paper", "--runs", "2", "--no-pictures"]
    return ["reproduce", *asked, "--out", out]


SHORT = ["--set", "run.t_end_s=60"]
OTHERS: dict[str, list[str]] = {
    "league": ["league", "--runs", "2", "--strategy", "none,soft", "--robots", "2", "--belief-runs", "2",
               "--fault-runs", "2", "--untuned", "--patterns", "diagonal", "--fills", "0.46", *SHORT],
    "detect": ["detect", "--robots", "2", "--runs", "4", "--fills", "0.4,0.6", "--no-pictures", *SHORT],
    "tradeoff": ["evaluate", "tradeoff", "--runs", "4", "--no-pictures", *SHORT],
    "inspect": ["inspect", "--floor", "diagonal:0.46", "--no-pictures", "--seed", "2", *SHORT],
}  # fmt: skip
"""Further folders: what made them, and makes them again."""


def _again(name: str) -> list[tuple[str, Line]]:
    return [("show", lambda base, it: ["show", it]), (name, lambda base, it: [*OTHERS[name], "--out", it])]


def _verified(base: Path, it: Path) -> list[str | Path]:
    return ["verify", it, "--runs", "2"]


Line = Callable[[Path, Path], "list[str | Path]"]
"""The command line that reads what is damaged (second) with the valid things beside it (first)."""

READERS: dict[str, list[tuple[str, Line | Callable[[Path], None]]]] = {
    "result": [
        ("show", lambda base, it: ["show", it]),
        ("verify", _verified),
        ("read in Python", lambda there: in_python(there)),
        ("lab export csv", lambda base, it: ["lab", "export", it, "--format", "csv", "--out", it / "out"]),
        ("lab export rugbot", lambda base, it: ["lab", "export", it, "--out", it / "out.csv"]),
        ("lab export webots", lambda base, it: ["lab", "export", it, "--format", "webots", "--out", it / "o"]),
        ("calibrate figures", lambda base, it: ["calibrate", "figures", it]),
        ("calibrate compare", lambda base, it: ["calibrate", "compare", base / "recording", it]),
    ],
    "recording": [
        ("show", lambda base, it: ["show", it]),
        ("lab replay", lambda base, it: ["lab", "replay", it, "--draws", "2"]),
        ("lab threshold", lambda base, it: ["lab", "threshold", it]),
        ("lab export rugbot", lambda base, it: ["lab", "export", it, "--out", it / "out.csv"]),
        ("lab export csv", lambda base, it: ["lab", "export", it, "--format", "csv", "--out", it / "out"]),
        ("calibrate figures", lambda base, it: ["calibrate", "figures", it]),
        ("calibrate compare", lambda base, it: ["calibrate", "compare", it, base / "result"]),
    ],
    "study": [
        ("show", lambda base, it: ["show", it]),
        ("verify", _verified),
        ("evaluate", lambda base, it: [*_evaluate(base), "--out", it]),
        ("merge", lambda base, it: ["evaluate", "merge", it.with_name("merged"), it, "--no-pictures"]),
    ],
    "share-1": [
        ("merge", lambda base, it: ["evaluate", "merge", it.with_name("merged"), it, base / "share-2",
                                    "--no-pictures"]),
    ],
    "search-pso": [
        ("show", lambda base, it: ["show", it]),
        ("verify", _verified),
        ("optimize", lambda base, it: [*_search(base, "pso"), "--out", it]),
    ],
    "search-random": [
        ("show", lambda base, it: ["show", it]),
        ("optimize", lambda base, it: [*_search(base, "random"), "--out", it]),
    ],
    "grid": [
        ("show", lambda base, it: ["show", it]),
        ("optimize", lambda base, it: ["optimize", base / "grid.toml", "--method", "grid", "--fresh", "3",
                                       "--no-pictures", "--out", it]),
    ],
    "paper": [("show", lambda base, it: ["show", it]), ("reproduce", lambda base, it: _reproduce(it))],
    **{name: _again(name) for name in OTHERS},
    "scenario.toml": [("scenario", lambda base, it: ["scenario", "--scenario", it]),
                      ("run", lambda base, it: ["run", "--scenario", it, "--set", "run.t_end_s=60"])],
    "study.toml": [("evaluate", lambda base, it: ["evaluate", it, "--no-pictures", "--no-confirm"])],
    "search.toml": [("optimize", lambda base, it: ["optimize", it, "--method", "random", "--budget", "24",
                                                   "--fresh", "4", "--no-pictures"])],
    "grid.toml": [("optimize", lambda base, it: ["optimize", it, "--method", "grid", "--runs", "2",
                                                 "--fresh", "3", "--no-pictures"])],
    "floor.txt": [("floors", lambda base, it: ["scenario", "--floor", it])],
    "energies.csv": [("scenario", lambda base, it: ["scenario", "--energies", it])],
    "log-1.csv": [("lab import", lambda base, it: ["lab", "import", it, "--floor", base / "floor.txt",
                                                   "--any-floor", "--out", it.with_name("lab")])],
    "console.txt": [("lab import", lambda base, it: ["lab", "import", it, "--floor", base / "floor.txt",
                                                     "--any-floor", "--out", it.with_name("lab")])],
    "columns.toml": [("lab import", lambda base, it: ["lab", "import", base / "log-1.csv", "--columns", it,
                                                      "--floor", base / "floor.txt", "--any-floor",
                                                      "--out", it.with_name("lab")])],
}  # fmt: skip
"""By what is damaged: the commands that read it."""

WEIGHTS = {"result": 6, "recording": 5, "study": 5, "search-pso": 3, "search-random": 3}


def in_python(folder: Path) -> None:
    """What a user does with a result: verdicts, floors, a page, a replay under other strategies and floors."""
    result = Result.read(folder)
    for run in result.runs["run"].to_list():
        verdict(result, run)
        record_of(result, run)
    replay(result, result.scenario.with_values({"strategy.name": "soft"}))
    moved: Scenario = result.scenario.with_values({"floor.tiles": None, "floor.source": "random:0.48"})
    replay(result, moved)


# ---- damages ---------------------------------------------------------------------------------------------------------

TABLES = (".parquet",)
TEXTS = (".toml", ".json", ".jsonl")


def damage(it: Path, dice: random.Random) -> str:
    """Damage a file or one of a folder's files; gives what was done."""
    path = it if it.is_file() else dice.choice(sorted(p for p in it.rglob("*") if p.is_file()))
    ways: list[Callable[[Path, random.Random], str]] = [_bytes, _file]
    if path.suffix in TABLES:
        ways = [_bytes, _file, _table, _table, _table, _table]
    elif path.suffix in TEXTS:
        ways = [_bytes, _file, _values, _values, _values, _values]
    elif path.suffix in (".csv", ".txt"):
        ways = [_bytes, _file, _cells, _cells, _cells]
    done = dice.choice(ways)(path, dice)
    if path.suffix in TABLES and path.is_file() and dice.random() < 0.6:
        done += _honest_shard(path)
    return f"{path.relative_to(it.parent)}: {done}"


def _bytes(path: Path, dice: random.Random) -> str:
    data = bytearray(path.read_bytes())
    how = dice.choice(["flip", "cut", "insert", "empty", "random", "repeat"])
    if how == "flip":
        for _ in range(dice.choice([1, 1, 3, 20])):
            if data:
                data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
    elif how == "cut":
        del data[dice.randrange(len(data) + 1) :]
    elif how == "insert":
        at = dice.randrange(len(data) + 1)
        data[at:at] = dice.choice([b"\0", b"\xff\xfe", b"[" * 3000, b"9" * 5000, b"\n\n", dice.randbytes(20)])
    elif how == "empty":
        data.clear()
    elif how == "random":
        data = bytearray(dice.randbytes(dice.choice([1, 10, 1000])))
    else:
        data = data * 2
    path.write_bytes(bytes(data))
    return f"bytes, {how}"


def _file(path: Path, dice: random.Random) -> str:
    others = [p for p in path.parent.iterdir() if p.is_file() and p != path]
    how = dice.choice(["delete", "folder", "fifo", "loop", "dangling", "zero", "swap", "unreadable"])
    if how == "swap" and others:
        other = dice.choice(others)
        path.write_bytes(other.read_bytes())
        return f"another file's bytes ({other.name})"
    path.unlink()
    if how == "folder":
        path.mkdir()
    elif how == "fifo":
        os.mkfifo(path)
    elif how == "loop":
        path.symlink_to(path.name)
    elif how == "dangling":
        path.symlink_to("nowhere")
    elif how == "zero":
        path.symlink_to("/dev/zero")
    elif how == "unreadable":
        path.write_bytes(b"x")
        path.chmod(0)
    return f"file, {how}"


ODD: tuple[Any, ...] = (
    None, "", "x", "../../etc", -1, 0, 1, 3, 1e308, -1e308, math.nan, math.inf, 10**30, 2**31, 2**63, [], {}, [1],
    ["a"], True, False, {"a": 1}, [[1, 2], [3]], "=1+1", "\0", "9" * 100, 1.5, [None], [[]], "random:0.48", 10**9,
)  # fmt: skip


def _changed(node: Any, dice: random.Random) -> str:
    """Change something below a node of parsed JSON or TOML, in place."""
    name = ""
    while True:
        keys: list[Any] = list(node) if isinstance(node, dict) else list(range(len(node)))
        if not keys:
            return f"{name} (empty)"
        key = dice.choice(keys)
        name = f"{name}.{key}"
        child = node[key]
        if isinstance(child, dict | list) and child and dice.random() < 0.8:
            node = child
            continue
        how = dice.choice(["odd", "odd", "odd", "drop", "rename", "text", "scale"])
        if how == "drop":
            del node[key]
        elif how == "rename" and isinstance(node, dict):
            node[f"{key}x"] = node.pop(key)
        elif how == "text":
            node[key] = str(child)
        elif how == "scale" and isinstance(child, int | float) and not isinstance(child, bool):
            node[key] = child * dice.choice([-1, 0, 1000, 10**9])
        else:
            node[key] = dice.choice(ODD)
            return f"{name} = {node[key]!r}"
        return f"{name} {how}"


def _values(path: Path, dice: random.Random) -> str:
    text = path.read_text()
    if path.suffix == ".jsonl":
        lines = text.splitlines()
        if not lines:
            return _bytes(path, dice)
        k = dice.randrange(len(lines))
        how = dice.choice(["value", "value", "value", "drop", "twice", "swap"])
        if how == "value":
            line = json.loads(lines[k])
            how = _changed(line, dice)
            lines[k] = json.dumps(line)
        elif how == "drop":
            del lines[k]
        elif how == "twice":
            lines.insert(k, lines[k])
        else:
            lines[0], lines[k] = lines[k], lines[0]
        path.write_text("\n".join(lines) + "\n")
        return f"line {k + 1}, {how}"
    is_json = path.suffix == ".json"
    values = json.loads(text) if is_json else tomllib.loads(text)
    if is_json and dice.random() < 0.1:
        values = dice.choice(ODD)
        path.write_text(json.dumps(values))
        return f"JSON, {values!r}"
    done = _changed(values, dice)
    try:
        path.write_text(json.dumps(values) if is_json else tomli_w.dumps(values))
    except (TypeError, ValueError):  # TOML has no null
        return _bytes(path, dice)
    return done


def _cells(path: Path, dice: random.Random) -> str:
    lines = path.read_text().splitlines()
    k = dice.randrange(len(lines))
    cells = lines[k].split(",")
    c = dice.randrange(len(cells))
    how = dice.choice(["value", "value", "value", "drop", "add", "line", "twice", "quote", "late"])
    if how == "value":
        cells[c] = dice.choice(
            ["", "x", "-1", "nan", "inf", "1e400", "9" * 400, "1.5", "=1+1", "2147483648", "None"]
        )
    elif how == "drop":
        del cells[c]
    elif how == "add":
        cells.append("7")
    elif how == "quote":
        cells[c] = '"'
    lines[k] = ",".join(cells)
    if how == "line":
        del lines[k]
    elif how == "twice":
        lines.insert(k, lines[k])
    elif how == "late":
        lines.append(lines.pop(k))
    path.write_text("\n".join(lines) + "\n")
    return f"line {k + 1}, cell {c + 1}, {how}"


def _table(path: Path, dice: random.Random) -> str:
    data, done = _table_bytes(path.read_bytes(), dice)
    path.write_bytes(data)
    return done


def _table_bytes(data: bytes, dice: random.Random) -> tuple[bytes, str]:
    try:
        frame = pl.read_parquet(io.BytesIO(data))
    except Exception:  # damaged already
        return data, "nothing"
    name, done = dice.choice(frame.columns), "none"
    how = dice.choice([
        "drop", "rename", "retype", "null", "nan", "negative", "huge", "odd", "duplicate", "remove", "shuffle", "none",
        "extra", "key", "key", "key", "column", "reverse",
    ])  # fmt: skip
    with contextlib.suppress(pl.exceptions.PolarsError, OverflowError, TypeError):
        frame, done = _of_frame(frame, name, how, dice)
    out = io.BytesIO()
    frame.write_parquet(out)
    return out.getvalue(), done


def _of_frame(frame: pl.DataFrame, name: str, how: str, dice: random.Random) -> tuple[pl.DataFrame, str]:
    kind, rows = frame.schema[name], frame.height
    some = np.zeros(rows, dtype=np.bool_)
    if rows:
        some[[dice.randrange(rows) for _ in range(dice.choice([1, 3, rows]))]] = True
    if how == "drop":
        return frame.drop(name), f"no {name}"
    if how == "rename":
        return frame.rename({name: f"{name}_"}), f"{name} renamed"
    if how == "retype":
        other = dice.choice([pl.String, pl.Float32, pl.Int64, pl.Float64, pl.UInt8, pl.Boolean])
        return frame.with_columns(pl.col(name).cast(other, strict=False)), f"{name} as {other}"
    if how in ("null", "nan", "negative", "huge", "odd", "key"):
        keys = [key for key in ("run", "robot", "sample", "cell") if key in frame.columns]
        if how == "key" and keys:
            name = dice.choice(keys)
            kind = frame.schema[name]
        value: Any = {
            "null": None, "nan": math.nan, "negative": -1, "huge": dice.choice([2**31, 2**32 - 1, 1e300, 65535]),
            "odd": dice.choice([0, 1, 7, 0.3, "x", "", 1e6]), "key": dice.choice([0, 1, 5, 1000, 65535, 2**32 - 1]),
        }[how]  # fmt: skip
        put = pl.Series("put", [value] * rows).cast(kind, strict=False)
        changed = pl.when(pl.Series(some)).then(put).otherwise(pl.col(name)).alias(name)
        return frame.with_columns(changed), f"{name} = {value!r} in {int(some.sum())} of {rows} rows"
    if how == "duplicate":
        return pl.concat([frame, frame.filter(pl.Series(some))]), "rows twice"
    if how == "remove":
        return frame.filter(~pl.Series(some)), "rows removed"
    if how == "shuffle":
        return frame.sample(fraction=1.0, shuffle=True, seed=dice.randrange(2**31)), "shuffled"
    if how == "none":
        return frame.clear(), "no rows"
    if how == "extra":
        return frame.with_columns(more=pl.lit("=1+1")), "a column more"
    if how == "column":
        other = dice.choice(frame.columns)
        return frame.with_columns(pl.col(other).cast(kind, strict=False).alias(name)), f"{name} from {other}"
    return frame.reverse(), "reversed"


def _honest_shard(path: Path) -> str:
    """Make the description of tables fit a damaged file."""
    about = path.with_name(path.name.partition(".")[0] + ".json")
    if path.parent.name not in ("shards", "steps", "fresh") or not about.is_file():
        return ""
    with contextlib.suppress(ValueError, KeyError, TypeError, UnicodeDecodeError):
        values = json.loads(about.read_text())
        data = path.read_bytes()
        values["files"][path.name] |= {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
        about.write_text(json.dumps(values))
    return ", hash made to fit"


# ---- one input -------------------------------------------------------------------------------------------------------


def one(number: int, seed: int, base: Path, only: Sequence[str]) -> tuple[str, str, str]:
    """Make input ``number`` and have it read; gives the outcome, what it was, and where it went wrong."""
    dice = random.Random(f"{seed} {number}")
    names = [name for name in READERS if not only or name in only]
    name = dice.choices(names, [WEIGHTS.get(name, 1) for name in names])[0]
    command, read = dice.choice(READERS[name])
    folder = Path(tempfile.mkdtemp(prefix="fuzz-", dir=base.parent))
    try:
        it = folder / name
        if (base / name).is_dir():
            shutil.copytree(base / name, it)
        else:
            shutil.copy(base / name, it)
        done = [damage(it, dice)]
        if dice.random() < 0.25 and it.exists():
            with contextlib.suppress(Exception):  # the first damage may have left nothing to damage
                done.append(damage(it, dice))
        about = f"{name}, {command}; {'; '.join(done)}"
        outcome, where = _read(command, read, base, it)
        return outcome, about, where
    finally:
        for path in folder.rglob("*"):
            with contextlib.suppress(OSError):
                path.chmod(0o700, follow_symlinks=False) if path.is_dir() else None
        shutil.rmtree(folder, ignore_errors=True)


def _read(command: str, read: Any, base: Path, it: Path) -> tuple[str, str]:
    out, told = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(told):
            if command == "read in Python":
                read(it)
                return "accepted", ""
            code = main([str(word) for word in read(base, it)])
    except (InputError, RunError) as error:
        return "refused", str(error)
    except SystemExit as error:
        return ("refused", "by argparse") if error.code == 2 else ("raw", f"SystemExit {error.code}")
    except MemoryError:
        return "raw", "MemoryError"
    except BaseException as error:
        return "raw", _where(error)
    last = told.getvalue().strip().splitlines()
    if code == 0:
        return "accepted", ""
    said = last[-1] if last else ""
    if command == "verify" and code == 1 and "NOT VERIFIED" in out.getvalue():
        return "refused", "runs differ"
    if code in (1, 2) and said.startswith("vibroswarm: error: ") and "Traceback" not in told.getvalue():
        return ("raw", "out of memory") if "out of memory" in said else ("refused", said)
    return "raw", f"exit code {code}: {said}"


def _where(error: BaseException) -> str:
    """The last line of our code, and the exception."""
    frames = [
        f for f in traceback.extract_tb(error.__traceback__) if f"{os.sep}vibroswarm{os.sep}" in f.filename
    ]
    frame = frames[-1] if frames else traceback.extract_tb(error.__traceback__)[-1]
    place = frame.filename.rpartition(f"vibroswarm{os.sep}")[2]
    words = str(error).splitlines()
    return f"{place}:{frame.lineno} {type(error).__name__}: {words[0][:90] if words else ''}"


# ---- many inputs -----------------------------------------------------------------------------------------------------


def _worker(numbers: Sequence[int], seed: int, base: Path, only: Sequence[str], pipe: Any) -> None:
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    for number in numbers:
        pipe.send(("begin", number))
        pipe.send(("done", number, *one(number, seed, base, only)))
    pipe.send(("end",))


def all_inputs(count: int, seed: int, base: Path, only: Sequence[str]) -> list[tuple[int, str, str, str]]:
    """Every input in a process of its own kind, which is begun again where an input kills it."""
    in_python(base / "result")  # what is compiled is kept, and takes no time from the first inputs
    left, found = list(range(count)), []
    context = multiprocessing.get_context("spawn")
    while left:
        here, there = context.Pipe(duplex=False)
        process = context.Process(target=_worker, args=(left, seed, base, only, there))
        process.start()
        there.close()
        first = began = left[0]
        while True:
            try:
                message = here.recv() if here.poll(ANSWER_S + (120 if began == first else 0)) else ("hang",)
            except EOFError:
                message = ("dead",)
            if message[0] == "begin":
                began = message[1]
            elif message[0] == "done":
                found.append((message[1], *message[2:]))
                left.remove(message[1])
                if len(found) % 200 == 0:
                    raws = sum(outcome == "raw" for _, outcome, _, _ in found)
                    print(f"{len(found):,} of {count:,}, {raws} raw", file=sys.stderr, flush=True)
            else:
                if message[0] != "end":
                    found.append((began, "raw", "?", f"the process {message[0]}s"))
                    left.remove(began)
                break
        process.kill()
        process.join()
    return found


def say(found: Sequence[tuple[int, str, str, str]], *, listed: bool) -> int:
    """Counts, and the raw ones by place."""
    by_kind: dict[str, Counter[str]] = defaultdict(Counter)
    for _, outcome, about, _ in found:
        by_kind[about.partition(";")[0]][outcome] += 1
    for kind in sorted(by_kind):
        print(f"{kind:<34}" + "".join(f"{word} {by_kind[kind][word]:>5}   " for word in OUTCOMES))
    total = Counter(outcome for _, outcome, _, _ in found)
    print(f"{'all':<34}" + "".join(f"{word} {total[word]:>5}   " for word in OUTCOMES))
    places: dict[str, list[int]] = defaultdict(list)
    for number, outcome, _, where in found:
        if outcome == "raw":
            places[where].append(number)
    print(f"\n{total['raw']} raw at {len(places)} places")
    for where, numbers in sorted(places.items(), key=lambda item: -len(item[1])):
        print(f"  {len(numbers):>4}  {where}   (inputs {', '.join(map(str, numbers[:4]))})")
    if listed:
        for number, outcome, about, where in sorted(found):
            print(f"{number} {outcome}: {about} -> {where}")
    return 1 if total["raw"] else 0


OUTCOMES = ("accepted", "refused", "raw")


def run() -> int:
    """The whole check."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--inputs", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="names of what is damaged, with commas")
    parser.add_argument("--list", action="store_true", help="also list every input")
    parser.add_argument("--input", type=int, help="this one alone, in this process")
    parser.add_argument("--base", type=Path, help="keep the valid folders here, or take them from there")
    arguments = parser.parse_args()
    only = [name for name in arguments.only.split(",") if name]
    with tempfile.TemporaryDirectory(prefix="fuzz-files-") as folder:
        base = arguments.base or Path(folder) / "base"
        if not base.is_dir():
            base.mkdir(parents=True)
            made(base)
        if arguments.input is not None:
            print(one(arguments.input, arguments.seed, base, only))
            return 0
        return say(all_inputs(arguments.inputs, arguments.seed, base, only), listed=arguments.list)


if __name__ == "__main__":
    sys.exit(run())
