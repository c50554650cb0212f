"""A study of many runs goes through, and its memory does not grow with them: the long check.

    python benchmarks/many_runs.py [--runs 100000] [--cells 10] [--t-end 1200] [--robots 5] [--workers 2] [--out DIR]

Cells that share motion: strategies and thresholds on floors drawn anew. The runs are done, then summed up cell by cell
(``study.outcome.outcome_of``), each in a process of its own whose resident memory is looked at ten times a second. Said
are its peak over time, part by part of the work, the rate, and what the store takes on disk.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from vibroswarm.scenario.scenario import preset
from vibroswarm.study.spec import Study

RUN = """
import sys
from vibroswarm.study.spec import Study
Study.read(sys.argv[1]).run(sys.argv[2], workers=int(sys.argv[3]))
"""
SUM = """
import sys
from vibroswarm.study.summary import outcome_of
from vibroswarm.study.study_result import StudyResult
outcome = outcome_of(StudyResult.open(sys.argv[2]))
print(outcome.table.height, "cells summed up")
"""
PARTS = 10


def study_of(cells: int, runs: int, robots: int, t_end_s: float) -> Study:
    """``cells`` cells that share motion."""
    base = preset("paper").with_values(
        {
            "swarm.robots": robots,
            "run.t_end_s": t_end_s,
            "decision.min_observations": max(int(t_end_s / 24), 1),
        }
    )
    thresholds = [round(0.90 + 0.01 * k, 2) for k in range(-(-cells // 2))]
    grid = {"strategy.name": ["none", "soft"], "decision.credible_threshold": thresholds}
    return Study(base, {"grid": grid}, runs)


def resident_mb(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def watched(code: str, *arguments: str) -> tuple[list[float], float, float]:
    """Run code in a process of its own; gives its resident memory over time (MB), its time and CPU time (s)."""
    began_s, seen = time.monotonic(), []
    before = os.times()
    process = subprocess.Popen([sys.executable, "-c", code, *arguments])
    while process.poll() is None:
        try:
            seen.append(resident_mb(process.pid))
        except (OSError, IndexError):
            break
        time.sleep(0.1)
    if process.wait() != 0:
        raise SystemExit(f"failed with {process.returncode}")
    after = os.times()
    cpu_s = after.children_user + after.children_system - before.children_user - before.children_system
    return seen, time.monotonic() - began_s, cpu_s


def peaks(seen: list[float]) -> str:
    """The peak of each tenth of the time."""
    size = max(-(-len(seen) // PARTS), 1)
    return " ".join(f"{max(seen[k : k + size]):.0f}" for k in range(0, len(seen), size))


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=100_000, help="of each cell (default 100000)")
    parser.add_argument("--cells", type=int, default=10)
    parser.add_argument("--robots", type=int, default=5)
    parser.add_argument("--t-end", type=float, default=1200.0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    study = study_of(options.cells, options.runs, options.robots, options.t_end)
    with tempfile.TemporaryDirectory(prefix="many-") as folder:
        file, out = Path(folder) / "study.toml", options.out or Path(folder) / "out"
        file.write_text(study.to_toml())
        total = len(study.cells) * options.runs
        print(f"{len(study.cells)} cells of {options.runs:,} runs: {total:,} runs", flush=True)
        for what, code in (("running", RUN), ("summing up", SUM)):
            seen, wall_s, cpu_s = watched(code, str(file), str(out), str(options.workers))
            print(
                f"{what}: {wall_s:.0f} s, {cpu_s:.0f} s of CPU, {total / cpu_s:,.0f} runs a CPU second; resident MB, "
                f"the peak of each tenth of the time: {peaks(seen)}",
                flush=True,
            )
        size = sum(path.stat().st_size for path in (out / "shards").iterdir())
        count = len(list((out / "shards").glob("*.json")))
        print(
            json.dumps({"shards": count, "MB": round(size / 1e6, 1), "bytes a run": round(size / total, 1)})
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
