"""A search from the options of ``vibroswarm optimize``, so that Python runs the same with the same keywords::

searched(search_of(method="tpe", budget=5000), Path("out"))
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vibroswarm.errors import InputError
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.search.loop import Found, Progress, run_search
from vibroswarm.search.search_files import write_search
from vibroswarm.search.spec import Search
from vibroswarm.search.validation import Front, Truth, front_of, truth_of
from vibroswarm.study.options import chosen, values_of


def search_of(
    file: Path | None = None,
    /,
    *,
    method: str | None = None,
    seed: int | None = None,
    strategy: str | None = None,
    robots: int | None = None,
    floor: str | None = None,
    **settings: Any,
) -> Search:
    """Return the search of a file, or else the default search, changed by options.

    Args:
        strategy, robots, floor: replace those of the file's scenario.
        settings: ``noise``, ``cost``, ``budget`` and ``fresh``, None as if left out, see ``Search.from_toml``.
    Raises:
        InputError: an option or the file is wrong.
    """
    settings["method"] = None if method is None else chosen("method", method)
    search = Search.from_toml("", **settings) if file is None else Search.read(file, **settings)
    study = search.study if seed is None else replace(search.study, seed=seed)
    base = study.base if isinstance(study.base, Scenario) else Scenario.from_base(dict(study.base))
    values = values_of(base, strategy=strategy, robots=robots, floor=floor)
    if values.keys() & {*study.varied, *search.space.names}:
        raise InputError("is searched over or varied by the file", field=next(iter(values)))
    return replace(search, study=replace(study, base=base.with_values(values)) if values else study)


@dataclass(frozen=True)
class Searched:
    """A search that was validated."""

    found: Found
    truth: Truth | None
    """The winner on fresh runs; None with several objectives."""
    front: Front | None
    """The Pareto front on fresh runs; None with one objective."""


def searched(
    search: Search,
    folder: Path | None = None,
    *,
    progress: Progress = lambda state: None,
    validating: Callable[[int], None] = lambda done: None,
    **where: Any,
) -> Searched:
    """Run a search, score its winner or its Pareto front on fresh runs, and write its files.

    Args:
        folder: where it is saved, and continued; None: nowhere. progress: of the search. validating: called with the
            number of finished fresh runs. where: as of ``run_search``.
    Raises:
        InputError: the search or the folder is wrong.
    """
    found = run_search(search, folder, progress=progress, **where)
    how = {"folder": folder, "progress": validating, **where}
    truth = truth_of(found, **how) if len(search.objectives) == 1 else None
    front = front_of(found, **how) if found.front else None
    if folder is not None:
        write_search(found, folder, front)
    return Searched(found, truth, front)
