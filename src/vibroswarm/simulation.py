"""Simulation of a scenario to a result, and replay of a result: motion, observation and inference in sequence."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from importlib.metadata import version

import polars as pl

import vibroswarm.motion.event.event_run
import vibroswarm.motion.fixed_step
import vibroswarm.motion.physics.wheels_run  # noqa: F401  (these make themselves known as sources)
from vibroswarm.core.jit import source_hash
from vibroswarm.core.rng import SEED_LIMIT
from vibroswarm.errors import InputError, RunError, shown, whole_number_of
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.agents import strategy_used
from vibroswarm.inference.closed_loop import steered_motion, until_all_decided
from vibroswarm.inference.deliveries import Timeline, needs_moves, timeline_of
from vibroswarm.inference.outcomes import outcome_tables, with_shares
from vibroswarm.inference.replay import infer
from vibroswarm.localisation.locate import is_estimated, place_frame
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.motion.pose import poses_of
from vibroswarm.motion.source import moved
from vibroswarm.observation.decision_boundary import readings_boundary
from vibroswarm.observation.observe import observe
from vibroswarm.result import Result, change_frame, floor_frame
from vibroswarm.scenario import plugins
from vibroswarm.scenario.fault_draws import fault_frame
from vibroswarm.scenario.scenario import Scenario

Progress = Callable[[float], None]
"""Called now and then with the share of the work done, in [0, 1]."""


def simulate(
    scenario: Scenario,
    seed: int = 1,
    runs: int | Iterable[int] = 1,
    *,
    motion: str = "event",
    poses: bool = False,
    moves: bool = False,
    energies: bool = True,
    progress: Progress | None = None,
) -> Result:
    """Simulate runs of a scenario: motion, observation, messages, beliefs and decisions.

    Args:
        scenario: what is to be simulated.
        seed: a whole number in [0, 2^63). The same scenario, seed and run number give the same result, bit by bit.
        runs: number of runs (they are numbered from 0), or a list of run numbers.
        motion: name of the source of motion.
        poses: whether the result shall have the table ``poses``, with a row for each robot and control tick.
        moves: whether it shall have the table ``moves``, with a row for each drive, turn, avoidance and stop; it has
            this table in any case if the network or localisation reads it.
        energies: whether it shall have the energies of the samples.
        progress: called with the share of the motion that is simulated; the readings and beliefs are computed after it.
    Raises:
        InputError: the seed or a run number is out of range, the source of motion is unknown, the code of a strategy,
            network or task is not loaded, or readings cannot be tested against the decision boundary.
        RunError: this process was forked from one that has simulated.
    """
    if _first_process() != os.getpid():
        raise RunError("a fork has none of polars' threads, and would wait forever; start processes by spawn")
    check_scenario(scenario)
    seed, chosen = check_seed(seed), check_runs(seed, runs)
    motion = plugins.resolve_code("motion", motion) if plugins.is_code(motion) else motion
    # These two calls refuse scenarios that cannot be simulated before any work is done.
    readings_boundary(scenario)
    strategy_used(scenario)
    floors = floors_of(scenario, seed, chosen)
    moves = moves or needs_moves(scenario)
    if by_decisions := motion_by_decisions(scenario):
        motions = by_decisions(scenario, seed, chosen, floors, motion, moves or poses, progress)
    else:
        motions = moved(motion, scenario, seed, chosen, moves or poses, progress)
    observations = observe(scenario, seed, motions.samples, floors, energies=energies)
    timeline = timeline_of(scenario, motions)
    inference, finals, reports = infer(scenario, seed, timeline, observations)
    places = places_of(scenario, seed, timeline)
    made = result_of(
        scenario, seed, floors, motions, observations, inference, finals, motion, places, reports
    )
    if poses and motions.moves is not None:  # a user's source may have no moves
        made = replace(made, poses=poses_of(motions.moves, motions.ends, scenario.run.control_period_ms))
    return made if moves else replace(made, moves=None)


@cache
def _first_process() -> int:
    """Return the number of the process that simulated first: this one, or one that it was forked from."""
    return os.getpid()


def motion_by_decisions(scenario: Scenario) -> Callable[..., Motion] | None:
    """Return what simulates motion that depends on decisions, called as ``steered_motion`` is; None: it does not."""
    if steers(scenario):
        return steered_motion
    return until_all_decided if scenario.run.stop == "all_decided" else None


OF_MOTION = ("arena", "swarm", "robot", "motion_rays", "walk", "sample", "run", "motion_faults")
"""Sections that determine motion; a replay cannot change them (``motion_rays``, ``motion_faults``: the parts of
``rays`` and ``faults`` that do)."""
OF_OBSERVATION = (*OF_MOTION, "floor", "change", "sensor", "faults")
"""Sections that determine what the sensors read."""


def replay(result: Result, scenario: Scenario) -> Result:
    """Replay the motion of a result under another scenario: another floor, sensor, strategy, decision or network.

    The new result is the same as that of simulating ``scenario``, and both have exactly the same motion, so they can be
    compared run by run. If floor, sensor and faults stay the same, the readings do too.

    Args:
        result: simulated runs that all lasted to ``run.t_end_s``, whose strategy does not steer; with moves, if the new
            network or localisation reads them.
        scenario: may differ from the result's scenario in all sections that do not determine motion (``OF_MOTION``).
    Raises:
        InputError: the result was recorded or lacks moves that are needed, ``scenario`` would move the robots in
            another way, the strategy of either steers or is a user's that is not loaded, the network or task of
            ``scenario`` is not loaded, readings cannot be tested against its decision boundary, or the runs ended when
            all robots had decided.
    """
    check_scenario(scenario)
    if result.seed is None:
        raise InputError("was recorded: what its robots read cannot be drawn again", field="result")
    for section in OF_MOTION:
        if getattr(scenario, section) != getattr(result.scenario, section):
            raise InputError("a replay keeps the motion, and so this section as it was", field=section)
    if scenario.run.stop != "t_end":  # true of the result too: both have the same section ``run``
        raise InputError("these runs ended when all had decided; their motion is cut short", field="run.stop")
    if steers(scenario) or steers(result.scenario):
        raise InputError(
            "steers its robots, and a replay keeps their motion; simulate it instead", field="strategy"
        )
    seed = result.seed
    runs = result.runs["run"].to_list()
    motion = Motion(
        samples=result.motion,
        ends=result.ends,
        moves=result.moves,
        failures=result.failures,
    )
    observations = result.observations
    floors = {run: result.floor(run) for run in runs}
    if any(getattr(scenario, section) != getattr(result.scenario, section) for section in OF_OBSERVATION):
        floors = floors_of(scenario, seed, runs)
        # The new result has energies if the given one has.
        energies = observations["energy"].null_count() < observations.height
        observations = observe(scenario, seed, result.motion, floors, energies=energies)
    timeline = timeline_of(scenario, motion)
    inference, finals, reports = infer(scenario, seed, timeline, observations)
    places = places_of(scenario, seed, timeline)
    made = result_of(
        scenario, seed, floors, motion, observations, inference, finals, result.source, places, reports
    )
    return replace(made, poses=result.poses)


def places_of(scenario: Scenario, seed: int, timeline: Timeline) -> pl.DataFrame | None:
    """Return the table of places where robots believe they sampled, or None if they know their places."""
    if not is_estimated(scenario):
        return None
    return place_frame(timeline.samples, timeline.estimates(scenario, seed))


MAX_RUNS = 100_000_000
"""Runs of one call: far more than memory holds, few enough to list their numbers."""


def check_runs(seed: int, runs: int | Iterable[int]) -> list[int]:
    """Check seed and runs as given to ``simulate``, and return the run numbers as a sorted list."""
    check_seed(seed)
    # A number of runs. Texts and floats come here too, so that ``whole_number_of`` refuses them with a clear message.
    if isinstance(runs, str | bytes | float) or not isinstance(runs, Iterable):
        return list(range(whole_number_of(runs, "runs", 1, MAX_RUNS)))
    numbers = list(runs)
    chosen = sorted({whole_number_of(run, "runs", 0, 2**32 - 1) for run in numbers})
    if not chosen or len(chosen) != len(numbers):
        raise InputError("give distinct whole numbers from 0 to 2^32 - 1, at least one", field="runs")
    return chosen


def check_seed(seed: int) -> int:
    """Check a seed, and return it as a Python integer."""
    return whole_number_of(seed, "seed", 0, SEED_LIMIT - 1)


def check_scenario(scenario: object) -> None:
    """Refuse what is not a ``Scenario``, and scenarios that need a user's code file that is not loaded."""
    if not isinstance(scenario, Scenario):
        raise InputError(
            f"{shown(scenario)} is not a Scenario; make one with preset('paper') or Scenario.read(file)",
            field="scenario",
        )


