"""Tasks: the question about a floor, its answers, and the right one; one file each (``base`` defines the protocol)."""

from __future__ import annotations

from vibroswarm.tasks import changed, fill_ratio, majority, share  # noqa: F401  (they register themselves)
from vibroswarm.tasks.base import Asked, Task, known, names, register, task

__all__ = ["Asked", "Task", "known", "names", "register", "task"]
