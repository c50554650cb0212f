"""What is asked of a floor, and which decision is right; one task a file (``base`` says what one is made of)."""

from __future__ import annotations

from vibroswarm.tasks import fill_ratio  # noqa: F401  (it makes itself known)
from vibroswarm.tasks.base import Asked, Task, known, names, register, task

__all__ = ["Asked", "Task", "known", "names", "register", "task"]
