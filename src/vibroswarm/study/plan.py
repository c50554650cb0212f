"""Plan a study: which cells share motion, which share observations, and in which batches they run.

Cells with the same motion (see ``simulation.OF_MOTION``) make a group; its motion runs once, is observed once for each
floor and sensor, and replayed for each strategy. Of cells that differ only in ``run.t_end_s``, the longest motion runs,
and the others use its beginning. Motion is not shared by runs that end when all robots have decided, nor by cells whose
strategy, network or task is user code, which may fail.

The runs of a group are divided into blocks whose bounds do not depend on the number of runs: small ones first, so that
a short study keeps all workers busy, then larger ones, so that a long study has few files. A batch is a block, or what
is missing of it.

Workers get scenarios as text; parsed scenarios are cached, so that text written here is not parsed again.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from vibroswarm import strategies
from vibroswarm.motion.source import robot_s_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import OF_MOTION, OF_OBSERVATION
from vibroswarm.study.spec import Cell, Study

MOST: Final = 4096
"""Size of the cache of scenarios."""
_known: dict[str, Scenario] = {}


def text_of(scenario: Scenario) -> str:
    """Write a scenario as TOML."""
    text = scenario.to_toml()
    _remember(text, scenario)
    return text


def scenario_of(text: str) -> Scenario:
    """Parse a scenario from its TOML."""
    scenario = _known.get(text)
    if scenario is None:
        scenario = Scenario.from_toml(text)
        _remember(text, scenario)
    return scenario


def _remember(text: str, scenario: Scenario) -> None:
    if len(_known) >= MOST:
        _known.clear()
    _known[text] = scenario


Texts = tuple[tuple[tuple[str, tuple[int, ...]], ...], ...]

Range = tuple[int, int]
"""First run, and one past the last."""

FIRST_BLOCK_S: Final = 0.1
MANY_CELLS: Final = 20
CELL_S: Final = 0.02
"""Duration of the first blocks of a larger group, s per cell: a block costs about 0.1 ms per cell besides its runs."""
LARGEST_BLOCK_S: Final = 10.0
MOST_ROWS: Final = 100_000
"""Most rows of a block; a worker needs about 1 kB a row."""
BLOCKS_OF_A_SIZE: Final = 32


@dataclass(frozen=True)
class Group:
    """Cells that share motion.

    ``observed`` has an entry for each floor, sensor and end of the runs, the longest runs first. An entry has a tuple
    of cells for each different scenario: one cell, or several equal ones.
    """

    number: int
    observed: tuple[tuple[tuple[Cell, ...], ...], ...]
    robot_s: float
    """``Source.robot_s`` of the study's source of motion."""

    @property
    def first(self) -> Scenario:
        """A scenario of this motion."""
        return self.observed[0][0][0].scenario

    @property
    def cells(self) -> tuple[Cell, ...]:
        """All cells in the order of their numbers."""
        return tuple(sorted((c for o in self.observed for i in o for c in i), key=lambda c: c.number))

    @property
    def inferences(self) -> int:
        """Number of replays for one run."""
        return sum(len(observed) for observed in self.observed)

    @cached_property
    def texts(self) -> Texts:
        """``observed`` as plain values: each scenario as TOML, and the numbers of its cells."""
        return tuple(
            tuple((text_of(same[0].scenario), tuple(cell.number for cell in same)) for same in inferences)
            for inferences in self.observed
        )

    @cached_property
    def block(self) -> int:
        """Number of runs in the first batches, so that one takes a suitable time and memory."""
        size, many = 10, len(self.cells) > MANY_CELLS
        while 2 * size * self.run_s <= (CELL_S * len(self.cells) if many else FIRST_BLOCK_S):
            size *= 2
        while size > 1 and (size * self.rows > MOST_ROWS or size * self.run_s > LARGEST_BLOCK_S):
            size //= 2
        return size

    @property
    def rows(self) -> int:
        """Rows of a run in the store."""
        return len(self.cells) * self.first.swarm.robots

    @property
    def run_s(self) -> float:
        """Rough time of a run on one core, s; only the size of batches depends on it."""
        robots, share = self.first.swarm.robots, self.first.run.t_end_s / 1200.0
        motion = self.robot_s * robots * (1 + robots / 10 if robots <= 30 else 4)
        each = robots * (1e-5 * len(self.observed) + 3e-6 * self.inferences)
        return 5e-4 + 4e-5 * self.inferences + share * (motion + each)

    def blocks(self, low: int, high: int) -> Iterator[tuple[int, int, int]]:
        """Yield blocks that overlap runs ``low`` to ``high``, cut off there: number, first run, one past the last."""
        first, size, count = 0, self.block, 0
        while first < high:
            if first + size > low:
                yield count, max(first, low), min(first + size, high)
            first, count = first + size, count + 1
            larger = 2 * size * self.run_s <= LARGEST_BLOCK_S and 2 * size * self.rows <= MOST_ROWS
            if count % BLOCKS_OF_A_SIZE == 0 and larger:
                size *= 2


