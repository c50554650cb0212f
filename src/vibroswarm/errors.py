"""The two ways in which a user's wish can fail, and nothing else.

``InputError`` is the user's to mend (exit code 2); ``RunError`` is a failure of the machine or of the
program while it worked (exit code 1). Both are printed as one message, never as a traceback.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """What was asked for cannot be done; the message names the field, the value, and what would be right.

    Args:
        message: what is wrong with the value, and what would be right.
        field: the field, option or file that is wrong, as the user would write it.
    """

    def __init__(self, message: str, *, field: str | None = None) -> None:
        self.field = field
        super().__init__(f"{field}: {message}" if field else message)


class RunError(RuntimeError):
    """Something failed while the work was being done: a full disk, a folder that cannot be written."""


def nearest(word: str, known: Iterable[str]) -> str:
    """``", did you mean 'x'?"`` for the known word nearest to ``word``, or an empty string."""
    match = difflib.get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f", did you mean '{match[0]}'?" if match else ""
