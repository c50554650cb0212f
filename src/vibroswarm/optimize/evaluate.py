"""Runs of candidates, in small pieces on any executor: from values to the figures of each run.

Every run has a number of its own, counted up over the search, so that evaluations are independent; or, with common
random numbers, evaluation e of every candidate is run e. The pieces are given out and put together in the order in
which they were asked for: no result depends on who does them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm import code_files
from vibroswarm.errors import InputError, RunError
from vibroswarm.inference.cost_outcomes import Outcomes
from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.method import Ask
from vibroswarm.optimize.objective import Objective, Rows
from vibroswarm.optimize.simulate_runs import outcomes_of
from vibroswarm.scenario import Scenario
from vibroswarm.study.executors import Workers

PIECE: Final = 10
"""Runs in a piece: some 20 ms of work, hundreds of times what giving it out costs."""
TRIES: Final = 2
NUMBERS: Final = ("independent", "common")
RUN_LIMIT: Final = 2**32


@dataclass(frozen=True)
class Piece:
    """Some runs of one candidate, in plain values.

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
    """Code of the user's, and its text."""


def code_of(cases: Sequence[Scenario], motion: str) -> tuple[tuple[str, str], ...]:
    """Code of the user's that these need, and its text."""
    return code_files.texts_of([motion, *(code for one in cases for code in one.codes)])


def derived_seed(seed: int, purpose: str) -> int:
    """A seed for one purpose of a search: evaluations, fresh runs, ..."""
    return int.from_bytes(hashlib.sha256(f"optimizer: {purpose} of {seed}".encode()).digest()[:7])


def do_piece(piece: Piece, objectives: tuple[Objective, ...]) -> Rows | str:
    """The figures of the runs, (runs, cases, columns of all objectives); or in words why they cannot be done.

    Raises:
        InputError: a cost gives no number.
    """
    try:
        code_files.install_all(piece.code)
        scenarios = [_scenario(text, piece.values) for text in piece.cases]
        found = outcomes_of(scenarios, piece.seed, range(piece.first, piece.last), piece.motion)
    except InputError as error:
        return str(error)
    return rows_of(found, objectives)


def rows_of(cases: Sequence[Outcomes], objectives: Sequence[Objective]) -> Rows:
    """(runs, cases, columns of all objectives)."""
    return np.stack([np.hstack([o.figures(found) for o in objectives]) for found in cases], axis=1)


@lru_cache(maxsize=64)
def _base(text: str) -> Scenario:
    return Scenario.from_toml(text)


@lru_cache(maxsize=512)
def _scenario(text: str, values: tuple[tuple[str, Any], ...]) -> Scenario:
    return _base(text).with_values(dict(values))


class Evaluator:
    """Counts off the runs of candidates in pieces, and puts their figures into the archive."""

    def __init__(
        self,
        archive: Archive,
        cases: Sequence[Scenario],
        seed: int,
        *,
        motion: str = "event",
        numbers: str = "independent",
    ) -> None:
        self.archive, self.motion, self.numbers = archive, motion, numbers
        self.cases, self.code = tuple(scenario.to_toml() for scenario in cases), code_of(cases, motion)
        self.seed = derived_seed(seed, "evaluations")
        self.next_run = 0

    def pieces(self, ask: Ask) -> list[Piece]:
        """The runs of one candidate; counts them off."""
        candidate = self.archive[ask.key]
        first = self.next_run if self.numbers == "independent" else candidate.count
        self.next_run += ask.runs
        if first + ask.runs > RUN_LIMIT:
            raise InputError("asks for more than 2^32 runs", field="budget")
        values = tuple(candidate.values.items())
        return [
            Piece(
                self.cases, values, self.seed, self.motion, low, min(low + PIECE, first + ask.runs), self.code
            )
            for low in range(first, first + ask.runs, PIECE)
        ]


