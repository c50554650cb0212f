"""What the folder of a study holds: how much is done and damaged, how to go on; and what its runs say."""

from __future__ import annotations

import shlex
from typing import Any, Final

from vibroswarm.core.numbers import count, count_of, whole
from vibroswarm.documents.study import study_document
from vibroswarm.errors import InputError
from vibroswarm.show.document import Document, Text
from vibroswarm.study.runs import Runs, groups_of
from vibroswarm.study.spec import MARKER, Study
from vibroswarm.study.summary import outcome_of


def study_state(study: Study, runs: Runs) -> dict[str, Any]:
    """Return the state of a study's folder in plain values, which ``--json`` prints: sums are over cells."""
    cells, store = runs.cell_table, runs.store
    return {
        "folder": str(runs.folder),
        "name": study.name,
        "study_hash": study.hash,
        "seed": study.seed,
        "varied": study.varied,
        "cells": len(study.cells),
        "motion_groups": len(groups_of(study.cells)),
        "runs_wanted": int(cells["wanted"].sum()),
        "runs_there": int(cells["there"].sum()),
        "runs_each": study.runs,
        "until": None if study.until is None else study.until.as_values(),
        "files": len(store.blocks),
        "damaged": [path.name for path in store.damaged],
        "other_runs": store.other_runs,
        "made_by": [dict(versions) for versions in store.made_by],
    }


def state_document(about: dict[str, Any], needed: str = "") -> Document:
    """Return the state of a study's folder.

    Args:
        about: the state of the study, as ``study_state`` returns it.
        needed: the user's code that its results need; empty: none (``results_or_need``).
    """
    wanted, done = about["runs_wanted"], about["runs_there"]
    each = f"{whole(about['runs_each'])} each" if about["runs_each"] else "until a precision"
    warnings = [f"Damaged, to be recomputed: {name}" for name in about["damaged"]]
    if about["other_runs"]:
        warnings.append(f"{count(about['other_runs'], 'run')} of another version of the code are not used.")
    if needed:
        warnings.append(f"The results need code that is not loaded ({needed}).")
    again = shlex.join(["vibroswarm", "evaluate", f"{about['folder']}/{MARKER}", "--out", about["folder"]])
    return Document(
        title=about["name"] or "Study",
        answer=(
            f"{count(about['cells'], 'cell')}, runs {each}, seed {about['seed']}; done: "
            f"{count_of(done, wanted, 'run')}. Varied: {', '.join(about['varied']) or 'nothing'}.",
        ),
        warnings=tuple(warnings),
        parts=(Text(f"To resume: {again}" if done < wanted else "", "code"),),
    )


OF_CODE: Final = ("strategy.name", "network.name", "task.name", "sensor.model")
"""Fields of a scenario that may name the user's own code."""


def results_or_need(runs: Runs) -> tuple[Document | None, str]:
    """Return what finished runs say and an empty text; or None, without any, and the user's code that they need.

    Without ``--trust``, ``show`` does not run such code.
    """
    try:
        return study_document(outcome_of(runs)) if any(runs.there.values()) else None, ""
    except InputError as error:
        if error.field not in OF_CODE:
            raise
        return None, str(error)
