"""A network in which every robot hears every other."""

from __future__ import annotations

from vibroswarm.networks.base import Network, register

ideal = register(Network(name="ideal", about="every robot hears every other"))
