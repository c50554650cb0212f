"""``vibroswarm league``: strategies compared on the same floors, motion, readings and radio."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import claim, deliver
from vibroswarm.cli.options import Paged, SwarmOptions, Where
from vibroswarm.cli.scenario_options import keywords_of, warned
from vibroswarm.cli.simulate import print_plan
from vibroswarm.cli.terminal import counting_runs


@dataclass(kw_only=True)
class Players(SwarmOptions):
    """Strategies, swarms and floors that play, and the scenario that they have in common."""

    seed: Annotated[int, Option("same scenario and seed: same result", "S", low=0, high=2**62)] = 1
    patterns: Annotated[tuple[str, ...] | None, Option("patterns of floors (default: the paper's five)")] = (
        None
    )
    fills: Annotated[
        tuple[float, ...] | None,
        Option("fill ratios below 0.5; each also mirrored (default 0.46,0.48)", "F,..."),
    ] = None
    shares: Annotated[
        tuple[float, ...] | None,
        Option(
            "shares of three kinds of tile or more, on random floors; each kind has each share once", "F,..."
        ),
    ] = None


@dataclass(kw_only=True)
class Entries:
    """With which settings strategies play."""

    settings_file: Annotated[
        Path | None,
        Option(
            "fields that each strategy sets, in TOML (default: those that ship)",
            name="--settings",
        ),
    ] = None
    untuned: Annotated[bool, Option("use the scenario's settings and each strategy's defaults")] = False
    own_motion: Annotated[
        bool, Option("each strategy moves as suits it: settings that were searched with motion")
    ] = False
    vary: Annotated[
        Sequence[str],
        Option(
            "one entry for each value, of one strategy or of all; may be repeated", "[STRATEGY:]FIELD=A,B,..."
        ),
    ] = ()


def league(
    *,
    runs: Annotated[int, Option("runs per floor and size")] = 300,
    by: Annotated[
        tuple[Literal["floor", "robots"], ...],
        Option("also standings of each floor, of each swarm size, or of both", "floor,robots"),
    ] = (),
    reference: Annotated[
        str | None, Option("entry that others are compared with (default: the first)")
    ] = None,
    scenario: Players,
    entries: Entries,
    execution: Where,
    output: Paged,
) -> None:
    """Compare strategies on the same floors, motion, readings and radio, with what each costs to send.

    An undecided robot that leans to the wrong side at the end counts as wrong (forced error).

    examples:
      vibroswarm league --runs 1000
      vibroswarm league --strategy none,soft --vary none:decision.credible_threshold=0.8,0.9,0.95 --out out/league
      vibroswarm league --strategy soft,mcp,mine.py:mine --settings frozen.toml --robots 5,10,20 --by robots
      vibroswarm league --own-motion --runs 300 --out out/own-motion
      vibroswarm league --shares 0.4,0.36,0.24
    """
    from vibroswarm.league.play import league_of, play

    floors = {name: getattr(scenario, name) for name in ("patterns", "fills", "shares")}
    chosen = league_of(runs=runs, seed=scenario.seed, **vars(entries), **floors, **keywords_of(scenario))
    warned(chosen.base)
    claim(output, "league", chosen.study.hash)
    print_plan(chosen.study)
    with counting_runs("simulating") as progress:
        standings = play(chosen, output.out, by=by, reference=reference, progress=progress, **execution.where)
    deliver(standings, output)
