"""What ``evaluate``, ``sweep``, ``merge`` and ``show`` share: options, the plan in words, the run, the table."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from vibroswarm.errors import InputError, RunError

if TYPE_CHECKING:
    from vibroswarm.study.outcome import Outcome
    from vibroswarm.study.result import StudyResult
    from vibroswarm.study.runner import Share
    from vibroswarm.study.spec import Study

STYLES = ("column", "page", "slide")


def add_running_options(parser: argparse.ArgumentParser) -> None:
    """Options that say who does the work."""
    how = parser.add_argument_group("who does the work")
    how.add_argument("--workers", metavar="N", help="threads or processes (default: all processors)")
    how.add_argument(
        "--executor", metavar="WHERE", default="threads",
        help="threads (default), processes, dask://HOST:PORT, or a Dask scheduler file",
    )  # fmt: skip
    how.add_argument("--shard", metavar="K/N", help="do only share K of N; 'vibroswarm merge' joins them")
    how.add_argument(
        "--batch", metavar="G:A-B", help="do only this batch, in this process (as failures are told)"
    )
    how.add_argument(
        "--mixed", action="store_true", help="go on where other versions began; the report says so"
    )


def add_outcome_options(parser: argparse.ArgumentParser) -> None:
    """Options that say what is shown."""
    what = parser.add_argument_group("what is shown")
    what.add_argument(
        "--json", action="store_true", help="give the figures as JSON, and nothing else, on stdout"
    )
    what.add_argument(
        "--style", metavar="NAME", default="column", help=f"of pictures: {', '.join(STYLES)} (default column)"
    )
    what.add_argument("--no-pictures", action="store_true", help="numbers only: no pictures, no report")
    what.add_argument(
        "--no-confirm", action="store_true",
        help="do not make comparisons a second time, on other seeds (up to 1000 runs more)",
    )  # fmt: skip


def check_style(style: str) -> None:
    """Refuse a style that there is not, before hours of work."""
    from vibroswarm.errors import nearest

    if style not in STYLES:
        known = ", ".join(STYLES)
        raise InputError(
            f"there is no style '{style}'{nearest(style, STYLES)} (there are {known})", field="--style"
        )


def do_study(study: Study, arguments: argparse.Namespace) -> int:
    """Plan, run, sum up, draw, say."""
    check_style(arguments.style)
    result = run_study_of(study, arguments, bear_failures=True)
    if result is None:
        return 0
    second = None if arguments.no_confirm or not _has_runs(result) else _second_block(result, arguments)
    if _has_runs(result):
        say_outcome(result, second, arguments)
    _check_failures(arguments.out is not None, result, second)
    return 0


def _has_runs(result: StudyResult) -> bool:
    return bool(result.cells["there"].sum())


def _check_failures(kept: bool, *results: StudyResult | None) -> None:
    """Raise RunError where runs failed, once all else is done and said."""
    from vibroswarm.study.runner import failures_in_words

    for one in results:
        if one is not None and one.store.failures:
            raise RunError(failures_in_words(one.store, kept))


def run_study_of(
    study: Study, arguments: argparse.Namespace, *, bear_failures: bool = False
) -> StudyResult | None:
    """Plan and run; None where only a share or a batch was wanted, which is then said.

    Args:
        bear_failures: give the result also where runs failed.
    """
    from vibroswarm.cli.scenarios import whole_number
    from vibroswarm.cli.warned import warn_of
    from vibroswarm.study.runner import Share, run_batch

    share = None if arguments.shard is None else Share.from_words(arguments.shard)
    workers = None if arguments.workers is None else whole_number(arguments.workers, "--workers")
    if share is not None and study.until is not None:
        raise InputError(
            "goes with a number of runs, not with --until: shares know nothing of each other", field="--shard"
        )
    if share is not None and arguments.batch is not None:
        raise InputError("is a batch of any share; say one of the two", field="--batch")
    if (share or arguments.batch) and arguments.out is None:
        raise InputError("needs --out DIR, where its runs are kept", field="--shard" if share else "--batch")
    warn_of(cell.scenario for cell in study.cells)
    if arguments.batch is not None:
        store = run_batch(study, arguments.out, arguments.batch)
        print(f"Batch {arguments.batch} is done and kept in {store.folder}.")
        return None
    result = _run(study, arguments, workers, share, bear_failures)
    if share is not None:
        _say_share(result, share)
        return None
    return result


def _run(
    study: Study,
    arguments: argparse.Namespace,
    workers: int | None,
    share: Share | None,
    bear_failures: bool,
) -> StudyResult:
    from vibroswarm.cli.progress import study_progress
    from vibroswarm.study.result import run

    say_plan(study, arguments.out, share)
    with study_progress("simulating", workers) as tell:
        return run(
            study,
            arguments.out,
            executor=arguments.executor,
            workers=workers,
            share=share,
            mixed=arguments.mixed,
            tell=tell,
            bear_failures=bear_failures and share is None,
        )


def _second_block(result: StudyResult, arguments: argparse.Namespace) -> StudyResult | None:
    from vibroswarm.cli.progress import study_progress
    from vibroswarm.study.compare import pairs_of, second_block

    if not pairs_of(result.study):
        return None
    workers = None if arguments.workers is None else int(arguments.workers)
    with study_progress("again, on other seeds", workers) as tell:
        return second_block(
            result,
            executor=arguments.executor,
            workers=workers,
            mixed=arguments.mixed,
            tell=tell,
            bear_failures=True,
        )


def say_plan(study: Study, out: Path | None, share: Share | None) -> None:
    """What will be done and how long it may take, on stderr."""
    from vibroswarm.cli.progress import say_compiling
    from vibroswarm.study.expected import expected
    from vibroswarm.study.plan import plan_of
    from vibroswarm.study.store import Store

    plan = plan_of(study)
    cells, groups = len(study.cells), len(plan.groups)
    runs = f"{study.runs:,}" if study.runs else "100 or more"
    shared = (
        f"moved {times(groups)} a run, observed {times(plan.observations)}, decided {times(plan.inferences)}"
    )
    words = f"{cells} cell{'s' * (cells != 1)}, {runs} runs each, seed {study.seed}; {shared}"
    print(words, file=sys.stderr)
    store = None if out is None else Store.existing(out, study)
    store = Store(Path(), study) if store is None else store
    for words in store.damaged:
        print(f"damaged, and made again: {words}", file=sys.stderr)
    say_compiling()
    left = expected(store, plan)
    if left.runs == 0:
        print("All of it is there already.", file=sys.stderr)
        return
    part = f" (this share: a part in {share.of})" if share else ""
    words = f"{left.runs:,} runs of motion to do, about {duration(left.core_s)} of one core{part}"
    print(f"{words} (from {left.tried} trial runs)", file=sys.stderr, flush=True)


def times(count: int) -> str:
    """once, twice, 3 times."""
    return {1: "once", 2: "twice"}.get(count, f"{count:,} times")


def duration(seconds: float) -> str:
    """In words that fit: 0.4 s, 25 s, 12 min, 3.5 h."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def _say_share(result: StudyResult, share: Share) -> None:
    cells = result.cells
    there, wanted = int(cells["there"].sum()), int(cells["wanted"].sum())
    where = result.store.folder
    print(
        f"Share {share.number} of {share.of} is done and kept in {where}: {there:,} of {wanted:,} runs there."
    )
    print("When all shares are done: vibroswarm merge OUT SHARE-FOLDER ...")


