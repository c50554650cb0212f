"""Whether the event-driven engine takes the same events at the same ticks as the fixed-step engine: the long check.

    python benchmarks/exactness.py [--runs 1=10000 5=2000 10=500] [--processes 2] [--seed 21] [--preset paper-empirical]
    python benchmarks/exactness.py --random 3000 [--processes 2] [--seed 21]

Whole runs of 1200 s. Every sample's robot, number, ticks and time account must be equal
to the end of the run, and so must the number of samples and the ends; positions may differ by a micrometre. Exit
code 1 if a single robot's run differs, or positions do in a run whose events are the same. With several robots rounding
may decide whether two of them touch: such runs are counted, with the time of the first event that differs.

``--random N`` compares both engines in N scenarios that are drawn as widely as a scenario allows
(``random_scenarios``). Where they differ, the fixed-step engine is run beside itself, moved by its last bits
(``twins``): if that parts as well, rounding suffices and the scenario is listed as chaotic, with whether its turn
controller is stable; if it does not, one engine is wrong: ERROR, exit code 1. With NUMBA_BOUNDSCHECK=1, and an empty
folder in XDG_CACHE_HOME, every index of every array is checked too.
"""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

from random_scenarios import random_scenario
from twins import MICROMETRE, Difference, Verdict, difference, judge
from vibroswarm.motion.event.event_run import EventRun
from vibroswarm.motion.fixed_step import FixedStepRun
from vibroswarm.motion.robot_params import scenario_warnings
from vibroswarm.scenario.scenario import preset

CHUNK = 25


def main() -> int:
    options = parse()
    if options.random:
        return compare_random(options.random, options.seed, options.processes)
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
    parser.add_argument("--random", type=int, metavar="N", help="N random scenarios in place of whole runs")
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


def largest_m(found: list[Difference]) -> float:
    """The largest distance of positions in runs that do not differ in any event, m."""
    return max((one.apart_m for one in found if one.first_s is None), default=0.0)


def compare_random(count: int, seed: int, processes: int) -> int:
    """Both engines in so many random scenarios; 1 if they differ in one in which rounding does not explain it."""
    print(f"{count} random scenarios, seed {seed}: event-driven against fixed-step", flush=True)
    judge_random(seed, 0)
    spawn = multiprocessing.get_context("spawn")
    chaotic, wrong, samples, unstable = 0, 0, 0, 0
    with ProcessPoolExecutor(processes, mp_context=spawn) as pool:
        results = pool.map(partial(judge_random, seed), range(count), chunksize=CHUNK)
        for number, (verdict, swings) in enumerate(results):
            chaotic, wrong = chaotic + verdict.is_chaotic, wrong + verdict.is_error
            samples, unstable = samples + verdict.found.samples, unstable + swings
            if not verdict.found.same:
                print(line(number, verdict, swings), flush=True)
    print(
        f"{count - chaotic - wrong:,} of {count:,} scenarios ({samples:,} samples) identical in every event, and in "
        f"positions to a micrometre; {chaotic} chaotic, {wrong} WRONG; in {unstable} turns are not stable"
    )
    return 1 if wrong else 0


def judge_random(seed: int, number: int) -> tuple[Verdict, bool]:
    """What a comparison says of one scenario, and whether its turn controller is unstable."""
    scenario = random_scenario(seed, number)
    return judge(scenario, seed, number), bool(scenario_warnings(scenario))


def line(number: int, verdict: Verdict, swings: bool) -> str:
    """What is said of a scenario in which the engines differ."""
    found, twin = verdict.found, verdict.twin
    what = (
        f"positions by {found.apart_m:.2g} m" if found.first_s is None else f"from {found.first_s:.2f} s on"
    )
    turns = "turns are not stable" if swings else "turns are stable"
    if twin is None:
        return f"  ERROR: scenario {number} differs, {what}, and no twin does; {turns}"
    return (
        f"  scenario {number} is chaotic: {what}; so does a twin of {twin.ulps} ulps ({twin.name}); {turns}"
    )


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
