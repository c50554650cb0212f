"""Claims of the paper: each is measured as it says, and verdicts follow from limits and nothing else."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy import stats

from vibroswarm.paper.cells import Cells, cells_of, log_spread, share_saved
from vibroswarm.paper.claims import ALPHA, Claim, Limits, Value, all_claims, decide, mean, verdict_of
from vibroswarm.paper.columns import published, scenario_of
from vibroswarm.paper.items.experiments import POOL, subset_sd
from vibroswarm.paper.items.search import regrets
from vibroswarm.scenario.scenario import preset

CLAIMS = {claim.id: claim for claim in all_claims()}
FIGURES = (
    "decision_time_s",
    "belief_in_truth",
    "wrong_share",
    "avoid_per_sample_s",
    "distance_m",
    "estimate",
)


def shaken(study: str, column: str, runs: int = 50) -> Cells:
    """Cells of a study with random figures, no two alike."""
    random, cells = np.random.default_rng(3), cells_of(study, column)
    frames = [pl.DataFrame({name: random.uniform(0.4, 0.6, runs) for name in FIGURES}) for _ in cells]
    return Cells(column, cells, frames)


def estimates(claim: str, column: str = "paper") -> dict[str, float]:
    cells = shaken(CLAIMS[claim].study or CLAIMS[claim].item, column)
    return {one.cell: one.estimate for one in cells.measure(CLAIMS[claim])}


def test_every_claim_on_cells_has_its_values_in_every_column() -> None:
    for claim in all_claims():
        for column in claim.columns if claim.figure else ():
            found = [*shaken(claim.study or claim.item, column).measure(claim)]
            assert len(found) == claim.values, claim.id


def means(study: str, **wanted: Any) -> dict[str, float]:
    """Means of the time by floor, or by swarm size."""
    cells = shaken(study, "paper")
    figure = wanted.pop("figure", "decision_time_s")
    places = cells.where({name.replace("__", "."): value for name, value in wanted.items()})
    return {cells.cells[place].name: float(cells.by_run(place, figure).mean()) for place in places}


def test_claims_compare_the_cells_that_they_name() -> None:
    soft, none = (means("fill-ratios", strategy__name=name) for name in ("soft", "none"))
    gain = estimates("soft-gain-most-near-half")
    saved = [b - a for a, b in zip(soft.values(), none.values(), strict=True)]  # by fill ratio
    assert [*gain.values()] == pytest.approx([saved[1] - saved[0], saved[2] - saved[3]])
    assert [*estimates("soft-faster-than-none").values()] == pytest.approx([-one for one in saved])
    wanted: dict[str, Any] = {"strategy__name": "soft", "decision__min_observations": 381, "label": "0.46"}
    beliefs = np.array([*means("patterns", figure="belief_in_truth", **wanted).values()])
    steady = [
        value for name, value in estimates("patterns-steady").items() if "soft" in name and "381" in name
    ]
    assert steady[5:] == pytest.approx(beliefs - beliefs.mean())
    wanted = {"label": "with loss", "sensor__rms_threshold": 1.55, "decision__gate": "own"}
    ours = np.array([*means("experiments", strategy__name="positive", **wanted).values()])
    less = [*estimates("robots-times").values()][6:12]
    assert less == pytest.approx(ours - published("experiments.decision_time_s.positive"))


def test_losses_are_of_messages_addressed_to_a_robot_and_change_nothing_else() -> None:
    cells = cells_of("experiments", "paper")
    lossy = [cell for cell in cells if cell.point["label"] == "with loss"][:6]
    plotted = np.array(published("experiments.packet_loss_percent")) / 100
    robots = np.array([cell.scenario.swarm.robots for cell in lossy])
    shares = [cell.scenario.network.params.share for cell in lossy]
    assert shares == pytest.approx(plotted * robots / (robots - 1))
    without = cells[6].scenario
    assert lossy[0].scenario.with_values({"network.loss.share": 0.0}) == without
    ten = scenario_of("calibrated", {"swarm.robots": 10})
    assert ten == preset("calibrated-swarm")


@pytest.mark.parametrize(
    ("states", "verdict"),
    [
        (["within", "within"], "reproduced"),
        (["within", "open"], "inconclusive"),
        (["within", "outside"], "not reproduced"),
        (["outside", "cannot be asked"], "not reproduced"),
        (["within", "cannot be asked"], "cannot be asked"),
    ],
)
def test_verdicts(states: list[str], verdict: str) -> None:
    assert verdict_of(states) == verdict


def normal(x: float, level: float) -> Limits:
    half = float(stats.norm.ppf(0.5 + level / 2))
    return x - half, x + half


def test_a_false_verdict_in_a_column_is_as_rare_as_said() -> None:
    """All values just outside or inside; limits at 95 % each (the control) settle many falsely."""
    random, families = np.random.default_rng(11), 400
    bounds: dict[str, Any] = {"item": "i", "statement": "s", "measured": "m", "unit": "u"}
    claims = [Claim(id=f"c{k}", within=16.0, values=6, **bounds) for k in range(8)]
    for truth, false in ((16.001, "reproduced"), (15.999, "not reproduced")):
        wrong = {True: 0, False: 0}
        for _ in range(families):
            common = random.normal()
            x = truth + 0.7 * common + math.sqrt(1 - 0.49) * random.normal(size=(8, 6))
            for corrected in wrong:
                values = [
                    Value(f"c{k}", "paper", str(v), one, 100, partial(_at, corrected, one))
                    for k, row in enumerate(x)
                    for v, one in enumerate(row)
                ]
                wrong[corrected] += any(one.verdict == false for one in decide(values, claims))
        assert wrong[True] / families <= ALPHA + 2.7 * math.sqrt(ALPHA * (1 - ALPHA) / families)
        assert false == "reproduced" or wrong[False] / families > 0.2


def _at(corrected: bool, x: float, level: float) -> Limits:
    return normal(x, level if corrected else 0.95)


def test_limits_hold_the_truth_also_of_rare_events_and_of_published_means() -> None:
    random = np.random.default_rng(5)
    rare = [
        mean("a", "paper", "x", (random.random(100) < 0.02).astype(np.float64), apart=1.0).limits(0.95)
        for _ in range(1000)
    ]
    assert np.mean([low <= 0.02 <= high for low, high in rare]) >= 0.94
    missed = {0.0: 0, 250.0 / 15**0.5: 0}
    for _ in range(1000):
        ours, theirs = random.normal(600.0, 250.0, 400), float(random.normal(600.0, 250.0, 15).mean())
        for error in missed:
            low, high = mean("a", "paper", "x", ours, theirs, published_error=error).limits(0.95)
            missed[error] += not low <= 0.0 <= high
    without, with_error = missed.values()
    assert with_error / 1000 == pytest.approx(0.05, abs=0.02)
    assert without / 1000 > 0.5


@pytest.mark.parametrize(
    ("statistic", "truth"), [(share_saved, 0.2), (log_spread, math.log(math.hypot(240.0, 50.0) / 300.0))]
)
def test_statistics_of_two_cells_have_the_errors_of_repeated_draws(
    statistic: Callable[..., Any], truth: float
) -> None:
    random = np.random.default_rng(8)
    seconds = random.normal(900.0, 300.0, (400, 200))
    drawn = [statistic(0.8 * second + random.normal(0.0, 50.0, 200), second)[0] for second in seconds]
    found = np.array([values.mean() for values in drawn])
    assert found.mean() == pytest.approx(truth, abs=0.005)
    assert np.mean([values.std(ddof=1) / 200**0.5 for values in drawn]) == pytest.approx(
        found.std(), rel=0.12
    )


def test_a_choice_of_equal_worth_has_no_regret_and_a_worse_one_what_it_costs() -> None:
    random = np.random.default_rng(5)
    fair = [regrets(*random.normal(1.0, 1.0, (2, 12, 40))).mean() for _ in range(400)]
    assert abs(np.mean(fair)) < 4 * np.std(fair) / 20
    cost = np.linspace(0.0, 1.1, 12)
    there, here = (one[:, None] + random.normal(0.0, 0.02, (12, 400)) for one in (cost[::-1], cost))
    assert regrets(there, here).mean() == pytest.approx(1.1, abs=0.01)


def test_spread_over_subsets_is_that_of_all_subsets_of_a_pool() -> None:
    random, count = np.random.default_rng(7), 13
    chosen = np.array([*combinations(range(POOL), count)])
    pools = random.normal(0.17, 0.02, (600, POOL))
    variance = np.mean([pool[chosen].mean(axis=1).var() for pool in pools])
    drawn = random.normal(0.17, 0.02, (4000, count)).mean(axis=1) + random.normal(0.0, 0.001, 4000)
    still = 0.17 + random.normal(0.0, 0.001, 4000)
    assert subset_sd(drawn, still, count) == pytest.approx(math.sqrt(variance), rel=0.05)
    assert math.isnan(subset_sd(still, drawn, count))
