"""Infer the rule of the sample timer (``sample.timer``) from the intervals between samples.

| name | symbol | meaning |
|---|---|---|
| usual | u | usual time between two samples without avoidance or turn: tau, a stop and two ticks |
| spacing | s | time between two samples |
| avoidance | a | time spent avoiding between them |
| rest | r = s - a | what is left |
| margin | w | smallest difference that counts (``MARGIN_S``): the rows of a log may be a quarter of a second late |

How long a rest lasts depends on what the timer does in an avoidance that begins d after it was 0 and lasts a < tau:

| rule | interval s | rest r |
|---|---|---|
| avoidance counts | u (longer only if an avoidance is finished first) | u - a |
| ``frozen_in_avoidance`` | u + a | u |
| ``reset_at_avoidance`` | u + d | u + d - a: shorter or longer than u |
| ``held_at_avoidance`` | u + d + a | u + d: never shorter than u |

Where avoidance counts, turns tell three rules apart: with ``always`` no interval without avoidance is longer than u; with
``hold_in_turn`` it is longer by the turn, and with ``reset_after_turn`` by the turn and the time since the timer was 0. Turns at the
end of legs and in avoidances are alike, so the median avoidance says how long a turn lasts.
"""  # noqa: E501

from __future__ import annotations

from typing import Final

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Floats
from vibroswarm.core.numbers import number, percent, stated
from vibroswarm.recordings.inferred import Inferred, undetermined

NAME: Final = "sample.timer"
MARGIN_S: Final = 0.3
"""Times that differ by less count as equal, s."""
LEAST: Final = 30
"""Fewest intervals with avoidance, and fewest calm intervals with turns, that tell rules apart."""
LEAST_TAU_S: Final = 1.5
"""With a shorter sample interval, avoidances that are shorter than it are too short to tell rules apart, s."""
COUNTED: Final = 0.65
"""Avoidance counts if at least this share of the rests is shorter than the usual interval."""
SOME: Final = 0.05
"""Only ``reset_at_avoidance`` has a share between this and ``COUNTED``. Rules under which no rest is shorter have less,
from lost rows and late times."""
FROZEN: Final = 0.5
"""Avoidance is not counted, and nothing is reset, if at least this share of the rests is as long as the usual interval;
a timer held at 0 has a small share: avoidances that begin right after a sample."""
TURNS: Final = 1.4
"""The timer is reset after turns if intervals with turns are longer than the usual one by more than this many median
avoidances (with the study's settings 1.9 to 2.6), and held in them if by less (1.0 to 1.2)."""


def infer_timer(between: pl.DataFrame, tau: Inferred) -> Inferred:
    """Infer the rule of the sample timer; undetermined without logged avoidance or with too few intervals.

    Args:
        between: ``infer_settings.intervals_of``.
        tau: setting from ``infer_tau``; without it no interval is known to be the usual one.
    """
    if between["avoid_s"].null_count() == between.height:
        return undetermined(NAME, "avoidance is not logged")
    if tau.value is None or tau.value < 1000.0 * LEAST_TAU_S:
        words = "unknown" if tau.value is None else f"below {stated(LEAST_TAU_S)} s"
        return undetermined(NAME, f"tau is {words}")
    known = between.filter(pl.col("whole"), pl.col("spacing_s").is_not_null())
    calm = known.filter(pl.col("avoid_s") == 0)["spacing_s"].to_numpy()
    usual_s = float(np.median(calm))
    avoids = known.filter(pl.col("avoid_s") > MARGIN_S, pl.col("avoid_s") <= tau.value / 1000.0)
    avoid_s = avoids["avoid_s"].to_numpy()
    rest_s = avoids["spacing_s"].to_numpy() - avoid_s
    if rest_s.size < LEAST:
        return undetermined(NAME, f"{rest_s.size} intervals with avoidance: too few")
    shorter = float((rest_s < usual_s - MARGIN_S).mean())
    alike = float((np.abs(rest_s - usual_s) <= MARGIN_S).mean())
    words = (
        f"of {rest_s.size} intervals with avoidance, less the avoidance {percent(shorter, 0)} are shorter than the "
        f"usual {number(usual_s, 2)} s and {percent(alike, 0)} as long, median {number(np.median(rest_s), 2)} s"
    )
    if shorter >= COUNTED:
        return _counted(calm - usual_s, float(np.median(avoid_s)), words)
    if shorter > SOME:
        return Inferred(NAME, "reset_at_avoidance", None, None, words)
    return Inferred(
        NAME, "frozen_in_avoidance" if alike >= FROZEN else "held_at_avoidance", None, None, words
    )


def _counted(excess_s: Floats, turn_s: float, words: str) -> Inferred:
    """Infer what the timer does in turns at the end of legs, if it counts avoidance.

    Args:
        excess_s: durations of intervals without avoidance minus the usual one. turn_s: how long a turn lasts, s.
        words: the evidence so far.
    """
    longer = excess_s[excess_s > MARGIN_S]
    if longer.size < LEAST:
        share = longer.size / excess_s.size
        if excess_s.size >= 10 * LEAST and share < 0.01:
            return Inferred(
                NAME, "always", None, None, f"{words}; {longer.size} of {excess_s.size} others are longer"
            )
        return undetermined(NAME, f"{words}: avoidance counts; {longer.size} intervals with turns: too few")
    rule = "reset_after_turn" if np.median(longer) > TURNS * turn_s else "hold_in_turn"
    words += (
        f"; with a turn at the end of a leg, {number(np.median(longer), 2)} s longer, and avoidances last "
        f"{number(turn_s, 2)} s"
    )
    return Inferred(NAME, rule, None, None, words)
