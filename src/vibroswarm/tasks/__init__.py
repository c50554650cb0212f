"""Tasks: the question about a floor, and the right decision; one file each (``base`` defines the protocol)."""

from __future__ import annotations

from vibroswarm.tasks import fill_ratio  # noqa: F401  (registers itself)
from vibroswarm.tasks.base import Asked, Task, known, names, register, task

__all__ = ["Asked", "Task", "known", "names", "register", "task"]
