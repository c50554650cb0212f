"""Networks: who hears which message, and when; one file each (``base`` defines the protocol)."""

from __future__ import annotations

from vibroswarm.networks import (  # noqa: F401  (these register themselves)
    bursts,
    delay,
    disc,
    loss,
    tree,
)
from vibroswarm.networks.base import Network, known, names, network, register
from vibroswarm.strategies.world import u

__all__ = ["Network", "known", "names", "network", "register", "u"]
