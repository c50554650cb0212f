"""Run studies and print their results, for the commands ``evaluate``, ``sweep``, ``detect`` and ``merge``.

Before a study runs, its plan is printed on stderr. Its results are the answer in sentences, the figures of each cell,
and the differences of each comparison of cells.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import (
    add_execution_options,
    add_json,
    add_pictures,
    add_style,
)
from vibroswarm.cli.output import add_open
from vibroswarm.cli.terminal import report
from vibroswarm.errors import InputError, RunError

if TYPE_CHECKING:
    from vibroswarm.study.runner import Job
    from vibroswarm.study.spec import Study
    from vibroswarm.study.study_result import StudyResult
    from vibroswarm.study.summary import Outcome


def add_running_options(parser: argparse.ArgumentParser) -> None:
    """Add options for how and which runs are executed: workers, executor, shards and batches."""
    execution = add_execution_options(parser)
    execution.add_argument(
        "--shard", metavar="K/N", help="run only shard K of N; 'vibroswarm merge' joins them"
    )
    execution.add_argument(
        "--batch", metavar="G:A-B", help="run only this batch, in this process (named as failures are listed)"
    )


def add_outcome_options(parser: argparse.ArgumentParser) -> None:
    """Add options for what is printed and drawn, and for whether comparisons are repeated."""
    output = parser.add_argument_group("output")
    add_json(output)
    add_style(output)
    add_pictures(output, without="numbers only: no pictures, no report")
    add_open(output)
    output.add_argument(
        "--no-confirm",
        action="store_true",
        help="do not repeat comparisons on other seeds (saves up to 1000 runs)",
    )
    output.add_argument(
        "--equal-error",
        action="store_true",
        help="also compare strategies at equal error, each with its best settings (replays up to 1000 runs)",
    )
    output.add_argument(
        "--reference",
        metavar="NAME",
        help="compare with this strategy (or other varied value) only; default: strategies in all pairs",
    )


def do_study(study: Study, arguments: argparse.Namespace) -> int:
    """Run a study, repeat its comparisons on other seeds, then summarise, print and draw it; return the exit code.

    If no run finished, nothing is repeated or printed.

    Raises:
        RunError: runs failed. The error is raised at the end, when all other runs are finished, saved and printed.
    """
    from vibroswarm.study.cell_comparison import pairs_of

    pairs_of(study, arguments.reference)  # refuses an unknown reference before anything is simulated
    result = run_study_of(study, arguments, allow_failures=True)
    if result is None:  # only a shard or a batch was requested
        return 0
    return confirm_and_print(result, arguments)


def confirm_and_print(result: StudyResult, arguments: argparse.Namespace) -> int:
    """Repeat the comparisons of a finished study on other seeds, then summarise, print and draw it.

    If no run finished, nothing is repeated or printed.

    Returns: the exit code.
    Raises:
        RunError: runs failed. The error is raised at the end, when everything is saved and printed.
    """
    from vibroswarm.study.runner import failures_in_words

    second = None
    if result.cells["there"].sum():
        second = None if arguments.no_confirm else _second_block(result, arguments)
        print_outcome(result, second, arguments)
    for study_result in (result, second):
        if study_result is not None and study_result.store.failures:
            raise RunError(
                failures_in_words(
                    study_result.store, kept=arguments.out is not None, is_repetition=study_result is second
                )
            )
    return 0


def run_study_of(
    study: Study, arguments: argparse.Namespace, *, allow_failures: bool = False
) -> StudyResult | None:
    """Print the plan of a study and run it, or only the part that ``--shard`` or ``--batch`` names.

    Args:
        allow_failures: return the result even if runs failed. A shard has no result to return, so its failures are
            raised anyway.
    Returns:
        The result; None if only a part of the study was run: then a sentence about that part is printed.
    Raises:
        InputError: options conflict, or ``--out`` holds something else.
        RunError: runs failed, and ``allow_failures`` is False or only a shard is run.
    """
    from vibroswarm.cli.out_folder import claim
    from vibroswarm.cli.output import check_open
    from vibroswarm.cli.progress import study_progress
    from vibroswarm.cli.scenario_warnings import warn_of
    from vibroswarm.study.run import run
    from vibroswarm.study.runner import Job, run_batch
    from vibroswarm.study.store import Store

    job = None if arguments.shard is None else Job.from_words(arguments.shard)
    if job is not None and study.until is not None:
        raise InputError(
            "needs a fixed number of runs, not --until: shards run independently", field="--shard"
        )
    if job is not None and arguments.batch is not None:
        raise InputError("cannot be used with --shard", field="--batch")
    # A part of a study is of use only if it is saved, to be joined with the other parts.
    if (job or arguments.batch) and arguments.out is None:
        raise InputError("needs --out DIR", field="--shard" if job else "--batch")
    check_open(arguments)
    claim(arguments, lambda folder: Store.existing(folder, study))
    warn_of(cell.scenario for cell in study.cells)
    if arguments.batch is not None:
        store = run_batch(study, arguments.out, arguments.batch, mixed=arguments.mixed)
        print(f"Batch {arguments.batch} is done; saved in {store.folder}")
        return None
    print_plan(study, arguments.out, job)
    with study_progress("simulating") as progress:
        result = run(
            study,
            arguments.out,
            job=job,
            progress=progress,
            allow_failures=allow_failures and job is None,
            **_execution(arguments),
        )
    if job is None:
        return result
    done, requested = int(result.cells["there"].sum()), int(result.cells["wanted"].sum())
    print(f"Shard {job.number} of {job.of} is done: {done:,} of {requested:,} runs in {result.store.folder}")
    print("After all shards: vibroswarm merge OUT SHARD ...")
    return None


def _execution(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the options of ``add_execution_options`` as keyword arguments of functions that run a study."""
    return {"executor": arguments.executor, "workers": arguments.workers, "mixed": arguments.mixed}


