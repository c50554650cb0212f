"""What a robot says and when it decides; one strategy a file (``base`` says what one is made of)."""

from __future__ import annotations

from vibroswarm.strategies import none, positive, soft  # noqa: F401  (these make themselves known)
from vibroswarm.strategies.base import Strategy, known, names, register, strategy

__all__ = ["Strategy", "known", "names", "register", "strategy"]
