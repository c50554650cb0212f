"""Whether the event-driven engine takes the same events at the same ticks as the fixed-step engine: the long check.

    python benchmarks/exactness.py [--runs 1=10000 5=2000 10=500] [--processes 2] [--seed 21] [--preset paper-empirical]

Whole runs of 1200 s. Every sample's robot, number, ticks and time account must be equal
to the end of the run, and so must the number of samples and the ends; positions may differ by a micrometre. Exit
code 1 if a single robot's run differs, or positions do in a run whose events are the same. With several robots rounding
may decide whether two of them touch: such runs are counted, with the time of the first event that differs.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np

from vibroswarm.motion.event import EventRun
from vibroswarm.motion.fixed_step import FixedStepRun
from vibroswarm.motion.record import Rows
from vibroswarm.presets import preset

EVENTS = ("robot", "sample", "stop_tick", "tick", "drive", "turn", "avoid", "stop")
MICROMETRE = 1e-6
CHUNK = 25


class Difference(NamedTuple):
    """Two runs compared."""

    run: int
    first_s: float | None
    """Time of the first sample that differs, s; None: none does, to the end."""
    apart_m: float
    """The largest distance between the two positions of a sample, before the first difference."""
    samples: int


def main() -> int:
    options = parse()
    print(f"{options.preset}, 1200 s, seed {options.seed}: event-driven against fixed-step", flush=True)
    compare(options.preset, 1, options.seed, 0)  # compiled once, here, before the processes start
    spawn = multiprocessing.get_context("spawn")
    same = True
    with ProcessPoolExecutor(options.processes, mp_context=spawn) as pool:
        for robots, runs in options.runs:
            work = partial(compare, options.preset, robots, options.seed)
            found = list(told(pool.map(work, range(runs), chunksize=CHUNK), robots, runs))
            print(summary(robots, found), flush=True)
            same &= largest_m(found) <= MICROMETRE
            same &= robots > 1 or all(one.first_s is None for one in found)
    return 0 if same else 1


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--runs", type=robots_and_runs, nargs="+", default=[(1, 10_000), (5, 2_000), (10, 500)],
        metavar="ROBOTS=RUNS", help="how many runs of how many robots (default 1=10000 5=2000 10=500)",
    )  # fmt: skip
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--seed", type=int, default=21)
    parser.add_argument("--preset", default="paper-empirical")
    return parser.parse_args()


def robots_and_runs(text: str) -> tuple[int, int]:
    robots, _, runs = text.partition("=")
    if int(robots) < 1 or int(runs) < 1:
        raise ValueError(text)
    return int(robots), int(runs)


def compare(name: str, robots: int, seed: int, run: int) -> Difference:
    """One run by both engines."""
    scenario = preset(name).with_values({"swarm.robots": robots})
    end_s = scenario.run.t_end_s
    stepped = FixedStepRun(scenario, seed, run).rows(end_s)
    jumped = EventRun(scenario, seed, run).rows(end_s)
    return difference(run, stepped, jumped, scenario.tick_s)


def difference(run: int, stepped: Rows, jumped: Rows, tick_s: float) -> Difference:
    """When the first event differs, and how far apart the robots were until then."""
    a, b = stepped.samples, jumped.samples
    count = min(a.size, b.size)
    other = np.zeros(count, dtype=bool)
    for name in EVENTS:
        other |= a[name][:count] != b[name][:count]
    same = int(np.argmax(other)) if other.any() else count
    apart_m = farthest_m(a[:same], b[:same])
    if same < count or a.size != b.size:
        ticks = [int(rows["tick"][same]) for rows in (a, b) if same < rows.size]
        return Difference(run, min(ticks) * tick_s, apart_m, count)
    if (stepped.ends["stop_tick"] != jumped.ends["stop_tick"]).any():
        return Difference(run, float(stepped.ends["tick"][0]) * tick_s, apart_m, count)
    return Difference(run, None, max(apart_m, farthest_m(stepped.ends, jumped.ends)), count)


def farthest_m(a: np.ndarray, b: np.ndarray) -> float:
    apart_m = np.hypot(a["x_m"] - b["x_m"], a["y_m"] - b["y_m"])
    return float(apart_m.max(initial=0.0))


def largest_m(found: list[Difference]) -> float:
    """The largest distance of positions in runs that do not differ in any event, m."""
    return max((one.apart_m for one in found if one.first_s is None), default=0.0)


def told(results: Iterator[Difference], robots: int, runs: int) -> Iterator[Difference]:
    """The results, with a line on stderr now and then."""
    told_s = time.monotonic()
    for done, result in enumerate(results, start=1):
        if result.first_s is not None:
            print(f"  {robots} robots, run {result.run}: differs from {result.first_s:.2f} s on", flush=True)
        if time.monotonic() - told_s > 10.0:
            told_s = time.monotonic()
            print(f"  {robots} robots: {done} of {runs} runs", file=sys.stderr, flush=True)
        yield result


def summary(robots: int, found: list[Difference]) -> str:
    """What was found, in one paragraph."""
    from scipy.stats import binomtest

    runs = len(found)
    first_s = [one.first_s for one in found if one.first_s is not None]
    high = binomtest(len(first_s), runs).proportion_ci(method="wilson").high
    apart_m = largest_m(found)
    samples = sum(one.samples for one in found)
    lines = [
        f"{robots} robot{'s' * (robots > 1)}: {runs - len(first_s):,} of {runs:,} runs ({samples:,} samples) "
        f"identical in every event to the end; share that differs at most {100 * high:.3f} % (Wilson, 95 %)",
        f"  largest distance of positions in those {apart_m * 1e6:.2g} micrometres "
        f"({'within' if apart_m <= MICROMETRE else 'NOT within'} 1)",
    ]
    if first_s:
        lines.append(f"  median time of the first difference {float(np.median(first_s)):.1f} s")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
