"""Plan a study: which cells share motion, which share observations, and in which batches they run.

Cells with the same motion (see ``simulation.OF_MOTION``) make a group. The motion of a group is simulated once, its
samples are observed once for each floor and sensor, and each strategy is replayed on these readings. If cells differ
only in ``run.t_end_s``, the longest motion is simulated, and the other cells use its beginning.

If the runs of a cell end when all robots have decided, or if its strategy steers, the motion depends on the decisions.
Such a cell shares its motion only with cells that have an equal scenario. A cell with user code (strategy, network or
task) shares its motion only with cells that use the same code, so that no batch of other cells is lost if this code
fails.

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

from vibroswarm.motion.source import robot_s_of
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
"""Number of runs from which the size of a group's first blocks is found by doubling and halving."""
FIRST_BLOCK_S: Final = 0.1
"""Longest duration to which the first blocks of a group with at most ``MANY_CELLS`` cells are doubled, s."""
MANY_CELLS: Final = 20
"""A group with more cells has first blocks whose duration grows with the number of cells."""
CELL_S: Final = 0.02
"""Longest duration to which the first blocks of a group with more cells are doubled, s per cell. A block costs about
0.1 ms per cell besides its runs."""
LARGEST_BLOCK_S: Final = 10.0
"""Longest estimated duration of a block, s."""
MOST_ROWS: Final = 100_000
"""Most rows of a block; a worker needs about 1 kB of memory per row."""
BLOCKS_OF_A_SIZE: Final = 32
"""After this many blocks of a size, the size doubles, up to the limits of a block."""
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
    robot_s: float
    """Time that the study's source of motion takes for a robot of one run of 1200 s, s (``Source.robot_s``)."""

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
        """Number of runs in each of the group's first blocks, from the estimated duration of a run (``run_s``).

        It is doubled from ``FIRST_RUNS`` as long as a block stays short, and then halved until a block keeps the limits
        of time and rows. Short first blocks keep all workers busy in a short study.
        """
        # With many cells a block takes time besides its runs (``CELL_S``), so its runs should take much longer.
        short_s = CELL_S * len(self.cells) if len(self.cells) > MANY_CELLS else FIRST_BLOCK_S
        runs = FIRST_RUNS
        while 2 * runs * self.run_s <= short_s:
            runs *= 2
        while runs > 1 and (runs * self.rows > MOST_ROWS or runs * self.run_s > LARGEST_BLOCK_S):
            runs //= 2
        return runs

    @property
    def rows(self) -> int:
        """Number of stored rows for one run: one for each cell and robot."""
        return len(self.cells) * self.first.swarm.robots

    @cached_property
    def run_s(self) -> float:
        """Estimated time on one core for one run of all cells, s, from measured constants; no result depends on it."""
        # The constants, in s, were measured in runs of 1200 s and are scaled to the length of this group's runs.
        robots, length = self.first.swarm.robots, self.first.run.t_end_s / 1200.0
        # A robot takes longer among many robots: the factor grows with their number up to 4, at 30 robots.
        motion = self.robot_s * robots * (1 + robots / 10 if robots <= 30 else 4)
        if steers(self.first):  # then the engine stops after each control period
            motion += 0.2 * robots
        observing_and_replaying = robots * (1e-5 * len(self.observed) + 3e-6 * self.inferences)
        # A strategy that reads places weighs each message of each robot by where its sender was.
        scenarios = (equal_cells[0].scenario for entry in self.observed for equal_cells in entry)
        heard = sum(robots * samples_of_run(one) for one in scenarios if one.strategy.reads_places)
        # The first two terms, of the run and of each replay, do not depend on the length of the run.
        return 5e-4 + 4e-5 * self.inferences + length * (motion + observing_and_replaying) + 5e-6 * heard

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
            may_double = 2 * size * self.run_s <= LARGEST_BLOCK_S and 2 * size * self.rows <= MOST_ROWS
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
        elif codes := cell.scenario.codes:
            motion = "\n".join([motion, *codes])  # if this code fails, no batch of other cells is lost
        observed = motions.setdefault(motion, {}).setdefault(_key(cell.scenario, OF_OBSERVATION), {})
        observed.setdefault(scenario_hash, []).append(cell)
    groups = []
    for number, observations in enumerate(motions.values()):
        entries = [
            tuple(tuple(equal_cells) for equal_cells in inferences.values())
            for inferences in observations.values()
        ]
        # The longest runs come first: their motion is simulated, and shorter runs use its beginning. All cells of an
        # entry have the same t_end_s, which is one of the fields that determine the readings.
        entries.sort(key=lambda entry: -entry[0][0].scenario.run.t_end_s)
        groups.append(Group(number=number, observed=tuple(entries), robot_s=robot_s_of(study.motion)))
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
