"""What fields of a scenario are called in pictures: in words, with symbol and unit, never by their names in files."""

from __future__ import annotations

from typing import Final, NamedTuple


class Label(NamedTuple):
    """A field's words, symbol (empty: none) and unit (empty: none)."""

    words: str
    symbol: str = ""
    unit: str = ""

    @property
    def text(self) -> str:
        """Words, symbol and unit: ``sample interval τ (ms)``."""
        named = f"{self.words} {self.symbol}".strip()
        return f"{named} ({self.unit})" if self.unit else named

    @property
    def short(self) -> str:
        """The symbol, or the words."""
        return self.symbol or self.words


SYMBOLS: Final = {
    "walk.walk_duration_location_ms": Label("walk duration, location", "γ₀", "ms"),
    "walk.walk_duration_scale_ms": Label("walk duration, scale", "γ", "ms"),
    "walk.avoidance_threshold_mm": Label("avoidance threshold", "θ_c", "mm"),
    "sample.sample_interval_ms": Label("sample interval", "τ", "ms"),
    "sensor.rms_threshold": Label("sensor threshold", "θ_E"),
    "decision.credible_threshold": Label("credible threshold", "p_c"),
    "decision.min_observations": Label("minimum of observations", "O_c"),
    "decision.decision_boundary": Label("decision boundary"),
    "strategy.soft.eta": Label("feedback", "η"),
    "strategy.soft.kappa": Label("feedback", "κ"),
    "floor.source": Label("fill ratio"),
    "floor.fill_ratio": Label("fill ratio"),
    "swarm.robots": Label("robots"),
}
"""Of the fields to which the paper gives a symbol, see ``scenario.fields``."""
UNITS: Final = {
    "_ms": "ms",
    "_mm": "mm",
    "_m_s": "m/s",
    "_m": "m",
    "_s": "s",
    "_rad": "rad",
    "_deg": "degrees",
}


def label_of(field: str) -> Label:
    """Return the label of a field; those without symbol are called by the words in their names.

    Args:
        field: ``walk.avoidance_threshold_mm``.
    """
    if field in SYMBOLS:
        return SYMBOLS[field]
    name = field.rpartition(".")[2]
    for suffix, unit in UNITS.items():
        if name.endswith(suffix):
            return Label(name.removesuffix(suffix).replace("_", " "), "", unit)
    return Label(name.replace("_", " "))


def setting_words(field: str, value: object) -> str:
    """Write a value of a field for a label: ``γ₀ 4000``, ``κ 2``."""
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return f"{label_of(field).short} {text}"
