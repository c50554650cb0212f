"""A cost of your own: what an inspection costs in money, and the parameters that make it cheap.

python examples/own_cost.py [BUDGET]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vibroswarm.search import Objective, Outcomes, Search, run_search, truth_of

PER_HOUR = 60.0
FALSE_ALARM = 40.0
MISS = 400.0
OPEN = 60.0
"""In euros: an hour of the site, work begun in vain, damage overlooked, an inspection without a clear outcome."""


def euros(outcomes: Outcomes) -> NDArray[np.float64]:
    """What each run costs. The swarm is right or wrong if all of its robots are, and open else."""
    right = outcomes.right.all(axis=1)
    wrong = outcomes.wrong.all(axis=1)
    of_wrong = np.where(outcomes.truth == 0, FALSE_ALARM, MISS)
    failure = np.where(wrong, of_wrong, np.where(right, 0.0, OPEN))
    return outcomes.time_s.max(axis=1) / 3600.0 * PER_HOUR + failure


def main(budget: int) -> None:
    """Search two fields of the decision and one of the walk for the least mean cost."""
    search = Search.read(Path(__file__).with_name("own_cost.toml"))
    search = replace(search, objectives=(Objective("euros", "mean", function=euros),))
    search = search.with_settings(budget=budget, fresh=max(20, budget // 2))
    found = run_search(search)
    truth = truth_of(found)
    print({name: round(value, 3) for name, value in found.values.items()})
    score, start = truth.winner.score, truth.others[0].score
    print(f"believed: {truth.believed:.1f} euros an inspection")
    print(f"true:     {score.estimate:.1f} [{score.low:.1f}, {score.high:.1f}], on {score.n} fresh runs")
    print(f"the start: {start.estimate:.1f} [{start.low:.1f}, {start.high:.1f}]")
    print("true - believed: {:.1f} [{:.1f}, {:.1f}]".format(*truth.bias[:3]))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("budget", type=int, nargs="?", default=3000, help="runs of the search; default: 3000")
    main(parser.parse_args().budget)
