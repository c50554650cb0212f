"""Compute the cost of each run, from which an objective computes the score of a candidate.

| cost | figure of a run | source in the paper |
|---|---|---|
| intended | sum over robots of (1 + abs(f - f*) N_tiles) e_d; e_d = t/T_end right, 5 wrong, 1 undecided | its text |
| printed | the same with (1 + abs(f - f*) / N_tiles) | Eq. 23 |
| authors_code | the same with abs(f - f*) / 0.04; undecided 3 | its program |
| decision_time | mean over robots of min(t, T_end), s | - |
| errors | mean over robots of t/T_end right, ``false_alarm`` or ``miss`` wrong, ``undecided`` undecided | - |
| consensus | min(consensus time, T_end), s; whether it was right | - |
| at_error | mean over robots of min(t, T_end), s; how many wrong, decided, all | - |

A false alarm decides "above the boundary" when the fill ratio is below it; a miss is the opposite error.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from vibroswarm.errors import InputError
from vibroswarm.inference.outcomes import Array
from vibroswarm.optimize.outcomes import Outcomes

WRONG: Final = 5.0
UNDECIDED: Final = 1.0
UNDECIDED_IN_CODE: Final = 3.0
TILE_IN_CODE: Final = 0.04
"""One of 25 tiles; the program uses this number for every floor."""

Figures = Callable[..., Array]
"""(outcomes, parameters) -> (runs, columns)."""


def intended(outcomes: Outcomes) -> Array:
    """Compute the paper's cost as its text defines it, with the error of the estimate in tiles."""
    # Eq. 23a as the text explains it: divided by one tile, 1 / N_tiles
    return _paper(outcomes, 1.0 + _error(outcomes, "intended") * outcomes.tiles, UNDECIDED)


def printed(outcomes: Outcomes) -> Array:
    """Compute the paper's cost as its equation defines it: divided by N_tiles, the estimate's error hardly counts."""
    return _paper(outcomes, 1.0 + _error(outcomes, "printed") / outcomes.tiles, UNDECIDED)  # Eq. 23a


def authors_code(outcomes: Outcomes) -> Array:
    """Compute the cost that the paper's program minimised: zero, however late, if the estimate is exact."""
    # the authors' program
    return _paper(outcomes, _error(outcomes, "authors_code") / TILE_IN_CODE, UNDECIDED_IN_CODE)


def decision_time(outcomes: Outcomes) -> Array:
    """Compute the mean decision time over robots, s."""
    return np.asarray(outcomes.time_s.mean(axis=1, keepdims=True))


def errors(
    outcomes: Outcomes, false_alarm: float = WRONG, miss: float = WRONG, undecided: float = UNDECIDED
) -> Array:
    """Compute the mean cost over robots, with different prices of false alarms and misses."""
    check_truth(outcomes)
    of_wrong = np.where(outcomes.truth[:, None] == 0.0, false_alarm, miss)
    cost = np.where(outcomes.wrong, of_wrong, outcomes.time_s / outcomes.t_end_s)
    cost = np.where(outcomes.undecided, undecided, cost)
    return np.asarray(cost.mean(axis=1, keepdims=True))


def consensus(outcomes: Outcomes) -> Array:
    """Return the consensus time, s (T_end without one), and 1 if the consensus is right, else 0; (runs, 2)."""
    check_truth(outcomes)
    time_s, right = outcomes.time_s, outcomes.right.all(axis=1)
    alike = ~outcomes.undecided.any(axis=1) & (right | outcomes.wrong.all(axis=1))
    return np.column_stack([np.where(alike, time_s.max(axis=1), outcomes.t_end_s), right])


def at_error(outcomes: Outcomes) -> Array:
    """Return mean decision time, s, and the counts of wrong robots, of those that decided, and of all; (runs, 4)."""
    check_truth(outcomes)
    decided = (~outcomes.undecided).sum(axis=1)
    robots = np.full(decided.size, float(outcomes.robots))
    return np.column_stack([outcomes.time_s.mean(axis=1), outcomes.wrong.sum(axis=1), decided, robots])


COSTS: Final[dict[str, Figures]] = {
    "intended": intended,
    "printed": printed,
    "authors_code": authors_code,
    "decision_time": decision_time,
    "errors": errors,
}
"""Costs with one figure per run, to which a statistic is applied."""


def check_truth(outcomes: Outcomes) -> None:
    """Refuse runs in which no decision is right.

    Raises:
        InputError: the fill ratio of a floor is the boundary itself.
    """
    if np.isnan(outcomes.truth).any():
        raise InputError(
            "no decision is right on a floor: its fill ratio is the decision boundary itself, or its task says so; "
            "choose another floor or boundary",
            field="floor.source",
        )


def check_figures(values: Any, runs: int, name: str) -> Array:
    """Check the figures of a cost and return them as an array (runs, columns).

    Raises:
        InputError: they have another shape, are no numbers, or are not finite in some run.
    """
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"gives {type(values).__name__}, not one number a run", field=name) from None
    array = array[:, None] if array.ndim == 1 else array
    if array.ndim != 2 or array.shape[0] != runs or array.shape[1] < 1:
        raise InputError(f"gives shape {np.shape(values)} for {runs} runs; one number a run", field=name)
    if bad := np.flatnonzero(~np.isfinite(array).all(axis=1)).tolist():
        row = array[bad[0]].tolist()
        raise InputError(
            f"gives {row[0] if len(row) == 1 else row} for {len(bad)} of {runs} runs; a cost is a finite number",
            field=name,
        )
    return array


def _error(outcomes: Outcomes, cost: str) -> Array:
    """Compute the absolute error of each robot's estimate, (runs, robots).

    Raises:
        InputError: a robot has no estimate.
    """
    if np.isnan(outcomes.estimate).any():
        strategy = f"strategy '{outcomes.strategy}'" if outcomes.strategy else "the strategy"
        raise InputError(
            f"'{cost}' needs each robot's estimate of the fill ratio, and {strategy} keeps none; "
            "choose decision_time, errors, expected_time_to_right or time_at_error",
            field="objective.cost",
        )
    return np.abs(outcomes.estimate - outcomes.fill_ratio[:, None])


def _paper(outcomes: Outcomes, of_estimate: Array, undecided: float) -> Array:
    """Sum over robots the product of the factors of the estimate and of the decision, (runs, 1)."""
    check_truth(outcomes)
    of_decision = np.where(outcomes.wrong, WRONG, outcomes.time_s / outcomes.t_end_s)  # Eq. 23b
    of_decision = np.where(outcomes.undecided, undecided, of_decision)
    return np.asarray((of_estimate * of_decision).sum(axis=1, keepdims=True))  # Eq. 23c
