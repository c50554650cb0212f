"""Do strategies do here what their authors report? Claims of abstracts and public code, measured in the paper's arena.

Figures of the original papers hold for 20 to 400 robots with local radio and are not to be expected here; the direction
of an effect is. Each row is a paired difference over runs, averaged over floors, with its 95 % interval.

    python benchmarks/published_claims.py [--runs 400] [--seed 1]
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from vibroswarm.analysis.intervals import mean_interval
from vibroswarm.league.entries import Entry, floors_of
from vibroswarm.league.standings import League, Standings
from vibroswarm.scenario.scenario import preset

LONG: Final = {"run.t_end_s": 3600.0, "network.name": "ideal", "decision.min_observations": 0}
"""Long enough for nearly all to decide: the originals have no deadline."""
TIME, WRONG = "decision_time_s", "wrong"


@dataclass(frozen=True)
class Claim:
    """A difference that its authors report as negative.

    Args:
        source, words: who reports what. first, second: settings; figure of first - second. strategy: of both, or two.
    """

    source: str
    words: str
    strategy: tuple[str, str]
    first: Mapping[str, Any]
    second: Mapping[str, Any]
    figure: str
    fills: tuple[tuple[float, ...], tuple[float, ...]] = ((0.44,), (0.44,))


EBERT: Final = {"strategy.bayes_bots.prior": 10, "strategy.bayes_bots.positive_feedback": False}
OPINION: Final = {"patience": 4}


def of(name: str, **values: Any) -> dict[str, Any]:
    """Return fields of a strategy."""
    return {f"strategy.{name}.{field}": value for field, value in values.items()}


CLAIMS: Final = (
    Claim(
        "Ebert et al. 2020", "a longer time between readings makes fewer errors", ("bayes_bots", "bayes_bots"),
        {**EBERT, "sample.sample_interval_ms": 12000.0}, {**EBERT, "sample.sample_interval_ms": 1000.0}, WRONG,
    ),
    Claim(
        "Ebert et al. 2020", "positive feedback makes decisions faster", ("bayes_bots", "bayes_bots"),
        {**EBERT, "strategy.bayes_bots.positive_feedback": True}, EBERT, TIME,
    ),
    Claim(
        "Ebert et al. 2020", "positive feedback makes fewer errors", ("bayes_bots", "bayes_bots"),
        {**EBERT, "strategy.bayes_bots.positive_feedback": True}, EBERT, WRONG,
    ),
    Claim(
        "Ebert et al. 2020", "a stronger prior makes fewer errors", ("bayes_bots", "bayes_bots"),
        {**EBERT, "strategy.bayes_bots.prior": 50}, {**EBERT, "strategy.bayes_bots.prior": 1}, WRONG,
    ),
    Claim(
        "Shan, Mostaghim 2021", "DBBS makes fewer errors than DMVD", ("dbbs", "dmvd"),
        of("dbbs", decay_other=0.1), of("dmvd", **OPINION), WRONG,
    ),
    Claim(
        "Shan, Mostaghim 2021", "DBBS makes fewer errors than DC", ("dbbs", "dc"),
        of("dbbs", decay_other=0.1), of("dc", **OPINION), WRONG,
    ),
    Claim(
        "Valentini et al. 2016", "DMMD agrees sooner than DMVD", ("dmmd", "dmvd"),
        of("dmmd", **OPINION), of("dmvd", **OPINION), TIME,
    ),
    *(
        Claim(
            "Valentini et al. 2016", f"{name.upper()} errs less often far from one half", (name, name),
            of(name, **OPINION), of(name, **OPINION), WRONG, ((0.34,), (0.48,)),
        )
        for name in ("dc", "dmmd", "dmvd")
    ),
)  # fmt: skip


def play(
    strategy: str, values: Mapping[str, Any], fills: tuple[float, ...], runs: int, seed: int
) -> Standings:
    """Play one entry on random floors."""
    entry = Entry(strategy, strategy, dict(values))
    base = preset("paper").with_values(LONG)
    return League(base, (entry,), floors_of(["random"], fills), (5,), runs, seed).play()


def main() -> None:
    """Print one line a claim."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    for claim in CLAIMS:
        sides = [
            play(name, values, fills, arguments.runs, arguments.seed)
            for name, values, fills in zip(
                claim.strategy, (claim.first, claim.second), claim.fills, strict=True
            )
        ]
        first, second = (side.by_unit(0, claim.figure) for side in sides)
        found = mean_interval(first - second)
        holds = "holds" if found.high < 0 else "the reverse" if found.low > 0 else "not shown"
        unit, scale = ("s", 1.0) if claim.figure == TIME else ("points", 100.0)
        shares = [scale * float(side.mean()) for side in (first, second)]
        print(
            f"{claim.source:22} {claim.words:55} {holds:12} {shares[0]:7.1f} - {shares[1]:7.1f} = "
            f"{scale * found.estimate:+.1f} [{scale * found.low:+.1f}, {scale * found.high:+.1f}] {unit}",
            flush=True,
        )


if __name__ == "__main__":
    main()
