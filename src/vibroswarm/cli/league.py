"""``vibroswarm league``: strategies compared on the same floors, motion, readings and radio.

A league is such a comparison. An entry of a league is a strategy with its settings. The forced error is the share of
wrong robots, where an undecided robot counts as if it had decided for the answer that it believes more at the end.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import deliver, print_document, print_saved_file
from vibroswarm.cli.interruption import folder_of_runs, saves_in
from vibroswarm.cli.options import (
    Force,
    Paged,
    Saved,
    ScenarioBase,
    SeveralSizes,
    SeveralStrategies,
    Where,
)
from vibroswarm.cli.out_folder import claim
from vibroswarm.cli.progress import STAGES, progress_bar
from vibroswarm.cli.scenario_options import warned, words_of
from vibroswarm.cli.studies import claim_study, print_plan
from vibroswarm.cli.terminal import say
from vibroswarm.core.atomic_io import whole_file, write_files


@dataclass(kw_only=True)
class Players(ScenarioBase, SeveralSizes, SeveralStrategies):
    """Strategies, swarms and floors that play, and the scenario that they have in common."""

    # The two seeds that follow are those of tests and of later rounds.
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
class Tuned(Players):
    """The same, on runs that no league has unless its seed is given."""

    # The settings of a tuning were chosen by runs of three seeds; by default a league has 1 and the two that follow.
    seed: Annotated[int, Option("same scenario and seed: same result", "S", low=0, high=2**62)] = 101


@dataclass(kw_only=True)
class Entries:
    """With which settings strategies play."""

    settings_file: Annotated[
        Path | None,
        Option(
            "fields that each strategy sets, in TOML (default: those found by 'vibroswarm league tune')",
            name="--settings",
        ),
    ] = None
    untuned: Annotated[bool, Option("use the scenario's settings and each strategy's defaults")] = False
    own_motion: Annotated[
        bool, Option("each strategy moves as suits it: use the settings that were found with motion")
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
    belief_runs: Annotated[
        int, Option("motions on which beliefs are compared with outcomes; 0: none (default 100)", low=0)
    ] = 100,
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
      vibroswarm league --strategy soft,totals,mine.py:mine --settings frozen.toml --robots 5,10,20
      vibroswarm league --own-motion --runs 300 --out out/own-motion
      vibroswarm league --shares 0.4,0.36,0.24
    """
    from vibroswarm.core.tables import csv_bytes
    from vibroswarm.documents.league import league_document
    from vibroswarm.league.words import belief_runs_of, league_of, played, studies_of_tests

    asked = league_of(
        runs=runs, seed=scenario.seed, **vars(entries), **floors_of(scenario), **words_of(scenario)
    )
    if asked.note:
        say(asked.note)
    warned(asked.league.base)
    belief_runs = belief_runs_of(asked, reference, belief_runs)
    study = (
        asked.league.study
    )  # refuses a floor on which no decision is right, before `--force` removes the folder
    claim_study(output, study)
    tested = studies_of_tests(asked.basic, belief_runs)
    print_plan(study, *tested.values())
    standings, tables = played(
        asked, output.out, reference=reference, belief_runs=belief_runs, stages=STAGES, **execution.where
    )
    if output.out is not None or output.json:
        tables["summary"] = standings.summary
    if output.out is not None:
        write_files(output.out, {f"{name}.csv": csv_bytes(table) for name, table in tables.items()})
    deliver(league_document(standings, tables), output, "league")


def floors_of(players: Players) -> dict[str, Any]:
    """Return the options that say which floors play, by name."""
    return {name: getattr(players, name) for name in ("patterns", "fills", "shares")}


def tune(
    *,
    runs: Annotated[int, Option("runs of each setting, floor and size in the first round")] = 20,
    points: Annotated[int, Option("settings tried for each tuned field of a strategy", low=1)] = 48,
    own_motion: Annotated[
        bool, Option("search the motion too, for 'vibroswarm league --own-motion'")
    ] = False,
    spaces: Annotated[
        Path | None,
        Option(
            'bounds of the fields to search, in TOML: [voter] with "strategy.voter.phase_s" = { from = 5, to = 90 }'
        ),
    ] = None,
    out: Annotated[Path | None, Option("write the settings here, for 'vibroswarm league --settings'")] = None,
    force: Force = False,
    scenario: Tuned,
    execution: Where,
) -> None:
    """Find settings for the strategies of a league: those that decide soonest at each of several forced errors.

    In three rounds, each on fresh motion and floors (--seed and the next two seeds). Play the league with another seed
    than these. Until the file --out is written, finished runs are saved in a folder beside it, and the same command
    resumes.

    example:
      vibroswarm league tune --strategy none,soft --seed 101 --out settings.toml
      vibroswarm league --strategy none,soft --settings settings.toml --seed 2
    """
    from vibroswarm.league.tuning import read_spaces
    from vibroswarm.league.tuning import spaces as shipped_spaces
    from vibroswarm.league.tuning import tune as tuned_by
    from vibroswarm.league.words import players_of

    names, base, floors, robots, note = players_of(**floors_of(scenario), **words_of(scenario))
    if note:
        say(note)
    warned(base)
    tuned_scenarios = [base.with_values({"strategy.name": name}) for name in names]
    # the search spaces of the package, and those of the user's file in their place
    space_of = shipped_spaces(own_motion) | (read_spaces(spaces) if spaces else {})
    with ExitStack() as stack:
        # The file is opened before the work, so that a name that cannot be written is refused at once.
        file = None if out is None else stack.enter_context(whole_file(out, replace=force))
        progress = stack.enter_context(progress_bar("tuning"))
        hashes = [one.hash for one in tuned_scenarios]
        asked = (hashes, floors, robots, space_of, points, runs, scenario.seed)
        saves_in(None, resumes=True)
        runs_folder = None
        if out is not None:
            runs_folder = stack.enter_context(_runs_beside(out, force, *asked))
        tuned = tuned_by(
            base,
            names,
            floors,
            robots,
            space_of=space_of,
            points=points,
            runs=runs,
            seed=scenario.seed,
            progress=progress,
            folder=runs_folder,
            **execution.where,
        )
        if file is not None:
            file.write_text(tuned.to_toml(), encoding="utf-8", newline="\n")
    saves_in(None, resumes=False)  # after Ctrl-C, nothing is left to resume
    # The file is complete, so the saved runs are no longer needed.
    if runs_folder is not None and runs_folder.exists():
        shutil.rmtree(runs_folder)
    print_document(tuned)
    print_saved_file(out)


@contextmanager
def _runs_beside(out: Path, force: bool, *asked: object) -> Iterator[Path]:
    """Yield the folder of a tuning's runs, locked; runs of the same question are used again, with --force too.

    Args:
        asked: all that the runs depend on.
    Raises:
        InputError: the folder holds something else, and would be removed at the end.
    """
    from vibroswarm.documents.saved import begin, hash_of, refuse_other

    work = hash_of(*asked)

    def check(folder: Path) -> None:
        refuse_other(folder, "league tune", work)

    folder = folder_of_runs(out)
    claim(Saved(out=folder, force=force), check)
    begin(folder, "league tune", work)
    try:
        yield folder
    finally:
        _remove_unused(folder)


def _remove_unused(folder: Path) -> None:
    """Remove the folder of a tuning's runs if the tuning ended before any, so that no later one is refused for it."""
    if folder.is_dir() and not any(path.is_dir() for path in folder.iterdir()):
        shutil.rmtree(folder)
