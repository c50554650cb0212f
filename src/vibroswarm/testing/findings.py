"""What a check finds, in words, whatever comes of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from vibroswarm.errors import InputError, RunError


@dataclass(frozen=True)
class Finding:
    """What one check found: whether it holds, and what is wrong."""

    what: str
    holds: bool
    why: str = ""
    only_told: bool = False
    """It is worth knowing, and not wrong."""


def hold(condition: object, words: str) -> None:
    """Stop a check unless something is so; as ``assert``, but under ``python -O`` too.

    Raises:
        AssertionError: it is not so; ``words`` say what is wrong.
    """
    if not condition:
        raise AssertionError(words)


def tried(what: str, check: Callable[[], Iterator[str] | None], only_told: bool = False) -> Finding:
    """What comes of a check that gives what is wrong in words, or raises it.

    Args:
        what: what is checked. only_told: a failure is no error.
    """
    why = ""
    try:
        found = check()
        why = "" if found is None else next(found, "")
    except (InputError, RunError) as error:
        why = str(error)
    except AssertionError as error:
        why = str(error) or "it is not so; the check says no more"
    except (
        Exception
    ) as error:  # tables, or code of the user's, can be wrong in ways that nobody has thought of
        why = f"it cannot be checked: {type(error).__name__}: {error}"
    return Finding(what, not why, why, only_told)
