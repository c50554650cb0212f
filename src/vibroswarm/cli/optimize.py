"""``vibroswarm optimize``: search for good parameters, and compare parameters."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import Destination, deliver, print_document
from vibroswarm.cli.options import Drawn, Execution, Json, Where
from vibroswarm.cli.out_folder import claim
from vibroswarm.cli.progress import STAGES, say_compiling, search_progress
from vibroswarm.cli.scenario_options import scenario_named, warn_of
from vibroswarm.cli.studies import claim_study, print_plan
from vibroswarm.cli.terminal import report
from vibroswarm.core.registry import written_names

if TYPE_CHECKING:
    from vibroswarm.optimize.spec import Search


def method_names() -> list[str]:
    """Return the names of the methods of this package, and that of a grid, which is no method of a search."""
    return sorted([*written_names("optimize"), "grid"])


File = Annotated[Path | None, Option("the search file (default: the paper's search)", "SEARCH.toml")]
Cost = Annotated[str | None, Option("cost to minimise (default: that of the file)")]
Seed = Annotated[int | None, Option("same search and seed: same result", "S")]


@dataclass(kw_only=True)
class SearchOptions:
    """What a search file says, and its options in its place."""

    method: Annotated[str | None, Option("{names}, or FILE.py:NAME (default pso)", names=method_names)] = None
    noise: Annotated[
        str | None, Option("for pso: rescore (default), ocba, fixed (the paper), or as-ran (its program)")
    ] = None
    cost: Cost = None
    budget: Annotated[int | None, Option("runs that the search may use")] = None
    fresh: Annotated[int | None, Option("fresh runs to validate the best (default 2000)")] = None
    seed: Seed = None
    runs: Annotated[int | None, Option("for a grid: runs of each cell (default 1000)")] = None


def optimize(
    search: File = None,
    /,
    *,
    settings: SearchOptions,
    execution: Execution,
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
      vibroswarm optimize compare out/pso/best.toml paper
    """
    run = _grid if settings.method == "grid" else _search
    run(search, settings, execution, output)


def _start(search: Search) -> None:
    """Print warnings about the scenarios of a search, and a note if kernels must be compiled first."""

    warn_of(cell.scenario for cell in search.cases)
    say_compiling(search.study.motion)


def _search(file: Path | None, options: SearchOptions, execution: Execution, output: Drawn) -> None:
    """Run a search, score its winner or its Pareto front on fresh runs, print and save the result."""
    from vibroswarm.documents.search import plan_sentences, search_document
    from vibroswarm.optimize.loop import check_ready
    from vibroswarm.optimize.steps import SearchFolder
    from vibroswarm.optimize.words import check_budgeted, search_of, searched

    search = search_of(file, **vars(options))
    check_budgeted(search)
    check_ready(search)  # now, since `--force` removes the folder
    # Making a `SearchFolder` writes nothing, but refuses a folder that holds anything but this search.
    claim(output, lambda folder: SearchFolder(folder, search, mixed=execution.mixed), mixed=execution.mixed)
    _start(search)
    for sentence in plan_sentences(search):
        report(sentence)
    with search_progress() as progress:
        made = searched(search, output.out, progress=progress, stages=STAGES, **execution.how)
    deliver(search_document(*made), output, "optimize")


def _grid(file: Path | None, options: SearchOptions, execution: Execution, output: Drawn) -> None:
    """Run a grid, score its cell of lowest cost on fresh runs, print and save the result."""
    from vibroswarm.documents.grid import grid_document
    from vibroswarm.optimize.words import grid_of, grid_searched

    grid, fresh = grid_of(file, **vars(options))
    claim_study(output, grid.study, mixed=execution.mixed)
    print_plan(grid.study, output.out, None)
    made = grid_searched(grid, fresh, output.out, stages=STAGES, **execution.how)
    deliver(grid_document(*made), output, "optimize --method grid")


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
    from vibroswarm.optimize.sensitivity import design_of, sobol_indices, write_sensitivity
    from vibroswarm.optimize.words import counting, search_of

    made = search_of(search, cost=cost, seed=seed)
    design_of(
        made, budget
    )  # refuses a small budget and code not loaded now, since `--force` removes the folder
    destination = Destination(output, "optimize sensitivity", made.hash, budget)
    _start(made)
    with counting(STAGES)("simulating", budget) as counted:
        indices = sobol_indices(made, budget, progress=counted, **execution.where)
    if output.out is not None:
        write_sensitivity(indices, output.out)
    destination.deliver(indices)


def compare(
    first: Annotated[str, Option("scenario file or preset", "FIRST")],
    second: Annotated[str, Option("another one (default: preset paper)", "SECOND")] = "paper",
    /,
    *,
    search: Annotated[
        Path | None, Option("search file, whose cases and cost are used (default: the paper's search)")
    ] = None,
    cost: Cost = None,
    runs: Annotated[int, Option("runs of each")] = 2000,
    seed: Seed = None,
    json: Json = False,
    execution: Where,
) -> None:
    """Score two scenarios on the same fresh runs, in pairs, twice with different seeds.

    Of a search, the comparison uses only the cases, the first objective, the source of motion and the seed.

    example:
      vibroswarm optimize compare out/pso/best.toml paper
    """
    from vibroswarm.optimize.scenario_comparison import compare_scenarios
    from vibroswarm.optimize.words import counting, search_of

    made = search_of(search, cost=cost, seed=seed)
    one, other = scenario_named(first, field="FIRST"), scenario_named(second, field="SECOND")
    _start(made)
    # Two scenarios, each with two blocks of seeds. Runs are counted once, however many cases each is simulated in.
    with counting(STAGES)("scoring on fresh runs", 4 * runs) as counted:
        comparison = compare_scenarios(
            one,
            other,
            made.objectives[0],  # the only one, or the first of several
            runs,
            made.seed,
            names=(first, second),
            cases=[cell.point for cell in made.cases],
            motion=made.study.motion,
            progress=counted,
            **execution.where,
        )
    print_document(comparison, as_json=json)
