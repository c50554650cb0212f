"""What a table of moves costs beside motion without: at most 1.3 times the time.

    python benchmarks/moves_cost.py [--runs 100] [--repeats 7] [--robots 5 10] [--most 1.3]

Batches of runs of the preset ``paper`` by the event-driven engine, in one process and by turns with moves and without;
the ratio is that of the least times, which other work on the machine disturbs least, and of the medians. Exits with 1
if the ratio of the least times is above ``--most``.

Measured on two cores of a shared virtual machine (load 1.0 to 1.4), time a run, least of 7; the first of three times:

| robots | moves a run | without moves | with moves | ratio (least) | ratio (median) |
|---|---|---|---|---|---|
| 5 | 4138 | 1020 us | 1287 us | 1.26 | 1.26 |
| 10 | 8914 | 3431 us | 4131 us | 1.20 | 1.20 |
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time

from vibroswarm.motion.event.event_run import EVENT
from vibroswarm.scenario.scenario import Scenario, preset


def batch_us(scenario: Scenario, runs: int, moves: bool) -> tuple[float, float]:
    """Time a run, us, and moves a run."""
    began_s = time.perf_counter()
    motion = EVENT.batch(scenario, 1, range(runs), moves=moves)
    spent_s = time.perf_counter() - began_s
    return 1e6 * spent_s / runs, motion.moves.height / runs if motion.moves is not None else 0.0


def main() -> int:
    """Measure and print a row of the table above for each number of robots."""
    parser = argparse.ArgumentParser(description="What a table of moves costs.")
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--robots", type=int, nargs="+", default=[5, 10])
    parser.add_argument("--most", type=float, default=1.3)
    asked = parser.parse_args()
    worst = 0.0
    for robots in asked.robots:
        scenario = preset("paper").with_values({"swarm.robots": robots})
        for moves in (False, True):  # compiled, and memory that is used again
            batch_us(scenario, asked.runs, moves)
        spent: dict[bool, list[float]] = {False: [], True: []}
        count = 0.0
        for _ in range(asked.repeats):
            for moves in (False, True):
                us, count = batch_us(scenario, asked.runs, moves)
                spent[moves].append(us)
        least, median = ({k: f(v) for k, v in spent.items()} for f in (min, statistics.median))
        ratio = least[True] / least[False]
        worst = max(worst, ratio)
        print(
            f"| {robots} | {count:.0f} | {least[False]:.0f} us | {least[True]:.0f} us"
            f" | {ratio:.2f} | {median[True] / median[False]:.2f} |"
        )
    return int(worst > asked.most)


if __name__ == "__main__":
    sys.exit(main())
