"""``vibroswarm show``: what the folder of a study or a search holds."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vibroswarm.study.store import Store


MOST_FAILED = 5
"""Batches that are named one by one."""


def add_parser(commands: Any) -> None:
    """Make the command known."""
    parser = commands.add_parser(
        "show",
        help="tell what the folder of a study or a search holds",
        description="Tell what a folder holds: its study or search, how much is done, what is damaged or failed.",
        allow_abbrev=False,
    )
    parser.add_argument("folder", metavar="DIR", type=Path, help="the folder of a study or a search")
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.set_defaults(run=run, parser=parser)


def run(arguments: argparse.Namespace) -> int:
    """Open the store, check its shards, tell."""
    from vibroswarm.optimize.journal import held, is_search
    from vibroswarm.study.store import Store

    if is_search(arguments.folder):
        search = held(arguments.folder)
        print(json.dumps(search, indent=2) if arguments.json else _search_words(search))
        return 0
    about = told(Store.open(arguments.folder))
    print(json.dumps(about, indent=2) if arguments.json else _words(about))
    return 0


def told(store: Store) -> dict[str, Any]:
    """What is there, in plain values."""
    from vibroswarm.study.plan import plan_of
    from vibroswarm.study.result import StudyResult

    study, plan = store.study, plan_of(store.study)
    cells = StudyResult(study, store, tuple(cell.number for cell in study.cells)).cells
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


def _search_words(about: dict[str, Any]) -> str:
    there, wanted = about["runs_there"], about["runs_wanted"]
    lines = [
        f"A search in {about['folder']}: {about['method']}, {' and '.join(about['objectives'])}, seed {about['seed']}.",
        f"Fields: {', '.join(about['fields'])}.",
        f"Done: {there:,} of {wanted:,} runs ({100 * there / max(wanted, 1):.4g} %), in {about['steps']} steps; "
        f"{about['runs_failed']:,} failed.",
    ]
    if about["result"] is None:
        lines.append("Not scored on fresh runs yet; say the same optimize again to go on.")
        return "\n".join(lines)
    if truth := about["result"].get("truth"):
        score = truth["true"]["score"]
        values = (f"{name} {v:.6g}" if isinstance(v, float) else f"{name} {v}"
                  for name, v in about["result"]["best"].items())  # fmt: skip
        score = {name: math.nan if value is None else value for name, value in score.items()}
        believed = math.nan if truth["believed"] is None else truth["believed"]
        limits = f"[{score['low']:.4g}, {score['high']:.4g}]"
        lines.append(f"Best: {', '.join(values)}")
        lines.append(f"Believed {believed:.4g}, true {score['estimate']:.4g} {limits}. {truth['says']}")
    if front := about["result"].get("front"):
        lines.append(front["says"])
    return "\n".join(lines)


def _words(about: dict[str, Any]) -> str:
    wanted, there = about["runs_wanted"], about["runs_there"]
    each = (
        f"{about['runs_each']:,} each"
        if about["runs_each"]
        else f"until {about['until']['figure']} is known to {about['until']['until']}"
    )
    name = f"{about['name'] or 'A study'} in {about['folder']}"
    lines = [
        f"{name}: {about['cells']} cells, runs {each}, seed {about['seed']}.",
        f"Varied: {', '.join(about['varied']) or 'nothing'}.",
        f"Done: {there:,} of {wanted:,} runs ({100 * there / max(wanted, 1):.4g} %), in {about['shards']} shards, "
        f"{about['bytes'] / 1e6:.1f} MB; kept: {', '.join(about['keeps'])}.",
    ]
    lines += [f"Damaged, and to be made again: {words}" for words in about["damaged"]]
    failed = about["failed_batches"]
    lines += [f"Failed: batch {f['batch']}, seed {f['seed']}: {f['why']}" for f in failed[:MOST_FAILED]]
    if len(failed) > MOST_FAILED:
        lines.append(
            f"... and {len(failed) - MOST_FAILED} more batches that failed, in {about['folder']}/failures."
        )
    if about["left_over_files"]:
        lines.append(f"{about['left_over_files']} files of writers that were killed; they count for nothing.")
    for made in about["made_by"]:
        lines.append(
            f"Made by vibroswarm {made['vibroswarm']} (code {made['code']}) on {made['architecture']}."
        )
    if len(about["made_by"]) > 1:
        lines.append("Different versions made parts of it; as a whole it may not be repeatable.")
    if there < wanted:
        lines.append(f"To go on: vibroswarm sweep '{about['folder']}/study.toml' --out '{about['folder']}'")
    return "\n".join(lines)
