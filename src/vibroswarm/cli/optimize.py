"""``vibroswarm optimize``: search for good parameters, and compare parameters."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.options import (
    add_execution_options,
    add_json,
    add_out,
    add_pictures,
    add_style,
    whole,
)
from vibroswarm.cli.output import add_open, check_open
from vibroswarm.cli.terminal import report
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.optimize.spec import Search
    from vibroswarm.optimize.validation import Front, Truth
    from vibroswarm.show.document import Document

EPILOG = """\
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
  vibroswarm optimize --check out/pso/best.toml --against paper
"""


METHODS = ("pso", "tpe", "gp", "cmaes", "nsga2", "random", "sobol", "grid")
"""Methods of a search, as ``optimize.spec`` has them, and a grid; a test compares them."""


def add_parser(commands: Any) -> None:
    """Add the command ``optimize`` and its options to the program's commands."""
    parser = commands.add_parser(
        "optimize",
        help="search for good parameters; compare parameters",
        description="Search for good parameters and validate them on fresh runs.",
        epilog=EPILOG,
    )
    parser.add_argument("search", metavar="STUDY.toml", type=Path, nargs="?", help="the search file")
    options = parser.add_argument_group("search")
    method = options.add_argument("--method", metavar="NAME", help=f"{', '.join(METHODS)} (default pso)")
    vars(method)["option"] = Option(str(method.help), names=partial(list, METHODS))
    options.add_argument(
        "--noise",
        metavar="NAME",
        help="for pso: rescore (default), ocba, fixed (the paper), or as-ran (its program)",
    )
    options.add_argument("--cost", metavar="NAME", help="cost to minimise (default: that of the file)")
    options.add_argument("--budget", metavar="N", type=whole, help="runs that the search may use")
    options.add_argument(
        "--fresh", metavar="N", type=whole, help="fresh runs to validate the best (default 2000)"
    )
    options.add_argument("--seed", metavar="S", type=whole, help="same search and seed: same optimum")
    check = parser.add_argument_group("comparison")
    check.add_argument(
        "--check",
        metavar="P",
        help="score this scenario (file or preset) on fresh runs, in the search's cases ...",
    )
    check.add_argument(
        "--against", metavar="Q", help="... and this one on the same runs, in pairs (default: preset paper)"
    )
    check.add_argument(
        "--runs",
        metavar="N",
        type=whole,
        help="with --check or --method grid: runs of each (default 2000; 1000)",
    )
    parser.add_argument(
        "--sensitivity",
        action="store_true",
        help="find which fields matter (Sobol indices) instead of the best",
    )
    add_execution_options(parser)
    add_out(parser, "save the search here, or resume it", force=True)
    add_open(parser)
    add_style(parser)
    add_pictures(parser)
    add_json(parser)
    # After Ctrl-C, the work saved in the folder --out can be resumed.
    parser.set_defaults(run=run, resumes="folder")


def run(arguments: argparse.Namespace) -> int:
    """Run a search, a grid, a comparison or a sensitivity analysis, as the options say; return the exit code.

    Only a search and a grid can be resumed. For the other two, ``arguments.resumes`` is set to None, so that the
    message after Ctrl-C does not offer to resume them.
    """
    check_open(arguments)
    if arguments.sensitivity:
        arguments.resumes = None
        return _sensitivity(arguments)
    if arguments.check is not None:
        arguments.resumes = None
        return _check(arguments)
    if arguments.against is not None:
        raise InputError("needs --check", field="--against")
    if arguments.runs is not None and arguments.method != "grid":
        raise InputError("needs --check or --method grid; a search has a --budget", field="--runs")
    if arguments.method == "grid":
        return _grid(arguments)
    return _search(search_from(arguments), arguments)


def search_from(arguments: argparse.Namespace) -> Search:
    """Return the search of the file, or without a file the default search, changed by the options.

    ``--cost`` replaces all objectives by a single one. The new objective keeps two settings of the search's first
    objective: its statistic, and whether the score is that of the worst case or the mean over cases (``over``).
    """
    from vibroswarm.optimize.objective import Objective
    from vibroswarm.optimize.spec import Search

    # `Search.read` gets these options, since it checks how they fit the other entries of the file.
    replaced = {"method": arguments.method, "cost": arguments.cost, "budget": arguments.budget}
    search = Search() if arguments.search is None else Search.read(arguments.search, **replaced)
    # The options change the default search too.
    options = {"budget": arguments.budget, "fresh": arguments.fresh, "method": arguments.method}
    changes = {name: value for name, value in options.items() if value is not None}
    pso = search.pso if arguments.noise is None else replace(search.pso, noise=arguments.noise)
    study = search.study if arguments.seed is None else replace(search.study, seed=arguments.seed)
    objectives = search.objectives
    if arguments.cost is not None:
        objectives = (Objective(arguments.cost, statistic=objectives[0].statistic, over=objectives[0].over),)
    settings = replace(search.settings, **changes)
    return replace(search, study=study, pso=pso, objectives=objectives, settings=settings)


