"""Commands told to write where they cannot, two at a time in one folder, and with absurd sizes: the long check.

    python benchmarks/hostile_places.py [--only evaluate optimize ...] [--runs 20]

Each command that writes is given

    full      a disk that is full after some bytes (a limit on the size of files), then enough space again
    places    a folder without permission, a file, links, loops, a pipe, a device, impossible names, odd names
    pairs     itself, begun twice in one folder; then once more
    sizes     numbers of runs, robots, tiles and settings that no machine holds, and vast sparse files

A try is wrong that ends with another exit code than 0, 1 or 2, without a sentence ("vibroswarm: error: ..."), with a
traceback, not at all, or if the same command then gives other tables than undisturbed. Exit code 1 where one was wrong.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from vibroswarm.cli import main

LONGEST_S = 300.0
FULL_BYTES = (0, 300, 3_000, 20_000, 100_000)
"""Sizes of files beyond which the disk is full."""
NOBODY = 65534
"""A user that may write nowhere."""
MEMORY = 8 * 2**30
SHORT = ["--set", "run.t_end_s=100", "--robots", "2"]
SEARCH = """
seed = 3
[scenario]
preset = "paper"
swarm = { robots = 2 }
run = { t_end_s = 100 }
[space]
"sample.sample_interval_ms" = { from = 1000, to = 6000 }
"decision.min_observations" = { from = 0, to = 60 }
[search]
method = "tpe"
budget = 60
fresh = 10
"""
ABSURD: tuple[tuple[str, ...], ...] = (
    ("evaluate", "--runs", "1000000000000"),
    ("evaluate", "--runs", "-5"),
    ("evaluate", "--robots", "1000000000"),
    ("evaluate", "--vary", "swarm.robots=" + ",".join(map(str, range(1, 3000)))),
    ("run", "--robots", "2000000000"),
    ("run", "--set", "run.t_end_s=1e300"),
    ("run", "--set", "run.t_end_s=nan"),
    ("run", "--set", "sample.sample_interval_ms=1e-300"),
    ("run", "--seed", "9" * 400),
    ("run", "--tiles", "1000000x1000000", "--floor", "random:0.48"),
    ("run", "--floor", "random:1e-320"),
    ("run", "--set", "floor.source=" + "x" * 100_000),
    ("run", "--floor", "vast.csv"),
    ("run", "--scenario", "vast.csv"),
    ("show", "vast.csv"),
    ("show", "/dev/zero"),
    ("inspect", "vast.csv", "--laws", "vast.csv", "--size", "1x1"),
    ("optimize", "--budget", "1000000000000000"),
    ("optimize", "--fresh", "1000000000000000000", "--budget", "100"),
    ("league", "--runs", "1000000000000"),
    ("detect", "--runs", "1000000000000"),
    ("reproduce", "--runs", "1000000000000", "--out", "absurd"),
    ("evaluate", "tradeoff", "--runs", "1000000000000"),
    ("lab", "import", "vast.csv", "--floor", "diagonal:0.46", "--out", "absurd"),
)
"""Lines that no machine can do; ``vast.csv`` is a sparse file of a terabyte."""


def commands(here: Path, runs: int) -> dict[str, list[str]]:
    """What is attacked, without ``--out``."""
    (here / "search.toml").write_text(SEARCH)
    few = ["--runs", str(runs), *SHORT]
    floors = ["--patterns", "diagonal", "--fills", "0.46", "--strategy", "none,soft"]
    tests = ["--untuned", "--belief-runs", "4", "--fault-runs", "4"]
    return {
        "run": ["run", *SHORT],
        "evaluate": ["evaluate", "--strategy", "none,soft", *few, "--no-pictures"],
        "detect": ["detect", "--fills", "0.4,0.6", *few, "--no-pictures"],
        "league": ["league", *few, *floors, *tests],
        "tune": ["league", "tune", *SHORT, *floors, "--runs", "3", "--points", "4"],
        "tradeoff": ["evaluate", "tradeoff", *few, "--no-pictures"],
        "optimize": ["optimize", str(here / "search.toml"), "--no-pictures"],
        "reproduce": [
            "reproduce",
            "--only",
            "fill-ratios",
            "--columns",
            "paper",
            "--runs",
            "4",
            "--no-pictures",
        ],
        "inspect": ["inspect", *SHORT, "--floor", "diagonal:0.46", "--no-pictures"],
    }


@contextlib.contextmanager
def full_after(size: int) -> Iterator[None]:
    """Let no file grow beyond a size."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@contextlib.contextmanager
