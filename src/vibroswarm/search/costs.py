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
and T_end the end of the run. A false alarm decides "above the boundary" when the fill ratio is below it; a miss is the
opposite error. With costs of mistakes (``task.costs``) ``errors`` and ``at_error`` count a mistake by its cost relative
to the dearest.

Every cost takes the ``Outcomes`` of some runs and returns an array with one row per run and one column per figure. An
undecided robot has no decision time: t is then T_end. Every cost except ``decision_time`` raises an InputError for runs
whose truth is undefined (``check_truth``), and those with f also if the strategy does not estimate f.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from vibroswarm.core.numbers import count
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
    """Compute the mean cost over the robots of each run, (runs, 1). A robot that decided right costs t/T_end.

    Args:
        outcomes: of some runs. false_alarm, miss: cost of a robot that decided wrong, by its kind of error.
        undecided: cost of an undecided robot.
    """
    check_truth(outcomes)
    # Where the truth is 0 (below the boundary), a wrong robot decided "above": a false alarm. Shape: (runs, 1).
    of_wrong = np.where(outcomes.truth[:, None] == 0.0, false_alarm, miss)
    if outcomes.costs is not None:
        of_wrong = of_wrong * outcomes.mistakes
    cost = np.where(outcomes.wrong, of_wrong, outcomes.time_s / outcomes.t_end_s)
    cost = np.where(outcomes.undecided, undecided, cost)
    return np.asarray(cost.mean(axis=1, keepdims=True))


def consensus(outcomes: Outcomes) -> Array:
    """Return two figures of each run, (runs, 2): its consensus time, s, and 1 if the consensus is right, else 0.

    A run has a consensus if all its robots decide the same; the consensus time is then that of the last decision.
    Without a consensus, the figures are T_end and 0.
    """
    check_truth(outcomes)
    time_s, all_right = outcomes.time_s, outcomes.right.all(axis=1)
    agreed = ~outcomes.undecided.any(axis=1) & (all_right | outcomes.wrong.all(axis=1))
    return np.column_stack([np.where(agreed, time_s.max(axis=1), outcomes.t_end_s), all_right])


def at_error(outcomes: Outcomes) -> Array:
    """Return the five figures of each run from which ``objective`` computes the time at a given error, (runs, 5).

    The columns are the mean of min(t, T_end) over all robots, s, where undecided robots count with T_end; the number of
    robots that decided wrong; the number that decided; the number of all robots; and T_end, s, by which the penalty is
    scaled. The sums of the three numbers over runs give the shares of errors and of undecided robots.
    """
    check_truth(outcomes)
    # A mistake that costs less than the dearest one counts as part of an error.
    decided = (~outcomes.undecided).sum(axis=1)
    robots, t_end_s = (np.full(decided.size, float(one)) for one in (outcomes.robots, outcomes.t_end_s))
    time_s, wrong = outcomes.time_s.mean(axis=1), outcomes.mistakes.sum(axis=1)
    return np.column_stack([time_s, wrong, decided, robots, t_end_s])


def estimate_error(outcomes: Outcomes) -> Array:
    """Compute the mean over robots of the absolute error of their estimates."""
    return np.asarray(_error(outcomes, "estimate_error").mean(axis=1, keepdims=True))


def _of_figure(figure: RunFigure) -> Figures:
    """Return the cost that is a figure of each run, (runs, 1)."""

    def cost(outcomes: Outcomes) -> Array:
        check_truth(outcomes)
        return figure.of_run(outcomes.swarms)[:, None]

    return cost


COSTS: Final[dict[str, Figures]] = {
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
    """Refuse runs whose truth is undefined (nan): no decision is right or wrong there, so that a cost has no meaning.

    Raises:
        InputError: the fill ratio of a floor is the boundary itself, or the task defines no truth on that floor.
    """
    if np.isnan(outcomes.truth).any():
        raise InputError(
            "no decision is right on a floor: its fill ratio is the decision boundary itself, or the task defines no "
            "truth on it; choose another floor or boundary",
            field="floor.source",
        )


def check_figures(values: Any, runs: int, name: str) -> Array:
    """Check the figures that a cost, possibly a user's function, returned, and convert them to (runs, 1).

    Args:
        values: what the cost returned: one number per run, (runs,) or (runs, 1).
        runs: number of runs that the cost was given. name: of the cost, for messages.
    Raises:
        InputError: the values are not numbers, not one per run, or some are not finite.
    """
    try:
        array = np.asarray(values)
        if array.dtype.kind in "cSUmM":  # complex numbers, texts and times, which NumPy would convert
            raise TypeError
        array = array.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        kind = getattr(values, "dtype", type(values).__name__)
        raise InputError(f"gives {kind}, not one number per run", field=name) from None
    array = array[:, None] if array.ndim == 1 else array  # one number per run is a single column
    if array.shape != (runs, 1):
        raise InputError(
            f"gives shape {np.shape(values)} for {runs} runs; return one number per run", field=name
        )
    if bad := np.flatnonzero(~np.isfinite(array).all(axis=1)).tolist():
        first = float(array[bad[0], 0])  # shown as an example
        raise InputError(
            f"gives {first} for {len(bad)} of {runs} runs; a cost is a finite number",
            field=name,
        )
    return array


def _error(outcomes: Outcomes, cost: str) -> Array:
    """Compute abs(f - f*), the absolute error of each robot's estimate of the fill ratio, (runs, robots).

    Args:
        outcomes: of some runs. cost: name of the cost that is computed from these errors, for the message.
    Raises:
        InputError: the robots of this strategy do not estimate the fill ratio.
    """
    lacking = np.isnan(outcomes.estimate)
    if lacking.any():
        strategy = f"strategy '{outcomes.strategy}'" if outcomes.strategy else "the strategy"
        has = (
            "keeps none"
            if lacking.all()
            else f"gave none for {lacking.sum()} of {count(lacking.size, 'robot')}"
        )
        raise InputError(
            f"'{cost}' needs each robot's estimate of the fill ratio, and {strategy} {has}; "
            "choose decision_time, errors, expected_time_to_right or time_at_error",
            field="objective.cost",
        )
    return np.abs(outcomes.estimate - outcomes.fill_ratio[:, None])


def _paper(outcomes: Outcomes, of_estimate: Array, undecided: float) -> Array:
    """Compute a cost of the paper (Eq. 23c), (runs, 1): the sum over robots of estimate factor times decision factor.

    Args:
        of_estimate: the factor for the error of the estimate, (runs, robots). undecided: the decision factor of an
            undecided robot.
    """
    check_truth(outcomes)
    of_decision = np.where(outcomes.wrong, WRONG, outcomes.time_s / outcomes.t_end_s)  # Eq. 23b
    of_decision = np.where(outcomes.undecided, undecided, of_decision)
    return np.asarray((of_estimate * of_decision).sum(axis=1, keepdims=True))  # Eq. 23c
