"""Do the tests find faults? Put single faults into the program, drawn by chance, and see which a test finds.

    python benchmarks/seeded_faults.py TABLE.csv [--faults 8] [--seed 1] [--only NUMBERS] [--limit-s 7200]

A fault is one small change of an expression: a comparison that takes its limit in or leaves it out, plus for minus,
times for divided by, another constant, ``and`` for ``or``, a branch for the other, a sign. In each of five folders as
many are drawn. Each is made alone, in a clone of the last commit; then contract tests, exact tests and property tests
run, without the golden values, until the first of them fails. Those in files that name the changed module run first.
A test run that takes longer than the limit is stopped, and its row says so: either the program no longer ends, or the
tests that would find the fault were not reached. It counts as not found.

The table has a row a fault: its number, file, line, what was there, what is there instead, the first test that failed
(empty: missed), and the time in seconds. Rows that are in the table already are not made again. Which faults a seed
draws depends on the sources. With ``--kernels``, calls share the kernels that they compile.
"""

from __future__ import annotations

import argparse
import ast
import csv
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

ROOT: Final = Path(__file__).parents[1]
FOLDERS: Final = ("motion", "inference", "analysis", "strategies", "sensors")
STOPPED: Final = "stopped"
"""How the row of a test run begins that took too long."""
FIRST: Final = "VIBROSWARM_TESTS_FIRST"
"""Environment variable that names the module whose tests run first."""
COLUMNS: Final = ("number", "file", "line", "was", "is", "found_by", "time_s")

SWAPPED: Final[dict[type[ast.AST], type[Any]]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.And: ast.Or,
    ast.Or: ast.And,
}


class Fault(NamedTuple):
    """One change of one file: the text from ``start`` to ``end`` (in characters) is replaced."""

    file: Path
    line: int
    start: int
    end: int
    was: str
    text: str


def changed(node: ast.AST) -> ast.expr | None:
    """Return an expression that differs from this one by a fault; None if there is no such fault."""
    match node:
        case ast.Compare(left, [operator], [right]) if type(operator) in SWAPPED:
            return ast.Compare(left, [SWAPPED[type(operator)]()], [right])
        case ast.BinOp(left, operator, right) if type(operator) in SWAPPED:
            return ast.BinOp(left, SWAPPED[type(operator)](), right)
        case ast.BoolOp(operator, values):
            return ast.BoolOp(SWAPPED[type(operator)](), values)
        case ast.IfExp(test, body, orelse):
            return ast.IfExp(test, orelse, body)
        case ast.UnaryOp(ast.USub() | ast.Not(), operand):
            return operand
        case ast.Constant(bool() as value):
            return ast.Constant(not value)
        case ast.Constant(int() as value):
            return ast.Constant(value + 1)
        case ast.Constant(float() as value):
            return ast.Constant(value * 1.5 + 0.1)
    return None


