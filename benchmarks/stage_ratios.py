"""CPU time of every stage and strategy, relative to a fixed piece of work: shows a loss of speed when it is made.

    python benchmarks/stage_ratios.py [--write] [--json]

The fixed piece of work (``fixed_work``) belongs to no part of vibroswarm and never changes, so a ratio to it changes
only with our code, and a little with compiler and processor. Each timing is taken directly after one of the fixed
work, and the median of these ratios is compared with the one in ``stage_ratios.csv``, which ``--write`` replaces.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, Final

import numba
import polars as pl
from numpy.typing import NDArray

from stage_timing import SEED, cpu_model, scenario_of
from vibroswarm.cli.deliver import print_report
from vibroswarm.inference.deliveries import Timeline, timeline_of
from vibroswarm.inference.replay import replay_to_end
from vibroswarm.localisation.locate import locate
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.motion.source import moved as motion_of
from vibroswarm.observation.observe import observe
from vibroswarm.report.report import Report, Table
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import floors_of
from vibroswarm.strategies import known

RECORDED: Final = Path(__file__).with_suffix(".csv")
"""The ratios to compare with, and the processor on which they were taken."""
TURNS: Final = 9
"""Timings of each task, after one that warms up."""
LOSS: Final = 0.1
"""A ratio that has grown by more than this share is marked."""
MOTIONS: Final = {5: 16, 10: 8, 100: 4}
"""Number of robots, and of runs that are timed at once."""
RUNS: Final = 16
"""Runs of the other stages that are timed at once."""
KINDS: Final = {"sensor.model": "confusion", "task.name": "majority", "floor.source": "random:0.4,0.36,0.24"}
"""Fields of the scenario for strategies that decide which kind of tile is most common."""
ROUNDS: Final = 1_000_000
"""Length of the fixed work: some 10 ms."""


@dataclass(frozen=True)
class Ratio:
    """The cost of one task."""

    work: str
    cpu_ms_a_run: float
    ratio: float
    """CPU time of a run relative to the fixed work."""
    least: float
    most: float
    """Smallest and largest ratio of a turn."""


@numba.njit
def fixed_work(rounds: int) -> float:
    """Do what kernels mostly do: mix integers, and take branches, roots and quotients that depend on them."""
    state, total = 88172645463325252, 0.0
    for _ in range(rounds):
        state ^= (state << 13) & 0xFFFFFFFFFFFFFFF
        state ^= state >> 7
        state ^= (state << 17) & 0xFFFFFFFFFFFFFFF
        share = (state & 0xFFFFF) / 1048576.0
        if share < 0.5:
            total += math.sqrt(share + total * total)
        elif share < 0.75:
            total = total / (1.0 + share)
        else:
            total -= share
    return total


def tasks() -> Iterable[tuple[str, int, Callable[[], object]]]:
    """Yield the tasks: what each does, how many runs at once, and the call that does it."""
    for robots, runs in MOTIONS.items():
        moving = scenario_of(robots)
        yield (
            f"motion, {robots} robots",
            runs,
            partial(motion_of, "event", moving, SEED, range(runs)),
        )
    scenario = scenario_of(5)
    located = scenario.with_values({"strategy.name": "places"})
    chosen = range(RUNS)
    floors = floors_of(scenario, SEED, chosen)
    motion = motion_of("event", scenario, SEED, chosen, True)
    yield "observation", RUNS, partial(observe, scenario, SEED, motion.samples, floors, energies=False)
    shaken = scenario.with_values({"sensor.model": "acceleration"})
    yield (
        "observation, acceleration",
        RUNS,
        partial(observe, shaken, SEED, motion.samples, floors, energies=True),
    )
    yield "localisation", RUNS, partial(locate, located, SEED, motion)
    kinds = scenario.with_values({"strategy.name": "dirichlet"} | KINDS)
    two, three = inferred(scenario, motion), inferred(kinds, motion)
    for name, one in known().items():
        timeline, read = three if one.answers_kinds else two
        decided = (kinds if one.answers_kinds else scenario).with_values({"strategy.name": name})
        # The timeline caches what does not depend on the strategy's own program, such as estimated places.
        yield f"inference, {name}", RUNS, partial(replay_to_end, decided, SEED, timeline, read)


def inferred(scenario: Scenario, motion: Motion) -> tuple[Timeline, NDArray[Any]]:
    """Return what strategies of this scenario are replayed from: the timeline, and the class of each reading."""
    floors = floors_of(scenario, SEED, range(RUNS))
    seen = observe(scenario, SEED, motion.samples, floors, energies=False)
    return timeline_of(scenario, motion), seen["observation"].to_numpy()


def measure(chosen: Iterable[tuple[str, int, Callable[[], object]]], turns: int = TURNS) -> list[Ratio]:
    """Time each task ``turns`` times, each time directly after the fixed work."""
    fixed_work(1)  # compiled here
    ratios = []
    for work, runs, call in chosen:
        call()  # compiles, and fills caches
        times_ms, relative = [], []
        for _ in range(turns):
            fixed_ms = cpu_ms(partial(fixed_work, ROUNDS))
            times_ms.append(cpu_ms(call) / runs)
            relative.append(times_ms[-1] / fixed_ms)
        ratios.append(Ratio(work, median(times_ms), median(relative), min(relative), max(relative)))
    return ratios


def cpu_ms(call: Callable[[], object]) -> float:
    """Return the CPU time of a call, ms, of all threads of this process."""
    began_ns = time.process_time_ns()
    call()
    return max(time.process_time_ns() - began_ns, 1) / 1e6


def recorded() -> dict[str, float]:
    """Return the recorded ratios by task; empty if none are recorded."""
    if not RECORDED.is_file():
        return {}
    table = pl.read_csv(RECORDED)
    return dict(zip(table["work"], table["ratio"], strict=True))


def write(ratios: Sequence[Ratio]) -> None:
    """Record these ratios."""
    table = pl.DataFrame({"work": [each.work for each in ratios], "ratio": [each.ratio for each in ratios]})
    table.with_columns(pl.col("ratio").round_sig_figs(3), cpu=pl.lit(cpu_model())).write_csv(RECORDED)


def compared(ratios: Sequence[Ratio], before: dict[str, float]) -> list[dict[str, Any]]:
    """Return each ratio with the recorded one, the change, and whether it is a loss; None where none is recorded."""
    rows = []
    for each in ratios:
        old = before.get(each.work)
        change = None if old is None else each.ratio / old - 1.0
        is_loss = change is not None and change > LOSS
        rows.append({**asdict(each), "recorded": old, "change": change, "is_loss": is_loss})
    return rows


def print_ratios(rows: Sequence[dict[str, Any]]) -> None:
    """Print the table, and below it which tasks have become slower."""
    words = (
        f"CPU time of a run relative to a fixed piece of work; medians of {TURNS} turns, in which each timing follows "
        f"one of the fixed work. {cpu_model()}"
    )
    columns = ("work", "cpu_ms_a_run", "ratio", "least", "most", "recorded", "change", "is_loss")
    frame = pl.DataFrame(rows, infer_schema_length=None).select(columns)
    frame = frame.rename({"least": "ratio_low", "most": "ratio_high", "change": "change_share"})
    slower = [row["work"] for row in rows if row["is_loss"]]
    loss = (f"Slower by more than {100 * LOSS:.0f} %: {', '.join(slower)}.",) if slower else ()
    print_report(Report("Ratios", (words, *loss), {"ratios": Table(frame)}))


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, and print or record the ratios."""
    parser = argparse.ArgumentParser(
        description="Compare CPU times of all stages and strategies with a fixed piece of work. Takes a minute, and "
        "two more to compile.",
        allow_abbrev=False,
    )
    parser.add_argument("--write", action="store_true", help=f"record the ratios in {RECORDED.name}")
    parser.add_argument("--json", action="store_true", help="print JSON and nothing else on stdout")
    chosen = parser.parse_args(arguments)
    ratios = measure(tasks())
    rows = compared(ratios, recorded())
    if chosen.json:
        print(json.dumps({"cpu": cpu_model(), "ratios": rows}, indent=2))
    else:
        print_ratios(rows)
    if chosen.write:
        write(ratios)
    return 0


if __name__ == "__main__":
    sys.exit(main())
