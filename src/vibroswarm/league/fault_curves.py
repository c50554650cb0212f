"""Compute how many faulty robots each strategy of a league bears.

For each kind of fault the league's smallest swarm plays with 0, 1, 2, ... faulty robots, on random floors on both sides
of 1/2: a fault that leans to one side does harm on the other. Robots that are faulty in a run are so with larger
numbers too, and everything else is the same: differences are paired, run by run.

| column | what it is |
|---|---|
| kind, faulty | the fault (a field of ``[faults]``), and the number of robots that have it |
| forced_error | of the working robots, averaged over floors |
| rise | its difference from the same robots in the same runs without faults |
| bears | true: the upper limit of the rise is below ``MARGIN``; false: the lower limit is above it; null: open |

The unit is the run; 95 % intervals. How a strategy bears two faulty robots is not corrected for having asked of one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.forced_error import forced_errors
from vibroswarm.analysis.intervals import mean_interval, plain
from vibroswarm.errors import InputError, check_choice
from vibroswarm.faults import working
from vibroswarm.inference.outcomes import numbers
from vibroswarm.league.entries import Entry, floors_of
from vibroswarm.league.standings import League
from vibroswarm.scenario.fault_fields import FAULTS
from vibroswarm.strategies import strategy
from vibroswarm.study.study_result import StudyResult, run

FOLDER: Final = "faults"
"""Of its runs in that of a league."""
KINDS: Final = ("stuck_at_1", "opposite", "radio_dead", "stopped")
"""Kinds of faults that a league asks by default."""
MARGIN: Final = 0.05
"""Rise of the forced error up to which a strategy bears a fault."""
FILL: Final = 0.46
MOST: Final = 2
"""Most faulty robots in a swarm, by default."""
Errors = tuple[NDArray[np.float64], NDArray[np.bool_]]
"""Errors of robots, averaged over floors, and which of them work: (runs, robots) each."""


def fault_curves(
    league: League,
    folder: Path | None = None,
    *,
    kinds: Sequence[str] = KINDS,
    most: int | None = None,
    runs: int = 100,
    **how: Any,
) -> pl.DataFrame:
    """Play a league's entries with faulty robots.

    Args:
        league: its entries, base and smallest swarm; other floors and another seed than its own.
        folder: where its runs are kept; those that are there are not repeated. kinds: of faults. most: faulty
            robots; by default ``MOST``, but never the whole swarm.
        runs: of each fault, number and floor.
        how: workers and progress, as of ``League.play``.
    Returns: see the module; ``name`` is the entry's, limits have ``_low`` and ``_high``. Empty for single robots.
    Raises:
        InputError: an unknown kind, or as many faulty robots as robots.
    """
    for kind in kinds:
        check_choice(kind, "faults", FAULTS)
    robots = min(league.robots)
    if most is None:
        most = min(MOST, robots - 1)
        if most == 0:
            return pl.DataFrame()
    if not 1 <= most < robots:
        raise InputError(
            f"{most} of {robots} robots cannot all be faulty; from 1 to {robots - 1}", field="faults"
        )
    cases = [(entry, kind, count) for entry in league.entries for kind, count in _cases(entry, kinds, most)]
    players = [
        replace(
            entry,
            label=f"{entry.label}, {count} {kind}",
            settings={**entry.settings, **({f"faults.{kind}": count / robots} if count else {})},
        )
        for entry, kind, count in cases
    ]
    asked = replace(
        league,
        entries=tuple(players),
        floors=floors_of(["random"], [FILL]),
        robots=(robots,),
        runs=runs,
        seed=league.seed + 2,
    )
    study = run(asked.study, folder, **how)
    errors = {case: _errors(asked, study, place) for place, case in enumerate(_keys(cases))}
    return pl.DataFrame(
        [_row(name, kind, count, errors) for name, kind, count in _with_none(errors, kinds)],
        infer_schema_length=None,
    )


def _cases(entry: Entry, kinds: Sequence[str], most: int) -> list[tuple[str, int]]:
    """Return kinds and numbers of faulty robots; without faults all kinds are the same, so that case comes once."""
    possible = [kind for kind in kinds if kind != "opposite" or strategy(entry.strategy).has_opposite]
    return [("none", 0), *((kind, count) for kind in possible for count in range(1, most + 1))]


def _keys(cases: Sequence[tuple[Entry, str, int]]) -> list[tuple[str, str, int]]:
    return [(entry.label, kind, count) for entry, kind, count in cases]


def _with_none(
    errors: dict[tuple[str, str, int], Errors], kinds: Sequence[str]
) -> list[tuple[str, str, int]]:
    """Return name, kind and number of each row: every kind begins with no faulty robot."""
    names = dict.fromkeys(name for name, _, _ in errors)
    return [
        (name, kind, count)
        for name in names
        for kind in kinds
        if (name, kind, 1) in errors
        for count in (0, *(number for n, k, number in errors if (n, k) == (name, kind)))
    ]


def _row(name: str, kind: str, count: int, errors: dict[tuple[str, str, int], Errors]) -> dict[str, Any]:
    without, everybody = errors[name, "none", 0]
    mine, fine = errors[name, kind, count] if count else (without, everybody)
    of_run, before = (np.where(fine, found, 0.0).sum(axis=1) / fine.sum(axis=1) for found in (mine, without))
    row: dict[str, Any] = {"name": name, "kind": kind, "faulty": count}
    for figure, values in (("forced_error", of_run), ("rise", of_run - before)):
        found = mean_interval(values)
        row |= {
            figure: plain(found.estimate),
            f"{figure}_low": plain(found.low),
            f"{figure}_high": plain(found.high),
        }
    low, high = row["rise_low"], row["rise_high"]
    known = count > 0 and low is not None and high is not None
    row["bears"] = None if not known else True if high < MARGIN else False if low > MARGIN else None
    return row


def _errors(league: League, study: StudyResult, place: int) -> Errors:
    """Return the forced errors of the robots of one player, averaged over floors, and which robots work.

    Raises:
        InputError: runs are missing.
    """
    floors, robots = len(league.floors), league.robots[0]
    total, fine = np.zeros((league.runs, robots)), np.ones((league.runs, robots), dtype=bool)
    for cell in study.study.cells[place * floors : (place + 1) * floors]:
        rows = study.rows(cell.number).select("run", "decision", "belief_in_truth", "truth").collect()
        if rows.height != league.runs * robots:
            raise InputError(
                f"has {rows['run'].n_unique()} of {league.runs} runs; run it again", field=cell.name
            )
        found = forced_errors(
            rows["decision"].to_numpy(), numbers(rows["belief_in_truth"]), numbers(rows["truth"])
        )
        total += found.reshape(league.runs, robots) / floors
        fine = working(cell.scenario, league.seed, range(league.runs))  # the same on all floors
    return total, fine


def borne(curves: pl.DataFrame) -> pl.DataFrame:
    """Return, for each entry and kind, the largest number of faulty robots that it is shown to bear.

    Returns: name, kind, borne (with all smaller numbers), open (the next number is neither borne nor not).
    """
    rows = []
    for (name, kind), part in curves.filter(pl.col("faulty") > 0).group_by(
        "name", "kind", maintain_order=True
    ):
        verdicts = part.sort("faulty")["bears"].to_list()
        count = next((k for k, verdict in enumerate(verdicts) if verdict is not True), len(verdicts))
        is_open = count < len(verdicts) and verdicts[count] is None
        rows.append({"name": name, "kind": kind, "borne": count, "open": is_open})
    return pl.DataFrame(rows, infer_schema_length=None)
