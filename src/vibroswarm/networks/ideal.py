"""A network in which everybody hears everybody."""

from __future__ import annotations

from vibroswarm.networks.base import Network, register

ideal = register(Network(name="ideal", about="everybody hears everybody"))
