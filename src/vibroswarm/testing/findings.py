"""Findings of checks, in words."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

from vibroswarm.errors import InputError, RunError


@dataclass(frozen=True)
class Finding:
    """The finding of one check: whether it holds, and if not, why."""

    what: str
    holds: bool
    why: str = ""
    is_warning: bool = False
    """Failure is worth knowing, but not an error."""


def require(condition: object, words: str) -> None:
    """Stop a check if a condition is false; as ``assert``, but under ``python -O`` too.

    Raises:
        AssertionError: it is not so; ``words`` say what is wrong.
    """
    if not condition:
        raise AssertionError(words)


def run_checks(
    checks: Mapping[str, Callable[[str], Iterator[str]]], name: str, warnings: Container[str] = ()
) -> list[Finding]:
    """Run checks of the object called ``name``; failures of ``warnings`` are no errors."""
    return [run_check(what, partial(check, name), what in warnings) for what, check in checks.items()]


def run_check(what: str, check: Callable[[], Iterator[str] | None], is_warning: bool = False) -> Finding:
    """Run a check that yields what is wrong in words, or raises it.

    Args:
        what: what is checked. is_warning: a failure is no error.
    """
    why = ""
    try:
        found = check()
        why = "" if found is None else next(found, "")
    except (InputError, RunError) as error:
        why = str(error)
    except AssertionError as error:
        why = str(error) or "the check failed without a message"
    except Exception as error:  # users' tables and code can be wrong in any way
        why = f"it cannot be checked: {type(error).__name__}: {error}"
    return Finding(what, not why, why, is_warning)
