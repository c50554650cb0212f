"""Compute the cost of each run, from which an objective computes the score of a candidate.

| cost | figure of a run | source in the paper |
|---|---|---|
| intended | sum over robots of (1 + abs(f - f*) N_tiles) e_d; e_d = t/T_end right, 5 wrong, 1 undecided | its text |
| printed | the same with (1 + abs(f - f*) / N_tiles) | Eq. 23 |
| authors_code | the same with abs(f - f*) / 0.04; undecided 3 | its program |
| decision_time | mean over robots of min(t, T_end), s | - |
| errors | mean over robots of t/T_end if right, ``false_alarm`` or ``miss`` if wrong, ``undecided`` if undecided | - |
| name of a figure | robots_wrong, robots_undecided, swarm_wrong, consensus_time_s (``statistics.figures``) | - |
| estimate_error | mean over robots of abs(f - f*) | - |
| consensus | two figures: min(consensus time, T_end), s; 1 if the consensus is right, else 0 | - |
| at_error | five figures: mean over robots of min(t, T_end), s; numbers wrong, decided and of all; T_end, s | - |

f is the robot's estimate of the fill ratio, f* the true fill ratio, N_tiles the number of tiles, t the decision time
(T_end if undecided) and T_end the end of the run. A false alarm decides "above the boundary" when the fill ratio is
below it; a miss is the opposite error. With costs of mistakes (``task.costs``) ``errors`` and ``at_error`` count a
mistake by its cost relative to the dearest. Every cost returns (runs, columns).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from vibroswarm.errors import InputError
from vibroswarm.inference.outcomes import Array
from vibroswarm.search.outcomes import Outcomes
from vibroswarm.statistics.figures import FIGURES, RunFigure

WRONG: Final = 5.0
"""Decision factor e_d of a wrong robot (Eq. 23b)."""
UNDECIDED: Final = 1.0
"""Decision factor e_d of an undecided robot in the paper's text."""
UNDECIDED_IN_CODE: Final = 3.0
"""The same in the paper's program."""
TILE_IN_CODE: Final = 0.04
"""One of 25 tiles; the program uses this number for every floor."""


def intended(outcomes: Outcomes) -> Array:
    """Compute the paper's cost as its text defines it, with the error of the estimate in tiles."""
    # Eq. 23a as the text explains it: divided by one tile, 1 / N_tiles
    return _paper(outcomes, 1.0 + _error(outcomes) * outcomes.tiles, UNDECIDED)


def printed(outcomes: Outcomes) -> Array:
    """Compute the paper's cost as its equation defines it: divided by N_tiles, the estimate's error hardly counts."""
    return _paper(outcomes, 1.0 + _error(outcomes) / outcomes.tiles, UNDECIDED)  # Eq. 23a


def authors_code(outcomes: Outcomes) -> Array:
    """Compute the cost that the paper's program minimised: zero, however late, if the estimate is exact."""
    return _paper(outcomes, _error(outcomes) / TILE_IN_CODE, UNDECIDED_IN_CODE)


def decision_time(outcomes: Outcomes) -> Array:
    """Compute the mean decision time over robots, s."""
    return np.asarray(outcomes.time_s.mean(axis=1, keepdims=True))


def errors(
    outcomes: Outcomes, false_alarm: float = WRONG, miss: float = WRONG, undecided: float = UNDECIDED
) -> Array:
    """Compute the mean cost over the robots of each run. A robot that decided right costs t/T_end."""
    check_truth(outcomes)
    # Where the truth is 0 (below the boundary), a wrong robot decided "above": a false alarm. Shape: (runs, 1).
    of_wrong = np.where(outcomes.truth[:, None] == 0.0, false_alarm, miss)
    if outcomes.costs is not None:
        of_wrong = of_wrong * outcomes.mistakes
    cost = np.where(outcomes.wrong, of_wrong, outcomes.time_s / outcomes.t_end_s)
    cost = np.where(outcomes.undecided, undecided, cost)
    return np.asarray(cost.mean(axis=1, keepdims=True))


