"""Evaluate candidates on any executor, in small pieces: from values of fields to the figures of each run.

Each run has a number of its own, counted over the search, so that evaluations are independent; with common random
numbers, evaluation e of every candidate is run e. As the paper's program ran, it is ``pso.shared_run``, and each run is
a piece, so that crashed ones can be dropped one by one. Results are joined in the order of the requests, so that none
depends on the workers.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Future
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import generator
from vibroswarm.errors import InputError, RunError
from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.methods import Ask
from vibroswarm.optimize.objective import Objective, Rows
from vibroswarm.optimize.outcomes import Outcomes, outcomes_of
from vibroswarm.optimize.pso import shared_run
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.study.executors import Workers, do_all

PIECE: Final = 10
"""Runs in a piece: about 20 ms of work, hundreds of times the cost of submitting it."""
TRIES: Final = 2
NUMBERS: Final = ("independent", "common")
AS_RAN: Final = "as-ran"
"""Numbers of runs that a search by the paper's program gives, whatever its settings say."""
RUN_LIMIT: Final = 2**32


@dataclass(frozen=True)
class Piece:
    """Some runs of one candidate, in plain values for a worker.

    Args:
        cases: scenarios as TOML. values: fields that the candidate sets in each.
    """

    cases: tuple[str, ...]
    values: tuple[tuple[str, Any], ...]
    seed: int
    motion: str
    first: int
    last: int
    code: tuple[tuple[str, str], ...] = ()
    """User code and its text."""
    crashed: bool = False
    """Whether the runs are taken to have crashed; they are not simulated."""


CRASHED: Final = "taken to crash (pso.crash_share)"


def code_of(cases: Sequence[Scenario], motion: str) -> tuple[tuple[str, str], ...]:
    """Return the user code that cases and motion need, with its text."""
    return plugins.texts_of([motion, *(code for case in cases for code in case.codes)])


def derived_seed(seed: int, purpose: str) -> int:
    """Derive a seed for one purpose of a search: evaluations, fresh runs, ..."""
    return int.from_bytes(hashlib.sha256(f"optimizer: {purpose} of {seed}".encode()).digest()[:7])


def do_piece(piece: Piece, objectives: tuple[Objective, ...]) -> Rows | str:
    """Simulate runs and return their figures, (runs, cases, columns of all objectives), or why they failed.

    Raises:
        InputError: a cost gives no number.
    """
    if piece.crashed:
        return CRASHED
    try:
        plugins.install_all(piece.code)
        scenarios = [_scenario(text, piece.values) for text in piece.cases]
        outcomes = outcomes_of(scenarios, piece.seed, range(piece.first, piece.last), piece.motion)
    except InputError as error:
        return str(error)
    return rows_of(outcomes, objectives)


def rows_of(cases: Sequence[Outcomes], objectives: Sequence[Objective]) -> Rows:
    """Stack figures of all objectives, (runs, cases, columns)."""
    return np.stack([np.hstack([o.figures(outcomes) for o in objectives]) for outcomes in cases], axis=1)


@lru_cache(maxsize=64)
def _base(text: str) -> Scenario:
    return Scenario.from_toml(text)


@lru_cache(maxsize=512)
def _scenario(text: str, values: tuple[tuple[str, Any], ...]) -> Scenario:
    return _base(text).with_values(dict(values))


class Evaluator:
    """Numbers the runs of candidates and divides them into pieces."""

    def __init__(
        self,
        archive: Archive,
        cases: Sequence[Scenario],
        seed: int,
        *,
        motion: str = "event",
        numbers: str = "independent",
        crash_share: float = 0.0,
    ) -> None:
        """Divide runs of the candidates in ``archive``; ``numbers`` is one of ``NUMBERS``, or AS_RAN."""
        self.archive, self.motion, self.numbers = archive, motion, numbers
        self.crash_share, self.search_seed = crash_share, seed
        self.cases, self.code = tuple(scenario.to_toml() for scenario in cases), code_of(cases, motion)
        self.seed = derived_seed(seed, "evaluations")
        self.next_run = 0

    def pieces(self, ask: Ask) -> list[Piece]:
        """Return the pieces of a request.

        Their runs have the next numbers of the search or, with common numbers, of the candidate.

        Raises:
            InputError: there are no more numbers.
        """
        candidate = self.archive[ask.key]
        if self.numbers == AS_RAN:
            return self._pieces_as_ran(ask)
        first = self.next_run if self.numbers == "independent" else candidate.count
        self.next_run += ask.runs
        if first + ask.runs > RUN_LIMIT:
            raise InputError("needs more than 2^32 runs", field="budget")
        values = tuple(candidate.values.items())
        return [
            Piece(
                self.cases, values, self.seed, self.motion, low, min(low + PIECE, first + ask.runs), self.code
            )
            for low in range(first, first + ask.runs, PIECE)
        ]

    def _pieces_as_ran(self, ask: Ask) -> list[Piece]:
        """Return a piece for each run, numbered by ``shared_run``; a random share of the runs counts as crashed."""
        candidate, values = self.archive[ask.key], tuple(self.archive[ask.key].values.items())
        chances = generator(self.search_seed, f"optimizer: crashes {ask.key} {candidate.count}")
        crashed = (chances.random(ask.runs) < self.crash_share).tolist()
        runs = [shared_run(candidate.count + e, candidate.iteration) for e in range(ask.runs)]
        return [
            Piece(self.cases, values, self.seed, self.motion, run, run + 1, self.code, lost)
            for run, lost in zip(runs, crashed, strict=True)
        ]


