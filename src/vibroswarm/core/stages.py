"""How long work tells its caller what it does: in stages, each a context whose value is called with its progress."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, NamedTuple


class Stages(NamedTuple):
    """Functions that begin a stage of some name, such as "simulating"."""

    runs: Callable[[str], AbstractContextManager[Callable[[Any], None]]]
    """A stage that counts runs; its progress is a ``study.run.StudyProgress``."""
    share: Callable[[str], AbstractContextManager[Callable[[float], None]]]
    """A stage whose progress is a share, 0 to 1."""