def nobody() -> Iterator[None]:
    """Be a user without permissions; only root can become another user."""
    if os.geteuid():
        yield
        return
    os.seteuid(NOBODY)
    try:
        yield
    finally:
        os.seteuid(0)


def asked(line: Sequence[str]) -> tuple[int, str]:
    """Return the exit code of a command and why it was wrong, if it was; in this process, since a start takes long."""
    out, told = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(told):
            code = main(list(line))
    except SystemExit as error:
        code = int(error.code or 0)
    except BaseException as error:
        return -1, f"{type(error).__name__}: {error}"
    return code, wrong_in(code, told.getvalue())


def wrong_in(code: int, told: str) -> str:
    """Return what is wrong with how a command ended; empty if nothing is."""
    if code == 0:
        return ""
    last = ([line for line in told.splitlines() if line.strip()] or [""])[-1]
    clear = "vibroswarm: error: " in told and "Traceback" not in told
    return "" if code in (1, 2) and clear else f"exit code {code}: {last[:150]}"


TABLES = ("*.csv", "shards/*.parquet", "steps/*.parquet", "fresh/*.parquet", "items/*/*.parquet", "best.toml")


def tables_in(out: Path) -> dict[str, bytes]:
    """Return what a command wrote that must be equal: a file, or tables of a folder."""
    if out.is_file():
        return {"": out.read_bytes()}
    found = [path for pattern in TABLES for path in out.glob(pattern)]
    return {str(path.relative_to(out)): path.read_bytes() for path in sorted(found)}


class Tries:
    """Counts tries, and prints those that were wrong."""

    def __init__(self) -> None:
        self.counts: Counter[tuple[str, str]] = Counter()

    def note(self, kind: str, name: str, code: int, wrong: str) -> None:
        self.counts[kind, "wrong" if wrong else str(code)] += 1
        if wrong:
            print(f"WRONG {kind}: {name}: {wrong}", flush=True)

    def say(self) -> bool:
        """Print the counts; return whether nothing was wrong."""
        for kind in dict.fromkeys(kind for kind, _ in self.counts):
            ends = {end: n for (of, end), n in sorted(self.counts.items()) if of == kind}
            print(
                f"{kind}: {sum(ends.values())} tries; " + ", ".join(f"{n} {end}" for end, n in ends.items())
            )
        return not any(end == "wrong" for _, end in self.counts)


def equal_after(line: Sequence[str], out: Path, alone: dict[str, bytes]) -> tuple[int, str]:
    """Give a command again, undisturbed; its tables must be those of the command left alone."""
    code, wrong = asked([*line, "--out", str(out)])
    if code == 2 and not wrong:  # what was left is refused; --force must help
        code, wrong = asked([*line, "--out", str(out), "--force"])
    if not wrong and (code or tables_in(out) != alone):
        wrong = f"exit code {code}, other tables than undisturbed"
    return code, wrong


def full_disk(tries: Tries, name: str, line: Sequence[str], here: Path, alone: dict[str, bytes]) -> None:
    for size in FULL_BYTES:
        out = here / f"full-{name}-{size}"
        with full_after(size):
            code, wrong = asked([*line, "--out", str(out)])
        tries.note("full disk", f"{name}, {size} bytes", code, wrong)
        code, wrong = equal_after(line, out, alone)
        tries.note("space again", f"{name}, {size} bytes", code, wrong)


