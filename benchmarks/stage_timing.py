"""CPU time of motion (both engines), observation and inference, compared with the fixed-step engine.

    python benchmarks/stage_timing.py [--robots 5,10,100,1000] [--runs 16] [--json]

Compared tasks alternate (A B A B ...), so that a change of machine speed affects all of them; ratios are taken turn
by turn. CPU time is that of the whole process with all its threads.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import polars as pl

from vibroswarm.cli import deliver
from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.replay import infer, replay_to_end
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.motion.source import moved as motion_of
from vibroswarm.observation.observe import observe
from vibroswarm.report import report
from vibroswarm.report.report import Table
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import floors_of, versions

PRESET = "paper-empirical"
SEED = 1
TURNS = 7
"""Timed repetitions of each task, after one that warms up."""
ROBOTS = (5, 10, 100, 1000)
RUNS = 16
ARENA_ROBOTS = 20
"""At most this many robots walk in the paper's arena of 1 m x 1 m for 1200 s."""


@dataclass(frozen=True)
class Figure:
    """The measurements of one task."""

    work: str
    robots: int
    side_m: float
    simulated_s: float
    """Simulated time of a run."""
    times_ms: tuple[float, ...]
    """CPU time per run, ms, for each turn."""
    yardstick: float | None = None
    """Speed relative to the fixed-step engine; None: not motion."""

    @property
    def median_ms(self) -> float:
        """Median CPU time per run, ms."""
        return median(self.times_ms)

    @property
    def speed(self) -> float:
        """Simulated seconds per CPU second."""
        return 1000.0 * self.simulated_s / self.median_ms

    @property
    def robot_second_us(self) -> float:
        """CPU time per robot and simulated second, microseconds."""
        return 1e6 / (self.speed * self.robots)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON, with units in the names."""
        return {
            "work": self.work,
            "robots": self.robots,
            "arena_side_m": self.side_m,
            "simulated_s_a_run": self.simulated_s,
            "cpu_ms_a_run": self.median_ms,
            "cpu_ms_a_run_least": min(self.times_ms),
            "cpu_ms_a_run_most": max(self.times_ms),
            "simulated_s_per_cpu_s": self.speed,
            "cpu_us_a_robot_second": self.robot_second_us,
            "ratio_to_fixed_step": self.yardstick,
        }


@dataclass(frozen=True)
class Report:
    """All measurements, how they were made and on what."""

    figures: tuple[Figure, ...]
    grid_ratio: float
    """CPU time of 34 strategies (3; soft with 8 eta x 4 kappa) on one motion, relative to one with its motion."""
    runs: int
    how: str
    machine: dict[str, Any]
    versions: dict[str, str]

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "preset": PRESET,
            "turns": TURNS,
            "runs_a_turn": self.runs,
            "how": self.how,
            "machine": self.machine,
            "versions": self.versions,
            "figures": [figure.as_dict() for figure in self.figures],
            "grid_of_34_strategies_ratio": self.grid_ratio,
        }


class Work(NamedTuple):
    """A task to time: ``call(turn)`` does ``runs`` runs of ``simulated_s`` each."""

    name: str
    runs: int
    simulated_s: float
    call: Callable[[int], object]


def measure(robots: Sequence[int] = ROBOTS, runs: int = RUNS) -> Report:
    """Measure motion for each number of robots, then observation and inference with the first of them.

    Args:
        runs: per turn, for up to 10 robots; fewer for more.
    """
    scenarios = [scenario_of(count) for count in robots]
    if max(robots) > ARENA_ROBOTS:
        scenarios.append(scenario_of(10, 1.4))  # reference for the cost of a robot-second
    figures: list[Figure] = []
    for scenario in scenarios:
        figures += compared(scenario, engines(scenario, runs))
    stages, grid_ratio = stages_of(scenario_of(robots[0]), runs)
    return Report(
        figures=(*figures, *stages),
        grid_ratio=grid_ratio,
        runs=runs,
        how=how(runs),
        machine=machine(),
        versions=dict(versions()),
    )


def scenario_of(robots: int, side_m: float | None = None) -> Scenario:
    """Preset paper-empirical; above 20 robots with 5 per square metre and a shorter run."""
    if side_m is None:
        side_m = 1.0 if robots <= ARENA_ROBOTS else round(2.0 * math.sqrt(robots / 5.0)) / 2.0
    end_s = 1200.0 if robots <= ARENA_ROBOTS else max(1.0, round(12_000.0 / robots))
    values = {"swarm.robots": robots, "arena.width_m": side_m, "arena.height_m": side_m, "run.t_end_s": end_s}
    return preset(PRESET).with_values(values)


def engines(scenario: Scenario, runs: int) -> list[Work]:
    """Both engines, over the same runs."""
    some = max(1, min(runs, runs * 10 // scenario.swarm.robots))

    def moved(name: str, turn: int) -> Motion:
        return motion_of(name, scenario, SEED, range(turn * some, (turn + 1) * some))

    end_s = scenario.run.t_end_s
    return [Work(name, some, end_s, partial(moved, name)) for name in ("event", "fixed-step")]


def in_turns(works: Sequence[Work]) -> list[tuple[float, ...]]:
    """CPU time per run of each task, ms, for each turn."""
    times_ms: list[list[float]] = [[] for _ in works]
    for turn in range(TURNS + 1):
        for work, times in zip(works, times_ms, strict=True):
            began_ns = time.process_time_ns()
            work.call(turn)
            times.append(max(time.process_time_ns() - began_ns, 1) / 1e6 / work.runs)
    return [tuple(times[1:]) for times in times_ms]  # the first turn compiles and fills caches


def compared(scenario: Scenario, works: Sequence[Work]) -> list[Figure]:
    """Figures of motion tasks, one of which is the fixed-step engine."""
    times_ms = in_turns(works)
    at = next(k for k, work in enumerate(works) if work.name == "fixed-step")
    yard_ms = [time_ms / works[at].simulated_s for time_ms in times_ms[at]]
    return [
        Figure(
            work.name, scenario.swarm.robots, scenario.arena.width_m, work.simulated_s, times,
            median(yard / (time_ms / work.simulated_s) for yard, time_ms in zip(yard_ms, times, strict=True)),
        )
        for work, times in zip(works, times_ms, strict=True)
    ]  # fmt: skip


def stages_of(scenario: Scenario, runs: int) -> tuple[list[Figure], float]:
    """Figures of observation and inference on the event engine's motion, and the cost of a grid of strategies."""
    chosen = range(runs)
    floors = floors_of(scenario, SEED, chosen)
    motion = motion_of("event", scenario, SEED, chosen)
    timeline = timeline_of(scenario, motion)
    seen = observe(scenario, SEED, motion.samples, floors, energies=False)

    def whole(variants: Sequence[Scenario], turn: int) -> None:
        moved = motion_of("event", scenario, SEED, chosen)
        bits = observe(scenario, SEED, moved.samples, floors, energies=False)
        heard = timeline_of(scenario, moved)
        for variant in variants:
            replay_to_end(variant, SEED, heard, bits["observation"].to_numpy())

    soft, grid = scenario.with_values({"strategy.name": "soft"}), strategies(scenario)
    calls: dict[str, Callable[[int], object]] = {
        "observation": lambda turn: observe(scenario, SEED, motion.samples, floors, energies=False),
        "inference, every sample": lambda turn: infer(soft, SEED, motion, seen),
        "inference, outcomes only": lambda turn: replay_to_end(
            soft, SEED, timeline, seen["observation"].to_numpy()
        ),
        "motion and 1 strategy": partial(whole, [soft]),
        "motion and 34 strategies": partial(whole, grid),
    }
    end_s = scenario.run.t_end_s
    times_ms = in_turns([Work(name, runs, end_s, call) for name, call in calls.items()])
    figures = [
        Figure(name, scenario.swarm.robots, scenario.arena.width_m, end_s, times)
        for name, times in zip(calls, times_ms, strict=True)
    ]
    one, many = times_ms[-2:]
    return figures, median(all_ms / one_ms for one_ms, all_ms in zip(one, many, strict=True))


