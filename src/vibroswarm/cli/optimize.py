"""``vibroswarm optimize``: search for good parameters."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import claim, deliver
from vibroswarm.cli.options import Drawn, Where
from vibroswarm.cli.scenario_options import warn_of
from vibroswarm.cli.terminal import progress_bar, report, say_compiling
from vibroswarm.core.registry import written_names

if TYPE_CHECKING:
    from vibroswarm.search.spec import Search


def method_names() -> list[str]:
    """Return the names of the methods of this package."""
    return sorted(written_names("search"))


File = Annotated[Path | None, Option("the search file (default: the paper's search)", "SEARCH.toml")]
Cost = Annotated[str | None, Option("cost to minimise (default: that of the file)")]
Seed = Annotated[int | None, Option("same search and seed: same result", "S")]


@dataclass(kw_only=True)
class SearchOptions:
    """What a search file says, and its options in its place."""

    method: Annotated[str | None, Option("{names}, or FILE.py:NAME (default pso)", names=method_names)] = None
    noise: Annotated[
        str | None, Option("for pso: rescore (default), fixed (the paper), or as-ran (its program)")
    ] = None
    cost: Cost = None
    budget: Annotated[int | None, Option("runs that the search may use")] = None
    fresh: Annotated[int | None, Option("fresh runs to validate the best (default 2000)")] = None
    seed: Seed = None
    strategy: Annotated[str | None, Option("what robots send each other")] = None
    robots: Annotated[int | None, Option("number of robots")] = None
    floor: Annotated[str | None, Option("pattern (diagonal:0.46), random:0.48, or file", "FLOOR")] = None


def optimize(
    search: File = None,
    /,
    *,
    settings: SearchOptions,
    execution: Where,
    output: Drawn,
) -> None:
    """Search for good parameters and validate them on fresh runs.

    a search file (default: the paper's five parameters, starting from its P0):
      start = ["paper-empirical"]
      [scenario]
      preset = "paper"
      [space]
      "walk.walk_duration_scale_ms" = { from = 0, to = 20000 }
      "decision.min_observations" = { from = 1, to = 500, scale = "log" }
      [objective]
      cost = "time_at_error"        # or authors_code (default), intended, printed, errors, expected_time_to_right, ...
      [grid]                        # cases for each candidate; the worst one counts
      "floor.source" = ["stripe:0.48", "diagonal:0.48"]

    examples:
      vibroswarm optimize --method pso --out out/pso           run again to resume
      vibroswarm optimize search.toml --method tpe --budget 5000
      vibroswarm evaluate out/pso/best.toml paper --cost authors_code    compare what was found with a preset
    """
    from vibroswarm.search.searched import search_of, searched

    made = search_of(search, **vars(settings))
    claim(output, "optimize", made.hash)
    _start(made)
    settled = made.settings
    report(
        f"{settled.method}: {made.budget:,} runs, and {settled.fresh:,} fresh runs to validate; seed {made.study.seed}"
    )
    with progress_bar("searching") as update, progress_bar("fresh runs") as validating:
        found = searched(
            made,
            output.out,
            progress=lambda runs, best: update(runs, made.budget, f"best so far {best:.4g}"),
            validating=lambda done: validating(done, settled.fresh * (1 + len(made.starts))),
            **execution.where,
        )
    deliver(found, output)


def _start(search: Search) -> None:

    warn_of(cell.scenario for cell in search.study.cells)
    say_compiling(search.study.motion)


def sensitivity(
    search: File = None,
    /,
    *,
    budget: Annotated[int, Option("runs of the analysis")] = 20_000,
    cost: Cost = None,
    seed: Seed = None,
    execution: Where,
    output: Drawn,
) -> None:
    """Find which fields of a search matter, by Sobol indices.

    example:
      vibroswarm optimize sensitivity search.toml --budget 20000 --out out/which
    """
    from vibroswarm.search.searched import search_of
    from vibroswarm.search.sensitivity import PIECE, saltelli, sobol_indices

    made = search_of(search, cost=cost, seed=seed)
    runs = len(saltelli(len(made.space.names), budget // PIECE, made.study.seed)) * PIECE
    claim(output, "optimize sensitivity", made.hash, budget)
    _start(made)
    report(f"{runs:,} runs of {len(made.space.names)} fields; seed {made.study.seed}")
    with progress_bar("simulating") as update:
        indices = sobol_indices(made, budget, progress=lambda done: update(done, runs), **execution.where)
    deliver(indices, output)