def do_pieces(
    pieces: Sequence[Piece],
    objectives: tuple[Objective, ...],
    hands: Workers,
    tell: Callable[[int], None] = lambda done: None,
) -> list[Rows | str]:
    """All pieces, in their order. One that fails is tried again, then its failure is what came of it.

    What is left when each worker has had as many as any other is shared among all: a search waits for the last.

    Raises:
        InputError: a cost gives no number. RunError: the workers are gone.
    """
    even = len(pieces) - len(pieces) % hands.width
    parts = [_shared(piece, 1 if k < even else hands.width) for k, piece in enumerate(pieces)]
    came = iter(_do_each([part for shared in parts for part in shared], objectives, hands, tell))
    return [_together([next(came) for _ in shared]) for shared in parts]


def _shared(piece: Piece, count: int) -> list[Piece]:
    """A piece in up to so many parts."""
    runs = piece.last - piece.first
    count = min(count, runs)
    bounds = [piece.first + runs * k // count for k in range(count + 1)]
    return [replace(piece, first=first, last=last) for first, last in pairwise(bounds)]


def _together(came: Sequence[Rows | str]) -> Rows | str:
    """What came of a piece's parts; why its first part failed, if any did: what is counted is not who did it."""
    failed = next((part for part in came if isinstance(part, str)), None)
    return (
        failed if failed is not None else np.concatenate([part for part in came if not isinstance(part, str)])
    )


def _do_each(
    pieces: Sequence[Piece],
    objectives: tuple[Objective, ...],
    hands: Workers,
    tell: Callable[[int], None],
) -> list[Rows | str]:
    found: dict[int, Rows | str] = {}
    waiting, tries = list(reversed(range(len(pieces)))), dict.fromkeys(range(len(pieces)), 0)
    under_way: dict[Future[Rows | str], int] = {}
    done = 0
    try:
        while waiting or under_way:
            while waiting and len(under_way) < 4 * hands.width:
                k = waiting.pop()
                under_way[hands.executor.submit(do_piece, pieces[k], objectives)] = k
            finished = wait(under_way, timeout=1.0, return_when=FIRST_COMPLETED).done
            if not finished:
                hands.check()
            for future in finished:
                k = under_way.pop(future)
                try:
                    found[k] = future.result()
                except (InputError, RunError):
                    raise
                except (BrokenExecutor, CancelledError) as error:
                    raise RunError(
                        f"the workers are gone ({type(error).__name__}: {error}); say the same again to go on from here"
                    ) from error
                except Exception as error:
                    tries[k] += 1
                    if tries[k] < TRIES:
                        waiting.append(k)
                        continue
                    found[k] = f"{type(error).__name__}: {error}"
                done += pieces[k].last - pieces[k].first
            tell(done)
    finally:
        for future in under_way:
            future.cancel()
    return [found[k] for k in range(len(pieces))]


@dataclass(frozen=True)
class Many:
    """Many runs of one set of values."""

    rows: Rows
    """(runs, cases, columns)."""
    runs: NDArray[np.int64]
    """Their numbers."""
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
    tell: Callable[[int], None] = lambda done: None,
) -> Many:
    """Runs 0 to ``runs`` of one set of values; with the same seed the same motion for any values that move alike."""
    texts, given = tuple(c.to_toml() for c in cases), tuple(values.items())
    step = 5 * PIECE
    code = code_of(cases, motion)
    pieces = [Piece(texts, given, seed, motion, k, min(k + step, runs), code) for k in range(0, runs, step)]
    found = do_pieces(pieces, objectives, workers, tell)
    good = [(piece, rows) for piece, rows in zip(pieces, found, strict=True) if not isinstance(rows, str)]
    bad = [(piece, rows) for piece, rows in zip(pieces, found, strict=True) if isinstance(rows, str)]
    if not good:
        raise RunError(f"none of {runs} runs could be done: {bad[0][1]}")
    return Many(
        rows=np.concatenate([rows for _, rows in good]),
        runs=np.concatenate([np.arange(piece.first, piece.last) for piece, _ in good]),
        failed=sum(piece.last - piece.first for piece, _ in bad),
        why=bad[0][1] if bad else "",
    )