def strategies(scenario: Scenario) -> list[Scenario]:
    """No feedback, positive feedback, and soft feedback with 8 eta x 4 kappa."""
    soft: list[dict[str, Any]] = [
        {
            "strategy.name": "soft",
            "strategy.soft.eta": 250.0 * (1 + eta),
            "strategy.soft.kappa": 0.5 * (1 + kappa),
        }
        for eta in range(8)
        for kappa in range(4)
    ]
    return [
        scenario.with_values(values)
        for values in [{"strategy.name": "none"}, {"strategy.name": "positive"}, *soft]
    ]


def how(runs: int) -> str:
    """The method of measurement, as text."""
    return (
        f"CPU time of one process with all its threads (time.process_time), after a warm-up; {TURNS} turns of "
        f"up to {runs} runs, in which the engines alternate over the same runs; includes making the tables; ratios are "
        f"medians over turns. Inference uses soft feedback, {runs} runs at a time: every sample, from the motion table "
        "to its own table; outcomes only, as in a study, from what all strategies on one motion share to the tables of "
        "robots and runs."
    )


def machine() -> dict[str, Any]:
    """The machine."""
    return {
        "cpu": cpu_model(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
    }


def cpu_model() -> str:
    """The processor's name, if the system reports it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    for line in lines:
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def print_report(report: Report) -> None:
    """Print versions, machine, method and figures."""
    machine, versions = report.machine, report.versions
    packages = ", ".join(f"{name} {versions[name]}" for name in ("python", "numpy", "numba", "polars"))
    print(f"vibroswarm {versions['vibroswarm']} (code {versions['code']}), {packages}")
    print(f"{machine['cpu']}, {machine['cores']} cores, {machine['system']}")
    print(report.how)
    for _, group in groupby(
        report.figures, key=lambda figure: (figure.robots, figure.side_m, figure.yardstick is None)
    ):
        print()
        print_figures(list(group))
    print(
        f"\n34 strategies (3; soft with 8 eta x 4 kappa) on one motion cost {report.grid_ratio:.2f} times as much as "
        "one strategy with its motion"
    )


def print_figures(figures: list[Figure]) -> None:
    """Print the figures of one swarm as a table."""
    first = figures[0]
    is_motion = first.yardstick is not None
    robots = f"{first.robots} robot{'' if first.robots == 1 else 's'}"
    rows = [
        {
            "work": figure.work,
            "simulated s": figure.simulated_s,
            "run_ms": figure.median_ms,
            "run_ms_low": min(figure.times_ms),
            "run_ms_high": max(figure.times_ms),
            "s per CPU s": figure.speed,
            "us per robot-s": figure.robot_second_us,
            "x fixed-step": figure.yardstick,
        }
        for figure in figures
    ]
    frame = pl.DataFrame(rows, infer_schema_length=None)
    words = f"{'motion' if is_motion else 'stages'}, {robots} in {first.side_m:g} m x {first.side_m:g} m"
    table = Table(frame if is_motion else frame.drop("x fixed-step"))
    deliver.print_report(report.Report("Figures", (words,), {"figures": table}))


def count_of(text: str, most: int) -> int:
    """Read a whole number from 1 to ``most``."""
    if not (text.isdecimal() and 1 <= int(text) <= most):
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 1 to {most}")
    return int(text)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and report."""
    parser = argparse.ArgumentParser(
        description="Measure CPU time of the stages; takes about 30 s.", allow_abbrev=False
    )
    parser.add_argument(
        "--robots",
        metavar="N,N",
        type=lambda text: tuple(count_of(one, 10_000) for one in text.split(",")),
        default=ROBOTS,
        help="numbers of robots (default 5,10,100,1000)",
    )
    parser.add_argument(
        "--runs",
        metavar="N",
        type=lambda text: count_of(text, 100_000),
        default=RUNS,
        help=f"runs per turn; more give steadier figures (default {RUNS})",
    )
    parser.add_argument("--json", action="store_true", help="print JSON and nothing else on stdout")
    chosen = parser.parse_args(arguments)
    report = measure(chosen.robots, chosen.runs)
    if chosen.json:
        print(json.dumps(report.as_dict(), indent=2))
    else:
        print_report(report)
    return 0


if __name__ == "__main__":
    sys.exit(main())
