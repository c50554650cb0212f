"""Public names and where they are; ``__init__.py`` imports each on first use."""

from .design import FloorDesign as FloorDesign
from .design import make_floor as make_floor
from .difficulty import Difficulty as Difficulty
from .difficulty import entropy as entropy
from .difficulty import measure as measure
from .difficulty import moran_index as moran_index
from .floor import Floor as Floor
from .io import parse_tiles as parse_tiles
from .io import read_tiles as read_tiles
from .io import write_tiles as write_tiles
from .source import is_random as is_random
from .source import named_tiles as named_tiles
from .source import pattern as pattern
from .source import random_tiles as random_tiles
from .source import resolve as resolve
