"""Draws of where samples were taken, each along one path: errors that neighbouring samples share are in all of them.

A draw follows one component of the mixture of ``localisation`` through its corrections, and through resampling by its
descendants; it leaves it for another as seldom as the weights allow. What is left to chance within a component is
stated as a spread, as for the mixture.

| name | symbol | unit | equation |
|---|---|---|---|
| weight of a line | M_c | - | sum of the weights of the components that descend from component c of the last sample |
| draw stays in its line | - | - | with probability min(1, M_c / w_c), w_c the weight of c at the last sample |
| else goes to line l | - | - | with probability as max(M_l - w_l, 0): a maximal coupling, so draws have the weights |
| place | - | m | smoothed place of the component; farther from the mean of all by the monitor's factor |
| spread | - | m | root of the mean of the components' variances, times that factor |

All draws of a robot are alike in law, and independent given what it measured. The mixture is not changed by them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner
from vibroswarm.robot.localisation import WIDEN_MOST, WIDEN_SLOPE
from vibroswarm.robot.pose_mixture import SAMPLES, WORD, LocalisationProgram, Mixture, excess


class Paths(NamedTuple):
    """Memory of a robot's draws; of none of them if there are none."""

    component: NDArray[np.int64]
    """(draws,): that it follows."""
    weights: NDArray[np.float64]
    """(components,): at the last sample."""
    lines: NDArray[np.float64]
    """(components,): scratch: weight of each line."""
    random: NDArray[np.int64]
    """(1,): state of the random numbers."""


def width_of(draws: int) -> int:
    """Return how many numbers ``draw_places`` writes for ``draws`` draws: 0 for none."""
    return 2 * draws + 2 if draws > 0 else 0


def empty_paths(draws: int, components: int) -> Paths:
    """Allocate the memory of a robot's draws."""
    return Paths(
        np.zeros(draws, dtype=np.int64),
        np.zeros(components),
        np.zeros(components),
        np.zeros(1, dtype=np.int64),
    )


@inlined
def path_uniform(paths: Paths) -> float:
    """Return the next random number in (0, 1), as ``pose_mixture.next_uniform`` does."""
    word: int = paths.random[0]
    word ^= (word << 13) & WORD
    word ^= word >> 17
    word ^= (word << 5) & WORD
    paths.random[0] = word
    return (word + 0.5) / 4294967296.0


@inner
def begin_paths(f: Mixture, paths: Paths, random: int) -> None:
    """Start at components drawn by weight.

    Args:
        random: state of the random numbers, from 1 to 2^32 - 1.
    """
    paths.random[0] = random
    remember_components(f, paths)
    for k in range(paths.component.size):
        paths.component[k] = chosen_in(f, paths, -1, 1.0)


@inlined
def remember_components(f: Mixture, paths: Paths) -> None:
    """Let each component begin a line of its own, with its present weight."""
    for i in range(f.weights.size):
        paths.weights[i] = f.weights[i]
        f.copies[f.weights.size + i] = i


@inner
def draw_places(f: Mixture, program: LocalisationProgram, paths: Paths, out: NDArray[np.float64]) -> None:
    """Write the place of the sample ``lag`` ago on each path. Call it before ``localisation.sampled``.

    Args:
        out: (2 draws + 2,): x and y by draw, then the spreads in x and y, m; nan while there is no such sample.
    """
    lag, draws = f.past.shape[1], paths.component.size
    slot = f.numbers[SAMPLES] % lag
    follow_components(f, paths)
    remember_components(f, paths)
    if f.numbers[SAMPLES] < lag:
        for n in range(out.size):
            out[n] = math.nan
        return
    factor = min(1.0 + WIDEN_SLOPE * excess(f, program), WIDEN_MOST)
    for axis in range(2):
        mean_m, variance = 0.0, 0.0
        for i in range(f.weights.size):
            mean_m += f.weights[i] * f.past[i, slot, axis]
            variance += f.weights[i] * max(f.past_variances[i, slot, axis], 0.0)
        out[2 * draws + axis] = factor * math.sqrt(variance)
        for k in range(draws):
            out[2 * k + axis] = mean_m + factor * (f.past[paths.component[k], slot, axis] - mean_m)


@inner
def follow_components(f: Mixture, paths: Paths) -> None:
    """Let each draw follow a descendant of its component, or go to another line, so that draws are distributed by
    weight."""
    count, grown = f.weights.size, 0.0
    for i in range(count):
        paths.lines[i] = 0.0
    for i in range(count):
        paths.lines[f.copies[count + i]] += f.weights[i]
    for i in range(count):
        grown += max(paths.lines[i] - paths.weights[i], 0.0)
    for k in range(paths.component.size):
        line = paths.component[k]
        if path_uniform(paths) * paths.weights[line] >= paths.lines[line]:
            at = path_uniform(paths) * grown
            for i in range(count):
                more = paths.lines[i] - paths.weights[i]
                if more > 0.0:
                    line = i
                    at -= more
                    if at <= 0.0:
                        break
        paths.component[k] = chosen_in(f, paths, line, paths.lines[line])


@inlined
def chosen_in(f: Mixture, paths: Paths, line: int, weight: float) -> int:
    """Return a component of a line, drawn by weight.

    Args:
        line: number of the line, -1: any. weight: sum of the weights of its components.
    """
    at, chosen = path_uniform(paths) * weight, 0
    for i in range(f.weights.size):
        if f.weights[i] > 0.0 and (line < 0 or f.copies[f.weights.size + i] == line):
            chosen = i
            at -= f.weights[i]
            if at <= 0.0:
                break
    return chosen
