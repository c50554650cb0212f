"""``vibroswarm optimize``: search for good parameters, and compare parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.options import Drawn, Execution, Json
from vibroswarm.cli.terminal import report
from vibroswarm.core.registry import written_names
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.optimize.spec import Search


def method_names() -> list[str]:
    """Return the names of the methods of this package, and that of a grid, which is no method of a search."""
    return [*written_names("optimize"), "grid"]


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
    if settings.method == "grid":
        _grid(search, settings, execution, output)
        return
    if settings.runs is not None:
        raise InputError("needs --method grid; a search has a --budget", field="--runs")
    _search(search_of(search, settings), execution, output)


def search_of(file: Path | None, options: SearchOptions) -> Search:
    """Return the search of the file, or without a file the default search, changed by the options.

    ``--cost`` replaces all objectives by a single one. The new objective keeps two settings of the search's first
    objective: its statistic, and whether the score is that of the worst case or the mean over cases (``over``).
    """
    from vibroswarm.cli.scenario_options import chosen
    from vibroswarm.optimize.objective import Objective
    from vibroswarm.optimize.spec import Search

    if options.method is not None:
        options = replace(options, method=chosen("method", options.method))
    # `Search.read` gets these options, since it checks how they fit the other entries of the file.
    replaced: dict[str, Any] = {"method": options.method, "cost": options.cost, "budget": options.budget}
    search = Search() if file is None else Search.read(file, **replaced)
    # The options change the default search too.
    given: dict[str, Any] = {"budget": options.budget, "fresh": options.fresh, "method": options.method}
    changes = {name: value for name, value in given.items() if value is not None}
    pso = search.pso if options.noise is None else replace(search.pso, noise=options.noise)
    study = search.study if options.seed is None else replace(search.study, seed=options.seed)
    objectives = search.objectives
    if options.cost is not None:
        objectives = (Objective(options.cost, statistic=objectives[0].statistic, over=objectives[0].over),)
    settings = replace(search.settings, **changes)
    return replace(search, study=study, pso=pso, objectives=objectives, settings=settings)


def _start(search: Search) -> None:
    """Print warnings about the scenarios of a search, and a note if kernels must be compiled first."""
    from vibroswarm.cli.progress import say_compiling
    from vibroswarm.cli.scenario_warnings import warn_of

    warn_of(cell.scenario for cell in search.cases)
    say_compiling(search.study.motion)


@contextmanager
def _counting(what: str, runs: int) -> Iterator[Callable[[int], None]]:
    """Show a progress bar; yield a function that updates it with the number of finished runs."""
    from vibroswarm.cli.progress import study_progress
    from vibroswarm.study.runner import StudyProgress

    with study_progress(what) as progress:
        # How many runs failed is not known here; the results report it.
        yield lambda done: progress(StudyProgress(done=done, wanted=runs, failed=0))


def _search(search: Search, execution: Execution, output: Drawn) -> None:
    """Run a search, score its winner or its Pareto front on fresh runs, print and save the result."""
    from vibroswarm.cli.deliver import deliver
    from vibroswarm.cli.out_folder import claim
    from vibroswarm.cli.progress import search_progress
    from vibroswarm.documents.search import plan_sentences, search_document
    from vibroswarm.optimize.loop import check_libraries, run_search
    from vibroswarm.optimize.search_files import made_by, write_search
    from vibroswarm.optimize.steps import SearchFolder
    from vibroswarm.optimize.validation import validated
    from vibroswarm.study.spec import Study

    if search.study.runs != Study().runs:
        raise InputError(
            "is for grids (--method grid); a search has a budget of runs, search.budget", field="runs"
        )
    check_libraries(search)  # now, since `--force` removes the folder
    # Making a `SearchFolder` writes nothing, but refuses a folder that holds anything but this search.
    claim(output, lambda folder: SearchFolder(folder, search, mixed=execution.mixed))
    _start(search)
    for sentence in plan_sentences(search):
        report(sentence)
    with search_progress() as progress:
        found = run_search(search, output.out, progress=progress, **execution.how)
    truth, front = validated(found, output.out, _counting, **execution.where)
    versions = []
    if output.out is not None:
        write_search(found, output.out, front)
        versions = made_by(output.out)
    deliver(search_document(found, truth, front, versions), output, "optimize")


def _grid(file: Path | None, options: SearchOptions, execution: Execution, output: Drawn) -> None:
    """Run a grid, score its cell of lowest cost on fresh runs, print and save the result.

    ``--cost`` replaces the grid's objective by one with default statistic and parameters, even if the file has others.
    """
    from vibroswarm.cli.deliver import deliver
    from vibroswarm.cli.out_folder import claim
    from vibroswarm.cli.progress import study_progress
    from vibroswarm.cli.studies import print_plan
    from vibroswarm.documents.grid import grid_document
    from vibroswarm.optimize.grid import FRESH, Grid, scores_of, truth_of_grid
    from vibroswarm.optimize.objective import Objective
    from vibroswarm.optimize.search_files import made_by, write_grid
    from vibroswarm.study.run import run as run_study
    from vibroswarm.study.store import Store

    for name in ("noise", "budget"):
        if getattr(options, name) is not None:
            raise InputError("does not apply to a grid", field=f"--{name}")
    grid = Grid.paper() if file is None else Grid.read(file)
    study = grid.study if options.runs is None else grid.study.with_runs(options.runs)
    if options.seed is not None:
        study = replace(study, seed=options.seed)
    objective = grid.objective if options.cost is None else Objective(options.cost)
    fresh = FRESH if options.fresh is None else options.fresh
    if fresh < 2:  # refused now, since `--force` removes the folder, and the grid takes long
        raise InputError(f"{fresh} is too few; at least 2", field="--fresh")
    # `Store.existing` refuses a folder that holds anything but runs of this study.
    claim(output, lambda folder: Store.existing(folder, study, shards=False))
    print_plan(study, output.out, None)
    with study_progress("simulating") as progress:
        result = run_study(study, output.out, progress=progress, **execution.how)
    nodes = scores_of(Grid(study, objective), result)
    with study_progress("scoring on fresh runs") as progress:
        truth = truth_of_grid(nodes, fresh, progress=progress, **execution.where)
    versions = []
    if output.out is not None:
        write_grid(nodes, output.out)
        versions = made_by(output.out)
    deliver(grid_document(nodes, truth, versions), output, "optimize --method grid")


def sensitivity(
    search: File = None,
    /,
    *,
    budget: Annotated[int, Option("runs of the analysis")] = 20_000,
    cost: Cost = None,
    seed: Seed = None,
    execution: Execution,
    output: Drawn,
) -> None:
    """Find which fields of a search matter, by Sobol indices.

    example:
      vibroswarm optimize sensitivity search.toml --budget 20000 --out out/which
    """
    from vibroswarm.cli.deliver import Destination
    from vibroswarm.documents.sensitivity import sensitivity_document
    from vibroswarm.optimize.sensitivity import design_of, sobol_indices, write_sensitivity

    if execution.mixed:
        raise InputError("applies to a search or a grid that is continued", field="--mixed")
    made = search_of(search, SearchOptions(cost=cost, seed=seed))
    design_of(made, budget)  # refuses a small budget now, since `--force` removes the folder
    destination = Destination(output, "optimize sensitivity", made.hash, budget)
    _start(made)
    with _counting("simulating", budget) as counted:
        indices = sobol_indices(made, budget, progress=counted, **execution.where)
    if output.out is not None:
        write_sensitivity(indices, output.out)
    destination.deliver(sensitivity_document(indices))


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
    execution: Execution,
) -> None:
    """Score two scenarios on the same fresh runs, in pairs, twice with different seeds.

    Of a search, the comparison uses only the cases, the first objective, the source of motion and the seed.

    example:
      vibroswarm optimize compare out/pso/best.toml paper
    """
    from vibroswarm.cli.deliver import print_document
    from vibroswarm.cli.scenario_warnings import warn_of
    from vibroswarm.documents.scenario_comparison import checked_document
    from vibroswarm.optimize.scenario_comparison import compare_scenarios, scenario_named

    made = search_of(search, SearchOptions(cost=cost, seed=seed))
    one, other = scenario_named(first, "FIRST"), scenario_named(second, "SECOND")
    warn_of([one, other])
    _start(made)
    # Two scenarios, each with two blocks of seeds. Runs are counted once, however many cases each is simulated in.
    with _counting("scoring on fresh runs", 4 * runs) as counted:
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
    print_document(checked_document(comparison), as_json=json)