def do_pieces(
    pieces: Sequence[Piece],
    objectives: tuple[Objective, ...],
    pool: Workers,
    progress: Callable[[int], None] = lambda done: None,
) -> list[Rows | str]:
    """Run all pieces and return for each, in order, its figures or the reason why it failed.

    The last pieces, too few for all workers, are divided among them, since a search waits for the slowest.

    Raises:
        InputError: a cost gives no number. RunError: the workers are gone.
    """
    even = len(pieces) - len(pieces) % pool.width
    parts = [_shared(piece, 1 if k < even else pool.width) for k, piece in enumerate(pieces)]
    results = iter(_do_each([part for shared in parts for part in shared], objectives, pool, progress))
    return [_together([next(results) for _ in shared]) for shared in parts]


def _shared(piece: Piece, count: int) -> list[Piece]:
    """Divide a piece into up to ``count`` parts."""
    runs = piece.last - piece.first
    count = min(count, runs)
    bounds = [piece.first + runs * k // count for k in range(count + 1)]
    return [replace(piece, first=first, last=last) for first, last in pairwise(bounds)]


def _together(came: Sequence[Rows | str]) -> Rows | str:
    """Join the figures of a piece's parts; if any failed, return the first reason instead."""
    rows = [part for part in came if not isinstance(part, str)]
    return np.concatenate(rows) if len(rows) == len(came) else next(p for p in came if isinstance(p, str))


def _do_each(
    pieces: Sequence[Piece],
    objectives: tuple[Objective, ...],
    pool: Workers,
    progress: Callable[[int], None],
) -> list[Rows | str]:
    """Run each piece; one that fails twice gives its error as text."""
    results: dict[int, Rows | str] = {}
    failures: Counter[int] = Counter()

    def take(future: Future[Rows | str], k: int) -> list[int]:
        try:
            results[k] = future.result()
        except (InputError, RunError, BrokenExecutor, CancelledError):
            raise
        except Exception as error:
            failures[k] += 1
            if failures[k] < TRIES:
                return [k]
            results[k] = f"{type(error).__name__}: {error}"
        return []

    do_all(
        pool,
        list(reversed(range(len(pieces)))),
        lambda k: pool.executor.submit(do_piece, pieces[k], objectives),
        take,
        ahead=lambda: 4 * pool.width,
        progress=lambda: progress(sum(pieces[k].last - pieces[k].first for k in results)),
    )
    return [results[k] for k in range(len(pieces))]


@dataclass(frozen=True)
class RunFigures:
    """Figures of many runs with one set of values."""

    rows: Rows
    """(runs, cases, columns)."""
    runs: NDArray[np.int64]
    """Numbers of the runs."""
    failed: int
    why: str = ""


def figures_of(
    cases: Sequence[Scenario],
    values: Mapping[str, Any],
    objectives: tuple[Objective, ...],
    runs: int,
    seed: int,
    workers: Workers,
    *,
    motion: str = "event",
    progress: Callable[[int], None] = lambda done: None,
) -> RunFigures:
    """Simulate runs 0 to ``runs`` - 1 with one set of values; leave out failed pieces.

    Under the same seed, sets of values with which the robots move alike have the same motion in each run.

    Raises:
        RunError: all runs failed.
    """
    texts, items = tuple(c.to_toml() for c in cases), tuple(values.items())
    step = 5 * PIECE
    code = code_of(cases, motion)
    pieces = [Piece(texts, items, seed, motion, k, min(k + step, runs), code) for k in range(0, runs, step)]
    results = do_pieces(pieces, objectives, workers, progress)
    good = [(piece, rows) for piece, rows in zip(pieces, results, strict=True) if not isinstance(rows, str)]
    bad = [(piece, rows) for piece, rows in zip(pieces, results, strict=True) if isinstance(rows, str)]
    if not good:
        raise RunError(f"all {runs} runs failed: {bad[0][1]}")
    return RunFigures(
        rows=np.concatenate([rows for _, rows in good]),
        runs=np.concatenate([np.arange(piece.first, piece.last) for piece, _ in good]),
        failed=sum(piece.last - piece.first for piece, _ in bad),
        why=bad[0][1] if bad else "",
    )
