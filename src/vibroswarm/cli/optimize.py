"""``vibroswarm optimize``: search for good parameters, and score any parameters against any others."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.warned import warn_of
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.optimize.check import Checked
    from vibroswarm.optimize.fronts import Front
    from vibroswarm.optimize.grid import Nodes
    from vibroswarm.optimize.loop import Found, Tell
    from vibroswarm.optimize.objective import Objective
    from vibroswarm.optimize.spec import Search
    from vibroswarm.optimize.truth import Scored, Truth

EPILOG = """\
a search's file (all of it may be left out: then it is the paper's five parameters, begun from its P0):
  start = ["paper-empirical"]
  [scenario]
  preset = "paper"
  [space]
  "walk.walk_duration_scale_ms" = { from = 0, to = 20000 }
  "decision.min_observations" = { from = 1, to = 500, scale = "log" }
  [objective]
  cost = "time_at_error"        # or authors_code (default), intended, printed, errors, expected_time_to_right, ...
  [grid]                        # the cases in which each candidate is tried; the worst counts
  "floor.source" = ["stripe:0.48", "diagonal:0.48"]

examples:
  vibroswarm optimize --method pso --out out/pso           again: goes on where it was
  vibroswarm optimize search.toml --method tpe --budget 5000
  vibroswarm optimize --check out/pso/best.toml --against paper
"""


def add_parser(commands: Any) -> None:
    """Make the command known."""
    parser = commands.add_parser(
        "optimize",
        help="search for good parameters; score parameters against others",
        description="Search for good parameters, and say what is true of them.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("search", metavar="STUDY.toml", type=Path, nargs="?", help="the search")
    how = parser.add_argument_group("how")
    how.add_argument(
        "--method", metavar="NAME", help="pso (default), tpe, gp, cmaes, nsga2, random, sobol, grid"
    )
    how.add_argument("--noise", metavar="NAME", help="of pso: rescore (default), ocba, or fixed (the paper)")
    how.add_argument("--cost", metavar="NAME", help="what is minimised, in place of the file's")
    how.add_argument("--budget", metavar="N", help="runs that the search may take")
    how.add_argument("--fresh", metavar="N", help="fresh runs on which what is best is scored (default 2000)")
    how.add_argument("--seed", metavar="S", help="same search and seed: same optimum")
    check = parser.add_argument_group("score parameters")
    check.add_argument(
        "--check",
        metavar="P",
        help="score this scenario (a file or a preset) on fresh runs, in the search's cases ...",
    )
    check.add_argument(
        "--against", metavar="Q", help="... against this one, in pairs (default: preset paper)"
    )
    check.add_argument(
        "--runs", metavar="N", help="with --check or --method grid: runs of each (default 2000; 1000)"
    )
    parser.add_argument(
        "--sensitivity", action="store_true", help="which fields matter, in place of the best (Sobol indices)"
    )
    who = parser.add_argument_group("who does the work")
    who.add_argument("--workers", metavar="N", help="threads or processes (default: all processors)")
    who.add_argument("--executor", metavar="WHERE", default="threads",
                     help="threads (default), processes, dask://HOST:PORT, or a Dask scheduler file")  # fmt: skip
    who.add_argument("--mixed", action="store_true", help="go on where other versions began")
    parser.add_argument("--out", metavar="DIR", type=Path, help="keep the search here, and go on with it")
    parser.add_argument(
        "--style", metavar="NAME", default="column", help="of pictures: column, page or slide"
    )
    parser.add_argument("--no-pictures", action="store_true", help="numbers only; the report without them")
    parser.add_argument(
        "--json", action="store_true", help="give the outcome as JSON, and nothing else, on stdout"
    )
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Check, search, or what else is asked for."""
    from vibroswarm.cli.studies import check_style

    check_style(arguments.style)
    if arguments.sensitivity:
        return _sensitivity(arguments)
    if arguments.check is not None:
        return _check(arguments)
    if arguments.against is not None:
        raise InputError("goes with --check", field="--against")
    if arguments.runs is not None and arguments.method != "grid":
        raise InputError("goes with --check and --method grid; a search has a --budget", field="--runs")
    if arguments.method == "grid":
        return _grid(arguments)
    return _search(search_from(arguments), arguments)


