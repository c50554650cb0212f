"""What the folder of a study holds: how much is done, damaged and failed, how to go on; and what its runs say."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from vibroswarm.core.numbers import count, count_of, number, whole
from vibroswarm.documents.study import study_document
from vibroswarm.errors import InputError, shown
from vibroswarm.show.document import Document, Text
from vibroswarm.study.plan import plan_of
from vibroswarm.study.store import Store, resume_command
from vibroswarm.study.study_result import StudyResult
from vibroswarm.study.summary import outcome_of

MOST_FAILED: Final = 5
"""Batches that are listed one by one."""


def study_state(store: Store) -> dict[str, Any]:
    """Return the state of a study's folder in plain values: how much is done, damaged and failed.

    ``--json`` prints these values, and ``state_document`` writes them in words.

    ``runs_wanted`` and ``runs_there`` are sums over cells; ``runs_each`` is the number of runs per cell, None if it
    depends on a precision (``until``).
    """
    study, plan = store.study, plan_of(store.study)
    # one row for each cell, with the numbers of its runs that are wanted and of those that are there
    cells = StudyResult(study, store, selected=tuple(cell.number for cell in study.cells)).cells
    size = sum(path.stat().st_size for shard in store.shards for path in shard.files.values())
    return {
        "folder": str(store.folder),
        "name": study.name,
        "command": store.command or "evaluate",
        "study_hash": study.hash,
        "seed": study.seed,
        "varied": study.varied,
        "cells": len(study.cells),
        "motion_groups": len(plan.groups),
        "runs_wanted": int(cells["wanted"].sum()),
        "runs_there": int(cells["there"].sum()),
        "runs_each": study.runs,
        "until": None if study.until is None else study.until.as_values(),
        "shards": len(store.shards),
        "bytes": size,
        "keeps": ["robots and runs", *study.keep],
        "damaged": store.damaged,
        "failed_batches": store.failures,
        "left_over_files": store.left_over,
        "made_by": store.made_by,
    }


def state_document(about: dict[str, Any], needed: str = "") -> Document:
    """Return the state of a study's folder: how much is done, damage, failures, and how to resume.

    Args:
        about: the state of the study, as ``study_state`` returns it.
        needed: the user's code that its results need; empty: none (``results_or_need``).
    """
    wanted, done = about["runs_wanted"], about["runs_there"]
    each = (
        f"{whole(about['runs_each'])} each"
        if about["runs_each"]
        else f"until {about['until']['figure']} is known to {about['until']['until']}"
    )
    name = f"{about['name'] or 'Study'} in {about['folder']}"
    made_by = [
        f"Made by vibroswarm {versions['vibroswarm']} (code {versions['code']}) on {versions['architecture']}."
        for versions in about["made_by"]
    ]
    command = about["command"]
    again = f"run the same {shown(f'vibroswarm {command}')} command again"
    if command == "evaluate":  # which reads all of it from the folder
        again = resume_command(about["folder"])
    return Document(
        title=about["name"] or "Study",
        answer=(
            f"{name}: {count(about['cells'], 'cell')}, runs {each}, seed {about['seed']}.",
            f"Done: {count_of(done, wanted, 'run')}, in {count(about['shards'], 'shard')}, "
            f"{number(about['bytes'] / 1e6, 1)} MB; saved: {', '.join(about['keeps'])}.",
            f"Varied: {', '.join(about['varied']) or 'nothing'}.",
        ),
        warnings=tuple(_warnings(about, needed)),
        parts=(
            *map(Text, made_by),
            Text(f"To resume: {again}" if done < wanted or about["damaged"] else "", "code"),
        ),
    )


def _warnings(about: dict[str, Any], needed: str) -> Iterator[str]:
    """Yield what is damaged, failed, left over and missing."""
    yield from (f"Damaged, to be recomputed: {words}" for words in about["damaged"])
    failed = about["failed_batches"]
    yield from (f"Failed: batch {f['batch']}, seed {f['seed']}: {f['why']}" for f in failed[:MOST_FAILED])
    if len(failed) > MOST_FAILED:
        more = count(len(failed) - MOST_FAILED, "more failed batch", "more failed batches")
        yield f"... and {more}, in {about['folder']}/failures."
    if about["left_over_files"]:
        yield f"Ignored: {count(about['left_over_files'], 'incomplete file')} of killed processes."
    if len(about["made_by"]) > 1:
        yield "Parts come from different versions; the whole may not be repeatable."
    if needed:
        yield f"The results need code that is not loaded ({needed})."


OF_CODE: Final = ("strategy.name", "network.name", "task.name", "sensor.model")
"""Fields of a scenario that may name the user's own code."""


def results_of(store: Store) -> Document | None:
    """Return what the finished runs of a study say; None if no run is finished."""
    every_cell = tuple(cell.number for cell in store.study.cells)
    result = StudyResult(store.study, store, selected=every_cell)
    if not result.cells["there"].sum():
        return None
    return study_document(outcome_of(result))


def results_or_need(store: Store) -> tuple[Document | None, str]:
    """Return the results of a study (``results_of``) and an empty text; or None and the user's code that they need.

    Results may need a strategy, network or task of the user. Without ``--trust``, ``show`` does not run such code; then
    the results are None, and the text states which code is needed. If no run of the study is finished, the results are
    None and the text is empty.
    """
    try:
        return results_of(store), ""
    except InputError as error:
        if error.field not in OF_CODE:
            raise
        return None, str(error)
