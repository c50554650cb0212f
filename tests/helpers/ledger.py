"""The ledger: hashes over values that no change of the code may move by one bit.

    python tests/helpers/ledger.py                      the whole ledger: what differs from what is kept
    python tests/helpers/ledger.py --short              a part of it, within a minute if kernels are compiled
    python tests/helpers/ledger.py --write statistics   keeps a part anew, or only the rows that ``--rows REGEX`` names

It has two parts. ``values.json``: simulated values (motion, readings, messages, beliefs, decisions, places, exported
programs, imported recordings), which never move. ``statistics.json``: figures of studies, leagues, searches, fits and
inspections, which move only in a commit of their own that says what has changed, and why.

Another processor may round otherwise; see ``helpers.common_instructions``.

``ledger.toml`` lists the combinations. Hashes are of values in the order of the columns that are named here or in
what is kept: files and columns may be added. One that is renamed is renamed there too.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import json
import os
import re
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from types import MappingProxyType
from typing import Any

if __name__ == "__main__":  # as a program it does not find its own package
    sys.path.insert(0, str(Path(__file__).parents[1]))

import helpers.common_instructions  # noqa: F401  # isort: skip - before NumPy

import numpy as np
import polars as pl

from helpers import drawn_video
from vibroswarm import InputError, Result, Scenario, load_code, preset, simulate
from vibroswarm.cli import main as vibroswarm
from vibroswarm.export.c_library import library_files
from vibroswarm.inference.outcomes import SHARES
from vibroswarm.scenario.plugins import is_code
from vibroswarm.simulation import versions

HERE = Path(__file__).parents[1] / "golden"
LIST = tomllib.loads((HERE / "ledger.toml").read_text(encoding="utf-8"))
FILES = {part: HERE / f"{part}.json" for part in ("values", "statistics")}
EXAMPLES = Path(__file__).parents[2] / "examples"
PARTS = {block["name"]: "values" for block in (*LIST["runs"], *LIST["export"])} | {
    block["name"]: block.get("part", "statistics") for block in LIST["command"]
}
"""The part of the ledger that each block of the list is in."""
RECORDINGS = "VIBROSWARM_RUGBOT"
"""Environment variable with the folder of recordings that some commands need."""
MADE_BY = ("numpy", "numba", "scipy", "polars", "architecture")
"""Other versions of these may round otherwise."""

COLUMNS = {
    "motion": ("run", "robot", "sample", "stop_start_s", "time_s", "x_m", "y_m", "heading_rad", "drive_s", "turn_s",
               "avoid_s", "stop_s"),
    "observations": ("tile", "energy", "observation"),
    "inference": ("message", "alpha", "beta", "messages_received", "belief_below", "decision"),
    "places": ("x_m", "y_m", "spread_m"),
    "robots": ("run", "robot", "decision", "decision_time_s", "belief_at_decision", "belief_below", "belief_in_truth",
               "alpha", "beta", "samples", "sent", "messages_received"),
    "runs": ("run", "consensus_time_s", "fill_ratio", "truth", "right", "wrong", "undecided", "end_s"),
    "ends": ("run", "robot", "end_s", "x_m", "y_m", "heading_rad", "stop_start_s"),
}  # fmt: skip
"""Tables and columns of a result of which the values are held."""

Hashes = dict[str, Any]
"""Hashes by name of what they are of; those of a command's tables by table and column."""
LEFT_OUT = ("blocked_s", *SHARES)
"""Columns of tables of commands that are not hashed: what robots do, which follows from other columns."""


def made_by() -> dict[str, str]:
    """The versions that values are repeatable with, to the bit."""
    return {name: versions()[name] for name in MADE_BY}


def part_of(name: str) -> str:
    """The part of the ledger that an entry is in."""
    return PARTS[name.split(":")[0]]


def all_hashes(short: bool, rows: str = "") -> Hashes:
    """Make the values of the ledger, or of its short part, and hash them; all of it in two processes.

    Args:
        rows: a regular expression; only entries in whose names it is found are made.
    """
    if short:
        found = hashes_of_simulator(short, rows) | hashes_of_commands(short, LIST["command"], rows)
    else:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            beside = pool.submit(hashes_beside, rows)
            others = [block for block in LIST["command"] if not block.get("beside")]
            found = hashes_of_commands(short, others, rows) | beside.result()
    return {name: value for name, value in found.items() if re.search(rows, name)}


def hashes_beside(rows: str) -> Hashes:
    """Make about half of the whole ledger."""
    beside = [block for block in LIST["command"] if block.get("beside")]
    return hashes_of_simulator(False, rows) | hashes_of_commands(False, beside, rows)