def search_from(arguments: argparse.Namespace) -> Search:
    """The search of the file, with what the options change."""
    from vibroswarm.cli.scenarios import whole_number
    from vibroswarm.optimize.objective import Objective
    from vibroswarm.optimize.spec import Search

    method = arguments.method
    search = Search() if arguments.search is None else Search.read(arguments.search, method=method)
    changed: dict[str, Any] = {}
    for name in ("budget", "fresh"):
        if getattr(arguments, name) is not None:
            changed[name] = whole_number(getattr(arguments, name), f"--{name}")
    if method is not None:
        changed["method"] = method
    pso = search.pso if arguments.noise is None else replace(search.pso, noise=arguments.noise)
    study = search.study
    if arguments.seed is not None:
        study = replace(study, seed=whole_number(arguments.seed, "--seed"))
    objectives = search.objectives
    if arguments.cost is not None:
        objectives = (Objective(arguments.cost, statistic=objectives[0].statistic, over=objectives[0].over),)
    settings = replace(search.settings, **changed)
    return replace(search, study=study, pso=pso, objectives=objectives, settings=settings)


def _search(search: Search, arguments: argparse.Namespace) -> int:
    from vibroswarm.cli.progress import say_compiling, study_progress
    from vibroswarm.optimize.fronts import fresh_runs, front_of
    from vibroswarm.optimize.loop import run_search
    from vibroswarm.optimize.report import as_dict, write_report
    from vibroswarm.optimize.truth import truth_of
    from vibroswarm.study.runner import Told

    workers = _workers(arguments)
    warn_of(cell.scenario for cell in search.cases)
    say_compiling(search.study.motion.replace("-", "_"))
    runs = search.search_runs + search.final_runs
    aims = " and ".join(objective.words for objective in search.objectives)
    about = f"{search.space.size} fields, {aims}, {runs:,} runs, seed {search.seed}"
    print(f"{search.settings.method}: {about}", file=sys.stderr, flush=True)
    with search_progress() as tell:
        found = run_search(
            search,
            arguments.out,
            executor=arguments.executor,
            workers=workers,
            mixed=arguments.mixed,
            tell=tell,
        )
    truth: Truth | None = None
    front: Front | None = None
    if found.front:
        wanted = fresh_runs(found) * len(found.front)
        with study_progress("scoring on fresh runs", workers) as told:
            front = front_of(
                found, executor=arguments.executor, workers=workers,
                tell=lambda done: told(Told(done, wanted, 0)),
            )  # fmt: skip
    if len(search.objectives) == 1:
        wanted = search.settings.fresh * (1 + len(search.starts))
        with study_progress("scoring on fresh runs", workers) as told:
            truth = truth_of(
                found, executor=arguments.executor, workers=workers,
                tell=lambda done: told(Told(done, wanted, 0)),
            )  # fmt: skip
    if arguments.out is not None:
        write_report(found, truth, arguments.out, None if arguments.no_pictures else arguments.style, front)
    if arguments.json:
        print(json.dumps(as_dict(found, truth, front), indent=2, allow_nan=False))
        return 0
    _say(found, truth, front)
    if arguments.out is None:
        print("Nothing was kept; --out DIR keeps the search, and goes on with it.")
    else:
        print(
            f"Kept in {arguments.out}: best.toml, result.json, history.csv, candidates.csv, the search itself."
        )
        _say_page(arguments.out)
    return 0


def _say_page(folder: Path) -> None:
    from vibroswarm.optimize.report import REPORT

    print(f"See it: open {(folder / REPORT).resolve()} in a browser.")


def _grid(arguments: argparse.Namespace) -> int:
    from vibroswarm.cli.progress import say_compiling, study_progress
    from vibroswarm.cli.scenarios import whole_number
    from vibroswarm.optimize.grid import FRESH, Grid, scores_of, truth_of_grid
    from vibroswarm.optimize.objective import Objective
    from vibroswarm.study.result import run as run_study

    for name in ("noise", "budget"):
        if getattr(arguments, name) is not None:
            raise InputError("is not for a grid", field=f"--{name}")
    fresh = FRESH if arguments.fresh is None else whole_number(arguments.fresh, "--fresh")
    grid = Grid.paper() if arguments.search is None else Grid.read(arguments.search)
    study = grid.study
    if arguments.runs is not None:
        study = study.with_runs(whole_number(arguments.runs, "--runs"))
    if arguments.seed is not None:
        study = replace(study, seed=whole_number(arguments.seed, "--seed"))
    objective = grid.objective if arguments.cost is None else Objective(arguments.cost)
    workers = _workers(arguments)
    say_compiling()
    with study_progress("simulating", workers) as tell:
        result = run_study(
            study,
            arguments.out,
            executor=arguments.executor,
            workers=workers,
            mixed=arguments.mixed,
            tell=tell,
        )
    nodes = scores_of(Grid(study, objective), result)
    with study_progress("scoring on fresh runs", workers) as tell:
        truth = truth_of_grid(nodes, fresh, executor=arguments.executor, workers=workers, tell=tell)
    if arguments.out is not None:
        from vibroswarm.optimize.report import write_grid

        write_grid(nodes, arguments.out, None if arguments.no_pictures else arguments.style, truth)
    if arguments.json:
        print(json.dumps(nodes.as_dict(truth), indent=2, allow_nan=False))
        return 0
    _say_grid(nodes)
    _say_truth(truth, nodes.best.cell.point, objective)
    if arguments.out is None:
        print("Nothing was kept.")
        return 0
    print(f"Kept in {arguments.out}: best.toml, grid.toml, grid.csv, result.json, the runs (shards).")
    _say_page(arguments.out)
    return 0


