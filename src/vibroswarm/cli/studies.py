"""Run studies and print their results, for the commands that run one."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import Comparisons, Drawn, Execution, Parts, Saved
from vibroswarm.cli.output import print_line
from vibroswarm.cli.terminal import report, say
from vibroswarm.errors import InputError, RunError

if TYPE_CHECKING:
    from vibroswarm.show.document import Document
    from vibroswarm.study.runner import Job
    from vibroswarm.study.spec import Study
    from vibroswarm.study.study_result import StudyResult
    from vibroswarm.study.summary import Outcome


def do_study(study: Study, comparison: Comparisons, execution: Parts, output: Drawn) -> None:
    """Run a study, repeat its comparisons on other seeds, then summarise, print and draw it.

    Raises:
        RunError: runs failed. The error is raised at the end, when all other runs are finished, saved and printed.
    """
    from vibroswarm.study.cell_comparison import pairs_of

    compared = bool(pairs_of(study, comparison.reference))  # refuses an unknown reference
    again = compared and not comparison.no_confirm
    result = run_study_of(
        study, execution, output, allow_failures=True, again=again, page_cells=_page_cells(study, output)
    )
    if result is not None:  # else only a shard or a batch was requested
        confirm_and_print(result, comparison, execution, output)


def _page_cells(study: Study, output: Drawn) -> int | None:
    return None if output.out is None or output.no_pictures else len(study.cells)


def confirm_and_print(
    result: StudyResult, comparison: Comparisons, execution: Execution, output: Drawn
) -> None:
    """Repeat the comparisons of a finished study on other seeds, then summarise, print and draw it.

    If no run finished, nothing is repeated or printed.

    Raises:
        RunError: runs failed. The error is raised at the end, when everything is saved and printed.
    """
    from vibroswarm.study.runner import failures_in_words

    second = None
    if result.cells["there"].sum():
        second = None if comparison.no_confirm else _second_block(result, comparison, execution)
        print_outcome(result, second, comparison, output)
    for study_result in (result, second):
        if study_result is not None and study_result.store.failures:
            raise RunError(
                failures_in_words(
                    study_result.store, kept=output.out is not None, is_repetition=study_result is second
                )
            )


def run_study_of(
    study: Study,
    execution: Parts,
    output: Saved,
    *,
    allow_failures: bool = False,
    again: bool = False,
    page_cells: int | None = None,
) -> StudyResult | None:
    """Print the plan of a study and run it, or only the part that ``--shard`` or ``--batch`` names.

    Args:
        allow_failures: return the result even if runs failed. A shard has no result to return, so its failures are
            raised anyway.
        again, page_cells: as ``documents.plan.work_sentence`` needs them.
    Returns:
        The result; None if only a part of the study was run: then a sentence about that part is printed.
    Raises:
        InputError: options conflict, or ``--out`` holds something else.
        RunError: runs failed, and ``allow_failures`` is False or only a shard is run.
    """
    from vibroswarm.cli.out_folder import claim
    from vibroswarm.cli.progress import study_progress
    from vibroswarm.cli.scenario_warnings import warn_of
    from vibroswarm.core.numbers import count_of
    from vibroswarm.study.run import run
    from vibroswarm.study.runner import Job, run_batch
    from vibroswarm.study.store import Store

    out = output.out
    job = None if execution.shard is None else Job.from_words(execution.shard)
    if job is not None and study.until is not None:
        raise InputError(
            "needs a fixed number of runs, not --until: shards run independently", field="--shard"
        )
    if job is not None and execution.batch is not None:
        raise InputError("cannot be used with --shard", field="--batch")
    # A part of a study is of use only if it is saved, to be joined with the other parts.
    if (job or execution.batch) and out is None:
        raise InputError("needs --out DIR", field="--shard" if job else "--batch")
    claim(output, lambda folder: Store.existing(folder, study, shards=False))
    warn_of(cell.scenario for cell in study.cells)
    if execution.batch is not None and out is not None:
        store = run_batch(study, out, execution.batch, mixed=execution.mixed)
        print_line(f"Batch {execution.batch} is done; saved in {store.folder}")
        return None
    print_plan(study, out, job, again=again and job is None, page_cells=page_cells if job is None else None)
    with study_progress("simulating") as progress:
        result = run(
            study,
            out,
            job=job,
            progress=progress,
            allow_failures=allow_failures and job is None,
            **execution.how,
        )
    if job is None:
        return result
    done, requested = int(result.cells["there"].sum()), int(result.cells["wanted"].sum())
    print_line(
        f"Shard {job.number} of {job.of} is done: {count_of(done, requested, 'run')} in {result.store.folder}"
    )
    print_line("After all shards: vibroswarm evaluate merge OUT SHARD ...")
    return None


def _second_block(result: StudyResult, comparison: Comparisons, execution: Execution) -> StudyResult | None:
    """Run the cells of a study again on other seeds, to confirm comparisons; None if no cells are compared."""
    from vibroswarm.cli.progress import study_progress
    from vibroswarm.study.cell_comparison import pairs_of, second_block

    if not pairs_of(result.study, comparison.reference):
        return None
    with study_progress("repeating on other seeds") as progress:
        # Failed runs are allowed here, because they are reported after the results are printed.
        return second_block(result, progress=progress, allow_failures=True, **execution.how)


def print_plan(
    study: Study,
    out: Path | None,
    job: Job | None,
    *,
    again: bool = False,
    page_cells: int | None = None,
    tests: int = 0,
) -> None:
    """Print on stderr what a study consists of, how much of it is left to do, and how long the command may take.

    Args:
        out: the study's folder, whose finished runs are not repeated; None if nothing is saved.
        job: the shard that will be run; None if the whole study will be run.
        again, page_cells, tests: as ``documents.plan.work_sentence`` needs them.
    """
    from vibroswarm.cli.progress import say_compiling
    from vibroswarm.documents.plan import plan_sentence, work_sentence
    from vibroswarm.study.plan import plan_of
    from vibroswarm.study.runner import expected
    from vibroswarm.study.store import Store

    plan = plan_of(study)
    report(plan_sentence(plan))
    store = None if out is None else Store.existing(out, study)
    # Without saved results, an empty store takes their place, so that all runs are left to do. Its path is not used.
    store = Store(Path(), study) if store is None else store
    for damage in store.damaged:
        # a warning, so it is not printed by `report`, which --quiet silences
        say(f"damaged, will be recomputed: {damage}")
    say_compiling()  # before `expected`, whose trial runs compile kernels
    left = expected(store, plan)
    report(work_sentence(plan, left, job, again=again, page_cells=page_cells, tests=tests))


def print_outcome(
    result: StudyResult, second: StudyResult | None, comparison: Comparisons, output: Drawn
) -> None:
    """Summarise a study and print it; with ``--out``, save its tables, its page, and pictures on request.

    Args:
        result: the study with its finished runs; without any, ``outcome_of`` raises ``InputError``.
        second: the repetition of its cells on other seeds, which confirms comparisons; None if it was not run.
    """
    from vibroswarm.cli.deliver import print_document, wants_pictures
    from vibroswarm.cli.output import print_saved
    from vibroswarm.cli.progress import progress_bar
    from vibroswarm.documents.saved import REPORT
    from vibroswarm.documents.study import study_document
    from vibroswarm.show.page_origin import is_made_from
    from vibroswarm.study.summary import outcome_of, write_outcome

    # `outcome_of` reports the progress of its replays for the comparison at equal error.
    with progress_bar("at equal error") as progress:
        outcome = outcome_of(
            result, second, comparison.reference, progress, equal_error=comparison.equal_error
        )
    if output.out is not None:
        write_outcome(outcome, output.out)
    document = study_document(outcome)
    print_document(document, as_json=output.json)
    sys.stdout.flush()  # the tables are seen before the page's pictures are drawn, which takes a while
    if output.out is not None and not output.no_pictures:
        content = _content(document, result, second)
        is_current = is_made_from(output.out / REPORT, _origin(content, output.out))
        if not is_current or wants_pictures(output):
            _write_page(outcome, output.out, output, content)
    print_saved(output, None if output.no_pictures else REPORT)


def _content(document: Document, result: StudyResult, second: StudyResult | None) -> dict[str, Any]:
    """Return what decides what is on the page of a study, as plain values: its tables and its stored runs.

    Args:
        document: without references, which follow from the runs.
    """
    from vibroswarm.show.data import document_data

    stored = [
        [shard.name, dict(shard.made_by)]
        for part in (result, second)
        if part is not None
        for shard in sorted(part.store.shards, key=lambda shard: shard.name)
    ]
    return {"document": document_data(document), "runs": stored}


def _origin(content: dict[str, Any], out: Path) -> str:
    """Return what the page of a study is made from; the table of references is made with it."""
    from vibroswarm.show.page_origin import origin

    return origin(content, (out / "references.csv", out / "references.parquet"))


def _write_page(outcome: Outcome, out: Path, output: Drawn, content: dict[str, Any]) -> None:
    """Write the page of a study, its table of references, and its pictures, if they are requested.

    A reference of a cell is how fast a decision could have been made if all samples had been known in one place at
    once. References are computed for studies with few cells only.

    Args:
        content: from ``_content``.
    """
    from vibroswarm.cli.deliver import save_requested_pictures
    from vibroswarm.cli.progress import progress_bar
    from vibroswarm.documents.saved import REPORT
    from vibroswarm.documents.study import study_document
    from vibroswarm.show.page import write_page
    from vibroswarm.study.baselines import references_of
    from vibroswarm.study.summary import write_outcome

    with progress_bar("references") as progress:
        references = tuple(references_of(outcome.result, progress=progress))
    outcome = replace(outcome, references=references)
    write_outcome(outcome, out)
    document = study_document(outcome)
    with progress_bar("drawing") as progress:
        write_page(out / REPORT, document, progress, _origin(content, out))
    with progress_bar("writing pictures") as progress:
        save_requested_pictures(document, output, out, progress)