def computing(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of a program that compute something: no annotations, error messages or texts."""
    for name, value in ast.iter_fields(tree):
        if name in ("annotation", "returns", "decorator_list"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not isinstance(child, ast.Raise | ast.JoinedStr):
                yield child
                yield from computing(child)


def faults_of(file: Path) -> list[Fault]:
    """Return all faults that a file can be given, in the order of its text."""
    text = file.read_text()
    lines = text.splitlines(keepends=True)
    begins = [0]
    for line in lines:
        begins.append(begins[-1] + len(line))
    found = []
    for node in computing(ast.parse(text)):
        fault = changed(node)
        if fault is None:
            continue
        assert isinstance(node, ast.expr)
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        # The columns of the syntax tree count bytes.
        start = begins[node.lineno - 1] + len(lines[node.lineno - 1].encode()[: node.col_offset].decode())
        last = lines[node.end_lineno - 1].encode()[: node.end_col_offset].decode()
        end = begins[node.end_lineno - 1] + len(last)
        new = f"({ast.unparse(ast.fix_missing_locations(fault))})"
        found.append(Fault(file, node.lineno, start, end, text[start:end], new))
    return found


def drawn(package: Path, each: int, seed: int) -> list[Fault]:
    """Return ``each`` faults of each folder, at most two of one file."""
    chance = random.Random(seed)
    chosen = []
    for folder in FOLDERS:
        faults = [fault for file in sorted((package / folder).rglob("*.py")) for fault in faults_of(file)]
        chance.shuffle(faults)
        taken: list[Fault] = []
        for fault in faults:
            if len(taken) < each and sum(other.file == fault.file for other in taken) < 2:
                taken.append(fault)
        chosen += taken
    return chosen


def pytest_collection_modifyitems(config: Any, items: list[Any]) -> None:
    """Keep contract, exact and property tests; put those first whose file names the changed module."""
    module = os.environ.get(FIRST)
    if module is None:
        return
    kept = [
        item
        for item in items
        if item.path.parent.name in ("contract", "exact") or hasattr(getattr(item, "obj", None), "hypothesis")
    ]
    config.hook.pytest_deselected(items=[item for item in items if item not in set(kept)])
    names = {path: module in path.read_text() for path in {item.path for item in kept}}
    items[:] = sorted(kept, key=lambda item: not names[item.path])


def first_failure(clone: Path, fault: Fault, cache: Path, limit_s: float) -> str:
    """Return the name of the first test that fails with the fault; empty if none does."""
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(str(clone / name) for name in ("src", "benchmarks")),
        "XDG_CACHE_HOME": str(cache),
        "PYTHONDONTWRITEBYTECODE": "",  # each program that a test starts would compile everything again
        FIRST: fault.file.stem,
    }
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-p", "seeded_faults"]
    with subprocess.Popen(
        [*command, "-m", "not slow", "--tb=no", "tests"],
        cwd=clone,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as tests:
        try:
            printed, _ = tests.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            os.killpg(tests.pid, signal.SIGKILL)  # with the programs that tests started, which hold the pipe
            return f"{STOPPED} after {limit_s:.0f} s"
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", printed, re.MULTILINE)
    if failed is None and tests.returncode != 0:
        return f"no test could be run: {printed.strip().splitlines()[-1]}"
    return failed.group(1) if failed else ""


def main() -> None:
    """Make the faults and write the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("table", type=Path)
    parser.add_argument("--faults", type=int, default=8, help="of each folder")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="*", help="numbers of faults")
    parser.add_argument("--limit-s", type=float, default=7200.0, help="of the tests of one fault")
    parser.add_argument(
        "--kernels", type=Path, help="folder of compiled kernels (default: one that is deleted)"
    )
    options = parser.parse_args()
    rows = []
    if options.table.exists():
        with options.table.open(newline="") as there:
            rows = list(csv.DictReader(there))
    done = {int(row["number"]) for row in rows}
    with tempfile.TemporaryDirectory() as scratch:
        clone = Path(scratch) / "clone"
        subprocess.run(["git", "clone", "-q", str(ROOT), str(clone)], check=True)
        package = clone / "src" / "vibroswarm"
        for number, fault in enumerate(drawn(package, options.faults, options.seed), start=1):
            if number in done or (options.only and number not in options.only):
                continue
            text = fault.file.read_text()
            fault.file.write_text(text[: fault.start] + fault.text + text[fault.end :])
            began = time.perf_counter()
            kernels = options.kernels or Path(scratch) / "cache"
            found_by = first_failure(clone, fault, kernels.absolute(), options.limit_s)
            fault.file.write_text(text)
            file = fault.file.relative_to(package).as_posix()
            values = (number, file, fault.line, fault.was, fault.text, found_by)
            rows.append(dict(zip(COLUMNS, (*values, round(time.perf_counter() - began)), strict=True)))
            with options.table.open("w", newline="") as table:
                writer = csv.DictWriter(table, COLUMNS)
                writer.writeheader()
                writer.writerows(rows)
            print(
                f"{number} {file}:{fault.line} {fault.was} -> {fault.text}: {found_by or 'MISSED'}",
                flush=True,
            )
    found = sum(bool(row["found_by"]) and not row["found_by"].startswith(STOPPED) for row in rows)
    print(f"{found} of {len(rows)} faults were found.")


if __name__ == "__main__":
    main()