def _say_grid(nodes: Nodes) -> None:
    from vibroswarm.cli.tables import number
    from vibroswarm.optimize.words import GRID_LUCK

    print(f"{nodes.grid.objective.words}, {nodes.best.scored.score.n:,} runs a cell on shared motion:")
    for node in nodes.nodes:
        mark = "  *" if node is nodes.best else "  =" if node.as_good else ""
        print(
            f"  {node.cell.name:<28} {number(node.scored.score, 2):>24}   time {node.time_s:6.0f} s, wrong "
            f"{100 * node.wrong:4.1f} %, undecided {100 * node.undecided:4.1f} %{mark}"
        )
    print(f"  * the lowest score; = {GRID_LUCK}")


def _sensitivity(arguments: argparse.Namespace) -> int:
    from vibroswarm.cli.progress import say_compiling, study_progress
    from vibroswarm.cli.scenarios import whole_number
    from vibroswarm.optimize.sensitivity import sobol_indices, write_sensitivity
    from vibroswarm.optimize.words import failures_said
    from vibroswarm.study.runner import Told

    for name in ("method", "noise", "fresh", "check"):
        if getattr(arguments, name) is not None:
            raise InputError("is not for --sensitivity", field=f"--{name}")
    budget = 20_000 if arguments.budget is None else whole_number(arguments.budget, "--budget")
    arguments.budget = None
    search = search_from(arguments)
    workers = _workers(arguments)
    warn_of(cell.scenario for cell in search.cases)
    say_compiling(search.study.motion.replace("-", "_"))
    with study_progress("simulating", workers) as told:
        found = sobol_indices(
            search, budget, executor=arguments.executor, workers=workers,
            tell=lambda done: told(Told(done, budget, 0)),
        )  # fmt: skip
    if arguments.out is not None:
        write_sensitivity(found, arguments.out)
    if arguments.json:
        print(json.dumps(found.as_dict(), indent=2, allow_nan=False))
        return 0
    print(
        f"{found.runs:,} runs at {found.points:,} points, {found.replicates} each; {failures_said(found.failed)}"
    )
    noise = f"{100 * found.noise_share:.0f} %"
    print(f"Noise of the runs is {noise} of the variance of the points' mean costs; it is taken out.")
    for one in found.fields:
        print(
            f"  {one.name:<34} total {one.total:5.2f} [{one.total_low:5.2f}, {one.total_high:5.2f}]   "
            f"alone {one.first:5.2f} [{one.first_low:5.2f}, {one.first_high:5.2f}]"
        )
    print(
        "Shares of the variance over the space: by the field alone, and with its interactions; 95 % bootstrap."
    )
    if vague := [one.name for one in found.fields if not one.total_low > 0]:
        print(
            f"Not told from no effect by these runs: {', '.join(vague)}. Four times the --budget makes the intervals "
            "half as wide."
        )
    return 0


def _workers(arguments: argparse.Namespace) -> int | None:
    from vibroswarm.cli.scenarios import whole_number

    return None if arguments.workers is None else whole_number(arguments.workers, "--workers")


def _say(found: Found, truth: Truth | None, front: Front | None) -> None:
    """What was found, in words."""
    from vibroswarm.cli.tables import number
    from vibroswarm.optimize.words import failures_said, fresh_failures_said, reasons

    archive = found.archive
    print(f"{len(archive):,} candidates in {found.runs:,} runs; {failures_said(archive.failed)}")
    for why in reasons(archive):
        print(f"  failed: {why}")
    if front is not None:
        _say_front(front)
    if truth is None:
        return
    objective = found.search.objectives[0]
    unit = f" {objective.unit}".rstrip()
    _say_truth(truth, found.values, objective)
    for scored in (truth.winner, *truth.others):
        if said := fresh_failures_said(scored):
            print(f"  {said}")
    _say_parts(truth.winner)
    for other, paired in zip(truth.others, truth.against, strict=True):
        print(
            f"{other.name}: {number(other.score, 2)}{unit}; the winner less this {number(paired, 2, sign=True)}"
        )


