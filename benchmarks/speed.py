"""CPU time of what users run, in turns with another version: ``python benchmarks/speed.py --with OTHER/bin/python``.

Each turn runs every task once in a process of either version, which has run it before to compile; ratios are those of
the least CPU times of all turns, with those of single turns beside them. On a busy machine they scatter by a tenth.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable

from vibroswarm import preset, simulate
from vibroswarm.scenario.scenario import Scenario


def scenario_of(robots: int, **values: object) -> Scenario:
    """As many robots on as much floor each as twenty on a square metre, or five in the paper's arena."""
    side_m = max(1.0, (robots / 20) ** 0.5)
    base = {"swarm.robots": robots, "arena.width_m": side_m, "arena.height_m": side_m}
    return preset("paper-empirical").with_values(base | {k.replace("__", "."): v for k, v in values.items()})


TASKS: dict[str, Callable[[], object]] = {
    "5 robots": lambda: simulate(scenario_of(5), 1, 100),
    "5 robots, soft, with moves": lambda: simulate(scenario_of(5, strategy__name="soft"), 1, 60, moves=True),
    "10 robots": lambda: simulate(scenario_of(10), 1, 60),
    "100 robots under loss": lambda: simulate(scenario_of(100, network__name="loss"), 1, 2),
    "places": lambda: simulate(scenario_of(5, strategy__name="places"), 1, 30),
}


def measured() -> dict[str, float]:
    """CPU time of each task, s, the second time that it runs."""
    times = {}
    for name, task in TASKS.items():
        task()
        start = time.process_time()
        task()
        times[name] = time.process_time() - start
    return times


def main() -> None:
    """Measure this version, or this and another in turns, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--with", dest="other", help="the other version's Python; without it, this one alone")
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--once", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.once:
        print(json.dumps(measured()))
        return
    versions = [python for python in (given.other, sys.executable) if python]
    found: dict[str, list[dict[str, float]]] = {python: [] for python in versions}
    for _ in range(given.turns):
        for python in versions:
            done = subprocess.run([python, __file__, "--once"], capture_output=True, text=True, check=True)
            found[python].append(json.loads(done.stdout))
    for name in TASKS:
        times = [[turn[name] for turn in found[python]] for python in versions]
        line = f"{name:28} {min(times[-1]):8.3f} s"
        if given.other:
            turns = " ".join(f"{now / before:.2f}" for before, now in zip(*times, strict=True))
            line += f"   ratio {min(times[1]) / min(times[0]):.2f} ({turns})"
        print(line)


if __name__ == "__main__":
    main()
