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
USUAL_S: Final = 0.3
"""Intervals without avoidance are the usual one if they differ by no more from the most frequent duration, s."""
COUNTED: Final = 0.2
"""Where avoidance counts, at least this share of the intervals with avoidance is as long as the usual one, and more are
than are a little longer."""
SOME: Final = 0.05
"""If avoidance does not count, only ``reset_at_avoidance`` has a share of shorter rests above this."""
FEW: Final = 0.01
"""Of other rules fewer rests than this are shorter, from lost rows and late times."""
FROZEN: Final = 0.33
"""Avoidance is not counted, and nothing is reset, if at least this share of the rests is as long as the usual interval;
a timer held at 0 has a small share: avoidances that begin right after a sample."""
MANY: Final = 0.5
"""If a larger share of intervals without avoidance has turns, many have more than one, and say nothing of one turn."""
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
    usual_s = float(np.median(usual_of(calm)))
    avoids = known.filter(pl.col("avoid_s") > MARGIN_S, pl.col("avoid_s") <= tau.value / 1000.0)
    avoid_s = avoids["avoid_s"].to_numpy()
    spacing_s = avoids["spacing_s"].to_numpy()
    rest_s = spacing_s - avoid_s
    if rest_s.size < LEAST:
        return undetermined(NAME, f"{rest_s.size} intervals with avoidance: too few")
    excess_s = spacing_s - usual_s
    counted = float((np.abs(excess_s) <= MARGIN_S).mean())
    later = float(((excess_s > MARGIN_S) & (excess_s <= 3.0 * MARGIN_S)).mean())
    shorter = float((rest_s < usual_s - MARGIN_S).mean())
    alike = float((np.abs(rest_s - usual_s) <= MARGIN_S).mean())
    words = (
        f"of {rest_s.size} intervals with avoidance, {percent(counted, 0)} are as long as the usual "
        f"{number(usual_s, 2)} s; less the avoidance {percent(shorter, 0)} are shorter and {percent(alike, 0)} as "
        f"long, median {number(np.median(rest_s), 2)} s"
    )
    if counted > max(later, COUNTED):
        return _counted(calm - usual_s, float(np.median(avoid_s)), words)
    if shorter > SOME:
        return Inferred(NAME, "reset_at_avoidance", None, None, words)
    if shorter > FEW:
        return undetermined(
            NAME, f"{words}: too few are shorter to tell whether avoidances set the timer to 0"
        )
    return Inferred(
        NAME, "frozen_in_avoidance" if alike >= FROZEN else "held_at_avoidance", None, None, words
    )


def usual_of(spacing_s: Floats) -> Floats:
    """Return the durations near the most frequent one of some intervals without avoidance, s.

    An interval is longer if the robot first had to finish a turn.

    Args:
        spacing_s: at least one duration, s.
    """
    # Find the window of width USUAL_S (two neighbouring bins of a histogram) with the most intervals.
    edges = np.arange(0.0, spacing_s.max() + USUAL_S, USUAL_S / 2)
    in_windows = np.convolve(np.histogram(spacing_s, edges)[0], [1, 1], "valid")
    middle_s = edges[int(np.argmax(in_windows))] + USUAL_S / 2
    # The edges are those of bins, which may cut the usual intervals anywhere. A log with rows every 0.2 s has intervals
    # on both sides of the true one, of which only the mean is right: so take them around the window's median.
    middle_s = float(np.median(spacing_s[np.abs(spacing_s - middle_s) <= USUAL_S / 2]))
    return spacing_s[np.abs(spacing_s - middle_s) <= USUAL_S]


def _counted(excess_s: Floats, turn_s: float, words: str) -> Inferred:
    """Infer what the timer does in turns at the end of legs, if it counts avoidance.

    Args:
        excess_s: durations of intervals without avoidance minus the usual one. turn_s: how long a turn lasts, s.
        words: the evidence so far.
    """
    longer = excess_s[excess_s > MARGIN_S]
    if longer.size > MANY * excess_s.size:
        return undetermined(NAME, f"{words}: avoidance counts; many intervals hold more than one turn")
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
