"""Labels of fields in pictures: words with symbol and unit, never the names that they have in files."""

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
        return f"{self.named} ({self.unit})" if self.unit else self.named

    @property
    def named(self) -> str:
        """Words and symbol: ``sample interval τ``."""
        return f"{self.words} {self.symbol}".strip()

    def of(self, value: str) -> str:
        """A value in words: ``sample interval τ 4750 ms``."""
        return f"{self.named} {value} {self.unit}".strip()

    @property
    def short(self) -> str:
        """The symbol, or the words if there is no symbol."""
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
"""Labels of fields to which the paper gives a symbol (see ``scenario.fields``), and of some others. The label of
``floor.source`` is "fill ratio", since pictures of studies draw ``random:0.46, random:0.48, ...`` along an axis by
their fill ratios."""
UNITS: Final = {
    "_ms": "ms",
    "_mm": "mm",
    "_m_s": "m/s",
    "_m": "m",
    "_s": "s",
    "_rad": "rad",
    "_deg": "degrees",
}
"""Unit of each suffix of a field's name. The first suffix that fits counts, so ``_m_s`` stands before ``_s``."""


def label_of(field: str) -> Label:
    """Return the label of a field, given by its full name such as ``walk.avoidance_threshold_mm``."""
    if field in SYMBOLS:
        return SYMBOLS[field]
    name = field.rpartition(".")[2]
    for suffix, unit in UNITS.items():
        if name.endswith(suffix):
            return Label(name.removesuffix(suffix).replace("_", " "), "", unit)
    return Label(name.replace("_", " "))
