"""Plan a study: which cells share motion, which share observations, and in which batches they run.

Cells with the same motion (see ``simulation.OF_MOTION``) make a group. The motion of a group is simulated once, its
samples are observed once for each floor and sensor, and each strategy is replayed on these readings. If cells differ
only in ``run.t_end_s``, the longest motion is simulated, and the other cells use its beginning.

If the runs of a cell end when all robots have decided, or if its strategy steers, the motion depends on the decisions.
Such a cell shares its motion only with cells that have an equal scenario.

The runs of a group are divided into blocks whose bounds do not depend on the number of runs: small ones first, so that
a short study keeps all workers busy, then larger ones, so that a long study has few files. A batch is a block, or the
part of a block that is not stored yet.

Workers get scenarios as TOML text. Scenarios are cached by their text, so that a text written in the same process is
not parsed again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import OF_MOTION, OF_OBSERVATION, steers
from vibroswarm.study.spec import Cell, Study

MOST: Final = 4096
"""Most scenarios in the cache; it is emptied when it is full."""
_known: dict[str, Scenario] = {}
"""The cache: scenarios by their TOML text."""


def text_of(scenario: Scenario) -> str:
    """Write a scenario as TOML, and cache the scenario, so that ``scenario_of`` need not parse the text."""
    text = scenario.to_toml()
    _remember(text, scenario)
    return text


def scenario_of(text: str) -> Scenario:
    """Return the scenario that a TOML text describes, from the cache if it is there."""
    scenario = _known.get(text)
    if scenario is None:
        scenario = Scenario.from_toml(text)
        _remember(text, scenario)
    return scenario


def _remember(text: str, scenario: Scenario) -> None:
    """Cache a scenario by its text."""
    if len(_known) >= MOST:
        _known.clear()
    _known[text] = scenario


Texts = tuple[tuple[tuple[str, tuple[int, ...]], ...], ...]
"""``Group.observed`` in plain values.

