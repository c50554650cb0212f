"""Run studies and print their results, for the commands that run one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from vibroswarm.cli import terminal
from vibroswarm.cli.deliver import (
    print_document,
    print_line,
    print_saved,
    save_requested_pictures,
    wants_pictures,
)
from vibroswarm.cli.option_values import refuse
from vibroswarm.cli.options import Comparisons, Drawn, Parts, Saved
from vibroswarm.cli.out_folder import claim
from vibroswarm.cli.progress import STAGES, say_compiling
from vibroswarm.cli.scenario_options import warn_of
from vibroswarm.cli.terminal import printing, report
from vibroswarm.core.folders import REPORT

if TYPE_CHECKING:
    from vibroswarm.study.runner import Job
    from vibroswarm.study.spec import Study
    from vibroswarm.study.study_result import StudyResult
    from vibroswarm.study.summary import Outcome


def do_study(study: Study, comparison: Comparisons, execution: Parts, output: Drawn) -> None:
    """Run a study, then summarise, print and draw it.

    Raises:
        RunError: runs failed. The error is raised at the end, when all other runs are finished, saved and printed.
    """
    from vibroswarm.study.cell_comparison import pairs_of

    pairs_of(study, comparison.reference)  # refuses an unknown reference
    result = run_parts(study, execution, output, allow_failures=True)
    if result is not None:  # else only a shard or a batch was requested
        summarise_and_print(result, comparison, output)


def summarise_and_print(result: StudyResult, comparison: Comparisons, output: Drawn) -> None:
    """Summarise, print and draw a finished study; if no run finished, nothing is printed.

    Raises:
        RunError: runs failed. The error is raised at the end, when everything is saved and printed.
    """
    from vibroswarm.study.evaluation import outcome_after, raise_failures

    if result.cells["there"].sum():
        outcome = outcome_after(result, output.out, reference=comparison.reference)
        _print_outcome(outcome, output)
    raise_failures(result, kept=output.out is not None)


def _print_outcome(outcome: Outcome, output: Drawn) -> None:
    """Print a study; with ``--out``, also write its page, and pictures on request."""
    try:
        print_document(outcome, as_json=output.json)
        terminal.results().flush()  # the tables are seen before the page's pictures are drawn, which takes a while
    except BrokenPipeError:  # the reader, such as `head`, has enough; the folder shall be complete
        _write_page(outcome, output)
        raise
    _write_page(outcome, output)
    print_saved(output, None if output.no_pictures else REPORT)


def _write_page(outcome: Outcome, output: Drawn) -> None:
    """Write the page of a study and its pictures, unless all that is wanted is there; remove pictures of another."""
    from vibroswarm.core.folders import PICTURES
    from vibroswarm.show.figures import remove_figures
    from vibroswarm.study.evaluation import has_report, write_report

    folder = output.out
    if folder is None:
        return
    is_reported = has_report(outcome, folder)
    if output.no_pictures and not is_reported:
        remove_figures(folder / PICTURES)
    elif not output.no_pictures and (wants_pictures(output) or not is_reported):
        document = write_report(outcome, folder, STAGES)
        with STAGES.share("writing pictures") as progress:
            save_requested_pictures(document, output, folder, progress)


def run_parts(
    study: Study,
    execution: Parts,
    output: Saved,
    *,
    allow_failures: bool = False,
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
    from vibroswarm.documents.plan import batch_sentence, shard_sentences
    from vibroswarm.study.evaluation import check_part
    from vibroswarm.study.run import run
    from vibroswarm.study.runner import run_batch

    out = output.out
    job = check_part(study, execution.shard, execution.batch, out)
    if part := "--shard" if job else "--batch" if execution.batch else None:
        for option in ("json", "open", "pictures"):
            words = f"is of the whole study, of which {part} runs a part; omit it"
            refuse(getattr(output, option, False), f"--{option}", words)
    claim_study(output, study, mixed=execution.mixed)
    warn_of(cell.scenario for cell in study.cells)
    if execution.batch is not None and out is not None:
        store = run_batch(study, out, execution.batch, mixed=execution.mixed)
        print_line(batch_sentence(execution.batch, store))
        return None
    print_plan(study, out, job)
    with STAGES.runs("simulating") as progress:
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
    for sentence in shard_sentences(result, job):
        print_line(sentence)
    return None


def claim_study(output: Any, study: Study, *, mixed: bool = False) -> None:
    """Refuse the folder of ``--out`` if it holds anything but runs of this study (``out_folder.claim``)."""
    from vibroswarm.study.store import Store

    claim(output, lambda folder: Store.existing(folder, study, shards=False), mixed=mixed)


def print_plan(
    study: Study,
    out: Path | None,
    job: Job | None,
    *,
    tests: Mapping[str, Study] = MappingProxyType({}),
) -> None:
    """Print on stderr what a study consists of, and how much of it is left to do.

    Args:
        out: the study's folder, whose finished runs are not repeated; None if nothing is saved.
        job: the shard that will be run; None if the whole study will be run.
        tests: further studies of the command, by the name of their folder in ``out``.
    """
    from vibroswarm.documents.plan import plan_sentence, work_sentence
    from vibroswarm.study.plan import plan_of
    from vibroswarm.study.runner import runs_left
    from vibroswarm.study.store import Store

    report(plan_sentence(plan_of(study)))

    def store_of(one: Study, folder: Path | None) -> Store:
        """Return the saved results of a study; without any, an empty store, so that all runs are left to do."""
        saved = None if folder is None else Store.existing(folder, one)
        return Store(Path(), one) if saved is None else saved  # the path of an empty store is not used

    say_compiling()
    if not printing.quiet:
        further = sum(
            runs_left(store_of(one, None if out is None else out / name)) for name, one in tests.items()
        )
        report(work_sentence(runs_left(store_of(study, out), job), job, further=further))