def _second_block(result: StudyResult, arguments: argparse.Namespace) -> StudyResult | None:
    """Run the cells of a study again on other seeds, to confirm comparisons; None if no cells are compared."""
    from vibroswarm.cli.progress import study_progress
    from vibroswarm.study.cell_comparison import pairs_of, second_block

    if not pairs_of(result.study, arguments.reference):
        return None
    with study_progress("repeating on other seeds") as progress:
        # Failed runs are allowed here, because `do_study` reports them after the results are printed.
        return second_block(result, progress=progress, allow_failures=True, **_execution(arguments))


def print_plan(study: Study, out: Path | None, job: Job | None) -> None:
    """Print on stderr what a study consists of, how much of it is left to do, and how long that may take.

    Args:
        out: the study's folder, whose finished runs are not repeated; None if nothing is saved.
        job: the shard that will be run; None if the whole study will be run.
    """
    from vibroswarm.cli.progress import say_compiling
    from vibroswarm.show.numbers import duration
    from vibroswarm.study.plan import plan_of
    from vibroswarm.study.runner import expected
    from vibroswarm.study.store import Store

    plan = plan_of(study)
    cells, groups = len(study.cells), len(plan.groups)
    # With --until, intervals are computed after 100 runs for the first time.
    runs = f"{study.runs:,}" if study.runs else "100 or more"
    # Cells share work (see `study.plan`). For each run, all cells together need this many motions, observations of
    # samples, and inferences from the readings.
    shared = ", ".join(
        f"{count:,} {name}{'s' * (count != 1)}"
        for count, name in (
            (groups, "motion"),
            (plan.observations, "observation"),
            (plan.inferences, "inference"),
        )
    )
    report(f"{cells} cell{'s' * (cells != 1)}, {runs} runs each, seed {study.seed}; shared per run: {shared}")
    store = None if out is None else Store.existing(out, study)
    # Without saved results, an empty store takes their place, so that all runs are left to do. Its path is not used.
    store = Store(Path(), study) if store is None else store
    for damage in store.damaged:
        # a warning, so it is not printed by `report`, which --quiet silences
        print(f"damaged, will be recomputed: {damage}", file=sys.stderr)
    say_compiling()  # before `expected`, whose trial runs compile kernels
    left = expected(store, plan)
    if left.runs == 0:
        report("Nothing to do: all runs exist.")
        return
    part = f" (this shard: 1/{job.of} of it)" if job else ""
    how = f"estimated from {left.tried} trial runs" if left.tried else "a rough estimate"
    report(f"To do: {left.runs:,} runs of motion, about {duration(left.core_s)} of one core{part} ({how})")


def print_outcome(result: StudyResult, second: StudyResult | None, arguments: argparse.Namespace) -> None:
    """Summarise a study and print it; with ``--out``, save its tables, its page, and pictures on request.

    Args:
        result: the study with its finished runs; without any, ``outcome_of`` raises ``InputError``.
        second: the repetition of its cells on other seeds, which confirms comparisons; None if it was not run.
    """
    from vibroswarm.cli.deliver import print_result
    from vibroswarm.cli.progress import progress_bar
    from vibroswarm.documents.study import study_document
    from vibroswarm.study.summary import outcome_of, write_outcome

    # `outcome_of` reports the progress of its replays for the comparison at equal error.
    with progress_bar("at equal error") as progress:
        outcome = outcome_of(result, second, arguments.reference, progress, equal_error=arguments.equal_error)
    if arguments.out is not None:
        write_outcome(outcome, arguments.out)
    print_result(study_document(outcome), arguments)
    sys.stdout.flush()  # the tables are seen before the page's pictures are drawn, which takes a while
    if arguments.out is not None and not arguments.no_pictures:
        _write_page(outcome, arguments)
    _print_saved(arguments)


def _write_page(outcome: Outcome, arguments: argparse.Namespace) -> None:
    """Write the page of a study, its table of references, and its pictures, if they are requested.

    A reference of a cell is how fast a decision could have been made if all samples had been known in one place at
    once. References are computed for studies with few cells only.
    """
    from vibroswarm.cli.deliver import REPORT, save_requested_pictures
    from vibroswarm.cli.progress import progress_bar
    from vibroswarm.documents.study import study_document
    from vibroswarm.show.page import write_page
    from vibroswarm.study.baselines import references_of
    from vibroswarm.study.summary import write_outcome

    with progress_bar("references") as progress:
        references = tuple(references_of(outcome.result, progress=progress))
    outcome = replace(outcome, references=references)
    write_outcome(outcome, arguments.out)
    document = study_document(outcome)
    with progress_bar("drawing") as progress:
        write_page(arguments.out / REPORT, document, progress)
    with progress_bar("writing pictures") as progress:
        save_requested_pictures(document, arguments, arguments.out, progress)


def _print_saved(arguments: argparse.Namespace) -> None:
    """Print where the tables, runs and report of a study are saved; without ``--out``, print what could be saved."""
    from vibroswarm.cli.output import print_saved

    # Without --out, the message lists all tables that a study may have; with it, only the tables that this study has.
    tables: tuple[str, ...] = ("summary.csv", "comparisons.csv")
    if arguments.equal_error:
        tables += ("equal_error.csv",)
    if arguments.out is not None:
        tables = tuple(name for name in tables if (arguments.out / name).is_file())
    saved = ", ".join(tables)
    page = None if arguments.no_pictures else "report.html"
    drawn = (
        "" if arguments.no_pictures else ", pictures and a report" if arguments.pictures else " and a report"
    )
    print_saved(arguments, f"{saved}, the runs (shards){drawn}", page)
