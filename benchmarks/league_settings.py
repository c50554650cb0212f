"""The settings that ship with the league against those of another tuning, in one league on fresh runs.

    python benchmarks/league_settings.py settings.toml [--strategy none,soft] [--runs 100] [--seed 302]

Printed for each strategy and forced error: the time on the front of each, and the difference, shipped - other, with
95 % limits of a bootstrap over motions, the same draws for both. No limits: a front does not reach the error in more
than one draw of twenty.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vibroswarm import preset
from vibroswarm.league.entries import entries_of, floors_of, frozen_settings, read_settings
from vibroswarm.league.fronts import drawn_means
from vibroswarm.league.standings import League
from vibroswarm.statistics.fronts import front_of, on_line
from vibroswarm.statistics.paired import drawn_interval

LEVELS = (0.15, 0.20)
"""Forced errors at which the fronts are compared."""


def main() -> None:
    """Play both settings of each strategy, and print how far apart their fronts are."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("settings", type=Path, help="file that 'vibroswarm league tune' wrote")
    parser.add_argument("--strategy", default="none,soft,positive,totals")
    parser.add_argument("--runs", type=int, default=100, help="of each floor and size")
    parser.add_argument("--seed", type=int, default=302, help="that of no tuning")
    arguments = parser.parse_args()
    names = arguments.strategy.split(",")
    shipped, other = (
        entries_of(names, settings) for settings in (frozen_settings(), read_settings(arguments.settings))
    )
    entries = [
        replace(entry, label=f"{place} {entry.label}", aim=None)
        for place, entry in enumerate((*shipped, *other))
    ]
    league = League(preset("paper"), tuple(entries), floors_of(), runs=arguments.runs, seed=arguments.seed)
    standings = league.play()
    times, errors = (drawn_means(standings, figure) for figure in ("decision_time_s", "forced_error"))
    for name in names:
        own = [
            [k for k in places if entries[k].strategy == name]
            for places in (range(len(shipped)), range(len(shipped), len(entries)))
        ]
        for level in LEVELS:
            first, second = (times_at(level, times[places], errors[places]) for places in own)
            found = drawn_interval(first - second, 2 * arguments.runs, "bootstrap of fronts")
            print(
                f"{name:<10} {level:.0%}: {first[0]:6.1f} and {second[0]:6.1f} s, shipped - other "
                f"{found.estimate:+.1f} [{found.low:+.1f}, {found.high:+.1f}] s"
            )


def times_at(level: float, times: NDArray[np.float64], errors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the time of a front at a forced error, of all runs and of each draw, (1 + draws,); nan: not reached.

    Args:
        times, errors: means of the front's settings, (settings, 1 + draws).
    """
    found: Sequence[float] = [
        on_line(level, *(each[::-1] for each in reversed(front_of(times[:, draw], errors[:, draw]))))
        for draw in range(times.shape[1])
    ]
    return np.array(found)


if __name__ == "__main__":
    main()
