"""Run studies and print their results, for the commands ``evaluate``, ``sweep``, ``detect`` and ``merge``.

Before a study runs, its plan is printed on stderr. Its results are the answer in sentences, the figures of each cell,
and the differences of each comparison of cells.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vibroswarm.cli.options import (
    add_execution_options,
    add_json,
    add_pictures,
    add_style,
    wants_picture_files,
)
from vibroswarm.cli.output import add_open, print_paragraph, print_table, with_interval
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
    claim(arguments, lambda: Store.existing(arguments.out, study))
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


def duration(seconds: float) -> str:
    """Return a duration in a fitting unit: 0.4 s, 25 s, 12 min, 3.5 h."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def print_outcome(result: StudyResult, second: StudyResult | None, arguments: argparse.Namespace) -> int:
    """Summarise a study and print its tables; with ``--out``, save numbers and report; return the exit code.

    Args:
        result: the study with its finished runs; without any, ``outcome_of`` raises ``InputError``.
        second: the repetition of its cells on other seeds, which confirms comparisons; None if it was not run.
    """
    from vibroswarm.cli.output import print_json
    from vibroswarm.cli.progress import progress_bar
    from vibroswarm.study.summary import outcome_of, write_outcome

    # `outcome_of` reports the progress of its replays for the comparison at equal error.
    with progress_bar("at equal error") as progress:
        outcome = outcome_of(result, second, arguments.reference, progress, equal_error=arguments.equal_error)
    if arguments.out is not None:
        write_outcome(outcome, arguments.out)
    if arguments.json:
        print_json(outcome.as_dict())
    else:
        print_tables(outcome)
        _print_hint(outcome)
    sys.stdout.flush()  # the tables are seen before the report's pictures are drawn, which takes a while
    if arguments.out is not None and not arguments.no_pictures:
        _draw(outcome, arguments)
    _print_saved(arguments)
    return 0


def _print_hint(outcome: Outcome) -> None:
    """Print how strategies are compared at equal error, if one is faster but wrong more often, and they were not."""
    from vibroswarm.study.cell_comparison import pairs_at_equal_error

    comparable = pairs_at_equal_error(outcome.result, outcome.comparisons)
    names = [
        answer.faster_and_more_wrong
        for answer in outcome.answers
        if answer.matched is None and (answer.cell.number, answer.reference.number) in comparable
    ]
    traded = list(dict.fromkeys(name for name in names if name is not None))
    if traded:
        print_paragraph(
            f"Faster but wrong more often: {', '.join(traded)}. Not compared at equal error; add --equal-error."
        )


def _draw(outcome: Outcome, arguments: argparse.Namespace) -> None:
    """Write the report of a study and its table of references; and its pictures, if requested or written before.

    Pictures that an earlier command has written are drawn again, since they may show fewer runs.

    A reference of a cell is how fast a decision could have been made if all samples had been known in one place at
    once. References are computed for studies with few cells only.
    """
    from vibroswarm.cli.progress import progress_bar
    from vibroswarm.study.baselines import reference_table, references_of
    from vibroswarm.study.study_report import MARKER, PICTURES, write_pictures_and_report
    from vibroswarm.study.summary import write_table

    with progress_bar("references") as progress:
        references = references_of(outcome.result, progress=progress)
    if references:
        write_table(reference_table(references), arguments.out / "references")
    style = arguments.style if wants_picture_files(arguments, f"{PICTURES}/{MARKER}") else None
    with progress_bar("drawing") as progress:
        write_pictures_and_report(outcome, references, arguments.out, style, progress)


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


MOST_SENTENCES: Final = 12
"""Greatest number of comparisons, or of cells, that are described in sentences."""
NOTES: Final = (
    "Differences run by run: the first minus the second, 95 % sign-flip intervals; right, wrong and undecided in "
    "percentage points of robots; * p < 0.05, corrected over all comparisons (Holm). No significant difference is not "
    "evidence of no difference."
)
"""The note below the table of differences."""


def print_tables(outcome: Outcome) -> None:
    """Print the answer of a study, the figures of its cells, the differences of comparisons, and warnings."""
    print_answers(outcome)
    _print_cells(outcome)
    runs = {cell_outcome.summary.runs for cell_outcome in outcome.cells}
    count = f"{min(runs):,}" if len(runs) == 1 else f"{min(runs):,} to {max(runs):,}"
    print_paragraph(
        f"{count} runs per cell; in brackets 95 % intervals over runs (Wilson, t). An undecided run counts with its "
        "whole time."
    )
    _print_agreements(outcome)
    # With --until, intervals are computed several times (looks), and the study ends when one is narrow enough. So that
    # the last interval holds at the study's level (95 %), the interval of each look has a higher level.
    until = outcome.result.study.until
    levels = {cell_outcome.settled.level for cell_outcome in outcome.cells if cell_outcome.settled}
    if until is not None and levels:
        levels_text = " to ".join(f"{100 * level:.2f} %" for level in sorted({min(levels), max(levels)}))
        print_paragraph(
            f"Intervals of {until.figure} are at {levels_text}, corrected for repeated looks: they hold at "
            f"{100 * until.level:g} %."
        )
    print_effects(outcome)
    for warning in outcome.warnings:
        print_paragraph(f"Warning: {warning}")


