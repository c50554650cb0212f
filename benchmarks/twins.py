"""Whether two engines differ by an error or by rounding: the fixed-step engine beside itself, moved by its last bits.

A scenario in which rounding grows, by a turn controller that swings or by bodies that just touch, has no one account
of a run: two runs of one engine part as well, one of which began with every robot a unit in the last place (ulp) beside
where it was, or a wheel as much faster. Such a ``Twin`` that parts from the run about as early as the other engine
did, says that rounding suffices. If none does, the difference is an error of an engine.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.motion.event.event_run import EventRun
from vibroswarm.motion.fixed_step import FixedStepRun
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.motion_tables import Sink, joined
from vibroswarm.scenario.scenario import Scenario

EVENTS = ("robot", "sample", "stop_tick", "tick", "drive", "turn", "avoid", "stop")
MICROMETRE = 1e-6
LATER = 2.0
"""A twin explains a difference up to so many times as early as its own: it may begin with less rounding."""


class Difference(NamedTuple):
    """Two runs compared."""

    run: int
    first_s: float | None
    """Time of the first sample that differs, s; None: none does, to the end."""
    apart_m: float
    """The largest distance between the two positions of a sample, before the first difference."""
    samples: int

    @property
    def same(self) -> bool:
        """Whether all events are the same, and positions to a micrometre."""
        return self.first_s is None and self.apart_m <= MICROMETRE


class Twin(NamedTuple):
    """What is moved, of the robots or of the scenario's numbers, and by how many ulps."""

    of: str
    name: str
    ulps: int
    signs: int
    """Which robots are moved up and which down: a seed. Were all moved alike, bodies would touch as before."""


TWINS = [
    Twin(of, name, ulps, signs)
    for ulps in (1, 64, 4096)
    for signs in range(4)
    for of, name in (
        ("robots", "heading_rad"), ("robots", "x_m"), ("robots", "y_m"),
        ("numbers", "full_speed_m_s"), ("numbers", "turn_track_m"),
    )
]  # fmt: skip
"""In the order in which they are tried. 4096 ulps of numbers about 1 are some 10^-12, less than both engines round."""


class Verdict(NamedTuple):
    """What a comparison of the engines says of a scenario."""

    found: Difference
    twin: Twin | None
    """The first twin that parts as well."""

    @property
    def is_error(self) -> bool:
        """Whether the engines differ, and rounding does not explain it."""
        return not self.found.same and self.twin is None


class Rows(NamedTuple):
    """The rows of a run."""

    samples: NDArray[np.void]
    ends: NDArray[np.void]


def begun(engine: type[KernelRun], scenario: Scenario, seed: int, run: int) -> KernelRun:
    """A run of an engine at time 0."""
    state = engine(scenario)
    state.begin(seed, run)
    return state


def rows_of(state: KernelRun) -> Rows:
    """All rows of a run."""
    taken = [state.record.samples[:0]]
    sink = Sink(lambda rows: taken.append(joined([rows])))
    state.advance(state.scenario.ticks, sink)
    return Rows(joined(taken), state.finish(sink))


def judge(scenario: Scenario, seed: int, run: int) -> Verdict:
    """Both engines on one run; where they differ, twins of the fixed-step engine beside it."""
    stepped, jumped = (rows_of(begun(engine, scenario, seed, run)) for engine in (FixedStepRun, EventRun))
    found = difference(run, stepped, jumped, scenario.tick_s)
    if found.same:
        return Verdict(found, None)
    explains = (twin for twin in TWINS if parts(scenario, seed, run, stepped, found, twin))
    return Verdict(found, next(explains, None))


def parts(scenario: Scenario, seed: int, run: int, stepped: Rows, found: Difference, twin: Twin) -> bool:
    """Whether a twin differs from the run it is one of in what ``found`` says, about as early."""
    other = difference(run, stepped, moved(scenario, seed, run, twin), scenario.tick_s)
    if found.first_s is None:
        return other.first_s is not None or other.apart_m > MICROMETRE
    return other.first_s is not None and other.first_s <= LATER * found.first_s


def moved(scenario: Scenario, seed: int, run: int, twin: Twin) -> Rows:
    """A run of the fixed-step engine that begins a few ulps beside."""
    state = begun(FixedStepRun, scenario, seed, run)
    if twin.of == "robots":
        rows, count = state.swarm, scenario.swarm.robots
    else:
        rows, count = state.setup.copy(), 1
        state.setup = rows
    up = (
        np.random.default_rng(twin.signs).integers(2, size=count) == 1
        if twin.of == "robots"
        else twin.signs % 2
    )
    towards = np.where(up, np.inf, -np.inf)
    for _ in range(twin.ulps * (1 + twin.signs // 2)):
        rows[twin.name] = np.nextafter(rows[twin.name], towards)
    return rows_of(state)


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
