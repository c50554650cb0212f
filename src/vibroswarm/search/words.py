"""A search from the words of ``vibroswarm optimize``, so that Python runs the same with the same words::

searched(search_of(method="tpe", budget=5000), Path("out"))
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from vibroswarm.core.stages import SILENT, Stages
from vibroswarm.errors import InputError
from vibroswarm.search.loop import Found, run_search
from vibroswarm.search.methods import SearchProgress
from vibroswarm.search.search_files import made_by, write_search
from vibroswarm.search.spec import Search
from vibroswarm.search.validation import Front, Truth, validated
from vibroswarm.study.options import chosen
from vibroswarm.study.run import StudyProgress


def search_of(
    file: Path | None = None,
    /,
    *,
    method: str | None = None,
    noise: str | None = None,
    cost: str | None = None,
    budget: int | None = None,
    fresh: int | None = None,
    seed: int | None = None,
) -> Search:
    """Return the search of a file, or else the default search, changed by words.

    Args:
        cost: replaces all objectives by a single one, which keeps two settings of the first: its statistic, and whether
            the score is that of the worst case or the mean over cases (``over``).
    Raises:
        InputError: a word or the file is wrong.
    """
    method = None if method is None else chosen("method", method)
    # Reading checks how these words fit the other entries of the file; no entries are the default search.
    words: dict[str, Any] = {"method": method, "cost": cost, "budget": budget, "noise": noise}
    search = Search.from_toml("", **words) if file is None else Search.read(file, **words)
    if noise is not None and (method or search.settings.method) != "pso":
        raise InputError("applies to the method pso only", field="--noise")
    return replace(
        search,
        study=search.study if seed is None else replace(search.study, seed=seed),
        settings=search.settings if fresh is None else replace(search.settings, fresh=fresh),
    )


def searched(
    search: Search,
    folder: Path | None = None,
    *,
    progress: Callable[[SearchProgress], None] = lambda state: None,
    stages: Stages = SILENT,
    **where: Any,
) -> tuple[Found, Truth | None, Front | None, list[dict[str, str]]]:
    """Run a search, score its winner or its Pareto front on fresh runs, and write its files.

    Args:
        folder: where it is saved, and continued; None: nowhere. progress: told the state of the search. stages: told
            how many fresh runs are done. where: as of ``run_search``.
    Returns: the search; its winner on fresh runs, None with several objectives; the Pareto front on fresh runs, None
        with one objective; and what made the folder, empty without one.
    Raises:
        InputError: the search or the folder is wrong.
    """
    found = run_search(search, folder, progress=progress, **where)
    truth, front = validated(found, folder, counting(stages), **where)
    if folder is not None:
        write_search(found, folder, front)
    return found, truth, front, [] if folder is None else made_by(folder)


def counting(stages: Stages) -> Callable[[str, int], AbstractContextManager[Callable[[int], None]]]:
    """Return a function that begins a stage, given its name and number of runs; a stage takes how many are done."""

    @contextmanager
    def stage(what: str, runs: int) -> Iterator[Callable[[int], None]]:
        with stages.runs(what) as progress:
            yield lambda done: progress(StudyProgress(done, runs))

    return stage