It has an entry for each floor, sensor and end of the runs, the longest runs first. An entry has a pair for each
different scenario: the scenario as TOML, and the numbers of the cells that have it.
"""

Range = tuple[int, int]
"""First run, and one past the last."""

FIRST_RUNS: Final = 10
"""Least number of runs in the first blocks of a group, if its source of motion is as fast as the event engine."""
FIRST_ROBOTS: Final = 200
"""Robots of all runs of a first block; a run of the event engine takes about 0.2 ms for each."""
MOST_ROWS: Final = 100_000
"""Most rows of a block; a worker needs about 1 kB of memory per row."""
BLOCKS_OF_A_SIZE: Final = 32
"""After this many blocks of a size, the size doubles, up to ``MOST_ROWS``."""
STANDING_MS: Final = 1000.0
"""Typical time that a robot stands for a sample, ms; added to the sample interval, which alone may be 0."""


def samples_of_run(scenario: Scenario) -> float:
    """Return about how many samples all robots of a run take, at least 1."""
    sample_ms = scenario.sample.sample_interval_ms + STANDING_MS
    return max(scenario.swarm.robots * scenario.run.t_end_s * 1000.0 / sample_ms, 1.0)


@dataclass(frozen=True)
class Group:
    """Cells that share motion.

    ``observed`` has an entry for each floor, sensor and end of the runs, the longest runs first. An entry has a tuple
    of cells for each different scenario: one cell, or several with equal scenarios.
    """

    number: int
    """Number of the group in its study, from 0."""
    observed: tuple[tuple[tuple[Cell, ...], ...], ...]
    """Cells by floor, sensor and end of the runs, and then by scenario."""
    is_slow: bool
    """Whether the source of motion takes far longer than the event engine: then a block is one run."""

    @property
    def first(self) -> Scenario:
        """A scenario with the longest runs of the group; all cells share what determines motion, such as the robots."""
        entry_of_longest_runs, *_ = self.observed
        equal_cells, *_ = entry_of_longest_runs
        return equal_cells[0].scenario

    @cached_property
    def cells(self) -> tuple[Cell, ...]:
        """All cells in the order of their numbers."""
        found = (cell for entry in self.observed for equal_cells in entry for cell in equal_cells)
        return tuple(sorted(found, key=lambda cell: cell.number))

    @property
    def inferences(self) -> int:
        """Number of replays for one run of the group: one for each different scenario."""
        return sum(len(entry) for entry in self.observed)

    @cached_property
    def texts(self) -> Texts:
        """``observed`` as plain values: each scenario as TOML, and the numbers of its cells."""
        return tuple(
            tuple(
                (text_of(equal_cells[0].scenario), tuple(cell.number for cell in equal_cells))
                for equal_cells in entry
            )
            for entry in self.observed
        )

    @cached_property
    def block(self) -> int:
        """Number of runs in each of the group's first blocks: few, so that a short study keeps all workers busy."""
        if self.is_slow:
            return 1
        # If a strategy steers, the engine stops after each control period, which takes long.
        runs = FIRST_RUNS if steers(self.first) else max(FIRST_ROBOTS // self.first.swarm.robots, FIRST_RUNS)
        return max(min(runs, MOST_ROWS // self.rows), 1)

    @property
    def rows(self) -> int:
        """Number of stored rows for one run: one for each cell and robot."""
        return len(self.cells) * self.first.swarm.robots

    def blocks(self, low: int, high: int) -> Iterator[tuple[int, int, int]]:
        """Divide the runs ``low`` to ``high`` - 1 into the parts that belong to one block each.

        Yields: number of the block, first run of the part, one past its last run.
        """
        # Blocks are always counted from run 0, so that their bounds do not depend on ``low`` and ``high``.
        first, size, number = 0, self.block, 0
        while first < high:
            if first + size > low:
                yield number, max(first, low), min(first + size, high)
            first, number = first + size, number + 1
            may_double = not self.is_slow and 2 * size * self.rows <= MOST_ROWS
            if number % BLOCKS_OF_A_SIZE == 0 and may_double:
                size *= 2


@dataclass(frozen=True)
class Plan:
    """The groups of a study."""

    study: Study
    groups: tuple[Group, ...]
    """In the order of their numbers; each cell of the study is in one group."""

    @property
    def observations(self) -> int:
        """Number of observations of one run, over all groups."""
        return sum(len(group.observed) for group in self.groups)

    @property
    def inferences(self) -> int:
        """Number of replays of one run, over all groups."""
        return sum(group.inferences for group in self.groups)


def plan_of(study: Study) -> Plan:
    """Return the plan of a study; it is cached in the study object, so that a second call does not make it again."""
    known: Plan | None = vars(study).get("_plan")
    if known is not None:
        return known
    # Cells by three nested keys: one of the fields that determine the motion, one of the fields that determine the
    # readings, and the hash of the whole scenario.
    motions: dict[str, dict[str, dict[str, list[Cell]]]] = {}
    for cell in study.cells:
        scenario_hash = cell.hash
        motion = _motion_key(cell.scenario)
        if cell.scenario.run.stop == "all_decided" or steers(cell.scenario):
            motion = scenario_hash  # shared by equal scenarios only, since decisions change the motion
        observed = motions.setdefault(motion, {}).setdefault(_key(cell.scenario, OF_OBSERVATION), {})
        observed.setdefault(scenario_hash, []).append(cell)
    groups, is_slow = [], study.motion == "mujoco"
    for number, observations in enumerate(motions.values()):
        entries = [
            tuple(tuple(equal_cells) for equal_cells in inferences.values())
            for inferences in observations.values()
        ]
        # The longest runs come first: their motion is simulated, and shorter runs use its beginning. All cells of an
        # entry have the same t_end_s, which is one of the fields that determine the readings.
        entries.sort(key=lambda entry: -entry[0][0].scenario.run.t_end_s)
        groups.append(Group(number=number, observed=tuple(entries), is_slow=is_slow))
    plan = Plan(study, tuple(groups))
    object.__setattr__(study, "_plan", plan)  # as a frozen dataclass, it refuses ``study._plan = plan``
    return plan


def missing(wanted: Range, there: Iterable[Range]) -> list[Range]:
    """List the parts of the range ``wanted`` that no range in ``there`` covers, in order.

    Ranges are pairs of the first run and one past the last; those in ``there`` may overlap.
    """
    begin, end = wanted
    gaps, low = [], begin  # each wanted run below ``low`` is either covered or listed in ``gaps``
    for first, last in sorted(there):
        if first > low:
            gaps.append((low, min(first, end)))
        low = max(low, last)
        if low >= end:
            break
    return [*gaps, (low, end)] if low < end else gaps


def _motion_key(scenario: Scenario) -> str:
    """Return a key of the motion: scenarios with equal keys have the same motion until the shorter one ends."""
    others = _key(scenario, [section for section in OF_MOTION if section != "run"])
    return f"{others}\n{scenario.run.model_dump_json(exclude={'t_end_s'})}"


def _key(scenario: Scenario, sections: Sequence[str]) -> str:
    """Return a text that is equal for scenarios with equal sections of these names."""
    return "\n".join(getattr(scenario, section).model_dump_json() for section in sections)
