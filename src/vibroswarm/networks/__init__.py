"""Who hears which message, and when; one network a file (``base`` says what one is made of)."""

from __future__ import annotations

from vibroswarm.networks import ideal, loss  # noqa: F401  (these make themselves known)
from vibroswarm.networks.base import Network, known, names, network, register
from vibroswarm.strategies.world import u

__all__ = ["Network", "known", "names", "network", "register", "u"]
