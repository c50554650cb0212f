"""The paper's own numbers, printed or read off its figures: the only ones that anybody typed in."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any, Final

from vibroswarm.errors import InputError

FIELDS: Final = {
    "gamma0_ms": "walk.walk_duration_location_ms",
    "gamma_ms": "walk.walk_duration_scale_ms",
    "tau_ms": "sample.sample_interval_ms",
    "theta_c_mm": "walk.avoidance_threshold_mm",
    "O_c": "decision.min_observations",
}
"""The searched parameters as the paper names them, and as a scenario does."""


@cache
def _all() -> dict[str, Any]:
    text = files("vibroswarm.paper").joinpath("published.json").read_text(encoding="utf-8")
    found: dict[str, Any] = json.loads(text)
    return found


def published(path: str) -> Any:
    """A number or list by its dotted name in ``published.json``, such as ``simulation.fill_ratios``.

    Raises:
        InputError: there is none.
    """
    found: Any = _all()
    for name in path.split("."):
        if not isinstance(found, dict) or name not in found:
            raise InputError("is no number of the paper", field=path)
        found = found[name]
    return found


def parameters(name: str) -> dict[str, Any]:
    """The fields that ``P0`` or ``P_star`` sets."""
    values = zip(published("parameters.names"), published(f"parameters.{name}"), strict=True)
    return {FIELDS[key]: value for key, value in values}