def hashes_of_simulator(short: bool, rows: str) -> Hashes:
    """Simulate the runs and export the programs, and hash them."""
    found: Hashes = {}
    for block in LIST["runs"]:
        for name, values in combinations(block, short):
            if re.search(rows, entry := f"{block['name']}: {name}"):
                found[entry] = hash_of_runs(block, values)
    for block in LIST["export"]:
        for name, text in exported_programs(block, short):
            found[f"{block['name']}: {name}"] = hash_of_program(text)
    return found


def combinations(block: Mapping[str, Any], short: bool) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield name and values of each combination of a block's choices, or of those in the short ledger."""
    choices = [LIST["choices"][kind].items() for kind in block["of"]]
    all_of_them = {
        ", ".join(name for name, _ in chosen): {
            field: value for _, fields in chosen for field, value in fields.items()
        }
        for chosen in product(*choices)
    }
    in_short = block["short"] if isinstance(block["short"], list) else list(all_of_them)[:: block["short"]]
    for name in in_short if short else all_of_them:
        yield name, all_of_them[name]


def hash_of_runs(block: Mapping[str, Any], values: Mapping[str, Any]) -> str:
    """Simulate the runs of a combination and hash them; "refused" if no swarm can be asked that."""
    try:
        return hash_of_result(result_of(block, values), block.get("also", {}))
    except InputError:
        return "refused"


def result_of(block: Mapping[str, Any], values: Mapping[str, Any]) -> Result:
    """Simulate the runs of a combination."""
    fields = block.get("values", {}) | values
    name, motion = fields.pop("preset", block.get("preset")), fields.pop("motion", "event")
    return simulate(scenario_of(name, fields), LIST["seed"], block["runs"], motion=motion)


def scenario_of(name: str, fields: Mapping[str, Any]) -> Scenario:
    """A preset with these fields, of which those that name code of the examples load it."""
    root = HERE.parents[1]
    loaded = {field: load_code(value, root) if is_code(value) else value for field, value in fields.items()}
    return preset(name).with_values(loaded)


def hash_of_result(result: Result, also: Mapping[str, Sequence[str]] = MappingProxyType({})) -> str:
    """16 hexadecimal digits of the values of a result's tables: of ``COLUMNS``, and then of ``also``."""
    digest = hashlib.sha256()
    for table, names in (*COLUMNS.items(), *also.items()):
        frame = getattr(result, table)
        for name in names if frame is not None else ():
            digest.update(bits_of(frame[name]))
    return digest.hexdigest()[:16]


def bits_of(values: pl.Series) -> bytes:
    """A column as doubles: null is not a number."""
    return np.ascontiguousarray(values.cast(pl.Float64).fill_null(float("nan")).to_numpy()).tobytes()


def exported_programs(block: Mapping[str, Any], short: bool) -> Iterator[tuple[str, str]]:
    """Yield name and text of the robot's program in C for every preset and choice that can be exported."""
    pairs = list(product(block["presets"], LIST["choices"][block["of"]].items()))
    for base, (name, values) in pairs[:: block["short"] if short else 1]:
        try:
            files = library_files(scenario_of(base, values))
        except InputError:
            continue
        yield (
            f"{base}, {name}",
            "\n".join(files[file] for file in sorted(files) if file.endswith((".c", ".h"))),
        )


def hash_of_program(text: str) -> str:
    """16 hexadecimal digits of a program's tokens: no comments, no hashes, no layout.

    ``VS_PROGRAM_ID`` is part of a hash of the package's code, which every change of it moves.
    """
    without_comments = re.sub(r"/\*.*?\*/|//[^\n]*", " ", text, flags=re.DOTALL)
    without_hashes = re.sub(r"VS_PROGRAM_ID UINT32_C\(0x\w+\)|[0-9a-f]{12,}", "#", without_comments)
    return hashlib.sha256(" ".join(without_hashes.split()).encode()).hexdigest()[:16]


def hashes_of_commands(short: bool, commands: Sequence[Mapping[str, Any]], rows: str) -> Hashes:
    """Run commands in a folder of their own, and hash the numbers that they write or print."""
    found: Hashes = {}
    recordings = os.environ.get(RECORDINGS)
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for name, text in LIST["files"].items():
            Path(name).write_text(text, encoding="utf-8")
        if any(re.search(rows, f"{block['name']}: ") for block in commands if block["name"] == "tracking"):
            drawn_video.write(Path("drawn.avi"), drawn_video.frames(40))
            Path("markers.toml").write_text(drawn_video.MARKERS.to_toml(), encoding="utf-8")
        for block in commands:
            if (short and not block.get("short")) or ("needs" in block and not recordings):
                continue
            if "needs" not in block and not re.search(rows, f"{block['name']}: "):
                continue
            printed = printed_by(
                [word.format(recordings=recordings, examples=EXAMPLES) for word in block["run"]]
            )
            if "tables" in block:
                files = [file for pattern in block["tables"] for file in sorted(Path().glob(pattern))]
                for file in files:
                    found[f"{block['name']}: {file.as_posix()}"] = hashes_of_file(file)
            else:
                found[f"{block['name']}: printed"] = hashes_of_numbers(json.loads(printed))
    return found