def floors_of(scenario: Scenario, seed: int, runs: Sequence[int]) -> dict[int, Floor]:
    """Return the floor of each run, by run number; one object for all unless floors are drawn for each run."""
    if scenario.floor.drawn_by_run or (scenario.floor.redraw == "run" and scenario.change.is_random):
        return {run: scenario.floor_for(seed, run) for run in runs}
    return dict.fromkeys(runs, scenario.floor_for(seed, 0))


def steers(scenario: Scenario) -> bool:
    """Return whether a scenario's strategy steers the robots."""
    return scenario.strategy.entry.steer is not None


def result_of(
    scenario: Scenario,
    seed: int,
    floors: Mapping[int, Floor],
    motion: Motion,
    observations: pl.DataFrame,
    inference: pl.DataFrame,
    finals: pl.DataFrame,
    source_name: str,
    places: pl.DataFrame | None = None,
    reports: pl.DataFrame | None = None,
) -> Result:
    """Assemble all tables into a result, and compute the outcomes of robots and runs."""
    robots, of_runs = outcome_tables(scenario, floors, finals, motion.ends)
    return Result(
        scenario=scenario,
        seed=seed,
        motion=motion.samples,
        ends=motion.ends,
        moves=motion.moves,
        failures=motion.failures,
        places=places,
        reports=reports,
        observations=observations,
        inference=inference,
        robots=with_shares(robots, motion.samples),
        runs=of_runs,
        floors=floor_frame(floors),
        changes=change_frame(floors),
        faults=fault_frame(scenario, seed, of_runs["run"].to_list(), of_runs["end_s"].to_numpy()),
        source=source_name,
        versions=versions(),
    )


@cache
def versions() -> dict[str, str]:
    """Return the versions of the software behind a result, the kind of processor and the code hash."""
    packages = ("vibroswarm", "numpy", "numba", "scipy", "polars")
    return {
        **{name: version(name) for name in packages},
        "python": platform.python_version(),
        "architecture": _architecture(),
        "system": platform.system(),
        "code": source_hash(),
    }


def _architecture() -> str:
    """Return processor and vector instructions of NumPy's exp, on which last bits depend."""
    try:
        from numpy.lib.introspect import opt_func_info
    except ImportError:  # NumPy before 2.1
        return platform.machine()
    used = opt_func_info(func_name="^exp$", signature="float64")
    levels = sorted({str(one["current"]) for of_types in used.values() for one in of_types.values()})
    return " ".join([platform.machine(), *levels])
