"""A study killed at random moments and gone on with gives the same tables, bit by bit: the long check.

    python benchmarks/kills.py [--kills 50] [--seed 1] [--folder DIR]

Two studies, one with a number of runs and one until a precision, each by threads and by processes. Each is begun again
and again, and killed (SIGKILL) at a random moment: at times while it starts, mostly while batches are being done and
written. At last it is let finish. Then all its tables are compared with those of a study that was left alone, and its
store is looked through: no shard may be damaged, and no process may be left.
"""

from __future__ import annotations

import argparse
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from vibroswarm.study.precision import Precision
from vibroswarm.study.result import StudyResult
from vibroswarm.study.spec import Study

BASE = {"run": {"t_end_s": 120.0}, "decision": {"min_observations": 5}}
GRID = {
    "swarm.robots": [2, 4],
    "floor.source": ["random:0.44", "diagonal:0.46"],
    "strategy.name": ["none", "positive"],
}
SCRIPT = """
import sys
from vibroswarm.study.spec import Study

if __name__ == "__main__":
    Study.read(sys.argv[1]).run(sys.argv[2], executor=sys.argv[3], workers=2)
"""


def studies(runs: int) -> dict[str, Study]:
    """What is killed."""
    return {
        "so many runs": Study(BASE, {"grid": GRID}, runs, seed=5),
        "until a precision": Study(BASE, {"grid": GRID}, None, Precision(0.012, max_runs=runs), seed=5),
    }


def shards(folder: Path) -> int:
    return len(list((folder / "shards").glob("*.json")))


def kill_once(line: Sequence[str], folder: Path, dice: random.Random, sessions: set[int]) -> tuple[bool, int]:
    """Begin, kill after a while; gives whether it was alive to be killed, and how many batches it had added."""
    before, early = shards(folder), dice.random() < 0.1
    process = subprocess.Popen(line, start_new_session=True)
    sessions.add(process.pid)
    if early:  # at some moment of its start
        time.sleep(dice.random() * 2.0)
    else:
        while process.poll() is None and shards(folder) == before:
            time.sleep(0.001)
        time.sleep(dice.random() ** 2 * 0.5)
    alive = process.poll() is None
    process.kill()
    process.wait()
    return alive, shards(folder) - before


def still_there(sessions: set[int]) -> int:
    """Processes of these sessions that live."""
    count = 0
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, _, _, session, *_ = path.read_text().rpartition(")")[2].split()
            count += int(session) in sessions and state != "Z"
    return count


def check(name: str, study: Study, executor: str, kills: int, folder: Path, dice: random.Random) -> bool:
    """One study killed so many times; says what was found."""
    alone = (
        study.run(folder / "alone", workers=1)
        if not (folder / "alone").exists()
        else StudyResult.open(folder / "alone")
    )
    file, script, out = folder / "study.toml", folder / "study.py", folder / executor
    file.write_text(study.to_toml())
    script.write_text(SCRIPT)
    line = [sys.executable, str(script), str(file), str(out), executor]
    hit, added, sessions = 0, 0, set[int]()
    while hit < kills:
        alive, more = kill_once(line, out, dice, sessions)
        hit, added = hit + alive, added + more
        if not alive:  # it was done before it was hit: take something away, as a disk that fails does
            for path in dice.sample(sorted((out / "shards").glob("*.parquet")), k=shards(out) // 2):
                path.unlink()
    left_over = StudyResult.open(out).store.left_over
    subprocess.run(line, check=True)
    mine = StudyResult.open(out)
    same = all(a.equals(b, null_equal=True) for a, b in zip(tables(mine), tables(alone), strict=True))
    time.sleep(3.0)
    alive_still = still_there(sessions)
    good = same and mine.store.damaged == [] and mine.store.failures == [] and not alive_still
    print(
        f"{name}, {executor}: killed {hit} times while at work, {added} batches added by those, {left_over} files left "
        f"half-written and passed over, {len(mine.store.shards)} shards at the end, {len(mine.store.damaged)} damaged, "
        f"{alive_still} processes left; tables {'the same, bit by bit' if same else 'DIFFER'}",
        flush=True,
    )
    return good


def tables(result: StudyResult) -> list[object]:
    return [result.robots(), result.runs(), result.cells]


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=50, help="in all (default 50)")
    parser.add_argument("--runs", type=int, default=6000, help="of each cell (default 6000)")
    parser.add_argument("--seed", type=int, default=1, help="of the moments")
    options = parser.parse_args()
    dice, good = random.Random(options.seed), True
    each = -(-options.kills // 4)
    with tempfile.TemporaryDirectory(prefix="kills-") as folder:
        for k, (name, study) in enumerate(studies(options.runs).items()):
            place = Path(folder) / str(k)
            place.mkdir()
            for executor in ("threads", "processes"):
                good &= check(name, study, executor, each, place, dice)
    print("good" if good else "FAILED")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
