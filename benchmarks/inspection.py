"""Measure how well simulated inspections, whose robots estimate their places, find and clear damage.

python benchmarks/inspection.py risk    true risk after clearing, and false calls, at 10, 5 and 1 %
python benchmarks/inspection.py pod     sizes that are found in 90 % of inspections
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from functools import cache

import numpy as np
import polars as pl
from scipy.stats import binomtest

from vibroswarm import preset, simulate
from vibroswarm.inspection.assessment import DRAWN, Question, risk_curve, statistic_for
from vibroswarm.inspection.damage import drawn_parts, squares_at
from vibroswarm.inspection.laws import law_of_scenario
from vibroswarm.inspection.patches import declared, shares_of
from vibroswarm.inspection.pod import plan
from vibroswarm.inspection.samples import Floats, Samples
from vibroswarm.inspection.scan import critical_value, drawn_statistics
from vibroswarm.inspection.sources import samples_of_result

PRESETS = ("optimised-places", "calibrated")
CONTRASTS = (0.5, 0.75, 1.0)
LEVELS = (0.1, 0.05, 0.01)
ENDS_S = (600.0, 1200.0)
RUNS = 2
KNOWN = 4999  # intact surfaces of a threshold: of fewer its own error would count as false calls


@cache
def inspections(name: str) -> list[Samples]:
    """Intact inspections: each run, ended at each time."""
    scenario = preset(name).with_values({"run.t_end_s": max(ENDS_S), "floor.source": "random:0.0"})
    result, law = simulate(scenario, 7, RUNS), law_of_scenario(scenario, "the scenario")
    whole = [samples_of_result(result, run, law) for run in range(RUNS)]
    return [one.where(pl.col("time_s") <= end_s) for one in whole for end_s in ENDS_S]


def risks(name: str, contrast: float, each: int) -> Iterator[tuple[Floats, Floats]]:
    """Risks of intact and of damaged surfaces of each inspection, by a curve of other surfaces."""
    question = Question(contrasts=(contrast,))
    for number, samples in enumerate(inspections(name)):
        statistic = statistic_for(samples, question)
        random = np.random.default_rng([number, round(100 * contrast)])

        def drawn(
            count: int, is_damaged: bool, samples=samples, statistic=statistic, random=random
        ) -> Floats:
            squares = squares_at(random, np.full(count, question.least_m), samples.size_m, contrast)
            parts = drawn_parts(random, samples, count, squares if is_damaged else None)
            return np.concatenate([statistic(part, True) for part in parts])

        risk = risk_curve(drawn(DRAWN, False), drawn(DRAWN, True), question.prior)
        yield risk(drawn(each, False)), risk(drawn(each, True))


def risk_rows(draws: int) -> Iterator[dict[str, object]]:
    """A row for each preset, contrast and tolerated risk: surfaces that are cleared, and the true risk."""
    for name in PRESETS:
        each = draws // (2 * len(inspections(name)))
        for contrast in CONTRASTS:
            found = list(risks(name, contrast, each))
            for level in LEVELS:
                sound, damaged = (sum(int((one[k] <= level).sum()) for one in found) for k in (0, 1))
                number = sound + damaged
                yield {
                    "preset": name, "contrast": contrast, "tolerated": level,
                    "cleared, intact": 2 * sound / draws, "cleared, damaged": 2 * damaged / draws,
                    "true risk": damaged / max(number, 1),
                    "p": binomtest(damaged, number, level, "greater").pvalue if number else 1.0,
                }  # fmt: skip


def call_rows(draws: int) -> Iterator[dict[str, object]]:
    """A row for each preset and level: intact surfaces that are called."""
    for name in PRESETS:
        called, each = dict.fromkeys(LEVELS, 0), draws // len(inspections(name))
        for number, samples in enumerate(inspections(name)):
            patches, random = declared(samples.size_m), np.random.default_rng(number)
            shares = shares_of(samples, patches)
            known, fresh = (drawn_statistics(random, samples, patches, shares, n) for n in (KNOWN, each))
            for level in LEVELS:
                called[level] += int((fresh >= critical_value(known, level)).sum())
        for level, number in called.items():
            p = binomtest(number, draws, level, "greater").pvalue
            yield {"preset": name, "level": level, "false calls": number / draws, "p": p}


def main() -> None:
    """Print the tables that are asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("risk", "pod"))
    parser.add_argument("--draws", type=int, default=2000, help="surfaces of each cell")
    parser.add_argument("--runs", type=int, default=40, help="inspections of a plan")
    options = parser.parse_args()
    with pl.Config(tbl_rows=-1, tbl_width_chars=120):
        if options.what == "risk":
            print(pl.DataFrame(list(risk_rows(options.draws))))
            print(pl.DataFrame(list(call_rows(options.draws))))
        else:
            for name in PRESETS:
                print(name, plan(preset(name), [5], [300.0, 600.0, 1200.0], runs=options.runs))


if __name__ == "__main__":
    main()
