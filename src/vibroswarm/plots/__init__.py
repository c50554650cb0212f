"""Pictures of floors, of runs, and of the results of many runs.

Each ``draw_*`` takes a frame of computed numbers and returns a ``Picture``: the figure, the numbers as drawn, and a
caption. ``title`` stands above it; ``style`` is "column", "page" or "slide". A wrong frame is an ``InputError``.
"""

from __future__ import annotations

from vibroswarm.plots.curves import draw_detection, draw_incidence, draw_spectrum
from vibroswarm.plots.distributions import draw_boxes, draw_outcomes
from vibroswarm.plots.error_bars import draw_error_bars
from vibroswarm.plots.front import draw_front
from vibroswarm.plots.heat import draw_density, draw_heat
from vibroswarm.plots.picture import Picture
from vibroswarm.plots.reports import draw_reports
from vibroswarm.plots.run import draw_run
from vibroswarm.plots.search import draw_parameters, draw_search

__all__ = [
    "Picture",
    "draw_boxes",
    "draw_density",
    "draw_detection",
    "draw_error_bars",
    "draw_front",
    "draw_heat",
    "draw_incidence",
    "draw_outcomes",
    "draw_parameters",
    "draw_reports",
    "draw_run",
    "draw_search",
    "draw_spectrum",
]
