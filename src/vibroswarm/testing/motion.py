"""Checks of every motion source."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import Final

from vibroswarm.errors import InputError, RunError
from vibroswarm.motion.source import Source
from vibroswarm.motion.source import source as source_of
from vibroswarm.testing.motion_cases import SHORT_CASE, Check, motion_of
from vibroswarm.testing.motion_segments import MOVE_CHECKS, SEGMENT_CHECKS
from vibroswarm.testing.motion_tables import TABLE_CHECKS, check_runs_differ
from vibroswarm.testing.runs import Finding, run_check

WARNINGS_ONLY: Final = (check_runs_differ,)
"""Checks whose failure is not an error: a recording is the same in every run."""


def check_motion(name: str) -> list[Finding]:
    """Run all checks of a registered motion source; those of segments and moves only if it gives them.

    Args:
        name: by which it is known.
    Raises:
        InputError: there is no such source.
    """
    source = source_of(name)  # once, as tables are cached by source
    return [
        run_check(words_of(check), lambda check=check: check(source), check in WARNINGS_ONLY)  # type: ignore[misc]
        for check in _applicable(source)
    ]


def words_of(check: Check) -> str:
    """Return what a check checks: the first line of its docstring."""
    return (inspect.getdoc(check) or check.__name__).splitlines()[0].rstrip(".")


def _applicable(source: Source) -> Iterator[Check]:
    """Yield the checks for the tables that this source can fill."""
    yield from TABLE_CHECKS
    try:
        motion = motion_of(source, SHORT_CASE)
    except (InputError, RunError):  # the first check reports it
        return
    if motion.segments is not None:
        yield from SEGMENT_CHECKS
        if motion.moves is not None:
            yield from MOVE_CHECKS
