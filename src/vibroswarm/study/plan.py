"""What must be done for a study: which cells share motion, which share observations, and in which batches.

Cells whose motion is the same (see ``simulation.OF_MOTION``) make a group; its motion runs once, is observed once for
each floor and sensor, and replayed for each strategy. Of cells that differ in ``run.t_end_s`` only, the longest motion
runs, and the others see its beginning. Runs that end when all have decided have a motion of their own, and so have
cells whose strategy, network or task is of a file of the user's, which may fail.

The runs of a group are cut into blocks whose bounds do not depend on how many runs are asked for: small ones first, so
that a short study keeps all workers busy, larger ones further on, so that a long one has not too many files. A batch is
one block, or what is missing of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from vibroswarm import strategies
from vibroswarm.scenario import Scenario
from vibroswarm.simulation import OF_MOTION
from vibroswarm.study.spec import Cell, Study
from vibroswarm.study.texts import text_of

Texts = tuple[tuple[tuple[str, tuple[int, ...]], ...], ...]

Range = tuple[int, int]
"""First run, and one past the last."""

OF_OBSERVATION: Final = (*OF_MOTION, "floor", "sensor")
FIRST_BLOCK_S: Final = 0.1
MANY_CELLS: Final = 20
CELL_S: Final = 0.02
"""Of the first blocks of a group of more cells than that, s a cell: each costs some 0.1 ms a block, beside its runs."""
LARGEST_BLOCK_S: Final = 10.0
MOST_ROWS: Final = 100_000
"""Rows of a block; a worker holds some 1 kB a row while it makes them."""
BLOCKS_OF_A_SIZE: Final = 32


@dataclass(frozen=True)
class Group:
    """Cells that share motion: for each floor, sensor and end, for each way to decide, the cells (equal ones together).

    Those that last longest come first.
    """

    number: int
    observed: tuple[tuple[tuple[Cell, ...], ...], ...]

    @property
    def first(self) -> Scenario:
        """A scenario of this motion."""
        return self.observed[0][0][0].scenario

    @property
    def cells(self) -> tuple[Cell, ...]:
        """All cells, by number."""
        return tuple(sorted((c for o in self.observed for i in o for c in i), key=lambda c: c.number))

    @property
    def inferences(self) -> int:
        """How often a strategy is replayed for one run."""
        return sum(len(observed) for observed in self.observed)

    @cached_property
    def texts(self) -> Texts:
        """``observed`` in plain values: each scenario as TOML, and the numbers of its cells."""
        return tuple(
            tuple((text_of(same[0].scenario), tuple(cell.number for cell in same)) for same in inferences)
            for inferences in self.observed
        )

    @cached_property
    def block(self) -> int:
        """Runs in the first blocks."""
        size, many = 10, len(self.cells) > MANY_CELLS
        while 2 * size * self.run_s <= (CELL_S * len(self.cells) if many else FIRST_BLOCK_S):
            size *= 2
        while size > 1 and size * self.rows > MOST_ROWS:
            size //= 2
        return size

    @property
    def rows(self) -> int:
        """Rows that a run leaves in the store."""
        return len(self.cells) * self.first.swarm.robots

    @property
    def run_s(self) -> float:
        """Time that a run roughly takes on one core, s; only the size of batches depends on it."""
        robots, share = self.first.swarm.robots, self.first.run.t_end_s / 1200.0
        motion = 0.15e-3 * robots * (1 + robots / 10 if robots <= 30 else 4)
        each = robots * (1e-5 * len(self.observed) + 3e-6 * self.inferences)
        return 5e-4 + 4e-5 * self.inferences + share * (motion + each)

    def blocks(self, low: int, high: int) -> Iterator[tuple[int, int, int]]:
        """The blocks that lie in or reach into runs ``low`` to ``high``, cut off there: number, first, past last."""
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
        """Observations of one run, over all groups."""
        return sum(len(group.observed) for group in self.groups)

    @property
    def inferences(self) -> int:
        """Replays of one run, over all groups."""
        return sum(group.inferences for group in self.groups)


def plan_of(study: Study) -> Plan:
    """Which cells of a study share what; worked out once for a study."""
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
    for number, found in enumerate(motions.values()):
        seen = [tuple(tuple(same) for same in inferences.values()) for inferences in found.values()]
        seen.sort(key=lambda inferences: -inferences[0][0].scenario.run.t_end_s)  # the longest moves first
        groups.append(Group(number, tuple(seen)))
    plan = Plan(study, tuple(groups))
    object.__setattr__(study, "_plan", plan)  # a study does not change
    return plan


def missing(wanted: Range, there: Iterable[Range]) -> list[Range]:
    """What is wanted and not there, in order."""
    gaps, low = [], wanted[0]
    for first, last in sorted(there):
        if first > low:
            gaps.append((low, min(first, wanted[1])))
        low = max(low, last)
        if low >= wanted[1]:
            break
    return [*gaps, (low, wanted[1])] if low < wanted[1] else gaps


def steers(scenario: Scenario) -> bool:
    """Whether a scenario's strategy has a say in how robots move."""
    known = strategies.known().get(scenario.strategy.name)
    return known is not None and known.steer is not None


def _moving(scenario: Scenario) -> str:
    """Equal for scenarios that move alike for as long as they last."""
    others = _key(scenario, [section for section in OF_MOTION if section != "run"])
    return f"{others}\n{scenario.run.model_dump_json(exclude={'t_end_s'})}"


def _key(scenario: Scenario, sections: Sequence[str]) -> str:
    return "\n".join(getattr(scenario, section).model_dump_json() for section in sections)
