"""Sensors: what a sample measures on each kind of tile, and which reading that is; one file each (see ``base``)."""

from __future__ import annotations

from vibroswarm.sensors import acceleration, confusion, energies, gamma  # noqa: F401  (they register themselves)
from vibroswarm.sensors.base import Samples, SensorModel, forget, known, names, register, sensor

__all__ = ["Samples", "SensorModel", "forget", "known", "names", "register", "sensor"]
