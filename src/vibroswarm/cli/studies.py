"""Run studies and print their results, for the commands that run one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli import terminal
from vibroswarm.cli.deliver import (
    document_of,
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
from vibroswarm.cli.terminal import report, say
from vibroswarm.core.folders import PICTURES, REPORT
from vibroswarm.core.numbers import count, whole
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.show.document import Document
    from vibroswarm.study.runs import Runs
    from vibroswarm.study.spec import Study

TABLES = ("summary", "reported", "comparisons", "scores")
"""Tables in the folder of a study."""


def do_study(
    study: Study, comparison: Comparisons, execution: Parts, output: Drawn, cost: str | None = None
) -> None:
    """Run a study, then summarise, print and draw it."""
    from vibroswarm.study.comparison import pairs_of
    from vibroswarm.study.summary import outcome_of

    pairs_of(study.cells, comparison.reference)  # refuses an unknown reference
    objective = _objective_of(cost)
    runs = run_parts(study, execution, output)
    if runs is None:  # only a shard was requested
        return
    outcome = outcome_of(runs, comparison.reference)
    document, tables = document_of(outcome), dict(outcome.tables)
    if objective is not None:
        from vibroswarm.documents.cell_scores import with_scores
        from vibroswarm.search.cell_scores import scores_of, with_fresh_runs

        with STAGES.runs("scoring on fresh runs") as progress:
            scores = with_fresh_runs(scores_of(runs, objective), runs, progress=progress, **execution.where)
        document, tables["scores"] = with_scores(document, scores), scores.table
    if output.out is not None:
        _write_tables(output.out, tables)
    _print_and_draw(document, output)


def _objective_of(cost: str | None) -> Any:
    from vibroswarm.search.objective import Objective

    return None if cost is None else Objective(cost)


def _write_tables(folder: Path, tables: dict[str, Any]) -> None:
    """Write tables into the folder of a study; remove those of an earlier call that it has not."""
    from vibroswarm.study.summary import write_table

    for name in TABLES:
        if name in tables:
            write_table(tables[name], folder / name)
        else:
            for suffix in ("csv", "parquet"):
                (folder / f"{name}.{suffix}").unlink(missing_ok=True)


def _print_and_draw(document: Document, output: Drawn) -> None:
    """Print a study; with ``--out``, also write its page, and pictures on request."""
    try:
        print_document(document, as_json=output.json)
        terminal.results().flush()  # the tables are seen before the page's pictures are drawn, which takes a while
    finally:  # also if the reader, such as `head`, has enough; the folder shall be complete
        _write_page(document, output)
    print_saved(output, None if output.no_pictures else REPORT)


def _write_page(document: Document, output: Drawn) -> None:
    """Write the page of a study and its pictures, unless all that is wanted is there; remove pictures of another."""
    from vibroswarm.show.data import document_data
    from vibroswarm.show.figures import remove_figures
    from vibroswarm.show.page import write_page
    from vibroswarm.show.page_origin import is_made_from, origin

    folder = output.out
    if folder is None:
        return
    made_from = origin(document_data(document))
    is_drawn = is_made_from(folder / REPORT, made_from)
    if output.no_pictures:
        if not is_drawn:
            (folder / REPORT).unlink(missing_ok=True)
            remove_figures(folder / PICTURES)
        return
    if not is_drawn:
        with STAGES.share("drawing") as progress:
            write_page(folder / REPORT, document, progress, made_from)
    if wants_pictures(output) or not is_drawn:
        with STAGES.share("writing pictures") as progress:
            save_requested_pictures(document, output, folder, progress)


def run_parts(study: Study, execution: Parts, output: Saved) -> Runs | None:
    """Print what a study consists of and run it, or only the part that ``--shard`` names.

    Returns:
        The runs; None if only a part of the study was run: then a sentence about that part is printed.
    Raises:
        InputError: options conflict, or ``--out`` holds something else.
    """

    part, of = _part(execution.shard)
    refuse(of > 1 and output.out is None, "--shard", "needs --out DIR")
    refuse(of > 1 and study.until is not None, "--shard", "needs a number of runs")
    claim_study(output, study)
    warn_of(cell.scenario for cell in study.cells)
    print_plan(study)
    with STAGES.runs("simulating") as progress:
        runs = study.run(output.out, shard=(part, of), progress=progress, **execution.where)
    if others := runs.store.other_runs:
        say(
            f"{count(others, 'run')} of another version of the code {'is' if others == 1 else 'are'} not used."
        )
    if of == 1:
        return runs
    there, wanted = sum(runs.there.values()), len(study.cells) * runs.runs
    print_line(
        f"Shard {part} of {of} is done; {whole(there)} of {count(wanted, 'run')} are in {output.out}. "
        "Copy the folders of all shards into one, and run the same command there without --shard."
    )
    return None


def _part(text: str | None) -> tuple[int, int]:
    """Parse ``"3/16"``: part 3 of 16."""
    part, _, of = (text or "1/1").partition("/")
    is_part = part.isdecimal() and of.isdecimal() and 1 <= int(part) <= int(of)
    refuse(not is_part, "--shard", f"'{text}' is not a part; give one such as 3/16")
    return int(part), int(of)


def claim_study(output: Any, study: Study) -> None:
    """Refuse the folder of ``--out`` if it holds anything but runs of this study.

    With ``--force``, the runs of another study stay, and all else is replaced.
    """
    from vibroswarm.core.folders import kind_of

    def check(folder: Path) -> None:
        try:
            study.refuse_other(folder)
        except InputError:
            if not (output.force and kind_of(folder) == "study"):
                raise

    claim(output, check)


def print_plan(*studies: Study) -> None:
    """Print on stderr what studies consist of."""
    say_compiling()
    for study in studies:
        each = f"{count(study.runs, 'run')} each" if study.runs else "runs until a precision"
        report(f"{count(len(study.cells), 'cell')}, {each}, seed {study.seed}")
