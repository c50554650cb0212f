"""Evaluate candidates on any executor, in small pieces: from values of fields to the figures of each run.

The runs of a candidate are divided into pieces, the units of work that are sent to workers. The number of a run
determines its motion and floor. The evaluations (runs) of candidates are numbered in one of three ways:

* ``independent``: every evaluation of the search gets a new number, so that evaluations are independent.
* ``common`` (common random numbers): evaluation e of every candidate is run e.
* ``AS_RAN``, as in the paper's program: the number is ``pso.shared_run``. Each run is a piece of its own, so that
  crashed runs can be dropped one by one.

Results are joined in the order of the requests, so that they do not depend on the number or the speed of the workers.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.numbers import every
from vibroswarm.errors import CodeError, InputError, RunError, plain_value
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.search.archive import Archive
from vibroswarm.search.methods import Ask
from vibroswarm.search.objective import Objective, Rows
from vibroswarm.search.outcomes import Outcomes, outcomes_of
from vibroswarm.search.pso import shared_run
from vibroswarm.statistics.intervals import generator
from vibroswarm.study.batch import scenario_of
from vibroswarm.study.run import Pool, do_all

PIECE: Final = 10
"""Runs in a piece: about 20 ms of work, hundreds of times the cost of submitting it."""
NUMBERS: Final = ("independent", "common")
AS_RAN: Final = "as-ran"
"""Numbering of a search as by the paper's program, which does not read the setting ``numbers``."""
RUN_LIMIT: Final = 2**32
"""Run numbers are below this."""