def say_outcome(result: StudyResult, second: StudyResult | None, arguments: argparse.Namespace) -> int:
    """Sum up; keep numbers, pictures and report where there is a folder; say the table."""
    from vibroswarm.study.outcome import outcome_of, write_outcome

    outcome = outcome_of(result, second)
    if arguments.out is not None:
        write_outcome(outcome, arguments.out)
    if arguments.json:
        print(json.dumps(outcome.as_dict(), indent=2, allow_nan=False))
    else:
        from vibroswarm.cli.tables import say_tables

        say_tables(outcome)
    sys.stdout.flush()
    if arguments.out is not None and not arguments.no_pictures:
        _draw(outcome, arguments)
    if not arguments.json:
        _say_where(arguments)
        sys.stdout.flush()
    return 0


def _draw(outcome: Outcome, arguments: argparse.Namespace) -> None:
    from vibroswarm.cli.progress import progress_bar
    from vibroswarm.study.outcome import write_table
    from vibroswarm.study.references import reference_table, references_of
    from vibroswarm.study.report import write_pictures_and_report

    with progress_bar("references") as tell:
        references = references_of(outcome.result, tell=tell)
    if references:
        write_table(reference_table(references), arguments.out / "references")
    with progress_bar("drawing") as tell:
        write_pictures_and_report(outcome, references, arguments.out, arguments.style, tell)


def _say_where(arguments: argparse.Namespace) -> None:
    if arguments.out is None:
        print("Nothing was kept; --out DIR keeps runs, numbers, pictures and a report.")
        return
    print(f"Kept in {arguments.out}: summary.csv, comparisons.csv, the runs (shards).")
    if not arguments.no_pictures:
        print(f"See it: open {(arguments.out / 'report.html').resolve()} in a browser.")