def _refuse(arguments: argparse.Namespace, names: tuple[str, ...], why: str) -> None:
    """Raise ``InputError`` with the message ``why`` if one of the options ``names`` is given."""
    for name in names:
        if getattr(arguments, name) is not None:
            raise InputError(why, field=f"--{name}")


def _start(search: Search) -> None:
    """Print warnings about the scenarios of a search, and a note if kernels must be compiled first."""
    from vibroswarm.cli.progress import say_compiling
    from vibroswarm.cli.scenario_warnings import warn_of

    warn_of(cell.scenario for cell in search.cases)
    say_compiling(search.study.motion)


@contextmanager
def _counting(what: str, runs: int) -> Iterator[Callable[[int], None]]:
    """Show a progress bar; yield a function that updates it with the number of finished runs.

    Args:
        what: description of the work.
        runs: number of all runs.
    """
    from vibroswarm.cli.progress import study_progress
    from vibroswarm.study.runner import StudyProgress

    with study_progress(what) as progress:
        # How many runs failed is not known here; the results report it.
        yield lambda done: progress(StudyProgress(done=done, wanted=runs, failed=0))


def _execution(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the options for workers and executor as keyword arguments of functions that simulate."""
    return {"executor": arguments.executor, "workers": arguments.workers}


def _search(search: Search, arguments: argparse.Namespace) -> int:
    """Run a search, score its winner or its Pareto front on fresh runs, print and save the result.

    Fresh runs are needed because the scores of the search itself are too good: the winner was chosen for its score,
    which is partly luck. With several objectives the result is a Pareto front. It is empty if no candidate has finite
    scores; then nothing is scored on fresh runs.

    Returns the exit code.
    """
    from vibroswarm.cli.out_folder import claim
    from vibroswarm.cli.progress import search_progress
    from vibroswarm.documents.search import search_document
    from vibroswarm.optimize.journal import Journal
    from vibroswarm.optimize.loop import check_libraries, run_search
    from vibroswarm.optimize.search_files import made_by, write_search
    from vibroswarm.optimize.validation import fresh_runs, front_of, truth_of

    execution = _execution(arguments)
    check_libraries(search)  # now, since `--force` removes the folder
    # Making a `Journal` writes nothing, but refuses a folder that holds anything but this search.
    claim(arguments, lambda folder: Journal(folder, search, mixed=arguments.mixed))
    _start(search)
    # the runs of the method, and those of the race between the best candidates
    runs = search.search_runs + search.final_runs
    aims = " and ".join(objective.words for objective in search.objectives)
    summary = f"{search.space.size} fields, {aims}, {runs:,} runs, seed {search.seed}"
    report(f"{search.settings.method}: {summary}")
    with search_progress() as progress:
        result = run_search(search, arguments.out, mixed=arguments.mixed, progress=progress, **execution)
    truth: Truth | None = None
    front: Front | None = None
    if result.front:  # never with one objective
        with _counting("scoring on fresh runs", fresh_runs(result) * len(result.front)) as counted:
            front = front_of(result, progress=counted, **execution)
    if len(search.objectives) == 1:  # the winner, and each start of the search for comparison
        with _counting("scoring on fresh runs", search.settings.fresh * (1 + len(search.starts))) as counted:
            truth = truth_of(result, progress=counted, **execution)
    versions = []
    if arguments.out is not None:
        write_search(result, arguments.out, front)
        versions = made_by(arguments.out)
    document = search_document(result, truth, front, versions)
    _deliver(document, arguments, "optimize", "best.toml, history.csv, candidates.csv, the search itself")
    return 0


def _deliver(document: Document, arguments: argparse.Namespace, command: str, saved: str) -> None:
    """Save and print the document of a search or a grid, with pictures as the options say."""
    from vibroswarm.cli.deliver import REPORT, print_result, save, save_requested_pictures
    from vibroswarm.cli.output import print_saved
    from vibroswarm.show.document import without_pictures

    if arguments.out is not None:
        save(without_pictures(document) if arguments.no_pictures else document, arguments.out, command)
        save_requested_pictures(document, arguments, arguments.out)
    print_result(document, arguments)
    print_saved(arguments, f"{saved}, pictures" if arguments.pictures else saved, REPORT)


def _grid(arguments: argparse.Namespace) -> int:
    """Run a grid, score its cell of lowest cost on fresh runs, print and save the result; return the exit code.

    ``--cost`` replaces the grid's objective by one with default statistic and parameters, even if the file has others.
    """
    from vibroswarm.cli.out_folder import claim
    from vibroswarm.cli.progress import say_compiling, study_progress
    from vibroswarm.documents.grid import grid_document
    from vibroswarm.optimize.grid import FRESH, Grid, scores_of, truth_of_grid
    from vibroswarm.optimize.objective import Objective
    from vibroswarm.optimize.search_files import grid_made_by, write_grid
    from vibroswarm.study.run import run as run_study
    from vibroswarm.study.store import Store

    _refuse(arguments, ("noise", "budget"), "does not apply to a grid")
    execution = _execution(arguments)
    grid = Grid.paper() if arguments.search is None else Grid.read(arguments.search)
    study = grid.study if arguments.runs is None else grid.study.with_runs(arguments.runs)
    if arguments.seed is not None:
        study = replace(study, seed=arguments.seed)
    objective = grid.objective if arguments.cost is None else Objective(arguments.cost)
    fresh = FRESH if arguments.fresh is None else arguments.fresh
    if fresh < 2:  # refused now, since `--force` removes the folder, and the grid takes long
        raise InputError(f"{fresh} is too few; at least 2", field="--fresh")
    # `Store.existing` refuses a folder that holds anything but runs of this study.
    claim(arguments, lambda folder: Store.existing(folder, study))
    say_compiling(study.motion)
    with study_progress("simulating") as progress:
        result = run_study(study, arguments.out, mixed=arguments.mixed, progress=progress, **execution)
    nodes = scores_of(Grid(study, objective), result)
    with study_progress("scoring on fresh runs") as progress:
        truth = truth_of_grid(nodes, fresh, progress=progress, **execution)
    versions = []
    if arguments.out is not None:
        write_grid(nodes, arguments.out)
        versions = grid_made_by(arguments.out)
    document = grid_document(nodes, truth, versions)
    _deliver(
        document, arguments, "optimize --method grid", "best.toml, grid.toml, grid.csv, the runs (shards)"
    )
    return 0


def _sensitivity(arguments: argparse.Namespace) -> int:
    """Compute Sobol indices of the fields of a search, print and save them; return the exit code."""
    from vibroswarm.cli.deliver import deliver
    from vibroswarm.cli.out_folder import claim, hash_of, refuse_other
    from vibroswarm.documents.sensitivity import sensitivity_document
    from vibroswarm.optimize.sensitivity import design_of, sobol_indices, write_sensitivity

    names = ("method", "noise", "fresh", "check", "against", "runs")
    _refuse(arguments, names, "does not apply to --sensitivity")
    if arguments.mixed:
        raise InputError(
            "applies to a search or a grid that is continued, not to --sensitivity", field="--mixed"
        )
    # Here --budget is the number of runs of the analysis. It is removed from the arguments, since `search_from` would
    # check it against the limits of a search's budget.
    budget, arguments.budget = 20_000 if arguments.budget is None else arguments.budget, None
    search = search_from(arguments)
    work = hash_of(search.hash, budget)
    design_of(search, budget)  # refuses a small budget now, since `--force` removes the folder
    claim(arguments, lambda folder: refuse_other(folder, "optimize --sensitivity", work))
    _start(search)
    with _counting("simulating", budget) as counted:
        indices = sobol_indices(search, budget, progress=counted, **_execution(arguments))
    if arguments.out is not None:
        write_sensitivity(indices, arguments.out)
    document = sensitivity_document(indices)
    deliver(document, arguments, "optimize --sensitivity", "sensitivity.csv", work)
    return 0


def _check(arguments: argparse.Namespace) -> int:
    """Compare two scenarios on fresh runs, twice with different seeds, and print the result; return the exit code.

    Of the search, the comparison uses only the cases, the first objective, the source of motion and the seed.
    """
    from vibroswarm.cli.deliver import print_result
    from vibroswarm.cli.scenario_warnings import warn_of
    from vibroswarm.documents.scenario_comparison import checked_document
    from vibroswarm.optimize.scenario_comparison import compare_scenarios, scenario_named

    _refuse(arguments, ("method", "noise", "budget", "fresh", "out"), "applies to a search, not to --check")
    for name in ("force", "mixed"):
        if getattr(arguments, name):
            raise InputError("applies to a search, not to --check", field=f"--{name}")
    search = search_from(arguments)
    runs = 2000 if arguments.runs is None else arguments.runs
    names = (arguments.check, arguments.against or "paper")
    first, second = scenario_named(names[0], "--check"), scenario_named(names[1], "--against")
    warn_of([first, second])
    _start(search)
    # Two scenarios, each with two blocks of seeds. Runs are counted once, however many cases each is simulated in.
    all_runs = 4 * runs
    with _counting("scoring on fresh runs", all_runs) as counted:
        comparison = compare_scenarios(
            first,
            second,
            search.objectives[0],  # the only one, or the first of several
            runs,
            search.seed,
            names=names,
            cases=[cell.point for cell in search.cases],
            motion=search.study.motion,
            progress=counted,
            **_execution(arguments),
        )
    print_result(checked_document(comparison), arguments)
    return 0