@dataclass(frozen=True, kw_only=True)
class Piece:
    """Successive runs of one candidate, in plain values, to be sent to a worker."""

    first: int
    """Number of the first run."""
    last: int
    """One past the number of the last run."""
    seed: int
    motion: str
    code: tuple[tuple[str, str], ...] = ()
    """The files of user code that the scenarios need: reference to code (``plugins``) and text of each."""
    cases: tuple[str, ...]
    """Scenarios as TOML; each run is simulated in all of them."""
    values: tuple[tuple[str, Any], ...]
    """Names and values of the fields that the candidate sets in each scenario."""
    crashed: bool = False
    """Whether the runs count as crashed, as some runs of the paper's program did; they are not simulated."""

    @property
    def runs(self) -> int:
        """Number of runs."""
        return self.last - self.first

    @property
    def numbers(self) -> range:
        """Numbers of the runs."""
        return range(self.first, self.last)

    def parts(self, count: int) -> list[Piece]:
        """Divide it into ``count`` parts of nearly equal size; into one per run if it has fewer runs."""
        count = min(count, self.runs)
        bounds = [self.first + self.runs * k // count for k in range(count + 1)]
        return [replace(self, first=first, last=last) for first, last in pairwise(bounds)]


CRASHED: Final = "taken to crash (pso.crash_share)"
"""Reason of failure of runs that count as crashed."""


def derived_seed(seed: int, purpose: str) -> int:
    """Derive a seed for one purpose of a search: evaluations, fresh runs, ..."""
    # 7 bytes, so that every derived seed is below ``rng.SEED_LIMIT``, 2^63.
    return int.from_bytes(hashlib.sha256(f"optimizer: {purpose} of {seed}".encode()).digest()[:7])


def do_piece(piece: Piece, objectives: tuple[Objective, ...]) -> Rows | str:
    """Simulate the runs of a piece and return their figures, or the reason why all of them failed.

    The figures are (runs, cases, columns), where the columns of all objectives stand side by side. The runs fail if the
    candidate's values give a scenario that is invalid or cannot be simulated.

    Raises:
        InputError: a cost gives no finite number, or is not defined on these outcomes (see ``Objective.figures``). This
            is an error in the objective or the scenario, not a failed run, and ends the search.
    """
    if piece.crashed:
        return CRASHED
    try:
        plugins.install_all(piece.code)  # a worker process may not have loaded the user code yet
        values = json.dumps(plain_value(piece.values))
        scenarios = [_scenario(text, values) for text in piece.cases]
        outcomes = outcomes_of(scenarios, piece.seed, piece.numbers, piece.motion)
    except InputError as error:
        return str(error)
    except (CodeError, RunError, MemoryError, OSError):  # the last two are of the machine, not of the runs
        raise
    except Exception as error:  # numbers that go wrong in a simulation
        return f"{type(error).__name__}: {error}"
    return rows_of(outcomes, objectives)


def rows_of(cases: Sequence[Outcomes], objectives: Sequence[Objective]) -> Rows:
    """Compute the figures of all objectives from the outcomes of each case, (runs, cases, columns)."""
    return np.stack([np.hstack([o.figures(outcomes) for o in objectives]) for outcomes in cases], axis=1)


@lru_cache(maxsize=512)
def _scenario(text: str, values: str) -> Scenario:
    """Return the scenario of a TOML text with a candidate's values; cached, since a candidate has several pieces.

    The values are JSON, as a list cannot be the key of a cache.
    """
    return scenario_of(text).with_values(dict(json.loads(values)))


class Simulations:
    """Simulations of the same cases with different values of fields, from one seed.

    Args:
        cases: scenarios in which each run is simulated. seed: of all runs. motion: name of the motion source.
    """

    def __init__(self, cases: Sequence[Scenario], seed: int, motion: str = "event") -> None:
        self.cases, self.seed, self.motion = tuple(case.to_toml() for case in cases), seed, motion
        self.code = plugins.texts_of([motion, *(code for case in cases for code in case.codes)])

    def pieces(
        self, values: Mapping[str, Any], first: int, end: int, size: int = PIECE, crashed: bool = False
    ) -> list[Piece]:
        """Divide the runs ``first`` to ``end`` - 1 of a candidate with these values into pieces of at most ``size``."""
        code = self.code + plugins.texts_of(value for value in values.values() if plugins.is_code(value))
        return [
            Piece(
                cases=self.cases,
                values=tuple(values.items()),
                seed=self.seed,
                motion=self.motion,
                first=low,
                last=min(low + size, end),
                code=code,
                crashed=crashed,
            )
            for low in range(first, end, size)
        ]


class Evaluator:
    """Assigns numbers to the runs of candidates, and divides the runs into pieces."""

    def __init__(
        self,
        archive: Archive,
        cases: Sequence[Scenario],
        seed: int,
        *,
        motion: str = "event",
        numbers: str = "independent",
        crash_share: float = 0.0,
        purpose: str = "evaluations",
    ) -> None:
        """Prepare to divide the runs of the candidates in ``archive``.

        Args:
            cases: scenarios in which each run is simulated. seed: of the search. motion: the motion source.
            numbers: how runs are numbered, one of ``NUMBERS`` or ``AS_RAN``.
            crash_share: with ``AS_RAN``, the share of runs that count as crashed.
            purpose: the seed of the runs is derived from it and the search's. It differs from that of the fresh runs,
                on which the winner is validated.
        """
        self.archive, self.numbers = archive, numbers
        self.crash_share, self.search_seed = crash_share, seed
        self.simulations = Simulations(cases, derived_seed(seed, purpose), motion)
        self.next_run = 0
        """Next unused number with ``independent`` numbers; otherwise not read."""

    def pieces(self, ask: Ask) -> list[Piece]:
        """Number the runs of a request, and divide them into pieces of at most ``PIECE`` runs.

        With ``independent`` numbers, the runs get the next unused numbers of the search, which count as used from now
        on. With ``common`` numbers, a candidate that has n runs continues with run n. See ``_pieces_as_ran`` for
        ``AS_RAN``.

        Raises:
            InputError: the numbers would exceed ``RUN_LIMIT``.
        """
        candidate = self.archive[ask.key]
        if self.numbers == AS_RAN:
            return self._pieces_as_ran(ask)
        first = self.next_run if self.numbers == "independent" else candidate.count
        self.next_run += ask.runs  # not read with ``common`` numbers
        if first + ask.runs > RUN_LIMIT:
            raise InputError("needs more than 2^32 runs", field="budget")
        return self.simulations.pieces(candidate.values, first, first + ask.runs)

    def _pieces_as_ran(self, ask: Ask) -> list[Piece]:
        """Return one piece per run, numbered as in the paper's program (``shared_run``).

        Each run counts as crashed with the probability ``crash_share``.
        """
        candidate = self.archive[ask.key]
        # The purpose names the candidate and its runs so far. So each request draws other crashes, and a resumed search
        # draws the same crashes again.
        chances = generator(self.search_seed, f"optimizer: crashes {ask.key} {candidate.count}")
        pieces: list[Piece] = []
        for e, is_crashed in enumerate((chances.random(ask.runs) < self.crash_share).tolist()):
            run = shared_run(candidate.count + e, candidate.iteration)
            pieces += self.simulations.pieces(candidate.values, run, run + 1, crashed=is_crashed)
        return pieces


Result = tuple[int, Rows | str, int]
"""Some runs of a candidate: its key, figures, (runs, cases, columns), or why they failed, and their number."""


def do_asks(
    asks: Sequence[tuple[Ask, Sequence[Piece]]],
    objectives: tuple[Objective, ...],
    pool: Pool,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Result]:
    """Run the pieces of requests, and return the result of each; see ``do_pieces``."""
    pieces = [piece for _, of_ask in asks for piece in of_ask]
    keys = [ask.key for ask, of_ask in asks for _ in of_ask]
    done = do_pieces(pieces, objectives, pool, progress)
    return [(key, found, piece.runs) for key, found, piece in zip(keys, done, pieces, strict=True)]


def do_pieces(
    pieces: Sequence[Piece],
    objectives: tuple[Objective, ...],
    pool: Pool,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Rows | str]:
    """Run all pieces and return for each, in order, its figures or the reason why it failed; see ``do_piece``.

    With p pieces and w workers, the last p mod w pieces would occupy only some workers while the search waits for them.
    Each of these pieces is therefore divided into parts for all workers.

    Args:
        pieces: the work. objectives: compute the figures. pool: the workers.
        progress: called with the number of finished runs.
    Raises:
        InputError: a cost gives no finite number, or is not defined on the outcomes. RunError: the workers are gone.
    """
    undivided = len(pieces) - len(pieces) % pool.width
    divided = [piece.parts(1 if k < undivided else pool.width) for k, piece in enumerate(pieces)]
    parts = [part for of_piece in divided for part in of_piece]
    results = dict[int, Rows | str]()
    done = 0

    def take(found: Rows | str, part: Piece) -> None:
        nonlocal done
        results[id(part)], done = found, done + part.runs
        progress(done)

    do_all(pool, do_piece, parts, take, objectives)
    each = (results[id(part)] for part in parts)
    return [_joined([next(each) for _ in of_piece]) for of_piece in divided]


def _joined(results: Sequence[Rows | str]) -> Rows | str:
    """Join the figures of a piece's parts along the runs; if any part failed, return the first reason instead."""
    rows = [result for result in results if not isinstance(result, str)]
    if len(rows) == len(results):
        return np.concatenate(rows)
    return next(result for result in results if isinstance(result, str))


@dataclass(frozen=True)
class RunFigures:
    """Figures of many runs with one set of values."""

    rows: Rows
    """(runs, cases, columns)."""
    runs: NDArray[np.int64]
    """Numbers of the runs that succeeded, in the order of ``rows``."""
    failed: int
    """Number of runs in failed pieces."""
    why: str = ""
    """Why the first of the failed pieces failed."""


def figures_of(
    cases: Sequence[Scenario],
    values: Mapping[str, Any],
    objectives: tuple[Objective, ...],
    runs: int,
    seed: int,
    workers: Pool,
    *,
    motion: str = "event",
    progress: Callable[[int], None] = lambda done: None,
) -> RunFigures:
    """Simulate runs 0 to ``runs`` - 1 with one set of values; the runs of pieces that fail are left out.

    Two sets of values with the same settings of motion, simulated with the same seed, have the same motion in each run,
    so that their figures can be compared run by run.

    Args:
        cases: scenarios in which each run is simulated. values: fields to set in all of them, by name.
        objectives: compute the figures. runs: number of runs, at least 1. seed: of the runs. workers: that simulate
            them.
        motion: the motion source. progress: called with the number of finished runs.
    Raises:
        InputError: a cost gives no finite number, or is not defined on the outcomes. RunError: all runs failed, or the
            workers are gone.
    """
    # Larger pieces than in a search, since there are many runs: fewer pieces to submit.
    pieces = Simulations(cases, seed, motion).pieces(values, 0, runs, 5 * PIECE)
    results = do_pieces(pieces, objectives, workers, progress)
    good = [(piece, rows) for piece, rows in zip(pieces, results, strict=True) if not isinstance(rows, str)]
    bad = [(piece, rows) for piece, rows in zip(pieces, results, strict=True) if isinstance(rows, str)]
    if not good:
        raise RunError(f"{every(runs, 'run')} failed: {bad[0][1]}")
    return RunFigures(
        rows=np.concatenate([rows for _, rows in good]),
        runs=np.concatenate([np.array(piece.numbers) for piece, _ in good]),
        failed=sum(piece.runs for piece, _ in bad),
        why=bad[0][1] if bad else "",
    )
