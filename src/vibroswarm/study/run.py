"""Run a study and return its result; merge the folders of its parts."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path

from vibroswarm.core.atomic_io import whole_file
from vibroswarm.core.folders import has_manifest
from vibroswarm.errors import InputError, RunError, check_kind
from vibroswarm.study.plan import plan_of
from vibroswarm.study.runner import Job, Progress, run_study
from vibroswarm.study.spec import Study
from vibroswarm.study.store import SHARDS, Store, resume_command
from vibroswarm.study.study_result import StudyResult, _TemporaryFolder


def run(
    study: Study,
    folder: str | Path | None = None,
    *,
    executor: str | Executor = "threads",
    workers: int | None = None,
    job: Job | None = None,
    mixed: bool = False,
    progress: Progress | None = None,
    allow_failures: bool = False,
) -> StudyResult:
    """Run a study, or continue it, and return its result.

    Args:
        folder: where the study is saved; None: a temporary folder, which is removed with the result.
        executor, workers, job, mixed, progress, allow_failures: see ``runner.run_study``.
    Raises:
        InputError, RunError: see ``runner.run_study``.
    """
    folder = None if folder is None else Path(folder)
    if job is not None:
        check_kind(job, Job, "job", "a Job")
    temporary = _TemporaryFolder() if folder is None else None
    # ``folder`` is None only if there is a temporary folder; ``or ""`` is for type checkers.
    target = temporary.folder / "study" if temporary is not None else Path(folder or "")
    store = run_study(
        study,
        target,
        executor=executor,
        workers=workers,
        job=job,
        mixed=mixed,
        progress=progress,
        allow_failures=allow_failures,
    )
    # The result refers to the temporary folder, which is removed with the last such result.
    return StudyResult(study, store, selected=tuple(cell.number for cell in study.cells), _kept=temporary)


def jobs_of_one_study(shares: Sequence[Path], *, mixed: bool = False) -> list[Store]:
    """Open the stores of several jobs, at least one.

    Args:
        mixed: whether versions may differ.
    Raises:
        InputError: no folder, or one that holds no study, another study or one with a precision, or versions differ.
    """
    if not shares:
        raise InputError("is empty; give the folders of the jobs", field="shares")
    stores = [Store.open(folder) for folder in shares]
    for store in stores[1:]:
        if store.study.hash != stores[0].study.hash:
            raise InputError(f"is of another study than '{shares[0]}'", field=str(store.folder))
    for store in stores:
        if store.study.until is not None:
            raise InputError(
                "runs until a precision; such a study has no jobs to merge", field=str(store.folder)
            )
    if not mixed:
        # All shards are put in one store in memory, as of one group, to compare their versions.
        all_shards = [shard for store in stores for shard in store.shards]
        Store(stores[0].folder, stores[0].study, by_group={0: all_shards}).check_alike()
    return stores


def merge(out: Path, shares: Sequence[Path], *, mixed: bool = False) -> Store:
    """Merge the stores of several jobs of a study into one store.

    Args:
        out: folder of the merged store; created, or continued if it holds the same study.
        shares: folders of the jobs, at least one; they are not changed.
        mixed: whether versions may differ.
    Raises:
        InputError: a folder holds no study, another study or one with a precision, or versions differ.
        RunError: runs are missing in all folders; the message lists the first of them. What was merged stays in
            ``out``.
    """
    stores = jobs_of_one_study(shares, mixed=mixed)
    # The jobs may have been run with different numbers of runs: the merged study has the largest.
    runs = max((store.study.runs or 0 for store in stores), default=0)
    if has_manifest(Path(out)):  # ``out`` may have more runs than these jobs
        runs = max(runs, Store.open(out).study.runs or 0)
    joined = Store.open_or_create(out, stores[0].study.with_runs(runs))
    present = {shard.name for shard in joined.shards}
    for store in stores:
        for shard in store.shards:
            if shard.name in present:
                continue
            # The description is copied last: without it, a shard is ignored.
            for path in [*shard.files.values(), store.root / SHARDS / f"{shard.name}.json"]:
                with whole_file(joined.root / SHARDS / path.name) as part:
                    shutil.copyfile(path, part)
    joined.refresh()
    if not mixed:
        joined.check_alike()  # again, since ``out`` may have had shards before
    damaged = [f"{store.folder}: {words}" for store in stores for words in store.damaged]
    lost = [
        f"{group.number}:{first}-{last}"
        for group in plan_of(joined.study).groups
        for _, first, last in joined.missing(group, runs)
    ]
    if lost:
        damage = f" (damaged: {'; '.join(damaged[:3])})" if damaged else ""
        some = ", ".join(lost[:5]) + (f" and {len(lost) - 5} more" if len(lost) > 5 else "")
        raise RunError(
            f"'{out}' is incomplete: batches {some} are in none of the folders{damage}. Run the job that lacks them "
            f"again and merge it too, or finish here: {resume_command(out)}"
        )
    return joined
