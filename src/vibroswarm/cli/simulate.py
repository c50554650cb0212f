"""Commands that simulate: ``vibroswarm run``, ``evaluate`` and ``detect``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from vibroswarm.cli.command_line import Option, refuse, share
from vibroswarm.cli.deliver import claim, deliver
from vibroswarm.cli.options import Drawn, Paged, Parts, Seed, Simulated, SwarmOptions, Tiles
from vibroswarm.cli.scenario_options import keywords_of, scenario_from, warn_of
from vibroswarm.cli.terminal import counting_runs, progress_bar, report, say_compiling
from vibroswarm.errors import named

if TYPE_CHECKING:
    from vibroswarm.study.runs import Runs
    from vibroswarm.study.spec import Study


def run(*, scenario: Simulated, output: Drawn) -> None:
    """Run one inspection: a swarm on a floor, from start to verdict.

    examples:
      vibroswarm run                                        the paper's setting, no feedback
      vibroswarm run --strategy soft --seed 2 --out first   save tables and page in 'first'
      vibroswarm run --floor diagonal:0.46 --robots 8
      vibroswarm run --floor random:0.08 --set decision.decision_boundary=0.03 --set decision.boundary_of=tiles
    """
    from vibroswarm.run_page.write import why_no_page, write_run_page
    from vibroswarm.simulation import simulate
    from vibroswarm.study.options import chosen

    wanted, out = scenario_from(scenario), output.out
    motion = chosen("motion", scenario.motion or "event")
    seed = 1 if scenario.seed is None else scenario.seed
    claim(output, "run", wanted.hash, seed, motion)
    say_compiling()
    with progress_bar("simulating") as progress:
        # Only the page needs the poses between samples.
        result = simulate(wanted, seed, runs=1, motion=motion, poses=out is not None, progress=progress)
    has_page = why_no_page(result) is None
    if out is not None:
        result.write_into(out)
        if has_page:
            write_run_page(result, out / "run.html")
    deliver(result, output, page="run.html" if has_page else "report.html", is_result=True)


def evaluate(
    study: Annotated[Path | None, Option("study or scenario, in place of options", "FILE.toml")] = None,
    other: Annotated[Path | None, Option("scenario or preset to compare with", "OTHER.toml")] = None,
    /,
    *,
    runs: Annotated[int | None, Option("runs per cell (default 100, or those of the file)")] = None,
    until: Annotated[
        str | None, Option("run until a figure is known to +-P %, in place of --runs", "P%")
    ] = None,
    figure: Annotated[str | None, Option("figure for --until (default decision_time_s)")] = None,
    max_runs: Annotated[int | None, Option("upper limit for --until (default 100000)")] = None,
    vary: Annotated[
        Sequence[str],
        Option(
            "one cell per value; repeat for all combinations",
            "FIELD=A,B,...",
        ),
    ] = (),
    reference: Annotated[
        str | None,
        Option("compare with this strategy, or other varied value, only"),
    ] = None,
    cost: Annotated[str | None, Option("score each cell under this cost")] = None,
    scenario: Simulated,
    execution: Parts,
    output: Drawn,
) -> None:
    """Run a scenario many times, or several side by side: figures with intervals, comparisons, pictures.

    examples:
      vibroswarm evaluate --runs 1000 --strategy none,positive,soft --out out/strategies
      vibroswarm evaluate --until 2% --robots 5,6,7,8,9,10 --strategy soft
      vibroswarm evaluate study.toml --out out/study                      run again to continue
      vibroswarm evaluate study.toml --out out/study --executor dask://head:8786
      vibroswarm evaluate out/pso/best.toml paper --cost authors_code

    a study file:
      runs = 1000                       # or: until = "2%"
      [scenario]
      preset = "paper"                  # or: scenario = "file.toml"
      [grid]                            # all combinations; also list
      "floor.source" = ["random:0.44", "random:0.48"]
      "strategy.name" = ["none", "positive", "soft"]
    """
    from vibroswarm.study.comparison import pairs_of
    from vibroswarm.study.options import study_of
    from vibroswarm.study.summary import outcome_of

    wanted = study_of(
        *filter(None, (study, other)),
        vary=vary,
        runs=runs,
        until=until,
        figure=figure,
        max_runs=max_runs,
        seed=scenario.seed,
        motion=scenario.motion,
        **keywords_of(scenario),
    )
    pairs_of(wanted.cells, reference)  # refuses an unknown reference
    objective = None if cost is None else _objective_of(cost)
    done = run_parts(wanted, execution, output, "evaluate")
    if done is None:
        return
    outcome = outcome_of(done, reference)
    scores = None if objective is None else _scored(done, objective, execution)
    deliver(outcome, output, scores=scores)


def _objective_of(cost: str) -> Any:
    from vibroswarm.search.objective import Objective

    return Objective(cost)


def _scored(runs: Runs, objective: Any, execution: Parts) -> Any:
    from vibroswarm.search.validation import scores_of

    with counting_runs("scoring on fresh runs") as progress:
        return scores_of(runs, objective, progress=progress, **execution.where)


@dataclass(kw_only=True)
class Inspected(SwarmOptions):
    """A scenario of random floors, and its seed."""

    tiles: Tiles = None
    seed: Seed = 1


def detect(
    *,
    more_than: Annotated[
        float | None,
        Option(
            "the question: does more than this share of the tiles vibrate? (default: the scenario's)",
            "P%",
            read=share,
        ),
    ] = None,
    fills: Annotated[
        tuple[float, ...] | None,
        Option(
            "fill ratios of random floors (default: around the boundary)",
            "F,...",
            low=0,
            high=1,
        ),
    ] = None,
    error: Annotated[float, Option("tolerated probability of a miss (default 5%)", "P%", read=share)] = 0.05,
    false_alarms: Annotated[
        float | None,
        Option("tolerated probability of a false alarm (default: as --error)", "P%", read=share),
    ] = None,
    boundary_of: Annotated[
        Literal["tiles", "readings"] | None,
        Option(
            "tiles (default): robots allow for their sensor's errors; readings: they ignore them, as in the paper",
            "WHAT",
        ),
    ] = None,
    runs: Annotated[int, Option("runs per cell")] = 300,
    scenario: Inspected,
    execution: Parts,
    output: Drawn,
) -> None:
    """Estimate how often floors above a boundary are missed and floors below it raise a false alarm.

    Says how many robots, and how much time, make both rare enough. Without --robots, the scenario's number and two
    larger ones are tried.

    examples:
      vibroswarm detect                                             more than half? fill ratios 0.24 to 0.76
      vibroswarm detect --more-than 3% --tiles 10x10
      vibroswarm detect --robots 5,10,20 --error 10% --out out/detect
      vibroswarm detect --false-alarms 1% --boundary-of readings    robots that ignore their sensor's errors
    """
    from vibroswarm.study.detection import detection_of, detection_study
    from vibroswarm.study.options import detection_scenario

    base = detection_scenario(more_than, boundary_of, **keywords_of(scenario))
    with named("--fills", of="floor.source"):
        study = detection_study(base, scenario.robots, fills, runs, scenario.seed)
    runs_done = run_parts(study, execution, output, "detect")
    if runs_done is not None:
        detection = detection_of(runs_done, error, false_alarms)
        deliver(detection, output)


def run_parts(study: Study, execution: Parts, output: Paged, command: str) -> Runs | None:
    """Print what a study consists of and run it, or only the part that ``--shard`` names."""
    shard = _shard(execution.shard)
    refuse(shard[1] > 1 and output.out is None, "--shard", "needs --out DIR")
    claim(output, command, study.hash)
    warn_of(cell.scenario for cell in study.cells)
    print_plan(study)
    with counting_runs("simulating") as progress:
        runs = study.run(output.out, shard=shard, progress=progress, **execution.where)
    if others := runs.store.other_runs:
        report(f"not used: {others:,} runs of another version of the code")
    if shard[1] == 1:
        return runs
    report(
        f"shard {shard[0]} of {shard[1]} is done; copy the folders of all into one, and run there without --shard"
    )
    return None


def _shard(text: str | None) -> tuple[int, int]:
    """Parse ``"3/16"``: part 3 of 16."""
    part, _, of = (text or "1/1").partition("/")
    is_part = part.isdecimal() and of.isdecimal() and 1 <= int(part) <= int(of)
    refuse(not is_part, "--shard", f"'{text}' is not a part; give one such as 3/16")
    return int(part), int(of)


def print_plan(*studies: Study) -> None:
    """Print on stderr what studies consist of."""
    say_compiling()
    for study in studies:
        each = f"{study.runs:,} runs each" if study.runs else "runs until a precision"
        report(f"{len(study.cells):,} cells, {each}, seed {study.seed}")