def printed_by(words: Sequence[str]) -> str:
    """Run a command in this process, and return what it prints.

    Raises:
        RuntimeError: it fails.
    """
    out, said = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(said):
        code = vibroswarm(list(words))
    if code:
        raise RuntimeError(f"vibroswarm {' '.join(words)}: exit code {code}\n{said.getvalue()}")
    return out.getvalue()


def hashes_of_file(file: Path) -> dict[str, str]:
    """Hashes of the numbers in a file, by column of a table, or by place in a TOML file."""
    if file.suffix == ".toml":
        return hashes_of_numbers(tomllib.loads(file.read_text(encoding="utf-8")))
    if file.suffix == ".parquet":
        return hashes_of_table(pl.read_parquet(file))
    return hashes_of_table(pl.read_csv(file, infer_schema_length=None))


def hashes_of_table(frame: pl.DataFrame) -> dict[str, str]:
    """8 hexadecimal digits of each column of numbers or truth values."""
    return {
        name: hashlib.sha256(bits_of(frame[name])).hexdigest()[:8]
        for name, kind in frame.schema.items()
        if (kind.is_numeric() or kind == pl.Boolean) and not name.startswith(LEFT_OUT)
    }


def hashes_of_numbers(document: Any) -> dict[str, str]:
    """8 hexadecimal digits of the numbers of each place of a nested document; items of a list have one place."""
    numbers: dict[str, list[float]] = {}

    def collect(value: Any, place: str) -> None:
        if isinstance(value, dict):
            for name, part in value.items():
                collect(part, f"{place}.{name}" if place else name)
        elif isinstance(value, list):
            for part in value:
                collect(part, place)
        elif isinstance(value, int | float):
            numbers.setdefault(place, []).append(float(value))

    collect(document, "")
    return {
        place: hashlib.sha256(np.array(values).tobytes()).hexdigest()[:8] for place, values in numbers.items()
    }


def differences(found: Hashes, kept: Hashes, *, all_there: bool) -> list[str]:
    """What is not as it was kept; an empty list if nothing.

    Args:
        all_there: whether everything that is kept must have been found too.
    """
    said = []
    for name, value in found.items():
        if name not in kept:
            said.append(f"{name}: is not in the ledger")
        elif isinstance(value, str):
            said += [f"{name}: differs"] if value != kept[name] else []
        else:
            changed = [part for part, digits in kept[name].items() if value.get(part) != digits]
            said += [f"{name}: {', '.join(changed)} differ"] if changed else []
    return said + ([f"{name}: is missing" for name in kept if name not in found] if all_there else [])


def kept_hashes() -> Hashes:
    """The hashes that are kept, and ``made by``: the versions that made them."""
    kept: Hashes = {}
    for file in FILES.values():
        kept |= json.loads(file.read_text(encoding="utf-8"))
    return kept


def write(part: str, found: Hashes, rows: str) -> None:
    """Keep what is found of a part; rows that ``rows`` names leave if their block was made, or is not in the list."""
    kept = json.loads(FILES[part].read_text(encoding="utf-8"))
    made = {name.split(":")[0] for name in found} | ({name.split(":")[0] for name in kept} - PARTS.keys())
    others = {n: value for n, value in kept.items() if not re.search(rows, n) or n.split(":")[0] not in made}
    document = others | {name: value for name, value in found.items() if part_of(name) == part}
    text = json.dumps(document | {"made by": made_by()}, indent=1)
    FILES[part].write_text(text + "\n", encoding="utf-8")


def main() -> int:
    """Compare with what is kept, or keep what is found."""
    parser = argparse.ArgumentParser(description="Compare the values of the ledger.")
    parser.add_argument("--short", action="store_true", help="a part of it only")
    parser.add_argument(
        "--rows", default="", metavar="REGEX", help="only entries in whose names this is found"
    )
    parser.add_argument("--write", choices=FILES, help="keep what is found of a part")
    options = parser.parse_args()
    if not os.environ.get(RECORDINGS):
        print(f"{RECORDINGS} does not name the recordings: what needs them is left out", file=sys.stderr)
    found = all_hashes(options.short, options.rows)
    if options.write:
        write(options.write, found, options.rows)
        return 0
    kept = kept_hashes()
    if kept.pop("made by") != made_by():
        print(f"the ledger was made by other versions: {kept_hashes()['made by']}, here is {made_by()}")
        return 1
    kept = {name: value for name, value in kept.items() if re.search(options.rows, name)}
    said = differences(found, kept, all_there=not options.short and bool(os.environ.get(RECORDINGS)))
    print("\n".join(said) or f"All {len(found)} entries are as they were.")
    return 1 if said else 0


if __name__ == "__main__":
    sys.exit(main())
