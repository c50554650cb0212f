"""Floors: patterns, files, difficulty, and floors designed to a given difficulty.

Names are imported on first use, so that importing this package loads neither Pillow nor SciPy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from vibroswarm.core.lazy_names import lazy_names

if TYPE_CHECKING:
    from vibroswarm.floors.design import FloorDesign, make_floor
    from vibroswarm.floors.difficulty import Difficulty, entropy, measure, moran_index
    from vibroswarm.floors.floor import Floor
    from vibroswarm.floors.grid_text import parse_tiles
    from vibroswarm.floors.io import read_tiles, write_tiles
    from vibroswarm.floors.source import is_random, named_tiles, pattern, random_tiles, resolve

__all__ = [
    "Difficulty",
    "Floor",
    "FloorDesign",
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
    "FloorDesign": "design",
    "entropy": "difficulty",
    "is_random": "source",
    "make_floor": "design",
    "measure": "difficulty",
    "moran_index": "difficulty",
    "named_tiles": "source",
    "parse_tiles": "grid_text",
    "pattern": "patterns",
    "random_tiles": "source",
    "read_tiles": "io",
    "resolve": "source",
    "write_tiles": "io",
}


__getattr__ = lazy_names(__name__, _HOME)


def __dir__() -> list[str]:
    return sorted(__all__)
