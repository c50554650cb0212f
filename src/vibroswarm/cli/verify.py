"""``vibroswarm verify``: simulate saved runs again, and say whether they are the same."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import print_report
from vibroswarm.cli.options import Json
from vibroswarm.cli.progress import progress_bar


def verify(
    folder: Annotated[Path, Option("folder of a study, league or reproduction", "DIR")],
    /,
    *,
    runs: Annotated[int, Option("runs to simulate again, drawn from all", low=1)] = 20,
    seed: Annotated[int, Option("of the draw", "S", low=0)] = 1,
    json: Json = False,
) -> int:
    """Simulate a sample of saved runs again from their seed, and compare them bit by bit.

    A run that differs was made by other code or other versions of libraries, on another kind of processor, or its files
    were changed. Runs of folders within, such as the tests of a league, are drawn too. The exit code is 1 if a run
    differs, or a file with runs is damaged.

    examples:
      vibroswarm verify out/study
      vibroswarm verify out/league --runs 200
      vibroswarm verify out/paper                a reproduction: runs of its studies
    """
    from vibroswarm.study.store import verify as simulate_again

    with progress_bar("simulating again") as progress:
        verified = simulate_again(folder, runs, seed, progress)
    print_report(verified, as_json=json)
    return 0 if verified.holds else 1
