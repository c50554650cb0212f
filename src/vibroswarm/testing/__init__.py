"""What every strategy must hold to, as functions that a test of one's own can call; ``vibroswarm check`` runs them."""

from __future__ import annotations

from vibroswarm.testing.plain import PlainRun, plain_run
from vibroswarm.testing.strategy import Finding, check_strategy

__all__ = ["Finding", "PlainRun", "check_strategy", "plain_run"]