def _print_cells(outcome: Outcome) -> None:
    """Print the figures of each cell as a table, with the number of failed runs if any run failed."""
    print_table(
        [
            "cell",
            *(["failed runs"] if outcome.has_failed_runs else []),
            "swarms right, %",
            "swarms wrong, %",
            "split, %",
            "incomplete, %",
            "robots undecided, %",
            "decision time, s",
            "belief in the truth",
        ],
        [
            [
                cell_outcome.cell.name,
                *([cell_outcome.failed.height] if outcome.has_failed_runs else []),
                *(
                    with_interval(share, ".1f", scale=100.0)
                    for share in (
                        cell_outcome.summary.swarm_right,
                        cell_outcome.summary.swarm_wrong,
                        cell_outcome.summary.swarm_split,
                        cell_outcome.summary.swarm_incomplete,
                        cell_outcome.summary.robots_undecided,
                    )
                ),
                with_interval(cell_outcome.summary.decision_time_s, ".0f"),
                with_interval(cell_outcome.summary.belief_in_truth, ".3f"),
            ]
            for cell_outcome in outcome.cells
        ],
        more=("split, %", "incomplete, %", "belief in the truth"),  # printed with --wide only
    )


def _print_agreements(outcome: Outcome) -> None:
    """Print on what swarms agreed, and whether agreement lasted, for cells with runs in which no answer is right.

    Nothing is printed if there are no such cells. A dash: decisions are final, or no swarm agreed.
    """
    from vibroswarm.study.answers import lacks_truth

    cells = [cell_outcome for cell_outcome in outcome.cells if lacks_truth(cell_outcome.summary)]
    if not cells:
        return
    rows = []
    for cell_outcome in cells:
        figures = cell_outcome.summary
        shares = (
            figures.agreed_on_0, figures.agreed_on_1, figures.swarm_split, figures.swarm_incomplete,
            figures.agreement_lasted,
        )  # fmt: skip
        texts = [with_interval(share, ".1f", scale=100.0) for share in shares]
        rows.append([cell_outcome.cell.name, *texts, with_interval(figures.consensus_time_s, ".0f")])
    print_table(
        [
            "cell",
            "agreed on 0, %",
            "agreed on 1, %",
            "split, %",
            "incomplete, %",
            "lasted, %",
            "agreement, s",
        ],
        rows,
    )
    print_paragraph(
        "Runs without a right answer: on what their swarms agreed (0: less, 1: more), as a share of all runs. Lasted: "
        "share of the agreements that held at the end, where opinions may change. Runs without agreement count with "
        "their whole time."
    )


def print_answers(outcome: Outcome) -> None:
    """Print the notes and the question of a study, and the sentences of its answer."""
    for note in outcome.notes:
        print_paragraph(note)
    print_paragraph(outcome.question)
    print()
    for sentence in answer_lines(outcome):
        print_paragraph(sentence)
    print()


def answer_lines(outcome: Outcome) -> list[str]:
    """Return sentences on the first ``MOST_SENTENCES`` comparisons, or on the first cells if a study compares none.

    If comparisons or cells are left out, a last sentence states their number.
    """
    from vibroswarm.study.answers import cell_sentences

    if not outcome.answers:
        lines = cell_sentences(outcome.cells[:MOST_SENTENCES])
        left = len(outcome.cells) - len(lines)  # there is one sentence for each cell
        return lines + ([f"... and {left} more cells."] if left else [])
    lines = []
    for answer in outcome.answers[:MOST_SENTENCES]:
        lines += [answer.sentence, *([answer.at_equal_error] if answer.at_equal_error else [])]
    left = len(outcome.answers) - MOST_SENTENCES
    return lines + ([f"... and {left} more comparisons, below."] if left > 0 else [])


def print_effects(outcome: Outcome) -> None:
    """Print a row for each comparison of two cells: the differences in time, right, wrong and undecided; then a note.

    A star marks significant differences. Nothing is printed if no cells are compared.
    """
    if not outcome.answers:
        return
    rows = []
    for answer in outcome.answers:
        # the differences in the order of the columns below
        effects = [effect.number + ("*" if effect.significant else "") for effect in answer.effects]
        rows.append([answer.name, *(text.replace(" points", "") for text in effects)])  # NOTES names the unit
    print_table(["compared", "time", "right", "wrong", "undecided"], rows)
    print_paragraph(NOTES)