@dataclass(frozen=True)
class Plan:
    """The groups of a study."""

    study: Study
    groups: tuple[Group, ...]

    @property
    def observations(self) -> int:
        """Number of observations of one run, over all groups."""
        return sum(len(group.observed) for group in self.groups)

    @property
    def inferences(self) -> int:
        """Number of replays of one run, over all groups."""
        return sum(group.inferences for group in self.groups)


def plan_of(study: Study) -> Plan:
    """Plan a study; the plan is cached with it."""
    known: Plan | None = vars(study).get("_plan")
    if known is not None:
        return known
    motions: dict[str, dict[str, dict[str, list[Cell]]]] = {}
    for cell in study.cells:
        deciding = cell.scenario.hash
        motion = _moving(cell.scenario)
        if cell.scenario.run.stop == "all_decided" or steers(cell.scenario):
            motion = deciding
        elif codes := cell.scenario.codes:
            motion = "\n".join([motion, *codes])  # where these fail, no batch of the others is lost
        observed = motions.setdefault(motion, {}).setdefault(_key(cell.scenario, OF_OBSERVATION), {})
        observed.setdefault(deciding, []).append(cell)
    groups = []
    for number, observations in enumerate(motions.values()):
        seen = [tuple(tuple(same) for same in inferences.values()) for inferences in observations.values()]
        seen.sort(key=lambda inferences: -inferences[0][0].scenario.run.t_end_s)  # the longest moves first
        groups.append(Group(number, tuple(seen), robot_s_of(study.motion)))
    plan = Plan(study, tuple(groups))
    object.__setattr__(study, "_plan", plan)  # a study does not change
    return plan


def missing(wanted: Range, there: Iterable[Range]) -> list[Range]:
    """List the parts of a range that no existing range covers, in order."""
    gaps, low = [], wanted[0]
    for first, last in sorted(there):
        if first > low:
            gaps.append((low, min(first, wanted[1])))
        low = max(low, last)
        if low >= wanted[1]:
            break
    return [*gaps, (low, wanted[1])] if low < wanted[1] else gaps


def steers(scenario: Scenario) -> bool:
    """Tell whether a scenario's strategy steers the robots; False if its code is not loaded."""
    known = strategies.known().get(scenario.strategy.name)
    return known is not None and known.steer is not None


def _moving(scenario: Scenario) -> str:
    """Make a key that is equal for scenarios whose robots move alike until the earlier end."""
    others = _key(scenario, [section for section in OF_MOTION if section != "run"])
    return f"{others}\n{scenario.run.model_dump_json(exclude={'t_end_s'})}"


def _key(scenario: Scenario, sections: Sequence[str]) -> str:
    return "\n".join(getattr(scenario, section).model_dump_json() for section in sections)