def places(tries: Tries, name: str, line: Sequence[str], here: Path) -> None:
    where = here / f"places-{name}"
    where.mkdir()
    (where / "file").write_text("mine")
    (where / "thesis").mkdir()
    (where / "thesis" / "thesis.tex").write_text("ten years")
    (where / "empty").mkdir()
    (where / "link").symlink_to("empty")
    (where / "dangling").symlink_to("nowhere")
    (where / "loop").symlink_to("loop")
    os.mkfifo(where / "pipe")
    odd = ["a b", "-x", "ü\u202e", "x'\"$(y)", os.fsdecode(b"\xff\xfe"), "*.csv", "n" * 200]
    impossible = ["file/below", "n" * 300, "nul\0", "pipe/below", "loop/below"]
    there = ["file", "thesis", "link", "dangling", "loop", "pipe"]
    for word in [*odd, *impossible, *there]:
        for force in ([], ["--force"]):
            code, wrong = asked([*line, "--out", str(where / word), *force])
            if not wrong and code == 0 and word in impossible:
                wrong = "wrote where it cannot"
            tries.note("places", f"{name}, {word[:40]!r} {force}", code, wrong)
    for path in ("/dev/null", "/dev/full", "/proc/nobody", "/sys/nobody"):
        code, wrong = asked([*line, "--out", path])
        tries.note("places", f"{name}, {path}", code, wrong or ("" if code else "wrote where it cannot"))
    mine = (where / "thesis" / "thesis.tex").read_text()
    tries.note("places", f"{name}, files of others", 0, "" if mine == "ten years" else "were changed")
    with nobody():
        for path in (where / "new", where / "empty"):
            code, wrong = asked([*line, "--out", str(path)])
            tries.note("no permission", name, code, wrong or ("" if code else "wrote where it may not"))


def pairs(tries: Tries, name: str, line: Sequence[str], here: Path, alone: dict[str, bytes]) -> None:
    out = here / f"pair-{name}"
    words = [sys.executable, "-m", "vibroswarm", *line, "--out", str(out)]
    both = [
        subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) for _ in "ab"
    ]
    for process in both:
        try:
            told = process.communicate(timeout=LONGEST_S)[1]
        except subprocess.TimeoutExpired:
            process.kill()
            told = process.communicate()[1]
        tries.note("two at once", name, process.returncode, wrong_in(process.returncode, told))
    code, wrong = (0, "") if out.is_file() else equal_after(line, out, alone)
    if not wrong and tables_in(out) != alone:
        wrong = "other tables than alone"
    tries.note("after two", name, code, wrong)


def sizes(tries: Tries, here: Path) -> None:
    with (here / "vast.csv").open("wb") as stream:
        stream.truncate(2**40)
    with contextlib.chdir(here):
        resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, resource.getrlimit(resource.RLIMIT_DATA)[1]))
        for line in ABSURD:
            words = [sys.executable, "-m", "vibroswarm", *line]
            try:
                done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
            except subprocess.TimeoutExpired:
                tries.note("absurd sizes", " ".join(line)[:80], -1, "no answer in a minute")
                continue
            code, wrong = done.returncode, wrong_in(done.returncode, done.stderr)
            tries.note("absurd sizes", " ".join(line)[:80], code, wrong)


def main_() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", default=[], help="only these commands; 'sizes': absurd sizes")
    parser.add_argument("--runs", type=int, default=20)
    options = parser.parse_args()
    tries = Tries()
    with tempfile.TemporaryDirectory(prefix="places-") as name:
        here = Path(name)
        here.chmod(0o755)
        for command, line in commands(here, options.runs).items():
            if options.only and command not in options.only:
                continue
            out = here / f"alone-{command}"
            code, wrong = asked([*line, "--out", str(out)])
            if code:
                raise SystemExit(f"{command}, undisturbed: exit code {code}: {wrong}")
            alone = tables_in(out)
            full_disk(tries, command, line, here, alone)
            places(tries, command, line, here)
            pairs(tries, command, line, here, alone)
            shutil.rmtree(out, ignore_errors=True)
            print(f"{command}: done", flush=True)
        if not options.only or "sizes" in options.only:
            sizes(tries, here)
        return 0 if tries.say() else 1


if __name__ == "__main__":
    sys.exit(main_())
