"""Pictures: of a floor, of a run, and of what came out of many.

Each ``draw_*`` takes a plain frame of numbers that somebody else computed, and gives a ``Picture``: the figure,
the numbers as drawn, and a caption. The names below are looked up when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from vibroswarm.lazy import lazy_names

if TYPE_CHECKING:
    from vibroswarm.plots.belief import draw_belief
    from vibroswarm.plots.boxes import draw_boxes
    from vibroswarm.plots.density import draw_density
    from vibroswarm.plots.detection import draw_detection
    from vibroswarm.plots.error_bars import draw_error_bars
    from vibroswarm.plots.forest import draw_forest
    from vibroswarm.plots.front import draw_front
    from vibroswarm.plots.heat import draw_heat
    from vibroswarm.plots.incidence import draw_incidence
    from vibroswarm.plots.outcomes import draw_outcomes
    from vibroswarm.plots.picture import Picture, write_picture
    from vibroswarm.plots.search import draw_parameters, draw_search
    from vibroswarm.plots.violins import draw_violins

__all__ = [
    "Picture",
    "draw_belief",
    "draw_boxes",
    "draw_density",
    "draw_detection",
    "draw_error_bars",
    "draw_forest",
    "draw_front",
    "draw_heat",
    "draw_incidence",
    "draw_outcomes",
    "draw_parameters",
    "draw_search",
    "draw_violins",
    "write_picture",
]

_HOME: Final = {
    "Picture": "picture",
    "draw_belief": "belief",
    "draw_boxes": "boxes",
    "draw_density": "density",
    "draw_detection": "detection",
    "draw_error_bars": "error_bars",
    "draw_forest": "forest",
    "draw_front": "front",
    "draw_heat": "heat",
    "draw_incidence": "incidence",
    "draw_outcomes": "outcomes",
    "draw_parameters": "search",
    "draw_search": "search",
    "draw_violins": "violins",
    "write_picture": "picture",
}

__getattr__ = lazy_names(__name__, _HOME)


def __dir__() -> list[str]:
    return sorted(__all__)
