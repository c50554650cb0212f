"""Shares of a study joined: their shards are copied into one store."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from vibroswarm.errors import InputError, RunError
from vibroswarm.files import whole_file
from vibroswarm.study.plan import plan_of
from vibroswarm.study.store import SHARDS, Store


def merge(out: Path, shares: Sequence[Path]) -> Store:
    """The store that holds all shards of the shares.

    Raises:
        InputError: a folder is no study, or of another study, or its versions differ.
        RunError: a shard is damaged, or runs are missing when all are joined (which are said); what is there is kept.
    """
    stores = [Store.open(folder) for folder in shares]
    for store in stores[1:]:
        if store.study.hash != stores[0].study.hash:
            raise InputError(f"is of another study than '{shares[0]}'", field=str(store.folder))
    for store in stores:
        if store.study.until is not None:
            raise InputError("runs until a precision; such a study has no shares", field=str(store.folder))
    runs = max((store.study.runs or 0 for store in stores), default=0)
    together = Store(Path(out), stores[0].study, shards=[s for store in stores for s in store.shards])
    together.check_alike()
    joined = Store.open_or_create(out, stores[0].study.with_runs(runs))
    there = {shard.name for shard in joined.shards}
    for store in stores:
        for shard in store.shards:
            if shard.name in there:
                continue
            for path in [*shard.files.values(), store.folder / SHARDS / f"{shard.name}.json"]:
                with whole_file(joined.folder / SHARDS / path.name) as part:
                    shutil.copyfile(path, part)
    joined.refresh()
    joined.check_alike()
    damaged = [f"{store.folder}: {words}" for store in stores for words in store.damaged]
    lost = [
        f"{group.number}:{first}-{last}"
        for group in plan_of(joined.study).groups
        for _, first, last in joined.missing(group, runs)
    ]
    if lost:
        told = f" (damaged: {'; '.join(damaged[:3])})" if damaged else ""
        some = ", ".join(lost[:5]) + (f" and {len(lost) - 5} more" if len(lost) > 5 else "")
        raise RunError(
            f"'{out}' is not whole: batches {some} are in none of the shares{told}. Do the share that lacks them "
            f"again and merge it too, or finish here: vibroswarm sweep '{out / 'study.toml'}' --out '{out}'"
        )
    return joined
