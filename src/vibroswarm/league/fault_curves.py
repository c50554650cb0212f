"""Compute how many faulty robots each strategy of a league tolerates.

For each kind of fault the smallest swarm of the league runs with 0, 1, 2, ... faulty robots, on random floors on both
sides of 1/2, since a fault that favours one answer does harm only on one side. Robots that are faulty in a run are also
faulty with each larger number, and everything else is the same, so differences are paired by run.

| column | what it is |
|---|---|
| kind, faulty | the fault (a field of ``[faults]``), and the number of robots that have it |
| forced_error | mean forced error (``analysis.forced_error``) of the working robots, averaged over floors |
| rise | its difference from that of the same robots in the same runs without faults; where no run shows a rise, \
the upper limit is at least Wilson's of 0 runs |
| bears | true (tolerated): upper limit of the rise below ``MARGIN``; false: lower limit above; else null, as for an \
entry that guesses without faults |

Intervals are 95 % intervals over runs. They are not corrected for the comparison of several numbers of faulty robots.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import Interval, columns_of, share_interval, student_test, wilson_limits
from vibroswarm.analysis.paired import difference, differences
from vibroswarm.errors import InputError, check_choice
from vibroswarm.inference.outcomes import costs_of, forced_errors
from vibroswarm.league.entries import Entry, floors_of
from vibroswarm.league.fronts import guess_level
from vibroswarm.league.standings import League
from vibroswarm.scenario.fault_draws import working
from vibroswarm.scenario.fault_fields import FAULTS
from vibroswarm.strategies import strategy
from vibroswarm.study.run import run
from vibroswarm.study.study_result import StudyResult

FOLDER: Final = "faults"
"""Name of the folder of these runs inside the folder of a league."""
KINDS: Final = ("stuck_at_1", "opposite", "radio_dead", "stopped")
"""Kinds of faults that are simulated by default."""
MARGIN: Final = 0.05
"""Rise of the forced error up to which a strategy tolerates a fault."""
FILL: Final = 0.46
"""Fill ratio of the random floors; its mirror 1 - f is added."""
MOST: Final = 2
"""Most faulty robots in a swarm, by default."""
CURVES: Final[dict[str, Any]] = {
    "name": pl.String,
    "kind": pl.String,
    "faulty": pl.Int64,
    **{f"{name}{end}": pl.Float64 for name in ("forced_error", "rise") for end in ("", "_low", "_high")},
    "bears": pl.Boolean,
}
"""Columns of ``fault_curves`` and their types."""
Errors = tuple[NDArray[np.float64], NDArray[np.bool_]]
"""Forced errors of robots, averaged over floors, and whether the robots work (have no fault): (runs, robots) each."""
Case = tuple[str, str, int]
"""Label of an entry, kind of fault ("none" without faulty robots), number of faulty robots."""


def fault_curves(
    league: League,
    folder: Path | None = None,
    *,
    kinds: Sequence[str] = KINDS,
    most: int | None = None,
    runs: int = 100,
    **how: Any,
) -> pl.DataFrame:
    """Simulate a league's entries with faulty robots, and compute the table of the module's docstring.

    Args:
        league: its entries, its base scenario and its smallest swarm size are used, with other floors and another seed.
        folder: where runs are saved; runs that are there already are not repeated. None: they are not saved.
        kinds: kinds of faults. most: largest number of faulty robots; by default ``MOST``, but never the whole swarm.
        runs: number of runs for each kind of fault, number of faulty robots and floor.
        how: further arguments of ``study.run.run``, such as workers.
    Returns: one row per entry (``name``), kind and number of faulty robots from 0 up; limits have ``_low`` and
        ``_high``. It has no rows if no kind fits any entry, or for a swarm of a single robot without ``most``.
    Raises:
        InputError: an unknown kind, ``most`` is not from 1 to the number of robots - 1, or runs are missing, for
            example because some failed.
    """
    for kind in kinds:
        check_choice(kind, "faults", FAULTS)
    robots = min(league.robots)
    if most is None:
        most = most_faulty(league)
        if most == 0:
            return pl.DataFrame(schema=CURVES)
    if not 1 <= most < robots:
        raise InputError(
            f"{most} of {robots} robots cannot be faulty; give a number from 1 to {robots - 1}",
            field="faults",
        )
    faulty_league = league_with_faults(league, kinds, most, runs)
    found = _errors(faulty_league, run(faulty_league.study, folder, **how))
    cases = [(entry.label, kind, count) for entry, kind, count in _cases(league, kinds, most)]
    errors = dict(zip(cases, found, strict=True))
    guess = guess_level(league.base)
    return pl.DataFrame([_row(case, errors, guess) for case in _rows_of(errors, kinds)], schema=CURVES)


def most_faulty(league: League) -> int:
    """Return the largest number of faulty robots by default: ``MOST``, but never the whole swarm."""
    return min(MOST, min(league.robots) - 1)


def league_with_faults(league: League, kinds: Sequence[str], most: int, runs: int) -> League:
    """Return the league whose runs ``fault_curves`` needs: each entry without and with faulty robots."""
    robots = min(league.robots)
    faulty_entries = [
        replace(
            entry,
            label=f"{entry.label}, {count} {kind}",
            settings={**entry.settings, **({f"faults.{kind}": count / robots} if count else {})},
        )
        for entry, kind, count in _cases(league, kinds, most)
    ]
    return replace(
        league,
        entries=tuple(faulty_entries),
        floors=floors_of(["random"], [FILL]),
        robots=(robots,),
        runs=runs,
        seed=league.seed + 2,  # fresh motion; the seed + 1 is that of belief_calibration
    )


def _cases(league: League, kinds: Sequence[str], most: int) -> Iterator[tuple[Entry, str, int]]:
    """Yield kinds and numbers of faulty robots of each entry; its first, ("none", 0), serves all kinds."""
    for entry in league.entries:
        has_opposite = strategy(entry.strategy).has_opposite
        possible = [kind for kind in kinds if kind != "opposite" or has_opposite]
        yield entry, "none", 0
        for kind in possible:
            yield from ((entry, kind, count) for count in range(1, most + 1))


def _rows_of(errors: dict[Case, Errors], kinds: Sequence[str]) -> list[Case]:
    """Return the cases of the table, in the order of its rows: each kind begins with a row of no faulty robot.

    That row has the results of the case "none", which was simulated once for all kinds. An entry has no rows of a kind
    that was not simulated for it.
    """
    names = dict.fromkeys(name for name, _, _ in errors)  # each once, in order
    return [
        (name, kind, count)
        for name in names
        for kind in kinds
        if (name, kind, 1) in errors
        for count in (0, *(number for n, k, number in errors if (n, k) == (name, kind)))
    ]


def _row(case: Case, errors: dict[Case, Errors], guess: float) -> dict[str, Any]:
    """Compute the row of a case: forced error and its rise with limits, and whether the fault is tolerated.

    The rise is the difference from the case without faulty robots, over the robots that work in ``case``.

    Args:
        errors: results of all cases. guess: forced error from which an entry guesses.
    """
    name, kind, count = case
    without_faults, all_work = errors[name, "none", 0]
    with_faults, works = errors[case] if count else (without_faults, all_work)
    # Mean forced error of each run over the robots that work in ``case``: in runs with the faults and without them.
    of_run, before = (
        np.where(works, found, 0.0).sum(axis=1) / works.sum(axis=1) for found in (with_faults, without_faults)
    )
    row: dict[str, Any] = {"name": name, "kind": kind, "faulty": count}
    row |= columns_of("forced_error", share_interval(of_run))
    row |= columns_of("rise", _rise(of_run, before) if count else (0.0, 0.0, 0.0))
    row["bears"] = _verdict(row) if count > 0 and share_interval(before).high < guess else None
    return row


def _rise(of_run: NDArray[np.float64], before: NDArray[np.float64]) -> Interval:
    """Estimate the mean rise of the forced error over runs, (runs,) each.

    Where no run shows a rise, the upper limit is at least that of how often a rise by 1 may occur: falls do not say how
    large rises are.
    """
    rise = difference(of_run, before, test=student_test, most=1.0).interval
    if (differences(of_run, before) > 0.0).any():
        return rise
    return rise._replace(high=max(rise.high, float(wilson_limits(0, rise.n)[1])))


def _verdict(row: dict[str, Any]) -> bool | None:
    """Return whether the rise is below ``MARGIN``; None without limits, or if the margin is not outside of them."""
    low, high = row["rise_low"], row["rise_high"]
    if low is None or high is None or low <= MARGIN <= high:
        return None
    return bool(high < MARGIN)


def _errors(league: League, study: StudyResult) -> list[Errors]:
    """Return the forced errors of the robots of each entry, averaged over floors, and which robots have no fault.

    Args:
        league: its entries have faults. study: the runs of this league.
    Raises:
        InputError: runs are missing.
    """
    floors, shape = len(league.floors), (league.runs, league.robots[0])
    errors = np.zeros((len(league.entries), *shape))
    for cells, robots, of_runs in study.arrays(("decision", "belief_in_truth", "truth")):
        # Cells of a league have one task.
        costs, truth = costs_of(cells[0].scenario), of_runs["truth"][..., None]
        found = forced_errors(robots["decision"], robots["belief_in_truth"], truth, costs)
        for cell, of_cell in zip(cells, found, strict=True):
            errors[cell.number // floors] += of_cell / floors  # cells are ordered by entry and floor
    # Faults are the same on all floors, so the cells of the first floor stand for all.
    firsts = [cell.scenario for cell in study.study.cells[::floors]]
    working_robots = [working(scenario, league.seed, range(league.runs)) for scenario in firsts]
    return list(zip(errors, working_robots, strict=True))


def borne(curves: pl.DataFrame) -> pl.DataFrame:
    """Compute for each entry and kind the largest number of faulty robots that the entry is shown to tolerate.

    Args:
        curves: from ``fault_curves``.
    Returns: one row per entry and kind: name, kind, borne (the entry tolerates this number of faulty robots and all
        smaller numbers), open (whether the result for the next larger number is inconclusive).
    """
    rows = []
    for (name, kind), part in curves.filter(pl.col("faulty") > 0).group_by(
        "name", "kind", maintain_order=True
    ):
        verdicts = part.sort("faulty")["bears"].to_list()  # of 1, 2, ... faulty robots
        # Number of verdicts before the first that is not True.
        count = next((k for k, verdict in enumerate(verdicts) if verdict is not True), len(verdicts))
        is_open = count < len(verdicts) and verdicts[count] is None
        rows.append({"name": name, "kind": kind, "borne": count, "open": is_open})
    return pl.DataFrame(
        rows, schema={"name": pl.String, "kind": pl.String, "borne": pl.Int64, "open": pl.Boolean}
    )