def consensus(outcomes: Outcomes) -> Array:
    """Return the consensus time, that of the last decision, s, and 1 if the consensus is right; else T_end and 0."""
    check_truth(outcomes)
    time_s, all_right = outcomes.time_s, outcomes.right.all(axis=1)
    agreed = ~outcomes.undecided.any(axis=1) & (all_right | outcomes.wrong.all(axis=1))
    return np.column_stack([np.where(agreed, time_s.max(axis=1), outcomes.t_end_s), all_right])


def at_error(outcomes: Outcomes) -> Array:
    """Return the five figures of each run from which ``objective`` computes the time at a given error."""
    check_truth(outcomes)
    # A mistake that costs less than the dearest one counts as part of an error.
    time_s, wrong = outcomes.time_s.mean(axis=1), outcomes.mistakes.sum(axis=1)
    decided, robots = (~outcomes.undecided).sum(axis=1), outcomes.decision.shape[1]
    constant = np.tile([robots, outcomes.t_end_s], (decided.size, 1))
    return np.column_stack([time_s, wrong, decided, constant])


def estimate_error(outcomes: Outcomes) -> Array:
    """Compute the mean over robots of the absolute error of their estimates."""
    return np.asarray(_error(outcomes).mean(axis=1, keepdims=True))


def _of_figure(figure: RunFigure) -> Callable[[Outcomes], Array]:
    def cost(outcomes: Outcomes) -> Array:
        check_truth(outcomes)
        return figure.of_run(outcomes.swarms)[:, None]

    return cost


COSTS: Final[dict[str, Callable[..., Array]]] = {
    "intended": intended,
    "printed": printed,
    "authors_code": authors_code,
    "decision_time": decision_time,
    "errors": errors,
    **{figure.name: _of_figure(figure) for figure in FIGURES if figure.is_cost},
    "estimate_error": estimate_error,
}
"""Costs with one figure per run, to which a statistic is applied."""


def check_truth(outcomes: Outcomes) -> None:
    """Refuse runs whose truth is undefined (nan): no decision is right or wrong there, and no cost has a meaning."""
    if np.isnan(outcomes.truth).any():
        raise InputError(
            "no decision is right on a floor: its fill ratio is the decision boundary itself, or the task defines no "
            "truth on it; choose another floor or boundary",
            field="floor.source",
        )


def check_figures(values: Any, shape: tuple[int, int], name: str) -> Array:
    """Return what a cost, possibly a user's function, gave as (runs, columns); refuse other shapes, and nan."""
    figures = np.asarray(values, dtype=np.float64)
    if figures.shape not in (shape, shape[:1]):
        raise InputError(
            f"gives shape {figures.shape} for {shape[0]} runs; return one number per run", field=name
        )
    if not np.isfinite(figures).all():
        first = figures[~np.isfinite(figures)][0]
        raise InputError(f"gives {first}; a cost is a finite number", field=name)
    return figures.reshape(shape)


def _error(outcomes: Outcomes) -> Array:
    """Compute abs(f - f*), (runs, robots)."""
    if np.isnan(outcomes.estimate).any():
        raise InputError(
            f"needs each robot's estimate of the fill ratio, and strategy '{outcomes.strategy}' lacks some; choose "
            "decision_time, errors, expected_time_to_right or time_at_error",
            field="objective.cost",
        )
    return np.abs(outcomes.estimate - outcomes.fill_ratio[:, None])


def _paper(outcomes: Outcomes, of_estimate: Array, undecided: float) -> Array:
    """Compute a cost of the paper (Eq. 23c): the sum over robots of estimate factor times decision factor."""
    check_truth(outcomes)
    of_decision = np.where(outcomes.wrong, WRONG, outcomes.time_s / outcomes.t_end_s)  # Eq. 23b
    of_decision = np.where(outcomes.undecided, undecided, of_decision)
    return np.asarray((of_estimate * of_decision).sum(axis=1, keepdims=True))  # Eq. 23c
