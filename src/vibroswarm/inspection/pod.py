"""What an inspection would have missed: probability of detection (PoD) against the size of drawn damage.

| name | symbol | equation |
|---|---|---|
| probability of detection | PoD(a) | p_f + (1 - p_f) F(b0 + b1 ln a), F logistic (log-odds, MIL-HDBK-1823A) |
| false calls | p_f | share of intact surfaces that are called |
| size found in 50, 90 % | a50, a90 | PoD(a50) = .5, PoD(a90) = .9 |
| penalised log likelihood | l | log likelihood + ln(det I) / 2, I the Fisher information of b0 and b1 |
| limit of a90 | a90/95 | largest a with 2 (l_max - l(a90 = a)) <= 2.706, l at its largest over b1 |

The most likely curve of few inspections is too steep, and its a90 too small. The penalty (Jeffreys; Firth 1993) takes
most of that away, and keeps the slope finite where all damage above a size was found and none below. A fit that leaves
p_f out takes false calls on small damage for detections.

Model-assisted PoD: damage is drawn from the law of the sensor, so that it is as right as this law, at the places and
times of this inspection; another one has other places (``pooled_trials``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from scipy import optimize
from scipy.special import expit, logit, xlogy

from vibroswarm.inspection.damage import squares_at
from vibroswarm.inspection.laws import law_of_scenario
from vibroswarm.inspection.patches import Patches, Shares, declared, shares_of
from vibroswarm.inspection.samples import Floats, Samples
from vibroswarm.inspection.scan import critical_value, drawn_statistics
from vibroswarm.inspection.sources import samples_of_result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate
from vibroswarm.statistics.intervals import generator

INTACT: Final = 2000
"""Intact inspections that give p_f to half a percent."""
DROP: Final = 2.706
"""Chi squared with one degree of freedom at 90 %: a one-sided limit of 95 %."""
BEYOND: Final = 1.5
"""a90/95 is looked for up to so many times the largest size that was tried."""
STARTS: Final = (2.0, 6.0, 20.0)
"""Slopes b1 from which the largest likelihood is looked for."""


class Pod(NamedTuple):
    """A fitted probability of detection; sizes are nan where they do not exist."""

    false_calls: float
    b0: float
    b1: float
    a50_m: float
    a90_m: float
    a90_95_m: float
    """Upper 95 % limit of a90."""
    trials: int

    def at(self, size_m: Floats | float) -> Floats:
        """Return PoD at sizes."""
        return np.asarray(
            self.false_calls + (1.0 - self.false_calls) * expit(self.b0 + self.b1 * np.log(size_m))
        )


def fit_pod(size_m: Floats, found: Floats, false: int, intact: int) -> Pod:
    """Fit PoD to inspections."""
    sizes, at = np.unique(size_m, return_inverse=True)
    number, hits = np.bincount(at), np.bincount(at, found)
    p_f, log_size = false / intact, np.log(sizes)
    centre, largest = float(log_size.mean()), float(log_size[-1])

    def penalised(b0: float, b1: float) -> float:
        rise = expit(b0 + b1 * (log_size - centre))
        p = np.clip(p_f + (1.0 - p_f) * rise, 1e-9, 1.0 - 1e-9)
        weight = number * ((1.0 - p_f) * rise * (1.0 - rise)) ** 2 / (p * (1.0 - p)) + 1e-18
        about = log_size - np.average(log_size, weights=weight)
        likely = float((xlogy(hits, p) + xlogy(number - hits, 1.0 - p)).sum())
        return -likely - 0.5 * float(np.log(weight.sum() * (weight @ about**2)))

    minimize: Any = optimize.minimize  # its stubs allow no lambda
    fits = [minimize(lambda b: penalised(*b), [0.0, start], method="Nelder-Mead") for start in STARTS]
    (b0, b1), least = min(((fit.x, fit.fun) for fit in fits), key=lambda fit: fit[1])

    def log_size_at(share: float) -> float:
        """Return ln of the size found in a share of inspections; nan: none that was tried."""
        at = (logit((share - p_f) / (1.0 - p_f)) - b0) / b1 + centre if p_f < share and b1 > 0.0 else np.nan
        return float(at) if at <= largest else float("nan")

    a90 = log_size_at(0.9)

    def excess(log_a: float) -> float:
        """Return twice the loss of log likelihood if ln a90 is this, less what is allowed."""
        x, steep = logit((0.9 - p_f) / (1.0 - p_f)), np.log(max(b1, 0.3))
        found = optimize.minimize_scalar(
            lambda log: penalised(x - np.exp(log) * (log_a - centre), np.exp(log)),
            bounds=(steep - 5.0, steep + 5.0), method="bounded",
        )  # fmt: skip
        return float(2.0 * (found.fun - least) - DROP)

    high, limit = largest + np.log(BEYOND), float("nan")
    if np.isfinite(a90) and excess(high) > 0.0:
        limit = float(optimize.brentq(excess, a90, high, xtol=1e-5))
    a50_m, a90_m, a90_95_m = np.exp([log_size_at(0.5), a90, limit]).tolist()
    return Pod(p_f, float(b0 - b1 * centre), float(b1), a50_m, a90_m, a90_95_m, at.size)


SIDES_M: Final = (0.03, 0.05, 0.07, 0.09, 0.12, 0.15, 0.2, 0.25, 0.3)
"""Sides of the drawn damage; on a surface that is smaller all are scaled down to it."""
EACH: Final = 60
"""Damaged surfaces drawn of each side."""


class Trials(NamedTuple):
    """Inspections of drawn damage, (inspections,) each, and of intact surfaces."""

    size_m: Floats
    found: Floats
    false: int
    intact: int

    def fit(self) -> Pod:
        """Return the fitted PoD."""
        return fit_pod(*self)


def own_trials(
    samples: Samples, patches: Patches, shares: Shares, critical: float, *, contrast: float = 1.0, each: int = EACH,
    intact: int = INTACT, seed: int = 2,
) -> Trials:  # fmt: skip
    """Draw damage, and intact surfaces, at the places of one inspection, and scan them."""
    random = generator(seed, f"damage of contrast {contrast:g}")
    sides_m = np.array(SIDES_M) * min(1.0, min(samples.size_m) / SIDES_M[-1])
    size_m = np.repeat(sides_m, each)
    squares = squares_at(random, size_m, samples.size_m, contrast)
    damaged = drawn_statistics(random, samples, patches, shares, size_m.size, squares)
    whole = drawn_statistics(random, samples, patches, shares, intact)
    return Trials(size_m, (damaged >= critical).astype(np.float64), int((whole >= critical).sum()), intact)


def pooled_trials(
    inspections: Sequence[Samples], fresh: Sequence[Samples], *, each: int = 5, level: float = 0.05, seed: int = 3,
    contrast: float = 1.0,
) -> Trials:  # fmt: skip
    """Draw damage in many inspections, and call it by a threshold from intact inspections of other motion."""
    patches = declared(inspections[0].size_m)
    each_intact = max(1, INTACT // len(fresh))
    critical = critical_value(
        np.concatenate([
            drawn_statistics(generator(seed + number, "fresh"), one, patches, shares_of(one, patches), each_intact)
            for number, one in enumerate(fresh)
        ]),
        level,
    )  # fmt: skip
    trials = [
        own_trials(one, patches, shares_of(one, patches), critical, contrast=contrast, each=each,
                   intact=max(1, INTACT // len(inspections)), seed=seed + 100_000 + number)
        for number, one in enumerate(inspections)
    ]  # fmt: skip
    sizes_m, found, called, inspected = zip(*trials, strict=True)
    return Trials(np.concatenate(sizes_m), np.concatenate(found), sum(called), sum(inspected))


def plan(
    scenario: Scenario, robots: Sequence[int], until_s: Sequence[float], *, runs: int = 40, seed: int = 1,
    each: int = 5, level: float = 0.05, progress: Callable[[float], None] | None = None,
) -> pl.DataFrame:  # fmt: skip
    """Return what robots and time buy: a50, a90, their limit and false calls, by number of robots and end."""
    rows: list[tuple[float, ...]] = []
    for number in robots:
        intact = {"floor.source": "random:0.0", "floor.tiles": None}
        ends = {"swarm.robots": number, "run.t_end_s": max(until_s)}
        simulated = scenario.with_values(intact | ends)
        result, law = simulate(simulated, seed, runs), law_of_scenario(simulated, "the scenario")
        inspections = [samples_of_result(result, run, law) for run in range(runs)]
        for end_s in until_s:
            ended = [one.where(pl.col("time_s") <= end_s) for one in inspections]
            pod = pooled_trials(
                ended[: runs // 2], ended[runs // 2 :], each=each, level=level, seed=seed
            ).fit()
            samples = float(np.mean([one.frame.height for one in ended]))
            rows.append((number, end_s, samples, pod.a50_m, pod.a90_m, pod.a90_95_m, pod.false_calls))
            if progress is not None:
                progress(len(rows) / (len(robots) * len(until_s)))
    names = ["robots", "until_s", "samples", "a50_m", "a90_m", "a90_95_m", "false_calls_share"]
    return pl.DataFrame(rows, schema=names, orient="row").fill_nan(None)
