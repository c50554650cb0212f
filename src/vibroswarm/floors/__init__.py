"""Floors: patterns, files, difficulty, and making a floor of given difficulty.

Names are looked up when they are first used, so that importing this room loads neither Pillow nor SciPy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from vibroswarm.lazy import lazy_names

if TYPE_CHECKING:
    from vibroswarm.floors.design import Made, make_floor
    from vibroswarm.floors.difficulty import Difficulty, entropy, measure, moran_index
    from vibroswarm.floors.files import parse_tiles, read_tiles, write_tiles
    from vibroswarm.floors.floor import Floor
    from vibroswarm.floors.patterns import pattern
    from vibroswarm.floors.random import random_tiles
    from vibroswarm.floors.source import is_random, named_tiles, resolve

__all__ = [
    "Difficulty",
    "Floor",
    "Made",
    "entropy",
    "is_random",
    "make_floor",
    "measure",
    "moran_index",
    "named_tiles",
    "parse_tiles",
    "pattern",
    "random_tiles",
    "read_tiles",
    "resolve",
    "write_tiles",
]

_HOME: Final = {
    "Difficulty": "difficulty",
    "Floor": "floor",
    "Made": "design",
    "entropy": "difficulty",
    "is_random": "source",
    "make_floor": "design",
    "measure": "difficulty",
    "moran_index": "difficulty",
    "named_tiles": "source",
    "parse_tiles": "files",
    "pattern": "patterns",
    "random_tiles": "random",
    "read_tiles": "files",
    "resolve": "source",
    "write_tiles": "files",
}


__getattr__ = lazy_names(__name__, _HOME)


def __dir__() -> list[str]:
    return sorted(__all__)
