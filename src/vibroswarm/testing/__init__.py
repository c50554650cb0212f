"""What code of one's own must hold to, as functions that a test can call; ``vibroswarm check`` runs them."""

from __future__ import annotations

from vibroswarm.testing.findings import Finding
from vibroswarm.testing.motion import check_motion
from vibroswarm.testing.plain import PlainRun, plain_run
from vibroswarm.testing.strategy import check_strategy

__all__ = ["Finding", "PlainRun", "check_motion", "check_strategy", "plain_run"]
