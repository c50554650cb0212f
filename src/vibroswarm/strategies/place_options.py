"""The variant of ``places`` that its options ask for: functions, memory and size of messages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from types import ModuleType
from typing import Any, Final

from vibroswarm.errors import InputError
from vibroswarm.strategies import place_samples, place_summaries
from vibroswarm.strategies.base import MAX_BYTES, Strategy, array
from vibroswarm.strategies.static_analysis import STRATEGY_HOOKS

TWELVE_BITS: Final = 4095


def with_options(places: Strategy, p: Any, sizes: Mapping[str, int]) -> Strategy:
    """Return the variant of ``places`` for these parameters; see ``places.variant``."""
    field = f"strategy.{places.name}"
    if p.rate_pairs:
        on = next(name for name in ("energies", "draws", "share_map") if getattr(p, name))
        raise InputError(f"does not go with {on}; leave one out", field=f"{field}.rate_pairs")
    if p.draws == 1:
        raise InputError(
            "1 draw says nothing of how sure it is; give 2 to 4, or 0 for mean and spread",
            field=f"{field}.draws",
        )
    if p.share_map and p.draws:
        raise InputError("does not go with share_map; leave one out", field=f"{field}.draws")
    size = message_bytes(p, sizes)
    if size > MAX_BYTES:
        raise InputError(
            f"a map of {sizes['tiles']} tiles takes {size} bytes; a message has {MAX_BYTES}",
            field=f"{field}.share_map",
        )
    return _variant(places, p.share_map, max(p.draws, 1), size)


def message_bytes(p: Any, sizes: Mapping[str, int]) -> int:
    """Return the size of a message, bytes.

    Args:
        sizes: tiles, and the arena's longer side, ``longest_mm``.
    """
    if p.share_map:
        return place_summaries.HEADER_BYTES + sizes["tiles"]
    if p.draws:
        return 4 + 4 * int(p.draws) + int(p.energies)
    return 9 if p.energies and sizes["longest_mm"] > TWELVE_BITS else 8


@cache
def _variant(places: Strategy, share_map: bool, maps: int, size: int) -> Strategy:
    module: ModuleType = place_summaries if share_map else place_samples
    arrays = type("Arrays", (module.Arrays,), {"odds": array("float64", f"{maps}*robots*tiles")})
    changed: dict[str, Any] = {hook: getattr(module, hook, None) for hook in STRATEGY_HOOKS}
    changed |= {"state": module.State, "message": module.Message, "arrays": arrays}
    return replace(places, **changed, bytes_on_air=size, reads_details=True)
