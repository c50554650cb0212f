"""What the folder of a study holds: how much is done, damaged and failed, and how to go on."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from vibroswarm.core.numbers import count, count_of, number, whole
from vibroswarm.show.document import Document, Text
from vibroswarm.study.plan import plan_of
from vibroswarm.study.store import Store
from vibroswarm.study.study_result import StudyResult

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
    resume = f"To resume: vibroswarm evaluate '{about['folder']}/study.toml' --out '{about['folder']}'"
    return Document(
        title=about["name"] or "Study",
        answer=(
            f"{name}: {count(about['cells'], 'cell')}, runs {each}, seed {about['seed']}.",
            f"Done: {count_of(done, wanted, 'run')}, in {count(about['shards'], 'shard')}, "
            f"{number(about['bytes'] / 1e6, 1)} MB; saved: {', '.join(about['keeps'])}.",
            f"Varied: {', '.join(about['varied']) or 'nothing'}.",
        ),
        warnings=tuple(_warnings(about, needed)),
        parts=(*map(Text, made_by), *([Text(resume, "code")] if done < wanted else [])),
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
        yield (
            f"Results need code that is not loaded ({needed}). Run the command that made them again to print them."
        )
