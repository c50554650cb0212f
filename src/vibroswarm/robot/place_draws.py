"""Random paths of where samples were taken, so that the places on one path share the errors of neighbouring samples.

Each draw is one path. It follows one component of the mixture of ``localisation`` and, after resampling, one of the
component's copies (its descendants). A "line" is the set of all components that descend from one component of the last
sample. A draw changes to another line as seldom as the weights allow. The uncertainty within a component is not drawn,
but stated as a spread.

| name | symbol | unit | equation |
|---|---|---|---|
| weight of a line | M_c | - | sum of the weights of the components that descend from component c of the last sample |
| draw stays in its line | - | - | with probability min(1, M_c / w_c), w_c the weight of c at the last sample |
| else changes to line l | - | - | with probability proportional to max(M_l - w_l, 0) |
| place | - | m | smoothed place of the component; its distance from the mean of all is scaled by the monitor's factor |
| spread | - | m | root of the mean of the components' variances, times that factor |

The two probabilities are a maximal coupling: after each sample the draws are distributed by the components' weights.
All draws of a robot have the same distribution, and are independent given what it measured. They do not change the
mixture, except for ``f.copies``, whose second half holds the line of each component.
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
    """Memory of a robot's draws."""

    component: NDArray[np.int64]
    """(draws,): index of the component that each draw follows."""
    weights: NDArray[np.float64]
    """(components,): weights of the components at the last sample."""
    lines: NDArray[np.float64]
    """(components,): scratch: weight of each line now, M_c."""
    random: NDArray[np.int64]
    """(1,): state of the random numbers."""


def width_of(draws: int) -> int:
    """Return how many numbers ``draw_places`` writes: x and y of each draw and two spreads; 0 if there are no draws."""
    return 2 * draws + 2 if draws > 0 else 0


def empty_paths(draws: int, components: int) -> Paths:
    """Allocate the memory of a robot's draws; all numbers are 0 until ``begin_paths`` is called.

    Args:
        draws: number of draws. components: number of components of the mixture.
    """
    return Paths(
        np.zeros(draws, dtype=np.int64),  # component
        np.zeros(components),  # weights
        np.zeros(components),  # lines
        np.zeros(1, dtype=np.int64),  # random
    )


@inlined
def path_uniform(paths: Paths) -> float:
    """Return the next random number in (0, 1), by xorshift; advance the state ``paths.random``."""
    word: int = paths.random[0]
    word ^= (word << 13) & WORD
    word ^= word >> 17
    word ^= (word << 5) & WORD
    paths.random[0] = word
    return (word + 0.5) / 4294967296.0  # 2^32; the 0.5 excludes 0 and 1


@inner
def begin_paths(f: Mixture, paths: Paths, random: int) -> None:
    """Start each path at a component that is drawn by weight.

    Args:
        f: the mixture, started. random: initial state of the paths' random numbers, from 1 to 2^32 - 1.
    """
    paths.random[0] = random
    remember_components(f, paths)
    for k in range(paths.component.size):
        paths.component[k] = chosen_in(f, paths, -1, 1.0)  # -1: of any line; 1.0: the sum of all weights


@inlined
def remember_components(f: Mixture, paths: Paths) -> None:
    """Let each component begin a line with its own number, and save the present weights as those of the last sample.

    The second half of ``f.copies`` holds the line's number of each component; resampling copies it with the component.
    """
    for i in range(f.weights.size):
        paths.weights[i] = f.weights[i]
        f.copies[f.weights.size + i] = i


@inner
def draw_places(f: Mixture, program: LocalisationProgram, paths: Paths, out: NDArray[np.float64]) -> None:
    """Advance each path by a sample, and write the place of the sample ``lag`` ago on each path.

    Call it before ``localisation.sampled``, which overwrites that sample's slot.

    Args:
        out: (2 draws + 2,): overwritten by x and y of each draw, then the spreads in x and in y, m. All are nan if
            fewer than ``lag`` samples came before this one.
    """
    lag, draws = f.past.shape[1], paths.component.size
    slot = f.numbers[SAMPLES] % lag
    follow_components(f, paths)
    remember_components(f, paths)
    if f.numbers[SAMPLES] < lag:
        for n in range(out.size):
            out[n] = math.nan
        return
    # The factor by which ``localisation.sampled`` widens its spreads while recent obstacles contradict the estimated
    # pose more often than usual (``excess``). Draws are moved away from their mean by it.
    factor = min(1.0 + WIDEN_SLOPE * excess(f, program), WIDEN_MOST)
    for axis in range(2):
        mean_m, variance = 0.0, 0.0
        for i in range(f.weights.size):
            mean_m += f.weights[i] * f.past[i, slot, axis]
            # Corrections may leave a variance slightly below 0 by rounding.
            variance += f.weights[i] * max(f.past_variances[i, slot, axis], 0.0)
        out[2 * draws + axis] = factor * math.sqrt(variance)
        for k in range(draws):
            out[2 * k + axis] = mean_m + factor * (f.past[paths.component[k], slot, axis] - mean_m)


@inner
def follow_components(f: Mixture, paths: Paths) -> None:
    """Move each draw to a component of its own line, or of another line, with the probabilities of the module's table.

    The draws are then distributed by the present weights of the components. Only ``paths`` is changed.
    """
    # grown: sum of the gains in weight of all lines whose weight has grown.
    count, grown = f.weights.size, 0.0
    for i in range(count):
        paths.lines[i] = 0.0
    for i in range(count):
        paths.lines[f.copies[count + i]] += f.weights[i]
    for i in range(count):
        grown += max(paths.lines[i] - paths.weights[i], 0.0)
    for k in range(paths.component.size):
        # The draw's component at the last sample is also the number of the draw's line.
        line = paths.component[k]
        # With probability 1 - min(1, M_c / w_c) the draw leaves its line for one whose weight has grown, which is drawn
        # with probability proportional to its gain ``more`` (the last such line if rounding leaves ``at`` above 0).
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
    """Return the index of a component of a line, drawn by weight.

    Args:
        line: number of the line, or -1 for components of any line. weight: sum of the weights of these components,
            above 0.
    """
    at, chosen = path_uniform(paths) * weight, 0
    # If rounding leaves ``at`` above 0, the last of these components is chosen, but never one of weight 0.
    for i in range(f.weights.size):
        if f.weights[i] > 0.0 and (line < 0 or f.copies[f.weights.size + i] == line):
            chosen = i
            at -= f.weights[i]
            if at <= 0.0:
                break
    return chosen