def _say_truth(truth: Truth, values: dict[str, Any], objective: Objective) -> None:
    """What was believed of the best, and what is true."""
    from vibroswarm.cli.tables import number
    from vibroswarm.optimize.words import values_said

    unit = f" {objective.unit}".rstrip()
    print(f"Best: {values_said(values)}")
    print(f"  the search believed  {truth.believed:.4g}{unit}")
    print(f"  true, on fresh runs  {number(truth.winner.score, 2)}{unit} ({truth.winner.score.n:,} runs)")
    print(f"  {truth.words}")


def _say_front(front: Front) -> None:
    from vibroswarm.cli.tables import number
    from vibroswarm.optimize.words import values_said

    print(f"{len(front.members)} candidates are beaten by none in all of {' and '.join(front.names)}:")
    for member in front.members:
        scores = "; ".join(
            f"believed {believed:.4g}, true {number(true, 2)}{f' {unit}'.rstrip()}"
            for believed, true, unit in zip(member.believed, member.true, front.units, strict=True)
        )
        print(f"  {'  ' if member.stays else '- '}{scores}: {values_said(member.values)}")
        if member.failed:
            print(f"    {member.failed:,} of its fresh runs FAILED and are in no figure")
    print(f"  {front.words}" + (" -: beaten there." if not all(m.stays for m in front.members) else ""))


def _say_parts(scored: Scored) -> None:
    from vibroswarm.cli.tables import number, percent

    if scored.parts is None:
        return
    time_s, wrong, undecided = (
        scored.parts[k] for k in ("decision_time_s", "robot_error", "robots_undecided")
    )
    print(f"  decision time {number(time_s, 0)} s")
    print(f"  wrong of those who decide {percent(wrong)}: {scored.near['robot_error']}")
    print(f"  undecided {percent(undecided)}: {scored.near['robots_undecided']}")
    if scored.cases:
        print("  (each in the case where it is worst)")


def _check(arguments: argparse.Namespace) -> int:
    from vibroswarm.cli.progress import say_compiling, study_progress
    from vibroswarm.cli.scenarios import whole_number
    from vibroswarm.optimize.check import compare_scenarios, scenario_named
    from vibroswarm.study.runner import Told

    for name in ("method", "noise", "budget", "fresh"):
        if getattr(arguments, name) is not None:
            raise InputError("is for a search, not for --check", field=f"--{name}")
    search = search_from(arguments)
    runs = 2000 if arguments.runs is None else whole_number(arguments.runs, "--runs")
    second_name = arguments.against or "paper"
    first, second = scenario_named(arguments.check, "--check"), scenario_named(second_name, "--against")
    warn_of([first, second])
    workers = _workers(arguments)
    warn_of(cell.scenario for cell in search.cases)
    say_compiling(search.study.motion.replace("-", "_"))
    with study_progress("scoring on fresh runs", workers) as told:
        found = compare_scenarios(
            first, second, search.objectives[0], runs, search.seed,
            names=(arguments.check, second_name), cases=[cell.point for cell in search.cases],
            executor=arguments.executor, workers=workers,
            tell=lambda done: told(Told(done, 4 * runs, 0)),
        )  # fmt: skip
    if arguments.json:
        print(json.dumps(found.as_dict(), indent=2, allow_nan=False))
    else:
        _say_check(found)
    return 0


def _say_check(found: Checked) -> None:
    from vibroswarm.cli.tables import number

    print(f"{found.objective.words}, {found.first.score.n:,} fresh runs of each, in pairs:")
    unit = f" {found.objective.unit}".rstrip()
    for scored in (found.first, found.second):
        failed = f" ({scored.failed:,} runs FAILED)" if scored.failed else ""
        print(f"  {scored.name}: {number(scored.score, 2)}{unit}{failed}")
        _say_parts(scored)
    print(f"  difference: {number(found.difference, 2, sign=True)}; again on other seeds "
          f"{number(found.again, 2, sign=True)}")  # fmt: skip
    print(f"  {found.says}")
    for paired in found.figures:
        print(f"  {paired.figure}: {number(paired.difference, 3, sign=True)} "
              f"({paired.first:.4g} against {paired.second:.4g})")  # fmt: skip


@contextmanager
def search_progress() -> Iterator[Tell]:
    """Give a function to be told how far a search is: a bar with the best so far, or lines now and then."""
    from vibroswarm.cli.progress import SearchLines

    if not sys.stderr.isatty():
        yield SearchLines()
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from vibroswarm.optimize.method import Told

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("runs"),
               TimeRemainingColumn(), TextColumn("{task.fields[best]}"))  # fmt: skip
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task("searching", total=None, best="")

        def tell(told: Told) -> None:
            failed = f", {told.failed} failed" if told.failed else ""
            bars.update(
                task, total=told.wanted, completed=told.runs, best=f"best so far {told.best:.4g}{failed}",
                description=f"{told.method} {told.iteration}/{told.iterations}",
            )  # fmt: skip

        yield tell
